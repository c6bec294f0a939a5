"""What of the errors is not stated, found from the residuals, and renewed with where a fit is."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float

from calibration.fitting.errors import Errors
from calibration.fitting.pooling import respread
from calibration.fitting.problem import Lanes, Problem
from calibration.fitting.variances import estimated

ALIKE = 1e-6  # of V_ii: variances that have settled


def needs_variances(problem: Problem) -> bool:
    """Whether variances are found together with the parameters, as something is weighed against them."""
    if all(stands_alone(problem, g) for g in range(len(problem.errors))):
        return False
    return any(one.unknown for one in problem.errors) or bool(problem.pools)


def stands_alone(problem: Problem, g: int) -> bool:
    """Whether one scatter is all that is unknown of a block, and nothing is weighed against it."""
    priors = bool(problem.pools) or any(e.parameter.prior is not None for e in problem.elements)
    several = problem.joint and len(problem.errors) > 1
    errors = problem.errors[g]
    return errors.is_plain and errors.dof is None and not (priors or several)


def first_variances(problem: Problem, z: np.ndarray) -> Problem:
    """To begin with: what z leaves unexplained."""
    off = problem.predict(z[None])[0] - problem.points.value
    pairs = zip(problem.errors, problem.own, strict=True)
    start = [_first(errors, float(np.mean(off[own] ** 2))) for errors, own in pairs]
    problem = problem.with_variances(start)
    return renewed(problem, z) if needs_variances(problem) else problem


def _first(errors: Errors, square: float) -> dict[str, float | None]:
    square = max(square, 1e-30)
    of_second = np.mean(errors.variance({"timing": 1.0}, 0.0, 0.0) + np.zeros(len(errors)))
    first = {
        "scatter": 1.0 if errors.unknown == ("scatter",) and errors.is_plain else square,
        "group": square,
        "scale": 1.0,
        "timing": square / max(float(of_second), 1e-300),
        "dof": errors.dof,
    }
    return {kind: first[kind] for kind in errors.unknown}


def variances_at(
    problem: Problem, z: Float[np.ndarray, "fits p"], lanes: Lanes | None = None, restricted=True
) -> tuple[dict[str, np.ndarray], ...]:
    """s of each data set and fit, from the residuals at z."""
    lanes = lanes or Lanes()
    before = problem.variances if lanes.variances is None else lanes.variances
    found = []
    for errors, s, seen in zip(problem.errors, before, problem.seen(z, lanes), strict=True):
        found.append(estimated(errors, seen, restricted, s) if errors.unknown else {})
    return tuple(found)


def renewed(problem: Problem, z: np.ndarray, restricted: bool = True) -> Problem:
    """The problem with variances and spreads of pools as of z."""
    if any(one.unknown for one in problem.errors):
        found = variances_at(problem, z[None], None, restricted)
        problem = problem.with_variances([_alone(one) for one in found])
    return respread(problem, z)


def with_noise(problem: Problem, z: np.ndarray) -> Problem:
    """A problem whose scatter is weighed against nothing, in units of it as z tells it."""
    found = [_alone(one) for one in variances_at(problem, z[None])]
    if problem.joint or len(problem.errors) == 1:
        return problem.with_variances(found)
    return replace(problem, variances=tuple(found))  # each set weighs as it did


def in_units(problem: Problem, z: Float[np.ndarray, "fits p"], lanes: Lanes) -> Lanes:
    """Fits side by side, each in units of its own noise: where nothing is weighed against it."""
    if lanes.variances is not None or needs_variances(problem) or problem.elastic is not None:
        return lanes
    if not any(one.unknown for one in problem.errors) or lanes.member is not None:
        return lanes
    found = variances_at(problem, z, lanes)
    if not problem.joint and len(problem.errors) > 1:
        return lanes._replace(variances=found)
    every = problem.diagonal(z, lanes._replace(variances=found))
    return lanes._replace(variances=found, weight=every**-0.5)


def have_settled(one: Problem, other: Problem) -> bool:
    """Whether two problems have the same variances and spreads of pools."""
    pools = zip(one.pools, other.pools, strict=True)
    return all(np.isclose(a.spread, b.spread, rtol=1e-5, atol=0) for a, b in pools) and all(
        _alike(errors, a, b)
        for errors, a, b in zip(one.errors, one.variances, other.variances, strict=True)
    )


def _alike(errors: Errors, one: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    """Equal in what each variance adds to that of ε."""
    if set(one) != set(other):
        return False
    whole = float(np.mean(errors.diagonal(one) + np.zeros(len(errors))))
    for kind in one:
        apart = {**one, kind: other[kind]}
        moved = float(np.mean(errors.diagonal(apart) + np.zeros(len(errors))))
        same = abs(moved - whole) <= ALIKE * whole
        if kind == "dof":
            same = abs(other[kind] - one[kind]) <= 1e-3 * one[kind]
        if not same:
            return False
    return True


def _alone(s: Mapping[str, np.ndarray]) -> dict[str, float]:
    return {kind: float(value[0]) for kind, value in s.items()}
