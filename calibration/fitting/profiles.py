"""Profile likelihoods, and the values, standard errors and intervals of what was searched.

A profile is how far one parameter can go while the others make up for it. All walks, two for each
parameter, go side by side, those of data sets that are alike together: each stride is one batch of
refits."""

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from calibration.fitting.batches import Alike, pooled_about, structure
from calibration.fitting.material import Estimate
from calibration.fitting.problem import DRAG, Lanes, Problem
from calibration.fitting.search import FARTHEST as FURTHEST
from calibration.fitting.search import search
from calibration.fitting.stages import ComponentFit
from calibration.fitting.steps import condense
from calibration.fitting.uncertainty import asks_for_curvature, quantile
from calibration.parameters import LOGIT, NONE
from calibration.schema import Real

FARTHEST = 12.0  # in z from the estimate (factors of e): beyond, an interval is open
STRIDE = 0.25  # in log units: where parameters make up for each other the way is curved
EASY = 3  # steps of a refit up to which the next stride may be longer: the way is straight
STEPS = 100  # of one refit
POINTS = 6.0  # strides up to the limit, about
BEYOND = 1.15  # of the way to the limit that is looked at, for the picture
TOLERANCE = 1e-7  # of the limit, in z, or of √Δχ² there
MOST_STRIDES = 400
ROUNDING = 1e-12  # of a way
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
    values: tuple[Real, ...]
    delta_chi_squared: tuple[Real, ...]
    low: float | None
    high: float | None
    threshold: float

    def at(self, value: float) -> float:
        """Δχ² between the values that were looked at; infinite beyond them."""
        rises = self.delta_chi_squared
        return float(np.interp(value, self.values, rises, left=np.inf, right=np.inf))


class Asked(NamedTuple):
    """Request for the profiles of one fit."""

    problem: Problem  # where it ended, as `search` takes it
    z: Float[np.ndarray, "elements"]
    begun: Float[np.ndarray, "elements"]
    variance: float  # of a weighted residual
    columns: Int[np.ndarray, "some"]  # which of the active elements
    errors: Float[np.ndarray, "some"]  # their standard errors in z
    # +1 or -1 for those held at an end of their range: only the other way is gone
    limits: Int[np.ndarray, "some"]
    quantiles: Float[np.ndarray, "some"]  # √Δχ² at the limits of each
    lowest: float | None = None  # twice the cost from which Δχ² counts; None: that at z


