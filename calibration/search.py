"""The optimisers behind one door: optax L-BFGS and Adam, optimistix Levenberg–Marquardt."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from calibration.ending import FARTHEST, Search, at_limit
from calibration.lbfgs import lbfgs
from calibration.problem import Problem

OPTIMISERS = {
    "l-bfgs": "optax L-BFGS",
    "adam": "optax Adam, then L-BFGS",
    "levenberg-marquardt": "optimistix Levenberg–Marquardt",
}
MAX_ITERATIONS = 200
BRANCH_ROUNDS = 10


def search(
    problem: Problem,
    z,
    optimiser: str = "l-bfgs",
    step: Callable | None = None,
    limit: int = MAX_ITERATIONS,
) -> Search:
    """Minimise from z; `step(cost)` is called after every iteration.

    What runs to an end of its range is held there, and the rest searched on.
    """
    problem.counter.evaluations = 0
    start = np.array(z, float)
    found = _searched(problem, start, optimiser, step, limit)
    gone = at_limit(problem, start, found)
    if not np.any(gone):
        return found
    z = np.where(gone, np.clip(found.z, start - FARTHEST, start + FARTHEST), found.z)
    rest = replace(problem.at(z), active=problem.active[~gone])
    last = lbfgs(rest, rest.start, step, limit)
    z[~gone] = last.z
    return replace(
        last,
        z=z,
        evaluations=problem.counter.evaluations,
        iterations=found.iterations + last.iterations,
        limits=tuple(int(position) for position in problem.active[gone]),
    )


def _searched(problem: Problem, z, optimiser: str, step, limit: int) -> Search:
    if optimiser == "levenberg-marquardt":
        from calibration.marquardt import levenberg_marquardt

        return levenberg_marquardt(problem, z, limit)
    if optimiser == "adam":
        from calibration.adam import ADAM_STEPS, adam

        found = lbfgs(problem, adam(problem, z, step), step, limit)
        return replace(found, iterations=found.iterations + ADAM_STEPS)
    return lbfgs(problem, z, step, limit)


def search_with_branches(problem: Problem, z, optimiser: str, step=None, limit=MAX_ITERATIONS):
    """As `search`, with the elastic points held during a search and looked at again after it.

    A yield strength or modulus that is free moves points across y = 1, where the cost jumps.
    Returns the search, its problem, and how many points changed branch since the start.
    """
    first = problem.obs.elastic
    total = 0
    for _ in range(BRANCH_ROUNDS):
        found = search(problem, z, optimiser, step, limit)
        total += found.evaluations
        z = found.z
        elastic = problem.elastic_at(problem.full(z))
        if problem.kind != "model" or np.array_equal(elastic, problem.obs.elastic):
            changed = int(np.sum((elastic != first) & (problem.obs.weight > 0)))
            return replace(found, evaluations=total), problem, changed
        problem = problem.with_elastic(elastic)
    changed = int(np.sum((elastic != first) & (problem.obs.weight > 0)))
    stuck = "points keep crossing the critical velocity"
    return replace(found, evaluations=total, converged=False, reason=stuck), problem, changed
