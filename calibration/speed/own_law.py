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
from calibration.speed.damped import ways_of
from calibration.speed.plan import BATCH
from calibration.speed.scene import stainless
from calibration.speed.ways import Way

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
class OwnScene:
    """Impact velocities, the law, and what is exact about them."""

    contact: sj.Contact
    velocity: np.ndarray  # [m/s], shape (n,)
    kind: type[Hardening] = Hardening

    def law_of(self, length, youngs_modulus, mass) -> Hardening:
        c = self.contact
        contact = sj.Contact(youngs_modulus, c.radius, mass, c.yield_strength, c.limit_velocity)
        return self.kind(contact, length)

    @property
    def theta(self) -> tuple[float, ...]:
        return LENGTH, float(self.contact.youngs_modulus), float(self.contact.mass)

    def depth(self, velocity: np.ndarray) -> np.ndarray:
        """δ_m/ℓ."""
        c = self.contact
        return (1.25 * float(c.mass / c.stiffness) * velocity**2) ** 0.4 / LENGTH

    def damping(self, velocity: np.ndarray) -> np.ndarray:
        """The power of the way back, of each impact."""
        return 1.5 + self.depth(velocity)

    @property
    def exact(self) -> np.ndarray:
        return np.sqrt(2.5 / (2.5 + self.depth(self.velocity)))

    @property
    def slopes(self) -> np.ndarray:
        """θ ∂ε/∂θ for ℓ, E and M."""
        depth = self.depth(self.velocity)
        by_depth = -0.5 * self.exact * depth / (2.5 + depth)
        return np.outer((-1.0, -0.4, 0.4), by_depth)

    def repeated(self, count: int) -> np.ndarray:
        return np.resize(self.velocity, count)


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


def own_scene() -> OwnScene:
    scene = stainless()
    return OwnScene(scene.contact, np.geomspace(1e-2, 10.0, 32))


def own_plan(scene: OwnScene, quick: bool) -> Iterator[Callable[[], Way]]:
    """Ways as functions that build them."""
    yield from rivals.plan(scene, Recoil, quick)
    few: list = [sj.ODE(solver="dopri5", steps=3), sj.ODE(solver="dopri8", steps=2)]
    more = [] if quick else [sj.ODE(solver="dopri5", steps=5), sj.ODE(rtol=1e-8)]
    for route in (*few, *more, sj.EnergyBalance()):
        yield partial(ways_of, scene, route, BATCH)
        # as all rivals are: they stop where the overlap vanishes
        yield partial(_told, replace(scene, kind=EndTold), route)


def _told(scene: OwnScene, route) -> Way:
    way = ways_of(scene, route, BATCH)
    return replace(way, setting=f"{way.setting}, end told")
