"""Build the search problems from data, laws and parameters.

Sets that share no parameter are fits of their own, whatever else is fitted with them: components. A
component has one vector z of all its elements, and one problem a stage, which searches some of them."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

import softjax as sj
from calibration.data import RestitutionData
from calibration.data.air import UNCERTAIN
from calibration.errors import DataError
from calibration.fitting.branches import held_at
from calibration.fitting.collisions import Laws, Route
from calibration.fitting.laws import (
    CONTACT_LEAVES,
    MOVE_YIELD,
    NOT_GIVEN,
    OF_CONTACT,
    LawModel,
    model_of_class,
    zhou_model,
)
from calibration.fitting.problem import DRAG, Element, Points, Problem, pools_of
from calibration.fitting.request import Request, SetSpec, blocks_of, placed
from calibration.observables import OBSERVABLES, PLACES, RESTITUTION
from calibration.parameters import Parameter, Transform
from softjax.fields import Declared

LEAST_RANGE, POWERS = 0.2, (-1.0, 0.0)  # of ln v, and of what power of v a curve may be
LIMIT = OF_CONTACT + "limit_velocity"
EMPIRICAL = ("sigma", "psi", LIMIT)  # searched by Eq. (17)'s stage


@dataclass(frozen=True)
class Component:
    """Data sets that share parameters, and the stages of their fit."""

    sets: tuple[int, ...]  # which of the fit's data sets these are, and the options of each
    specs: tuple[SetSpec, ...]
    elements: tuple[Element, ...]  # the free parameters
    stages: tuple[tuple[str, Problem], ...] = ()  # names and problems, in their order

    @property
    def start(self) -> np.ndarray:
        """z where everything starts."""
        transform = self.stages[0][1].transform
        return transform.unconstrained(np.array([e.start for e in self.elements]))

    def places(self, g: int) -> dict[str, int]:
        """Element of each free parameter of a data set, by its name."""
        return {e.name: k for k, e in enumerate(self.elements) if g in e.sets}


def assemble(request: Request) -> list[Component]:
    """The components of a fit.

    Raises:
        ValueError: naming what does not fit together and what is accepted.
    """
    specs = request.specs()
    route = request.chosen_route(specs)
    names = [spec.data.name for spec in specs]
    if len(set(names)) < len(names):
        raise DataError("data", names, "sets of different names")
    elements = _elements(specs)
    _check_shared(specs, elements)
    return [
        _component(sets, specs, [e for e in elements if e.sets[0] in sets], route)
        for sets in _together(len(specs), elements)
    ]


def _elements(specs: Sequence[SetSpec]) -> list[Element]:
    """The free parameters of all data sets, those that are shared only once."""
    found: dict[tuple[str, str], Element] = {}
    for g, spec in enumerate(specs):
        for one in spec.local:
            if not one.parameter.free:
                continue
            where = f"set {g}" if one.group is None else f"group {one.group}"
            owner = spec.data.name if one.group is None else one.group
            label = f"{one.name}[{owner}]" if len(specs) > 1 and owner else one.name
            first = found.get((one.name, where), replace(one, label=label))
            found[one.name, where] = replace(first, sets=(*first.sets, g))
    return list(found.values())


def _check_shared(specs: Sequence[SetSpec], elements: Sequence[Element]) -> None:
    """Pools are of several sets by `model`; no group is named like a data set outside it.

    Results call "chi[name]" what either has.
    """
    for name, sets in _pooled(elements).items():
        if len(sets) < 2:
            raise DataError(f"shared of {name}", "pooled", "left out for one data set alone")
        if any(specs[g].objective != "model" for g in sets):
            raise DataError(f"shared of {name}", "pooled", 'left out, or objective="model"')
    names = [spec.data.name for spec in specs]
    for one in elements:
        if one.group in names and names.index(one.group) not in one.sets:
            accepted = "the name of a group that no data set outside the group has"
            raise placed(one.parameter, one.name, DataError("shared", one.group, accepted))


def _pooled(elements: Iterable[Element]) -> dict[str, list[int]]:
    """The data sets of each parameter that is pooled."""
    found: dict[str, list[int]] = {}
    for one in elements:
        if one.parameter.pooled:
            found.setdefault(one.name, []).extend(one.sets)
    return found


def _together(count: int, elements: Sequence[Element]) -> list[tuple[int, ...]]:
    """Data sets that share or pool a parameter, directly or through others, in their order."""
    group = list(range(count))
    for sets in [*(one.sets for one in elements), *_pooled(elements).values()]:
        joined = {group[g] for g in sets}
        group = [min(joined) if own in joined else own for own in group]
    return [tuple(g for g in range(count) if group[g] == first) for first in sorted(set(group))]


def _component(sets, specs, elements, route: Route) -> Component:
    own = _of_one_kind([specs[g] for g in sets])
    if len({(spec.model.key, spec.objective) for spec in own}) > 1:
        told = ", ".join(f"{spec.data.name}: {spec.model.key}" for spec in own)
        raise DataError("parameters", f"shared between {told}", "shared within one law")
    # drag was taken out of these with a coefficient that is not known exactly
    flights = tuple(
        g
        for g, spec in zip(sets, own, strict=True)
        if spec.objective == "model" and spec.data.errors.by_drag is not None
    )
    if flights:
        label = f"{DRAG}[{specs[flights[0]].data.name}]" if len(specs) > len(sets) else DRAG
        known = Parameter(0.0, prior=(0.0, UNCERTAIN), transform="none")
        ends, declared = (-np.inf, np.inf), Declared(DRAG)
        elements = [*elements, Element(DRAG, known, declared, 0.0, ends, False, label, flights)]
    component = Component(tuple(sets), tuple(own), tuple(elements))
    _check_counts(component)
    return replace(component, stages=tuple(_stages(component, route)))


def _of_one_kind(specs: Sequence[SetSpec]) -> Sequence[SetSpec]:
    """Zhou's law by ε_up for some data sets and by σ for others, as one law of both."""
    names = [tuple(spec.model.parameters) for spec in specs]
    if len(set(names)) == 1 or {spec.model.key for spec in specs} != {"zhou"}:
        return specs
    model = zhou_model({"sigma", *(name for own in names for name in own)}, specs[0].model.options)
    dummies, wide = {"sigma": 0.0, "eps_up": NOT_GIVEN}, (-np.inf, np.inf)
    unified = []
    for spec in specs:
        every = {one.name: one for one in spec.local}
        for name in dummies.keys() & set(model.parameters) - set(every):
            fixed, declared = Parameter(free=False), model.declared(name)
            every[name] = Element(name, fixed, declared, dummies[name], wide, True)
        order = [*model.parameters, *(name for name in every if name not in model.parameters)]
        unified.append(replace(spec, model=model, local=tuple(every[name] for name in order)))
    return unified


