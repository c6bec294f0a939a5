"""Refits of simulated data: the parametric bootstrap.

Each point is drawn about the fitted curve with its noise, all are fitted again from the fit, side by side, and the spread
of the refits is that of the estimates. A mean of two values of 0.05 each spreads by 0.05/√2 = 0.0354, a thousand
refits tell that to 2.2 %.

>>> import calibration as cal
>>> data = cal.RestitutionData([1.0, 1.0], [0.75, 0.65], uncertainty=[0.05, 0.05])
>>> found = cal.fit(data, "constant", profiles=False, starts=1).bootstrap(1000, seed=1)
>>> bool(abs(found.values.std() / 0.0354 - 1) < 3 * 0.022)
True
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from calibration.fitting.components import ComponentFit
from calibration.fitting.problem import Problem
from calibration.fitting.rows import Batch
from calibration.fitting.search import Ends, search
from calibration.fitting.starts import along_valley
from calibration.fitting.variance_updates import needs_variances, variances_at

# Measured on 40 refits of five fits each, two with variances of their own.

STEPS = 200  # of one refit; 50 leaves 18 of 200 unfinished, 1000 none as this
# of a refit and its variances in turn; 6 are enough, 3 move estimates by up to 7e-5 of their spread
ROUNDS = 12
# change of z from round to round; 1e-3 moves estimates by up to 4e-6 of their spread
SETTLED = 1e-6


def refitted(fit: ComponentFit, again: Callable[[Problem, Any], Ends], count: int = 1):
    """Refits through all stages from the fit: z of each, and which arrived."""
    z, converged = np.repeat(fit.z[None], count, axis=0), np.ones(count, bool)
    for stage in fit.stages:
        end = again(stage.problem, z)
        z, converged = end.z, converged & end.converged
    return z, converged


def with_own_noise(problem: Problem, z, batch: Batch, reference_start=None) -> Ends:
    """Searches from z, each with the variances of its own residuals."""
    end = search(problem, z, reference_start=reference_start, batch=batch, limit=STEPS)
    if not needs_variances(problem) or not any(errors.unknown for errors in problem.errors):
        return end
    for _ in range(ROUNDS):
        before, variances = end.z, variances_at(problem, end.z, batch)
        batch = batch._replace(variances=variances)
        end = search(
            problem,
            before,
            reference_start=end.reference_start,
            batch=batch,
            limit=STEPS,
            releases=0,
        )
        if np.max(np.abs(end.z - before), initial=0.0) <= SETTLED:
            break
    return end


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
    converged: Bool[np.ndarray, " fits"]
    intervals: dict[str, tuple[float, float]]


def bootstrap(fits: list[ComponentFit], count: int, seed: int, confidence: float) -> Bootstrap:
    """Simulate each point with the fitted curve and its noise, and fit that again, the noise as well.

    What a prior was taken from is a measurement too: its mean is drawn about the estimate.
    """
    random = np.random.default_rng(seed)
    batches, arrived = [], []
    for fit in fits:
        first, drawn = fit.stages[0].problem, []
        curve = first.linearise(fit.z[None])
        for errors, s, span in zip(first.errors, first.variances, first.spans, strict=True):
            residual = errors.simulate(s, curve.measured_curve(span), random, count)
            drawn.append(curve.prediction[:, span] + residual)
        value = np.maximum(np.concatenate(drawn, axis=1), 0.0)
        batch = Batch(value=value, centre=_centres(fit, random, count))
        again = partial(
            _of_simulated, batch=batch, reference_start=np.tile(fit.reference_start, (count, 1))
        )
        z, converged = refitted(fit, again, count)
        batches.append(fit.final.problem.transform.physical(z))
        arrived.append(converged)
    values, converged = np.concatenate(batches, axis=1), np.all(arrived, axis=0)
    names = [e.label for fit in fits for e in fit.component.elements]
    part = 100 * np.array([0.5 * (1 - confidence), 0.5 * (1 + confidence)])
    ends = (
        np.percentile(values[converged], part, axis=0)
        if np.any(converged)
        else np.full((2, len(names)), np.nan)
    )
    intervals = {n: (float(a), float(b)) for n, a, b in zip(names, *ends, strict=True)}
    return Bootstrap(tuple(names), values, converged, intervals)


def _centres(fit: ComponentFit, random, count: int) -> Float[np.ndarray, "fits elements"]:
    """Draw the centres of priors and pools about the fit, with their deviations."""
    centre = np.tile(fit.theta, (count, 1))
    for k, prior in enumerate(e.parameter.prior for e in fit.component.elements):
        if prior is not None:
            centre[:, k] += prior[1] * random.standard_normal(count)
    for pool in fit.stages[0].problem.pools:
        members = list(pool.members)
        centre[:, members] = random.normal(fit.z[members], pool.spread, (count, len(members)))
    return centre


def _of_simulated(problem: Problem, z, batch: Batch, reference_start) -> Ends:
    """Fits to simulated data; where velocities have errors the lowest of each one's minima near there."""
    first, fits = with_own_noise(problem, z, batch, reference_start), len(z)
    if not problem.has_velocity_errors or needs_variances(problem) or not len(problem.active):
        return first
    starts = along_valley(problem, first.z)
    twice, reference_start = (
        batch.select(np.tile(np.arange(fits), 2)),
        np.tile(reference_start, (2, 1)),
    )
    more = search(problem, starts, reference_start=reference_start, batch=twice, limit=STEPS)
    both = Ends._make(map(np.concatenate, zip(first, more, strict=True)))
    cost = np.where(both.converged, both.cost, np.inf).reshape(3, fits)
    return both.select(np.argmin(cost, axis=0) * fits + np.arange(fits))
