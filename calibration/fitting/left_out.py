"""Each point, or each group, predicted by the fit to all others."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from calibration.fitting.component_fit import ComponentFit
from calibration.fitting.problem import AT_ONCE, Lanes, Problem
from calibration.fitting.refits import refit

EXACT = 1_000_000  # impacts up to which every point is left out by a refit
EXACT_BY_TIME = 20_000  # the same where every impact is integrated over time
SEEN = 1e-9  # singular values below that of the largest are none
LEAST_SQUARES = 1e-30  # of the residuals of data without noise


@dataclass(frozen=True)
class LeaveOneOut:
    """Each point predicted by the fit without it.

    Where data have groups all of a group is left out together.

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
    """Predictions and densities of what each refit left out."""
    problem = fit.final.problem
    predicted, density = np.empty(problem.count), np.empty(problem.count)
    most = max(1, AT_ONCE // problem.count)
    for first in range(0, len(z), most):
        found = problem.linearise(z[first : first + most])
        searched = _searched(fit, found.jacobian)
        for k, (prediction, jacobian) in enumerate(zip(found.prediction, searched, strict=True)):
            rows = fold == first + k
            predicted[rows] = prediction[rows]
            density[rows] = _densities(fit, prediction, jacobian, rows)
    residual = predicted - _measured(problem)
    return LeaveOneOut(predicted, residual, density, fold, True, bool(np.all(converged)))


def _searched(fit: ComponentFit, jacobian: Float[np.ndarray, "fits m p"]) -> np.ndarray:
    """Its columns of unit length, and 0 for what is held at an end of its range."""
    held = fit.uncertainty.limits[0, fit.final.problem.active] != 0
    size = np.linalg.norm(jacobian, axis=1, keepdims=True)
    return np.where(held, 0.0, jacobian / np.where(size > 0, size, 1.0))


def _densities(fit: ComponentFit, prediction, jacobian, rows) -> np.ndarray:
    """ln of the predictive density of the points `rows` by a fit to all others."""
    problem = fit.final.problem
    weight = problem.points.weight
    weighted = (prediction - _measured(problem)) * weight
    kept = np.ones(len(jacobian), bool)
    kept[: len(rows)] = ~rows
    left, singular, right = np.linalg.svd(jacobian[kept], full_matrices=False)
    seen = singular > SEEN * max(np.max(singular, initial=0.0), SEEN)
    used = float(np.sum(left[: np.sum(~rows), seen] ** 2))  # parameters that the points pay for
    scale, degrees = _scale(fit, float(np.sum(weighted[~rows] ** 2)), np.sum(~rows) - used)
    along = jacobian[: len(rows)][rows] @ right[seen].T / singular[seen]
    deviation = scale * np.sqrt(1 + np.sum(along**2, axis=1))
    density = log_density(weighted[rows] / deviation, degrees)
    return density - np.log(deviation / weight[rows])


def _scale(fit: ComponentFit, squares, degrees):
    """Standard deviation of a weighted residual: one, or from the squares where it is not stated."""
    if all(plan.stated for plan in fit.final.problem.plans):
        return 1.0, None
    degrees = np.maximum(degrees, 1.0)
    return np.sqrt(np.maximum(squares, LEAST_SQUARES) / degrees), degrees


def _continued(fit: ComponentFit, fold: Int[np.ndarray, "n"]) -> LeaveOneOut:
    """The fit without each fold to first order: exact for a linear model.

    With U an orthonormal basis of the Jacobian's columns and B_g = (1 - U_gᵀ U_g)⁻¹, leaving the
    fold g out takes its residuals from r_g to s_g = r_g + U_g B_g U_gᵀ r_g. It predicts them with
    the variance 1 + u B_g uᵀ, in units of the noise, and lowers the sum of squares by r_gᵀ s_g. For
    single points these are r/(1 - h) and 1/(1 - h).
    """
    problem = fit.final.problem
    measured, weight = _measured(problem), problem.points.weight
    found = problem.linearise(fit.z[None])
    left, singular, _ = np.linalg.svd(_searched(fit, found.jacobian)[0], full_matrices=False)
    basis = left[: problem.count, singular > SEEN * max(np.max(singular, initial=0.0), SEEN)]
    weighted = (found.prediction[0] - measured) * weight
    folds, p = int(np.max(fold)) + 1, basis.shape[1]
    taken, pull = np.zeros((folds, p, p)), np.zeros((folds, p))
    np.add.at(taken, fold, basis[:, :, None] * basis[:, None, :])
    np.add.at(pull, fold, basis * weighted[:, None])
    inverse = np.linalg.pinv(np.eye(p) - taken, rcond=SEEN, hermitian=True)[fold]
    without = weighted + np.einsum("np,npq,nq->n", basis, inverse, pull[fold])
    spread = 1 + np.einsum("np,npq,nq->n", basis, inverse, basis)
    squares = np.sum(weighted**2) - np.bincount(fold, weighted * without)[fold]
    used = float(np.sum(basis**2))
    scale, degrees = _scale(fit, squares, problem.count - np.bincount(fold)[fold] - used)
    deviation = scale * np.sqrt(spread)
    density = log_density(without / deviation, degrees) - np.log(deviation / weight)
    residual = without / weight
    return LeaveOneOut(residual + measured, residual, density, fold, False, True)


def _left_out_together(fit: ComponentFit) -> LeaveOneOut:
    """Without each group of points that share errors, by refits under the covariance of the fit."""
    problem = fit.final.problem
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
    return log_density(np.linalg.solve(lower, residual), None) - np.log(np.diag(lower))


def _continued_together(fit: ComponentFit, fold: Int[np.ndarray, "n"]) -> LeaveOneOut:
    """The same to first order; point by point where there is one group alone.

    With P = V⁻¹ - V⁻¹J (A₀ + JᵀV⁻¹J)⁻¹ JᵀV⁻¹ the residuals of a group b by the fit to all others are
    P_bb⁻¹ (P r)_b, of covariance P_bb⁻¹: exact for a linear model.
    """
    problem = fit.final.problem
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


def log_density(x: np.ndarray, degrees: float | np.ndarray | None) -> np.ndarray:
    """ln of Student's density, or of the normal one where the noise is known."""
    if degrees is None:
        return -0.5 * (x**2 + math.log(2 * math.pi))
    from scipy import special

    level = special.gammaln(0.5 * (degrees + 1)) - special.gammaln(0.5 * degrees)
    level = level - 0.5 * np.log(math.pi * degrees)
    return level - 0.5 * (degrees + 1) * np.log1p(x**2 / degrees)
