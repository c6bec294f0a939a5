"""Profile likelihood: how far one parameter can go while the others make up for it.

All walks, two for each parameter, go side by side: each stride is one batch of refits.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from calibration.fitting.condensed import condense
from calibration.fitting.problem import Problem
from calibration.fitting.search import FARTHEST as FURTHEST
from calibration.fitting.search import search
from calibration.fitting.transform import NONE

FARTHEST = 12.0  # in z from the estimate (factors of e): beyond, an interval is open
STRIDE = 0.25  # in log units: where parameters make up for each other the way is curved
LEVEL, LEVEL_STRIDE = 0.1, 2.0  # √Δχ² up to which a way from an end of the range is hurried
STEPS = 100  # of one refit
POINTS = 6.0  # strides up to the limit, about
BEYOND = 1.15  # of the way to the limit that is looked at, for the picture
TOLERANCE = 1e-7  # of the limit, in z, or of √Δχ² there
MOST_STRIDES = 400
MOST_HALVINGS = 60
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


@dataclass(frozen=True)
class Walk:
    """One parameter in one direction.

    Attributes:
        column: which of the active elements.
        sign: +1 upwards, -1 downwards, in z.
        step: about one standard error, in z.
        quantile: √Δχ² at the limit.
        from_end: whether it begins at an end of the parameter's range, where all is level.
    """

    column: int
    sign: int
    step: float
    quantile: float
    from_end: bool = False


class _Walks:
    """√Δχ² of refits along several walks, in lockstep."""

    def __init__(self, problem: Problem, z, begun, walks: list[Walk], variance):
        self.problem, self.begun, self.walks = problem, begun, walks
        self.variance = variance
        self.quantile = np.array([walk.quantile for walk in walks])
        self.columns = np.array([walk.column for walk in walks])
        self.signs = np.array([walk.sign for walk in walks])
        self.positions = problem.active[self.columns]
        self.held = np.zeros((len(walks), len(problem.active)), bool)
        self.held[np.arange(len(walks)), self.columns] = True
        self.scaled = problem.transform.kind[self.positions] != NONE
        self.steps = np.array([walk.step for walk in walks])
        self.centre = z[self.positions]
        self.z = np.repeat(z[None], len(walks), axis=0)
        self.lowest = float(np.sum(problem.linearise(z[None]).residual ** 2))
        self.from_end = np.array([walk.from_end for walk in walks])
        reach = np.where(self.from_end, FURTHEST + FARTHEST, FARTHEST)
        self.reach = np.where(self.scaled, reach, 100 * self.steps)
        self.way: list[list[tuple[float, float]]] = [[] for _ in walks]

    def refit(self, at: Float[np.ndarray, "some"], which: Int[np.ndarray, "some"]):
        """Everything else refitted with the parameters there: z of each, and √Δχ²."""
        start = self._foreseen(at, which)
        found = self._search(start, which)
        plain = np.array(self.z[which])
        plain[np.arange(len(which)), self.positions[which]] = at
        z, cost = found.z, found.cost
        # a far limit may be a search that was sent astray: looked at again from where the walk is
        poor = ~found.converged | (self._rise(cost) > self.quantile[which])
        if np.any(poor):
            again = self._search(plain[poor], which[poor])
            lower = again.cost < cost[poor]
            z[np.flatnonzero(poor)[lower]] = again.z[lower]
            cost[np.flatnonzero(poor)[lower]] = again.cost[lower]
        return z, self._rise(cost)

    def _rise(self, cost: Float[np.ndarray, "some"]) -> Float[np.ndarray, "some"]:
        """√Δχ²."""
        rise = np.sqrt(np.maximum(2 * cost - self.lowest, 0.0) / self.variance)
        return np.where(np.isfinite(rise), rise, 1e6)

    def _search(self, start, which):
        """The others searched, from some start."""
        held = self.held[which]
        return search(self.problem, start, begun=self.begun, held=held, limit=STEPS)

    def _foreseen(self, at, which) -> np.ndarray:
        """What the others do to first order when the parameters go there."""
        z = np.array(self.z[which])
        rows = np.arange(len(which))
        move = at - z[rows, self.positions[which]]
        found = self.problem.linearise(z)
        # the column that moves stands in for the residual: its answer is the others' least squares
        moving = found.jacobian[rows, :, self.columns[which]]
        begun = np.where(np.isnan(self.begun), z, self.begun)
        at_an_end = np.abs(z - begun)[:, self.problem.active] > 0.9 * FURTHEST
        answer = condense(moving, found.jacobian, self.held[which] | at_an_end).newton
        scaled = self.problem.transform.kind[self.problem.active] != NONE
        answer = answer * move[:, None]
        limited = np.clip(answer, -LARGEST_ANSWER, LARGEST_ANSWER)
        z[:, self.problem.active] += np.where(scaled, limited, answer)
        z[rows, self.positions[which]] = at
        return z

    def run(self) -> Float[np.ndarray, "walks"]:
        """Where each walk crosses the quantile, NaN where it does not; `way` is what was seen."""
        count = len(self.walks)
        stride = np.where(self.scaled, np.minimum(self.steps, STRIDE), self.steps)
        inside, rise = np.array(self.centre), np.zeros(count)
        crossing = np.full(count, np.nan)
        going = np.ones(count, bool)
        for _ in range(MOST_STRIDES):
            which = np.flatnonzero(going)
            if not len(which):
                break
            at = inside[which] + self.signs[which] * stride[which]
            z, new = self.refit(at, which)
            for k, place, value in zip(which, at, new, strict=True):
                self.way[k].append((float(place), float(value)))
            over = new >= self.quantile[which]
            there = which[over]
            missing = self.quantile[there]
            ends = inside[there], at[over], rise[there] - missing, new[over] - missing
            crossing[there] = self._cross(there, *ends)
            self.z[which[~over]] = z[~over]
            grown = np.maximum(new - rise[which], 1e-3)
            better = stride[which] * np.clip(self.quantile[which] / POINTS / grown, 0.5, 2.0)
            level = self.from_end[which] & (new < LEVEL)
            limit = np.where(level, LEVEL_STRIDE, STRIDE)
            better = np.where(level, LEVEL_STRIDE, better)
            stride[which] = np.where(self.scaled[which], np.minimum(better, limit), better)
            inside[which[~over]], rise[which[~over]] = at[~over], new[~over]
            gone = np.abs(at - self.centre[which]) >= self.reach[which]
            going[which[over | gone]] = False
        self._beyond(crossing)
        return crossing

    def _cross(self, which, inside, outside, below, above) -> np.ndarray:
        """The crossing between two places of each walk, by the Illinois method.

        Args:
            below, above: √Δχ² there less the quantile.
        """
        low, high = np.array(inside), np.array(outside)
        if not len(which):
            return low
        f_low, f_high = np.array(below), np.array(above)
        side = np.zeros(len(which))
        for _ in range(MOST_HALVINGS):
            between = np.clip(f_low / (f_low - f_high), 0.0, 1.0)
            middle = low + np.where(np.isfinite(between), between, 0.5) * (high - low)
            f_middle = self._excess(middle, which)
            up = f_middle > 0
            f_low = np.where(up & (side > 0), 0.5 * f_low, f_low)
            f_high = np.where(~up & (side < 0), 0.5 * f_high, f_high)
            high, f_high = np.where(up, middle, high), np.where(up, f_middle, f_high)
            low, f_low = np.where(up, low, middle), np.where(up, f_low, f_middle)
            side = np.where(up, 1.0, -1.0)
            done = (np.abs(high - low) <= TOLERANCE) | (np.abs(f_middle) <= TOLERANCE)
            if np.all(done):
                break
        return middle

    def _excess(self, at, which) -> np.ndarray:
        return self.refit(at, which)[1] - self.quantile[which]

    def _beyond(self, crossing) -> None:
        """One look beyond each limit, for the picture."""
        which = np.flatnonzero(np.isfinite(crossing))
        if len(which):
            at = self.centre[which] + BEYOND * (crossing[which] - self.centre[which])
            for k, place, value in zip(which, at, self.refit(at, which)[1], strict=True):
                self.way[k].append((float(place), float(value)))


def profiles(
    problem: Problem,
    z: Float[np.ndarray, "elements"],
    begun: Float[np.ndarray, "elements"],
    columns: Int[np.ndarray, "some"],
    errors: Float[np.ndarray, "some"],
    limits: Int[np.ndarray, "some"],
    variance: float,
    quantiles: Float[np.ndarray, "some"],
) -> dict[str, Profile]:
    """Profiles of some active elements, by their labels.

    Args:
        begun: as `search` takes it.
        columns: which of the active elements.
        errors: their standard errors in z.
        limits: +1 or -1 for those held at an end of their range: only the other way is gone.
        variance: of a weighted residual.
        quantiles: √Δχ² at the limits of each.
    """
    walks = [
        Walk(int(column), sign, float(error), float(reach), bool(limit))
        for column, error, reach, limit in zip(columns, errors, quantiles, limits, strict=True)
        for sign in (-1, 1)
        if sign != limit
    ]
    if not walks:
        return {}
    state = _Walks(problem, z, begun, walks, variance)
    crossing = state.run()
    found = {}
    for column, limit in zip(columns, limits, strict=True):
        members = [k for k, walk in enumerate(walks) if walk.column == column]
        label = problem.elements[problem.active[column]].label
        found[label] = _profile(state, label, members, crossing, int(limit))
    return found


def _profile(state: _Walks, label: str, members, crossing, limit: int) -> Profile:
    """Both ways of one parameter together, in physical units."""
    position = int(state.positions[members[0]])
    transform = state.problem.transform.part(np.array([position]))
    physical = lambda z: float(transform.physical(np.array([z]))[0])  # noqa: E731
    way = [(float(state.centre[members[0]]), 0.0), *(one for k in members for one in state.way[k])]
    way.sort()
    ends: dict[int, float | None] = {-1: None, 1: None}
    for k in members:
        if np.isfinite(crossing[k]):
            ends[int(state.signs[k])] = physical(crossing[k])
    if limit:
        bound = float(transform.bound_beyond(np.array([limit]))[0])
        ends[limit] = bound if np.isfinite(bound) else None
    return Profile(
        label,
        tuple(physical(at) for at, _ in way),
        tuple(rise**2 for _, rise in way),
        ends[-1],
        ends[1],
        float(state.quantile[members[0]]) ** 2,
    )