class _Walks:
    """√Δχ² of refits along the walks of fits whose problems are alike, in lockstep.

    Of each walk: of which fit it is (`member`), along which of the active elements (`columns`) and
    which way (`signs`) in z, about one standard error (`steps`), and √Δχ² at the limit (`quantile`).
    """

    def __init__(self, asked: Sequence[Asked]):
        self.problem = problem = Alike.of([one.problem for one in asked])
        walks = [
            (member, column, sign, error, quantile, limit != 0)
            for member, one in enumerate(asked)
            for column, error, quantile, limit in zip(
                one.columns, one.errors, one.quantiles, one.limits, strict=True
            )
            for sign in (-1, 1)
            if sign != limit
        ]
        told = (np.array(part) for part in zip(*walks, strict=True))
        self.member, self.columns, self.signs, self.steps, self.quantile, from_end = told
        self.begun = np.array([asked[k].begun for k in self.member])
        self.variance = np.array([asked[k].variance for k in self.member])
        self.z = np.array([asked[k].z for k in self.member])
        every = np.arange(len(walks))
        self.positions = problem.active[self.columns]
        self.held = np.zeros((len(walks), len(problem.active)), bool)
        self.held[every, self.columns] = True
        self.scaled = problem.transform.kind[self.positions] != NONE
        self.centre = self.z[every, self.positions]
        begin = problem.linearise(self.z, self._lanes(every), slopes=False)
        lowest = [asked[k].lowest for k in self.member]
        at_z = 2 * begin.cost
        self.lowest = np.array([b if a is None else a for a, b in zip(lowest, at_z, strict=True)])
        self.begin = self._rise(0.5 * at_z, np.arange(len(walks)))
        self.edge = self._edges()
        reach = np.where(from_end, FURTHEST + FARTHEST, FARTHEST)
        # a search that began at an end is farther off: the middle of two bounds is z = 0
        bounded = from_end & (problem.transform.kind[self.positions] == LOGIT)
        reach = np.where(bounded, np.maximum(reach, np.abs(self.centre) + FARTHEST), reach)
        reach = np.where(self.scaled, reach, 100 * self.steps)
        self.reach = np.minimum(reach, np.abs(self.edge - self.centre))
        self.way: list[list[tuple[float, float]]] = [[] for _ in walks]

    def _edges(self) -> Float[np.ndarray, "walks"]:
        """Values at which points would leave their branches, beyond which another profile continues."""
        if self.problem.within is None:
            return self.signs * np.inf
        lower, upper = self.problem.within
        return np.where(self.signs < 0, lower[self.positions], upper[self.positions])

    def _lanes(self, which) -> Lanes:
        return Lanes(member=self.member[which])

    def refit(self, at: Float[np.ndarray, "some"], which: Int[np.ndarray, "some"], doubted=None):
        """Everything else refitted with the parameters there: z of each, √Δχ², and steps taken.

        Args:
            doubted: √Δχ² above which a search may have gone astray, and is made again from where the
                walk is; None: the limit.
        """
        found = self._search(self._foreseen(at, which), which)
        z, rise = found.z, self._rise(found.cost, which)
        most = self.quantile[which] if doubted is None else doubted
        poor = np.flatnonzero(~found.converged | (rise > most))
        if len(poor):
            plain = self.z[which[poor]]
            plain[np.arange(len(poor)), self.positions[which[poor]]] = at[poor]
            again = self._search(plain, which[poor])
            lower = again.cost < found.cost[poor]
            z[poor[lower]] = again.z[lower]
            rise[poor[lower]] = self._rise(again.cost, which[poor])[lower]
        return z, rise, found.iterations

    def _rise(self, cost: Float[np.ndarray, "some"], which) -> Float[np.ndarray, "some"]:
        """√Δχ²."""
        above = np.maximum(2 * cost - self.lowest[which], 0.0)
        rise = np.sqrt(above / self.variance[which])
        return np.where(np.isfinite(rise), rise, 1e6)

    def _search(self, start, which):
        """The others searched, from some start."""
        begun, held, lanes = self.begun[which], self.held[which], self._lanes(which)
        return search(self.problem, start, begun=begun, held=held, lanes=lanes, limit=STEPS)

    def _foreseen(self, at, which) -> np.ndarray:
        """First-order change of the other parameters when the profiled ones move."""
        z = self.z[which]
        rows = np.arange(len(which))
        move = at - z[rows, self.positions[which]]
        found = self.problem.linearise(z, self._lanes(which))
        # the column that moves stands in for the residual: its answer is the others' least squares
        moving = found.jacobian[rows, :, self.columns[which]]
        begun = np.where(np.isnan(self.begun[which]), z, self.begun[which])
        at_an_end = np.abs(z - begun)[:, self.problem.active] > 0.9 * FURTHEST
        answer = condense(moving, found.jacobian, self.held[which] | at_an_end).newton
        scaled = self.problem.transform.kind[self.problem.active] != NONE
        answer = answer * move[:, None]
        limited = np.clip(answer, -LARGEST_ANSWER, LARGEST_ANSWER)
        z[:, self.problem.active] += np.where(scaled, limited, answer)
        z[rows, self.positions[which]] = at
        return z

    def run(self) -> Float[np.ndarray, "walks"]:
        """Value where each walk crosses the quantile, NaN if it does not; `way` is the path."""
        count = len(self.way)
        stride = np.where(self.scaled, np.minimum(self.steps, STRIDE), self.steps)
        inside, rise = np.array(self.centre), np.zeros(count)
        outside, above = np.full((2, count), np.nan)
        going = np.ones(count, bool)
        for _ in range(MOST_STRIDES):
            which = np.flatnonzero(going)
            if not len(which):
                break
            left = self.reach[which] - np.abs(inside[which] - self.centre[which])
            at = inside[which] + self.signs[which] * np.minimum(stride[which], left)
            z, new, steps = self.refit(at, which)
            self._saw(which, at, new)
            over = new >= self.quantile[which]
            outside[which[over]], above[which[over]] = at[over], new[over]
            self.z[which[~over]] = z[~over]
            grown = np.maximum(new - rise[which], 1e-3)
            better = stride[which] * np.clip(self.quantile[which] / POINTS / grown, 0.5, 2.0)
            limit = np.where(self.scaled[which] & (steps > EASY), STRIDE, np.inf)
            stride[which] = np.minimum(better, limit)
            inside[which[~over]], rise[which[~over]] = at[~over], new[~over]
            gone = np.abs(at - self.centre[which]) >= self.reach[which] * (1 - ROUNDING)
            going[which[over | gone]] = False
        crossing = self._cross(inside, outside, rise - self.quantile, above - self.quantile)
        self._beyond(crossing)
        return crossing

    def _saw(self, which, at, rise) -> None:
        for k, place, value in zip(which, at, rise, strict=True):
            self.way[k].append((float(place), float(value)))

    def _cross(self, inside, outside, below, above) -> np.ndarray:
        """The crossing between two places of each walk, by the Illinois method; NaN without.

        Args:
            below, above: √Δχ² there less the quantile.
        """
        ends = np.array([inside, outside, below, above, np.zeros(len(inside))])
        crossing = np.array(outside)
        open_ = np.flatnonzero(np.isfinite(outside))
        for _ in range(MOST_HALVINGS):
            if not len(open_):
                break
            low, high, f_low, f_high, side = ends[:, open_]
            between = np.clip(f_low / (f_low - f_high), 0.0, 1.0)
            middle = low + np.where(np.isfinite(between), between, 0.5) * (high - low)
            z, rise, _ = self.refit(middle, open_, f_high + self.quantile[open_])
            self._saw(open_, middle, rise)  # strides may be long: a picture needs these
            f_middle = rise - self.quantile[open_]
            up = f_middle > 0
            self.z[open_[~up]] = z[~up]
            f_low = np.where(up & (side > 0), 0.5 * f_low, f_low)
            f_high = np.where(~up & (side < 0), 0.5 * f_high, f_high)
            high, f_high = np.where(up, middle, high), np.where(up, f_middle, f_high)
            low, f_low = np.where(up, low, middle), np.where(up, f_low, f_middle)
            ends[:, open_] = low, high, f_low, f_high, np.where(up, 1.0, -1.0)
            crossing[open_] = middle
            done = (np.abs(high - low) <= TOLERANCE) | (np.abs(f_middle) <= TOLERANCE)
            open_ = open_[~done]
        return crossing

    def _beyond(self, crossing) -> None:
        """One look beyond each limit, for the picture."""
        which = np.flatnonzero(np.isfinite(crossing))
        if len(which):
            at = self.centre[which] + BEYOND * (crossing[which] - self.centre[which])
            self._saw(which, at, self.refit(at, which)[1])


