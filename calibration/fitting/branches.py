"""Branches at first yield, where ε jumps: which impacts of a data set stayed elastic.

The cost jumps where the critical velocity passes that of a point. Between two neighbouring such
places every point has its branch and the cost is smooth: a search begins in each, stays there, and
the lowest cost of all decides.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from calibration.fitting.laws import MOVE_YIELD, OF_CONTACT
from calibration.fitting.problem import Lanes, Problem
from calibration.fitting.search import guided_search

POWERS = dict(zip(MOVE_YIELD, (2.5, -2.0, 1.5, -0.5), strict=True))  # of each in v_cr
INSIDE = 1e-9  # in z: how far from the places where a point changes its branch
BEYOND = 0.1  # in z: the start of a search beyond the last of them
AT_ONCE = 200_000  # impacts of searches side by side
LEAST, MOST = 8, 64  # branches that are searched at once
ROUNDS = 8
LOWER = 1e-9  # share of the cost that counts as lower

Z = Float[np.ndarray, "fits elements"]


class Branches(NamedTuple):
    """Places between neighbouring jumps of the cost, each array with a leading axis of these."""

    lower: Z  # the ends in z of every element
    upper: Z
    elastic: Bool[np.ndarray, "fits points"]  # which points are below yield
    z: Z  # a start there, and later the place of the lowest cost
    cost: Float[np.ndarray, " fits"] = None  # type: ignore[assignment]  # half the sum of squares there
    limits: Int[np.ndarray, "fits p"] = None  # type: ignore[assignment]  # of the active elements, see `Ends`

    def some(self, which) -> "Branches":
        return Branches(*(None if part is None else part[which] for part in self))

    @classmethod
    def joined(cls, parts: list["Branches"]) -> "Branches":
        return cls(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))

    def problem(self, problem: Problem, k: int) -> Problem:
        """The problem held on one of these."""
        return replace(problem, elastic=self.elastic[k], within=(self.lower[k], self.upper[k]))

    def searched(self, problem: Problem) -> "Branches":
        """The lowest cost of each."""
        lanes = Lanes(elastic=self.elastic, lower=self.lower, upper=self.upper)
        lowest = guided_search(problem, self.z, "levenberg-marquardt", lanes=lanes)
        return self._replace(z=lowest.z, cost=lowest.cost, limits=lowest.limits)


def moving(problem: Problem) -> list[int]:
    """Active elements that yield moves with."""
    names = {OF_CONTACT + name for name in MOVE_YIELD}
    return [int(k) for k in problem.active if problem.elements[k].name in names]


def held_at(problem: Problem, z: Float[np.ndarray, " elements"]) -> Problem:
    """The problem on the branches that its points have at z."""
    if problem.elastic is None:
        return problem
    return replace(problem, elastic=problem.elastic_at(z), within=_ends(problem, z))


def _changes(problem: Problem, z, k: int) -> Float[np.ndarray, " points"]:
    """Value of an element at which each point changes its branch; NaN for points that never do."""
    name = problem.elements[k].name
    laws = problem.laws
    moves = laws.element[laws.names.index(name)][laws.row] == k
    power = POWERS[name.removeprefix(OF_CONTACT)]
    here = problem.transform.part(np.array([k]))
    theta = here.physical(z[k : k + 1])
    with np.errstate(over="ignore", divide="ignore"):
        value = theta * (problem.points.velocity / problem.yields_at(z)) ** (1 / power)
    possible = moves & (value > here.lower) & (value < here.upper)
    return np.where(possible, here.unconstrained(value[:, None])[:, 0], np.nan)


def _ends(problem: Problem, z) -> tuple[np.ndarray, np.ndarray]:
    """Between which z no point changes its branch; elements with points in common share the way."""
    lower, upper = np.full(len(z), -np.inf), np.full(len(z), np.inf)
    every = moving(problem)
    for k in every:
        way = (_changes(problem, z, k) - z[k]) / len(_with_points_of(problem, k))
        rises = POWERS[problem.elements[k].name.removeprefix(OF_CONTACT)] > 0
        below = way <= 0 if rises else way < 0
        lower[k] = z[k] + min(np.max(way[below], initial=-np.inf) + INSIDE, 0.0)
        upper[k] = z[k] + max(np.min(way[way >= 0][~below[way >= 0]], initial=np.inf) - INSIDE, 0.0)
    return lower, upper


def _with_points_of(problem: Problem, k: int) -> list[int]:
    """The elements that move the yield of the same data sets, the element itself among them."""
    sets = set(problem.elements[k].sets)
    return [m for m in moving(problem) if sets & set(problem.elements[m].sets)]


def _all_along(problem: Problem, z, k: int) -> Branches:
    """Every place between jumps along one element, all else as at z."""
    at = _changes(problem, z, k)
    edges = np.unique(at[np.isfinite(at)])
    edges = edges[np.diff(edges, prepend=-np.inf) > 2 * INSIDE]
    ends = np.concatenate([[-np.inf], edges, [np.inf]])
    count = len(ends) - 1
    low, high = ends[:-1] + INSIDE, ends[1:] - INSIDE
    with np.errstate(invalid="ignore"):
        middle = np.where(np.isfinite(low + high), 0.5 * (low + high), z[k])
    middle = np.clip(middle, low + BEYOND * np.isinf(high), high - BEYOND * np.isinf(low))
    begin = np.where((low <= z[k]) & (z[k] <= high), z[k], middle)
    places = np.repeat(z[None], count, axis=0)
    places[:, k] = begin
    at_start = np.repeat(np.asarray(problem.elastic_at(z))[None], count, axis=0)
    rises = POWERS[problem.elements[k].name.removeprefix(OF_CONTACT)] > 0
    elastic = at <= low[:, None] if rises else at >= high[:, None]
    elastic = np.where(np.isfinite(at), elastic, at_start)
    lower, upper = (np.repeat(end[None], count, axis=0) for end in _ends(problem, z))
    for m in _with_points_of(problem, k):
        lower[:, m] = upper[:, m] = z[m]
    lower[:, k], upper[:, k] = low, high
    return Branches(lower, upper, elastic, places)


def _lowest_along(problem: Problem, z, k: int) -> Branches:
    """Branches with their lowest costs; if there are very many, all near the best and some of the others."""
    candidates = _all_along(problem, z, k)
    count = len(candidates.z)
    most = int(np.clip(AT_ONCE // problem.count, LEAST, MOST))
    low, high, done = 0, count - 1, []
    while True:
        chosen = np.unique(np.linspace(low, high, min(most, high - low + 1)).astype(int))
        searched = candidates.some(chosen).searched(problem)
        done.append(searched)
        if len(chosen) == high - low + 1:
            return Branches.joined(done)
        best = int(np.argmin(searched.cost))
        low, high = chosen[max(best - 1, 0)], chosen[min(best + 1, len(chosen) - 1)]


def by_branches(problem: Problem, z) -> tuple[Branches, Branches]:
    """The lowest cost from a start, and all branches around it along the elements that yield moves with."""
    best, elements = _together(problem, z), moving(problem)
    for _ in range(ROUNDS):
        along = [_lowest_along(problem, best.z[0], k) for k in elements]
        around = Branches.joined(along)
        lowest = around.some([int(np.argmin(around.cost))])
        if len(elements) > 1:
            lowest = min(lowest, _together(problem, lowest.z[0]), key=lambda tried: tried.cost[0])
        if not lowest.cost[0] < best.cost[0] * (1 - LOWER):
            break
        best = lowest
    return best, around


def _together(problem: Problem, z) -> Branches:
    """All elements searched at once, on the branches that points have at z."""
    here = (*_ends(problem, z), np.asarray(problem.elastic_at(z)), z)
    return Branches(*(part[None] for part in here)).searched(problem)
