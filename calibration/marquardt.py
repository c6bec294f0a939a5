"""optimistix's Levenberg–Marquardt: the whole search compiled at once, collisions included."""

from dataclasses import replace
from functools import partial

import jax
import numpy as np

from calibration import impacts, objective
from calibration.ending import Search, ended, verdict_of
from calibration.objective import KINDS
from calibration.problem import Problem

TOLERANCE = 1e-7  # of the step left: its own stopping rule looks at the cost alone


def levenberg_marquardt(problem: Problem, z, limit) -> Search:
    """Minimise from z, the searched elements of the problem."""
    searched = np.zeros(len(problem.base))
    searched[problem.active] = 1.0
    found, solved, steps = _compiled_marquardt(
        problem.full(z),
        searched,
        problem.layout,
        problem.obs,
        problem.noise,
        limit,
        KINDS.index(problem.kind),
        free=problem.free or ("chi",),  # all stages of a plain fit are one compilation
        model=problem.model,
        loss=problem.loss,
    )
    z = np.asarray(found)[problem.active]
    value, jacobian = problem.linearise(z)
    gradient = jacobian.T @ value
    reason = verdict_of(value, jacobian, gradient, TOLERANCE) or (
        "stopped short of a minimum" if bool(solved) else "iterations used up"
    )
    end = ended(problem, z, value, gradient, int(steps), reason)
    return replace(end, evaluations=int(steps) + 1)


@partial(jax.jit, static_argnames=("limit", "free", "model", "loss"))
def _compiled_marquardt(start, searched, layout, obs, noise, limit, kind, free, model, loss):
    """From `start`, along the elements that are `searched` (1 or 0; the damping bears the rest)."""
    import optimistix as optx

    def plastic(columns):
        return impacts.collisions(impacts.only_free(columns, free), obs, model)[0]

    def f(z, _):
        z = start + searched * (z - start)
        return objective.residuals(z, layout, obs, noise, plastic, model, kind, loss)[0]

    solver = optx.LevenbergMarquardt(rtol=1e-11, atol=1e-14)
    result = optx.least_squares(f, solver, start, max_steps=limit, throw=False)
    solved = result.result == optx.RESULTS.successful
    return result.value, solved, result.stats["num_steps"]