def profiles(asked: Sequence[Asked]) -> list[dict[str, Profile]]:
    """Profiles of some elements of fits whose problems are alike, by their labels."""
    if not any(len(one.columns) for one in asked):
        return [{} for _ in asked]
    state = _Walks(asked)
    crossing = state.run()
    of_member: list[dict[str, Profile]] = []
    for member, one in enumerate(asked):
        own = np.flatnonzero(state.member == member)
        found = {}
        for column, limit in zip(one.columns, one.limits, strict=True):
            label = one.problem.elements[one.problem.active[column]].label
            members = own[state.columns[own] == column]
            found[label] = _profile(state, label, members, crossing, int(limit))
        of_member.append(found)
    return of_member


def joined(curves: Sequence[Profile]) -> Profile:
    """Profiles of one parameter that begin at several minima as one: the lowest Δχ² of all counts."""
    ways = sorted(
        (value, rise)
        for own in curves
        for value, rise in zip(own.values, own.delta_chi_squared, strict=True)
        if all(rise <= other.at(value) for other in curves if other is not own)
    )
    lows = [c.low for c in curves if c.low is not None]
    highs = [c.high for c in curves if c.high is not None]
    return Profile(
        curves[0].parameter,
        tuple(value for value, _ in ways),
        tuple(rise for _, rise in ways),
        min(lows) if len(lows) == len(curves) else None,
        max(highs) if len(highs) == len(curves) else None,
        curves[0].threshold,
    )


def _profile(state: _Walks, label: str, members, crossing, limit: int) -> Profile:
    """Both sides of the profile of one parameter, in physical units."""
    position = int(state.positions[members[0]])
    transform = state.problem.transform.part(np.array([position]))
    physical = lambda z: float(transform.physical(np.array([z]))[0])  # noqa: E731
    first = int(members[0])
    begin = (float(state.centre[first]), float(state.begin[first]))
    way = [begin, *(one for k in members for one in state.way[k])]
    way.sort()
    ends: dict[int, float | None] = {-1: None, 1: None}
    at = np.where(np.isfinite(crossing), crossing, state.edge)
    for k in members:
        if np.isfinite(at[k]):
            ends[int(state.signs[k])] = physical(at[k])
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


LEAST_ERROR = 1e-12  # of data without noise: the interval is a point
SIDE_BY_SIDE = 100  # fits whose profiles are one batch: progress is reported between batches
SKEWED = 1 / 8  # of an interval's width, see `is_skewed`
BEND_STEP = 0.1  # in standard errors, of the third derivative
FROM_END = 0.5  # first stride of a walk that begins at an end of the range, in z


