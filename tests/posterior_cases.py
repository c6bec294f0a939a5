"""What tests of posteriors share: the extra's packages, moments of draws and of densities on a grid."""

import importlib
import os
import warnings

import numpy as np
import pytest


def needed(name):
    """A package of the extra; where it has to be there its absence fails, else it skips."""
    try:
        return importlib.import_module(name)
    except FileNotFoundError:  # ArviZ notes the day in a file, which two workers replace at once
        return importlib.import_module(name)
    except ModuleNotFoundError:
        if "SOFTJAX_TEST_EXTRAS" in os.environ:
            raise
        pytest.skip("pip install softjax-contact[test-bayes]", allow_module_level=True)


with warnings.catch_warnings():
    warnings.simplefilter("ignore", FutureWarning)  # ArviZ 0.23 announces 1.0
    blackjax, az, xarray = needed("blackjax"), needed("arviz"), needed("xarray")


def made(**groups):
    """Groups of xarray data sets as what this ArviZ works on."""
    if az.__version__.startswith("0."):
        return az.InferenceData(**groups)
    return xarray.DataTree.from_dict(groups)


def values_of(data, name):
    """All draws of one variable, chain after chain."""
    return np.ravel(np.asarray(data["posterior"][name]))


def moments(draws):
    """Mean and standard deviation of draws (chains, draws), with the Monte Carlo errors of both."""
    draws = np.asarray(draws)
    spread = (draws - np.mean(draws)) ** 2
    deviation = np.std(draws)
    error = np.std(spread) / (2 * deviation) / float(az.ess(spread)) ** 0.5
    return np.mean(draws), deviation / float(az.ess(draws)) ** 0.5, deviation, error


def check_grid(posterior, log_density, **axes):
    """Draws' moments are those of the density on a grid, within 5 Monte Carlo errors, known to 7 %.

    Without the Jacobian of a transform a mean is off by more than 10 of these errors.
    """
    grid = np.meshgrid(*axes.values(), indexing="ij")
    density = log_density(*grid)
    weight = np.exp(density - np.max(density))
    weight /= np.sum(weight)
    for name, values in zip(axes, grid, strict=True):
        expected = np.sum(weight * values)
        width = np.sum(weight * (values - expected) ** 2) ** 0.5
        mean, error, deviation, its_error = moments(posterior["posterior"][name])
        assert error < 0.07 * width, name
        assert abs(mean - expected) < 5 * error, name
        assert abs(deviation - width) < 5 * its_error, name
