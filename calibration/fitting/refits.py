"""Many fits of one problem side by side: without each point, and to simulated data."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from calibration.fitting.component_fit import ComponentFit
from calibration.fitting.noise import leverages
from calibration.fitting.problem import Lanes, Problem
from calibration.fitting.search import Found, search
from calibration.fitting.uncertainty import winsorised

STEPS = 100  # of one refit
EXACT = 3_000_000  # impacts up to which every point is left out by a refit
EXACT_BY_TIME = 60_000  # the same where every impact is integrated over time


@dataclass(frozen=True)
class LeaveOneOut:
    """Each point predicted by the fit without it.

    Attributes:
        predicted: ε, (n,), in the order of the data sets' points.
        residual: predicted less measured.
        log_density: of each point under the prediction without it.
        exact: whether refits were made; else the fit was continued to first order.
        converged: whether every refit arrived.
    """

    predicted: Float[np.ndarray, "n"]
    residual: Float[np.ndarray, "n"]
    log_density: Float[np.ndarray, "n"]
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
        """Its standard error, √n times the scatter over the points."""
        return float(np.sqrt(len(self.log_density) * np.var(self.log_density)))


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


def leave_one_out(fits: list[ComponentFit]) -> LeaveOneOut:
    """Of all components, in the order of the data sets."""
    parts = [(fit, _left_out(fit)) for fit in fits]
    rows = [(g, fit, part, k) for fit, part in parts for k, g in enumerate(fit.component.sets)]
    ordered = sorted(rows, key=lambda row: row[0])

    def joined(name: str) -> np.ndarray:
        every = [getattr(p, name)[f.final.problem.points.set == k] for _, f, p, k in ordered]
        return np.concatenate(every)

    return LeaveOneOut(
        joined("predicted"),
        joined("residual"),
        joined("log_density"),
        all(part.exact for _, part in parts),
        all(part.converged for _, part in parts),
    )


def _left_out(fit: ComponentFit) -> LeaveOneOut:
    problem = fit.final.problem
    if problem.shared is not None:
        return left_out_together(fit)
    by_time = fit.final.report.route == "ode"
    if problem.count**2 <= (EXACT_BY_TIME if by_time else EXACT):
        z, converged = _refitted_without(fit)
        return _scored(fit, z, converged)
    return _continued(fit)


def _refitted_without(fit: ComponentFit):
    """z of the fit without each point, through all stages; and which of them arrived."""
    count = fit.final.problem.count
    z, converged = np.repeat(fit.z[None], count, axis=0), np.ones(count, bool)
    for stage in fit.stages:
        weight = stage.problem.points.weight * (1 - np.eye(count))
        found = _search(fit, stage.problem, z, Lanes(weight=weight))
        z, converged = found.z, converged & found.converged
    return z, converged


def _search(fit: ComponentFit, problem: Problem, z, lanes: Lanes) -> Found:
    return search(problem, z, begun=fit.begun, lanes=lanes, limit=STEPS)


def _scored(fit: ComponentFit, z, converged) -> LeaveOneOut:
    """Predictions and densities of what each refit left out."""
    problem = fit.final.problem
    predicted, density = np.empty(problem.count), np.empty(problem.count)
    measured = np.concatenate([data.restitution for data in problem.datasets])
    most = max(1, EXACT // problem.count)
    for first in range(0, problem.count, most):
        found = problem.linearise(z[first : first + most])
        for k, point in enumerate(range(first, min(first + most, problem.count))):
            predicted[point] = found.prediction[k, point]
            density[point] = _density(fit, found.prediction[k], found.jacobian[k], point)
    residual = predicted - measured
    return LeaveOneOut(predicted, residual, density, True, bool(np.all(converged)))


def _density(fit: ComponentFit, prediction, jacobian, point: int) -> float:
    """ln of the predictive density of a point by a fit to all others."""
    problem = fit.final.problem
    weight = problem.points.weight
    weighted = (prediction - problem.points.restitution) * weight
    others = np.ones(problem.count, bool)
    others[point] = False
    used = jacobian[: problem.count][others]
    scale, degrees = _scale(fit, weighted, others)
    size = np.linalg.norm(used, axis=0)
    size = np.where(size > 0, size, 1.0)
    inverse = np.linalg.pinv(used / size, rcond=1e-9)
    of_mean = float(np.sum((jacobian[point] / size @ inverse) ** 2))  # its variance over scale²
    deviation = scale * math.sqrt(1 + of_mean)
    told = float(log_density(weighted[point] / deviation, degrees))
    return told - math.log(deviation / weight[point])


def _scale(fit: ComponentFit, weighted, others) -> tuple[float, float | None]:
    """Standard deviation of a weighted residual, from the other points where it is not stated."""
    problem = fit.final.problem
    if all(plan.stated for plan in problem.plans):
        return 1.0, None
    degrees = max(float(np.sum(others)) - len(fit.z), 1.0)
    return max(float(np.sqrt(np.sum(weighted[others] ** 2) / degrees)), 1e-15), degrees


def _continued(fit: ComponentFit) -> LeaveOneOut:
    """The fit without each point to first order: exact for a linear model, r/(1 - h)."""
    problem = fit.final.problem
    found = problem.linearise(fit.z[None])
    leverage = leverages(found.jacobian)[0, : problem.count]
    weighted = (found.prediction[0] - problem.points.restitution) * problem.points.weight
    without = weighted / np.maximum(1 - leverage, 1e-12)
    stated = all(plan.stated for plan in problem.plans)
    degrees = max(problem.count - 1 - float(np.sum(leverage)), 1.0)
    squares = max(float(np.sum(weighted**2)), 1e-300) - weighted * without
    scale = np.ones(problem.count) if stated else np.sqrt(np.maximum(squares, 1e-300) / degrees)
    deviation = scale / np.sqrt(np.maximum(1 - leverage, 1e-12))
    own = log_density(without / deviation, None if stated else degrees)
    density = own - np.log(deviation / problem.points.weight)
    residual = without / problem.points.weight
    predicted = residual + problem.points.restitution
    return LeaveOneOut(predicted, residual, density, False, True)


def left_out_together(fit: ComponentFit) -> LeaveOneOut:
    """Without each group of points that share errors, to first order; point by point where there is
    one group alone.

    With P = V⁻¹ - V⁻¹J (A₀ + JᵀV⁻¹J)⁻¹ JᵀV⁻¹ the residuals of a group b by the fit to all others are
    P_bb⁻¹ (P r)_b, of covariance P_bb⁻¹: exact for a linear model.
    """
    problem = fit.final.problem
    found = problem.linearise(fit.z[None])
    white, count = found.jacobian[0], problem.count
    inverse = np.linalg.pinv(white.T @ white, hermitian=True)
    gradient = white[:count].T @ found.residual[0, :count]
    residual, density = np.empty(count), np.empty(count)
    off = found.prediction[0] - problem.points.restitution
    for rows, precision, solved, slopes in _blocks(problem, off, white[:count]):
        covariance = np.linalg.inv(precision - slopes @ inverse @ slopes.T)
        without = covariance @ (solved - slopes @ (inverse @ gradient))
        lower = np.linalg.cholesky(0.5 * (covariance + covariance.T))
        told = log_density(np.linalg.solve(lower, without), None)
        residual[rows] = without
        density[rows] = told - np.log(np.diag(lower))
    return LeaveOneOut(residual + problem.points.restitution, residual, density, False, True)


def _blocks(problem: Problem, off, white):
    """What is left out together: its rows, (V⁻¹)_bb, V⁻¹ r and V⁻¹ J there."""
    assert problem.shared is not None
    first = 0
    for errors in problem.shared:
        rows = slice(first, first + len(errors.slope))
        solved = errors.unwhiten(errors.whiten(off[rows][:, None]))[:, 0]
        slopes = errors.unwhiten(white[rows])
        for members in errors.units():
            yield first + members, errors.precision(members), solved[members], slopes[members]
        first = rows.stop


def log_density(x, degrees: float | None) -> np.ndarray:
    """ln of Student's density, or of the normal one where the noise is known."""
    if degrees is None:
        return -0.5 * (x**2 + math.log(2 * math.pi))
    level = math.lgamma(0.5 * (degrees + 1)) - math.lgamma(0.5 * degrees)
    level -= 0.5 * math.log(math.pi * degrees)
    return level - 0.5 * (degrees + 1) * np.log1p(x**2 / degrees)


