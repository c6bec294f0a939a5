"""Leave-one-out predictions: each point, or all that share its errors, predicted by a fit without it.

Four values of a constant ε: each is predicted by the mean of the three others.

>>> import calibration as cal
>>> data = cal.RestitutionData([1.0, 1.0, 1.0, 1.0], [0.84, 0.86, 0.90, 0.88])
>>> found = cal.fit(data, "constant", profiles=False, starts=1).leave_one_out()
>>> found.predicted.round(4)
array([0.88  , 0.8733, 0.86  , 0.8667])

Its density there is Student's t of the noise that the others scatter by, with the variance of their mean added:
s² (1 + 1/3), of 2 degrees of freedom."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from calibration.fitting.components import ComponentFit
from calibration.fitting.problem import AT_ONCE, Problem
from calibration.fitting.refits import STEPS, refitted
from calibration.fitting.rows import Batch, Linear
from calibration.fitting.search import Ends, search
from calibration.fitting.variances import estimated, relative_covariance

FEW = 400  # points up to which each is left out by itself
FOLDS = 20  # in which more are
MOST = 1_000_000  # impacts of refits side by side
SEEN = 1e-9  # singular values below that of the largest are none


@dataclass(frozen=True)
class LeaveOneOut:
    """Each point predicted by a fit without it.

    Points that share errors (a group, a bounce sequence) are left out together; of more than 400 points
    a twentieth at a time, drawn at random. The density is that of the measured ε at the measured velocity.

    Attributes:
        predicted: ε, or another observable over its scale, (n,), in the order of the data
            sets, in each that of `calibration.observables`.
        residual: predicted less measured.
        log_density: of each point under the prediction without it.
        pointwise: ln p of each point by the fit to all of them, given the others where points share
            errors: the terms of its likelihood.
        unit: points of equal number share errors, 0, 1, 2, ...
        fold: points of equal number were left out together, 0, 1, 2, ...
        converged: whether every refit arrived.
    """

    predicted: Float[np.ndarray, " n"]
    residual: Float[np.ndarray, " n"]
    log_density: Float[np.ndarray, " n"]
    pointwise: Float[np.ndarray, " n"]
    unit: Int[np.ndarray, " n"]
    fold: Int[np.ndarray, " n"]
    converged: bool

    @property
    def in_folds(self) -> int | None:
        """How many folds several units were left out in; None where each unit was by itself."""
        folds = int(np.max(self.fold)) + 1
        return folds if folds <= np.max(self.unit) else None

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
        """Standard error of `elpd`."""
        return self.error_of_sum(self.log_density)

    def error_of_sum(self, values: Float[np.ndarray, " n"]) -> float:
        """Standard error of the sum of one number a point: √m times the scatter over m units."""
        sums = np.bincount(self.unit, values)
        return float(np.sqrt(len(sums) * np.var(sums, ddof=1)))


def leave_one_out(fits: list[ComponentFit]) -> LeaveOneOut:
    """Leave-one-out predictions of all components, in the order of the data sets.

    Raises:
        ValueError: for data of one group alone, without which nothing is left.
    """
    parts = [(fit, _left_out(fit)) for fit in fits]
    first = dict.fromkeys(("unit", "fold"), 0)
    rows = []
    for fit, part in parts:
        numbers = {name: getattr(part, name) + first[name] for name in first}
        first = {name: int(np.max(number)) + 1 for name, number in numbers.items()}
        for k, g in enumerate(fit.component.sets):
            rows.append((g, replace(part, **numbers), fit.final.problem.points.set == k))
    ordered = sorted(rows, key=lambda row: row[0])

    def joined(name: str) -> np.ndarray:
        return np.concatenate([getattr(part, name)[order] for _, part, order in ordered])

    names = ("predicted", "residual", "log_density", "pointwise", "unit", "fold")
    columns: dict[str, Any] = {name: joined(name) for name in names}
    return LeaveOneOut(**columns, converged=all(part.converged for _, part in parts))


def _left_out(fit: ComponentFit) -> LeaveOneOut:
    problem, first = fit.final.problem, fit.stages[0].problem
    unit, shares = units_of(first), any(errors.shares for errors in first.errors)
    fold, units = unit, int(np.max(unit)) + 1
    if problem.count > FEW and units > FOLDS:
        fold = (np.random.default_rng(0).permutation(units) % FOLDS)[unit]
    method = _without_groups if shares else _without_points
    residual, density, arrived = method(fit, fold, unit)
    density = density - np.log(problem.points.unit)
    predicted = residual + problem.points.value
    return LeaveOneOut(predicted, residual, density, _pointwise(fit), unit, fold, arrived)


def units_of(problem: Problem) -> Int[np.ndarray, " n"]:
    """Points that share errors: a group, a bounce sequence, or a point alone.

    Of one sequence alone the points: each is predicted by all others of it.
    """
    unit, first = np.empty(problem.count, int), 0
    for errors, rows in zip(problem.errors, problem.spans, strict=True):
        numbers = errors.units
        unit[rows] = first + numbers
        first += int(np.max(numbers)) + 1
    if first > 1:
        return unit
    if any(errors.labels is not None for errors in problem.errors):
        raise problem.datasets[0].refusal("one group", "two or more, as each is left out in turn")
    return np.arange(problem.count)


def _pointwise(fit: ComponentFit) -> Float[np.ndarray, " n"]:
    """ln p of each point by the likelihood of the fit."""
    first = fit.stages[0].problem
    linear, at = fit.final.problem.linearise(fit.z[None]), first.linearise(fit.z[None])
    residual, parts = linear.prediction - first.points.value, []
    for errors, s, span in zip(first.errors, first.variances, first.spans, strict=True):
        parts.append(
            errors.by_point(
                s, residual[:, span], at.slope[:, span], at.curvature_variance[:, span]
            )[0]
        )
    return np.concatenate(parts)


def _fixed(fit: ComponentFit) -> Bool[np.ndarray, " p"]:
    """Elements at an end of their range, which stay there."""
    return fit.uncertainty.bound_side[fit.final.problem.active] != 0


def _without_points(fit: ComponentFit, fold: np.ndarray, unit: np.ndarray):
    """Refits without points that share no errors; the noise is estimated from the remaining points.

    Returns:
        Predicted less measured, densities, and whether all refits arrived; as the others.
    """
    folds, problem = int(np.max(fold)) + 1, fit.final.problem
    residual, density = np.empty((2, problem.count))
    arrived, most = True, max(1, MOST // problem.count)
    for some in np.split(np.arange(folds), np.arange(most, folds, most)):
        kept = (fold != some[:, None]).astype(float)

        def again(problem: Problem, z, kept=kept) -> Ends:
            batch = Batch(copies=kept * problem.points.copies)
            reference_start = np.broadcast_to(fit.reference_start, z.shape)
            return search(problem, z, reference_start=reference_start, batch=batch, limit=STEPS)

        z, converged = refitted(fit, again, len(some))
        arrived = arrived and bool(np.all(converged))
        few = max(1, AT_ONCE // problem.count)
        for part in np.split(np.arange(len(some)), np.arange(few, len(some), few)):
            of_all, scores = _scored(fit, z[part], kept[part])
            is_left_out = np.isin(fold, some[part])
            at = fold[is_left_out] - some[part[0]], np.flatnonzero(is_left_out)
            residual[is_left_out], density[is_left_out] = of_all[at], scores[at]
    return residual, density, arrived


def _scored(fit: ComponentFit, z: np.ndarray, kept: np.ndarray):
    """Predicted less measured by refits, and densities of what each left out."""
    problem, first, fixed = fit.final.problem, fit.stages[0].problem, _fixed(fit)
    linear = problem.linearise(z)
    residual = linear.prediction - problem.points.value
    variance, families = np.empty(residual.shape), []
    for errors, s, block, span in zip(
        first.errors, first.variances, first.residuals_at(z), first.spans, strict=True
    ):
        mask = np.where(np.any(kept[:, span] > 0, axis=1)[:, None], kept[:, span], 1.0)
        raw = np.where(fixed, 0.0, linear.per[:, span])
        block = block._replace(residual=residual[:, span], jacobian=raw, included=mask)
        at = block.slope, block.curvature_variance
        s = estimated(errors, block, True, s) if errors.unknown else s
        variance[:, span] = total = errors.variance(s, *at) + np.zeros(residual[:, span].shape)
        degrees: Any = np.inf
        if errors.unknown and not errors.is_stated and errors.noise.is_least_squares:
            relative = relative_covariance(errors, s, block)
            per = [errors.variance({**s, k: 2 * s[k]}, *at) - total for k in errors.unknown]
            spread = np.einsum("cfn,fcd,dfn->fn", per, relative, per)
            with np.errstate(divide="ignore"):
                degrees = np.where(spread > 0, 2 * total**2 / spread, np.inf)
        families.append((errors.noise, span, degrees))
    raw = _slopes(fit, linear)
    rows, others = raw[:, : problem.count], raw[:, problem.count :]
    there = rows * (kept * variance**-0.5)[..., None]
    information = np.swapaxes(there, 1, 2) @ there + np.swapaxes(others, 1, 2) @ others
    covariance = np.linalg.pinv(information, rcond=SEEN, hermitian=True)
    spread = variance + np.einsum("fnp,fpq,fnq->fn", rows, covariance, rows)
    density = [f.log_predictive(residual[:, s], spread[:, s], nu) for f, s, nu in families]
    return residual, np.concatenate(density, axis=1)


def _slopes(fit: ComponentFit, linear: Linear) -> np.ndarray:
    """Derivatives of the predictions and of the priors' rows, columns of unit length; 0 for fixed elements."""
    problem = fit.final.problem
    priors = linear.jacobian[:, problem.count : linear.jacobian.shape[1] - problem.more]
    rows = np.concatenate([linear.per, priors], axis=1)
    size = np.linalg.norm(rows, axis=1, keepdims=True)
    return np.where(_fixed(fit), 0.0, rows / np.where(size > 0, size, 1.0))


