"""Laws given by their forces, chosen by numbers, so that a batch of all kinds is one program.

Over x = δ/LENGTH and in FORCE, those of Hertz's collision at 1 m/s, so that M v²/2 is 0.4 v²:

    loading    min(x, e)^{3/2} + A (x - e)^p + B (x - b)^q - c - S exp(-((x - 0.4)/0.1)²), until `end`
    unloading  P_m times a shape of s = (x/x_m - ρ')/(1 - ρ'),  ρ' = ρ - h/(x_m + g)

with differences in brackets not below zero. The formulas serve the law and, in NumPy, its answers:
collisions solved by hand, and by closed works, bisection and quadrature of all laws at once.
"""

import itertools
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from scipy.integrate import solve_ivp
from scipy.special import beta, erf

import softjax as sj
from tests.cases import pair
from tests.oracles.by_scipy import NODES, WEIGHTS

STEEL = pair("stainless steel", area="hertz")
LENGTH = (1.25 * STEEL.mass / STEEL.stiffness) ** 0.4
FORCE = STEEL.stiffness * LENGTH**1.5
CLIPPED, OPEN, CUBE, STEEP, JUMPS, DROPS, BELOW, HOLE, HERTZ, SAME = range(10)  # shapes
FAR = 1e30  # beyond any overlap
DEFAULTS = {
    "elastic": 0.0,  # e: Hertz's law up to there
    "slope": 1.0,  # A
    "power": 1.0,  # p
    "kink": FAR,  # b
    "more": 0.0,  # B
    "bend": 1.0,  # q
    "pull": 0.0,  # c
    "snap": 0.0,  # S
    "end": FAR,
    "shape": CLIPPED,
    "rest": 0.0,  # ρ
    "gap": 0.0,  # h
    "sharp": 1.0,  # g
    "back": 1.0,  # u: the power of s
    "floor": 0.0,  # what is left at s = 0; of HERTZ and SAME the share that comes back
    "jolt": 0.0,  # how much an open line steepens below b
    "declared": 1.0,  # whether e and b are declared
}
NAMES = tuple(DEFAULTS)


class Forces(sj.RateIndependentLaw):
    __annotations__ = {"contact": sj.Contact} | dict.fromkeys(NAMES, float)
    few = False

    def elastic_overlap(self):
        return jnp.where(self.declared > 0, self.elastic, 0.0) * LENGTH

    def breakpoints(self):
        known = (self.declared > 0) & (self.kink < FAR)
        return (jnp.where(known, self.kink, jnp.inf) * LENGTH,)

    def loading_force(self, overlap):
        return FORCE * loading(self, overlap / LENGTH)

    def unloading_force(self, overlap, peak_overlap):
        return FORCE * unloading(self, overlap / LENGTH, peak_overlap / LENGTH)


class Drawn(Forces):
    """Those that `draw` gives, and BELOW, a smaller program: no pull, snap or end, and three shapes."""

    few = True


class Columns(NamedTuple("Fields", [(name, np.ndarray) for name in NAMES])):
    """The numbers of many laws."""

    def law(self) -> Forces:
        return Forces(STEEL, *map(jnp.asarray, self))

    def take(self, places):
        return Columns(*(column[places] for column in self))


def columns(rows: list[dict]) -> Columns:
    return Columns(*(np.array([r.get(n, DEFAULTS[n]) for r in rows], float) for n in NAMES))


def _power(x, exponent, xp):
    inside = x > 0
    return xp.where(inside, xp.where(inside, x, 1.0) ** exponent, 0.0)


def _hertz(x, xp):
    inside = xp.where(x > 0, x, 1.0)
    return xp.where(x > 0, inside * xp.sqrt(inside), 0.0)


def loading(f, x, xp=jnp):
    hertz = _hertz(xp.minimum(x, f.elastic), xp)
    bent = f.slope * _power(x - f.elastic, f.power, xp) + f.more * _power(x - f.kink, f.bend, xp)
    if getattr(f, "few", False):
        return hertz + bent
    found = hertz + bent - f.pull - f.snap * xp.exp(-(((x - 0.4) / 0.1) ** 2))
    return xp.where(x < f.end, found, xp.nan)