def profiles_of(
    fits: Sequence[ComponentFit], confidence: float, tell: Callable[[int], None]
) -> list[dict[str, Profile]]:
    """Profiles of each scalar parameter that has a likelihood: of `model`, and of the step by Eq. (17).

    χ̃ of `two-step` has none. Fits whose problems are alike go side by side; `tell` hears how many
    are done.
    """
    alike: dict[Hashable, list[tuple[int, Asked]]] = {}
    curves: list[dict[str, Profile]] = [{} for _ in fits]
    for k, fit in enumerate(fits):
        asked = _requested(fit, confidence)
        if asked is None:
            continue
        if fit.stages[0].branches is None:
            alike.setdefault(structure(asked.problem), []).append((k, asked))
        else:
            curves[k] = _profiles_of_branches(fit, asked)
    done = len(fits) - sum(map(len, alike.values()))
    for members in alike.values():
        for first in range(0, len(members), SIDE_BY_SIDE):
            tell(done)
            places, some = zip(*members[first : first + SIDE_BY_SIDE], strict=True)
            for k, found in zip(places, profiles(some), strict=True):
                curves[k] = found
            done += len(some)
    return curves


def _profiles_of_branches(fit: ComponentFit, asked: Asked) -> dict[str, Profile]:
    """Profiles where ε jumps at yield: the lowest Δχ² of all branches that come near the best."""
    (stage,), branches = fit.stages[:1], fit.stages[0].branches
    assert branches is not None
    cost = float(stage.found.cost[0])
    near = np.max(asked.quantiles, initial=0.0) ** 2 * asked.variance
    found = [profiles([asked._replace(lowest=2 * cost)])[0]]
    own = np.all(branches.elastic == stage.problem.elastic, axis=1)
    for k in np.flatnonzero(~own & (2 * (branches.cost - cost) < near)):
        limits = branches.limits[k][asked.columns]
        errors = np.where(limits != 0, FROM_END, asked.errors)
        problem = branches.problem(stage.problem, int(k))
        told = {"problem": problem, "z": branches.z[k], "limits": limits, "errors": errors}
        found += profiles([asked._replace(**told, lowest=2 * cost)])
    return {label: joined([curves[label] for curves in found]) for label in found[0]}


def _requested(fit: ComponentFit, confidence: float) -> Asked | None:
    """Parameters of a fit to be profiled; None if there are none."""
    stage = fit.stages[0]
    if not stage.found.converged[0] or not len(stage.problem.active):
        return None
    problem, known = stage.problem, fit.uncertainty
    variance = _variance(fit)
    if variance is None:
        return None
    errors = known.errors[problem.active]
    limits = known.limits[problem.active]
    errors = np.where(limits != 0, FROM_END, errors)
    # a number of a network, or the error of the drag coefficient, which has a Gaussian prior, is no
    # parameter of whose profile anybody makes use
    names = [problem.elements[k].name for k in problem.active]
    unread = np.array(["[" in name or name == DRAG for name in names])
    wanted = (errors > LEAST_ERROR) & ~known.undetermined[problem.active] & ~unread
    columns = np.flatnonzero(wanted)
    degrees = np.where(limits != 0, _left(fit), known.degrees[problem.active])[columns]
    reach = np.atleast_1d(quantile(confidence, degrees)) * known.widened[problem.active[columns]]
    few = pooled_about(problem, fit.z, known.errors[problem.active])
    return Asked(few, fit.z, fit.begun, variance, columns, errors[columns], limits[columns], reach)


def _left(fit: ComponentFit) -> float:
    """Degrees of freedom of the noise: of what has no standard error of its own."""
    if all(one.is_stated for one in fit.stages[0].problem.errors):
        return np.inf
    return float(np.min(fit.uncertainty.left))


def _variance(fit: ComponentFit) -> float | None:
    """Variance of a weighted residual; None if data sets differ in it, or have no noise."""
    weighted = weighted_deviation(fit, fit.stages[0].problem)
    if np.ptp(weighted) > 1e-9 * np.max(weighted) or not np.max(weighted) > 0:
        return None
    return float(np.max(weighted)) ** 2


def weighted_deviation(fit: ComponentFit, problem: Problem) -> np.ndarray:
    """Standard deviation of each weighted residual of a stage's points."""
    if not problem.is_fixed:
        return np.ones(problem.count)
    return fit.uncertainty.deviation * problem.points.weight


