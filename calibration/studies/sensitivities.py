"""Sensitivities of ε to its inputs: exact derivatives at a point."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike, Float, Int

import softjax as sj
from calibration.fitting.estimates import FitEstimates
from calibration.studies.inputs import (
    VELOCITY,
    Inputs,
    as_inputs,
    check_velocity,
)
from softjax.compiling import filled
from softjax.fields import Declared

PADDING = 64  # most batches of velocities share one compilation


@dataclass(frozen=True, eq=False)
class Sensitivities:
    """θ ∂ε/∂θ of p inputs, the velocity among them, at n velocities.

    Attributes:
        declared: symbol and unit of the inputs by name, (p,); the last is "velocity".
        velocity: v [m/s], (n,).
        coefficient: ε [-], (n,).
        absolute: θ ∂ε/∂θ [-], (n, p): the change of ε for a relative change of θ. Zero where
            θ = 0; for a negative Poisson's ratio it keeps its sign.
        status: flags of each collision, (n,).
    """

    declared: Mapping[str, Declared]
    velocity: Float[np.ndarray, " n"]
    coefficient: Float[np.ndarray, " n"]
    absolute: Float[np.ndarray, "n p"]
    status: Int[np.ndarray, " n"]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the inputs, (p,)."""
        return tuple(self.declared)

    @property
    def logarithmic(self) -> Float[np.ndarray, "n p"]:
        """∂ln ε/∂ln θ [-]; NaN where ε = 0 and θ ∂ε/∂θ alone has a meaning."""
        return self.absolute / np.where(self.coefficient > 0, self.coefficient, np.nan)[:, None]

    def of(self, name: str) -> Float[np.ndarray, " n"]:
        """θ ∂ε/∂θ of one input."""
        return self.absolute[:, self.names.index(name)]

    def rows(self, which: slice) -> "Sensitivities":
        """Select velocities."""
        columns = ("velocity", "coefficient", "absolute", "status")
        return replace(self, **{name: getattr(self, name)[which] for name in columns})

    def ranked(self, velocity: float) -> list[tuple[str, float]]:
        """(name, θ ∂ε/∂θ) at the velocity nearest to the given one, the largest first."""
        row = self.absolute[np.argmin(np.abs(self.velocity - velocity))]
        order = np.argsort(-np.abs(row), kind="stable")
        return [(self.names[i], float(row[i])) for i in order]

    def __repr__(self) -> str:
        shown = ", ".join(declared.symbol for declared in self.declared.values())
        return f"Sensitivities({len(self.velocity)} velocities; θ ∂ε/∂θ of {shown})"


def sensitivity(
    inputs: Inputs | sj.ContactLaw | FitEstimates,
    velocity: Float[ArrayLike, "..."],
    route: sj.AbstractRoute | None = None,
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
    padded = filled(velocity, len(velocity) + -len(velocity) % PADDING)
    with jax.enable_x64(True):
        law, moved = _built(names, values, inputs.build)
        results = _slopes(law, padded, route)
    slopes, coefficient, status = (np.asarray(x)[..., : len(velocity)] for x in results)
    absolute = np.column_stack([slopes[:-1].T @ moved, slopes[-1]]) + 0.0  # no -0
    declared = {name: inputs.declared(name) for name in (*names, VELOCITY)}
    return Sensitivities(declared, velocity, coefficient, absolute, status)


@eqx.filter_jit
def _built(names: tuple[str, ...], values, build: Any) -> Any:
    """The law, and ∂x/∂s of its m numbers at s = 0 with θ (1 + s): θ ∂x/∂θ, whatever θ's sign, (m, p)."""

    def numbers(s):
        law = build(dict(zip(names, values * (1 + s), strict=True)))
        single, shared = _single(law)
        x = jnp.stack(jax.tree.leaves(single))  # of one type, whatever they are built of
        return x, eqx.combine(jax.tree.unflatten(jax.tree.structure(single), list(x)), shared)

    moved, law = jax.jacfwd(numbers, has_aux=True)(jnp.zeros(len(values)))
    return law, moved


@eqx.filter_jit
def _slopes(law: sj.ContactLaw, velocity, route: Any) -> Any:
    """∂ε/∂x of the law's numbers and v ∂ε/∂v, (m + 1, n), ε and the status: one program, whatever the inputs."""
    single, shared = _single(law)
    numbers, structure = jax.tree.flatten(single)

    def coefficient(x):
        law = eqx.combine(jax.tree.unflatten(structure, x[:-1]), shared)
        hit = sj.restitution(law, velocity * x[-1], route=route)
        return hit.coefficient, (hit.coefficient, hit.status)

    # jacfwd maps all unit tangents through one linearised pass over the whole batch
    slopes, others = jax.jacfwd(coefficient, has_aux=True)(jnp.stack([*numbers, 1.0]))
    return slopes.T, *others


def _single(law: sj.ContactLaw) -> Any:
    """The law's single numbers, and its fields that impacts share."""
    return eqx.partition(law, lambda leaf: jnp.ndim(leaf) == 0)
