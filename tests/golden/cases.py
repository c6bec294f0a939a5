"""Bodies and data sets that several scenarios share, and what is recorded of a fit."""

from functools import cache

import numpy as np

import calibration as cal
import softjax as sj
from tests.golden import simulated
from tests.golden.numbers import Numbers

QUICK = {"starts": 8, "profiles": False}


def contact(material=simulated.ALLOY, radius=simulated.RADIUS, area="zhou"):
    body = sj.Material(*material)
    return sj.Contact.between_spheres(body, body, radius, radius, area=area)


def rebounds(uncertainty=0.003, name="alloy", material=simulated.ALLOY, measured=None, **made):
    """A data set that follows Zhou's law, or the measured (v, ε)."""
    velocity, restitution = measured or simulated.rebounds(material, **made)
    return cal.RestitutionData(velocity, restitution, contact(material), uncertainty, name)


@cache
def plain_fit():
    """Of Zhou's law to the data set as it is, for what is made of a fit."""
    return cal.fit(rebounds(), **QUICK)


def record_fit(numbers: Numbers, result: cal.FitResult, name="", *, weighted=False) -> None:
    """Estimates, standard errors, intervals, rms and the likelihood.

    Args:
        weighted: whether errors that are estimated themselves weigh the points: then whatever was
            found may move with the model of the errors.
    """
    estimate = numbers.error if weighted else numbers.estimate
    for label, error in result.standard_errors.items():
        if error is not None and np.isnan(error) and label in result.covariance_names:
            place = result.covariance_names.index(
                label
            )  # of the curvature, where no table prints it
            error = float(np.sqrt(result.covariance[place, place]))
        if error is None or np.isnan(error):  # an arbitrary number where nothing determines it
            numbers.text("error", f"{name}{label} has no error", "none")
            continue
        low, high = result.intervals[label]
        alone = 0.1 * error if weighted else error
        estimate(f"{name}{label}", result.values[label], alone)
        numbers.error(f"{name}{label} error, interval", [error, low, high], error)
    data = result.data if isinstance(result.data, dict) else {"": result.data}
    rms = result.rms if isinstance(result.rms, dict) else {"": result.rms}
    for key, size in rms.items():
        estimate(f"{name}rms {key}".rstrip(), size, 0.1 * size / np.sqrt(len(data[key])))
    if result.log_likelihood is not None:
        likelihood = [result.log_likelihood, result.aic, result.bic]
        estimate(f"{name}ln L, AIC, BIC", likelihood, 0.01 if weighted else 0.1)
    numbers.text("estimate", f"{name}converged", str(bool(result.converged)))


def record_band(numbers: Numbers, band: cal.Band, name: str, *, weighted=False) -> None:
    """A curve with its ends; a quarter of their distance is the standard error, nearly."""
    error = (band.high - band.low) / 4
    estimate = numbers.error if weighted else numbers.estimate
    estimate(name, band.coefficient, error)
    numbers.error(f"{name}, low", band.low, error)
    numbers.error(f"{name}, high", band.high, error)
