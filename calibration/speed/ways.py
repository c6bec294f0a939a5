"""A way to compute ε_p, ready to be timed, and the ways of this library."""

from collections.abc import Callable
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

import softjax as sj
from calibration.speed.scene import Scene

NO_OVERLAPS = "exact, no overlaps"  # ε, ε_p and status alone


@dataclass(frozen=True)
class Way:
    """One line of the table.

    `value(velocity)` returns ε_p; `gradient(velocity)` returns Σ ε_p and θ ∂(Σ ε_p)/∂θ for the
    three parameters. `batch` is the number of velocities it is timed with.
    """

    family: str
    setting: str
    batch: int
    value: Callable[[np.ndarray], np.ndarray]
    gradient: Callable | None = None
    precision: str = "float64"


def by_route(
    scene: Scene,
    batch: int,
    route: sj.EnergyBalance | sj.ClosedForm | sj.ODE,
    gradient: bool = True,
    precision: str = "float64",
    overlaps: bool = True,
) -> Way:
    """As a user calls it outside of any `jit`: all fields of the result, not ε_p alone."""
    law = scene.law

    def coefficient(theta, velocity):
        return sj.restitution(scene.law_of(*theta), velocity, route).plastic_coefficient

    family, setting = route.name, "exact" if overlaps else NO_OVERLAPS
    if isinstance(route, sj.ODE):
        in_steps = route.rtol is None and route.steps
        told = f"{route.steps} steps" if in_steps else f"rtol {route.tolerance:.0e}"
        family, setting = "ODE", f"{route.solver}, {told}"
    return Way(
        family,
        setting,
        batch,
        lambda v: sj.restitution(law, v, route, overlaps=overlaps).plastic_coefficient,
        with_gradient(scene, coefficient) if gradient else None,
        precision,
    )


def energy_balance(scene: Scene, batch: int, **options) -> Way:
    return by_route(scene, batch, sj.EnergyBalance(), **options)


def ode(scene: Scene, batch: int, route: sj.ODE, gradient: bool = False, **options) -> Way:
    return by_route(scene, batch, route, gradient, **options)


def with_gradient(scene: Scene, coefficient: Callable) -> Callable:
    """Σ ε_p of `coefficient(theta, velocity)` and its gradient by ln θ, reverse mode."""

    @jax.jit
    def value_and_gradient(theta, velocity):
        total = lambda theta: jnp.sum(coefficient(theta, velocity))  # noqa: E731
        value, slopes = jax.value_and_grad(total)(theta)
        return value, tuple(t * s for t, s in zip(theta, slopes, strict=True))

    return lambda velocity: value_and_gradient(scene.theta, velocity)
