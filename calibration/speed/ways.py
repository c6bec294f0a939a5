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


def energy_balance(
    scene: Scene,
    batch: int,
    precision: str = "float64",
    gradient: bool = True,
    overlaps: bool = True,
) -> Way:
    """As a user calls it outside of any `jit`: all fields of the result, not ε_p alone."""
    law = scene.law

    def value(velocity):
        return sj.restitution(law, velocity, overlaps=overlaps).plastic_coefficient

    slopes = _gradient(scene, sj.EnergyBalance()) if gradient else None
    setting = "exact" if overlaps else NO_OVERLAPS
    return Way("energy balance", setting, batch, value, slopes, precision)


def ode(scene: Scene, batch: int, route: sj.ODE, gradient: bool = False, **kwargs) -> Way:
    law = scene.law
    told = f"rtol {route.rtol:.0e}" if route.rtol is not None else f"{route.steps} steps"

    def value(velocity):
        return sj.restitution(law, velocity, route).plastic_coefficient

    setting = f"{route.solver}, {told}"
    return Way(
        "ODE", setting, batch, value, _gradient(scene, route) if gradient else None, **kwargs
    )


def _gradient(scene: Scene, route) -> Callable:
    """Σ ε_p and its gradient with respect to ln χ̃, ln E and ln Y, reverse mode."""

    @jax.jit
    def value_and_gradient(theta, velocity):
        def total(theta):
            law = scene.law_of(*theta)
            return jnp.sum(sj.restitution(law, velocity, route).plastic_coefficient)

        value, slopes = jax.value_and_grad(total)(theta)
        return value, tuple(t * s for t, s in zip(theta, slopes, strict=True))

    return lambda velocity: value_and_gradient(scene.theta, velocity)
