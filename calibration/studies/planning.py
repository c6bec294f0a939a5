"""Plans for a law that is known, and for a fit: what is free, what is true, what is there already.

Parameters that a fit has no standard error of are taken as known, and told.
"""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import jax
import numpy as np
from jaxtyping import ArrayLike

import softjax as sj
from calibration.data import RestitutionData
from calibration.errors import DataError
from calibration.fitting.assembly import Component, assemble, sets_beside
from calibration.fitting.collisions import Route
from calibration.fitting.curves import WIDE, yield_velocity
from calibration.fitting.law_model import OF_CONTACT
from calibration.fitting.noise import needs_weights, noise_of, reweighed
from calibration.fitting.pooling import LEAST
from calibration.fitting.problem import Problem
from calibration.fitting.request import Request
from calibration.fitting.result import FitResult
from calibration.fitting.rows import numbers_in
from calibration.fitting.specs import Local
from calibration.fitting.zhou import eps_up_of
from calibration.options import FitOptions
from calibration.parameters import Parameter, as_parameter
from calibration.rounding import number
from calibration.studies.planned import PLACEHOLDER, Column, Impacts, Plan
from softjax.fields import numbers_of, options_of, whole_fields

SETTLING = 8  # rounds in which true velocities and weights agree at where a fit ended
BY_HAND = (
    "to plan elsewhere take the law with values given by hand: `softjax sensitivity FILE.toml "
    "--chi … --sigma … --psi … --study design --from …`"
)


def plan_of(
    law: sj.ContactLaw | FitResult,
    reach: ArrayLike,
    *,
    parameters: Mapping[str, Any] | None = None,
    objective: str | None = None,
    route: Route = None,
    material: str | None = None,
    measured: tuple[ArrayLike, ArrayLike] | None = None,
) -> Plan:
    """The plan for a law, or for one of a fit's materials.

    Args:
        reach: velocities that are planned, or the ends of what can be [m/s].
        measured: velocities and uncertainties of ε of what is there already, for a law.

    The others are those of `fisher_information`.

    Raises:
        ValueError: naming the argument, its value and what is accepted.
    """
    reach = np.asarray(reach, float).ravel()
    with jax.enable_x64(True):
        if isinstance(law, FitResult):
            told = {"parameters": parameters, "objective": objective, "measured": measured}
            for name, value in told.items():
                if value is not None:
                    raise DataError(name, value, "left out with a fit, which has its own")
            return _of_fit(law, material, reach, route)
        if not isinstance(law, sj.ContactLaw):
            raise DataError("law", law, "a contact law or a FitResult")
        if material is not None:
            raise DataError("material", material, "left out with a law")
        v, u = ((), 1.0) if measured is None else measured
        there = checked_impacts(v, u, "measured")
        every = np.concatenate([there[0], reach])
        return _of_law(law, every, parameters or {}, objective, route, there)


def checked_impacts(velocity: ArrayLike, uncertainty: ArrayLike, name: str) -> Impacts:
    """Velocities and uncertainties of one length."""
    v, u = np.asarray(velocity, float).ravel(), np.asarray(uncertainty, float)
    if not (np.all(np.isfinite(u)) and np.all(u > 0)):
        raise DataError("uncertainty", uncertainty, "positive")
    if u.ndim and u.shape != v.shape:
        raise DataError(name, f"{u.size} uncertainties", f"one for all, or {v.size}")
    return v, np.broadcast_to(u, v.shape) if v.size else v


def _of_law(law, every: Column, parameters, objective, route: Route, there: Impacts) -> Plan:
    for name, value in numbers_of(law).items():
        if np.ndim(value):
            raise DataError(name, f"of shape {np.shape(value)}", "a single number")
    limit, contact = getattr(law, "limit_velocity", None), getattr(law, "contact", None)
    level, limit = np.full(len(every), PLACEHOLDER), None if contact else limit
    data = RestitutionData(
        every, level, contact, name="the plan", limit_velocity=limit, plausibility=False
    )
    said = _said(law, parameters)
    options = FitOptions.of(law=type(law), objective=objective, route=route)
    request = Request((data,), said, options)
    spec = request.specs()[0]
    if objective is not None and spec.objective != objective:
        raise DataError("objective", objective, "model for a law without a contact")
    spec = replace(spec, local=tuple(_at(one, _truth(law, one.name)) for one in spec.local))
    by_time = isinstance(law, sj.RateDependentLaw)
    route = request.chosen_route([spec]) if by_time else route
    return _checked(Plan((spec,), (there,), 0, route, yields=yield_velocity(law) or 0.0))


