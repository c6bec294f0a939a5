"""Many fits of one problem side by side: from changed weights, and to simulated data."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from calibration.fitting.component_fit import ComponentFit
from calibration.fitting.noise import needs_variances, variances_at
from calibration.fitting.problem import Lanes, Problem
from calibration.fitting.search import Found, search
from calibration.fitting.uncertainty import Settled

STEPS = 200  # of one refit
ROUNDS = 12  # in which a refit and its variances settle
SETTLED = 1e-6  # change of z from round to round


def settled(
    problems: Iterable[Problem], z: Float[np.ndarray, "fits p"], lanes: Lanes | None = None
) -> tuple[Float[np.ndarray, "fits p"], list[Settled], Bool[np.ndarray, "fits"], Lanes]:
    """Searches of one stage after the other from z, the noise of each fit its own.

    Returns:
        Where they end, the stages, which arrived, and the lanes with the variances of each fit.
    """
    arrived, stages, lanes = np.ones(len(z), bool), [], lanes or Lanes()
    for problem in problems:
        found, lanes = with_own_noise(problem, z, lanes)
        z, arrived = found.z, arrived & found.converged
        stages.append(Settled(problem, found.limits))
    return z, stages, arrived, lanes


def with_own_noise(problem: Problem, z, lanes: Lanes, begun=None) -> tuple[Found, Lanes]:
    """Searches from z, each with the variances that its own residuals tell."""
    found = search(problem, z, begun=begun, lanes=lanes, limit=STEPS)
    if not needs_variances(problem) or not any(one.unknown for one in problem.errors):
        return found, lanes
    for _ in range(ROUNDS):
        variances = variances_at(problem, found.z, lanes)
        lanes = lanes._replace(variances=variances)
        if problem.is_fixed:
            kept = 1.0 if lanes.weight is None else lanes.weight > 0
            lanes = lanes._replace(weight=kept * problem.diagonal(found.z, lanes) ** -0.5)
        again = search(problem, found.z, begun=found.begun, lanes=lanes, limit=STEPS, releases=0)
        moved = float(np.max(np.abs(again.z - found.z), initial=0.0))
        found = again
        if moved <= SETTLED:
            break
    return found, lanes


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


def bootstrap(fits: list[ComponentFit], count: int, seed: int, confidence: float) -> Bootstrap:
    """Simulate each point with the fitted curve and its noise, and fit that again, the noise as well."""
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
    parts = [
        carried.mean + errors.simulate(s, carried, random, count)
        for errors, s, carried in zip(
            first.errors, first.variances, first.carried(fit.z[None]), strict=True
        )
    ]
    return np.maximum(np.concatenate(parts, axis=1), 0.0)


def _refitted(fit: ComponentFit, drawn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Physical values of fits to such data, and which of them arrived."""
    z, converged = np.repeat(fit.z[None], len(drawn), axis=0), np.ones(len(drawn), bool)
    for stage in fit.stages:
        begun = np.broadcast_to(fit.begun, z.shape)
        found, _ = with_own_noise(stage.problem, z, Lanes(value=drawn), begun)
        z, converged = found.z, converged & found.converged
    return fit.final.problem.transform.physical(z), converged
