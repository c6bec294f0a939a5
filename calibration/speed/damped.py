"""The scene of a law with damping, and the ways to its restitution.

In units of the impact velocity and of its spring every motion is x'' = -x^p - c x^q x', x'(0) = 1,
with c of each impact. Exact answers: of viscoelastic spheres 60-digit arithmetic rounded to 20
digits (tests/oracles/speed_reference.py made them); a dashpot gives back the ε it is set to.
"""

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

import softjax as sj
from calibration.speed import damped_rivals as rivals
from calibration.speed.plan import BATCH, LARGE
from calibration.speed.scene import Scene, stored
from calibration.speed.ways import Way, by_route

EXPONENTS = {"viscoelastic": (1.5, 0.5), "hertz-dashpot": (1.5, 0.25), "linear": (1.0, 0.0)}
RESTITUTION, STIFFNESS = 0.7, 1e6  # of the dashpots


def damped_scene(name: str) -> Scene:
    """Gradients by what damps, E and M."""
    x, rows = stored("exact_damped.json")

    def law_of(damping, youngs_modulus, mass) -> sj.ContactLaw:
        contact = sj.Contact(youngs_modulus, x["R"], mass, x["Y"], x["v_lim"])
        if name == "viscoelastic":
            return sj.ViscoelasticHertz(contact, damping)
        if name == "linear":
            return sj.LinearSpringDashpot(contact, STIFFNESS, damping)
        return sj.HertzDashpot(contact, damping)

    def motion_damping(velocity: np.ndarray) -> np.ndarray:
        """c of each impact."""
        if name == "viscoelastic":
            contact = scene.contact
            rate = float(contact.stiffness / contact.mass) ** 0.4
            return 1.5 * x["dissipation_time"] * rate * velocity**0.2
        fraction = -np.log(RESTITUTION) / np.hypot(np.pi, np.log(RESTITUTION))
        return np.full_like(velocity, (2.0 if name == "linear" else 5**0.5) * fraction)

    velocity = np.array([row["velocity"] for row in rows])
    exact = np.array([float(row["restitution"]) for row in rows])
    slope = np.array([float(row["slope"]) for row in rows])  # by ln w²
    damping, powers = x["dissipation_time"], (1.0, 0.4, -0.4)
    if name != "viscoelastic":
        exact = slope = np.full_like(velocity, RESTITUTION)
        damping, powers = RESTITUTION, (1.0, 0.0, 0.0)
    theta = (damping, float(x["E"]), float(x["M"]))
    scene = Scene(law_of, theta, velocity, exact, np.outer(powers, slope), motion_damping)
    return scene


def damped_plan(name: str, scene: Scene, quick: bool) -> Iterator[Callable[[], Way]]:
    """Ways as functions that build them."""
    motion = partial(rivals.Motion, *EXPONENTS[name], name == "viscoelastic")
    yield from rivals.plan(scene, motion, quick)
    few: list = [sj.ODE(solver="dopri5", steps=4), sj.ODE(solver="dopri5", steps=8)]
    more = [] if quick else [sj.ODE(solver="dopri8", steps=4), sj.ODE(rtol=1e-8)]
    for route in (*few, *more, sj.ClosedForm()):
        yield partial(by_route, scene, BATCH, route)
    yield partial(by_route, scene, LARGE, sj.ClosedForm())
