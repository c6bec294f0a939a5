"""Build the search problems from data, laws and parameters.

Sets that share no parameter are fits of their own, whatever else is fitted with them: components. A
component has one vector z of all its elements, and one problem a stage, which searches some of them."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

import softjax as sj
from calibration.data import RestitutionData
from calibration.data.air import UNCERTAIN
from calibration.errors import DataError
from calibration.fitting.branches import held_at
from calibration.fitting.collisions import Laws, Route
from calibration.fitting.laws import CONTACT_LEAVES, MOVE_YIELD, OF_CONTACT, LawModel, model_of
from calibration.fitting.problem import DRAG, Element, Points, Problem, pools_of
from calibration.fitting.request import DEFAULT_ODE, WIDE, Request, SetSpec, blocks_of, placed
from calibration.observables import OBSERVABLES, PLACES, RESTITUTION
from calibration.parameters import Parameter, Transform
from softjax.fields import Declared

LEAST_RANGE, POWERS = 0.2, (-1.0, 0.0)  # of ln v, and of what power of v a curve may be
LIMIT = OF_CONTACT + "limit_velocity"
EMPIRICAL = ("sigma", "psi", LIMIT)  # searched by Eq. (17)'s stage


@dataclass(frozen=True)
class Component:
    """Data sets that share parameters, and the stages of their fit."""

    sets: tuple[int, ...]  # which of the fit's data sets these are
    specs: tuple[SetSpec, ...]  # of each, in this order
    elements: tuple[Element, ...]  # the free parameters, whose `sets` are places in `specs`
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
    names = [spec.data.name for spec in specs]
    if len(set(names)) < len(names):
        raise DataError("data", names, "sets of different names")
    elements = _elements(specs)
    together = _together(specs, elements)
    two_step = any(spec.objective == "two-step" for spec in specs)
    route = request.route or (DEFAULT_ODE if two_step else None)  # the paper's procedure
    return [_component(sets, specs, elements, route) for sets in together]


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


def _together(specs: Sequence[SetSpec], elements: Sequence[Element]) -> list[tuple[int, ...]]:
    """Data sets that share or pool a parameter, directly or through others, in their order.

    Pools are of several sets by `model`; no group is named like a data set outside it, as results call
    "chi[name]" what either has.
    """
    pools: dict[str, list[int]] = {}
    names = [spec.data.name for spec in specs]
    for one in elements:
        if one.parameter.pooled:
            pools.setdefault(one.name, []).extend(one.sets)
        if one.group in names and names.index(one.group) not in one.sets:
            accepted = "the name of a group that no data set outside the group has"
            raise placed(one.parameter, one.name, DataError("shared", one.group, accepted))
    for name, pool in pools.items():
        if len(pool) < 2:
            raise DataError(f"shared of {name}", "pooled", "left out for one data set alone")
        if any(specs[g].objective != "model" for g in pool):
            raise DataError(f"shared of {name}", "pooled", 'left out, or objective="model"')
    group = list(range(len(specs)))
    for sets in [*(one.sets for one in elements), *pools.values()]:
        joined = {group[g] for g in sets}
        group = [min(joined) if own in joined else own for own in group]
    return [tuple(g for g, own in enumerate(group) if own == one) for one in sorted({*group})]


def _component(sets, specs, elements, route: Route) -> Component:
    own = tuple(specs[g] for g in sets)
    if len({(spec.model.key, spec.objective) for spec in own}) > 1:
        told = ", ".join(f"{spec.data.name}: {spec.model.key}" for spec in own)
        raise DataError("parameters", f"shared between {told}", "shared within one law")
    place = {g: k for k, g in enumerate(sets)}
    free = [
        replace(e, sets=tuple(place[g] for g in e.sets)) for e in elements if e.sets[0] in place
    ]
    # drag was taken out of these with a coefficient that is not known exactly
    flights = tuple(
        k
        for k, spec in enumerate(own)
        if spec.objective == "model" and spec.data.errors.by_drag is not None
    )
    if flights:
        label = f"{DRAG}[{own[flights[0]].data.name}]" if len(specs) > len(sets) else DRAG
        known = Parameter(0.0, prior=(0.0, UNCERTAIN), transform="none")
        free.append(Element(DRAG, known, Declared(DRAG), 0.0, WIDE, False, label, flights))
    component = Component(sets, own, tuple(free))
    _check_counts(component)
    return replace(component, stages=tuple(_stages(component, route)))


def _check_counts(component: Component) -> None:
    """More values than free parameters in every data set; not of those that other sets determine too.

    A prior does, the other sets of a pool, and of a network its predictions.
    """
    for g, spec in enumerate(component.specs):
        whole = {tree.name for tree in spec.model.trees}
        own = [
            e.name
            for e in component.elements
            if e.sets == (g,) and e.parameter.prior is None and not e.parameter.pooled
            if e.name.partition("[")[0] not in whole
        ]
        count = sum(len(rows) for *_, rows, _, _ in blocks_of(spec.data))
        if count <= len(own):
            free = f"{len(own)} free parameter{'s' * (len(own) != 1)} ({', '.join(own)})"
            problem = f"{count} point{'s' * (count != 1)} for {free}"
            raise spec.data.refusal(problem, "more points than free parameters")


def _stages(component: Component, route: Route) -> Iterator[tuple[str, Problem]]:
    """One stage by `model`; by `two-step` Eq. (17)'s, then the law's with what that gave."""
    every, specs = range(len(component.elements)), component.specs
    # sets with ε_up and sets with σ are of one law of both
    model = next((one.model for one in specs if not one.model.direct), specs[0].model)
    declared = {name: what for one in specs for name, what in one.model.parameters.items()}
    names = {local.name: local.name for one in specs for local in one.local}
    rows = _rows(component, replace(model, parameters=declared), names)
    if specs[0].objective == "model":
        yield "model", _problem(component, rows, list(every), route)
        return
    first = [k for k in every if component.elements[k].name in EMPIRICAL]
    eq_17 = model_of(sj.EmpiricalRestitution, "eq-17", None, {})
    names_17 = {name.removeprefix(OF_CONTACT): name for name in EMPIRICAL}
    yield "Eq. (17)", _problem(component, _rows(component, eq_17, names_17), first, None)
    rest = [k for k in every if k not in first]
    # by the energy balance more slopes cost next to nothing: then curve and band share the program
    more = [] if isinstance(route, sj.ODE) else every
    yield "model", _problem(component, rows, rest, route, more)


def _rows(component: Component, model: LawModel, names: Mapping[str, str]) -> Laws:
    """Rows of one law for all data sets, from the element of each of its parameters.

    What is said for other sets alone has the value of this one's contact, or none.
    """
    sets = []
    for g, spec in enumerate(component.specs):
        contact = spec.data.contact
        known = {OF_CONTACT + leaf: getattr(contact, leaf, None) for leaf in CONTACT_LEAVES}
        if "limit_velocity" in names:  # Eq. (17)'s own
            known[LIMIT] = spec.data.limit_velocity
        known |= {one.name: one.start for one in spec.local}
        places = component.places(g)
        local = {name: (places.get(full, -1), known.get(full)) for name, full in names.items()}
        sets.append((len(spec.data), contact, local))
    return Laws.of(model, sets)


def _problem(
    component: Component, rows: Laws, active: list[int], route: Route, more: Sequence[int] = ()
) -> Problem:
    elements, specs = component.elements, component.specs
    transform = transform_of(elements)
    data = tuple(spec.data for spec in specs)
    points, impact = points_of(data)
    theta = np.array([e.start for e in elements])
    problem = Problem(
        data,
        elements,
        transform,
        replace(rows, row=rows.row[impact]).bind(theta, [*active, *more]),
        points,
        np.array(active, int),
        route,
        tuple(errors for spec in specs for errors in spec.errors),
        joint=specs[0].objective == "model",
        pools=pools_of(elements),
    )
    # where ε jumps at yield, and the search moves yield, points are held on their branches
    moved = {elements[k].name.removeprefix(OF_CONTACT) for k in active}
    if not (getattr(rows.model.law_type, "jumps_at_yield", False) and moved & {*MOVE_YIELD}):
        return problem
    holding = replace(problem, elastic=np.zeros(len(points.velocity), bool))
    return held_at(holding, transform.unconstrained(theta))


def transform_of(elements: Sequence[Element]) -> Transform:
    return Transform.of([e.range for e in elements], [e.parameter.transform for e in elements])


def points_of(data: Sequence[RestitutionData]) -> tuple[Points, np.ndarray]:
    """All points in a row, each weighing one; and which impact each is, those of all sets in a row."""
    parts, impacts, first = [], [], 0
    for g, one in enumerate(data):
        for _, name, rows, value, unit in blocks_of(one):
            ones, by_drag = np.ones(len(rows)), by_drag_of(one, name)[rows]
            sets, code = np.full(len(rows), g), np.full(len(rows), PLACES[name])
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
    slower = by_drag[:, 1] / data.velocity
    if observable != RESTITUTION:
        return OBSERVABLES[observable].power * slower
    eps, v = data.restitution, np.log(data.velocity)
    seen = np.isfinite(eps) & (eps > 0)
    if not np.any(seen):
        return np.zeros(len(data))
    degree = min(2, int(np.sum(seen)) // 4) if np.ptp(v[seen]) > LEAST_RANGE else 0
    curve = np.polyfit(v[seen], np.log(eps[seen]), degree)
    smooth, power = np.exp(np.polyval(curve, v)), np.polyval(np.polyder(curve), v)
    cubic = np.where(seen, (by_drag[:, 0] + eps * slower) / np.where(seen, eps, 1.0) ** 3, 0.0)
    of_eps = cubic * smooth**3 - smooth * slower
    return np.where(np.isfinite(eps), np.clip(power, *POWERS) * smooth * slower - of_eps, 0.0)