def bootstrap(fits: list[ComponentFit], count: int, seed: int, confidence: float) -> Bootstrap:
    """Simulate each point with the fitted curve and its noise, and fit that again."""
    random = np.random.default_rng(seed)
    names, values, converged = [], [], np.ones(count, bool)
    for fit in fits:
        found, arrived = _simulated(fit, count, random)
        names += [e.label for e in fit.component.elements]
        values.append(found)
        converged &= arrived
    joined = np.concatenate(values, axis=1)
    part = 100 * np.array([0.5 * (1 - confidence), 0.5 * (1 + confidence)])
    ends = (
        np.percentile(joined[converged], part, axis=0)
        if np.any(converged)
        else np.full((2, len(names)), np.nan)
    )
    intervals = {n: (float(a), float(b)) for n, a, b in zip(names, *ends, strict=True)}
    return Bootstrap(tuple(names), joined, converged, intervals)


def _simulated(fit: ComponentFit, count: int, random) -> tuple[np.ndarray, np.ndarray]:
    """Physical values of fits to data around the curve of the first stage."""
    first = fit.stages[0].problem
    curve = first.predict(fit.z[None])[0]
    if first.shared is not None:
        noise = np.concatenate([one.simulate(random, count) for one in first.shared], axis=1)
    else:
        noise = random.standard_normal((count, first.count)) * fit.uncertainty.noise.deviation[0]
    drawn = np.maximum(curve + noise, 0.0)
    z, converged = np.repeat(fit.z[None], count, axis=0), np.ones(count, bool)
    for k, stage in enumerate(fit.stages):
        if k and first.loss != "squared":
            drawn = winsorised(first, z, Lanes(restitution=drawn))
        found = _search(fit, stage.problem, z, Lanes(restitution=drawn))
        z, converged = found.z, converged & found.converged
    return fit.final.problem.transform.physical(z), converged
