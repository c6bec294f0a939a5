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
from jaxtyping import ArrayLike, Bool, Float

import softjax as sj
from calibration.data import RestitutionData
from calibration.errors import DataError
from calibration.fitting.assembly import EMPIRICAL, Component, assemble
from calibration.fitting.bands import typical_noise
from calibration.fitting.collisions import Route
from calibration.fitting.law_model import OF_CONTACT
from calibration.fitting.noise import noise_of
from calibration.fitting.problem import Problem
from calibration.fitting.request import Request
from calibration.fitting.result import FitResult
from calibration.fitting.root import NO_REBOUND_BELOW
from calibration.fitting.rows import numbers_in
from calibration.fitting.search import search
from calibration.fitting.specs import Local, SetSpec
from calibration.fitting.uncertainty import Settled, Uncertainty, gradient_slopes, stacked
from calibration.fitting.zhou import eps_up_of
from calibration.parameters import Parameter, as_parameter
from softjax.fields import numbers_of, options_of, whole_fields

USUAL_NOISE = 0.01  # standard uncertainty of ε unless told
PLACEHOLDER = 0.5  # ε of data that have none yet
WIDE = (-np.inf, np.inf)

Column = Float[np.ndarray, "n"]
Impacts = tuple[Column, Column]  # v [m/s], and standard uncertainty of ε


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
        yields: the velocity at which an impact yields [m/s]; 0 for laws without.
    """

    specs: tuple[SetSpec, ...]
    measured: tuple[Impacts, ...]
    place: int
    route: Route
    by_first: bool = False
    noise: float = USUAL_NOISE
    yields: float = 0.0

    @property
    def objective(self) -> str:
        return self.specs[0].objective

    @property
    def is_likelihood(self) -> bool:
        """Whether the fit is one step, whose information is Fisher's."""
        return self.objective == "model"

    def component(
        self, velocity: Column, uncertainty: Column
    ) -> tuple[Component, Bool[np.ndarray, "points"]]:
        """The fit's problems on the curve itself, and which of the points are the planned ones."""
        every = [(v, u, np.zeros(len(v), bool)) for v, u in self.measured]
        planned = (velocity, uncertainty, np.ones(len(velocity), bool))
        every[self.place] = tuple(map(np.append, every[self.place], planned))  # type: ignore[call-overload]
        pairs = zip(self.specs, every, strict=True)
        specs = [replace(spec, data=_data(spec.data, v, u)) for spec, (v, u, _) in pairs]
        component = assemble(specs, self.route, EMPIRICAL)[0]
        source = component.stages[0 if self.by_first else -1][1]
        curve = source.predict(component.start[None])[0]
        # an impact that does not rebound tells nothing
        weight = (curve > NO_REBOUND_BELOW) / np.concatenate([u for _, u, _ in every])
        stages = tuple(
            (name, replace(p, points=p.points._replace(restitution=curve, weight=weight)))
            for name, p in component.stages
        )
        return replace(component, stages=stages), np.concatenate([new for *_, new in every])

    def fitted(
        self, velocity: Column, uncertainty: Column
    ) -> tuple[Component, Column, Uncertainty]:
        """The fit's problems, what it finds, z, and how well."""
        component, _ = self.component(velocity, uncertainty)
        z, stages = component.start[None], []
        for _, problem in component.stages:
            found = search(problem, z)
            z = found.z
            stages.append(Settled(problem, found.limits))
        return component, z[0], stacked(stages, z)


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


def relative_unit(problem: Problem, z: Column) -> Column:
    """dθ/dz over the size of θ: covariances in z times these are of ln θ."""
    theta = problem.transform.physical(z)
    return problem.transform.slope(z) / np.where(theta == 0, 1.0, np.abs(theta))


