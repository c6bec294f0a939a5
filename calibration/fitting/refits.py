"""Many fits of one problem side by side: from changed weights, and to simulated data."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from calibration.fitting.component_fit import ComponentFit
from calibration.fitting.problem import Lanes, Problem
from calibration.fitting.search import Found, search
from calibration.fitting.uncertainty import Settled, winsorised

STEPS = 200  # of one refit


def settled(
    problems: Iterable[Problem], z: Float[np.ndarray, "fits p"], lanes: Lanes | None = None
) -> tuple[Float[np.ndarray, "fits p"], list[Settled], Bool[np.ndarray, "fits"]]:
    """Searches of one stage after the other from z: where they end, the stages, and which arrived."""
    arrived, stages = np.ones(len(z), bool), []
    for problem in problems:
        found = search(problem, z, lanes=lanes)
        z, arrived = found.z, arrived & found.converged
        stages.append(Settled(problem, found.limits))
    return z, stages, arrived


@dataclass(frozen=True)
class Bootstrap:
    """Fits of simulated data.

    Attributes:
        names: of the free parameters.
        values: physical, (fits, p).
        converged: which fits arrived, (fits,).
        intervals: percentile limits by name.
    """

    names: tuple[str, ...]
    values: Float[np.ndarray, "fits p"]
    converged: Bool[np.ndarray, "fits"]
    intervals: dict[str, tuple[float, float]]


def refit(fit: ComponentFit, problem: Problem, z: np.ndarray, lanes: Lanes) -> Found:
    """Its search again from z, with other weights or other data."""
    return search(problem, z, begun=fit.begun, lanes=lanes, limit=STEPS)


def bootstrap(fits: list[ComponentFit], count: int, seed: int, confidence: float) -> Bootstrap:
    """Simulate each point with the fitted curve and its noise, and fit that again."""
    random = np.random.default_rng(seed)
    drawn = [_simulated(fit, count, random) for fit in fits]
    found = [_refitted(fit, data) for fit, data in zip(fits, drawn, strict=True)]
    every, arrived = zip(*found, strict=True)
    values, converged = np.concatenate(every, axis=1), np.all(arrived, axis=0)
    names = [e.label for fit in fits for e in fit.component.elements]
    part = 100 * np.array([0.5 * (1 - confidence), 0.5 * (1 + confidence)])
    ends = (
        np.percentile(values[converged], part, axis=0)
        if np.any(converged)
        else np.full((2, len(names)), np.nan)
    )
    intervals = {n: (float(a), float(b)) for n, a, b in zip(names, *ends, strict=True)}
    return Bootstrap(tuple(names), values, converged, intervals)


def _simulated(fit: ComponentFit, count: int, random) -> Float[np.ndarray, "count n"]:
    """Data around the curve of the first stage."""
    first = fit.stages[0].problem
    curve = first.predict(fit.z[None])[0]
    if first.shared is not None:
        noise = np.concatenate([one.simulate(random, count) for one in first.shared], axis=1)
    else:
        noise = random.standard_normal((count, first.count)) * fit.uncertainty.noise.deviation[0]
    return np.maximum(curve + noise, 0.0)


def _refitted(fit: ComponentFit, drawn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Physical values of fits to such data, and which of them arrived."""
    first, count = fit.stages[0].problem, len(drawn)
    z, converged = np.repeat(fit.z[None], count, axis=0), np.ones(count, bool)
    for k, stage in enumerate(fit.stages):
        if k and first.loss != "squared":
            drawn = winsorised(first, z, Lanes(restitution=drawn))
        found = refit(fit, stage.problem, z, Lanes(restitution=drawn))
        z, converged = found.z, converged & found.converged
    return fit.final.problem.transform.physical(z), converged
