"""Very many points as few.

Between neighbours in velocity ε is a straight line to far less than its error: neighbours that a fit
cannot distinguish stand as one, with their mean, their scatter about it and all their weight. Where
searches go, how cost rises along a profile and how it bends need no more; with the gradient of all
points at a place added, the few have their minimum there where all have it.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from calibration.fitting.problem import Problem

# points from which on it pays: a fit to so many, with profiles, takes 1.5 s in place of 4.4 s
MANY = 20_000
# neighbourhoods, of all data sets together; limits of that fit move by up to 4e-5 standard errors,
# with 1024 by 1.2e-4 in 1.2 s
FEW = 4096


def binned(problem: Problem, z: Float[np.ndarray, " elements"] | None = None) -> Problem:
    """Neighbourhoods in place of points; the problem itself where points are few, or share errors.

    Args:
        z: where value (up to a constant) and gradient of the cost are to be those of all points; None:
            neighbourhoods have the mean of their values.
    """
    merges = all(errors.noise.is_least_squares and not errors.shares for errors in problem.errors)
    if problem.count < MANY or not merges or problem.jumps:
        return problem
    points, laws = problem.points, problem.laws
    block = np.repeat(np.arange(len(problem.spans)), [s.stop - s.start for s in problem.spans])
    order = np.lexsort((points.velocity, laws.row, block))
    kind = np.stack([block[order], laws.row[order]])
    new = np.append(True, np.any(np.diff(kind) != 0, axis=0))
    since = np.arange(len(order)) - np.flatnonzero(new)[np.cumsum(new) - 1]
    begin = np.flatnonzero(new | (since % -(-problem.count // FEW) == 0))
    size = np.diff(np.append(begin, len(order)))
    middle = order[begin + size // 2]

    if z is None:
        residual = -points.value
        variances = zip(problem.errors, problem.variances, strict=True)
        every = [errors.diagonal(s) + np.zeros(len(errors)) for errors, s in variances]
        variance = np.concatenate(every)
    else:
        linear = problem.linearise(z[None])
        residual, variance = linear.prediction[0] - points.value, problem.diagonal(z[None])[0]
    weight = points.copies / variance
    total = np.add.reduceat(weight[order], begin)
    mean = np.add.reduceat((weight * residual)[order], begin) / total
    inside = np.add.reduceat((weight * residual**2)[order], begin) - total * mean**2

    few = problem.select_points(middle)
    copies, inside = total * variance[middle], variance[middle] * np.maximum(inside, 0.0)
    few = replace(few, points=few.points._replace(copies=copies, value=-mean), inside=inside)
    if z is None:
        return few
    value = few.linearise(z[None], slopes=False).prediction[0] - mean
    few = replace(few, points=few.points._replace(value=value))
    return replace(few, gradient_shift=(z, (linear.gradient - few.linearise(z[None]).gradient)[0]))
