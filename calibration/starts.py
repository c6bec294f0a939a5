"""Where searches start: a seeded Sobol sequence, screened as one batch."""

import numpy as np

import softjax as sj
from calibration.assemble import Setup
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
APART = 1.0  # in z: starts nearer than that would be one search made twice


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
    """The `keep` best that are not neighbours, best first; each data set ranks its own elements."""
    if len(points) == 1:
        return [points[0]]
    costs = screen(problem, points)
    owners = {e.position: e.sets for e in setup.elements}
    sets = [owners.get(int(position), ()) for position in problem.active]
    keep = min(keep, len(points))
    starts = [np.array(points[0]) for _ in range(keep)]
    for group in set(sets):
        own = np.array([i for i, one in enumerate(sets) if one == group])
        ranked = costs[:, group[0]] if len(group) == 1 else costs.sum(axis=1)
        order = np.argsort(ranked, kind="stable")
        for start, chosen in zip(starts, _apart(order, points[:, own], keep), strict=True):
            start[own] = points[chosen, own]
    return starts


def _apart(order, points, keep: int) -> list[int]:
    """The first `keep` of an order that are `APART` from each other, filled up by those that are not."""
    chosen: list[int] = []
    for i in order:
        if all(np.max(np.abs(points[i] - points[j])) > APART for j in chosen):
            chosen.append(int(i))
    chosen += [int(i) for i in order if int(i) not in chosen]
    return chosen[:keep]


def screen(problem: Problem, points: np.ndarray) -> np.ndarray:
    """Cost of each start and data set, (starts, sets): the collisions of all starts in one batch.

    By the energy balance, whatever the search's route.
    """
    problem = problem.by(sj.EnergyBalance())
    zs = [problem.full(x) for x in points]
    costs = [
        _cost(problem, z, expansion)
        for z, expansion in zip(zs, problem.expansions(zs), strict=True)
    ]
    return np.nan_to_num(np.array(costs), nan=np.inf)


def _cost(problem: Problem, z, expansion) -> np.ndarray:
    """Sum of squares of each data set, priors added to all."""
    value = problem.linearised(z, expansion)[0]
    count, sets = len(problem.obs.velocity), len(problem.layout.fixed)
    by_set = np.bincount(problem.obs.group, value[:count] ** 2, sets)
    return by_set + np.sum(value[count:] ** 2)
