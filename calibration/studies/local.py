"""Local sensitivities: how ε at each velocity moves with each input, exactly."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike, Float, Int

import softjax as sj
from calibration.errors import DataError
from calibration.fitting.result import FitResult
from calibration.studies.inputs import VELOCITY, Inputs, as_inputs, check_velocity
from softjax.fields import Declared

PADDING = 64  # most batches of velocities share one compilation
# exponents of kilogram, metre and second
DIMENSIONS = {
    "-": (0, 0, 0),
    "Pa": (1, -1, -2),
    "N/m": (1, 0, -2),
    "kg": (1, 0, 0),
    "kg/m³": (1, -3, 0),
    "m": (0, 1, 0),
    "1/m": (0, -1, 0),
    "m/s": (0, 1, -1),
    "s": (0, 0, 1),
}


@dataclass(frozen=True, eq=False)
class Sensitivities:
    """θ ∂ε/∂θ of p inputs, the velocity among them, at n velocities.

    Attributes:
        declared: symbol and unit of the inputs by name, (p,); the last is "velocity".
        values: θ, (p - 1,), of all but the velocity.
        velocity: v [m/s], (n,).
        coefficient: ε [-], (n,).
        absolute: θ ∂ε/∂θ [-], (n, p): the change of ε for a relative change of θ. Zero where
            θ = 0; for a negative Poisson's ratio it keeps its sign.
        status: flags of each collision, (n,).
    """

    declared: Mapping[str, Declared]
    values: Float[np.ndarray, "inputs"]
    velocity: Float[np.ndarray, "n"]
    coefficient: Float[np.ndarray, "n"]
    absolute: Float[np.ndarray, "n p"]
    status: Int[np.ndarray, "n"]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the inputs, (p,)."""
        return tuple(self.declared)

    @property
    def logarithmic(self) -> Float[np.ndarray, "n p"]:
        """∂ln ε/∂ln θ [-]; NaN where ε = 0 and θ ∂ε/∂θ alone has a meaning."""
        safe = np.where(self.coefficient > 0, self.coefficient, np.nan)
        return self.absolute / safe[:, None]

    def of(self, name: str) -> Float[np.ndarray, "n"]:
        """θ ∂ε/∂θ of one input."""
        return self.absolute[:, self.names.index(name)]

    def rows(self, which: slice) -> "Sensitivities":
        """Select velocities."""
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

        Raises:
            ValueError: where the unit of an input is not known.
        """
        units = {name: one.unit for name, one in self.declared.items()}
        for name, unit in units.items():
            if unit not in DIMENSIONS:
                raise DataError(f"unit of {name}", unit, f"one of {', '.join(DIMENSIONS)}")
        return self.absolute @ np.array([DIMENSIONS[unit] for unit in units.values()], float)

    def ranked(self, velocity: float) -> list[tuple[str, float]]:
        """(name, θ ∂ε/∂θ) at the velocity nearest to the given one, the largest first."""
        row = self.absolute[np.argmin(np.abs(self.velocity - velocity))]
        order = np.argsort(-np.abs(row), kind="stable")
        return [(self.names[i], float(row[i])) for i in order]

    def __repr__(self) -> str:
        shown = ", ".join(one.symbol for one in self.declared.values())
        return f"Sensitivities({len(self.velocity)} velocities; θ ∂ε/∂θ of {shown})"


def sensitivity(
    inputs: Inputs | sj.ContactLaw | FitResult,
    velocity: Float[ArrayLike, "..."],
    route: sj.EnergyBalance | sj.ClosedForm | sj.ODE | None = None,
    *,
    material: str | None = None,
) -> Sensitivities:
    """θ ∂ε/∂θ of every input at every velocity, from one forward pass for all of them.

    Args:
        inputs: `Inputs` (e.g. `of_spheres(material, radius, chi=…, sigma=…, psi=…)`, whose E, ν,
            ρ, Y, R are those of the bodies), or a law, or a fit, whose law's stored fields are then
            the inputs.
        velocity: v [m/s], a number or any shape (taken flat).
        route: as `softjax.restitution` takes it: the energy balance where the law can, if not stated.
        material: which one of a fit's.

    Where two bodies have the same yield strength, ε has a kink in each body's own: it is given
    for the body that yields, the second one.

    Raises:
        ValueError: naming the argument, its value and what is accepted.
    """
    inputs = as_inputs(inputs, material)
    velocity = check_velocity(velocity)
    inputs.law()  # refuses values that make no law
    names, values = tuple(inputs.values), np.array(list(inputs.values.values()), float)
    filled = np.pad(velocity, (0, -len(velocity) % PADDING), mode="edge")
    with jax.enable_x64(True):
        found = _scaled_jacobian(names, values, filled, inputs.build, route)
    absolute, coefficient, status = (np.asarray(x)[: len(velocity)] for x in found)
    return Sensitivities(
        declared={name: inputs.declared(name) for name in (*names, VELOCITY)},
        values=values,
        velocity=velocity,
        coefficient=coefficient,
        absolute=absolute + 0.0,  # no -0
        status=status,
    )


@eqx.filter_jit
def _scaled_jacobian(names: tuple[str, ...], values, velocity, build: Any, route: Any) -> Any:
    """∂ε/∂s at s = 0 with θ (1 + s) for θ and v (1 + s) for v: θ ∂ε/∂θ, whatever θ's sign.

    Then ε and the status.
    """

    def coefficient(s):
        moved = dict(zip(names, values * (1 + s[:-1]), strict=True))
        hit = sj.restitution(build(moved), velocity * (1 + s[-1]), route=route)
        return hit.coefficient, (hit.coefficient, hit.status)

    # jacfwd maps all unit tangents through one linearised pass over the whole batch
    slopes, (value, status) = jax.jacfwd(coefficient, has_aux=True)(jnp.zeros(len(values) + 1))
    return slopes, value, status
