"""Many fits of one problem side by side: to simulated data, and without each point or group."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from calibration.fitting.errors import log_density
from calibration.fitting.problem import AT_ONCE, Lanes, Problem
from calibration.fitting.search import Found, search
from calibration.fitting.stages import ComponentFit
from calibration.fitting.uncertainty import Settled
from calibration.fitting.variances import (
    estimated,
    needs_variances,
    relative_covariance,
    variances_at,
)

STEPS = 200  # of one refit
ROUNDS = 12  # in which a refit and its variances settle
SETTLED = 1e-6  # change of z from round to round


def settled(
    problems: Iterable[Problem], z: Float[np.ndarray, "fits p"], lanes: Lanes | None = None
) -> tuple[Float[np.ndarray, "fits p"], list[Settled], Bool[np.ndarray, "fits"], Lanes]:
    """Searches of one stage after the other from z, the noise of each fit its own.

    Returns:
        Where they end, the stages, which arrived, and the lanes with the variances of each fit.
    """
    arrived, stages, lanes = np.ones(len(z), bool), [], lanes or Lanes()
    for problem in problems:
        found, lanes = with_own_noise(problem, z, lanes)
        z, arrived = found.z, arrived & found.converged
        stages.append(Settled(problem, found.limits))
    return z, stages, arrived, lanes


def with_own_noise(problem: Problem, z, lanes: Lanes, begun=None) -> tuple[Found, Lanes]:
    """Searches from z, each with the variances that its own residuals tell."""
    found = search(problem, z, begun=begun, lanes=lanes, limit=STEPS)
    if not needs_variances(problem) or not any(one.unknown for one in problem.errors):
        return found, lanes
    for _ in range(ROUNDS):
        variances = variances_at(problem, found.z, lanes)
        lanes = lanes._replace(variances=variances)
        if problem.is_fixed:
            kept = 1.0 if lanes.weight is None else lanes.weight > 0
            lanes = lanes._replace(weight=kept * problem.diagonal(found.z, lanes) ** -0.5)
        again = search(problem, found.z, begun=found.begun, lanes=lanes, limit=STEPS, releases=0)
        moved = float(np.max(np.abs(again.z - found.z), initial=0.0))
        found = again
        if moved <= SETTLED:
            break
    return found, lanes


@dataclass(frozen=True)
class Bootstrap:
    """Fits of simulated data.

    Attributes:
        names: of the free parameters.
        values: physical, (fits, p).
        converged: which fits arrived, (fits,).
        intervals: percentile limits by name.
    """

    names: tuple[str, ...]
    values: Float[np.ndarray, "fits p"]
    converged: Bool[np.ndarray, "fits"]
    intervals: dict[str, tuple[float, float]]


def bootstrap(fits: list[ComponentFit], count: int, seed: int, confidence: float) -> Bootstrap:
    """Simulate each point with the fitted curve and its noise, and fit that again, the noise as well."""
    random = np.random.default_rng(seed)
    drawn = [_simulated(fit, count, random) for fit in fits]
    found = [_refitted(fit, data) for fit, data in zip(fits, drawn, strict=True)]
    every, arrived = zip(*found, strict=True)
    values, converged = np.concatenate(every, axis=1), np.all(arrived, axis=0)
    names = [e.label for fit in fits for e in fit.component.elements]
    part = 100 * np.array([0.5 * (1 - confidence), 0.5 * (1 + confidence)])
    ends = (
        np.percentile(values[converged], part, axis=0)
        if np.any(converged)
        else np.full((2, len(names)), np.nan)
    )
    intervals = {n: (float(a), float(b)) for n, a, b in zip(names, *ends, strict=True)}
    return Bootstrap(tuple(names), values, converged, intervals)


def _simulated(fit: ComponentFit, count: int, random) -> Float[np.ndarray, "count n"]:
    """Data around the curve of the first stage."""
    first = fit.stages[0].problem
    parts = [
        carried.mean + errors.simulate(s, carried, random, count)
        for errors, s, carried in zip(
            first.errors, first.variances, first.carried(fit.z[None]), strict=True
        )
    ]
    return np.maximum(np.concatenate(parts, axis=1), 0.0)


def _refitted(fit: ComponentFit, drawn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Physical values of fits to such data, and which of them arrived."""
    z, converged = np.repeat(fit.z[None], len(drawn), axis=0), np.ones(len(drawn), bool)
    for stage in fit.stages:
        begun = np.broadcast_to(fit.begun, z.shape)
        found, _ = with_own_noise(stage.problem, z, Lanes(value=drawn), begun)
        z, converged = found.z, converged & found.converged
    return fit.final.problem.transform.physical(z), converged


