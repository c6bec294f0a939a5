"""The scene of a law of one's own, given by its forces in SI and known in no closed form.

Loading is Hertz's; unloading follows a power of the overlap that grows with the largest one,
F_m (δ/δ_m)^{3/2 + δ_m/ℓ}. The works of both are elementary, and so ε² = (5/2)/(5/2 + δ_m/ℓ) is exact,
which no route is told. In units of δ_m and v the motion is x'' = -(5/4) x^{3/2}, x'(0) = 1, and back
by the other power.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import jax.numpy as jnp
import numpy as np

import softjax as sj
from calibration.speed import damped_rivals as rivals
from calibration.speed.plan import BATCH
from calibration.speed.scene import Scene, stainless
from calibration.speed.ways import Way, by_route

LENGTH = 2e-4  # [m]


class Hardening(sj.RateIndependentLaw):
    """Steeper on unloading the deeper the impact went."""

    contact: sj.Contact
    length: float = sj.number_field("ℓ", "m", "length", within="(0, inf)")

    def loading_force(self, overlap):
        return self.contact.stiffness * sj.power_3_2(overlap)

    def unloading_force(self, overlap, peak_overlap):
        power = 1.5 + peak_overlap / self.length
        return self.loading_force(peak_overlap) * (overlap / peak_overlap) ** power


class EndTold(Hardening):
    """The same, which says that its unloading force vanishes with the overlap and not before."""

    def residual_overlap(self, peak_overlap):
        return jnp.zeros_like(peak_overlap)


@dataclass(frozen=True)
class Recoil:
    """x'' = -(5/4) x^{3/2} up to the peak, and with the power c back to zero overlap."""

    c: float

    to_zero_force = False
    undamped = 2.9432751845  # half a period of Hertz's collision

    def force(self, x, u, power=np.power):
        return 1.25 * power(x, 1.5 + (u <= 0) * (self.c - 1.5))

    def ends(self, x, u, power=np.power):
        return x

    def kernel(self) -> Callable:
        return lambda x, u, c: 1.25 * x ** (1.5 if u > 0 else c)


def own_scene(kind: type[Hardening] = Hardening) -> Scene:
    """Gradients by ℓ, E and M."""
    steel, velocity = stainless().contact, np.geomspace(1e-2, 10.0, 32)

    def law_of(length, youngs_modulus, mass) -> Hardening:
        contact = replace(steel, youngs_modulus=youngs_modulus, mass=mass)
        return kind(contact, length)

    def depth(velocity: np.ndarray) -> np.ndarray:
        """δ_m/ℓ."""
        return (1.25 * float(steel.mass / steel.stiffness) * velocity**2) ** 0.4 / LENGTH

    exact = np.sqrt(2.5 / (2.5 + depth(velocity)))
    by_depth = -0.5 * exact * depth(velocity) / (2.5 + depth(velocity))
    return Scene(
        law_of,
        (LENGTH, float(steel.youngs_modulus), float(steel.mass)),
        velocity,
        exact,
        slopes=np.outer((-1.0, -0.4, 0.4), by_depth),
        damping=lambda velocity: 1.5 + depth(velocity),  # the power of the way back
    )


def own_plan(scene: Scene, quick: bool) -> Iterator[Callable[[], Way]]:
    """Ways as functions that build them."""
    yield from rivals.plan(scene, Recoil, quick)
    few: list = [sj.ODE(solver="dopri5", steps=3), sj.ODE(solver="dopri8", steps=2)]
    more = [] if quick else [sj.ODE(solver="dopri5", steps=5), sj.ODE(rtol=1e-8)]
    for route in (*few, *more, sj.EnergyBalance()):
        yield partial(by_route, scene, BATCH, route)
        # as all rivals are: they stop where the overlap vanishes
        yield partial(_told, own_scene(EndTold), route)


def _told(scene: Scene, route) -> Way:
    way = by_route(scene, BATCH, route)
    return replace(way, setting=f"{way.setting}, end told")