def equations(component: Component, z: Column) -> Equations:
    """Of a component in one stage or two, around z."""
    problems = [problem for _, problem in component.stages]
    p, count = len(z), problems[0].count
    slope, score = np.zeros((count, p, p)), np.zeros((count, p))
    prior_slope, prior_middle = np.zeros((p, p)), np.zeros((p, p))
    for k, problem in enumerate(problems):
        own, jacobian = problem.active, problem.linearise(z[None]).jacobian[0]
        added = np.zeros((len(jacobian), len(own), p))
        if k:
            added[:] = gradient_slopes(problem, z[None], np.arange(p))[0]
        else:
            added[:, :, own] = jacobian[:, :, None] * jacobian[:, None, :]
        slope[:, own], score[:, own] = added[:count], jacobian[:count]
        prior_slope[own] += np.sum(added[count:], axis=0)
        prior_middle[own, own] += np.sum(jacobian[count:] ** 2, axis=0)
    final = replace(problems[-1], active=np.arange(p))
    curve = final.weighed(np.ones(count)).linearise(z[None]).jacobian[0, :count]
    unit = 1 / relative_unit(final, z)
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
        there = checked_impacts(*((), 1.0) if measured is None else measured, "measured")
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


def _data(like: RestitutionData, velocity: Column, uncertainty: Column) -> RestitutionData:
    """Impacts of the same bodies, without a restitution yet."""
    limit = like.limit_velocity if like.contact is None else None
    level = np.full(len(velocity), PLACEHOLDER)
    return RestitutionData(
        velocity, level, like.contact, uncertainty, like.name, limit_velocity=limit
    )


def _of_law(law, every: Column, parameters, objective, route: Route, there: Impacts) -> Plan:
    for name, value in numbers_of(law).items():
        if np.ndim(value):
            raise DataError(name, f"of shape {np.shape(value)}", "a single number")
    limit = getattr(law, "limit_velocity", None)
    contact = getattr(law, "contact", None)
    level, limit = np.full(len(every), PLACEHOLDER), None if contact else limit
    data = RestitutionData(every, level, contact, name="the plan", limit_velocity=limit)
    said = _said(law, parameters)
    request = Request((data,), type(law), said, objective, route)
    spec = request.specs()[0]
    if objective is not None and spec.objective != objective:
        raise DataError("objective", objective, "model for a law without a contact")
    spec = replace(spec, local=tuple(_at(one, _truth(law, one.name)) for one in spec.local))
    by_time = isinstance(law, sj.RateDependentLaw)
    route = request.chosen_route([spec]) if by_time else route
    return _checked(Plan((spec,), (there,), 0, route, yields=_yields_at(law)))


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
    """The law's own value of a parameter; None where it has none, such as c1."""
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
    if value is None:
        value = local.start
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
        local = tuple(
            _at(one, values[one.name], determined.get(labels.get(one.name), False))
            for one in spec.local
        )
        placed.append(replace(spec, local=local))
    there = _there(result, component)
    by_first = one.objective == "two-step"
    place = component.sets.index(g)
    plan = Plan(
        tuple(placed), there, place, route, by_first, typical_noise(one), _yields_at(one.law)
    )
    return _checked(plan)


def _there(result: FitResult, component: Component) -> tuple[Impacts, ...]:
    """What the component's data sets have measured, with the errors that the fit gave them."""
    problem = component.stages[0][1]
    theta = [float(result.materials[e.sets[0]].values[e.name]) for e in component.elements]
    z = problem.transform.unconstrained(np.array(theta))
    deviation = noise_of(problem, z[None]).deviation[0]
    own = [problem.points.set == k for k in range(len(component.specs))]
    return tuple((problem.points.velocity[which], deviation[which]) for which in own)


def _yields_at(law: sj.ContactLaw) -> float:
    if not isinstance(law, sj.RateIndependentLaw):
        return 0.0
    velocity = float(np.asarray(law.elastic_velocity()))
    return velocity if np.isfinite(velocity) else 0.0


def _checked(plan: Plan) -> Plan:
    for spec in plan.specs:
        contact = spec.data.contact
        if contact is not None and any(map(np.ndim, contact.leaves().values())):
            raise DataError("contact", "other for each impact", "one for all impacts")
    if not any(one.parameter.free for spec in plan.specs for one in spec.local):
        raise DataError("parameters", "none free", "at least one that is free and determined")
    return plan
