"""Profile likelihood: how far one parameter can go while the others make up for it."""

from dataclasses import dataclass, replace

import numpy as np

from calibration.parameters import NONE
from calibration.problem import Problem
from calibration.search import search

FARTHEST = 12.0  # in z from the estimate (factors of e): beyond, an interval is open
ROOT_TOLERANCE = 1e-9
POINTS = 9  # on each side, for the picture
STEPS = 60


@dataclass(frozen=True)
class Profile:
    """Δχ² along one parameter, all others refitted; limits None where it never reaches `threshold`.

    Attributes:
        parameter: its label.
        values: of the parameter, physical units.
        delta_chi_squared: cost above its minimum, in units of the noise variance.
        low, high: where it crosses `threshold`.
        threshold: quantile² of the confidence level.
    """

    parameter: str
    values: tuple[float, ...]
    delta_chi_squared: tuple[float, ...]
    low: float | None
    high: float | None
    threshold: float


class _Walk:
    """√Δχ² of the refit at a value of one element, warm-started from the last one."""

    def __init__(self, problem: Problem, position: int, variance: float):
        self.problem, self.position, self.variance = problem, position, variance
        self.others = problem.active[problem.active != position]
        self.base = np.array(problem.base)
        value, _ = problem.linearise(problem.start)
        self.lowest = float(value @ value)
        self.last = self.base
        # a refit from elsewhere may end elsewhere, so each is made once
        self.known = {float(problem.base[position]): 0.0}

    def __call__(self, z: float) -> float:
        if z not in self.known:
            self.known[z] = self._refit(z)
        return self.known[z]

    def _refit(self, z: float) -> float:
        base = np.array(self.last)
        base[self.position] = z
        problem = replace(self.problem, base=base, active=self.others)
        if len(self.others):
            found = search(problem, problem.start, limit=STEPS)
            self.last, cost = problem.full(found.z), 2 * found.cost
        else:
            value, _ = problem.linearise(problem.start)
            self.last, cost = base, float(value @ value)
        rise = float(np.sqrt(max(cost - self.lowest, 0.0) / self.variance))
        return rise if np.isfinite(rise) else 1e6

    def restart(self) -> None:
        self.last = self.base


def profile(
    problem: Problem, position: int, label: str, variance: float, step: float, quantile: float
) -> Profile:
    """The profile of one element of z, `step` being about one standard error in z."""
    centre = float(problem.base[position])
    walk = _Walk(problem, position, variance)
    physical = lambda z: _physical(problem, position, z)  # noqa: E731
    ends, zs, deltas = [], [centre], [0.0]
    for sign in (-1, 1):
        walk.restart()
        end = _crossing(walk, centre, sign * step, quantile)
        ends.append(end)
        reach = end if end is not None else centre + sign * min(6 * step, FARTHEST)
        walk.restart()
        for part in np.linspace(0, 1.15, POINTS + 1)[1:]:
            z = centre + part * (reach - centre)
            zs.append(z)
            deltas.append(walk(z) ** 2)
    order = np.argsort(zs)
    return Profile(
        label,
        tuple(float(physical(zs[i])) for i in order),
        tuple(float(deltas[i]) for i in order),
        None if ends[0] is None else physical(ends[0]),
        None if ends[1] is None else physical(ends[1]),
        quantile**2,
    )


def _crossing(walk: _Walk, centre: float, step: float, quantile: float) -> float | None:
    """Where √Δχ² crosses the quantile: bracketed by growing steps, then Brent; None where open."""
    from scipy.optimize import brentq

    scaled = walk.problem.layout.kind[walk.position] != NONE
    farthest = FARTHEST if scaled else 100 * abs(step)
    inside, length = centre, min(abs(step) * quantile, 0.5 * farthest)
    outside = centre + np.sign(step) * length
    while walk(outside) < quantile:
        if length >= farthest:
            return None
        inside, length = outside, min(1.6 * length, farthest)
        outside = centre + np.sign(step) * length
    f = lambda z: walk(z) - quantile  # noqa: E731
    return float(brentq(f, inside, outside, xtol=ROOT_TOLERANCE, rtol=ROOT_TOLERANCE))


def _physical(problem: Problem, position: int, z: float) -> float:
    full = np.array(problem.base)
    full[position] = z
    return float(problem.layout.physical(full, np)[position])
