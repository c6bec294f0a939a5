"""Where searches start: a seeded Sobol sequence, screened as one batch."""

import numpy as np
from jaxtyping import Float

from calibration.fitting.law_model import OF_CONTACT
from calibration.fitting.problem import Element, Lanes, Problem
from calibration.fitting.transform import LOGIT, NONE

DECADES = 3 * np.log(10)  # on either side of the start of a positive parameter
# how far around the start it is worth looking, in z: a factor of 30 below and 300 above for χ̃
SPREAD = {
    "chi": (-3.5, 5.7),
    "sigma": (-3.5, 3.5),
    "psi": (-2.5, 1.5),
    "limit_velocity": (-1.0, 1.0),
    OF_CONTACT + "limit_velocity": (-1.0, 1.0),
}
OF_A_CONTACT = (-0.3, 0.3)  # properties that were measured
LOGIT_SPREAD = (-4.0, 4.0)
APART = 1.0  # in z: starts nearer than that would be one search made twice

Places = Float[np.ndarray, "starts elements"]


def candidates(
    problem: Problem, z: Float[np.ndarray, "elements"], count: int, seed: int, wide: float = 1.0
) -> Places:
    """`count` starts: z itself, then Sobol points around it along the active elements.

    Args:
        wide: how many times its own size an element of any sign may change.
    """
    active = problem.active
    if count <= 1 or not len(active):
        return z[None]
    from scipy.stats import qmc

    low, high = np.transpose([_range(problem, int(k), z[k], wide) for k in active])
    power = int(np.ceil(np.log2(count)))
    unit = qmc.Sobol(len(active), seed=seed).random_base2(power)[: count - 1]
    places = np.repeat(z[None], count, axis=0)
    places[1:, active] = low + (high - low) * unit
    return places


def _range(problem: Problem, k: int, start: float, wide: float) -> tuple[float, float]:
    kind, name = problem.transform.kind[k], problem.elements[k].name
    if kind == LOGIT:
        return LOGIT_SPREAD
    if kind == NONE:
        low, high = float(problem.transform.lower[k]), float(problem.transform.upper[k])
        size = wide * (abs(start) + 1e-3)
        return max(start - size, low), min(start + size, high)
    below, above = SPREAD.get(
        name, OF_A_CONTACT if name.startswith(OF_CONTACT) else (-DECADES, DECADES)
    )
    return start + below, start + above


def best_starts(problem: Problem, places: Places, keep: int) -> Places:
    """The `keep` best that are not neighbours, best first; each data set ranks its own elements."""
    if len(places) == 1:
        return places
    costs = screen(problem, places)
    keep = min(keep, len(places))
    starts = np.repeat(places[:1], keep, axis=0)
    for group in {_sets(problem, problem.elements[k]) for k in problem.active}:
        members = [k for k in problem.active if _sets(problem, problem.elements[k]) == group]
        ranked = costs[:, group[0]] if len(group) == 1 else costs.sum(axis=1)
        chosen = _apart(np.argsort(ranked, kind="stable"), places[:, members], keep)
        starts[:, members] = places[chosen][:, members]
    return starts


def _sets(problem: Problem, element: Element) -> tuple[int, ...]:
    """The data sets of an element, as the problem counts them."""
    places = {g: i for i, g in enumerate(sorted({g for e in problem.elements for g in e.sets}))}
    return tuple(places[g] for g in element.sets)


def _apart(order, places, keep: int) -> list[int]:
    """The first `keep` of an order that are `APART` from each other, filled up by those that are not."""
    chosen: list[int] = []
    for i in order:
        if all(np.max(np.abs(places[i] - places[j])) > APART for j in chosen):
            chosen.append(int(i))
        if len(chosen) == keep:
            return chosen
    chosen += [int(i) for i in order if int(i) not in chosen]
    return chosen[:keep]


def screen(problem: Problem, places: Places) -> Float[np.ndarray, "starts sets"]:
    """Cost of each start and data set, priors added to all, in one batch."""
    lanes = Lanes(elastic=problem.elastic_at(places))
    found = problem.linearise(places, lanes, slopes=False)
    squares = np.nan_to_num(found.residual, nan=np.inf) ** 2
    points, sets = problem.points.set, len(problem.datasets)
    by_set = np.stack([squares[:, : problem.count][:, points == g].sum(1) for g in range(sets)], 1)
    return by_set + squares[:, problem.count :].sum(axis=1)[:, None]
