"""Least squares of a candidate by SciPy's Levenberg–Marquardt (MINPACK).

Values and exact slopes come from one compiled function, `curves.expand`. A search compiled as a
whole would run no faster, but compiles for five times as long, for each law anew.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from calibration.compare.candidates import Candidate
from calibration.compare.curves import Expanded, Observed, expand
from calibration.compare.scores import promised
from calibration.data.measurements import RestitutionData
from calibration.minima import LEFT_UNDONE

STARTS = 16
MOST_EVALUATIONS = 100
TOLERANCE = 1e-10
FIRST_REACH = 1.0  # of a search in z: a factor of e
MINPACK_FACTOR = 100  # its first reach over the scale of the variables, for a start at 0
ROUNDS = 4  # searches in a row, each from where the last one stopped
SEED = 0


@dataclass
class Problem:
    """Weighted residuals of one candidate over z, with their Jacobian.

    The last evaluation is kept: MINPACK asks for slopes where it has just asked for values.
    """

    candidate: Candidate
    observed: Observed
    units: np.ndarray
    _last: tuple[bytes, Expanded] | None = field(default=None, repr=False)

    def at(self, z: np.ndarray) -> Expanded:
        """ε, slopes and status at each observed point."""
        key = np.asarray(z, float).tobytes()
        if self._last is None or self._last[0] != key:
            found = expand(self.candidate, z, self.units, self.observed.points)
            self._last = key, found.first(self.observed.count)
        return self._last[1]

    def residual(self, z: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """Weighted residuals, (points,)."""
        return weight * (self.at(z).value - self.observed.restitution)

    def jacobian(self, z: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """Their slopes in z, (points, p)."""
        return weight[:, None] * self.at(z).slope

    def cost(self, z: np.ndarray) -> float:
        """Sum of squares of all weighted residuals."""
        residual = self.residual(z, self.observed.weight)
        return float(residual @ residual)


class Refits(NamedTuple):
    """Where each search ended: z (fits, p), sum of squares, and whether that is a minimum."""

    z: np.ndarray
    cost: np.ndarray
    converged: np.ndarray


def starts_of(candidate: Candidate, data: RestitutionData) -> np.ndarray:
    """`STARTS` starts in z: the middle of the box, and a Sobol sequence in it."""
    from scipy.stats import qmc

    assert candidate.box is not None
    boxes = zip(candidate.parameters, candidate.box(data), candidate.units(data), strict=True)
    ends = [[free.searched(end, unit) for end in box] for free, box, unit in boxes]
    low, high = np.array(ends).T
    inside = qmc.Sobol(len(low), seed=SEED).random(STARTS)
    inside[0] = 0.5
    return low + (high - low) * inside


def from_starts(problem: Problem, starts: np.ndarray) -> Refits:
    """A search from each start, against all points."""
    weight = problem.observed.weight
    return _joined([search(problem, start, weight) for start in starts])


def without_each(problem: Problem, z: np.ndarray) -> Refits:
    """A search from z for each point, against all points but that one."""
    found = []
    for left_out in range(problem.observed.count):
        weight = problem.observed.weight.copy()
        weight[left_out] = 0.0
        found.append(search(problem, z, weight))
    return _joined(found)


def search(problem: Problem, start: np.ndarray, weight: np.ndarray):
    """One search: z, sum of squares, and whether that is a minimum.

    MINPACK stops where a step lowers the sum of squares by next to nothing, be it because the step
    had to be short. So what it says of its end does not count: that is a minimum where the gradient
    says so, and else the search goes on from there.
    """
    z = start
    for _ in range(ROUNDS):
        found = _marquardt(problem, z, weight)
        z = z + found.x
        at_minimum = promised(found.fun, found.jac) <= LEFT_UNDONE
        if at_minimum or found.status <= 0:
            break
    return z, 2 * float(found.cost), at_minimum


def _marquardt(problem: Problem, start: np.ndarray, weight: np.ndarray):
    """MINPACK's search from a start, in the distance from it.

    Its steps may first be as long as the start is far from 0, times 100. In z, where 0 is no more
    than the unit that the data suggest, that would be no step at all from a start at 1e-16.
    """
    from scipy.optimize import least_squares

    return least_squares(
        lambda distance: problem.residual(start + distance, weight),
        np.zeros_like(start),
        lambda distance: problem.jacobian(start + distance, weight),
        method="lm",
        x_scale=FIRST_REACH / MINPACK_FACTOR,
        ftol=TOLERANCE,
        xtol=TOLERANCE,
        gtol=TOLERANCE,
        max_nfev=MOST_EVALUATIONS,
    )


def _joined(found) -> Refits:
    return Refits(*map(np.array, zip(*found, strict=True)))
