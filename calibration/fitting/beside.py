"""The paper's procedure beside a fit by `model`: how well Eq. (17) fits, and whether they agree."""

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
from calibration.fitting.specs import SetSpec, specs_of
from calibration.fitting.stages import Options

PLAIN = Options(optimiser="levenberg-marquardt", starts=4)
NOISELESS = 1e-9  # rms of ε about Eq. (17) below which data are a curve and no measurement
LOSSES = ("sigma", "psi", "eps_up")


def two_step_beside(fit: ComponentFit, spec: SetSpec) -> ComponentFit | None:
    """The same data by `two-step`; None where that procedure does not apply.

    It applies to Zhou's law of one data set whose χ̃ is free, whose losses are plainly free, and
    whose yield stays where it is.
    """
    if spec.model.key != "zhou" or len(fit.component.sets) > 1 or spec.objective != "model":
        return None
    free = {e.name for e in fit.component.elements}
    if not free <= {"chi", *LOSSES} or spec.data.limit_velocity is None or len(spec.data) <= 3:
        return None
    if any(e.parameter.prior is not None for e in fit.component.elements):
        return None
    two = specs_of([spec.data], "zhou", dict(spec.model.options), "two-step")
    names = [name for name in ("chi", "sigma", "psi") if name in free]
    bound = [*names, "sigma"] if "eps_up" in free else names
    component = assemble(two, fit.final.problem.route, bound)[0]
    return fit_component(component, PLAIN)


def eq_17_alone(data: RestitutionData) -> ComponentFit | None:
    """Eq. (17) against all points; None without a limit velocity."""
    if data.limit_velocity is None or len(data) <= 2:
        return None
    plain = replace(data, contact=None)
    return fit_component(assemble(specs_of([plain], "eq-17", None, None), None)[0], PLAIN)


def eq_17_of(fit: ComponentFit, g: int) -> tuple[float, dict[str, float]]:
    """Root mean square of ε about the first stage's Eq. (17), and its coefficients."""
    problem, place = fit.stages[0].problem, fit.component.sets.index(g)
    residual = problem.predict(fit.z[None])[0] - problem.points.restitution
    law = problem.law_of(fit.theta, place)
    names = ("limit_velocity", "sigma", "psi")
    values = {name: float(getattr(law, name)) for name in names}
    return float(np.sqrt(np.mean(residual[problem.points.set == place] ** 2))), values


def disagreements(
    two: ComponentFit, parameters: dict[str, Estimate], derived: dict[str, Estimate]
) -> list[Doubt]:
    """Doubts where ε_up or χ̃ are apart by more than their errors, on data with noise."""
    if eq_17_of(two, 0)[0] < NOISELESS:
        return []
    spec = two.component.specs[0]
    names = [e.name for e in two.component.elements]
    others = {"chi": estimate_of(two, names.index("chi"), None, 0.95)}
    others |= derived_of(two, spec, 0, 0.95)
    own = {**derived, **parameters}
    found = []
    for name in ("eps_up", "chi"):
        one, other = own.get(name), others.get(name)
        if one is None or other is None:
            continue
        first, second = ((e.value, e.standard_error) for e in (one, other))
        if None not in first and None not in second:
            found.append(doubts.disagreement(name, first, second, spec.data.name))
    return [one for one in found if one is not None]
