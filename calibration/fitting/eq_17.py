"""Eq. (17) beside Zhou's law: how well it fits, and whether `two-step` and `model` agree."""

from dataclasses import replace

import numpy as np

from calibration.data import RestitutionData
from calibration.fitting import doubt as doubts
from calibration.fitting.assembly import assemble
from calibration.fitting.component_fit import ComponentFit, fit_component
from calibration.fitting.derived import derived_of
from calibration.fitting.doubt import Doubt
from calibration.fitting.estimate import Estimate
from calibration.fitting.intervals import estimate_of
from calibration.fitting.specs import specs_of
from calibration.options import FitOptions

PLAIN = FitOptions(optimiser="levenberg-marquardt", starts=4)
NOISELESS = 1e-9  # rms of ε about Eq. (17) below which data are a curve and no measurement


def eq_17_alone(data: RestitutionData) -> ComponentFit | None:
    """Eq. (17) against all points; None without a limit velocity."""
    if data.limit_velocity is None or np.sum(np.isfinite(data.restitution)) <= 2:
        return None
    plain = replace(data, contact=None, observed=())
    return fit_component(assemble(specs_of([plain], "eq-17", None, None), None)[0], PLAIN)


def eq_17_of(fit: ComponentFit, g: int) -> tuple[float, dict[str, float]]:
    """Root mean square of ε about the first stage's Eq. (17), and its coefficients."""
    problem, place = fit.stages[0].problem, fit.component.sets.index(g)
    residual = problem.predict(fit.z[None])[0] - problem.points.value
    law = problem.law_of(fit.theta, place)
    names = ("limit_velocity", "sigma", "psi")
    values = {name: float(getattr(law, name)) for name in names}
    return float(np.sqrt(np.mean(residual[problem.of_restitution(place)] ** 2))), values


def disagreements(two: ComponentFit, g: int, parameters: dict[str, Estimate]) -> list[Doubt]:
    """Doubts where a fit by `model` has another ε_up or χ̃, by more than their errors.

    Args:
        two: the fit by `two-step`, of data with noise; of a curve without any nothing is compared.
        g: the data set.
        parameters: what that fit found, derived numbers included.
    """
    component = two.component
    free = {e.name: e.parameter.prior for e in component.elements}
    plainly_free = set(free) == {"chi", "sigma", "psi"} and not any(free.values())
    if len(component.sets) > 1 or not plainly_free or eq_17_of(two, g)[0] < NOISELESS:
        return []
    spec = component.specs[0]
    own = specs_of([spec.data], "zhou", dict(spec.model.options), "model")
    fit = fit_component(assemble(own, None)[0], PLAIN)
    others = derived_of(fit, fit.component.specs[0], 0, 0.95)
    for k, element in enumerate(fit.component.elements):
        others[element.name] = estimate_of(fit, k, None, 0.95)
    found = []
    for name in ("eps_up", "chi"):
        one, other = others.get(name), parameters.get(name)
        if one is None or other is None:
            continue
        first, second = ((e.value, e.standard_error) for e in (one, other))
        if None not in first and None not in second:
            found.append(doubts.disagreement(name, first, second, spec.data.name))
    return [one for one in found if one is not None]
