"""Profile likelihoods: how far one parameter can go while the others make up for it.

Δχ²(θ_k) = 2 [min cost with θ_k held - min cost] in units of the noise variance; a limit is where √Δχ² is the quantile of
the confidence. Two measurements 0.95 and 0.85, each ± 0.05, of a constant ε: 0.9 ∓ 1.96 · 0.05/√2.

>>> import calibration as cal
>>> data = cal.RestitutionData([1.0, 1.0], [0.95, 0.85], uncertainty=[0.05, 0.05])
>>> profile = cal.fit(data, "constant", starts=1).profiles["restitution"]
>>> round(profile.low, 4), round(profile.high, 4), round(profile.threshold**0.5, 2)
(0.8307, 0.9693, 1.96)

All walks, two for each parameter of all fits of one kind, go side by side: each stride is one batch of refits.
Where the cost jumps at yield a refit begins from several yields, and Δχ² may fall again behind a limit:
of what yield depends on the limits are the outermost crossings."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from calibration.fitting.components import ComponentFit
from calibration.fitting.degrees_of_freedom import quantile
from calibration.fitting.elements import DRAG
from calibration.fitting.elements import FARTHEST as FURTHEST
from calibration.fitting.methods import factorise
from calibration.fitting.neighbourhoods import binned
from calibration.fitting.problem import Problem
from calibration.fitting.search import search
from calibration.fitting.side_by_side import alike, as_one
from calibration.parameters import LOGIT, NONE
from calibration.schema import Real

# Measured on 42 profiles of Zhou's law, 23 of nine ordinary fits and 19 of seven with a skewed or
# narrow likelihood; where it is said on the 23, or on 4 with a free yield strength. 2x is twice
# the evaluations.

FARTHEST = 12.0  # in z: beyond, an interval is open by convention; 6 opens 3 limits more
STRIDE = 0.25  # in log units, where the way is curved; 0.5 finds 5 false limits, 0.1 takes 1.7x
# steps of a refit up to which the next stride may grow: the way is straight; 10 finds 2 false
# limits, 1 takes 1.1x
EASY = 3
STEPS = 100  # of one refit
POINTS = 6.0  # strides up to the limit, about; 3 and 12 take 0.99x to 1.07x
BEYOND = 1.15  # of the way to the limit that is looked at, for the picture
TOLERANCE = 1e-6  # of the limit, in z, or of √Δχ² there
MOST_STRIDES = 400  # of a walk: open intervals end after 12/0.25 and few more
# of Δχ² that a refit may end above its minimum; of 23 profiles 1e-4 moves 3 limits by over 1e-3
# standard errors, 1e-9 takes 1.1x
ENOUGH = 1e-6
ROUNDING = 1e-12  # of a way
# of the others to one stride, in log units; 100 takes 0.6x and one limit of χ̃ is 0.01 short, 3
# finds 6 false limits
LARGEST_ANSWER = 30.0
# where Δχ² may fall again: shares of the way to a limit, or of so much in z; of 4 profiles the
# limits are the same with 6 or 96 places (0.9x and 1.6x), and with 0.05 to 0.8 in z
BEHIND = np.linspace(0, 1, 25)[1:]
LEAST_BEHIND = 0.2
BISECTIONS = 40  # of the outermost crossing: 0.2 in z to 1e-12
# in z, from which a refit begins too where the cost jumps: without, or with 0.01, 2 of 8 limits
# are 8 and 11 % off; with 0.2 none
OTHER_YIELDS = np.array([-0.05, 0.05])


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
    values: tuple[Real, ...]
    delta_chi_squared: tuple[Real, ...]
    low: float | None
    high: float | None
    threshold: float


class ProfileTask(NamedTuple):
    """Request for the profiles of one fit."""

    problem: Problem  # where it ended, as `search` takes it
    z: Float[np.ndarray, " elements"]
    reference_start: Float[np.ndarray, " elements"]
    variance: float  # of a weighted residual
    columns: Int[np.ndarray, " some"]  # which of the active elements
    errors: Float[np.ndarray, " some"]  # their standard errors in z
    # +1 or -1 for those held at an end of their range: only the other way is gone
    bound_side: Int[np.ndarray, " some"]
    quantiles: Float[np.ndarray, " some"]  # √Δχ² at the limits of each


class _Walks:
    """√Δχ² of refits along the walks of fits of one kind, in lockstep.

    Of each walk: of which task it is (`of`), along which of the active elements (`columns`) and which
    way (`signs`) in z, about one standard error (`steps`), and √Δχ² at the limit (`quantile`).
    """

    def __init__(self, tasks: Sequence[ProfileTask]):
        self.problem, batch = as_one([task.problem for task in tasks])
        problem, z = self.problem, np.array([task.z for task in tasks])
        walks = [
            (t, k, sign)
            for t, task in enumerate(tasks)
            for k, end in enumerate(task.bound_side)
            for sign in (-1, 1)
            if sign != end
        ]
        self.of, _, self.signs = np.transpose(walks)
        self.columns, self.steps, self.quantile, bound_side = (
            np.array([getattr(tasks[t], name)[k] for t, k, _ in walks])
            for name in ("columns", "errors", "quantiles", "bound_side")
        )
        self.reference_start, self.variance = (
            np.array([getattr(task, name) for task in tasks])[self.of]
            for name in ("reference_start", "variance")
        )
        self.batch, self.z, from_end = batch.select(self.of), z[self.of], bound_side != 0
        self.positions = problem.active[self.columns]
        self.fixed = self.columns[:, None] == np.arange(len(problem.active))
        kind = problem.transform.kind[self.positions]
        self.scaled = kind != NONE
        self.highest = problem.transform.part(problem.active).highest()
        self.centre = self.z[np.arange(len(walks)), self.positions]
        at_z = problem.linearise(z, batch, slopes=False).cost
        self.lowest = 2 * at_z[self.of]
        reach = np.where(from_end, FURTHEST + FARTHEST, FARTHEST)
        # a search that began at an end is farther off: the middle of two bounds is z = 0
        bounded = from_end & (kind == LOGIT)
        reach = np.where(bounded, np.maximum(reach, np.abs(self.centre) + FARTHEST), reach)
        # σ of e^100 and more follows from a steep ψ: its other limit may be that far off
        goes_far = np.array([problem.elements[k].reach for k in self.positions]) > FURTHEST
        back = np.maximum(reach, self.centre + FARTHEST)
        reach = np.where(goes_far & (self.signs < 0), back, reach)
        self.reach = np.where(self.scaled, reach, 100 * self.steps)
        self.way: list[list[tuple[float, float]]] = [[] for _ in walks]

    def refit(self, at: Float[np.ndarray, " some"], which: Int[np.ndarray, " some"], doubted=None):
        """Everything else refitted with the parameters there: z of each, √Δχ², and steps taken.

        Args:
            doubted: √Δχ² above which a search may have gone astray, and is made again from where the
                walk is; None: the limit.
        """
        minima = self._search(self._foreseen(at, which), which)
        z, rise = minima.z, self._rise(minima.cost, which)
        most = self.quantile[which] if doubted is None else doubted
        poor = np.flatnonzero(~minima.converged | (rise > most))
        if len(poor):
            plain = self.z[which[poor]]
            plain[np.arange(len(poor)), self.positions[which[poor]]] = at[poor]
            again = self._search(plain, which[poor])
            lower = again.cost < minima.cost[poor]
            z[poor[lower]] = again.z[lower]
            rise[poor[lower]] = self._rise(again.cost, which[poor])[lower]
        return z, rise, minima.iterations

    def _rise(self, cost: Float[np.ndarray, " some"], which) -> Float[np.ndarray, " some"]:
        """√Δχ²."""
        rise = np.sqrt(np.maximum(2 * cost - self.lowest[which], 0.0) / self.variance[which])
        return np.where(np.isfinite(rise), rise, 1e6)

    def _search(self, start, which):
        """The others searched, from some start; where the cost jumps, from other yields too."""
        count, yield_elements = 1, self.problem.affects_yield
        if yield_elements is not None:
            # others of a yield that is profiled itself are none
            count, at = 1 + len(OTHER_YIELDS), self.positions[which]
            other = np.where(yield_elements, 1.0, 0.0) * (
                np.arange(len(yield_elements)) != at[:, None]
            )
            shifts = np.concatenate([[0.0], OTHER_YIELDS])
            start = (start[:, None] + shifts[:, None] * other[:, None]).reshape(
                -1, len(yield_elements)
            )
            which = np.repeat(which, count)
        keywords = {
            "reference_start": self.reference_start[which],
            "fixed": self.fixed[which],
            "limit": STEPS,
        }
        keywords |= {"batch": self.batch.select(which), "enough": ENOUGH * self.variance[which]}
        ends = search(self.problem, start, **keywords)
        best = np.argmin(ends.cost.reshape(-1, count), axis=1)
        return ends.select(best + count * np.arange(len(best)))

    def _foreseen(self, at, which) -> np.ndarray:
        """First-order change of the other parameters when the profiled ones move."""
        z = self.z[which]
        rows = np.arange(len(which))
        move = at - z[rows, self.positions[which]]
        linear = self.problem.linearise(z, self.batch.select(which))
        # the column that moves stands in for the residual: its answer is the others' least squares
        moving = linear.jacobian[rows, :, self.columns[which]]
        reference_start = np.where(
            np.isnan(self.reference_start[which]), z, self.reference_start[which]
        )
        at_an_end = np.abs(z - reference_start)[:, self.problem.active] > 0.9 * FURTHEST
        at_an_end |= z[:, self.problem.active] >= self.highest
        answer = factorise(moving, linear.jacobian, self.fixed[which] | at_an_end).newton
        scaled = self.problem.transform.kind[self.problem.active] != NONE
        answer = answer * move[:, None]
        limited = np.clip(answer, -LARGEST_ANSWER, LARGEST_ANSWER)
        z[:, self.problem.active] += np.where(scaled, limited, answer)
        z[rows, self.positions[which]] = at
        return z

    def run(self, tell: Callable[[int], None]) -> Float[np.ndarray, " walks"]:
        """Value where each walk crosses the quantile, NaN if it does not; `way` is the path.

        By strides until one is beyond, then between the two by the Illinois method.
        """
        count, quantile = len(self.way), self.quantile
        stride = np.where(self.scaled, np.minimum(self.steps, STRIDE), self.steps)
        low, f_low, side = np.array(self.centre), -quantile, np.zeros(count)
        high, f_high = np.full((2, count), np.nan)
        crossing, going = np.full(count, np.nan), np.ones(count, bool)
        for _ in range(MOST_STRIDES):
            k = np.flatnonzero(going)
            tell(len(set(self.of) - set(self.of[k])))
            if not len(k):
                break
            remaining = self.reach[k] - np.abs(low[k] - self.centre[k])
            ahead = low[k] + self.signs[k] * np.minimum(stride[k], remaining)
            with np.errstate(invalid="ignore", divide="ignore"):
                part = np.clip(f_low[k] / (f_low[k] - f_high[k]), 0.0, 1.0)
            part = np.where(np.isfinite(part), part, 0.5)
            between = np.isfinite(high[k])
            at = np.where(between, low[k] + part * (high[k] - low[k]), ahead)
            z, rise, steps = self.refit(at, k, np.where(between, f_high[k], 0.0) + quantile[k])
            self._saw(k, at, rise)
            f = rise - quantile[k]
            is_beyond = f >= 0
            self.z[k[~is_beyond]] = z[~is_beyond]
            better = stride[k] * np.clip(
                quantile[k] / POINTS / np.maximum(f - f_low[k], 1e-3), 0.5, 2.0
            )
            limit = np.where(self.scaled[k] & (steps > EASY), STRIDE, np.inf)
            stride[k] = np.minimum(better, limit)
            gone = (
                ~is_beyond
                & ~between
                & (remaining - np.abs(at - low[k]) <= self.reach[k] * ROUNDING)
            )
            f_low[k[between & is_beyond & (side[k] > 0)]] *= 0.5  # an end that stays counts half
            f_high[k[between & ~is_beyond & (side[k] < 0)]] *= 0.5
            side[k] = np.where(between, np.where(is_beyond, 1.0, -1.0), 0.0)
            low[k], f_low[k] = np.where(is_beyond, low[k], at), np.where(is_beyond, f_low[k], f)
            high[k], f_high[k] = np.where(is_beyond, at, high[k]), np.where(is_beyond, f, f_high[k])
            crossing[k[is_beyond | between]] = at[is_beyond | between]
            close = (np.abs(high[k] - low[k]) <= TOLERANCE) | (np.abs(f) <= TOLERANCE)
            going[k] = ~(gone | (between & close))
        which = np.flatnonzero(np.isfinite(crossing))
        if self.problem.affects_yield is not None:
            yields = which[self.problem.affects_yield[self.positions[which]]]
            crossing[yields] = self._outermost(crossing[yields], yields)
        if len(which):  # one look beyond each limit, for the picture
            at = self.centre[which] + BEYOND * (crossing[which] - self.centre[which])
            self._saw(which, at, self.refit(at, which, BEYOND**2 * self.quantile[which])[1])
        return crossing

    def _outermost(self, crossing, which) -> Float[np.ndarray, " some"]:
        """Limits behind which Δχ² does not fall below them again where the cost jumps."""
        ahead = np.maximum(np.abs(crossing - self.centre[which]), LEAST_BEHIND)
        way = crossing[:, None] + (self.signs[which] * ahead)[:, None] * BEHIND
        many = np.repeat(which, len(BEHIND))
        rise = self.refit(way.ravel(), many)[1]
        self._saw(many, way.ravel(), rise)
        below = rise.reshape(way.shape) < self.quantile[which, None]
        last = len(BEHIND) - 1 - np.argmax(below[:, ::-1], axis=1)
        again = np.flatnonzero(np.any(below, axis=1) & (last < len(BEHIND) - 1))
        low, high = (
            way[again, last[again]],
            way[again, np.minimum(last[again] + 1, len(BEHIND) - 1)],
        )
        for _ in range(BISECTIONS):
            if np.all(np.abs(high - low) <= TOLERANCE):
                break
            middle = 0.5 * (low + high)
            is_below = self.refit(middle, which[again])[1] < self.quantile[which[again]]
            low, high = np.where(is_below, middle, low), np.where(is_below, high, middle)
        crossing[again] = low
        return crossing

    def _saw(self, which, at, rise) -> None:
        for k, place, value in zip(which, at, rise, strict=True):
            self.way[k].append((float(place), float(value)))


def profiles(
    tasks: Sequence[ProfileTask], tell: Callable[[int], None] = lambda done: None
) -> list[dict[str, Profile]]:
    """Profiles of some elements of fits of one kind, by their labels; `tell` hears how many are done."""
    state = _Walks(tasks)
    crossing = state.run(tell)
    return [
        {
            label: _profile(state, np.flatnonzero(members), label, int(limit), crossing)
            for column, limit in zip(task.columns, task.bound_side, strict=True)
            for members in [(state.of == t) & (state.columns == column)]
            for label in [task.problem.elements[task.problem.active[column]].label]
        }
        for t, task in enumerate(tasks)
    ]


def _profile(state: _Walks, members, label: str, limit: int, crossing) -> Profile:
    """Both sides of the profile of one parameter, in physical units."""
    first = int(members[0])
    position = int(state.positions[first])
    transform = state.problem.transform.part(np.array([position]))
    physical = lambda z: float(transform.physical(np.array([z]))[0])  # noqa: E731
    begin = (float(state.centre[first]), 0.0)
    way = sorted([begin, *(point for k in members for point in state.way[k])])
    ends: dict[int, float | None] = {-1: None, 1: None}
    for k in members:
        if np.isfinite(crossing[k]):
            ends[int(state.signs[k])] = physical(crossing[k])
    if limit:
        bound = float(transform.bound_beyond(np.array([limit]))[0])
        ends[limit] = bound if np.isfinite(bound) else None
    values, rises = tuple(physical(at) for at, _ in way), tuple(rise**2 for _, rise in way)
    return Profile(label, values, rises, ends[-1], ends[1], float(state.quantile[first]) ** 2)


LEAST_ERROR = 1e-12  # of data without noise: the interval is a point
FROM_END = 0.5  # first stride of a walk that begins at an end of the range, in z


def profiles_of(
    fits: Sequence[ComponentFit], confidence: float, tell: Callable[[int], None]
) -> list[dict[str, Profile]]:
    """Profiles of each scalar parameter of a likelihood; `tell` hears how many fits are done."""
    curves: list[dict[str, Profile]] = [{} for _ in fits]
    requested = {k: _requested(fit, confidence) for k, fit in enumerate(fits)}
    tasks = {k: task for k, task in requested.items() if task is not None}
    order, done = list(tasks), 0
    for members in alike([task.problem for task in tasks.values()]):
        places = [order[i] for i in members]
        heard = lambda count, done=done: tell(done + count)  # noqa: E731
        tables = profiles([tasks[k] for k in places], heard)
        done += len(places)
        for k, table in zip(places, tables, strict=True):
            curves[k] = table
    return curves


def _requested(fit: ComponentFit, confidence: float) -> ProfileTask | None:
    """Parameters of a fit to be profiled; None if there are none."""
    stage = fit.stages[0]
    if not (fit.has_intervals and stage.ends.converged[0] and len(stage.problem.active)):
        return None
    problem, known = stage.problem, fit.uncertainty
    variance = _variance(fit)
    if variance is None:
        return None
    errors = known.errors[problem.active]
    bound_side = known.bound_side[problem.active]
    errors = np.where(bound_side != 0, FROM_END, errors)
    # a number of a network, or the error of the drag coefficient, which has a Gaussian prior, is no
    # parameter of whose profile anybody makes use
    names = [problem.elements[k].name for k in problem.active]
    unread = np.array(["[" in name or name == DRAG for name in names])
    profiled = (errors > LEAST_ERROR) & ~known.undetermined[problem.active] & ~unread
    columns = np.flatnonzero(profiled)
    degrees = np.where(bound_side != 0, _noise_dof(fit), known.parameter_dof[problem.active])[
        columns
    ]
    reach = (
        np.atleast_1d(quantile(confidence, degrees)) * known.se_inflation[problem.active[columns]]
    )
    if not len(columns):
        return None
    few = binned(problem, fit.z)
    return ProfileTask(
        few,
        fit.z,
        fit.reference_start,
        variance,
        columns,
        errors[columns],
        bound_side[columns],
        reach,
    )


def _noise_dof(fit: ComponentFit) -> float:
    """Degrees of freedom of the noise: of what has no standard error of its own."""
    if all(errors.is_stated for errors in fit.stages[0].problem.errors):
        return np.inf
    return float(np.min(fit.uncertainty.residual_dof))


def _variance(fit: ComponentFit) -> float | None:
    """Variance of a weighted residual; None if data sets differ in it, or have no noise."""
    weighted = weighted_deviation(fit, fit.stages[0].problem)
    if np.ptp(weighted) > 1e-9 * np.max(weighted) or not np.max(weighted) > 0:
        return None
    return float(np.max(weighted)) ** 2


def weighted_deviation(fit: ComponentFit, problem: Problem, least: float = 0.0) -> np.ndarray:
    """Standard deviation of each weighted residual of a stage's points; `least` of each value."""
    if not problem.is_fixed:
        return np.ones(problem.count)
    weight = np.sqrt(problem.points.copies / problem.diagonal(fit.z[None])[0])
    return np.maximum(fit.uncertainty.deviation, least) * weight
