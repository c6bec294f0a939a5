"""How closely a curve follows a data set, and what is known of the set's errors."""

from typing import Any

import numpy as np

from calibration.fitting.component_fit import ComponentFit
from calibration.fitting.intervals import weighted_deviation
from calibration.fitting.material import Outlier
from calibration.fitting.problem import Problem
from calibration.fitting.uncertainty import leverages

RARE = 0.05  # probability that the farthest of n normal errors is named
MOST_OUTLIERS = 100  # of one data set
ROUNDING = 1e-9  # of ε: residuals below are none


def goodness_of(fit: ComponentFit, place: int) -> dict[str, Any]:
    """Fields of the `MaterialFit` of the data set at a place of a component."""
    problem = fit.final.problem
    own = problem.points.set == place
    data = problem.datasets[place]
    found = problem.linearise(fit.z[None])
    leverage = leverages(found.jacobian)[0, : problem.count][own]
    left = float(max(len(data) - np.sum(leverage), 0.0))
    weighted = found.residual[0, : problem.count][own]
    spread = weighted_deviation(fit, problem)[own]
    allowed = np.sqrt(np.maximum(1 - leverage, 1e-12)) * np.where(spread > 0, spread, 1.0)
    first = fit.stages[0].problem  # which knows what the points share
    off = found.prediction[0][own] - problem.points.restitution[own]
    timing = first.variances[place].get("timing")
    nu = first.errors[place].nu(first.variances[place])
    return {
        "standardised": tuple(map(float, weighted / allowed)),
        "leverage": tuple(map(float, leverage)),
        "residual_degrees": left,
        "reduced_chi_squared": _reduced(first, place, fit.z, off, left),
        "variances": _variances(first, place, fit.z),
        "noise_dof": None if nu is None else float(nu),
        "outliers": _outliers(first, place, fit.z, off, leverage),
        "timing": None if timing is None else float(timing) ** 0.5,
    }


def _outliers(first: Problem, place: int, z: np.ndarray, off, leverage) -> tuple[Outlier, ...]:
    """Points beyond `RARE`: the one of n points that noise sends so far once in twenty data sets."""
    from scipy import special

    errors, s, data = first.errors[place], first.variances[place], first.datasets[place]
    carried = first.carried(z[None])[place]
    spread = np.sqrt(errors.diagonal(s, carried.slope, carried.bend) + np.zeros((1, len(errors))))[
        0
    ]
    if errors.shares:  # without what the others of its group tell
        solved = errors.solve(errors.factor(s, carried.slope, carried.bend), off[None, :, None])
        factor = errors.factor(s, carried.slope, carried.bend)
        residual = -(solved[0, :, 0] / np.sqrt(errors.precisions(factor).reshape(-1)))
    else:
        residual = -off / spread
    size = np.abs(residual) / np.sqrt(np.maximum(1 - leverage, 1e-3))
    limit, nu = special.ndtri(1 - 0.5 * RARE / len(data)), errors.nu(s)
    # noise of no more than rounding, of data without scatter, explains nothing and names nothing
    size = np.where((spread > ROUNDING) & (np.max(np.abs(off)) > ROUNDING), size, 0.0)
    weight = np.ones(len(data)) if nu is None else (nu + 1) / (nu + residual**2) * nu / (nu + 1)
    found = [k for k in np.argsort(-size, kind="stable") if size[k] > limit]
    lines = data.origin.lines if data.origin is not None else None
    return tuple(
        Outlier(
            int(k) + 1,
            None if lines is None or k >= len(lines) else int(lines[k]),
            float(data.velocity[k]),
            float(data.restitution[k]),
            float(residual[k]),
            float(weight[k]),
        )
        for k in found[:MOST_OUTLIERS]
    )


def _reduced(first: Problem, place: int, z: np.ndarray, off, left: float) -> float | None:
    """χ² over its degrees of freedom, of errors as they are stated; None where they are not all that is."""
    errors, data = first.errors[place], first.datasets[place]
    told = errors.is_stated or errors.unknown == ("scale",)
    if data.uncertainty is None or left < 1 or not told or errors.dof is not None:
        return None
    carried = first.carried(z[None])[place]
    s = {**first.variances[place], "scale": 1.0}
    factor = errors.factor(s, carried.slope, carried.bend)
    return float(np.sum(errors.whiten(factor, off[None, :, None]) ** 2)) / left


def _variances(problem: Problem, place: int, z: np.ndarray) -> dict[str, float]:
    """Mean variances of a point, by where they come from."""
    errors, s = problem.errors[place], problem.variances[place]
    carried = problem.carried(z[None])[place]
    found = {kind: float(s[kind]) for kind in ("scatter", "group") if kind in s}
    bare = {kind: value for kind, value in s.items() if kind not in ("scatter", "group")}
    rest = float(
        np.mean(errors.variance(bare, carried.slope, carried.bend) + np.zeros(len(errors)))
    )
    if rest <= 0:
        return found
    kinds = [kind for kind in ("scale", "timing") if kind in s]
    name = kinds[0] if kinds else "stated" if errors.degrees is None else "repeats"
    return {name: rest} | found
