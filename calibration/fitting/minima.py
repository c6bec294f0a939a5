"""When two ends of searches are two minima, and not two places in one.

An end is a minimum of its own only if

- the gradient vanishes there: the search says so, see `search`;
- the cost rises on the way from it to the other minimum. Where it does not, one could walk down
  from the one to the other, and the first was a place in the other's valley: where a search went to
  sleep, a saddle, or another of the places that a level valley offers.

A straight way that rises does not prove that every bent one does. A valley so bent and so level
that the gradient vanishes at two places along it is one whose parameters the data do not determine;
of those no other minima are told.
"""

import numpy as np
from jaxtyping import Float

from calibration.fitting.component_fit import ComponentFit
from calibration.fitting.intervals import weighted_deviation
from calibration.fitting.problem import Lanes, Problem
from calibration.fitting.search import Found
from calibration.fitting.stages import StageFit

MOVED = 1e-2  # in z, from which on values are others to a reader
STATIONS = 32
# Share of the cost that the next step may still promise where the gradient counts as vanished. A
# rise no larger than that may be made of what the two searches left undone.
LEFT_UNDONE = 1e-8
ROUNDING = 1e-10  # of ε: less is no noise


def other_minima(fit: ComponentFit, stage: StageFit, least: float) -> list[tuple[int, float]]:
    """Elements with another value at another minimum, and how much higher χ² is there.

    Only where χ² is less than `least` above that of the best.
    """
    found: dict[int, float] = {}
    for other in stage.others:
        moved = _moved(fit, stage, other)
        if not moved:
            continue
        rise = _rise(fit, stage, other.z[0])
        if rise < least and rises_between(stage.problem, stage.z, other.z[0]):
            for k in moved:
                found.setdefault(k, rise)
    return list(found.items())


def _moved(fit: ComponentFit, stage: StageFit, other: Found) -> list[int]:
    """Elements that are determined and elsewhere.

    None where an element is at an end of its range: a valley without an end has no second minimum.
    """
    if not other.converged[0] or np.any(stage.limits) or np.any(other.limits):
        return []
    apart = np.abs(other.z[0] - stage.z) > MOVED
    return [int(k) for k in stage.problem.active if apart[k] and fit.uncertainty.known[0, k]]


def _rise(fit: ComponentFit, stage: StageFit, z) -> float:
    """χ² there less χ² at the best: twice the difference of -ln p."""
    problem = stage.problem
    deviation = np.maximum(weighted_deviation(fit, problem), ROUNDING * problem.points.weight)
    return 2 * (_cost(problem, z) - _cost(problem, stage.z)) / float(np.mean(deviation**2))


def _cost(problem: Problem, z) -> float:
    """Of the points, each on the branch that it has at z, and of the priors."""
    held = problem.held(problem.elastic_at(z))
    return float(held.linearise(z[None], slopes=False).cost[0])


def rises_between(
    problem: Problem, first: Float[np.ndarray, "elements"], second: Float[np.ndarray, "elements"]
) -> bool:
    """Whether the cost rises above both ends on the straight way from one to the other.

    Looked at the more closely the nearer to an end: the rise around a shallow minimum is there.
    """
    shares = np.sin(np.linspace(0, np.pi / 2, STATIONS + 2)) ** 2
    places = first + shares[:, None] * (second - first)
    lanes = Lanes(elastic=problem.elastic_at(places))
    cost = problem.linearise(places, lanes, slopes=False).cost
    allowed = max(cost[0], cost[-1]) * (1 + LEFT_UNDONE)
    return bool(np.any(cost[1:-1] > allowed))
