"""Many fits of one problem side by side: from changed weights, and to simulated data."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from calibration.fitting.component_fit import ComponentFit
from calibration.fitting.problem import Lanes, Problem
from calibration.fitting.search import Found, search
from calibration.fitting.uncertainty import winsorised

STEPS = 100  # of one refit


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
    names, values, converged = [], [], np.ones(count, bool)
    for fit in fits:
        found, arrived = _simulated(fit, count, random)
        names += [e.label for e in fit.component.elements]
        values.append(found)
        converged &= arrived
    joined = np.concatenate(values, axis=1)
    part = 100 * np.array([0.5 * (1 - confidence), 0.5 * (1 + confidence)])
    ends = (
        np.percentile(joined[converged], part, axis=0)
        if np.any(converged)
        else np.full((2, len(names)), np.nan)
    )
    intervals = {n: (float(a), float(b)) for n, a, b in zip(names, *ends, strict=True)}
    return Bootstrap(tuple(names), joined, converged, intervals)


def _simulated(fit: ComponentFit, count: int, random) -> tuple[np.ndarray, np.ndarray]:
    """Physical values of fits to data around the curve of the first stage."""
    first = fit.stages[0].problem
    curve = first.predict(fit.z[None])[0]
    if first.shared is not None:
        noise = np.concatenate([one.simulate(random, count) for one in first.shared], axis=1)
    else:
        noise = random.standard_normal((count, first.count)) * fit.uncertainty.noise.deviation[0]
    drawn = np.maximum(curve + noise, 0.0)
    z, converged = np.repeat(fit.z[None], count, axis=0), np.ones(count, bool)
    for k, stage in enumerate(fit.stages):
        if k and first.loss != "squared":
            drawn = winsorised(first, z, Lanes(restitution=drawn))
        found = refit(fit, stage.problem, z, Lanes(restitution=drawn))
        z, converged = found.z, converged & found.converged
    return fit.final.problem.transform.physical(z), converged
