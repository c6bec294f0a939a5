"""Very many points as few: neighbours that a fit cannot tell apart stand as one, with all their weight.

Between neighbours in velocity ε is a straight line to far less than its error. Where searches begin,
and how cost rises along a profile, need no more; where a search ends is always found on all points.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from calibration.fitting.condensed import condense
from calibration.fitting.problem import Points, Problem

MANY = 20_000  # points from which on it pays
FEW = 4096  # neighbourhoods, of all data sets together
CLOSE = 1e-3  # standard errors by which the minimum may move


def pooled(problem: Problem) -> Problem:
    """The problem with neighbours as one; itself where points are few, or share errors."""
    if not _can_be_pooled(problem):
        return problem
    return _pooled(problem, _neighbourhoods(problem), problem.points.value)


def pooled_about(
    problem: Problem,
    z: Float[np.ndarray, "elements"],
    errors: Float[np.ndarray, "p"],
) -> Problem:
    """The same with the minimum where that of all points is; itself where that cannot be had.

    Args:
        z: the minimum.
        errors: standard errors of the active elements, in z.
    """
    if not _can_be_pooled(problem):
        return problem
    members = _neighbourhoods(problem)
    residual = problem.predict(z[None])[0] - problem.points.value
    few = _pooled(problem, members, residual)
    # each neighbourhood keeps its mean residual, whatever ε does inside of it
    measured = few.predict(z[None])[0] - few.points.value
    few = replace(few, points=few.points._replace(value=measured))
    found = few.linearise(z[None])
    known = np.isfinite(errors) & (errors > 0)  # the others are held at an end of their range
    step = condense(found.residual, found.jacobian, ~known[None]).newton[0]
    return few if np.all(np.abs(step[known]) <= CLOSE * errors[known]) else problem


def _can_be_pooled(problem: Problem) -> bool:
    normal = all(one.is_fixed and one.dof is None for one in problem.errors)
    alone = normal and problem.elastic is None and not np.any(problem.points.observable)
    return alone and problem.count >= MANY


def _neighbourhoods(problem: Problem) -> Int[np.ndarray, "points"]:
    """Which one each point belongs to: equally many in each, of one data set and one law."""
    points, rows = problem.points, problem.laws.rows.row
    order = np.lexsort((points.velocity, rows, points.set))
    kind = np.stack([points.set[order], rows[order]])
    size = -(-problem.count // FEW)
    new = np.zeros(problem.count, bool)
    new[1:] = np.any(kind[:, 1:] != kind[:, :-1], axis=0)
    starts = np.flatnonzero(new)
    since = np.arange(problem.count) - np.append(0, starts)[np.cumsum(new)]
    members = np.empty(problem.count, int)
    members[order] = np.cumsum(new | (since % size == 0)) - 1
    return members


def _pooled(problem: Problem, members, value) -> Problem:
    """Weighted means; of what is passed in the place of the values."""
    points, count = problem.points, int(members.max()) + 1
    square = points.weight**2
    weight = np.bincount(members, square, count)
    held = np.maximum(weight, np.finfo(float).tiny)

    def mean(values):
        return np.bincount(members, square * values, count) / held

    _, first = np.unique(members, return_index=True)
    velocity = np.where(weight > 0, mean(points.velocity), points.velocity[first])
    few = Points(velocity, mean(value), np.sqrt(weight), *(a[first] for a in points[3:]))
    rows = replace(problem.laws.rows, row=problem.laws.rows.row[first])
    laws = replace(problem.laws, rows=rows)
    return replace(problem, points=few, laws=laws, errors=(), variances=())
