"""Each point, or each group, predicted by the fit to all others."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from jaxtyping import Float, Int

from calibration.fitting.component_fit import ComponentFit
from calibration.fitting.noise import (
    LEAST,
    as_measured,
    known_variances,
    level,
    slopes_at,
    with_slopes,
)
from calibration.fitting.plan import ErrorPlan
from calibration.fitting.problem import AT_ONCE, Lanes, Problem
from calibration.fitting.refits import refit

EXACT = 1_000_000  # impacts up to which every point is left out by a refit
EXACT_BY_TIME = 20_000  # the same where every impact is integrated over time
SEEN = 1e-9  # singular values below that of the largest are none


@dataclass(frozen=True)
class LeaveOneOut:
    """Each point predicted by the fit without it.

    Where data have groups all of a group is left out together. The density is that of the measured ε
    at the measured velocity, whose error is carried into ε by the curve's slope.

    Attributes:
        predicted: ε, (n,), in the order of the data sets' points.
        residual: predicted less measured.
        log_density: of each point under the prediction without it.
        fold: points of equal number were left out together, 0, 1, 2, ...
        exact: whether refits were made; else the fit was continued to first order.
        converged: whether every refit arrived.
    """

    predicted: Float[np.ndarray, "n"]
    residual: Float[np.ndarray, "n"]
    log_density: Float[np.ndarray, "n"]
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

    return LeaveOneOut(
        joined("predicted"),
        joined("residual"),
        joined("log_density"),
        joined("fold"),
        all(part.exact for _, part in parts),
        all(part.converged for _, part in parts),
    )


def _left_out(fit: ComponentFit) -> LeaveOneOut:
    problem = fit.final.problem
    if problem.shared is not None:
        return _left_out_together(fit)
    fold = folds_of(problem)
    most = EXACT_BY_TIME if fit.final.report.route == "ode" else EXACT
    if problem.count * (1 + np.max(fold)) > most or not _apart(fit.stages[0].problem):
        return _continued(fit, fold)
    z, converged = _refitted_without(fit, fold)
    return _scored(fit, z, converged, fold)


def _apart(problem: Problem) -> bool:
    """Whether what is left out shares no error with what stays."""
    shared = problem.shared or ()
    return all(len(errors.units()) > 1 and errors.group is not None for errors in shared)


def folds_of(problem: Problem) -> Int[np.ndarray, "n"]:
    """What is left out together: each point alone, or all of a group where the data have groups."""
    fold = np.empty(problem.count, int)
    first = 0
    for g, data in enumerate(problem.datasets):
        rows = np.flatnonzero(problem.points.set == g)
        index = data.group_index
        own = np.arange(len(rows)) if index is None else index
        fold[rows] = first + own
        first += int(np.max(own)) + 1
    if first == 1:
        raise problem.datasets[0].refusal("one group", "two or more, as each is left out in turn")
    return fold


def _refitted_without(fit: ComponentFit, fold: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """z of the fit without each fold, through all stages; and which of them arrived."""
    folds = int(np.max(fold)) + 1
    z = np.repeat(fit.z[None], folds, axis=0)
    converged = np.ones(folds, bool)
    kept = fold != np.arange(folds)[:, None]
    for stage in fit.stages:
        lanes = Lanes(weight=np.where(kept, stage.problem.points.weight, 0.0))
        found = refit(fit, stage.problem, z, lanes)
        z, converged = found.z, converged & found.converged
    return z, converged


def _measured(problem: Problem) -> Float[np.ndarray, "n"]:
    """ε as it was measured, outliers not drawn in."""
    return np.concatenate([data.restitution for data in problem.datasets])


def _scored(fit: ComponentFit, z: np.ndarray, converged: np.ndarray, fold) -> LeaveOneOut:
    """Predictions and densities of what each refit left out, at the measured velocities."""
    problem = as_measured(fit.final.problem, fit.z)
    measured, residual, density = _measured(problem), *np.empty((2, problem.count))
    most = max(1, AT_ONCE // problem.count)
    for first in range(0, len(z), most):
        some = z[first : first + most]
        found = problem.linearise(some)
        slope = None if problem.latent is None else slopes_at(problem, some)
        searched = _searched(fit, found.jacobian)
        for k, (prediction, jacobian) in enumerate(zip(found.prediction, searched, strict=True)):
            rows, off = fold == first + k, prediction - measured
            at = problem if slope is None else with_slopes(problem, slope[k])
            residual[rows], density[rows] = off[rows], _densities(at, off, jacobian, rows)
    return LeaveOneOut(residual + measured, residual, density, fold, True, bool(np.all(converged)))


def _searched(fit: ComponentFit, jacobian: Float[np.ndarray, "fits m p"]) -> np.ndarray:
    """Its columns of unit length, and 0 for what is held at an end of its range."""
    held = fit.uncertainty.limits[0, fit.final.problem.active] != 0
    size = np.linalg.norm(jacobian, axis=1, keepdims=True)
    return np.where(held, 0.0, jacobian / np.where(size > 0, size, 1.0))


def _densities(problem: Problem, off, jacobian, rows) -> np.ndarray:
    """ln of the predictive density of the points `rows` by a fit to all others.

    Its variance is that of the point's own errors, and what the errors of the others make in the
    prediction.
    """
    weight, kept = problem.points.weight, np.ones(len(jacobian), bool)
    kept[: len(rows)] = ~rows
    left, singular, right = np.linalg.svd(jacobian[kept], full_matrices=False)
    seen = singular > SEEN * max(np.max(singular, initial=0.0), SEEN)
    basis, leverage = left[:, seen], np.zeros(len(rows))
    leverage[~rows] = np.sum(basis[: np.sum(~rows)] ** 2, axis=1)
    variance, degrees = _noise_without(problem, off, leverage, ~rows)
    errors = np.ones(len(basis))  # of the weighted points, and of the priors
    errors[: np.sum(~rows)] = (variance * weight**2)[~rows]
    influence = (jacobian[: len(rows)][rows] @ right[seen].T / singular[seen]) @ basis.T
    deviation = np.sqrt(variance[rows] + influence**2 @ errors / weight[rows] ** 2)
    return log_density(off[rows] / deviation, degrees[rows]) - np.log(deviation)


def _noise_without(problem: Problem, off, leverage, kept) -> tuple[np.ndarray, np.ndarray]:
    """The variance of each point's errors, each data set's from its kept points; degrees of freedom."""
    variance, degrees = np.empty(len(off)), np.full(len(off), np.inf)
    for g, plan in enumerate(problem.plans):
        own = problem.points.set == g
        known, some = known_variances(problem, g), kept[own]
        some = some if np.any(some) else ~some
        left = max(float(np.sum((1 - leverage[own])[some])), 1.0)
        scatter, factor = level(plan, off[own][some], known[some], left)
        total = scatter + factor * known
        variance[own] = total
        weight = np.sum(1 / total[some])
        degrees[own] = _degrees(plan, total, scatter, left, np.sum(some) / weight)
    return variance, degrees


def _degrees(plan: ErrorPlan, total, scatter, left, mean):
    """Degrees of freedom of variances s² + known with s² an estimate (Satterthwaite).

    Args:
        mean: the harmonic mean of the variances that s² was estimated among.
    """
    if plan.stated:
        return np.inf
    if "scatter" not in plan.unknown:
        return left
    # the variance of s² by Paule and Mandel; one that is hardly told has one degree of freedom
    spread = np.minimum(2 * mean**2 / left, 2 * scatter**2)
    return 2 * total**2 / spread


def _continued(fit: ComponentFit, fold: Int[np.ndarray, "n"]) -> LeaveOneOut:
    """The fit without each fold to first order: exact for a linear model.

    With U an orthonormal basis of the Jacobian's columns and B_f = (1 - U_fᵀ U_f)⁻¹, leaving the
    fold f out moves the fit by c_f = B_f U_fᵀ r_f, and a weighted residual from r to r + u c_f. The
    prediction has the variance u B_f M_f B_f uᵀ, M_f = Σ uᵀ var(r) u over the other rows.
    """
    problem = as_measured(fit.final.problem, fit.z)
    measured, weight = _measured(problem), problem.points.weight
    found = problem.linearise(fit.z[None])
    left, singular, _ = np.linalg.svd(_searched(fit, found.jacobian)[0], full_matrices=False)
    basis = left[: problem.count, singular > SEEN * max(np.max(singular, initial=0.0), SEEN)]
    off, square = found.prediction[0] - measured, basis[:, :, None] * basis[:, None, :]
    folds, one = int(np.max(fold)) + 1, np.eye(basis.shape[1])
    inverse = np.linalg.pinv(one - _sums(square, fold, folds), rcond=SEEN, hermitian=True)
    pull = _sums(basis * (off * weight)[:, None], fold, folds)
    moved = np.einsum("fpq,fq->fp", inverse, pull)
    turned = np.einsum("np,npq->nq", basis, inverse[fold])
    residual = off + np.sum(basis * moved[fold], axis=1) / weight
    variance, degrees = np.empty((2, problem.count))
    middle = np.repeat((one - np.sum(square, axis=0))[None], folds, axis=0)  # of the priors
    for g, plan in enumerate(problem.plans):
        own, known = problem.points.set == g, known_variances(problem, g)
        every, sums = np.sum(square[own], axis=0), partial(_sums, fold=fold[own], folds=folds)
        scatter, factor = level(plan, off[own], known, max(len(known) - np.trace(every), 1.0))
        total = scatter + factor * known
        kept = len(known) - sums(np.ones(len(known)))
        used = np.sum(inverse * every, axis=(1, 2)) - sums(np.sum((turned * basis)[own], axis=1))
        free = np.maximum(kept - used, 1.0)
        # Σ (r + u c)²/variance over the set less the fold
        over = 1 / np.sqrt(total)
        white, steep = off[own] * over, basis[own] * (over / weight[own])[:, None]
        squares = (
            np.sum(white**2) + 2 * moved @ (steep.T @ white) - sums((residual[own] * over) ** 2)
        )
        squares += np.sum(moved @ (steep.T @ steep) * moved, axis=1)
        # a step of Newton's from the noise of all points, exact where nothing of it is known
        excess = np.where((kept > 0) & (not plan.stated), squares / free - 1, 0.0)
        others = np.maximum(np.sum(over**2) - sums(over**2), np.min(over**2))
        mean = np.where(kept > 0, kept / others, scatter)
        by_scale = "scale" in plan.unknown
        unit, step, least = (total, 1.0, 1.0) if by_scale else (np.ones(len(known)), mean, scatter)
        change = np.maximum(excess * step, (LEAST - 1) * least)
        variance[own] = total + change[fold[own]] * unit
        square_of = square[own] * weight[own, None, None] ** 2
        middle += np.tensordot(total, square_of, 1) - sums(square_of * variance[own, None, None])
        middle += change[:, None, None] * np.tensordot(unit, square_of, 1)
        settled = [a[fold[own]] for a in (scatter + change, free, mean + change)]
        degrees[own] = _degrees(plan, variance[own], *settled)
    deviation = np.sqrt(
        variance + np.einsum("np,npq,nq->n", turned, middle[fold], turned) / weight**2
    )
    density = log_density(residual / deviation, degrees) - np.log(deviation)
    return LeaveOneOut(residual + measured, residual, density, fold, False, True)


def _sums(values: np.ndarray, fold: np.ndarray, folds: int) -> np.ndarray:
    """Of the points of each fold."""
    found = np.zeros((folds, *values.shape[1:]))
    np.add.at(found, fold, values)
    return found


def _left_out_together(fit: ComponentFit) -> LeaveOneOut:
    """Without each group of points that share errors, by refits under the covariance of the fit."""
    problem = as_measured(fit.final.problem, fit.z)
    assert problem.shared is not None
    fold = np.empty(problem.count, int)
    for number, (rows, *_) in enumerate(_members(problem)):
        fold[rows] = number
    if not _apart(problem) or problem.count * (1 + np.max(fold)) > EXACT:
        return _continued_together(fit, fold)
    z, converged = _refitted_without(fit, fold)
    bare = replace(problem, shared=None, loss="squared").weighed(np.ones(problem.count))
    white, raw = problem.linearise(z), bare.linearise(z)
    measured, residual, density = _measured(problem), *np.empty((2, problem.count))
    for number, (rows, errors, members) in enumerate(_members(problem)):
        kept = np.ones(white.jacobian.shape[1], bool)
        kept[rows] = False
        slopes = _searched(fit, white.jacobian[number : number + 1])[0][kept]
        own = _searched(fit, raw.jacobian[number : number + 1])[0][rows]
        size = [np.linalg.norm(j[number], axis=0) for j in (white.jacobian, raw.jacobian)]
        own = own * size[1] / np.where(size[0] > 0, size[0], 1.0)
        inverse = np.linalg.pinv(slopes.T @ slopes, rcond=SEEN, hermitian=True)
        covariance = np.linalg.inv(errors.precision(members)) + own @ inverse @ own.T
        residual[rows] = raw.prediction[number, rows] - measured[rows]
        density[rows] = _joint_density(residual[rows], covariance)
    return LeaveOneOut(residual + measured, residual, density, fold, True, bool(np.all(converged)))


def _joint_density(residual: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """ln of the normal density of points together: of each, those before it given."""
    lower = np.linalg.cholesky(0.5 * (covariance + covariance.T))
    return log_density(np.linalg.solve(lower, residual), np.inf) - np.log(np.diag(lower))


def _continued_together(fit: ComponentFit, fold: Int[np.ndarray, "n"]) -> LeaveOneOut:
    """The same to first order; point by point where there is one group alone.

    With P = V⁻¹ - V⁻¹J (A₀ + JᵀV⁻¹J)⁻¹ JᵀV⁻¹ the residuals of a group b by the fit to all others are
    P_bb⁻¹ (P r)_b, of covariance P_bb⁻¹: exact for a linear model.
    """
    problem = as_measured(fit.final.problem, fit.z)
    found, measured = problem.linearise(fit.z[None]), _measured(problem)
    white, count = found.jacobian[0], problem.count
    inverse = np.linalg.pinv(white.T @ white, hermitian=True)
    gradient = white[:count].T @ found.residual[0, :count]
    residual, density = np.empty(count), np.empty(count)
    off = found.prediction[0] - problem.points.restitution
    for rows, precision, solved, slopes in _blocks(problem, off, white[:count]):
        covariance = np.linalg.inv(precision - slopes @ inverse @ slopes.T)
        without = covariance @ (solved - slopes @ (inverse @ gradient))
        residual[rows], density[rows] = without, _joint_density(without, covariance)
    return LeaveOneOut(residual + measured, residual, density, fold, False, True)


def _members(problem: Problem) -> Iterator[tuple]:
    """What is left out together: its rows, the errors of its data set, its points among these."""
    assert problem.shared is not None
    first = 0
    for errors in problem.shared:
        for members in errors.units():
            yield first + members, errors, members
        first += len(errors.slope)


def _blocks(problem: Problem, off: np.ndarray, white: np.ndarray) -> Iterator[tuple]:
    """What is left out together: its rows, (V⁻¹)_bb, V⁻¹ r and V⁻¹ J there."""
    assert problem.shared is not None
    first = 0
    for errors in problem.shared:
        rows = slice(first, first + len(errors.slope))
        solved = errors.solved(off[rows][:, None])[:, 0]
        slopes = errors.unwhiten(white[rows])
        for members in errors.units():
            yield first + members, errors.precision(members), solved[members], slopes[members]
        first = rows.stop


def log_density(x: np.ndarray, degrees: float | np.ndarray) -> np.ndarray:
    """ln of Student's density; of the normal one where the noise is known (infinite degrees)."""
    from scipy import special

    normal = -0.5 * (x**2 + math.log(2 * math.pi))
    some = np.where(np.isinf(degrees), 1.0, degrees)
    level = np.log(special.poch(0.5 * some, 0.5)) - 0.5 * np.log(math.pi * some)
    return np.where(np.isinf(degrees), normal, level - 0.5 * (some + 1) * np.log1p(x**2 / some))
