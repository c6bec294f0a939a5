"""The variances of a problem, estimated at some place of its parameters, and when they have converged.

A search minimises with the variances as they are; then they are estimated from the residuals where it ended,
and it goes on, until they change by less than 1e-5. Where one scatter is all that is unknown it moves nothing
but the scale of the cost, and is estimated once.

>>> import calibration as cal
>>> from calibration.fitting.request import Request, assemble
>>> data = cal.RestitutionData([1.0, 1.0, 1.0, 1.0], [0.84, 0.86, 0.90, 0.88])
>>> (component,) = assemble(Request((data,)).with_options(law="constant"))
>>> _, problem = component.stages[0]
>>> needs_variances(problem)
False
>>> at_mean = problem.transform.unconstrained(np.array([0.87]))
>>> update_variances(first_variances(problem, at_mean), at_mean).variances[0]["scatter"].__round__(6)
0.000667
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float

from calibration.fitting.errors import Errors
from calibration.fitting.pools import estimate_of_pool
from calibration.fitting.problem import Problem
from calibration.fitting.rows import Batch
from calibration.fitting.variances import estimated

FIRST_GROUP = 0.1  # of the variance of a point, offsets of groups where a search begins
CONVERGED = (
    1e-5  # relative change of a variance, or of a spread: intervals show no more than four digits
)


def needs_variances(problem: Problem) -> bool:
    """Whether variances are found together with the parameters, as something is weighed against them."""
    if all(is_single_variance(problem, g) for g in range(len(problem.errors))):
        return False
    return any(errors.unknown for errors in problem.errors) or bool(problem.pools)


def is_single_variance(problem: Problem, g: int) -> bool:
    """Whether one scatter is all that is unknown of a block, and nothing is weighed against it."""
    priors = bool(problem.pools) or any(e.parameter.prior is not None for e in problem.elements)
    several = problem.joint and len(problem.errors) > 1
    errors = problem.errors[g]
    return errors.is_plain and errors.noise.is_least_squares and not (priors or several)


def first_variances(problem: Problem, z: np.ndarray) -> Problem:
    """First estimate of the variances, from the residuals at z."""
    starts = []
    first = problem.bare.linearise(z[None], slopes=False).prediction[0]
    for errors, span in zip(problem.errors, problem.spans, strict=True):
        square = max(float(np.mean((first - problem.points.value)[span] ** 2)), 1e-30)
        of_second = float(np.mean(errors.variance({"timing": 1.0}, 0.0, 0.0) + np.zeros(1)))
        guess = {
            "scatter": 1.0 if errors.unknown == ("scatter",) and errors.is_plain else square,
            "group": square,
            "scale": 1.0,
            "timing": square / max(of_second, 1e-300),
        }
        starts.append({kind: guess[kind] for kind in errors.unknown})
    problem = replace(problem, variances=tuple(starts))
    return update_variances(problem, z) if needs_variances(problem) else problem


def with_level(problem: Problem) -> Problem | None:
    """The problem with offsets of groups too small to carry the curve's level; None without groups.

    Far from the points residuals have a mean that an estimate takes for offsets, and these leave the level free:
    a search may end there, and another that begins with the level does not.
    """
    if not any("group" in s for s in problem.variances):
        return None
    pairs = zip(problem.errors, problem.variances, strict=True)
    return replace(problem, variances=tuple(_with_level(*pair) for pair in pairs))


def _with_level(errors: Errors, s: Mapping[str, Any]) -> dict[str, Any]:
    if "group" not in s:
        return dict(s)
    rest = {kind: value for kind, value in s.items() if kind != "group"}
    apart = float(np.mean(errors.variance(rest, 0.0, 0.0) + np.zeros(1)))
    return {**s, "group": min(float(s["group"]), FIRST_GROUP * apart)}


def variances_at(
    problem: Problem, z: Float[np.ndarray, "fits p"], batch: Batch | None = None, restricted=True
) -> tuple[dict[str, np.ndarray], ...]:
    """s of each data set and fit, from the residuals at z."""
    before = problem.variances if batch is None or batch.variances is None else batch.variances
    estimates = []
    every = zip(problem.errors, before, problem.residuals_at(z, batch), strict=True)
    for errors, s, block in every:
        estimates.append(estimated(errors, block, restricted, s) if errors.unknown else {})
    return tuple(estimates)


def update_variances(
    problem: Problem, z: np.ndarray, restricted: bool = True, bound_side: Any = None
) -> Problem:
    """The problem with variances and spreads of pools as of z, `bound_side` as of `estimate_of_pool`."""
    if any(errors.unknown for errors in problem.errors):
        estimates = variances_at(problem, z[None], None, restricted)
        single = [{kind: float(value[0]) for kind, value in table.items()} for table in estimates]
        problem = replace(problem, variances=tuple(single))
    pools = [
        p._replace(spread=estimate_of_pool(problem, z, p, bound_side).spread) for p in problem.pools
    ]
    return replace(problem, pools=tuple(pools)) if pools else problem


def variances_converged(before: Problem, after: Problem) -> bool:
    """Whether two problems have the same variances and spreads of pools."""
    was, now = (
        [*(s[kind] for s in p.variances for kind in s), *(pool.spread for pool in p.pools)]
        for p in (before, after)
    )
    return np.allclose(was, now, rtol=CONVERGED, atol=0)
