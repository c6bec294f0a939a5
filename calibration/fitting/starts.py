"""Places where searches start: a sequence of points that fill the ranges of the parameters evenly, the best of them kept.

Point k of the sequence has the parts u_j = (shift + k √prime_j) mod 1 of the ranges (Richtmyer): of two parameters
the first four, without a shift,

>>> (np.arange(1, 5)[:, None] * np.sqrt([2, 3]) % 1).round(2)
array([[0.41, 0.73],
       [0.83, 0.46],
       [0.24, 0.2 ],
       [0.66, 0.93]])

A positive parameter is looked at three decades to each side of its start, χ̃ from 1/33 to 300 of it. Each data set
ranks its own parameters; of places nearer than a factor of e to a better one none is kept.
"""

import math

import numpy as np
from jaxtyping import Float

from calibration.fitting.laws import OF_CONTACT
from calibration.fitting.methods import TINY
from calibration.fitting.problem import Problem
from calibration.fitting.search import (
    LARGEST_STEP,
)
from calibration.parameters import LOGIT, NONE

# How far around the start it is worth looking, in z: three decades to each side of a positive
# parameter, a factor of 30 below and 300 above for χ̃. A third and twice of DECADES end in the same
# places in 8 fits of groups, extra scatter and the like; a third of WIDTHS takes 1.6 times the
# evaluations in 12 fits that start a factor of ten off, twice takes as many, and all arrive.
DECADES = (-3 * np.log(10), 3 * np.log(10))
WIDTHS = {
    "chi": (-3.5, 5.7),
    "sigma": (-3.5, 3.5),
    "psi": (-2.5, 1.5),
    "limit_velocity": (-1.0, 1.0),
    OF_CONTACT + "limit_velocity": (-1.0, 1.0),
}
OF_A_CONTACT = (-0.3, 0.3)  # properties that were measured
LOGIT_SPREAD = 4.0  # between two bounds: from 1.8 to 98.2 % of the way
# in z: starts nearer than that would be one search made twice; on the 12 no effect from 0.1, 3
# takes 1.3 times the evaluations
APART = 1.0

Places = Float[np.ndarray, "starts elements"]


def screened(
    problem: Problem, z: Float[np.ndarray, " elements"], count: int, seed: int, keep: int, wide=1.0
) -> Places:
    """The `keep` best of `count` places that are `APART`, the best first; each data set ranks its own elements.

    z itself, and points evenly around it along the active elements.

    Args:
        wide: how many times its own size an element of any sign may change.
    """
    active, transform = problem.active, problem.transform.part(problem.active)
    if count <= 1 or not len(active):
        return z[None]
    names = [problem.elements[k].name for k in active]
    usual = [OF_A_CONTACT if name.startswith(OF_CONTACT) else DECADES for name in names]
    below, above = np.transpose([WIDTHS.get(n, u) for n, u in zip(names, usual, strict=True)])
    x, plain = z[active], transform.kind == NONE
    size = wide * (np.abs(x) + 1e-3)
    low = np.where(plain, np.maximum(x - size, transform.lower), x + below)
    high = np.where(plain, np.minimum(x + size, transform.upper), x + above)
    bounded = transform.kind == LOGIT
    low, high = np.where(bounded, -LOGIT_SPREAD, low), np.where(bounded, LOGIT_SPREAD, high)
    # SciPy's Sobol points are as even after half a second of imports
    many = range(2, 10 + 20 * len(active))
    primes = [n for n in many if all(n % k for k in range(2, math.isqrt(n) + 1))][: len(active)]
    shift = np.random.default_rng(seed).random(len(active))
    unit = (shift + np.arange(1, count)[:, None] * np.sqrt(primes)) % 1
    places = np.repeat(z[None], count, axis=0)
    places[1:, active] = low + (high - low) * unit
    linear = problem.linearise(places, slopes=False)
    squares = np.nan_to_num(linear.residual, nan=np.inf) ** 2
    begins = np.unique(problem.points.set, return_index=True)[1]
    of_sets = np.add.reduceat(squares[:, : problem.count], begins, axis=1)
    costs = of_sets + squares[:, problem.count :].sum(axis=1)[:, None]
    keep = min(keep, count)
    starts = np.repeat(places[:1], keep, axis=0)
    for sets in {problem.elements[k].sets for k in active}:
        members = [k for k in active if problem.elements[k].sets == sets]
        ranked = costs[:, sets[0]] if len(sets) == 1 else costs.sum(axis=1)
        order, own = np.argsort(ranked, kind="stable").tolist(), places[:, members]
        chosen: list[int] = []
        for i in order:
            if len(chosen) < keep and all(np.ptp(own[[i, j]], 0).max() > APART for j in chosen):
                chosen.append(i)
        chosen += [i for i in order if i not in chosen]  # filled up by neighbours
        starts[:, members] = own[chosen[:keep]]
    return starts


def along_valley(problem: Problem, z: Float[np.ndarray, "fits elements"]) -> Places:
    """Two standard errors to both sides of z along what the points leave most open, (2 fits, elements).

    Errors of velocities, whose variance moves with the curve, may give the likelihood several minima there.
    """
    active, transform = problem.active, problem.transform
    jacobian = np.nan_to_num(problem.linearise(z).jacobian)
    _, size, axes = np.linalg.svd(jacobian, full_matrices=False)
    step = 2 * axes[:, -1] / np.maximum(size[:, -1:], TINY)
    unit = np.where(transform.kind[active] == NONE, np.abs(z[:, active]) + TINY, 1.0)
    step /= np.maximum(np.max(np.abs(step) / unit, axis=1, keepdims=True) / LARGEST_STEP, 1.0)
    places = np.concatenate([z, z])
    places[:, active] += np.concatenate([step, -step])
    inside = np.clip(places, transform.lower, transform.upper)
    return np.where(transform.kind == NONE, inside, places)
