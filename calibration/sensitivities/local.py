"""Local sensitivities: how ε at each velocity moves with each input, exactly."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike, Float

import softjax as sj
from calibration.sensitivities.inputs import (
    Inputs,
    as_inputs,
    check_velocity,
    dimension,
    padded,
    symbol,
)

VELOCITY = "velocity"


@dataclass(frozen=True, eq=False)
class Sensitivities:
    """θ ∂ε/∂θ of p inputs, the velocity among them, at n velocities.

    Attributes:
        names: of the inputs, (p,); the last is "velocity".
        values: θ, (p - 1,), of all but the velocity.
        velocity: v [m/s], (n,).
        coefficient: ε [-], (n,).
        absolute: θ ∂ε/∂θ [-], (n, p): the change of ε for a relative change of θ. Zero where
            θ = 0; for a negative Poisson's ratio it keeps its sign.
        status: flags of each collision, (n,).
    """

    names: tuple[str, ...]
    values: Float[np.ndarray, " inputs"]
    velocity: Float[np.ndarray, " n"]
    coefficient: Float[np.ndarray, " n"]
    absolute: Float[np.ndarray, "n p"]
    status: np.ndarray

    @property
    def logarithmic(self) -> Float[np.ndarray, "n p"]:
        """∂ln ε/∂ln θ [-]; NaN where ε = 0 and θ ∂ε/∂θ alone has a meaning."""
        answered = self.coefficient > 0
        safe = np.where(answered, self.coefficient, np.nan)
        return self.absolute / safe[:, None]

    def of(self, name: str) -> Float[np.ndarray, " n"]:
        """θ ∂ε/∂θ of one input."""
        return self.absolute[:, self.names.index(name)]

    def rows(self, which: slice) -> "Sensitivities":
        """The same at some of the velocities."""
        columns = ("velocity", "coefficient", "absolute", "status")
        return replace(self, **{name: getattr(self, name)[which] for name in columns})

    def dimensional_sums(self) -> Float[np.ndarray, "n 3"]:
        """Σ_θ [θ]_u θ ∂ε/∂θ for u = kg, m, s, with [θ]_u the exponent of u in θ's unit.

        ε has no unit, so it is the same in any units: each of the three sums is zero. For two
        spheres of one material they read

            kg:  S_E + S_Y + S_ρ = 0
            m:   S_R + S_v - S_E - S_Y - 3 S_ρ = 0
            s:   -2 S_E - 2 S_Y - S_v = 0

        and so S_R = 0 and S_v = 2 S_ρ: ε depends on no size, and on v only as v √(ρ/E).
        """
        exponents = np.array([dimension(name) for name in self.names], float)
        return self.absolute @ exponents

    def ranked(self, velocity: float) -> list[tuple[str, float]]:
        """(name, θ ∂ε/∂θ) at the velocity nearest to the one asked for, the largest first."""
        row = self.absolute[np.argmin(np.abs(self.velocity - velocity))]
        order = np.argsort(-np.abs(row), kind="stable")
        return [(self.names[i], float(row[i])) for i in order]

    def __repr__(self) -> str:
        shown = ", ".join(symbol(name) for name in self.names)
        return f"Sensitivities({len(self.velocity)} velocities; θ ∂ε/∂θ of {shown})"


def sensitivity(
    inputs: Inputs | sj.ContactLaw,
    velocity: Float[ArrayLike, "..."],
    route: sj.EnergyBalance | sj.ODE | None = None,
) -> Sensitivities:
    """θ ∂ε/∂θ of every input at every velocity, from one forward pass for all of them.

    Args:
        inputs: `Inputs` (e.g. `of_spheres(material, radius, chi=…, sigma=…, psi=…)`, whose E, ν,
            ρ, Y, R are those of the bodies) or a law, whose stored fields are then the inputs.
        velocity: v [m/s], a number or any shape (taken flat).
        route: as `softjax.restitution` takes it: the energy balance where the law can, if not told.

    Where two bodies have the same yield strength, ε has a kink in each body's own: it is given
    for the body that yields, the second one.

    Raises:
        ValueError: naming the argument, its value and what is accepted.
    """
    inputs = as_inputs(inputs)
    velocity = check_velocity(velocity)
    inputs.law()  # refuses values that make no law
    names = tuple(inputs.values)
    values = np.array([inputs.values[name] for name in names], float)
    found = _scaled_jacobian(values, padded(velocity), names, inputs.build, route)
    absolute, coefficient, status = (np.asarray(x)[: len(velocity)] for x in found)
    return Sensitivities(
        names=(*names, VELOCITY),
        values=values,
        velocity=velocity,
        coefficient=coefficient,
        absolute=absolute + 0.0,  # no -0
        status=status,
    )


@partial(jax.jit, static_argnames=("names", "build", "route"))
def _scaled_jacobian(values, velocity, names: Sequence[str], build, route):
    """∂ε/∂s at s = 0 with θ (1 + s) for θ and v (1 + s) for v: θ ∂ε/∂θ, whatever θ's sign.

    Then ε and the status.
    """

    def coefficient(s):
        moved = dict(zip(names, values * (1 + s[:-1]), strict=True))
        hit = sj.restitution(build(moved), velocity * (1 + s[-1]), route=route)
        return hit.coefficient, (hit.coefficient, hit.status)

    # jacfwd maps all unit tangents through one linearised pass over the whole batch
    slopes, (value, status) = jax.jacfwd(coefficient, has_aux=True)(jnp.zeros(len(names) + 1))
    return slopes, value, status
