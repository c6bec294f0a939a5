"""Jumps of the cost: ε jumps at yield, and a fit that moves yield takes points from one side to the other.

Between two jumps the cost is smooth: its minimum has no gradient, or is at a jump.
"""

import numpy as np
from jaxtyping import Float

from calibration.fitting.problem import Problem

# Measured on three fits of 26 points with a free yield strength: each value tried found the same
# minima.

BESIDE = 1e-9  # of a parameter: how far from a jump it is put; tried 1e-12 and 1e-6
# factor on the critical velocity within which jumps are looked at; 1.2 takes 0.4x the evaluations,
# 6 takes 2.3x
AROUND = 2.0
MOST = 16  # of them, along an element; 4 takes 0.6x the evaluations, 64 as many
TRIED = 1e-3  # step in z that shows how the critical velocity moves; tried 1e-6 and 0.1


def beside_jumps(
    problem: Problem, z: Float[np.ndarray, " elements"]
) -> Float[np.ndarray, "places elements"]:
    """Places on both sides of the jumps around z, along each element that yield moves with."""
    places = [z[None][:0]]
    yield_elements = (
        np.zeros(len(z), bool) if problem.affects_yield is None else problem.affects_yield
    )
    for k in problem.active[yield_elements[problem.active]]:
        of_sets = np.flatnonzero(np.isin(problem.points.set, problem.elements[k].sets))
        both, part = np.tile(z, (2, 1)), problem.transform.part([k])
        both[1, k] += TRIED * max(abs(z[k]), TRIED)
        value, moved = part.physical(both[:, [k]])[:, 0]
        here, there = np.asarray(problem.yields_at(both, of_sets))
        with np.errstate(divide="ignore", invalid="ignore"):
            power = np.log(there / here) / np.log(moved / value)
            ratio = problem.points.velocity[of_sets] / here
            factor = ratio ** (1 / power)
        near = (power != 0) & (np.abs(np.log(ratio)) < np.log(AROUND))
        factor = np.unique(factor[near & np.isfinite(factor)])
        factor = factor[np.argsort(np.abs(np.log(factor)))]
        if len(factor) > MOST:  # the nearest, and some of the others
            rest = np.linspace(MOST // 2, len(factor) - 1, MOST - MOST // 2)
            factor = factor[[*range(MOST // 2), *rest.astype(int)]]
        sides = value * np.outer(factor, [1 - BESIDE, 1 + BESIDE]).ravel()
        sides = sides[(sides > part.lower) & (sides < part.upper)]
        along = np.repeat(z[None], len(sides), axis=0)
        along[:, k] = part.unconstrained(sides[:, None])[:, 0]
        places.append(along)
    return np.concatenate(places)