def _without_groups(fit: ComponentFit, fold: np.ndarray, unit: np.ndarray):
    """Refits without each fold of points that share errors, with the variances of the fit."""
    problem, first, fixed = fit.final.problem, fit.stages[0].problem, _fixed(fit)
    residual, density = np.empty((2, problem.count))
    arrived = True
    for number in range(int(np.max(fold)) + 1):
        rows = fold == number

        def again(problem: Problem, z, others=~rows) -> Ends:
            return search(
                problem.select_points(others),
                z,
                reference_start=fit.reference_start[None],
                limit=STEPS,
            )

        z, converged = refitted(fit, again)
        arrived, remaining = arrived and bool(converged[0]), problem.select_points(~rows)
        there = np.where(fixed, 0.0, remaining.linearise(z).jacobian[0])
        inverse = np.linalg.pinv(there.T @ there, rcond=SEEN**2, hermitian=True)
        mine = problem.select_points(rows)
        removed = replace(first.select_points(rows), active=problem.active, laws=mine.laws)
        residual[rows] = mine.linearise(z, slopes=False).prediction[0] - mine.points.value
        places = np.flatnonzero(rows)
        for errors, s, block, part in zip(
            removed.errors, removed.variances, removed.residuals_at(z), removed.spans, strict=True
        ):
            slopes, units_of_part = np.where(fixed, 0.0, block.jacobian[0]), unit[places[part]]
            for k in np.unique(units_of_part):
                own = np.flatnonzero(units_of_part == k)
                of_unit, place = errors.select(own), places[part][own]
                at = [
                    a[0, own] if np.ndim(a) else a for a in (block.slope, block.curvature_variance)
                ]
                variance = of_unit.times(of_unit.factor(s, *at), np.eye(len(own)))
                spread = variance + slopes[own] @ inverse @ slopes[own].T
                density[place] = _joint(residual[place], spread)
    return residual, density, arrived


def _joint(residual: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """ln of the normal density of points together: of each, those before it given."""
    lower = np.linalg.cholesky(0.5 * (covariance + covariance.T))
    white = np.linalg.solve(lower, residual)
    return -0.5 * (white**2 + math.log(2 * math.pi)) - np.log(np.diag(lower))
