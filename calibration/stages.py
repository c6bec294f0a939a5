"""One stage of a fit: starts, searches, and for a robust loss its scale."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from calibration.assemble import Setup
from calibration.ending import Search
from calibration.problem import Problem
from calibration.search import OPTIMISERS, search_with_branches
from calibration.starts import best_starts, candidates

REFINED = 3  # of the screened starts
SCALE_ROUNDS = 20
SCALE_TOLERANCE = 1e-6
MAD = 1.4826  # median absolute deviation of Gaussian noise to its standard deviation
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Options:
    """How to search."""

    optimiser: str = "l-bfgs"
    starts: int = 32
    seed: int = 0
    loss: str = "squared"
    loss_scale: float = 1.345
    max_steps: int = 200
    progress: Progress | None = None

    def tell(self, stage: str, done: int, total: int) -> None:
        if self.progress is not None:
            self.progress(stage, done, total)


@dataclass(frozen=True)
class Stage:
    """What a stage did; a line of the report."""

    stage: str
    optimiser: str
    route: str
    evaluations: int
    iterations: int
    gradient_norm: float | None
    cost: float
    converged: bool
    reason: str
    starts: int


@dataclass(frozen=True)
class StageFit:
    """The best search of a stage, its problem (based at it), and what was noticed."""

    problem: Problem
    search: Search
    report: Stage
    others: tuple[Search, ...]  # where the other starts ended
    crossings: int  # points that changed branch
    seconds: float

    @property
    def z(self) -> np.ndarray:
        return self.problem.base


def run_stage(name: str, setup: Setup, problem: Problem, options: Options) -> StageFit:
    """Minimise from the best starts; with a robust loss until its scale is that of its residuals."""
    begun = time.perf_counter()
    points = candidates(setup, problem, options.starts, options.seed)
    squared = replace(problem, loss="squared")
    searched = []
    starts = best_starts(setup, squared, points, REFINED)
    for i, start in enumerate(starts):
        options.tell(name, i, len(starts))
        searched.append(
            search_with_branches(squared, start, options.optimiser, None, options.max_steps)
        )
    options.tell(name, len(starts), len(starts))
    best = min(searched, key=lambda one: (not one[0].converged, one[0].cost))
    if best[0].cost > min(one[0].cost for one in searched) * (1 + 1e-6):
        best = min(searched, key=lambda one: one[0].cost)
    found, used, crossings = best
    others = tuple(one[0] for one in searched if one[0] is not found)
    used, found = used.at(found.z), found
    if options.loss != "squared":
        used, found = _robust(used, found, options)
    evaluations = found.evaluations + sum(other.evaluations for other in others)
    report = _report(name, used, found, options, len(points), evaluations)
    return StageFit(used, found, report, others, crossings, time.perf_counter() - begun)


def _robust(problem: Problem, found: Search, options: Options) -> tuple[Problem, Search]:
    """Refit with the loss, its scale the median absolute deviation of its own residuals."""
    evaluations, previous = found.evaluations, None
    for _ in range(SCALE_ROUNDS):
        scale = residual_scale(problem) * options.loss_scale
        noise = problem.noise._replace(scale=scale)
        problem = replace(problem, loss=options.loss, noise=noise)
        found, problem, _ = search_with_branches(
            problem, problem.start, options.optimiser, None, options.max_steps
        )
        evaluations += found.evaluations
        problem = problem.at(found.z)
        if previous is not None and np.allclose(scale, previous, rtol=SCALE_TOLERANCE, atol=0):
            break
        previous = scale
    return problem, replace(found, evaluations=evaluations)


def residual_scale(problem: Problem) -> np.ndarray:
    """1.4826 times the median absolute weighted residual of each data set, at each point."""
    residual = raw_residuals(problem)
    scale = np.ones(len(residual))
    for g in np.unique(problem.obs.group):
        own = (problem.obs.group == g) & (problem.obs.weight > 0)
        if np.any(own):
            spread = MAD * np.median(np.abs(residual[own]))
            scale[problem.obs.group == g] = max(spread, 1e-15)
    return scale


def raw_residuals(problem: Problem) -> np.ndarray:
    """Weighted residuals before the loss."""
    obs = problem.obs
    return (problem.prediction(problem.base) - obs.restitution) * obs.weight


def _report(name, problem, found, options, starts, evaluations) -> Stage:
    route = problem.model.route.name if problem.kind == "model" else "closed form"
    norm = found.gradient_norm if np.isfinite(found.gradient_norm) else None
    return Stage(
        stage=name,
        optimiser=OPTIMISERS[options.optimiser],
        route=route,
        evaluations=evaluations,
        iterations=found.iterations,
        gradient_norm=norm,
        cost=found.cost,
        converged=found.converged,
        reason=found.reason,
        starts=starts,
    )