def unloading(f, x, top, xp=jnp):
    share = x / top
    rest = f.rest - f.gap / (top + f.sharp)
    s = (share - rest) / (1 - rest)
    inside, peak = s > 0, loading(f, top, xp)
    corner = xp.minimum(f.kink, top)
    shapes = [
        f.floor + (1 - f.floor) * _power(s, f.back, xp),
        s - f.jolt * xp.maximum(corner - x, 0) / top,
    ]
    below = xp.where(inside, _hertz(s, xp), xp.nan)
    if getattr(f, "few", False):
        return peak * xp.where(f.shape == BELOW, below, xp.where(f.shape == CLIPPED, *shapes))
    shapes += [
        s**3,
        -xp.expm1(-20 * xp.maximum(s, -1.0)) / -np.expm1(-20.0),
        xp.where(inside, 0.5 * (1 + s), -0.5),
        xp.where(inside, 0.5 * (1 + s), 0.0),
        below,
        xp.where((share > 0.5) & (share < 0.7), xp.nan, _hertz(share, xp)),
    ]
    # one is chosen before it meets the peak: slopes of the others are none
    shape = sum(xp.where(f.shape == k, one, 0.0) for k, one in enumerate(shapes))
    hertz = xp.where(f.shape == HERTZ, _hertz(x, xp), 0.0)
    return peak * shape + f.floor * (hertz + xp.where(f.shape == SAME, loading(f, x, xp), 0.0))


# answers by quadrature, all laws at once


class Answers(NamedTuple):
    """ε_p², overlaps over LENGTH."""

    squared: np.ndarray
    peak: np.ndarray
    residual: np.ndarray


def answers(f: Columns, velocity) -> Answers:
    energy = 0.4 * velocity**2
    top = _bisected(lambda x: _work(f, x) - energy, 1e4 * np.ones_like(velocity))
    lowest = _bisected(lambda x: unloading(f, x, top, np), top)
    goes_below = (f.shape == OPEN) & (unloading(f, 0 * top, top, np) < 0)
    low = np.where(f.shape == CLIPPED, f.rest * top, np.where(goes_below, lowest, 0.0))
    edges = np.sort([low, top, *(np.clip(at, low, top) for at in (f.kink, f.elastic))], axis=0)
    each = Columns(*(column[:, None] for column in f))
    back = 0.0
    for left, right in itertools.pairwise(edges):
        half = 0.5 * (right - left)[:, None]
        x = left[:, None] + half * (1 + NODES)
        back += np.sum(half * WEIGHTS * unloading(each, x, top[:, None], np), axis=1)
    return Answers(back / energy, top, low)


def _bisected(function, high):
    """Where a function that is below zero at 0 and not at `high` changes its sign."""
    low = 0 * high
    for _ in range(120):
        middle = 0.5 * (low + high)
        below = function(middle) < 0
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return 0.5 * (low + high)


def _work(f, x):
    inside, out, above = np.minimum(x, f.elastic), x - f.elastic, x - f.kink
    bent = sum(
        a * _power(y, n + 1, np) / (n + 1)
        for a, y, n in ((f.slope, out, f.power), (f.more, above, f.bend))
    )
    snap = 0.05 * np.sqrt(np.pi) * f.snap * (erf((x - 0.4) / 0.1) + erf(4.0))
    plateau = f.elastic**1.5 * np.maximum(out, 0.0)
    return 0.4 * inside**2.5 + plateau + bent - f.pull * x - snap


def duration(f, velocity: float, top: float, low: float) -> float:
    """The time of x'' = -(5/4) p up to the peak and back from it [LENGTH per m/s], by SciPy."""

    def until(force, state, vanishes):
        def end(_, state):
            return vanishes(*state)

        end.terminal, end.direction = True, -1
        motion = lambda _, state: (state[1], -1.25 * float(force(max(state[0], 0.0))))  # noqa: E731
        found = solve_ivp(motion, (0, 1e3), state, "DOP853", events=end, rtol=1e-12, atol=1e-13)
        return float(found.t_events[0][0])

    up = until(lambda x: loading(f, x, np), (0.0, velocity), lambda x, v: v)
    return up + until(lambda x: unloading(f, x, top, np), (top, 0.0), lambda x, v: x - low)


