"""A posterior from a fit: where it ended is where chains start."""

import importlib.metadata
import json
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from calibration.data.checks import check_whole
from calibration.errors import DataError
from calibration.fitting.component_fit import ComponentFit
from calibration.fitting.posterior.coordinates import Scaling
from calibration.fitting.posterior.density import Density, density_of
from calibration.fitting.posterior.extra import needed
from calibration.fitting.posterior.inference_data import inference_data
from calibration.fitting.posterior.nuts import SHARP, SMOOTH, Progress, Sampler
from calibration.fitting.request import Request
from calibration.fitting.traceable import traceable

APART = 1.5  # standard deviations that chains start apart from where the fit ended
LEAST_WARMUP = 50


def sampled(
    request: Request,
    fits: Sequence[ComponentFit],
    draws: int = 1000,
    chains: int = 4,
    seed: int = 0,
    warmup: int = 1000,
    progress: Progress = None,
) -> Any:
    """Draws from the posterior of a fit's parameters; see `FitResult.posterior`."""
    _check(draws, chains, seed, warmup)
    check_possible(request.options.objective, request.options.loss)
    with jax.enable_x64(True):
        problem = traceable(request)
        if not (problem.names or problem.noises):
            accepted = "one that is free, or noise that is not stated, for a posterior"
            raise DataError("parameters", "none free", accepted)
        density, scaling = density_of(problem, fits)
        measured = np.concatenate([one.data.restitution for one in density.problem.sets])
        arrays = (Scaling(*map(jnp.asarray, scaling)), jnp.asarray(measured))
        sharp = density.straight.has_corners(scaling.centre)
        sampler = Sampler(density.log_density, SHARP if sharp else SMOOTH)
        starts = _starts(len(density.labels), chains, seed)
        found = sampler.run(starts, arrays, draws, warmup, seed, progress)
        return inference_data(density, scaling, found, seed, _told(density, seed, warmup))


def check_possible(objective: str | None, loss: str) -> None:
    """Refuse what has no posterior, or cannot be sampled here.

    Raises:
        ImportError: without the extra.
        ValueError: for what was no likelihood.
    """
    for package in ("blackjax", "arviz"):
        needed(package)
    if objective == "two-step":
        raise DataError("objective", "two-step", "model for a posterior: it has a likelihood")
    if loss != "squared":
        raise DataError("loss", loss, "squared for a posterior")


def _check(draws: int, chains: int, seed: int, warmup: int) -> None:
    least = {"draws": 4, "chains": 1, "seed": 0, "warmup": LEAST_WARMUP}
    given = {"draws": draws, "chains": chains, "seed": seed, "warmup": warmup}
    for name, value in given.items():
        check_whole(name, value, least[name])


def _starts(count: int, chains: int, seed: int) -> np.ndarray:
    random = np.random.default_rng(seed)
    return APART * random.standard_normal((chains, count))


def _told(density: Density, seed: int, warmup: int) -> dict[str, Any]:
    """How it was made, in the posterior's attributes."""
    versions = {name: importlib.metadata.version(name) for name in ("blackjax", "arviz", "jax")}
    priors = {one.label: one.told for one in density.priors.each}
    return {
        "inference_library": "blackjax",
        "inference_library_version": versions["blackjax"],
        "sampler": "NUTS",
        "seed": seed,
        "warmup": warmup,
        "priors": json.dumps(priors, ensure_ascii=False),
        "versions": json.dumps(versions),
    }
