"""One data set's part of a result: its parameters, what follows from them, how closely it fits."""

from dataclasses import fields, replace

import numpy as np

import softjax as sj
from calibration.fitting.component_fit import ComponentFit
from calibration.fitting.derived import derived_of
from calibration.fitting.doubt import Doubt
from calibration.fitting.eq_17 import disagreements, eq_17_alone, eq_17_of
from calibration.fitting.estimate import Estimate
from calibration.fitting.goodness import goodness_of
from calibration.fitting.material import Goodness, MaterialFit
from calibration.fitting.specs import SetSpec
from calibration.fitting.suspicions import material_doubts, observed_doubts
from calibration.fitting.zhou import several_yields
from calibration.observables import RESTITUTION

OF_RESTITUTION = [one.name for one in fields(Goodness)]


def summarise_material(
    fit: ComponentFit,
    g: int,
    estimates: dict[int, Estimate],
    confidence: float,
    shared: list[Doubt],
) -> MaterialFit:
    """One data set's part of the result."""
    place = fit.component.sets.index(g)
    spec, problem = fit.component.specs[place], fit.final.problem
    found = problem.linearise(fit.z[None], slopes=False)
    goodness = goodness_of(fit, place)
    first = problem.of_restitution(place)
    residual = found.prediction[0][first] - problem.points.value[first]
    of_eps = goodness.get(RESTITUTION) or next(iter(goodness.values()))
    every = {name: getattr(of_eps, name) for name in OF_RESTITUTION}
    every["outliers"] = tuple(one for own in goodness.values() for one in own.outliers)
    known_from, known_to = _known(fit, spec, g)
    values, labels = _values(fit, spec, g)
    part = MaterialFit(
        data=spec.data,
        objective=spec.objective,
        model=spec.model,
        parameters=_parameters(fit, spec, g, estimates, known_to),
        derived=derived_of(fit, spec, g, confidence),
        values=values,
        labels=labels,
        trees=spec.trees,
        rms_empirical=None,
        empirical=None,
        converged=fit.converged,
        status=tuple(map(int, found.status[0][first])),
        known_from=known_from,
        known_to=known_to,
        observed={name: one for name, one in goodness.items() if name != RESTITUTION},
        **every,
    )
    rms_empirical, empirical, apart = _eq_17(fit, spec, part, g)
    part = replace(part, rms_empirical=rms_empirical, empirical=empirical)
    own = [d for d in shared if d.material == spec.data.name] + apart
    errors = dict(zip(goodness, spec.errors, strict=True))
    if RESTITUTION in errors:
        own += material_doubts(part, residual, errors[RESTITUTION])
    for name, one in part.observed.items():
        own += observed_doubts(part, name, one, errors[name])
    return replace(part, warnings=tuple(own))


def _parameters(
    fit: ComponentFit, spec: SetSpec, g: int, estimates, known_to
) -> dict[str, Estimate]:
    """Those that were free, and those that were held; numbers of a whole parameter left out."""
    found, places = {}, fit.component.places(g)
    for local in spec.local:
        if "[" in local.name:
            continue
        place = places.get(local.name)
        if place is not None:
            found[local.name] = estimates[place]
        elif not local.stands_in:
            acts = np.isinf(known_to) or local.name not in ("chi", "c1", "c2")
            value = float(np.mean(np.asarray(local.start))) if acts else None
            found[local.name] = Estimate(value, method="fixed")
    return found


def _values(fit: ComponentFit, spec: SetSpec, g: int):
    """All that makes the law, and what the covariance calls what was free."""
    values, labels = {}, {}
    places = fit.component.places(g)
    for local in spec.local:
        place = places.get(local.name)
        if place is None:
            values[local.name] = local.start
        else:
            values[local.name] = float(fit.theta[place])
            labels[local.name] = fit.component.elements[place].label
    return values, labels


def _known(fit: ComponentFit, spec: SetSpec, g: int) -> tuple[float, float]:
    """Between which velocities the fit knows anything of the curve.

    By `model` σ and ψ are known from points below yield, or from pairs that yield at several
    velocities, χ̃ from points above: else only where they were given. Of bodies that differ from impact
    to impact the ends are those that hold for all.
    """
    if spec.model.law_type is not sj.Zhou or spec.objective != "model":
        return 0.0, np.inf
    problem, place = fit.final.problem, fit.component.sets.index(g)
    own = problem.points.set == place
    critical = np.asarray(problem.yields_at(fit.z))[own]
    below = problem.points.velocity[own] <= critical
    free = {e.name for e in fit.component.elements if g in e.sets}
    told = {e.name for e in fit.component.elements if e.parameter.prior is not None}
    needs_below = spec.by_eps_up or ({"sigma", "psi"} & free) - told
    above_is_open = "chi" in {local.name for local in spec.local if local.parameter.value is None}
    several = not spec.by_eps_up and several_yields(spec.data.contact)
    knows_below = bool(np.any(below)) or not needs_below or several
    chi_told = not np.all(below) or not ({"chi", "c1", "c2"} & free or above_is_open)
    known_from = 0.0 if knows_below else float(np.max(critical))
    return known_from, (np.inf if chi_told else float(np.min(critical)))


def _eq_17(fit: ComponentFit, spec: SetSpec, part: MaterialFit, g: int):
    """Eq. (17) beside Zhou's law: its rms and coefficients, and whether `model` disagrees with `two-step`."""
    if spec.model.law_type is sj.EmpiricalRestitution:
        return part.rms, part.values, []
    if spec.model.law_type is not sj.Zhou:
        return None, None, []
    if spec.objective == "two-step":
        return *eq_17_of(fit, g), disagreements(fit, g, {**part.derived, **part.parameters})
    alone = eq_17_alone(spec.data)
    return (None, None, []) if alone is None else (*eq_17_of(alone, 0), [])