EXACT = 1_000_000  # impacts up to which every point is left out by a refit
EXACT_BY_TIME = 20_000  # the same where every impact is integrated over time
SEEN = 1e-9  # singular values below that of the largest are none


@dataclass(frozen=True)
class LeaveOneOut:
    """Each point predicted by the fit without it.

    Where data have groups all of a group is left out together. The density is that of the measured ε
    at the measured velocity.

    Attributes:
        predicted: ε, or another observable over its measured value, (n,), in the order of the data
            sets, in each that of `calibration.observables`.
        residual: predicted less measured.
        log_density: of each point under the prediction without it.
        pointwise: ln p of each point by the fit to all of them, given the others where points share
            errors: the terms of its likelihood.
        fold: points of equal number were left out together, 0, 1, 2, ...
        exact: whether refits were made; else the fit was continued to first order.
        converged: whether every refit arrived.
    """

    predicted: Float[np.ndarray, "n"]
    residual: Float[np.ndarray, "n"]
    log_density: Float[np.ndarray, "n"]
    pointwise: Float[np.ndarray, "n"]
    fold: Int[np.ndarray, "n"]
    exact: bool
    converged: bool

    @property
    def rms(self) -> float:
        """Root mean square of the residuals."""
        return float(np.sqrt(np.mean(self.residual**2)))

    @property
    def elpd(self) -> float:
        """Expected log predictive density: the sum over the points."""
        return float(np.sum(self.log_density))

    @property
    def elpd_se(self) -> float:
        """Its standard error."""
        return self.error_of_sum(self.log_density)

    def error_of_sum(self, values: Float[np.ndarray, "n"]) -> float:
        """Standard error of the sum of one number a point: √m times the scatter over m folds."""
        sums = np.bincount(self.fold, values)
        return float(np.sqrt(len(sums) * np.var(sums, ddof=1)))


def leave_one_out(fits: list[ComponentFit]) -> LeaveOneOut:
    """Of all components, in the order of the data sets.

    Raises:
        ValueError: for data of one group alone, without which nothing is left.
    """
    parts = [(fit, _left_out(fit)) for fit in fits]
    folds = np.cumsum([0, *(np.max(part.fold) + 1 for _, part in parts)])
    rows = [
        (g, replace(part, fold=part.fold + first), fit.final.problem.points.set == k)
        for (fit, part), first in zip(parts, folds[:-1], strict=True)
        for k, g in enumerate(fit.component.sets)
    ]
    ordered = sorted(rows, key=lambda row: row[0])

    def joined(name: str) -> np.ndarray:
        return np.concatenate([getattr(part, name)[own] for _, part, own in ordered])

    names = ("predicted", "residual", "log_density", "pointwise", "fold")
    columns: dict[str, Any] = {name: joined(name) for name in names}
    for name in ("exact", "converged"):
        columns[name] = all(getattr(part, name) for _, part in parts)
    return LeaveOneOut(**columns)


def _left_out(fit: ComponentFit) -> LeaveOneOut:
    problem, first = fit.final.problem, fit.stages[0].problem
    fold, shares = folds_of(first), any(one.shares for one in first.errors)
    most = EXACT_BY_TIME if fit.final.report.route == "ode" else EXACT
    whole = problem.count * (1 + np.max(fold)) <= most
    apart = all(e.group is not None for e in first.errors if e.shares)
    if not whole or not apart:
        return _continued(fit, fold)
    return _without_groups(fit, fold) if shares else _without_points(fit, fold)