def estimates(
    fit: ComponentFit, curves: dict[str, Profile], confidence: float
) -> dict[int, Estimate]:
    """Estimates of each element of the component."""
    bends = None if curves or not fit.is_likelihood else third_derivatives(fit)
    found = {}
    for k, e in enumerate(fit.component.elements):
        one = estimate_of(fit, k, curves.get(e.label), confidence)
        is_read = "[" not in e.name and e.name != DRAG
        if one.method == "wald" and one.standard_error is not None and is_read:
            one = replace(one, skewed=_is_skewed_by(fit, k, one, confidence, bends))
        found[k] = one
    return found


def third_derivatives(fit: ComponentFit) -> np.ndarray | None:
    """Third derivative of -ln p along each element while the others follow, in standard errors.

    That of the profile likelihood is the same. From the exact gradient on both sides; None where second
    derivatives were not taken either.
    """
    problem, known = fit.final.problem, fit.uncertainty
    if not known.definite or not asks_for_curvature(problem):
        return None
    bends = np.zeros(len(fit.z))
    covariance = np.nan_to_num(known.covariance)
    every = [k for k in problem.active if known.known[k] and covariance[k, k] > 0]
    if not every:
        return bends
    ways = covariance[every] / np.sqrt(np.diag(covariance)[every])[:, None]
    places = fit.z + BEND_STEP * np.concatenate([ways, -ways])
    found = problem.linearise(places)
    gradient = np.einsum("fmp,fm->fp", found.jacobian, found.residual)
    along = np.einsum("fp,fp->f", gradient, np.tile(ways[:, problem.active], (2, 1)))
    bends[every] = along.reshape(2, -1).sum(axis=0) / BEND_STEP**2
    return bends


def _is_skewed_by(
    fit: ComponentFit, k: int, one: Estimate, confidence: float, bends
) -> bool | None:
    """Judged by the third derivative: where ends of the profile would lie, to first order in it."""
    if bends is None:
        return None
    q = float(quantile(confidence, fit.uncertainty.degrees[k]))
    shift = -bends[k] * q**2 / 6
    transform = fit.final.problem.transform.part(np.array([k]))
    error = float(fit.uncertainty.errors[k])
    ends = transform.physical(fit.z[k] + error * np.array([[shift - q], [shift + q]]))[:, 0]
    low, high = sorted(map(float, ends))
    return is_skewed(one.value, one.standard_error, low, high, q)


def is_skewed(value, error, low: float | None, high: float | None, quantile: float) -> bool:
    """Whether an end of an interval is an eighth of its width from value ± quantile · error."""
    if low is None or high is None:
        return True
    apart = max(abs(low - (value - quantile * error)), abs(high - (value + quantile * error)))
    return bool(apart > SKEWED * (high - low))


def estimate_of(fit: ComponentFit, k: int, curve: Profile | None, confidence: float) -> Estimate:
    """Value, standard error and interval: the profile's where there is one."""
    known, value = fit.uncertainty, float(fit.theta[k])
    if known.limits[k]:
        return _at_an_end(fit, k, curve)
    if known.undetermined[k]:
        return Estimate(value, method="undetermined", free=True)
    transform = fit.final.problem.transform.part(np.array([k]))
    z_error = float(known.errors[k])
    slope = float(abs(transform.slope(fit.z[k : k + 1])[0]))
    error = slope * z_error if known.definite else None
    if curve is not None:
        q = float(quantile(confidence, known.degrees[k]))
        skewed = error is not None and is_skewed(value, error, curve.low, curve.high, q)
        return Estimate(value, error, curve.low, curve.high, "profile", True, False, skewed)
    reach = quantile(confidence, known.degrees[k]) * z_error
    ends: list[float | None] = []
    for sign in (-1, 1):
        told = transform.kind[0] == NONE or reach < FARTHEST
        end = transform.physical(fit.z[k : k + 1] + sign * reach)[0]
        ends.append(float(end) if told else None)
    method = "wald" if fit.is_likelihood else "sandwich"
    return Estimate(value, error, ends[0], ends[1], method, True)


def _at_an_end(fit: ComponentFit, k: int, curve: Profile | None) -> Estimate:
    """Estimate at a bound, with a one-sided interval if there is a profile; or one that grew without bound."""
    limit = fit.uncertainty.limits[k]
    bound = float(fit.final.problem.transform.bound_beyond(limit)[k])
    low, high = (None, None) if curve is None else (curve.low, curve.high)
    method = "undetermined" if curve is None else "profile"
    if not np.isfinite(bound):
        return Estimate(None, None, low, high, method, True)
    return Estimate(bound, None, low, high, method, True, True)
