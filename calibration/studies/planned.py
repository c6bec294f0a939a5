"""A fit of impacts that are only planned: the fit's own problem, on data without noise.

What such a fit would find and how well is what the engine says of it: its searches, and its stacked
covariance at where they end. Under `model` they end at the law itself. Under `two-step` they need
not: Eq. (17) fitted to a law's curve is another curve than Eq. (17) with that law's σ and ψ, and the
errors are those of what is found.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import ArrayLike, Float

import softjax as sj
from calibration.data import RestitutionData
from calibration.errors import DataError
from calibration.fitting.assembly import EMPIRICAL, Component, assemble
from calibration.fitting.bands import typical_noise
from calibration.fitting.collisions import Route
from calibration.fitting.component_fit import ComponentFit, fit_component
from calibration.fitting.law_model import OF_CONTACT
from calibration.fitting.noise import noise_of
from calibration.fitting.request import Request
from calibration.fitting.result import FitResult
from calibration.fitting.root import NO_REBOUND_BELOW
from calibration.fitting.rows import numbers_in
from calibration.fitting.specs import Local, SetSpec
from calibration.fitting.stages import Options
from calibration.fitting.uncertainty import gradient_slopes
from calibration.fitting.zhou import eps_up_of
from calibration.parameters import Parameter, as_parameter
from softjax.fields import numbers_of, options_of, whole_fields

SEARCH = Options(optimiser="levenberg-marquardt", starts=1)
USUAL_NOISE = 0.01  # standard uncertainty of ε unless told
TELLS_NOTHING = 1e3  # that of an impact that does not rebound
PLACEHOLDER = 0.5  # ε of data that have none yet
WIDE = (-np.inf, np.inf)

Column = Float[np.ndarray, "n"]


class Measured(NamedTuple):
    """Impacts of a data set: v [m/s], and standard uncertainty of ε."""

    velocity: Column
    uncertainty: Column

    def joined(self, other: "Measured") -> "Measured":
        return Measured(*(np.concatenate(pair) for pair in zip(self, other, strict=True)))


@dataclass(frozen=True)
class Plan:
    """What a fit of planned impacts rests on.

    Attributes:
        specs: of the data sets that are fitted together, every parameter where the law has it.
        measured: what each of them has already.
        place: which of them the planned impacts belong to.
        route: from a law to ε.
        by_first: whether the first stage's curve is what is measured, as a fit in two steps takes
            it; else the law's own.
        noise: standard uncertainty of one more ε.
        known: velocities between which the law is known [m/s].
    """

    specs: tuple[SetSpec, ...]
    measured: tuple[Measured, ...]
    place: int
    route: Route
    by_first: bool = False
    noise: float = USUAL_NOISE
    known: tuple[float, float] = (0.0, np.inf)

    @property
    def objective(self) -> str:
        return self.specs[0].objective

    def fitted(self, velocity: Column, uncertainty: Column) -> ComponentFit:
        """The fit of what was measured and of planned impacts, to the curve itself."""
        points = list(self.measured)
        points[self.place] = points[self.place].joined(Measured(velocity, uncertainty))
        component, curve = self._without_noise(points)
        if np.any(curve <= NO_REBOUND_BELOW):
            errors = np.concatenate([one.uncertainty for one in points])
            errors = np.where(curve > NO_REBOUND_BELOW, errors, TELLS_NOTHING)
            ends = np.cumsum([len(one.velocity) for one in points])[:-1]
            parts = zip(points, np.split(errors, ends), strict=True)
            component, curve = self._without_noise([Measured(p.velocity, u) for p, u in parts])
        return fit_component(component, SEARCH)

    def _without_noise(self, points: list[Measured]) -> tuple[Component, Column]:
        """The component of these impacts, and the curve that they are on."""
        specs = [
            replace(spec, data=_data(spec.data, *own))
            for spec, own in zip(self.specs, points, strict=True)
        ]
        component = assemble(specs, self.route, EMPIRICAL)[0]
        source = component.stages[0 if self.by_first else -1][1]
        curve = source.predict(component.start[None])[0]
        stages = tuple(
            (name, replace(problem, points=problem.points._replace(restitution=curve)))
            for name, problem in component.stages
        )
        return replace(component, stages=stages), curve


class Equations(NamedTuple):
    """What each impact adds to the estimating equations of a fit, in relative changes of θ.

    Attributes:
        slope: to A, (points, p, p).
        score: G u, so that the middle matrix is Σ G Gᵀ u², (points, p).
        prior_slope, prior_middle: what the priors add to A and to the middle, (p, p).
        curve: slopes of ε itself, (points, p).
    """

    slope: Float[np.ndarray, "points p p"]
    score: Float[np.ndarray, "points p"]
    prior_slope: Float[np.ndarray, "p p"]
    prior_middle: Float[np.ndarray, "p p"]
    curve: Float[np.ndarray, "points p"]


def relative_unit(fit: ComponentFit) -> Column:
    """dθ/dz over the size of θ: covariances in z times these are of ln θ."""
    theta = fit.theta
    return fit.final.problem.transform.slope(fit.z) / np.where(theta == 0, 1.0, np.abs(theta))


def equations(fit: ComponentFit) -> Equations:
    """Of a fit in one stage or two."""
    problems = [stage.problem for stage in fit.stages]
    p, count, z = len(fit.z), problems[0].count, fit.z[None]
    slope, score = np.zeros((count, p, p)), np.zeros((count, p))
    prior_slope, prior_middle = np.zeros((p, p)), np.zeros((p, p))
    for k, problem in enumerate(problems):
        own, jacobian = problem.active, problem.linearise(z).jacobian[0]
        added = np.zeros((len(jacobian), len(own), p))
        if k:
            added[:] = gradient_slopes(problem, z, np.arange(p))[0]
        else:
            added[:, :, own] = jacobian[:, :, None] * jacobian[:, None, :]
        slope[:, own], score[:, own] = added[:count], jacobian[:count]
        prior_slope[own] += np.sum(added[count:], axis=0)
        prior_middle[own, own] += np.sum(jacobian[count:] ** 2, axis=0)
    final = replace(problems[-1], active=np.arange(p))
    curve = final.linearise(z).jacobian[0, :count] / final.points.weight[:, None]
    unit = 1 / relative_unit(fit)
    both = np.outer(unit, unit)
    return Equations(
        slope * both, score * unit, prior_slope * both, prior_middle * both, curve * unit
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
        law: as far as it is known; or a fit, whose objective, priors and points are its own, and of
            whose parameters those count that it determined.
        reach: velocities that are planned, or the ends of what can be [m/s].
        parameters: as `fit` takes them: which are free, their priors; those not free are held at
            the law's own value. All of them as there, if left out.
        objective: "model" unless told.
        route: from the law to ε: the energy balance where it can.
        material: which one of a fit's.
        measured: velocities and uncertainties of ε of what is there already, for a law.

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
        there = checked_impacts(*(measured or ((), ())), "measured")
        every = np.concatenate([there.velocity, reach])
        return _of_law(law, every, parameters or {}, objective, route, there)


def checked_impacts(velocity: ArrayLike, uncertainty: ArrayLike, name: str) -> Measured:
    """Velocities and uncertainties of one length."""
    v, u = np.asarray(velocity, float).ravel(), np.asarray(uncertainty, float)
    if not (np.all(np.isfinite(u)) and np.all(u > 0)):
        raise DataError("uncertainty", uncertainty, "positive")
    if u.ndim and u.shape != v.shape:
        raise DataError(name, f"{u.size} uncertainties", f"one for all, or {v.size}")
    return Measured(v, np.broadcast_to(u, v.shape) if v.size else v)


def _data(like: RestitutionData, velocity: Column, uncertainty: Column) -> RestitutionData:
    """Impacts of the same bodies, without a restitution yet."""
    limit = like.limit_velocity if like.contact is None else None
    level = np.full(len(velocity), PLACEHOLDER)
    return RestitutionData(
        velocity, level, like.contact, uncertainty, like.name, limit_velocity=limit
    )


def _of_law(law, every: Column, parameters, objective, route: Route, there: Measured) -> Plan:
    for name, value in numbers_of(law).items():
        if np.ndim(value):
            raise DataError(name, f"of shape {np.shape(value)}", "a single number")
    limit = getattr(law, "limit_velocity", None)
    contact = getattr(law, "contact", None)
    data = RestitutionData(
        every, np.full(len(every), PLACEHOLDER), contact, limit_velocity=None if contact else limit
    )
    said = _said(law, parameters)
    request = Request((data,), type(law), said, objective, route)
    spec = request.specs()[0]
    spec = replace(spec, local=tuple(_at(one, _truth(law, one.name)) for one in spec.local))
    by_time = isinstance(law, sj.RateDependentLaw)
    route = request.chosen_route([spec]) if by_time else route
    return _checked(Plan((spec,), (there,), 0, route))


def _said(law: sj.ContactLaw, parameters: Mapping[str, Any]) -> dict[str, Any]:
    """What is said of the parameters, with the law's options and what of it is whole."""
    said = dict(parameters)
    for name in options_of(type(law)):
        said[name] = getattr(law, name)
    for name in whole_fields(type(law)):
        free = name in said and as_parameter(name, said[name]).free
        said[name] = Parameter(getattr(law, name), free=free)
    return said