def folds_of(problem: Problem) -> Int[np.ndarray, "n"]:
    """What is left out together: each point alone, or all of a group where the data have groups."""
    fold, first = np.empty(problem.count, int), 0
    for errors, rows in zip(problem.errors, problem.own, strict=True):
        own = np.arange(len(errors)) if errors.labels is None else errors.labels
        fold[rows] = first + own
        first += int(np.max(own)) + 1
    if first == 1:
        raise problem.datasets[0].refusal("one group", "two or more, as each is left out in turn")
    return fold


def _pointwise(fit: ComponentFit) -> Float[np.ndarray, "n"]:
    """ln p of each point by the likelihood of the fit."""
    first = fit.stages[0].problem
    curve = fit.final.problem.predict(fit.z[None])[0]
    off = curve - first.points.value
    every = zip(first.errors, first.variances, first.carried(fit.z[None]), first.own, strict=True)
    parts = [e.by_point(s, off[None, own], c.slope, c.bend)[0] for e, s, c, own in every]
    return np.concatenate(parts)


def _without_points(fit: ComponentFit, fold: np.ndarray) -> LeaveOneOut:
    """By refits, of points that share no errors; the noise is that of the points that are kept."""
    folds, problem = int(np.max(fold)) + 1, fit.final.problem
    z, converged = np.repeat(fit.z[None], folds, axis=0), np.ones(folds, bool)
    kept = (fold != np.arange(folds)[:, None]).astype(float)
    for stage in fit.stages:
        lanes = Lanes(weight=kept * stage.problem.points.weight)
        begun = np.broadcast_to(fit.begun, z.shape)
        found = search(stage.problem, z, begun=begun, lanes=lanes, limit=STEPS)
        z, converged = found.z, converged & found.converged
    predicted, density = np.empty((2, problem.count))
    known = np.log(problem.points.unit)
    most = max(1, AT_ONCE // problem.count)
    for some in np.split(np.arange(folds), np.arange(most, folds, most)):
        curve, scores = _scored(fit, z[some], kept[some])
        for k, number in enumerate(some):
            rows = fold == number
            predicted[rows], density[rows] = curve[k, rows], scores[k, rows] - known[rows]
    residual = predicted - problem.points.value
    whole = bool(np.all(converged))
    return LeaveOneOut(predicted, residual, density, _pointwise(fit), fold, True, whole)


def _scored(fit: ComponentFit, z: np.ndarray, kept: np.ndarray):
    """Predictions of refits, and densities of what each left out."""
    problem, first = fit.final.problem, fit.stages[0].problem
    found = problem.linearise(z)
    off = found.prediction - problem.points.value
    variance, degrees = np.empty((2, *off.shape))
    nus: list = []
    held = fit.uncertainty.limits[0, problem.active] != 0
    every = zip(first.errors, first.variances, first.seen(z), first.own, strict=True)
    for errors, s, seen, own in every:
        mask = np.where(np.any(kept[:, own] > 0, axis=1)[:, None], kept[:, own], 1.0)
        columns = found.jacobian[:, : problem.count][:, own] / problem.points.weight[own][:, None]
        raw = np.where(held, 0.0, seen.jacobian if problem is first else columns)
        seen = seen._replace(off=off[:, own], jacobian=raw, kept=mask)
        at = (seen.slope, seen.bend)
        if errors.unknown:
            s = estimated(errors, seen, True, s)
            relative = relative_covariance(errors, s, seen)
        total = errors.variance(s, *at) + np.zeros(off[:, own].shape)
        variance[:, own], degrees[:, own] = total, np.inf
        nus.append(errors.nu(s))
        if errors.unknown and not errors.is_stated and errors.dof is None:
            per = [
                errors.variance({**s, kind: 2 * s[kind]}, *at) - total for kind in errors.unknown
            ]
            spread = np.einsum("cfn,fcd,dfn->fn", per, relative, per)
            with np.errstate(divide="ignore"):
                degrees[:, own] = np.where(spread > 0, 2 * total**2 / spread, np.inf)
    weight = np.broadcast_to(problem.points.weight, off.shape)
    raw = _searched(fit, found.jacobian, weight)
    rows = raw[:, : problem.count]
    there = rows * (kept * variance**-0.5)[..., None]
    others = raw[:, problem.count :]
    information = np.swapaxes(there, 1, 2) @ there + np.swapaxes(others, 1, 2) @ others
    covariance = np.linalg.pinv(information, rcond=SEEN, hermitian=True)
    spread = variance + np.einsum("fnp,fpq,fnq->fn", rows, covariance, rows)
    if nus[0] is not None:
        wide = [n + np.zeros(off[:, own].shape) for n, own in zip(nus, first.own, strict=True)]
        return found.prediction, log_density(off, spread, np.concatenate(wide, axis=1))
    deviation = np.sqrt(spread)
    return found.prediction, student(off / deviation, degrees) - np.log(deviation)


def _searched(fit: ComponentFit, jacobian, weight) -> np.ndarray:
    """Slopes of ε and of the priors' rows, columns of unit length; 0 for what is held at an end."""
    problem = fit.final.problem
    if problem.is_fixed:
        safe = np.where(weight > 0, weight, 1.0)
        points = jacobian[:, : problem.count] / safe[..., None]
    else:
        variance = problem.diagonal(np.repeat(fit.z[None], len(jacobian), axis=0))
        points = jacobian[:, : problem.count] * np.sqrt(variance)[..., None]
    end = jacobian.shape[1] - problem.more
    rows = np.concatenate([points, jacobian[:, problem.count : end]], axis=1)
    held = fit.uncertainty.limits[0, problem.active] != 0
    size = np.linalg.norm(rows, axis=1, keepdims=True)
    return np.where(held, 0.0, rows / np.where(size > 0, size, 1.0))


def _without_groups(fit: ComponentFit, fold: np.ndarray) -> LeaveOneOut:
    """By refits without each group of points that share errors, under the variances of the fit."""
    problem, first = fit.final.problem, fit.stages[0].problem
    predicted, density, whole = np.empty(problem.count), np.empty(problem.count), True
    held = fit.uncertainty.limits[0, problem.active] != 0
    for number in range(int(np.max(fold)) + 1):
        rows, z = fold == number, fit.z[None]
        for stage in fit.stages:
            own = stage.problem.kept(~rows)
            found = search(own, z, begun=fit.begun[None], limit=STEPS)
            z, whole = found.z, whole and bool(found.converged[0])
        there = np.where(held, 0.0, own.linearise(z).jacobian[0])
        inverse = np.linalg.pinv(there.T @ there, rcond=SEEN**2, hermitian=True)
        left = replace(first.kept(rows), active=problem.active, laws=problem.kept(rows).laws)
        seen, places = left.seen(z), [np.flatnonzero(rows[o]) for o in first.own]
        curve = problem.kept(rows).predict(z)[0]
        predicted[rows] = curve
        off, k = curve - problem.points.value[rows], 0
        for errors, s, one, some in zip(left.errors, left.variances, seen, places, strict=True):
            if not len(some):
                continue
            part, slopes = slice(k, k + len(some)), np.where(held, 0.0, one.jacobian[0])
            factor = errors.factor(s, one.slope, one.bend)
            own_errors = errors.times(factor, np.eye(len(some))[None])[0]
            place = np.flatnonzero(rows)[part]
            joint = _joint(off[part], own_errors + slopes @ inverse @ slopes.T)
            density[place] = joint - np.log(problem.points.unit[place])
            k = part.stop
    residual = predicted - problem.points.value
    return LeaveOneOut(predicted, residual, density, _pointwise(fit), fold, True, whole)


def _joint(residual: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """ln of the normal density of points together: of each, those before it given."""
    lower = np.linalg.cholesky(0.5 * (covariance + covariance.T))
    white = np.linalg.solve(lower, residual)
    return -0.5 * (white**2 + math.log(2 * math.pi)) - np.log(np.diag(lower))


def _continued(fit: ComponentFit, fold: Int[np.ndarray, "n"]) -> LeaveOneOut:
    """The same to first order; point by point where there is one train alone.

    With P = V⁻¹ - V⁻¹J (A₀ + JᵀV⁻¹J)⁻¹ JᵀV⁻¹ the residuals of a fold b by the fit to all others are
    P_bb⁻¹ (P r)_b, of covariance P_bb⁻¹: exact for a linear model. An unknown noise is found from what
    is left of rᵀ P r.
    """
    problem, first = fit.final.problem, fit.stages[0].problem
    z, count = fit.z[None], fit.final.problem.count
    found = problem.linearise(z)
    held = fit.uncertainty.limits[0, problem.active] != 0
    white = np.where(held, 0.0, found.jacobian[0])
    inverse = np.linalg.pinv(white.T @ white, hermitian=True)
    off = found.prediction[0] - problem.points.value
    apart = any(e.shares and e.group is None for e in first.errors)
    fold = np.arange(count) if apart else fold
    residual, density = np.empty((2, count))
    seen = first.seen(z)
    factors = [
        e.factor(s, one.slope, one.bend)
        for e, s, one in zip(first.errors, first.variances, seen, strict=True)
    ]
    raw = [one.jacobian[0] for one in seen]
    if problem is not first:
        raw = [found.jacobian[0, own] / problem.points.weight[own, None] for own in first.own]
    solved = [
        e.solve(f, np.c_[o, j][None])[0]
        for e, f, o, j in zip(
            first.errors,
            factors,
            np.split(off, [o.stop for o in first.own[:-1]]),
            (np.where(held, 0.0, j) for j in raw),
            strict=True,
        )
    ]
    pull = sum(
        j.T @ s[:, 0] for j, s in zip((np.where(held, 0.0, j) for j in raw), solved, strict=True)
    )
    for g, (errors, s, factor, own) in enumerate(
        zip(first.errors, first.variances, factors, first.own, strict=True)
    ):
        x, left_over = solved[g][:, 1:], solved[g][:, 0] - solved[g][:, 1:] @ (inverse @ pull)
        quadratic = float(off[own] @ left_over)
        left = max(float(fit.uncertainty.noise.left[0, g]) - 1.0, 1.0)
        own_fold = fold[own]
        if len(np.unique(own_fold)) == len(own_fold):
            precision = errors.precisions(factor).reshape(-1) + np.zeros(len(errors))
            precision = precision - np.einsum("np,pq,nq->n", x, inverse, x)
            precision = np.maximum(precision, 1e-300)
            residual[own] = left_over / precision
            if errors.dof is not None:
                density[own] = log_density(residual[own], 1 / precision, errors.nu(s))
                continue
            scale, degrees = np.ones(len(errors)), np.inf
            if not errors.is_stated and not errors.shares:
                scale = np.maximum(quadratic - left_over**2 / precision, 1e-3 * quadratic) / left
                degrees = left
            deviation = np.sqrt(scale / precision)
            density[own] = student(residual[own] / deviation, degrees) - np.log(deviation)
            continue
        for number in np.unique(own_fold):
            rows = np.flatnonzero(own_fold == number)
            alone = errors.some(rows)
            at = [a[0, rows] if np.ndim(a) else a for a in (seen[g].slope, seen[g].bend)]
            variance = alone.times(alone.factor(s, *at), np.eye(len(rows)))
            covariance = np.linalg.inv(np.linalg.inv(variance) - x[rows] @ inverse @ x[rows].T)
            place = np.arange(own.start, own.stop)[rows]
            residual[place] = covariance @ left_over[rows]
            density[place] = _joint(residual[place], covariance)
    predicted = residual + problem.points.value
    density = density - np.log(problem.points.unit)
    return LeaveOneOut(predicted, residual, density, _pointwise(fit), fold, False, True)


def student(x: np.ndarray, degrees) -> np.ndarray:
    """ln of Student's density of standardised x; the normal one of infinite degrees."""
    degrees = np.broadcast_to(degrees, x.shape)
    finite = np.where(np.isinf(degrees), 1.0, degrees)
    return np.where(
        np.isinf(degrees), log_density(x, 1.0, None), log_density(x, np.ones_like(x), finite)
    )
