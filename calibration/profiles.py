"""Profile likelihood: how far one parameter can go while the others make up for it."""

from dataclasses import dataclass, replace

import numpy as np

from calibration.ending import whitening
from calibration.parameters import NONE
from calibration.problem import Problem
from calibration.search import search

FARTHEST = 12.0  # in z from the estimate (factors of e): beyond, an interval is open
ROOT_TOLERANCE = 1e-9
POINTS = 9  # on each side, for the picture
STEPS = 100
STRIDE = 0.25  # in log units: ψ to σ is a curved way
LARGEST_ANSWER = 30.0  # of the others to one stride, in log units


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
    """√Δχ² of the refit at values of one element, each started from its nearest neighbour.

    Long ways are gone in strides: where parameters make up for each other, a refit that starts far
    off may end in another minimum, and the profile would jump.
    """

    def __init__(self, problem: Problem, position: int, variance: float, stride: float):
        self.problem, self.position, self.variance = problem, position, variance
        self.stride = stride
        self.others = problem.active[problem.active != position]
        value, _ = problem.linearise(problem.start)
        self.lowest = float(value @ value)
        # a refit from elsewhere may end elsewhere, so each is made once
        self.known = {float(problem.base[position]): (0.0, np.array(problem.base))}

    def __call__(self, z: float) -> float:
        near = min(self.known, key=lambda one: abs(one - z))
        strides = max(int(np.ceil(abs(z - near) / self.stride)), 1)
        base = self.known[near][1]
        for at in np.linspace(near, z, strides + 1)[1:]:
            if at not in self.known:
                self.known[at] = self._refit(base, float(at))
            base = self.known[at][1]
        return self.known[z][0]

    def _refit(self, near, z: float) -> tuple[float, np.ndarray]:
        """√Δχ² at z, and the whole vector there; the start is a neighbour's, moved on."""
        base = self._foreseen(near, z)
        problem = replace(self.problem, base=base, active=self.others)
        found = search(problem, problem.start, limit=STEPS)
        if not found.converged:
            problem = self.problem_at(near, z)
            found = min(found, search(problem, problem.start, limit=STEPS), key=lambda s: s.cost)
        rise = float(np.sqrt(max(2 * found.cost - self.lowest, 0.0) / self.variance))
        return (rise, problem.full(found.z)) if np.isfinite(rise) else (1e6, near)

    def problem_at(self, near, z: float) -> Problem:
        """The others' problem with the element at z, started from where they are."""
        base = np.array(near)
        base[self.position] = z
        return replace(self.problem, base=base, active=self.others)

    def _foreseen(self, near, z: float) -> np.ndarray:
        """What the others do to first order when the element goes to z."""
        base = np.array(near)
        move = z - base[self.position]
        _, jacobian = self.problem.linearise_all(base)
        base[self.position] = z
        if np.all(np.isfinite(jacobian)):
            basis = whitening(jacobian[:, self.others])
            answer = -basis @ (basis.T @ (jacobian[:, self.others].T @ jacobian[:, self.position]))
            scaled = self.problem.layout.kind[self.others] != NONE
            limit = np.where(scaled, LARGEST_ANSWER, np.inf)
            base[self.others] += np.clip(answer * move, -limit, limit)
        return base


def profile(
    problem: Problem, position: int, label: str, variance: float, step: float, quantile: float
) -> Profile:
    """The profile of one element of z, `step` being about one standard error in z."""
    centre = float(problem.base[position])
    scaled = problem.layout.kind[position] != NONE
    walk = _Walk(problem, position, variance, min(2 * step, STRIDE) if scaled else 2 * step)
    physical = lambda z: _physical(problem, position, z)  # noqa: E731
    ends, zs, deltas = [], [centre], [0.0]
    for sign in (-1, 1):
        end = _crossing(walk, centre, sign * step, quantile)
        ends.append(end)
        reach = end if end is not None else centre + sign * min(6 * step, FARTHEST)
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
