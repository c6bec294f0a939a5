"""How closely a curve follows a data set, and what is known of the set's errors."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from calibration.fitting.component_fit import ComponentFit
from calibration.fitting.noise import leverages
from calibration.fitting.plan import ErrorPlan
from calibration.fitting.problem import Problem


@dataclass(frozen=True)
class Goodness:
    """Of one data set.

    Attributes:
        residual: curve less measurement, at the measured velocities, (n,).
        standardised: the same over its standard deviation, what the fit took of it allowed for.
        leverage: how many parameters each point pays for.
        left: degrees of freedom of the residuals.
        reduced_chi_squared: against the stated uncertainties; None without.
        variances: mean variance of ε by where it comes from: "stated" and the names of
            `set_errors.KINDS`.
        timing: standard deviation of times that was found [s]; None where that was not asked.
    """

    residual: Float[np.ndarray, "n"]
    standardised: Float[np.ndarray, "n"]
    leverage: Float[np.ndarray, "n"]
    left: float
    reduced_chi_squared: float | None
    variances: dict[str, float]
    timing: float | None


def goodness_of(fit: ComponentFit, place: int) -> Goodness:
    """Of the data set at a place of a component."""
    problem = fit.final.problem
    own = problem.points.set == place
    plan, data = problem.plans[place], problem.datasets[place]
    free = sum(fit.component.sets[place] in e.sets for e in fit.component.elements)
    left = float(max(len(data) - free, 0))
    measured = problem.as_measured().predict(fit.z[None])[0]
    found = problem.linearise(fit.z[None])
    leverage = leverages(found.jacobian)[0, : problem.count][own]
    weighted = found.residual[0, : problem.count][own]
    spread = np.ones(len(data))
    if problem.shared is None:
        spread = fit.uncertainty.noise.deviation[0, own] * problem.points.weight[own]
    allowed = np.sqrt(np.maximum(1 - leverage, 1e-12)) * np.where(spread > 0, spread, 1.0)
    return Goodness(
        residual=measured[own] - data.restitution,
        standardised=weighted / allowed,
        leverage=leverage,
        left=left,
        reduced_chi_squared=_reduced(fit, problem, place, found.prediction[0][own], left),
        variances=_variances(fit, problem, place, plan),
        timing=_timing(problem, place),
    )


def _reduced(
    fit: ComponentFit, problem: Problem, place: int, predicted, left: float
) -> float | None:
    """χ² over its degrees of freedom, of errors as they are stated."""
    data = problem.datasets[place]
    if data.uncertainty is None or left < 1:
        return None
    off = predicted - problem.points.restitution[problem.points.set == place]
    if problem.shared is not None:
        return float(np.sum(problem.shared[place].whiten(off[:, None]) ** 2)) / left
    return float(np.sum(off**2 / _stated(problem, place))) / left


def _stated(problem: Problem, place: int) -> Float[np.ndarray, "n"]:
    """The variances that are stated, those of the velocities included."""
    data = problem.datasets[place]
    if problem.latent is None:
        return data.errors.covariance().diagonal
    at = problem.latent[place]
    return at.errors.covariance(at.slope).diagonal


def _variances(
    fit: ComponentFit, problem: Problem, place: int, plan: ErrorPlan
) -> dict[str, float]:
    """Mean variances of a point."""
    data, own = problem.datasets[place], problem.points.set == place
    if problem.shared is not None:
        return _of_shared(problem, place)
    total = float(np.mean(fit.uncertainty.noise.deviation[0, own] ** 2))
    if data.uncertainty is None:
        return {"scatter": total}
    if "scale" in plan.unknown:
        return {"scale": total}
    if "scatter" in plan.unknown:
        stated = float(np.mean(_stated(problem, place)))
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