# kinds

# what pulls on the way, jumps, or stiffens much: by quadrature
PULLED = [
    ({"power": 1.5, "pull": pull, "snap": snap, "shape": HERTZ, "floor": share}, v)
    for pull, snap, share in ((0.01, 0, 0.8), (0.1, 0, 0.8), (0.5, 0, 0.8), (0, 2.0, 0.5))
    for v in (1.0, 4.0)
]
JUMPING = {"power": 1.5, "kink": 0.31, "more": 0.5, "bend": 0.0, "shape": SAME, "floor": 0.8}
PULLED += [(JUMPING, v) for v in (0.5, 1.0, 3.0)]
STIFFENING = {"power": 1.5, "kink": 0.0, "more": 20.0, "bend": 4.0, "back": 2.0}
PULLED += [(STIFFENING, v) for v in (0.05, 1.0, 4.0)]


def draw(seed: int, count: int) -> tuple[Columns, np.ndarray]:
    """So many laws, and velocities at which some stay elastic and most do not."""
    rng = np.random.default_rng(seed)

    def chance(share):
        return (rng.random(count) < share) * 1.0

    def between(low, high):
        return rng.uniform(low, high, count)

    elastic = chance(0.5) * between(0.05, 3.0)
    bent = chance(0.6) * (1 - chance(0.2) * (elastic > 0))  # the rest of those are plateaus
    remains = chance(0.6)
    opens = remains * chance(0.4)
    floor = (1 - remains) * chance(0.5) * between(0.1, 0.9)
    given = {
        "elastic": elastic,
        "slope": np.where((elastic == 0) | (bent > 0), 10 ** between(-1, 1.3), 0.0),
        "power": np.where(elastic > 0, between(1, 2), between(0.5, 3)),
        "kink": elastic + between(0.05, 2.0),
        "more": bent * 10 ** between(-1, 1.3),
        "bend": rng.choice([1.0, 1.5, 2.0], count),
        "rest": remains * between(0.05, 0.95),
        "back": np.where(opens > 0, 1.0, between(1, 3)),
        "floor": floor,
        "jolt": chance(0.3) * between(0, 0.5) * (floor == 0) * opens,
        "shape": np.where(opens > 0, 1.0 * OPEN, CLIPPED),
    }
    whole = {name: np.full(count, float(DEFAULTS[name])) for name in NAMES} | given
    return Columns(**whole), 10 ** between(-0.3, 1.0)


class Impact(NamedTuple):
    """An impact solved by hand, lengths over LENGTH and times by LENGTH/(1 m/s); NaN where unknown."""

    law: dict[str, float]
    velocity: float
    squared: float  # ε²
    peak: float
    residual: float
    status: sj.Status = sj.Status.PLAIN
    tolerance: float = 1e-9  # of ε², relative
    duration: float = np.nan