def _truth(law: sj.ContactLaw, name: str) -> Any:
    """The law's own value of a parameter; None where it has none, such as c1."""
    stem, _, entry = name.partition("[")
    if entry:
        return numbers_in(getattr(law, stem))[int(entry[:-1])]
    if name.startswith(OF_CONTACT):
        return getattr(law.contact, name.removeprefix(OF_CONTACT))  # type: ignore[attr-defined]
    if name == "eps_up":
        return float(eps_up_of(law))  # type: ignore[arg-type]
    return getattr(law, name, None)


def _at(local: Local, value: Any) -> Local:
    """A parameter that is known to be somewhere, as free as before; a prior's mean is there too."""
    if value is None:
        value = local.start
    if not local.parameter.free:
        if local.parameter.value not in (None, value):
            accepted = f"the law's own, {value:g}, to be held at"
            raise DataError(f"parameters[{local.name!r}]", local.parameter.value, accepted)
        return replace(local, start=value)
    if not local.declared.lower < value < local.declared.upper:
        raise DataError(local.name, value, f"{local.declared.accepted}, inside its range, or fixed")
    parameter, ends = local.parameter, local.range
    if not ends[0] < value < ends[1]:  # an end that was guessed from data
        parameter, ends = replace(parameter, bounds=None, transform="none"), WIDE
    if parameter.prior is not None:
        parameter = replace(parameter, prior=(float(value), parameter.prior[1]))
    return replace(local, start=value, parameter=replace(parameter, value=None), range=ends)