def _said(law: sj.ContactLaw, parameters: Mapping[str, Any]) -> dict[str, Any]:
    """What is said of the parameters, with the law's options and what of it is whole."""
    said = dict(parameters)
    for name, value in parameters.items():
        is_held = isinstance(value, Parameter) and not value.free and value.value is None
        if is_held and hasattr(law, name):
            said[name] = Parameter(getattr(law, name), free=False)
    for name in options_of(type(law)):
        said[name] = getattr(law, name)
    for name in whole_fields(type(law)):
        free = name in said and as_parameter(name, said[name]).free
        said[name] = Parameter(getattr(law, name), free=free)
    return said


def _truth(law: sj.ContactLaw, name: str) -> Any:
    """The law's own value of a parameter; None where it has none."""
    stem, _, entry = name.partition("[")
    if entry:
        return numbers_in(getattr(law, stem))[int(entry[:-1])]
    if name.startswith(OF_CONTACT):
        return getattr(law.contact, name.removeprefix(OF_CONTACT))  # type: ignore[attr-defined]
    if name == "eps_up":
        return float(eps_up_of(law))  # type: ignore[arg-type]
    return getattr(law, name, None)


def _at(local: Local, value: Any, is_determined: bool = True) -> Local:
    """A parameter that is known to be somewhere, free if it was; a prior's mean is there too."""
    parameter, ends = local.parameter, local.range
    if value is None:  # such as c1
        raise DataError("parameters", local.name, "of those whose value the law tells")
    if not parameter.free and parameter.value not in (None, value):
        accepted = f"the law's own, {value:g}, to be held at"
        raise DataError(f"parameters[{local.name!r}]", parameter.value, accepted)
    if not (parameter.free and is_determined):
        return replace(local, start=value, parameter=Parameter(free=False))
    if not local.declared.lower < value < local.declared.upper:
        raise DataError(local.name, value, f"{local.declared.accepted}, inside its range, or fixed")
    if not ends[0] < value < ends[1]:  # an end that was guessed from data
        parameter, ends = replace(parameter, bounds=None, transform="none"), WIDE
    prior = None if parameter.prior is None else (float(value), parameter.prior[1])
    return replace(
        local, start=value, parameter=replace(parameter, value=None, prior=prior), range=ends
    )


def _of_fit(result: FitResult, material: str | None, reach: Column, route: Route) -> Plan:
    one = result.material(material)
    g = result.materials.index(one)
    low, high = one.known_from, one.known_to
    if np.any((reach < low) | (reach > high)):
        end = f"up to {high:.4g} m/s" if low <= 0 else f"{low:.4g} m/s or more"
        accepted = f"{end}, where this fit knows the law; {BY_HAND}"
        outside = np.min(reach) if np.min(reach) < low else np.max(reach)
        raise DataError("velocity", float(outside), accepted)
    specs = result.request.specs()
    by_time = issubclass(one.model.law_type, sj.RateDependentLaw)
    route = result.request.chosen_route(specs) if route is None and by_time else route
    component = next(c for c in assemble(specs, route) if g in c.sets)
    names = result.covariance_names
    determined = dict(zip(names, np.isfinite(np.diag(result.covariance)), strict=True))
    placed = []
    for k, spec in zip(component.sets, component.specs, strict=True):
        values = result.materials[k].model.inside(result.materials[k].values)
        labels = result.materials[k].labels
        local = tuple(
            _at(one, values[one.name], determined.get(labels.get(one.name, ""), False))
            for one in spec.local
        )
        placed.append(replace(spec, local=local))
    problem, z = _settled(result, component)
    there, place = _there(problem, z), component.sets.index(g)
    # data sets are joined no more by a parameter that is held, as the fit did not determine it
    kept = sets_beside(place, placed)
    plan = Plan(
        tuple(placed[k] for k in kept),
        tuple(there[k] for k in kept),
        kept.index(place),
        route,
        by_first=one.objective == "two-step",
        shared=None if problem.shared is None else tuple(problem.shared[k] for k in kept),
        noise=float(np.sqrt(sum(one.variances.values()))),
        yields=yield_velocity(one.law) or 0.0,
        spreads={
            pool.name: max(result.pooled[pool.spread_name].value or 0.0, LEAST)
            for pool in component.stages[0][1].pools
        },
    )
    return _checked(plan)


