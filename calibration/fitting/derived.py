"""Numbers that follow from the parameters of Zhou's law, with their errors: ε_up, v_cr, χ̃ on a line."""

from collections.abc import Callable

import numpy as np

import softjax as sj
from calibration.data.paper import eq_17
from calibration.fitting.component_fit import ComponentFit
from calibration.fitting.estimate import Estimate
from calibration.fitting.specs import SetSpec
from calibration.fitting.transform import NONE
from calibration.fitting.uncertainty import quantile
from calibration.fitting.zhou import several_yields

STEP = 1e-3  # in z, of fourth-order differences: their error is near 1e-12


def critical_velocity_of(law: sj.Zhou) -> float:
    return float(np.mean(np.asarray(law.contact.critical_velocity)))


def eps_up_of(law: sj.Zhou) -> float:
    """ε_17(v_cr), Eq. (16)."""
    limit = float(np.mean(np.asarray(law.contact.limit_velocity)))
    critical = critical_velocity_of(law)
    if critical >= limit:
        return 0.0
    return float(eq_17(critical, limit, float(law.sigma), float(law.psi)))


def chi_of(law: sj.Zhou) -> float:
    return float(law.chi)


def derived_of(fit: ComponentFit, spec: SetSpec, g: int, confidence: float) -> dict[str, Estimate]:
    """What follows from Zhou's law of one data set; nothing for others.

    Of bodies that differ from impact to impact v_cr is the highest, and ε_up none.
    """
    if spec.model.law_type is not sj.Zhou:
        return {}
    problem = fit.final.problem
    critical = np.asarray(problem.yields_at(fit.z))[
        problem.points.set == fit.component.sets.index(g)
    ]
    found = {"critical_velocity": Estimate(float(np.max(critical)), method="derived")}
    names = spec.model.parameters
    if not (spec.by_eps_up or several_yields(spec.data.contact)):
        found["eps_up"] = _carried(fit, g, eps_up_of, confidence, (0.0, 1.0))
    if "chi" not in names:
        found["chi"] = _carried(fit, g, chi_of, confidence, (0.0, np.inf))
    return found


def _law(fit: ComponentFit, z: np.ndarray, g: int) -> sj.Zhou:
    problem, place = fit.final.problem, fit.component.sets.index(g)
    return problem.law_of(problem.transform.physical(z), place)  # type: ignore[return-value]


def _carried(fit: ComponentFit, g: int, what: Callable, confidence, ends) -> Estimate:
    """A number with the error that the covariance gives it."""
    value = what(_law(fit, fit.z, g))
    gradient = np.zeros(len(fit.z))
    for k, element in enumerate(fit.component.elements):
        if g in element.sets:
            gradient[k] = _slope(fit, k, g, what)
    acting = (gradient != 0) & (fit.uncertainty.limits[0] == 0)
    covariance = fit.uncertainty.covariance[0][np.ix_(acting, acting)]
    variance = float(gradient[acting] @ covariance @ gradient[acting]) if np.any(acting) else np.nan
    if not (np.isfinite(variance) and variance >= 0):
        return Estimate(value, method="derived")
    error = variance**0.5
    direction = np.where(acting, gradient, 0.0)
    degrees = fit.uncertainty.parts.along(direction[None])[0, 0]
    reach = quantile(confidence, degrees) * error
    low, high = float(max(value - reach, ends[0])), float(min(value + reach, ends[1]))
    return Estimate(value, error, low, high, "derived")


def _slope(fit: ComponentFit, k: int, g: int, what: Callable) -> float:
    def at(step: float) -> float:
        z = np.array(fit.z)
        z[k] += step
        return what(_law(fit, z, g))

    scaled = fit.final.problem.transform.kind[k] != NONE
    h = STEP * (1.0 if scaled else max(abs(float(fit.z[k])), 1e-6))
    return (8 * (at(h) - at(-h)) - (at(2 * h) - at(-2 * h))) / (12 * h)
