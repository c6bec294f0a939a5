"""optax's Adam with a schedule."""

from functools import lru_cache

import jax
import numpy as np

from calibration.lbfgs import padded
from calibration.parameters import NONE
from calibration.problem import Problem

ADAM_STEPS = 200


@lru_cache
def _adam_tools():
    import optax

    schedule = optax.cosine_decay_schedule(0.1, ADAM_STEPS)
    tool = optax.adam(schedule)
    return jax.jit(tool.init), jax.jit(tool.update)


def adam(problem: Problem, z, step) -> np.ndarray:
    """Adam with a cosine schedule, in units of each parameter's own size."""
    init, update = _adam_tools()
    z = np.array(z, float)
    size = np.where(problem.layout.kind[problem.active] == NONE, np.abs(z) + 1e-3, 1.0)
    count = padded(len(z))
    state = init(np.zeros(count))
    best, lowest = z, np.inf
    for _ in range(ADAM_STEPS):
        value, jacobian = problem.linearise(z)
        cost = 0.5 * float(value @ value)
        best, lowest = (z, cost) if cost < lowest else (best, lowest)
        gradient = np.concatenate([size * (jacobian.T @ value), np.zeros(count - len(z))])
        change, state = update(gradient, state)
        z = z + size * np.asarray(change)[: len(z)]
        if step:
            step(cost)
    return best
