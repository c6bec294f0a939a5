"""What tests of posteriors share: the extra's packages, small data, moments of a density on a grid."""

import importlib
import os
import warnings

import numpy as np
import pytest

import calibration as cal


def needed(name):
    """A package of the extra; where it has to be there its absence fails, else it skips."""
    if "SOFTJAX_TEST_EXTRAS" in os.environ:
        return importlib.import_module(name)
    return pytest.importorskip(name, reason="pip install softjax-contact[test-bayes]")


with warnings.catch_warnings():
    warnings.simplefilter("ignore", FutureWarning)  # ArviZ 0.23 announces 1.0
    blackjax, az, xarray = needed("blackjax"), needed("arviz"), needed("xarray")

V = np.linspace(0.5, 4.0, 16)


def level(noise=0.07, **told):
    """Restitutions about 0.93, near enough to 1 for the range to act."""
    errors = noise * np.random.default_rng(1).standard_normal(len(V))
    return cal.RestitutionData(V, 0.93 + errors, **told)


def moments(draws):
    """Mean and standard deviation of draws (chains, draws), with the Monte Carlo errors of both."""
    draws = np.asarray(draws)
    size = float(az.ess(draws))
    squares = float(az.ess((draws - np.mean(draws)) ** 2))
    deviation = np.std(draws)
    spread = (draws - np.mean(draws)) ** 2
    error = np.std(spread) / (2 * deviation) / squares**0.5
    return np.mean(draws), deviation / size**0.5, deviation, error


def on_grid(log_density, *axes):
    """Mean and standard deviation of each unknown under a density on a grid."""
    grid = np.meshgrid(*axes, indexing="ij")
    weight = np.exp(log_density(*grid) - np.max(log_density(*grid)))
    weight /= np.sum(weight)
    means = [np.sum(weight * one) for one in grid]
    return [(m, np.sum(weight * (one - m) ** 2) ** 0.5) for m, one in zip(means, grid, strict=True)]
