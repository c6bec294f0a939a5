"""Many fits of one problem side by side: without each point, and to simulated data."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from calibration.fitting.component_fit import ComponentFit
from calibration.fitting.noise import is_stated, leverages
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
    by_time = fit.final.report.route == "ode"
    if problem.count**2 <= (EXACT_BY_TIME if by_time else EXACT):
        z, converged = _refitted_without(fit)
        return _scored(fit, z, converged)
    return _continued(fit)


def _groups(problem: Problem) -> list[np.ndarray]:
    """What is left out together: a point, or all of a group where the data have groups."""
    found: list[np.ndarray] = []
    for g, data in enumerate(problem.datasets):
        rows = np.flatnonzero(problem.points.set == g)
        labels = getattr(data, "group", None)
        if labels is None:
            found += [rows[k : k + 1] for k in range(len(rows))]
        else:
            found += [rows[np.asarray(labels) == label] for label in dict.fromkeys(labels)]
    return found


def _refitted_without(fit: ComponentFit):
    """z of the fit without each group, through all stages; and which of them arrived."""
    groups = _groups(fit.final.problem)
    z = np.repeat(fit.z[None], len(groups), axis=0)
    converged = np.ones(len(groups), bool)
    for stage in fit.stages:
        weight = np.repeat(stage.problem.points.weight[None], len(groups), axis=0)
        for lane, rows in enumerate(groups):
            weight[lane, rows] = 0.0
        found = _search(fit, stage.problem, z, Lanes(weight=weight))
        z, converged = found.z, converged & found.converged
    return z, converged


def _search(fit: ComponentFit, problem: Problem, z, lanes: Lanes) -> Found:
    return search(problem, z, begun=fit.begun, lanes=lanes, limit=STEPS)


def _scored(fit: ComponentFit, z, converged) -> LeaveOneOut:
    """Predictions and densities of what each refit left out."""
    problem, groups = fit.final.problem, _groups(fit.final.problem)
    predicted, density = np.empty(problem.count), np.empty(problem.count)
    measured = np.concatenate([data.restitution for data in problem.datasets])
    most = max(1, EXACT // problem.count)
    for first in range(0, len(groups), most):
        lanes = range(first, min(first + most, len(groups)))
        found = problem.linearise(z[lanes.start : lanes.stop])
        for k, lane in enumerate(lanes):
            rows = groups[lane]
            predicted[rows] = found.prediction[k, rows]
            density[rows] = _densities(fit, found.prediction[k], found.jacobian[k], rows)
    residual = predicted - measured
    return LeaveOneOut(predicted, residual, density, True, bool(np.all(converged)))


def _densities(fit: ComponentFit, prediction, jacobian, rows) -> np.ndarray:
    """ln of the predictive density of the points `rows` by a fit to all others."""
    problem = fit.final.problem
    weight = problem.points.weight
    weighted = (prediction - problem.points.restitution) * weight
    others = np.ones(problem.count, bool)
    others[rows] = False
    used = jacobian[: problem.count][others]
    scale, degrees = _scale(fit, weighted, others)
    size = np.linalg.norm(used, axis=0)
    size = np.where(size > 0, size, 1.0)
    inverse = np.linalg.pinv(used / size, rcond=1e-9)
    known = np.sum((jacobian[rows] / size @ inverse) ** 2, axis=1)  # variance of the mean over scale²
    deviation = scale * np.sqrt(1 + known)
    return log_density(weighted[rows] / deviation, degrees) - np.log(deviation / weight[rows])


def _scale(fit: ComponentFit, weighted, others) -> tuple[float, float | None]:
    """Standard deviation of a weighted residual, from the other points where it is not stated."""
    problem = fit.final.problem
    if all(is_stated(data) for data in problem.datasets):
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
    stated = all(is_stated(data) for data in problem.datasets)
    degrees = max(problem.count - 1 - float(np.sum(leverage)), 1.0)
    squares = max(float(np.sum(weighted**2)), 1e-300) - weighted * without
    scale = np.ones(problem.count) if stated else np.sqrt(np.maximum(squares, 1e-300) / degrees)
    deviation = scale / np.sqrt(np.maximum(1 - leverage, 1e-12))
    own = log_density(without / deviation, None if stated else degrees)
    density = own - np.log(deviation / problem.points.weight)
    residual = without / problem.points.weight
    predicted = residual + problem.points.restitution
    return LeaveOneOut(predicted, residual, density, False, True)


def log_density(x: np.ndarray, degrees: float | None) -> np.ndarray:
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
    ends = np.percentile(joined[converged], part, axis=0) if np.any(converged) else np.full((2, len(names)), np.nan)
    intervals = {n: (float(a), float(b)) for n, a, b in zip(names, *ends, strict=True)}
    return Bootstrap(tuple(names), joined, converged, intervals)


def _simulated(fit: ComponentFit, count: int, random) -> tuple[np.ndarray, np.ndarray]:
    """Physical values of fits to data around the curve of the first stage."""
    first = fit.stages[0].problem
    curve = first.predict(fit.z[None])[0]
    noise = random.standard_normal((count, first.count)) * fit.uncertainty.noise.deviation[0]
    drawn = np.maximum(curve + noise, 0.0)
    z, converged = np.repeat(fit.z[None], count, axis=0), np.ones(count, bool)
    for k, stage in enumerate(fit.stages):
        if k and first.loss != "squared":
            drawn = winsorised(first, z, Lanes(restitution=drawn))
        found = _search(fit, stage.problem, z, Lanes(restitution=drawn))
        z, converged = found.z, converged & found.converged
    return fit.final.problem.transform.physical(z), converged