def _settled(result: FitResult, component: Component) -> tuple[Problem, np.ndarray]:
    """The problem of what is measured, with the errors that the fit gave it, and where it ended."""
    problem = component.stages[0][1]
    theta = [float(result.materials[e.sets[0]].values[e.name]) for e in component.elements]
    z = problem.transform.unconstrained(np.array(theta))
    for _ in range(SETTLING if needs_weights(problem) else 0):
        problem = reweighed(problem, z)
    return problem, z


def _there(problem: Problem, z: np.ndarray) -> tuple[Impacts, ...]:
    """What the component's data sets have measured, with the errors that the fit gave them."""
    deviation = noise_of(problem, z[None]).deviation[0]
    own = [problem.points.set == k for k in range(len(problem.datasets))]
    return tuple((problem.points.velocity[which], deviation[which]) for which in own)


def _checked(plan: Plan) -> Plan:
    for spec in plan.specs:
        contact = spec.data.contact
        if contact is not None and any(map(np.ndim, contact.leaves().values())):
            raise DataError("contact", "other for each impact", "one for all impacts")
    if not any(one.parameter.free for spec in plan.specs for one in spec.local):
        raise DataError("parameters", "none free", "at least one that is free and determined")
    return plan


def taken_as_known(
    law: Any, material: str | None, targets: Iterable[str], plan: Plan
) -> tuple[str, ...]:
    """A sentence for each parameter that a plan from a fit takes as known, and on shared errors.

    Args:
        law: what is planned for: a fit, or a law, of which nothing is taken so.
        material: the data set of it.
        targets: labels of what errors are promised of.
        plan: for it.
    """
    if not isinstance(law, FitResult):
        return ()
    result, one = law, law.material(material)
    variance = dict(zip(result.covariance_names, np.diag(result.covariance), strict=True))
    open_ = [name for name, label in one.labels.items() if not np.isfinite(variance[label])]
    reasons = [_open(name, one.parameters.get(name)) for name in open_]
    if plan.is_likelihood and any(errors.variance for errors in plan.shared or ()):
        reasons.append("the variances of errors that points share are taken as known")
    targets = list(targets)
    return tuple(_sentence(why, targets, result) for why in reasons)


def _open(name: str, estimate: Any) -> str:
    at_bound = estimate is not None and estimate.at_bound and estimate.value is not None
    why = f"stands at its bound {number(estimate.value, 4)}" if at_bound else "is not determined"
    return f"{name} {why} and is taken as known"


def _sentence(why: str, targets: list[str], result: FitResult) -> str:
    whose = "error" if len(targets) == 1 else "errors"
    text = f"{why}: the {whose} of {', '.join(targets)} may be larger"
    intervals = [told for target in targets if (told := _interval(target, result))]
    return "; ".join([text, *intervals])


def _interval(target: str, result: FitResult) -> str:
    """The fit's own, and in parts of the value as the promised errors are."""
    estimate = result.estimates.get(target)
    if estimate is None or estimate.low is None or estimate.high is None:
        return ""
    ends, value = (estimate.low, estimate.high), estimate.value
    told = " to ".join(number(x, 4) for x in ends)
    text = f"the fit's {100 * result.confidence:g} % interval of {target} is {told}"
    if not value:
        return text
    parts = " to ".join(f"{100 * (x / value - 1):+.2g} %" for x in ends)
    return f"{text} ({parts})"
