"""Values, standard errors and intervals of what was searched, in physical units."""

import numpy as np

from calibration.estimate import Estimate
from calibration.parameters import NONE
from calibration.profiles import FARTHEST, Profile, profile
from calibration.uncertainty import quantile

BOUND_MARGIN = 1e-6  # of the bounds' distance, or of the value


def physical_covariance(fitted):
    """Of the free parameters in physical units: D C D with D = ∂θ/∂z."""
    setup, known = fitted.setup, fitted.uncertainty
    by_position = {e.position: e.label for e in setup.elements}
    rows = [i for i, p in enumerate(known.positions) if int(p) in by_position]
    names = tuple(by_position[int(known.positions[i])] for i in rows)
    slope = _slopes(fitted)[known.positions[rows]]
    covariance = known.covariance[np.ix_(rows, rows)] * np.outer(slope, slope)
    return names, covariance


def _slopes(fitted) -> np.ndarray:
    return fitted.setup.layout.slope(fitted.z)


def _degrees_of(fitted, element) -> int | None:
    own = [fitted.uncertainty.degrees[g] for g in element.sets]
    return None if any(d is None for d in own) else sum(own)


def estimate_of(fitted, element, curve: Profile | None, confidence) -> Estimate:
    """Value, standard error and interval: the profile's where there is one."""
    setup, known = fitted.setup, fitted.uncertainty
    layout, i = setup.layout, element.position
    value = float(layout.physical(fitted.z, np)[i])
    bound = bound_reached(layout, i, value)
    if bound is None and is_held(fitted, element):
        return Estimate(None, method="undetermined", free=True)  # grows without bound
    if bound is not None:
        low, high = (None, None) if curve is None else (curve.low, curve.high)
        return Estimate(bound, None, low, high, "profile" if curve else "undetermined", True, True)
    row = known.of(i)
    if row is None or known.undetermined[row]:
        # nothing in the data says anything about it
        return Estimate(value, method="undetermined", free=True)
    z_error = float(np.sqrt(known.covariance[row, row]))
    error = abs(float(_slopes(fitted)[i])) * z_error
    if curve is not None:
        return Estimate(value, error, curve.low, curve.high, "profile", True)
    reach = quantile(confidence, _degrees_of(fitted, element)) * z_error
    ends = []
    for sign in (-1, 1):
        z = np.array(fitted.z)
        z[i] += sign * reach
        told = layout.kind[i] == NONE or reach < FARTHEST
        ends.append(float(layout.physical(z, np)[i]) if told else None)
    sandwich = any(setup.plans[g] == "two-step" for g in element.sets)
    robust = any(stage.problem.loss != "squared" for stage in fitted.stages)
    method = "sandwich" if sandwich or robust else "wald"
    return Estimate(value, error, ends[0], ends[1], method, True)


def is_held(fitted, element) -> bool:
    """Whether the search held it at an end of its range."""
    return any(element.position in stage.search.limits for stage in fitted.stages)


def bound_reached(layout, i: int, value: float) -> float | None:
    """The bound that a value lies at, if it does."""
    lower, upper = float(layout.lower[i]), float(layout.upper[i])
    span = upper - lower
    near = BOUND_MARGIN * (span if np.isfinite(span) else max(abs(value), 1.0))
    if layout.kind[i] != NONE and np.isfinite(lower) and not np.isfinite(upper) and lower == 0:
        near = 1e-6  # of a quantity that nears zero on a logarithmic scale
    if np.isfinite(lower) and value - lower <= near:
        return lower
    return upper if np.isfinite(upper) and upper - value <= near else None


def profiles_of(fitted, options, confidence) -> dict[str, Profile]:
    """Of Eq. (17)'s step and of `model`: where there is a likelihood. χ̃ of `two-step` has none."""
    setup, known = fitted.setup, fitted.uncertainty
    jobs = []
    for stage in fitted.stages:
        problem = stage.problem
        if problem.loss != "squared" or not stage.search.converged:
            continue
        if problem.kind == "model" and "two-step" in setup.plans:
            continue
        jobs += [(stage, e) for e in setup.elements if e.position in problem.active]
    curves = {}
    for k, (stage, e) in enumerate(jobs):
        options.tell("profiles", k, len(jobs))
        row = known.of(e.position)
        if known.undetermined[row]:
            continue
        variance = variance_of(fitted, stage.problem, e)
        step = float(np.sqrt(known.covariance[row, row]))
        if variance is None or not step > 1e-12:
            continue  # data without noise: the interval is a point
        reach = quantile(confidence, _degrees_of(fitted, e))
        curves[e.label] = profile(stage.problem, e.position, e.label, variance, step, reach)
    if jobs:
        options.tell("profiles", len(jobs), len(jobs))
    return curves


def variance_of(fitted, problem, element) -> float | None:
    """The weighted residuals' variance: 1 where u is stated, else the noise's; None where sets
    of one shared parameter differ in it."""
    weighted = {
        round(
            float((fitted.uncertainty.noise * problem.obs.weight)[fitted.setup.rows(g).start]), 14
        )
        for g in element.sets
    }
    variance = weighted.pop() ** 2
    return variance if not weighted and variance > 0 else None
