"""The scene of a law with damping, and the ways to its restitution.

In units of the impact velocity and of its spring every motion is x'' = -x^p - c x^q x', x'(0) = 1,
with c of each impact. Exact answers: of viscoelastic spheres 60-digit arithmetic rounded to 20
digits (tests/oracles/speed_damped.py made them); a dashpot gives back the ε it is set to.
"""

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from importlib import resources

import jax
import jax.numpy as jnp
import numpy as np

import softjax as sj
from calibration.speed import damped_rivals as rivals
from calibration.speed.plan import BATCH, LARGE
from calibration.speed.ways import Way

EXPONENTS = {"viscoelastic": (1.5, 0.5), "hertz-dashpot": (1.5, 0.25), "linear": (1.0, 0.0)}
LAWS = tuple(EXPONENTS)
RESTITUTION, STIFFNESS = 0.7, 1e6  # of the dashpots


@dataclass(frozen=True)
class DampedScene:
    """Impact velocities, the law, and what is exact about them."""

    name: str
    contact: sj.Contact
    dissipation_time: float
    velocity: np.ndarray  # [m/s], shape (n,)
    exact: np.ndarray  # ε, shape (n,)
    slopes: np.ndarray  # θ ∂ε/∂θ for what damps, E and M, shape (3, n)

    def law_of(self, damping, youngs_modulus, mass) -> sj.ContactLaw:
        c = self.contact
        contact = sj.Contact(youngs_modulus, c.radius, mass, c.yield_strength, c.limit_velocity)
        if self.name == "viscoelastic":
            return sj.ViscoelasticHertz(contact, damping)
        if self.name == "linear":
            return sj.LinearSpringDashpot(contact, STIFFNESS, damping)
        return sj.HertzDashpot(contact, damping)

    @property
    def theta(self) -> tuple[float, ...]:
        damping = self.dissipation_time if self.name == "viscoelastic" else RESTITUTION
        return damping, float(self.contact.youngs_modulus), float(self.contact.mass)

    def damping(self, velocity: np.ndarray) -> np.ndarray:
        """c of each impact."""
        if self.name == "viscoelastic":
            rate = float(self.contact.stiffness / self.contact.mass) ** 0.4
            return 1.5 * self.dissipation_time * rate * velocity**0.2
        fraction = -np.log(RESTITUTION) / np.hypot(np.pi, np.log(RESTITUTION))
        return np.full_like(velocity, (2.0 if self.name == "linear" else 5**0.5) * fraction)

    def repeated(self, count: int) -> np.ndarray:
        """`count` velocities, the exact ones over and over."""
        return np.resize(self.velocity, count)


def damped_scene(name: str) -> DampedScene:
    text = resources.files(__package__).joinpath("exact_damped.json").read_text(encoding="utf-8")
    stored = json.loads(text)
    x, rows = stored["inputs"], stored["rows"]
    contact = sj.Contact(x["E"], x["R"], x["M"], x["Y"], x["v_lim"])
    velocity = np.array([row["velocity"] for row in rows])
    exact = np.array([float(row["restitution"]) for row in rows])
    slope = np.array([float(row["slope"]) for row in rows])  # by ln w²
    powers = (1.0, 0.4, -0.4)
    if name != "viscoelastic":
        exact = slope = np.full_like(velocity, RESTITUTION)
        powers = (1.0, 0.0, 0.0)
    slopes = np.outer(powers, slope)
    return DampedScene(name, contact, x["dissipation_time"], velocity, exact, slopes)


def damped_plan(scene: DampedScene, quick: bool) -> Iterator[Callable[[], Way]]:
    """Ways as functions that build them."""
    motion = partial(rivals.Motion, *EXPONENTS[scene.name], scene.name == "viscoelastic")
    yield from rivals.plan(scene, motion, quick)
    for route in _odes(quick):
        yield partial(ways_of, scene, route, BATCH)
    yield partial(ways_of, scene, sj.ClosedForm(), BATCH)
    yield partial(ways_of, scene, sj.ClosedForm(), LARGE)


def _odes(quick: bool) -> list[sj.ODE]:
    few = [sj.ODE(solver="dopri5", steps=4), sj.ODE(solver="dopri5", steps=8)]
    return few if quick else [*few, sj.ODE(solver="dopri8", steps=4), sj.ODE(rtol=1e-8)]


def ways_of(scene, route, batch: int) -> Way:
    """By a route of this library, as a user calls it outside of any `jit`."""
    law = scene.law_of(*scene.theta)

    @jax.jit
    def value_and_gradient(theta, velocity):
        def total(theta):
            result = sj.restitution(scene.law_of(*theta), velocity, route)
            return jnp.sum(result.plastic_coefficient)

        value, slopes = jax.value_and_grad(total)(theta)
        return value, tuple(t * s for t, s in zip(theta, slopes, strict=True))

    setting = "exact"
    if isinstance(route, sj.ODE):
        told = (
            f"{route.steps} steps"
            if route.rtol is None and route.steps
            else f"rtol {route.tolerance:.0e}"
        )
        setting = f"{route.solver}, {told}"
    return Way(
        "ODE" if isinstance(route, sj.ODE) else route.name,
        setting,
        batch,
        lambda velocity: sj.restitution(law, velocity, route).plastic_coefficient,
        lambda velocity: value_and_gradient(scene.theta, velocity),
    )
