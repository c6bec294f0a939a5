"""How closely a curve follows a data set, and what is known of the set's errors."""

import numpy as np

from calibration.data import RestitutionData
from calibration.fitting.component_fit import ComponentFit
from calibration.fitting.intervals import weighted_deviation
from calibration.fitting.material import Goodness, Outlier
from calibration.fitting.problem import Problem
from calibration.fitting.uncertainty import leverages
from calibration.observables import RESTITUTION

RARE = 0.05  # probability that the farthest of n normal errors is named
MOST_OUTLIERS = 100  # of one data set
ROUNDING = 1e-9  # of ε: residuals below are none


def goodness_of(fit: ComponentFit, place: int) -> dict[str, Goodness]:
    """Of each observable of the data set at a place of a component."""
    blocks = fit.final.problem.blocks
    return {b.observable: _of_block(fit, k) for k, b in enumerate(blocks) if b.set == place}


def _of_block(fit: ComponentFit, k: int) -> Goodness:
    problem = fit.final.problem
    own = problem.own[k]
    found = problem.linearise(fit.z[None])
    leverage = leverages(found.jacobian)[0, : problem.count][own]
    left = float(max(len(leverage) - np.sum(leverage), 0.0))
    weighted = found.residual[0, : problem.count][own]
    spread = weighted_deviation(fit, problem)[own]
    allowed = np.sqrt(np.maximum(1 - leverage, 1e-12)) * np.where(spread > 0, spread, 1.0)
    first = fit.stages[0].problem  # which knows what the points share
    off = found.prediction[0][own] - problem.points.value[own]
    timing = first.variances[k].get("timing")
    nu = first.errors[k].nu(first.variances[k])
    return Goodness(
        float(np.sqrt(np.mean(off**2))),
        _reduced(first, k, fit.z, off, left),
        _variances(first, k, fit.z),
        None if timing is None else float(timing) ** 0.5,
        None if nu is None else float(nu),
        _outliers(first, k, fit.z, off, leverage),
        tuple(map(float, weighted / allowed)),
        tuple(map(float, leverage)),
        left,
    )


def _outliers(first: Problem, k: int, z: np.ndarray, off, leverage) -> tuple[Outlier, ...]:
    """Points beyond `RARE`: the one of n points that noise sends so far once in twenty data sets."""
    from scipy import special

    errors, s, block = first.errors[k], first.variances[k], first.blocks[k]
    carried, own = first.carried(z[None])[k], block.own
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
    limit, nu = special.ndtri(1 - 0.5 * RARE / len(off)), errors.nu(s)
    # noise of no more than rounding, of data without scatter, explains nothing and names nothing
    size = np.where((spread > ROUNDING) & (np.max(np.abs(off)) > ROUNDING), size, 0.0)
    weight = np.ones(len(off)) if nu is None else (nu + 1) / (nu + residual**2) * nu / (nu + 1)
    found = [i for i in np.argsort(-size, kind="stable") if size[i] > limit]
    data = first.datasets[block.set]
    lines = data.origin.lines if data.origin is not None else None
    rows = _rows(data, block.observable)
    values = (first.points.value * first.points.unit)[own]
    return tuple(
        Outlier(
            int(rows[i]) + 1,
            None if lines is None or rows[i] >= len(lines) else int(lines[rows[i]]),
            float(first.points.velocity[own][i]),
            float(values[i]),
            float(residual[i]),
            float(weight[i]),
            block.observable,
        )
        for i in found[:MOST_OUTLIERS]
    )


def _rows(data: RestitutionData, observable: str) -> np.ndarray:
    """Which impacts have a value of an observable."""
    if observable == RESTITUTION:
        return np.flatnonzero(np.isfinite(data.restitution))
    return next(one.rows for one in data.observed if one.name == observable)


def _reduced(first: Problem, k: int, z: np.ndarray, off, left: float) -> float | None:
    """χ² over its degrees of freedom, of errors as they are stated; None where they are not all that is."""
    errors = first.errors[k]
    told = errors.is_stated or errors.unknown == ("scale",)
    if errors.points.uncertainty is None or left < 1 or not told or errors.dof is not None:
        return None
    carried = first.carried(z[None])[k]
    s = {**first.variances[k], "scale": 1.0}
    factor = errors.factor(s, carried.slope, carried.bend)
    return float(np.sum(errors.whiten(factor, off[None, :, None]) ** 2)) / left


def _variances(problem: Problem, k: int, z: np.ndarray) -> dict[str, float]:
    """Mean variances of a point, by where they come from."""
    errors, s = problem.errors[k], problem.variances[k]
    carried = problem.carried(z[None])[k]
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