def _of_fit(result: FitResult, material: str | None, reach: Column, route: Route) -> Plan:
    one = result.material(material)
    g = result.materials.index(one)
    low, high = one.known_from, one.known_to
    if np.any((reach < low) | (reach > high)):
        accepted = f"from {low:.4g} to {high:.4g} m/s, where this fit knows the law"
        raise DataError("velocity", float(np.min(reach)), accepted)
    specs = result.request.specs()
    by_time = issubclass(one.model.law_type, sj.RateDependentLaw)
    route = result.request.chosen_route(specs) if route is None and by_time else route
    component = next(c for c in assemble(specs, route) if g in c.sets)
    names = result.covariance_names
    determined = dict(zip(names, np.isfinite(np.diag(result.covariance)), strict=True))
    placed = []
    for k, spec in zip(component.sets, component.specs, strict=True):
        values, labels = result.materials[k].values, result.materials[k].labels
        local = [
            _held_or_free(l, values[l.name], determined.get(labels.get(l.name, ""), False))
            for l in spec.local
        ]
        placed.append(replace(spec, local=tuple(local)))
    there = _there(result, component)
    by_first = one.objective == "two-step"
    place = component.sets.index(g)
    plan = Plan(tuple(placed), there, place, route, by_first, typical_noise(one), (low, high))
    return _checked(plan)


def _held_or_free(local: Local, value: Any, is_determined: bool) -> Local:
    if local.parameter.free and not is_determined:
        local = replace(local, parameter=Parameter(free=False))
    return _at(local, value)


def _there(result: FitResult, component: Component) -> tuple[Measured, ...]:
    """What the component's data sets have measured, with the errors that the fit gave them."""
    problem = component.stages[0][1]
    theta = [float(result.materials[e.sets[0]].values[e.name]) for e in component.elements]
    z = problem.transform.unconstrained(np.array(theta))
    deviation = noise_of(problem, z[None]).deviation[0]
    sets = range(len(component.specs))
    own = [problem.points.set == k for k in sets]
    return tuple(Measured(problem.points.velocity[which], deviation[which]) for which in own)


def _checked(plan: Plan) -> Plan:
    for spec in plan.specs:
        contact = spec.data.contact
        if contact is not None and any(map(np.ndim, contact.leaves().values())):
            raise DataError("contact", "other for each impact", "one for all impacts")
    if not any(one.parameter.free for spec in plan.specs for one in spec.local):
        raise DataError("parameters", "none free", "at least one that is free and determined")
    return plan
