"""Values, standard errors and intervals of what was searched.

An interval is the profile's where there is one, else θ(z ± q σ) with q the quantile of Student's t. No standard error is
given where it describes no interval: where an end of the profile's lies more than an eighth of its width from
value ± q σ. Of 1.0 ± 0.5 and q = 2 an interval from 0.2 to 2.2 is not skewed, one from 0.4 to 2.8 is:

>>> is_skewed(1.0, 0.5, 0.2, 2.2, 2.0), is_skewed(1.0, 0.5, 0.4, 2.8, 2.0)
(False, True)
"""

from dataclasses import replace

import numpy as np

from calibration.fitting.components import ComponentFit
from calibration.fitting.degrees_of_freedom import quantile
from calibration.fitting.elements import DRAG
from calibration.fitting.material import Estimate
from calibration.fitting.profiles import FARTHEST, Profile
from calibration.parameters import NONE

SKEWED = 1 / 8  # of an interval's width, see `is_skewed`


def estimates(
    fit: ComponentFit, curves: dict[str, Profile], confidence: float
) -> dict[int, Estimate]:
    """Estimates of each element of the component."""
    table = {}
    for k, e in enumerate(fit.component.elements):
        estimate = estimate_of(fit, k, curves.get(e.label), confidence)
        is_read = "[" not in e.name and e.name != DRAG
        if estimate.method == "wald" and estimate.standard_error is not None and is_read:
            estimate = replace(estimate, skewed=None)
            if not curves and np.any(fit.uncertainty.bound_side):  # too narrow: another is held
                estimate = replace(estimate, standard_error=None, low=None, high=None)
        table[k] = estimate
    return table


def is_skewed(value, error, low: float | None, high: float | None, quantile: float) -> bool:
    """Whether an end of an interval is an eighth of its width from value ± quantile · error."""
    if low is None or high is None:
        return True
    difference = max(abs(low - (value - quantile * error)), abs(high - (value + quantile * error)))
    return bool(difference > SKEWED * (high - low))


def estimate_of(fit: ComponentFit, k: int, curve: Profile | None, confidence: float) -> Estimate:
    """Value, standard error and interval: the profile's where there is one."""
    known, value = fit.uncertainty, float(fit.theta[k])
    if known.bound_side[k]:
        return _at_an_end(fit, k, curve)
    if known.undetermined[k]:
        return Estimate(value, method="undetermined", free=True)
    if not fit.has_intervals:
        return Estimate(value, method="none", free=True)
    transform = fit.final.problem.transform.part(np.array([k]))
    z_error = float(known.errors[k])
    slope = float(abs(transform.slope(fit.z[k : k + 1])[0]))
    error = slope * z_error if known.definite else None
    if curve is not None:
        q = float(quantile(confidence, known.parameter_dof[k]))
        skewed = error is not None and is_skewed(value, error, curve.low, curve.high, q)
        error = None if skewed else error
        return Estimate(value, error, curve.low, curve.high, "profile", True, False, skewed)
    reach = quantile(confidence, known.parameter_dof[k]) * z_error
    ends: list[float | None] = []
    for sign in (-1, 1):
        is_finite = transform.kind[0] == NONE or reach < FARTHEST
        end = transform.physical(fit.z[k : k + 1] + sign * reach)[0]
        ends.append(float(end) if is_finite else None)
    return Estimate(value, error, ends[0], ends[1], "wald", True)


def _at_an_end(fit: ComponentFit, k: int, curve: Profile | None) -> Estimate:
    """Estimate at a bound, with a one-sided interval if there is a profile; or one that grew without bound."""
    limit = fit.uncertainty.bound_side[k]
    bound = float(fit.final.problem.transform.bound_beyond(limit)[k])
    low, high = (None, None) if curve is None else (curve.low, curve.high)
    method = "undetermined" if curve is None else "profile"
    if not np.isfinite(bound):
        return Estimate(None, None, low, high, method, True)
    return Estimate(bound, None, low, high, method, True, True)
