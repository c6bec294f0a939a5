"""Where searches start: a seeded Sobol sequence, screened as one batch."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

import softjax as sj
from calibration import objective
from calibration.assemble import Setup
from calibration.objective import KINDS
from calibration.parameters import LOGIT, NONE
from calibration.problem import Problem

# how far around the start to look, in z: a factor of 30 below and 300 above for χ̃
SPREAD = {
    "chi": (-3.5, 5.7),
    "sigma": (-3.5, 3.5),
    "psi": (-2.5, 1.5),
    "yield_strength": (-0.3, 0.3),
    "youngs_modulus": (-0.3, 0.3),
    "limit_velocity": (-1.0, 1.0),
}
LOGIT_SPREAD = (-4.0, 4.0)


def candidates(setup: Setup, problem: Problem, count: int, seed: int) -> np.ndarray:
    """`count` starts of the searched elements: the start itself, then Sobol points around it."""
    start = problem.start
    if count <= 1 or not len(start):
        return start[None]
    from scipy.stats import qmc

    low, high = np.transpose([_range(setup, problem, i) for i in range(len(start))])
    power = int(np.ceil(np.log2(count)))
    unit = qmc.Sobol(len(start), seed=seed).random_base2(power)[: count - 1]
    return np.concatenate([start[None], low + (high - low) * unit])


def _range(setup: Setup, problem: Problem, i: int) -> tuple[float, float]:
    position, start = problem.active[i], problem.start[i]
    column = next((e.column for e in setup.elements if e.position == position), "")
    kind = problem.layout.kind[position]
    if kind == LOGIT:
        return LOGIT_SPREAD
    below, above = SPREAD.get(column, (-1.0, 1.0))
    size = 1.0 if kind != NONE else abs(start) + 1e-3
    return start + below * size, start + above * size


def best_starts(setup: Setup, problem: Problem, points: np.ndarray, keep: int) -> list[np.ndarray]:
    """The `keep` best of them, best first; each data set's own elements are ranked by its cost."""
    if len(points) == 1:
        return [points[0]]
    costs = screen(problem, points)
    orders = np.argsort(costs, axis=0, kind="stable")
    total = np.argsort(costs.sum(axis=1), kind="stable")
    owner = {e.position: e.sets for e in setup.elements}
    starts: list[np.ndarray] = []
    for rank in range(min(keep, len(points))):
        chosen = []
        for i, position in enumerate(problem.active):
            sets = owner.get(position, ())
            order = orders[:, sets[0]] if len(sets) == 1 else total
            chosen.append(points[order[rank], i])
        starts.append(np.array(chosen))
    return starts


def screen(problem: Problem, points: np.ndarray) -> np.ndarray:
    """Cost of each start and data set, (starts, sets), by the energy balance."""
    model = objective.Model(
        problem.model.form, problem.model.kappa, problem.model.area, sj.EnergyBalance()
    )
    z = np.stack([problem.full(x) for x in points])
    costs = _screen(
        z,
        problem.layout,
        problem.obs,
        problem.noise,
        KINDS.index(problem.kind),
        model=model,
        loss=problem.loss,
    )
    return np.nan_to_num(np.asarray(costs), nan=np.inf)


@partial(jax.jit, static_argnames=("model", "loss"))
def _screen(z, layout, obs, noise, kind, model, loss):
    def one(z):
        plastic = lambda columns: objective.plastic_squared(columns, obs, model)  # noqa: E731
        value = objective.residuals(z, layout, obs, noise, plastic, model, kind, loss)[0]
        by_point = value[: len(obs.velocity)] ** 2
        sets = layout.fixed.shape[0]
        return jax.ops.segment_sum(by_point, obs.group, sets) + jnp.sum(
            value[len(obs.velocity) :] ** 2
        )

    return jax.vmap(one)(z)
