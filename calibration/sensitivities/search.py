"""The search for velocities: a criterion on the information matrix, followed down its gradient.

Each impact's slopes depend on its own velocity alone. So the collision is expanded impact by
impact, slopes and their derivatives in the velocity (second derivatives of ε), by one compiled
function for every objective and criterion; what is small is then made of these.
"""

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import softjax as sj
from calibration.sensitivities import estimating
from calibration.sensitivities.estimating import Rows

FASTEST_STEP = 0.1  # of Adam, in the unconstrained variable
SPREAD = 4.0  # the unconstrained variable at the ends of a start's velocities


@dataclass(frozen=True)
class Goal:
    """What is made small, as a value that compiles once.

    "c" is the logarithm of the target's standard error. "D" is that of the geometric mean of the
    standard errors, correlations counted: of all parameters for `model`. For `two-step` it is
    taken of each step's own parameters, (σ, ψ) and χ̃: over all three the stacked covariance is
    singular for impacts at two velocities, although none of the three is then known well.
    """

    names: tuple[str, ...]
    objective: str
    criterion: str
    target: int

    def covariance(self, rows: Rows, weight) -> Array:
        return estimating.covariance(*estimating.summed(rows, weight, self.names, self.objective))

    def __call__(self, rows: Rows, weight) -> Array:
        covariance = self.covariance(rows, weight)
        if self.criterion == "c":
            return 0.5 * jnp.log(covariance[self.target, self.target])
        if self.objective == "model":
            determinants = jnp.linalg.slogdet(covariance)[1]
        else:
            second_step = jnp.log(covariance[0, 0])
            determinants = second_step + jnp.linalg.slogdet(covariance[1:, 1:])[1]
        return 0.5 * determinants / len(self.names)


class Task(NamedTuple):
    """What the search is given beside its goal."""

    law: sj.Zhou
    bounds: Float[np.ndarray, "2"]
    known: Rows  # slopes of what was measured
    known_weight: Float[np.ndarray, " m"]
    weight: float  # 1/u² of each new shot

    def joined(self, rows: Rows) -> tuple[Rows, Array]:
        """Slopes and weights of old and new impacts."""
        both = Rows(*(jnp.concatenate(pair) for pair in zip(self.known, rows, strict=True)))
        new = jnp.full(rows.eps_up.shape, self.weight)
        return both, jnp.concatenate([jnp.asarray(self.known_weight), new])

    def velocity(self, z) -> Array:
        """v between its bounds, on a logarithmic scale, for any z."""
        low, high = jnp.log(self.bounds[0]), jnp.log(self.bounds[1])
        return jnp.exp(low + (high - low) * jax.nn.sigmoid(z))


class Found(NamedTuple):
    """Where each start ended."""

    velocity: Float[np.ndarray, "starts n"]
    cost: Float[np.ndarray, " starts"]
    gradient_norm: Float[np.ndarray, " starts"]


def starting_points(count: int, starts: int, seed: int) -> Float[np.ndarray, "starts count"]:
    """Unconstrained velocities: spread evenly, then a scrambled Sobol sequence."""
    from scipy.stats import qmc

    even = np.linspace(-1, 1, count) if count > 1 else np.zeros(1)
    sampler = qmc.Sobol(count, rng=np.random.default_rng(seed))
    spread = 2 * sampler.random_base2(max(0, (starts - 1).bit_length()))[: starts - 1] - 1
    return SPREAD * np.concatenate([even[None], spread])


def search(first, task: Task, goal: Goal, steps: int, progress=None) -> Found:
    """Adam with a cosine schedule, from all starts at once."""
    z, state = jnp.asarray(first), _optimiser(steps).init(jnp.asarray(first))
    for done in range(steps + 1):
        velocity = task.velocity(z)
        rows, change = estimating.slopes_and_change(task.law, np.ravel(velocity))
        moved, state, cost, gradient = _step(z, state, velocity, rows, change, task, goal, steps)
        if done < steps:
            z = moved
        if progress is not None:
            progress("velocities", done, steps)
    norm = np.linalg.norm(np.asarray(gradient), axis=1)
    return Found(np.asarray(velocity), np.asarray(cost), norm)


def _optimiser(steps: int):
    import optax

    return optax.adam(optax.cosine_decay_schedule(FASTEST_STEP, steps))


@partial(jax.jit, static_argnames=("goal", "steps"))
def _step(z, state, at, rows, change, task: Task, goal: Goal, steps: int):
    """One step of Adam; also the criterion and its gradient where it started."""
    rows, change = (_by_start(some, z.shape) for some in (rows, change))

    def cost(z, at, rows, change):
        moved = (task.velocity(z) - at)[:, None]
        line = Rows(
            model=rows.model + change.model * moved,
            empirical=rows.empirical + change.empirical * moved,
            eps_up=rows.eps_up + change.eps_up * moved[:, 0],
        )
        return goal(*task.joined(line))

    value, gradient = jax.vmap(jax.value_and_grad(cost))(z, at, rows, change)
    update, state = _optimiser(steps).update(gradient, state)
    return z + update, state, value, gradient


def _by_start(rows: Rows, shape: tuple[int, int]) -> Rows:
    return jax.tree.map(lambda row: row.reshape(*shape, *row.shape[1:]), rows)
