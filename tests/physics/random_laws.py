"""Contact laws drawn at random, given by their forces in SI, and what SciPy makes of them.

One class holds them all, so that a batch of them is one compiled program: which parts a law has is
said by numbers. Overlaps x over LENGTH, forces over FORCE, those of Hertz's collision at 1 m/s:

    loading    min(x, e)^{3/2} + A (x - e)^p + B (x - b)^q             a plateau where A = B = 0
    unloading  P_m [s^u + (1 - s^u) c - j (b - x)/x_m],  s = (x - x*)/(x_m - x*),  x* = ρ x_m

with every difference in brackets, s too unless the law is `open`, not below zero.
"""

import jax.numpy as jnp
import numpy as np
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq

import softjax as sj
from tests.cases import pair

PAIR = pair("stainless steel", area="hertz")
VELOCITY = 1.0
# Hertz's collision at that velocity: its largest overlap and force
LENGTH = (5 * PAIR.mass * VELOCITY**2 / (4 * PAIR.stiffness)) ** 0.4
FORCE = PAIR.stiffness * LENGTH**1.5
PRECISE = {"epsabs": 1e-13, "epsrel": 1e-13, "limit": 200}


class Drawn(sj.RateIndependentLaw):
    """A drawn law without a word of where its kinks are. Overlaps over LENGTH, forces over FORCE."""

    contact: sj.Contact
    elastic: float  # e: Hertz's law up to there
    slope: float  # A
    power: float  # p
    kink: float  # b
    more: float  # B
    bend: float  # q
    rest: float  # ρ
    back: float  # u
    floor: float  # c: what is left at zero overlap
    jolt: float  # j: how much unloading steepens below b
    open: float  # 1: the unloading force goes on below zero

    def loading_force(self, overlap):
        x = overlap / LENGTH
        hertz = _power(jnp.minimum(x, self.elastic), 1.5)
        first = self.slope * _power(x - self.elastic, self.power)
        return FORCE * (hertz + first + self.more * _power(x - self.kink, self.bend))

    def unloading_force(self, overlap, peak_overlap):
        rest = self.rest * peak_overlap
        s = (overlap - rest) / (peak_overlap - rest)
        shape = jnp.where(self.open > 0, s, _power(s, self.back))
        shape = shape + (1 - shape) * self.floor
        corner = jnp.minimum(self.kink * LENGTH, peak_overlap)
        steeper = self.jolt * jnp.maximum(corner - overlap, 0) / peak_overlap
        return self.loading_force(peak_overlap) * (shape - steeper)


class Declared(Drawn):
    """The same law with all that may be said of it."""

    def elastic_overlap(self):
        return self.elastic * LENGTH

    def breakpoints(self):
        return (self.kink * LENGTH,)


def _power(x, exponent):
    inside = x > 0
    return jnp.where(inside, jnp.where(inside, x, 1.0) ** exponent, 0.0)


def draw(seed: int, count: int) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Fields of so many laws, and velocities at which some stay elastic and most do not."""
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
    fields = {
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
        "open": opens,
    }
    return fields, 10 ** between(-0.3, 1.0)


def law_of(fields: dict[str, np.ndarray], kind=Declared) -> Drawn:
    return kind(PAIR, **fields)


class Answer:
    """One impact by SciPy: closed works, bracketed roots, adaptive quadrature."""

    def __init__(self, fields: dict[str, float], velocity: float):
        self.f, self.velocity = fields, velocity
        f = fields
        energy = 0.4 * velocity**2
        top = brentq(
            lambda x: self._work(x) - energy, 0.0, self._beyond(energy), xtol=1e-300, rtol=1e-14
        )
        self.peak = top
        self.force = self.loading(top)
        end = lambda x: self.unloading(x)  # noqa: E731
        low = f["rest"] * top
        if f["open"]:
            low = brentq(end, 0.0, top, xtol=1e-300, rtol=1e-14) if end(0.0) < 0 else 0.0
        self.residual = low
        points = [p for p in (f["kink"], f["elastic"]) if low < p < top] or None
        self.squared = quad(self.unloading, low, top, points=points, **PRECISE)[0] / energy

    def _work(self, x):
        f = self.f
        inside, out = min(x, f["elastic"]), max(x - f["elastic"], 0.0)
        above = max(x - f["kink"], 0.0)
        first = 0.4 * inside**2.5 + f["elastic"] ** 1.5 * out
        second = f["slope"] * out ** (f["power"] + 1) / (f["power"] + 1)
        return first + second + f["more"] * above ** (f["bend"] + 1) / (f["bend"] + 1)

    def _beyond(self, energy):
        x = 1.0
        while self._work(x) < energy:
            x *= 2
        return x

    def loading(self, x):
        f = self.f
        out, above = max(x - f["elastic"], 0.0), max(x - f["kink"], 0.0)
        first = min(x, f["elastic"]) ** 1.5 + (f["slope"] * out ** f["power"] if out > 0 else 0.0)
        return first + (f["more"] * above ** f["bend"] if above > 0 else 0.0)

    def unloading(self, x):
        f = self.f
        rest = f["rest"] * self.peak
        s = (x - rest) / (self.peak - rest)
        shape = s if f["open"] else max(s, 0.0) ** f["back"]
        shape += (1 - shape) * f["floor"]
        return self.force * (
            shape - f["jolt"] * max(min(f["kink"], self.peak) - x, 0.0) / self.peak
        )

    def duration(self) -> float:
        """The time of x'' = -(5/4) p up to the peak and back from it [LENGTH per m/s]."""
        up = self._until(self.loading, (0.0, self.velocity), lambda x, v: v)
        down = self._until(self.unloading, (self.peak, 0.0), lambda x, v: x - self.residual)
        return up + down

    def _until(self, force, state, vanishes) -> float:
        def end(_, state):
            return vanishes(*state)

        end.terminal, end.direction = True, -1
        motion = lambda _, state: (state[1], -1.25 * force(max(state[0], 0.0)))  # noqa: E731
        found = solve_ivp(motion, (0, 1e3), state, "DOP853", events=end, rtol=1e-12, atol=1e-13)
        return float(found.t_events[0][0])


def answers(fields: dict[str, np.ndarray], velocity: np.ndarray) -> list[Answer]:
    names = list(fields)
    rows = zip(*(fields[name] for name in names), velocity, strict=True)
    return [Answer(dict(zip(names, row, strict=False)), row[-1]) for row in rows]