def _check_counts(component: Component) -> None:
    """More values than free parameters in every data set; not of those that other sets determine too.

    A prior does, the other sets of a pool, and of a network its predictions.
    """
    whole = {tree.name for spec in component.specs for tree in spec.model.trees}
    for g, spec in zip(component.sets, component.specs, strict=True):
        own = [
            e.name
            for e in component.elements
            if e.sets == (g,) and e.parameter.prior is None and not e.parameter.pooled
            if e.name.partition("[")[0] not in whole
        ]
        count = sum(len(rows) for _, rows, *_ in blocks_of(spec.data))
        if count <= len(own):
            points = f"{count} point{'s' * (count != 1)}"
            problem = (
                f"{points} for {len(own)} free parameter{'s' * (len(own) != 1)} ({', '.join(own)})"
            )
            raise spec.data.refusal(problem, "more points than free parameters")


def _stages(component: Component, route: Route):
    """One stage by `model`; by `two-step` Eq. (17)'s, then the law's with what that gave."""
    every = range(len(component.elements))
    names = (one.name for spec in component.specs for one in spec.local)
    rows = _rows(component, component.specs[0].model, {name: name for name in names})
    if component.specs[0].objective == "model":
        yield "model", _problem(component, rows, list(every), route)
        return
    first = [k for k in every if component.elements[k].name in EMPIRICAL]
    eq_17 = model_of_class(sj.EmpiricalRestitution, "eq-17", {})
    names_17 = {name.removeprefix(OF_CONTACT): name for name in EMPIRICAL}
    yield "Eq. (17)", _problem(component, _rows(component, eq_17, names_17), first, None)
    rest = [k for k in every if k not in first]
    # by the energy balance more slopes cost next to nothing: then curve and band share the program
    more = [] if isinstance(route, sj.ODE) else every
    yield "model", _problem(component, rows, rest, route, more)


