"""A restitution above 1 is noise, or a slip: told apart by how much its neighbours scatter."""

import numpy as np

from calibration.data.checks import Column
from calibration.errors import DataError

NEIGHBOURS = 30  # points whose scatter tells, the nearest in velocity
TIMES_STATED = 4.0  # standard uncertainties that noise reaches
# Scatters that noise reaches, of p triples: where every true ε is 1, 3 of 1000 sets go beyond
TIMES_SCATTER = (4.5, 60.0)  # 4.5 + 60/p
FEWEST = 3  # triples that tell a scatter at all
FEW = 20  # triples that tell it well
ROUNDED = 0.02  # of readings with two digits, which may all be alike
MOST_UNKNOWN = 0.15  # where it is not known
MOST_OF_FEW = 0.2
MOST = 0.5
CANDIDATES = 20  # the points furthest above 1 are looked at
PERCENT = 1.5  # from here on 85 for 0.85 is the likeliest slip


def check_above_one(velocity: Column, restitution: Column, uncertainty: Column | None) -> None:
    """Refuse ε further above 1 than noise brings it.

    Noise is 4 stated uncertainties, or a multiple of the robust scatter of the other points about
    their neighbours, whichever is more; where nothing is stated and there are too few points to
    tell, 0.15.

    Raises:
        DataError: naming the point, and how far above 1 it might be.
    """
    known = np.zeros(len(velocity)) if uncertainty is None else uncertainty
    with np.errstate(over="ignore"):
        stated = TIMES_STATED * known
    excess = restitution - 1 - stated
    if np.max(excess) <= 0:
        return
    order = np.argsort(velocity, kind="stable")
    for point in np.argsort(-excess, kind="stable")[:CANDIDATES]:
        scatter = _allowance(velocity, restitution, order, point, uncertainty is not None)
        if excess[point] > 0 and restitution[point] - 1 > scatter:
            _refuse(point, restitution[point], max(scatter, stated[point]))


def _allowance(velocity, restitution, order, point: int, is_stated: bool) -> float:
    """How far above 1 the scatter of the other points brings this one."""
    place = int(np.flatnonzero(order == point)[0])
    others = np.delete(order, place)
    start = np.clip(place - NEIGHBOURS // 2, 0, max(len(others) - NEIGHBOURS, 0))
    near = others[start : start + NEIGHBOURS]
    if len(near) < FEWEST + 2:
        return 0.0 if is_stated else MOST_UNKNOWN
    triples = len(near) - 2
    least, few = TIMES_SCATTER
    reach = (least + few / triples) * scatter_of(velocity[near], restitution[near])
    floor = 0.0 if is_stated else ROUNDED
    return float(np.clip(reach, floor, MOST_OF_FEW if triples < FEW else MOST))


def scatter_of(velocity: Column, restitution: Column) -> float:
    """Robust standard deviation of ε about a smooth curve, of points in the order of velocity.

    1.4826 times the median of |ε_i - line through its two neighbours|, each scaled to the
    variance of one point (Gasser, Sroka and Jennen-Steinmetz, Biometrika 73, 625, 1986).
    """
    gap = velocity[2:] - velocity[:-2]
    left = np.where(gap > 0, (velocity[2:] - velocity[1:-1]) / np.where(gap > 0, gap, 1.0), 0.5)
    line = left * restitution[:-2] + (1 - left) * restitution[2:]
    scale = np.sqrt(1 + left**2 + (1 - left) ** 2)
    return 1.4826 * float(np.median(np.abs(restitution[1:-1] - line) / scale))


def _refuse(point: int, value: float, allowance: float) -> None:
    accepted = f"at most 1, or above it by no more than noise brings it, {allowance:.2g} here"
    question = " (is it in percent? then the unit is [%])" if value > PERCENT else ""
    raise DataError("restitution", float(value), accepted + question, int(point))