def by_hand() -> list[Impact]:
    """ε² = P_m x_m (1 - ρ) ∫ shape ds over the work of loading, 0.4 v²."""
    rows, none, plain = [], float("nan"), sj.Status.PLAIN
    opened, gain, inexact = (
        sj.Status[n] for n in ("NO_RESIDUAL_OVERLAP", "ENERGY_GAIN", "INEXACT")
    )
    # a spring, x_m²/2 = 0.4 v²: back straight, clipped, of any power, bent, and where it jumps or drops
    pace = np.sqrt(0.8)
    peak = 0.7 * pace
    steep = 1 / -np.expm1(-20.0) - 0.05
    shapes = [({"shape": k}, area) for k, area in ((OPEN, 0.5), (CUBE, 0.25), (STEEP, steep))]
    shapes += [({"back": n}, 1 / (n + 1)) for n in (1.0, 1.5, 2.5, 0.5)]
    shapes += [({"shape": k}, 0.75) for k in (JUMPS, DROPS)]
    for rest in (0.37, 0.9):
        for shape, area in shapes:
            squared = 2 * (1 - rest) * area
            flags = inexact if shape.get("shape") in (JUMPS, DROPS) else plain
            flags = gain if squared > 1 else flags
            # of a straight line back a quarter period of each spring
            lasts = 0.5 * np.pi * pace * (1 + np.sqrt(1 - rest)) if area == 0.5 else none
            law = shape | {"rest": rest}
            rows.append(Impact(law, 0.7, squared, peak, rest * peak, flags, 1e-11, lasts))
    # down to zero overlap: positive there, zero there, clipped at zero, just above zero by a hair
    for floor, back, rest in ((0.2, 2.0, 0.0), (0.0, 2.0, 0.0), (0.0, 1.0, 0.5), (1e-9, 3.0, 0.0)):
        law = {"floor": floor, "back": back, "rest": rest}
        squared = 2 * (1 - rest) * (floor + (1 - floor) / (back + 1))
        rows.append(Impact(law, 0.7, squared, peak, rest * peak, plain if rest else opened))
    # powers of the overlap over 24 decades of energy: x^{p+1}/(p + 1) = 0.4 v²
    for power in (0.0, 1.0, 1.5, 4.0):
        for v in (1e-9, 1e-3, 1.0, 1e3):
            peak = ((power + 1) * 0.4 * v**2) ** (1 / (power + 1))
            flags = opened | gain if power > 1 else opened
            rows.append(Impact({"power": power}, v, (power + 1) / 2, peak, 0.0, flags, 1e-8))
    # Hertz's collision by its forces alone, so slow that squares underflow
    for v in (1e-300, 1e-100):
        law, peak = {"power": 1.5, "back": 1.5}, v**0.8
        lasts = 0.8 * beta(0.4, 0.5) * peak / v
        rows.append(Impact(law, v, 1.0, peak, 0.0, opened, duration=lasts))
    # a triangle of work end/2 turns a body of less energy; so does what is no number from `end`
    falls = {"power": 0.0, "kink": 0.0, "bend": 1.0, "declared": 0.0}
    for share, end, triangle in (
        (0.8, 1.3, True),
        (1.2, 3.0, True),
        (0.9, 2, False),
        (1.1, 2, False),
    ):
        work = share * end * (0.5 if triangle else 1.0)
        law = falls | {"more": -1 / end} if triangle else {"power": 0.0, "end": end}
        v = np.sqrt(2.5 * work)
        if share > 1:
            rows.append(Impact(law, v, 0.0, none, none, sj.Status.NO_TURNING_POINT))
            continue
        x = end * (1 - np.sqrt(1 - share)) if triangle else end * share
        force = 1 - x / end if triangle else 1.0
        rows.append(Impact(law, v, 0.5 * force * x / work, x, 0.0, opened, 1e-8))
    # a plateau up to a million times its start: (2/5) y² = 2/5 + (x_m - 1), ε² = (1/4)/((2/5) y²)
    law = {"elastic": 0.01, "slope": 0.0, "rest": 1.0, "gap": 0.005, "sharp": 0.0}
    critical = 0.01**1.25
    rows.append(Impact(law, 0.5 * critical, 1.0, 0.01 * 0.5**0.8, 0.0, sj.Status.ELASTIC))
    for y in (1.5, 10.0, 1e3, 1e6):
        x = 1 + 0.4 * (y**2 - 1)
        # a law of overlaps alone knows x_m - x of a nearly plastic impact to the rounding of x_m
        near = 1e-8 if y < 1e6 else 3e-3
        rows.append(
            Impact(law, y * critical, 0.625 / y**2, 0.01 * x, 0.01 * (x - 0.5), plain, near)
        )
    # s^{3/2} that sharpens with the peak, no number below δ* or 0 there; then a hole on the way back
    for v in (1e-3, 0.1, 10.0):
        peak = v * pace
        rest = peak / (peak + 0.5)
        for shape in ({"shape": BELOW}, {"back": 1.5}):
            law = shape | {"rest": 1.0, "gap": 0.5, "sharp": 0.5}
            rows.append(Impact(law, v, 0.8 * (1 - rest), peak, rest * peak, plain, 1e-8))
    peak = 0.7 * pace
    left = 0.8 * (1 - 0.7**2.5)
    rows.append(Impact({"shape": HOLE}, 0.7, left, peak, 0.7 * peak, inexact, 1e-6))
    return rows