def _problem(
    component: Component, rows: Laws, active: list[int], route: Route, more: Sequence[int] = ()
) -> Problem:
    elements = component.elements
    transform = Transform.of([e.range for e in elements], [e.parameter.transform for e in elements])
    data = [spec.data for spec in component.specs]
    points, impact = points_of(data)
    theta = np.array([e.start for e in elements])
    problem = Problem(
        tuple(data),
        elements,
        transform,
        replace(rows, row=rows.row[impact]).bind(theta, [*active, *more]),
        points,
        np.array(active, int),
        route,
        tuple(errors for spec in component.specs for errors in spec.errors),
        joint=component.specs[0].objective == "model",
        pools=pools_of(elements),
    )
    # where ε jumps at yield, and the search moves yield, points are held on their branches
    jumps = getattr(rows.model.law_type, "jumps_at_yield", False)
    if not jumps or not any(
        elements[k].name.removeprefix(OF_CONTACT) in MOVE_YIELD for k in active
    ):
        return problem
    holding = replace(problem, elastic=np.zeros(len(points.velocity), bool))
    return held_at(holding, transform.unconstrained(theta))


def points_of(data: Sequence[RestitutionData]) -> tuple[Points, np.ndarray]:
    """All points in a row, each weighing one; and which impact each is, those of all sets in a row."""
    parts, impacts, first = [], [], 0
    for g, one in enumerate(data):
        for name, rows, value, unit in blocks_of(one):
            ones, code = np.ones(len(rows)), np.full(len(rows), PLACES[name])
            by_drag = by_drag_of(one, name)[rows]
            sets = np.full(len(rows), g)
            parts.append((one.velocity[rows], value, ones, sets, code, unit, by_drag))
            impacts.append(first + rows)
        first += len(one)
    columns = (np.concatenate(column) for column in zip(*parts, strict=True))
    return Points(*columns), np.concatenate(impacts)


def by_drag_of(data: RestitutionData, observable: str = RESTITUTION) -> np.ndarray:
    """∂(expected - measured)/∂c of ε, (n,), for flights with a drag coefficient of (1 + c) C_d.

    Take-off speeds move with their third power, ∂ε/∂c = a ε³ - ε v_c/v, and the measured velocity moves
    too. ε in that is a smooth curve through the points: their own noise would be taken for drag. Of
    other observables, in parts, the velocity alone moves, and they with their power of it under Hertz's law.
    """
    by_drag = data.errors.by_drag
    if by_drag is None:
        return np.zeros(len(data))
    if observable != RESTITUTION:
        return OBSERVABLES[observable].power * by_drag[:, 1] / data.velocity
    eps, v = data.restitution, np.log(data.velocity)
    seen = np.isfinite(eps) & (eps > 0)
    if not np.any(seen):
        return np.zeros(len(data))
    degree = min(2, int(np.sum(seen)) // 4) if np.ptp(v[seen]) > LEAST_RANGE else 0
    curve = np.polyfit(v[seen], np.log(eps[seen]), degree)
    smooth, power = np.exp(np.polyval(curve, v)), np.polyval(np.polyder(curve), v)
    slower = by_drag[:, 1] / data.velocity
    known = np.where(seen, eps, 1.0)
    cubic = np.where(seen, (by_drag[:, 0] + eps * slower) / known**3, 0.0)
    of_eps = cubic * smooth**3 - smooth * slower
    return np.where(np.isfinite(eps), np.clip(power, *POWERS) * smooth * slower - of_eps, 0.0)


def _rows(component: Component, model: LawModel, names: Mapping[str, str]) -> Laws:
    """Rows of one law for all data sets, from the element of each of its parameters.

    What is said for other sets alone has the value of this one's contact.
    """
    sets = []
    for g, spec in zip(component.sets, component.specs, strict=True):
        places, start = component.places(g), {one.name: one.start for one in spec.local}
        bodies = {
            OF_CONTACT + leaf: getattr(spec.data.contact, leaf, None) for leaf in CONTACT_LEAVES
        }
        if "limit_velocity" in names:  # Eq. (17)'s own
            bodies[LIMIT] = spec.data.limit_velocity
        known = bodies | start
        local = {name: (places.get(full, -1), known.get(full)) for name, full in names.items()}
        sets.append((len(spec.data), spec.data.contact, local))
    return Laws.of(model, sets)
