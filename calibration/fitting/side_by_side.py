"""Fits of data sets that share nothing as one batch of one problem.

A search of one fit or of a hundred costs nearly the same: what a step costs is what is done once for all.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from calibration.fitting.errors import Errors
from calibration.fitting.problem import Problem
from calibration.fitting.rows import Batch

MOST_POINTS = 20_000  # points from which on a problem fills its batches by itself


def alike(problems: Sequence[Problem]) -> list[list[int]]:
    """Places of the problems that can be searched side by side, together."""
    groups: dict[Any, list[int]] = {}
    for i, problem in enumerate(problems):
        kind = _kind(problem)
        groups.setdefault(i if kind is None else kind, []).append(i)
    return list(groups.values())


def _kind(problem: Problem) -> Any:
    """Key that problems of single data sets must share; None where this one is searched by itself."""
    laws, errors = problem.laws, problem.errors
    held = (problem.gradient_shift, problem.affects_yield, problem.drag)
    more = (problem.pools, problem.with_prior, np.any(problem.inside), any(laws.shape.shared))
    is_simple = (
        len(errors) == laws.size == 1 and errors[0].noise.is_least_squares and problem.is_fixed
    )
    is_simple &= problem.count < MOST_POINTS and not np.any(problem.points.observable)
    if not is_simple or any(a is not None for a in held) or any(more):
        return None
    arrays = (laws.element, problem.active, *problem.transform)
    of_laws = (laws.model, laws.shape, laws.names, laws.moving, laws.free, laws.area)
    return *of_laws, problem.route, *(a.tobytes() for a in arrays)


def as_one(problems: Sequence[Problem]) -> tuple[Problem, Batch]:
    """Problems that are alike as one, and the batch of their fits, whose points weigh by their variances."""
    if len(problems) == 1:
        return problems[0], Batch()
    longest = max(problems, key=lambda problem: problem.count)
    missing = [longest.count - problem.count for problem in problems]

    def filled(columns, by: Any = "edge") -> np.ndarray:
        pairs = zip(columns, missing, strict=True)
        return np.array([np.pad(column, (0, more), by) for column, more in pairs])

    variances = [problem.errors[0].diagonal(problem.variances[0]) for problem in problems]
    weights = [p.points.copies / v for p, v in zip(problems, variances, strict=True)]
    contacts = [p.laws.contact or {} for p in problems]
    batch = Batch(
        of=np.arange(len(problems)),
        value=filled([p.points.value for p in problems]),
        copies=filled(weights, "constant"),
        velocity=filled([p.points.velocity for p in problems]),
        contact={n: np.array([c[n] for c in contacts]) for n in contacts[0]} or None,
        fixed=np.array([p.laws.fixed for p in problems]),
    )
    errors, count = (Errors.known(longest.points.velocity, 1.0),), np.zeros(len(problems), int)
    return replace(longest, errors=errors, variances=({},), evaluated=count), batch
