"""Laws as users write them: the library's forces borrowed, a law from the literature, and forces whose
collisions are solved by hand.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from scipy.special import beta

import softjax as sj
from tests.cases import pair

STEEL = pair("stainless steel", area="hertz")


class Borrowed(sj.RateIndependentLaw):
    """A built-in law's forces, in newtons, in a law of the user's."""

    contact: sj.Contact
    law: sj.RateIndependentLaw

    def elastic_overlap(self):
        if not isinstance(self.law, sj.Zhou | sj.Thornton):
            return 0.0
        impact = 1.25 * self.contact.mass * self.law.elastic_velocity() ** 2
        return (impact / self.contact.stiffness) ** 0.4

    def loading_force(self, overlap):
        return self.law.loading_force(overlap)

    def unloading_force(self, overlap, peak_overlap):
        return self.law.unloading_force(overlap, peak_overlap)


class BorrowedDamped(sj.RateDependentLaw):
    """The same of a law with a damped force."""

    contact: sj.Contact
    law: sj.RateDependentLaw
    end: str = sj.choice_field("zero-overlap", "zero-force")

    def force(self, overlap, velocity):
        return self.law.force(overlap, velocity)


class JacksonGreen(sj.RateIndependentLaw):
    """A sphere on a rigid flat, J. Tribol. 127, 343 and 484 (2005); back along a larger Hertz's.

    F/F_c = e^{-w^{5/12}/4} w^{3/2} + (4 H/C Y)(1 - e^{-w^{5/9}/25}) w beyond w = δ/δ_c = 1.9.

    With C = 1.295 e^{0.736 ν}, δ_c = (π C Y/2E)² R and H/Y = 2.84 [1 - e^{-0.82 (a/R)^{-0.7}}]; back
    by F_m [(δ - δ*)/(δ_m - δ*)]^{3/2}, δ* = 1.02 δ_m [1 - ((w_m + 5.9)/6.9)^{-0.54}].
    """

    contact: sj.Contact
    poisson_ratio: float

    def factor(self):
        """C: the peak pressure at first yield is C Y."""
        return 1.295 * jnp.exp(0.736 * self.poisson_ratio)

    def strain(self):
        """a/R = √(δ_c/R) at first yield."""
        return (
            0.5 * jnp.pi * self.factor() * self.contact.yield_strength / self.contact.youngs_modulus
        )

    def critical_overlap(self):
        return self.strain() ** 2 * self.contact.radius

    def critical_force(self):
        return self.contact.stiffness * self.critical_overlap() ** 1.5

    def elastic_overlap(self):
        return 1.9 * self.critical_overlap()

    def loading_force(self, overlap):
        w = jnp.maximum(overlap / self.critical_overlap(), 1.9)
        growth = 0.07 * jnp.exp(23 * self.contact.yield_strength / self.contact.youngs_modulus)
        radius = self.strain() * jnp.sqrt(w) * (w / 1.9) ** growth  # a/R
        hardness = 2.84 * (1 - jnp.exp(-0.82 * radius**-0.7))  # H/Y
        elastic = jnp.exp(-0.25 * w ** (5 / 12)) * w**1.5
        plastic = 4 * hardness / self.factor() * (1 - jnp.exp(-(w ** (5 / 9)) / 25)) * w
        yields = overlap > self.elastic_overlap()
        hertz = self.contact.stiffness * overlap**1.5
        return jnp.where(yields, self.critical_force() * (elastic + plastic), hertz)

    def residual_overlap(self, peak_overlap):
        w = peak_overlap / self.critical_overlap()
        return 1.02 * peak_overlap * (1 - ((w + 5.9) / 6.9) ** -0.54)

    def unloading_force(self, overlap, peak_overlap):
        rest = self.residual_overlap(peak_overlap)
        share = jnp.maximum((overlap - rest) / (peak_overlap - rest), 0.0)
        return self.loading_force(peak_overlap) * share**1.5


def published_fit(ratio, yield_strain):
    """ε over v/v_c for Y/E < 0.008, fitted by its authors to 1 <= v/v_c <= 1000.

    R. L. Jackson, I. Green and D. B. Marghitu, Nonlinear Dyn. 60, 217 (2010).
    """
    ratio = np.maximum(ratio, 1.0)
    slow = 1 - 0.1 * np.log(ratio) * ((ratio - 1) / 59) ** 0.156
    over = np.maximum(ratio, 60.0)
    fast = 1 - 0.1 * np.log(60) - 0.11 * np.log(over / 60) * (over - 60) ** (2.36 * yield_strain)
    return np.where(ratio < 60, slow, fast)


FORCE, LENGTH = 100.0, 1e-4  # N and m: a spring of 1e6 N/m
PACE = np.sqrt(STEEL.mass * LENGTH / FORCE)  # peak overlap over velocity of that spring
POWER, FALLS, ENDS, PLATEAU = range(4)  # ByHand.loading
LINE, CLIPPED, CUBE, STEEP, JUMPS, DROPS, BELOW, HOLE = range(8)  # ByHand.shape
SHARPENING = 1e-4  # m: the residual overlap δ_m²/(δ_m + that) of BELOW and its clipped like


class ByHand(sj.RateIndependentLaw):
    """Loading forces and shapes of unloading, chosen by numbers: a batch of them is one program.

    Loading in FORCE over x = δ/LENGTH: x^p, 1 - x/end, 1 up to `end` and no number beyond, or Hertz's up
    to `end` and constant from there. Unloading gives back P_m times a shape of s = (δ/δ_m - ρ)/(1 - ρ).
    """

    contact: sj.Contact
    loading: float = POWER
    power: float = 1.0  # p
    end: float = 1.0
    shape: float = CLIPPED
    rest: float = 0.0  # ρ; 1 of a plateau, 2 where it sharpens: of the peak
    floor: float = 0.0  # what CLIPPED gives back below its zero
    bend: float = 1.0  # the power of s in CLIPPED

    def elastic_overlap(self):
        return jnp.where(self.loading == PLATEAU, self.end * LENGTH, 0.0)

    def loading_force(self, overlap):
        x = overlap / LENGTH
        inside = x > 0
        power = jnp.where(inside, jnp.where(inside, x, 1.0) ** self.power, self.power == 0)
        hertz = self.contact.stiffness / FORCE * jnp.minimum(overlap, self.end * LENGTH) ** 1.5
        kinds = [power, 1 - x / self.end, jnp.where(x < self.end, 1.0, jnp.nan), hertz]
        return FORCE * _chosen(self.loading, kinds)

    def unloading_force(self, overlap, peak_overlap):
        plateau = 1 - 0.5 * self.end * LENGTH / peak_overlap
        sharp = peak_overlap / (peak_overlap + SHARPENING)
        rest = jnp.where(self.rest == 1, plateau, jnp.where(self.rest == 2, sharp, self.rest))
        x = overlap / peak_overlap
        s = (x - rest) / (1 - rest)
        inside = s > 0
        t = jnp.where(inside, s, 1.0)
        kinds = [
            s,
            self.floor + (1 - self.floor) * jnp.where(inside, t**self.bend, 0.0),
            s**3,
            -jnp.expm1(-20 * s) / -np.expm1(-20.0),
            jnp.where(inside, 0.5 * (1 + s), -0.5),
            jnp.where(inside, 0.5 * (1 + s), 0.0),
            jnp.where(inside, t**1.5, jnp.nan),
            jnp.where((x > 0.5) & (x < 0.7), jnp.nan, t**1.5),
        ]
        return self.loading_force(peak_overlap) * _chosen(self.shape, kinds)


def _chosen(kind, values):
    picked = jnp.arange(len(values)) == kind
    return jnp.sum(jnp.where(picked, jnp.stack(jnp.broadcast_arrays(*values)), 0.0))


class Impact(NamedTuple):
    """One impact of `ByHand`, solved by hand; NaN where nothing is known."""

    law: dict[str, float]
    velocity: float
    squared: float  # ε²
    peak: float
    residual: float
    status: sj.Status = sj.Status.PLAIN
    tolerance: float = 1e-9  # of ε², relative
    duration: float = np.nan


def by_hand() -> list[Impact]:
    """The impacts of `ByHand`: ε² = P_m δ_m (1 - ρ) ∫ shape ds over the work of loading."""
    rows, none, plain = [], float("nan"), sj.Status.PLAIN
    opened, gain, inexact = (
        sj.Status[n] for n in ("NO_RESIDUAL_OVERLAP", "ENERGY_GAIN", "INEXACT")
    )
    # a spring: straight, clipped, of any power, bent, and where it jumps or drops
    peak = 0.7 * PACE
    steep = 1 / -np.expm1(-20.0) - 0.05
    shapes = [({"shape": k}, area) for k, area in ((LINE, 0.5), (CUBE, 0.25), (STEEP, steep))]
    shapes += [({"bend": n}, 1 / (n + 1)) for n in (1.0, 1.5, 2.5, 0.5)]
    shapes += [({"shape": k}, 0.75) for k in (JUMPS, DROPS)]
    for rest in (0.37, 0.9):
        for shape, area in shapes:
            law, squared = shape | {"rest": rest}, 2 * (1 - rest) * area
            told = inexact if shape.get("shape") in (JUMPS, DROPS) else plain
            told = gain if squared > 1 else told
            # of a straight line back a quarter period of each spring
            lasts = 0.5 * np.pi * PACE * (1 + np.sqrt(1 - rest)) if area == 0.5 else none
            rows.append(Impact(law, 0.7, squared, peak, rest * peak, told, 1e-11, lasts))
    # down to zero overlap: positive there, zero there, clipped at zero, just above zero by a hair
    for floor, bend, rest in ((0.2, 2.0, 0.0), (0.0, 2.0, 0.0), (0.0, 1.0, 0.5), (1e-9, 3.0, 0.0)):
        law = {"floor": floor, "bend": bend, "rest": rest}
        squared = 2 * (1 - rest) * (floor + (1 - floor) / (bend + 1))
        rows.append(Impact(law, 0.7, squared, peak, rest * peak, plain if rest else opened))
    # powers of the overlap over 24 decades of energy: F L x^{p+1}/(p + 1) = M v²/2
    for power in (0.0, 1.0, 1.5, 4.0):
        for v in (1e-9, 1e-3, 1.0, 1e3):
            energy = 0.5 * STEEL.mass * v**2 / (FORCE * LENGTH)
            peak = LENGTH * ((power + 1) * energy) ** (1 / (power + 1))
            told = opened | gain if power > 1 else opened
            rows.append(Impact({"power": power}, v, (power + 1) / 2, peak, 0.0, told, 1e-8))
    # Hertz's collision by its forces alone, so slow that squares underflow
    for v in (1e-300, 1e-100):
        peak = (1.25 * STEEL.mass / (FORCE * LENGTH**-1.5)) ** 0.4 * v**0.8
        law, lasts = {"power": 1.5, "bend": 1.5}, 0.8 * beta(0.4, 0.5) * peak / v
        rows.append(Impact(law, v, 1.0, peak, 0.0, opened, duration=lasts))
    # a triangle of work F end/2 turns a body of less energy; so does what is no number from `end`
    for share, kind, end in (
        (0.8, FALLS, 1.3),
        (1.2, FALLS, 3.0),
        (0.9, ENDS, 2.0),
        (1.1, ENDS, 2.0),
    ):
        work = share * FORCE * LENGTH * end * (0.5 if kind == FALLS else 1.0)
        v = np.sqrt(2 * work / STEEL.mass)
        law = {"loading": kind, "power": 0.0, "end": end}
        if share > 1:
            rows.append(Impact(law, v, 0.0, none, none, sj.Status.NO_TURNING_POINT))
            continue
        x = end * (1 - np.sqrt(1 - share)) if kind == FALLS else end * share
        force = 1 - x / end if kind == FALLS else 1.0
        squared = 0.5 * force * x * FORCE * LENGTH / work
        rows.append(Impact(law, v, squared, LENGTH * x, 0.0, opened, 1e-8))
    # a plateau up to a million times its start: (2/5) y² = 2/5 + (x_m - 1), ε² = (1/4)/((2/5) y²)
    law = {"loading": PLATEAU, "end": 0.01, "rest": 1.0}
    pace = np.sqrt(0.8 * STEEL.stiffness * 1e-6**2.5 / STEEL.mass)
    rows.append(Impact(law, 0.5 * pace, 1.0, 1e-6 * 0.5**0.8, 0.0, sj.Status.ELASTIC))
    for y in (1.5, 10.0, 1e3, 1e6):
        x = 1 + 0.4 * (y**2 - 1)
        # a law of overlaps alone knows x_m - x of a nearly plastic impact to the rounding of x_m
        near = 1e-8 if y < 1e6 else 3e-3
        rows.append(Impact(law, y * pace, 0.625 / y**2, 1e-6 * x, 1e-6 * (x - 0.5), plain, near))
    # ((δ - δ*)/(δ_m - δ*))^{3/2}, no number below δ* or 0 there; then a hole on the way back
    for v in (1e-3, 0.1, 10.0):
        peak = v * PACE
        rest = peak / (peak + SHARPENING)
        for shape in ({"shape": BELOW}, {"bend": 1.5}):
            law = shape | {"rest": 2.0}
            rows.append(Impact(law, v, 0.8 * (1 - rest), peak, rest * peak, plain, 1e-8))
    peak = 0.7 * PACE
    left = 0.8 * (1 - 0.7**2.5)
    rows.append(Impact({"shape": HOLE}, 0.7, left, peak, 0.7 * peak, inexact, 1e-6))
    return rows
