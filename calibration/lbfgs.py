"""optax's L-BFGS for least squares, preconditioned by the Gauss–Newton matrix."""

from functools import lru_cache

import jax
import numpy as np

from calibration.ending import RAN_AWAY, Search, ended, ran_away, verdict_of, whitening
from calibration.parameters import NONE
from calibration.problem import Problem

LARGEST_STEP = 1.5  # in log units
PERIOD = 6  # steps between two preconditionings
FIRST_DAMPING, LARGEST_DAMPING = 1e-2, 1e6  # of the Gauss–Newton matrix with unit diagonal
ROUNDING = 1e-13  # of a cost: near its minimum steps are judged by the gradient alone


def lbfgs(problem: Problem, z, step, limit: int) -> Search:
    """L-BFGS in variables in which the damped Gauss–Newton matrix is one, renewed now and then.

    That makes its first step Levenberg's and leaves what the curvature of the residuals changes to
    L-BFGS's memory. Far from a minimum the damping grows with every step that had to be shortened.
    """
    start = z = np.array(z, float)
    value, jacobian = problem.linearise(z)
    damping, age = FIRST_DAMPING, 0
    for iteration in range(limit):
        gradient = jacobian.T @ value
        verdict = verdict_of(value, jacobian, gradient)
        if not verdict and np.any(ran_away(problem, start, z)):
            verdict = RAN_AWAY
        if verdict:
            return ended(problem, z, value, gradient, iteration, verdict)
        if age % PERIOD == 0:
            basis = whitening(jacobian, damping)
            memory = _lbfgs_memory(padded(basis.shape[1]))
        direction, memory = _lbfgs_direction(basis.T @ gradient, memory, basis, z)
        if gradient @ direction >= 0:
            direction = -basis @ (basis.T @ gradient)
        moved, length = _backtrack(problem, z, value, gradient, direction)
        age += 1
        if length < 1:
            damping, age = min(damping * 10, LARGEST_DAMPING), 0
        else:
            damping *= 0.2
        if moved is not None:
            z, value, jacobian = moved
        elif damping >= LARGEST_DAMPING:
            return ended(problem, z, value, gradient, iteration, "no lower cost found")
        if step:
            step(0.5 * float(value @ value))
    gradient = jacobian.T @ value
    return ended(problem, z, value, gradient, limit, "iterations used up")


def _backtrack(problem, z, value, gradient, direction):
    """The first of ever shorter steps that lowers the cost enough (Armijo), and its length.

    None, 0 where there is none.
    """
    cost = 0.5 * float(value @ value)
    plain = problem.layout.kind[problem.active] == NONE
    unit = np.where(plain, np.maximum(np.abs(z), 1.0), 1.0)
    longest = np.max(np.abs(direction) / unit, initial=0.0)
    length = min(1.0, LARGEST_STEP / max(longest, 1e-300))
    for _ in range(8):
        trial = z + length * direction
        new_value, new_jacobian = problem.linearise(trial)
        new_cost = 0.5 * float(new_value @ new_value)
        if new_cost <= cost * (1 + ROUNDING) + 1e-4 * length * float(gradient @ direction):
            return (trial, new_value, new_jacobian), length
        length *= 0.25
    return None, 0.0


def padded(count: int) -> int:
    """Sizes are rounded up, so that few of them are compiled."""
    return 8 * -(-count // 8)


@lru_cache
def _lbfgs_tools():
    import optax

    tool = optax.scale_by_lbfgs(memory_size=10, scale_init_precond=False)
    return jax.jit(tool.init), jax.jit(tool.update)


def _lbfgs_memory(size: int):
    return _lbfgs_tools()[0](np.zeros(size))


def _lbfgs_direction(gradient, memory, basis, z):
    """The step in z, from the gradient in the whitened variables u, z = z_0 + basis u."""
    size = padded(len(gradient))
    pad = lambda a: np.concatenate([a, np.zeros(size - len(a))])  # noqa: E731
    place = pad(np.linalg.lstsq(basis, z, rcond=None)[0])
    update, memory = _lbfgs_tools()[1](pad(gradient), memory, place)
    return -basis @ np.asarray(update)[: len(gradient)], memory
