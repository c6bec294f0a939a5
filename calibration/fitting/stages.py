"""One stage of a fit: the lowest minimum of a problem, together with the variances of where it is.

A search minimises the cost for given variances of the noise, which are then estimated where it ended, until both stay
(`estimate_variances`). Four values of ε around their mean 0.87, whose scatter is unknown: the cost ½ Σ r²/s with the
restricted s = 0.002/3 is 1.5, half the degrees of freedom.

>>> import calibration as cal
>>> from calibration.fitting.request import Request, assemble
>>> data = cal.RestitutionData([1.0, 1.0, 1.0, 1.0], [0.84, 0.86, 0.90, 0.88])
>>> request = Request((data,)).with_options(law="constant", starts=1)
>>> (component,) = assemble(request)
>>> stage = run_stage(*component.stages[0], component.start, request.options)
>>> round(float(stage.problem.transform.physical(stage.z)[0]), 4), round(float(stage.ends.cost[0]), 4)
(0.87, 1.5)
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import softjax as sj
from calibration.fitting.minima import distinct_minima, over_jumps, searched, tied
from calibration.fitting.pools import estimate_of_pool
from calibration.fitting.problem import Problem
from calibration.fitting.search import (
    OPTIMISERS,
    Ends,
    search,
)
from calibration.fitting.variance_updates import (
    first_variances,
    needs_variances,
    update_variances,
    variances_converged,
    with_level,
)
from calibration.options import FitOptions
from calibration.parameters import NONE
from calibration.rounding import to_digits
from calibration.schema import Real

# of -2 ln p: of ends that agree to these the one found first is taken, on any machine; no effect
# from 5 to 13 on 8 fits of groups, extra scatter and the like
DEVIANCE_DIGITS = 9
# of variances and searches in turn, and of jumps at yield; 8 were enough for these fits
ROUNDS = 30
# in z: an element this far from its start may act on nothing any more; no effect on these from 1.5
# (1.1x) on
RUN_OUT = 5.0
UNSETTLED = "variances keep changing"


@dataclass(frozen=True)
class Stage:
    """Record of a stage, a row of the report; `materials` are its data sets."""

    stage: str
    materials: tuple[str, ...]
    optimiser: str
    route: str
    evaluations: int
    iterations: int
    gradient_norm: float | None
    cost: Real
    converged: bool
    reason: str
    starts: int


@dataclass(frozen=True)
class StageFit:
    """Result of a stage."""

    problem: Problem  # with the variances at its end
    z: np.ndarray  # of the whole component
    ends: Ends  # the search that ended there, of one fit
    others: tuple[Ends, ...]  # where the other starts ended
    report: Stage  # what it took
    single_search: bool  # whether one search alone of many ended so low, and misses the points

    @property
    def bound_side(self) -> np.ndarray:
        """+1 or -1 for active elements that are fixed at an end of their range, else 0."""
        return self.ends.bound_side[0]


def run_stage(
    name: str, problem: Problem, z: np.ndarray, options: FitOptions, ends: list[Ends] | None = None
) -> StageFit:
    """Minimise from the best starts, and estimate the variances there.

    Args:
        ends: of the searches from these starts, where they were made already.
    """
    evaluated = 0 if ends else problem.evaluated[0]
    problem = first_variances(problem, z)
    unsettled = needs_variances(problem)
    ends, single_search = searched(problem, z, options, ends)
    if (level := with_level(problem)) is not None:
        first, *more = searched(level, z, options, None)[0]
        ends = [ends[0], first, *ends[1:], *more]
    best, others = ends[0], ends[1:]
    if unsettled:
        candidates = [*distinct_minima(ends), *tied(problem, z, options)]
        problem, best, *others = _lowest(problem, candidates, options)
        is_scaled = problem.transform.kind != NONE
        if np.any(np.abs(best.z[0] - z)[is_scaled] > RUN_OUT):
            # while variances were large a loss might go to nothing, and is too flat there to come back
            again = search(problem, z[None], options.optimiser, limit=options.max_steps)
            problem, best, higher = _lowest(problem, [best, again], options)
            others.append(higher)
    if unsettled and problem.jumps:
        for _ in range(ROUNDS):  # with the variances as they are now
            lower = over_jumps(problem, [best], options)[0]
            if lower is best:
                break
            problem, best = estimate_variances(problem, lower, options)
    norm, law = float(best.gradient_norm[0]), problem.laws.model.law_type
    report = Stage(
        stage=name,
        materials=tuple(data.name for data in problem.datasets),
        optimiser=OPTIMISERS[options.optimiser],
        route="closed form" if issubclass(law, sj.HardSphereLaw) else problem.collided_by.name,
        evaluations=int(problem.evaluated[0] - evaluated),
        iterations=int(best.iterations[0]),
        gradient_norm=norm if np.isfinite(norm) else None,
        cost=float(best.cost[0]),
        converged=bool(best.converged[0]),
        reason=str(best.reason[0]),
        starts=options.starts if len(problem.active) else 1,
    )
    if not unsettled and any(errors.unknown for errors in problem.errors):
        problem, best = _in_units(problem, best)
    return StageFit(
        problem,
        best.z[0],
        best,
        tuple(others),
        report,
        single_search=single_search,
    )


def _in_units(problem: Problem, end: Ends) -> tuple[Problem, Ends]:
    """Problem and search in units of the noise, which was weighed against nothing."""
    problem = update_variances(problem, end.z[0])
    if len(problem.errors) > 1:  # each set weighs as it did
        points = problem.points._replace(copies=problem.diagonal(end.z)[0])
        return replace(problem, points=points), end
    scale = 1 / problem.variances[0]["scatter"]
    norm = scale * end.gradient_norm
    return problem, end._replace(cost=scale * end.cost, gradient_norm=norm)


def _lowest(problem: Problem, ends: list[Ends], options: FitOptions) -> tuple[Any, ...]:
    """The problem and the end of the highest likelihood, each with its own variances; then the others."""
    estimated = [estimate_variances(problem, end, options) for end in ends]
    (problem, best), *others = sorted(estimated, key=lambda each: _minus_two_log(*each))
    return problem, best, *(end for _, end in others)


def _minus_two_log(problem: Problem, end: Ends) -> float:
    """-2 ln p(data | θ, s) p(θ) where a search ended, over all members of pools, to `DEVIANCE_DIGITS`."""
    linear = problem.linearise(end.z, slopes=False)
    priors = linear.residual[:, problem.count : linear.residual.shape[1] - problem.more]
    pools = [(estimate_of_pool(problem, end.z[0], p, end.bound_side[0]), p) for p in problem.pools]
    spreads = sum(estimate.minus_two_log(pool.spread) for estimate, pool in pools)
    total = float(problem.deviance(end.z)[0] + np.sum(priors**2) + spreads)
    return to_digits(total, DEVIANCE_DIGITS)


def estimate_variances(problem: Problem, end: Ends, options: FitOptions, restricted: bool = True):
    """Search again until the variances are those of where the search ends: the problem, and the end."""
    for _ in range(ROUNDS):
        adapted = update_variances(problem, end.z[0], restricted, end.bound_side[0])
        if variances_converged(adapted, problem):
            return problem, end
        problem = adapted
        optimiser, most = options.optimiser, options.max_steps
        # what is at an end of its range stays there: it was looked at when the search arrived
        again = search(
            problem, end.z, optimiser, reference_start=end.reference_start, limit=most, releases=0
        )
        end = again._replace(iterations=end.iterations + again.iterations)
    if not variances_converged(
        update_variances(problem, end.z[0], restricted, end.bound_side[0]), problem
    ):
        end = end._replace(converged=np.array([False]), reason=np.array([UNSETTLED]))
    return problem, end
