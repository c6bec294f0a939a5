"""Values, standard errors and intervals of what was searched, in physical units."""

from collections.abc import Callable, Hashable, Sequence
from dataclasses import replace

import numpy as np

from calibration.fitting.alike import structure
from calibration.fitting.component_fit import ComponentFit
from calibration.fitting.estimate import Estimate
from calibration.fitting.neighbours import pooled_about
from calibration.fitting.problem import Problem
from calibration.fitting.profiles import FARTHEST, Asked, Profile, joined, profiles
from calibration.fitting.transform import NONE
from calibration.fitting.uncertainty import asks_for_curvature, quantile

LEAST_ERROR = 1e-12  # of data without noise: the interval is a point
SIDE_BY_SIDE = 100  # fits whose profiles are one batch: progress is told between batches
SKEWED = 1 / 8  # of an interval's width, see `is_skewed`
BEND_STEP = 0.1  # in standard errors, of the third derivative
FROM_END = 0.5  # first stride of a walk that begins at an end of the range, in z


def profiles_of(
    fits: Sequence[ComponentFit], confidence: float, tell: Callable[[int], None]
) -> list[dict[str, Profile]]:
    """Of each single-number parameter, where there is a likelihood: of `model`, and of Eq. (17)'s step.

    χ̃ of `two-step` has none. Fits whose problems are alike go side by side; `tell` hears how many
    are done.
    """
    alike: dict[Hashable, list[tuple[int, Asked]]] = {}
    curves: list[dict[str, Profile]] = [{} for _ in fits]
    for k, fit in enumerate(fits):
        asked = _asked(fit, confidence)
        if asked is None:
            continue
        if fit.stages[0].branches is None:
            alike.setdefault(structure(asked.problem), []).append((k, asked))
        else:
            curves[k] = _along_branches(fit, asked)
    done = len(fits) - sum(map(len, alike.values()))
    for members in alike.values():
        for first in range(0, len(members), SIDE_BY_SIDE):
            tell(done)
            places, some = zip(*members[first : first + SIDE_BY_SIDE], strict=True)
            for k, found in zip(places, profiles(some), strict=True):
                curves[k] = found
            done += len(some)
    return curves


def _along_branches(fit: ComponentFit, asked: Asked) -> dict[str, Profile]:
    """Where ε jumps at yield: the lowest Δχ² of all branches that come near enough to the best."""
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


def _asked(fit: ComponentFit, confidence: float) -> Asked | None:
    """What is to be profiled of a fit; None where nothing is."""
    stage = fit.stages[0]
    if not stage.found.converged[0] or not len(stage.problem.active):
        return None
    problem, known = stage.problem, fit.uncertainty
    variance = _variance(fit)
    if variance is None:
        return None
    errors = known.errors[0, problem.active]
    limits = known.limits[0, problem.active]
    errors = np.where(limits != 0, FROM_END, errors)
    entry = np.array(["[" in problem.elements[k].name for k in problem.active])
    wanted = (errors > LEAST_ERROR) & ~known.undetermined[0, problem.active] & ~entry
    columns = np.flatnonzero(wanted)
    degrees = np.where(limits != 0, _left(fit), known.degrees[0, problem.active])[columns]
    reach = np.atleast_1d(quantile(confidence, degrees)) * known.widened[0, problem.active[columns]]
    few = pooled_about(problem, fit.z, known.errors[0, problem.active])
    return Asked(few, fit.z, fit.begun, variance, columns, errors[columns], limits[columns], reach)


def _left(fit: ComponentFit) -> float:
    """Degrees of freedom of the noise: of what has no standard error of its own."""
    if all(one.is_stated for one in fit.stages[0].problem.errors):
        return np.inf
    return float(np.min(fit.uncertainty.noise.left[0]))


def _variance(fit: ComponentFit) -> float | None:
    """Of a weighted residual; None where data sets differ in it, or have no noise."""
    weighted = weighted_deviation(fit, fit.stages[0].problem)
    if np.ptp(weighted) > 1e-9 * np.max(weighted) or not np.max(weighted) > 0:
        return None
    return float(np.max(weighted)) ** 2


def weighted_deviation(fit: ComponentFit, problem: Problem) -> np.ndarray:
    """Standard deviation of each weighted residual of a stage's points."""
    if not problem.is_fixed:
        return np.ones(problem.count)
    return fit.uncertainty.noise.deviation[0] * problem.points.weight


def estimates(
    fit: ComponentFit, curves: dict[str, Profile], confidence: float
) -> dict[int, Estimate]:
    """Of each element of the component."""
    bends = None if curves or not fit.is_likelihood else third_derivatives(fit)
    found = {}
    for k, e in enumerate(fit.component.elements):
        one = estimate_of(fit, k, curves.get(e.label), confidence)
        if one.method == "wald" and one.standard_error is not None and "[" not in e.name:
            one = replace(one, skewed=_is_skewed_by(fit, k, one, confidence, bends))
        found[k] = one
    return found


def third_derivatives(fit: ComponentFit) -> np.ndarray | None:
    """Of -ln p along the direction in which the others follow each element, in standard errors.

    That of the profile likelihood is the same. From the exact gradient on both sides; None where second
    derivatives were not taken either.
    """
    problem, known = fit.final.problem, fit.uncertainty
    if not known.definite[0] or not asks_for_curvature(problem, 1):
        return None
    bends = np.zeros(len(fit.z))
    covariance = np.nan_to_num(known.covariance[0])
    every = [k for k in problem.active if known.known[0, k] and covariance[k, k] > 0]
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
    q = float(quantile(confidence, fit.uncertainty.degrees[0, k]))
    shift = -bends[k] * q**2 / 6
    transform = fit.final.problem.transform.part(np.array([k]))
    error = float(fit.uncertainty.errors[0, k])
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
    if known.limits[0, k]:
        return _at_an_end(fit, k, curve)
    if known.undetermined[0, k]:
        return Estimate(value, method="undetermined", free=True)
    transform = fit.final.problem.transform.part(np.array([k]))
    z_error = float(known.errors[0, k])
    slope = float(abs(transform.slope(fit.z[k : k + 1])[0]))
    error = slope * z_error if known.definite[0] else None
    if curve is not None:
        q = float(quantile(confidence, known.degrees[0, k]))
        skewed = error is not None and is_skewed(value, error, curve.low, curve.high, q)
        return Estimate(value, error, curve.low, curve.high, "profile", True, False, skewed)
    reach = quantile(confidence, known.degrees[0, k]) * z_error
    ends: list[float | None] = []
    for sign in (-1, 1):
        told = transform.kind[0] == NONE or reach < FARTHEST
        end = transform.physical(fit.z[k : k + 1] + sign * reach)[0]
        ends.append(float(end) if told else None)
    method = "wald" if fit.is_likelihood else "sandwich"
    return Estimate(value, error, ends[0], ends[1], method, True)


def _at_an_end(fit: ComponentFit, k: int, curve: Profile | None) -> Estimate:
    """At a bound, with a one-sided interval where there is a profile; or grown without bound."""
    limit = fit.uncertainty.limits[0, k]
    bound = float(fit.final.problem.transform.bound_beyond(limit)[k])
    low, high = (None, None) if curve is None else (curve.low, curve.high)
    method = "undetermined" if curve is None else "profile"
    if not np.isfinite(bound):
        return Estimate(None, None, low, high, method, True)
    return Estimate(bound, None, low, high, method, True, True)
