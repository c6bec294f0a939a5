"""How closely a curve follows a data set, and what is known of the set's errors."""

from typing import Any

import numpy as np

from calibration.fitting.component_fit import ComponentFit
from calibration.fitting.intervals import weighted_deviation
from calibration.fitting.noise import known_variances, leverages
from calibration.fitting.problem import Problem


def goodness_of(fit: ComponentFit, place: int) -> dict[str, Any]:
    """Fields of the `MaterialFit` of the data set at a place of a component."""
    problem = fit.final.problem
    own = problem.points.set == place
    data = problem.datasets[place]
    free = sum(fit.component.sets[place] in e.sets for e in fit.component.elements)
    left = float(max(len(data) - free, 0))
    found = problem.linearise(fit.z[None])
    leverage = leverages(found.jacobian)[0, : problem.count][own]
    weighted = found.residual[0, : problem.count][own]
    spread = weighted_deviation(fit, problem)[own]
    allowed = np.sqrt(np.maximum(1 - leverage, 1e-12)) * np.where(spread > 0, spread, 1.0)
    first = fit.stages[0].problem  # which knows what the points share
    return {
        "standardised": tuple(map(float, weighted / allowed)),
        "leverage": tuple(map(float, leverage)),
        "residual_degrees": left,
        "reduced_chi_squared": _reduced(first, problem, place, found.prediction[0][own], left),
        "variances": _variances(fit, first, place),
        "timing": _timing(first, place),
    }


def _reduced(first: Problem, problem: Problem, place: int, predicted, left: float) -> float | None:
    """χ² over its degrees of freedom, of errors as they are stated."""
    data = problem.datasets[place]
    if data.uncertainty is None or left < 1:
        return None
    off = predicted - problem.points.restitution[problem.points.set == place]
    if first.shared is not None:
        return float(np.sum(first.shared[place].whiten(off[:, None]) ** 2)) / left
    return float(np.sum(off**2 / known_variances(problem, place))) / left


def _variances(fit: ComponentFit, problem: Problem, place: int) -> dict[str, float]:
    """Mean variances of a point."""
    plan, data = problem.plans[place], problem.datasets[place]
    own = problem.points.set == place
    if problem.shared is not None:
        return _of_shared(problem, place)
    total = float(np.mean(fit.uncertainty.noise.deviation[0, own] ** 2))
    if data.uncertainty is None:
        return {"scatter": total}
    if "scale" in plan.unknown:
        return {"scale": total}
    if "scatter" in plan.unknown:
        stated = float(np.mean(known_variances(problem, place)))
        return {"stated": stated, "scatter": max(total - stated, 0.0)}
    return {"stated" if data.degrees is None else "repeats": total}


def _of_shared(problem: Problem, place: int) -> dict[str, float]:
    assert problem.shared is not None
    errors = problem.shared[place]
    found = {k: v for k, v in errors.variance.items() if k in ("scatter", "group")}
    rest = float(np.mean(errors.diagonal)) - sum(found.values())
    kinds = [kind for kind in ("scale", "timing") if kind in errors.variance]
    return {kinds[0] if kinds else "stated": max(rest, 0.0)} | found


def _timing(problem: Problem, place: int) -> float | None:
    if problem.shared is None or "timing" not in problem.shared[place].variance:
        return None
    return float(np.sqrt(problem.shared[place].variance["timing"]))
