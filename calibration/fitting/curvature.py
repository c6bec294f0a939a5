"""Second derivatives of the cost: the observed information of the parameters.

They are differences of the exact gradient g = Jᵀ r along directions w, of fourth order with a step h of 2e-3 in z,

    wᵀ ∂g/∂z ≈ [8 (g(z + h w) - g(z - h w)) - (g(z + 2 h w) - g(z - 2 h w))]/(12 h)

all in one batch: no second derivative of a time integration is compiled, and the error stays near 1e-11. The points
at -2h … 2h, with their weights, differentiate polynomials up to the fourth power without error: of x⁴ at 1

>>> places, weights = BOTH_SIDES
>>> round(float(weights @ (1 + DIFFERENCE * places) ** 4) / DIFFERENCE, 10)
4.0

Where ε jumps at yield the cost jumps with it: steps are halved until they pass no jump, or go to one side of it.
"""

import numpy as np
from jaxtyping import Float

from calibration.fitting.methods import TINY
from calibration.fitting.problem import Problem
from calibration.parameters import NONE

# step in z of the differences: rounding and truncation of the gradient are both 1e-11; 2e-4 and
# 2e-2 move standard errors of nine fits by up to 1.4e-7 and 8e-6
DIFFERENCE = 2e-3
# places of these differences and their weights: on both sides, and of third order on one
BOTH_SIDES = np.array([-2.0, -1.0, 1.0, 2.0]), np.array([1.0, -8.0, 8.0, -1.0]) / 12
ONE_SIDE = np.arange(4.0), np.array([-11.0, 18.0, -9.0, 2.0]) / 6
# how often a step is halved that would pass a jump; 3 gives the same errors of three fits
SHORTER = 12
MOST = 4_000_000  # impacts of second derivatives: a second, at 0.23 µs each (`compiling`)
BY_TIME = 0.1  # of these where each is integrated over time: value and gradient take 7 µs in place of 0.08
NUMBERS = 20_000_000  # of Jacobians that are in memory at once: 160 MB


def gradient_slopes(
    problem: Problem, z, ways: Float[np.ndarray, "n elements"], longest: float = np.inf
) -> Float[np.ndarray, "n p"]:
    """Derivatives of the gradient Jᵀ r along some directions.

    Args:
        ways: the directions, of lengths that change the cost by about one.
        longest: step, in these lengths.
    """
    scaled = problem.transform.kind != NONE
    moved = np.abs(ways) / np.where(scaled, 1.0, np.maximum(np.abs(z), 1e-6))
    steps = np.minimum(DIFFERENCE / np.maximum(np.max(moved, axis=1), TINY), longest)
    sides, weights = (np.tile(a, (len(ways), 1)) for a in BOTH_SIDES)
    if problem.jumps:
        for k, way in enumerate(ways):
            steps[k], sides[k], weights[k] = _between_jumps(problem, z, way, steps[k])
    flat = (z + steps[:, None, None] * ways[:, None] * sides[..., None]).reshape(-1, len(z))
    most = max(1, NUMBERS // (problem.count * max(len(problem.active), 1)))
    gradient = np.concatenate(
        [problem.linearise(flat[k : k + most]).gradient for k in range(0, len(flat), most)]
    ).reshape(len(ways), 4, -1)
    return np.einsum("ns,nsp->np", weights, gradient) / steps[:, None]


def _between_jumps(problem: Problem, z, way, step: float):
    """The longest step of differences along a way that passes no jump, their places and weights."""
    (sides, weights), here = ONE_SIDE, problem.is_elastic_at(z[None])
    for _ in range(SHORTER):
        for at, factors in (BOTH_SIDES, ONE_SIDE, (-sides, -weights)):
            if np.all(problem.is_elastic_at(z + step * at[:, None] * way) == here):
                return step, at, factors
        step *= 0.5
    return step, *ONE_SIDE


def has_network(problem: Problem) -> bool:
    """Whether numbers of an array are searched, such as a network's weights."""
    return any("[" in problem.elements[k].name for k in problem.active)


def asks_for_curvature(problem: Problem) -> bool:
    """Whether second derivatives are taken: not of a network, and not where they would take long."""
    if has_network(problem) or not len(problem.active):
        return False
    impacts = 4 * len(problem.active) * problem.count * (5 if problem.has_velocity_errors else 1)
    return impacts <= MOST * (BY_TIME if problem.collided_by.by_time else 1.0)
