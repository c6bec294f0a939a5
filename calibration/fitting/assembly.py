"""From what is asked of each data set to problems that can be searched.

Data sets that share no parameter are fits of their own, whatever else is fitted beside them: they
are taken apart into components. A component has one vector z of all its elements, and one problem a
stage, which searches some of them.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

import softjax as sj
from calibration.data import RestitutionData
from calibration.errors import DataError
from calibration.fitting.branches import held_at
from calibration.fitting.collisions import Route
from calibration.fitting.known_laws import KNOWN
from calibration.fitting.law_model import MOVE_YIELD, OF_CONTACT, LawModel, model_of_class
from calibration.fitting.problem import Element, Points, Problem, pools_of
from calibration.fitting.rows import Rows, SetRows, Tree
from calibration.fitting.specs import Local, SetSpec
from calibration.fitting.transform import Transform
from calibration.fitting.zhou import NOT_GIVEN, zhou_model
from calibration.observables import PLACES, RESTITUTION
from calibration.parameters import Parameter

LIMIT = OF_CONTACT + "limit_velocity"
EMPIRICAL = ("sigma", "psi", LIMIT)  # searched by Eq. (17)'s stage


@dataclass(frozen=True)
class Component:
    """Data sets that share parameters, and the stages of their fit.

    Attributes:
        sets: which of the fit's data sets these are.
        specs: what is asked of each.
        elements: the free parameters.
        stages: names and problems, in their order.
    """

    sets: tuple[int, ...]
    specs: tuple[SetSpec, ...]
    elements: tuple[Element, ...]
    stages: tuple[tuple[str, Problem], ...]

    @property
    def start(self) -> np.ndarray:
        """z where everything starts."""
        transform = self.stages[0][1].transform
        return transform.unconstrained(np.array([e.start for e in self.elements]))

    def places(self, g: int) -> dict[str, int]:
        """Which element each free parameter of a data set is, by its name."""
        return {e.name: k for k, e in enumerate(self.elements) if g in e.sets}


@dataclass
class _Drafted:
    """An element while its data sets are being gathered."""

    local: Local
    group: str | None
    sets: list[int] = field(default_factory=list)


def assemble(specs: Sequence[SetSpec], route: Route, bound: Sequence[str] = ()) -> list[Component]:
    """The components of a fit.

    Args:
        bound: parameters along which slopes are computed though the law's stage does not search
            them: what is compiled for another fit then serves this one.

    Raises:
        ValueError: naming what does not fit together and what is accepted.
    """
    names = [spec.data.name for spec in specs]
    if len(set(names)) < len(names):
        raise DataError("data", names, "sets of different names")
    drafted = _gathered(specs)
    _check_pooled(specs, drafted)
    _check_groups(names, drafted)
    return [
        _component(
            sets, [specs[g] for g in sets], _of_sets(drafted, sets), len(specs), route, bound
        )
        for sets in _together(len(specs), drafted)
    ]


def _gathered(specs) -> list[_Drafted]:
    """The free parameters of all data sets, those that are shared only once."""
    found: dict[tuple[str, str], _Drafted] = {}
    for g, spec in enumerate(specs):
        for local in spec.local:
            if local.parameter.free:
                where = f"set {g}" if local.group is None else f"group {local.group}"
                one = found.setdefault((local.name, where), _Drafted(local, local.group))
                one.sets.append(g)
    return list(found.values())


def _check_pooled(specs, drafted: Iterable[_Drafted]) -> None:
    for name, sets in _pooled(drafted).items():
        if len(sets) < 2:
            raise DataError(f"shared of {name}", "pooled", "left out for one data set alone")
        if any(specs[g].objective != "model" for g in sets):
            raise DataError(f"shared of {name}", "pooled", 'left out, or objective="model"')


def _check_groups(names: list[str], drafted: Iterable[_Drafted]) -> None:
    """No group has the name of a data set outside it: results call "chi[name]" what either has."""
    for one in drafted:
        if one.group in names and names.index(one.group) not in one.sets:
            accepted = "the name of a group that no data set outside the group has"
            refused = DataError(f"shared of {one.local.name}", one.group, accepted)
            origin = one.local.parameter.origin
            raise refused if origin is None else origin.error(refused)


def _pooled(drafted: Iterable[_Drafted]) -> dict[str, list[int]]:
    """The data sets of each parameter that is pooled."""
    found: dict[str, list[int]] = {}
    for one in drafted:
        if one.local.parameter.pooled:
            found.setdefault(one.local.name, []).extend(one.sets)
    return found


def _together(count: int, drafted: Sequence[_Drafted]) -> list[tuple[int, ...]]:
    """Data sets that share or pool a parameter, directly or through others, in their order."""
    group = list(range(count))
    for sets in [*(one.sets for one in drafted), *_pooled(drafted).values()]:
        joined = {group[g] for g in sets}
        lowest = min(joined)
        group = [lowest if own in joined else own for own in group]
    return [tuple(g for g in range(count) if group[g] == first) for first in sorted(set(group))]


def _of_sets(drafted: Iterable[_Drafted], sets) -> list[_Drafted]:
    return [one for one in drafted if one.sets[0] in sets]


def _component(sets, specs, drafted, many: int, route: Route, bound) -> Component:
    specs = _of_one_kind(specs)
    kinds = {(spec.model.key, spec.objective) for spec in specs}
    if len(kinds) > 1:
        told = ", ".join(f"{spec.data.name}: {spec.model.key}" for spec in specs)
        raise DataError("parameters", f"shared between {told}", "shared within one law")
    elements = tuple(_element(one, specs, sets, many) for one in drafted)
    component = Component(tuple(sets), tuple(specs), elements, ())
    _check_counts(component)
    stages = _stages(component, route, bound)
    return Component(tuple(sets), tuple(specs), elements, tuple(stages))


def _of_one_kind(specs: Sequence[SetSpec]) -> Sequence[SetSpec]:
    """Zhou's law by ε_up for some data sets and by σ for others, told as one law of both."""
    names = [tuple(spec.model.parameters) for spec in specs]
    if len(set(names)) == 1 or {spec.model.key for spec in specs} != {"zhou"}:
        return specs
    model = zhou_model({"sigma", *(name for own in names for name in own)}, specs[0].model.options)
    dummies = {"sigma": 0.0, "eps_up": NOT_GIVEN}
    unified = []
    for spec in specs:
        local = {one.name: one for one in spec.local}
        missing = [name for name in model.parameters if name not in local]
        held = Parameter(free=False)
        more = [
            Local(name, held, model.declared(name), dummies[name], (-np.inf, np.inf), True)
            for name in missing
            if name in dummies
        ]
        every = {**local, **{one.name: one for one in more}}
        order = [*model.parameters, *(name for name in every if name not in model.parameters)]
        told = tuple(every[name] for name in order)
        unified.append(replace(spec, model=model, local=told))
    return unified


def _element(one: _Drafted, specs, sets, many: int) -> Element:
    local = one.local
    name, _, entry = local.name.partition("[")
    entry = f"[{entry}" if entry else ""
    owner = specs[sets.index(one.sets[0])].data.name if one.group is None else one.group
    label = f"{name}{entry}[{owner}]" if many > 1 and owner else f"{name}{entry}"
    return Element(
        label,
        local.name,
        tuple(one.sets),
        local.parameter,
        local.declared,
        float(local.start),
        local.range,
    )


def _check_counts(component: Component) -> None:
    """More points than free parameters in every data set (a prior counts as a point)."""
    whole = {tree.name for spec in component.specs for tree in spec.trees}
    for g, spec in zip(component.sets, component.specs, strict=True):
        own = [e for e in component.elements if e.sets == (g,) and not _is_told(e)]
        # a network may have as many weights as it likes: it is told by its predictions
        own = [e for e in own if e.name.partition("[")[0] not in whole]
        count = len(spec.data.restitution) + sum(map(len, spec.data.observed))
        count -= int(np.sum(np.isnan(spec.data.restitution)))
        if count <= len(own):
            names = ", ".join(e.name for e in own)
            problem = f"{count} points for {len(own)} free parameters ({names})"
            raise spec.data.refusal(problem, "more points than free parameters")


def _is_told(element: Element) -> bool:
    """By more than the points: a prior, or the other data sets of a pool."""
    return element.parameter.prior is not None or element.parameter.pooled


def _stages(component: Component, route: Route, bound: Sequence[str]):
    """One stage by `model`; by `two-step` Eq. (17)'s, then the law's with what that gave."""
    names = [e.name for e in component.elements]
    every = range(len(names))
    if component.specs[0].objective == "model":
        yield "model", _problem(component, _law_rows(component), list(every), route)
        return
    first = [k for k in every if names[k] in EMPIRICAL]
    yield "Eq. (17)", _problem(component, _empirical_rows(component), first, None)
    rest = [k for k in every if k not in first]
    # by the energy balance more slopes cost next to nothing: then curve and band share the program
    cheap = not isinstance(route, sj.ODE)
    more = [k for k in every if names[k] in bound or cheap]
    yield "model", _problem(component, _law_rows(component), rest, route, more)


def _problem(
    component: Component, rows: Rows, active: list[int], route: Route, more: Sequence[int] = ()
) -> Problem:
    elements = component.elements
    transform = Transform.of([e.range for e in elements], [e.parameter.transform for e in elements])
    data = [spec.data for spec in component.specs]
    points, impact = points_of(data)
    rows = replace(rows, row=rows.row[impact])
    theta = np.array([e.start for e in elements])
    problem = Problem(
        tuple(data),
        elements,
        transform,
        rows.bind(theta, [*active, *more]),
        points,
        np.array(active, int),
        route,
        tuple(errors for spec in component.specs for errors in spec.errors),
        joint=component.specs[0].objective == "model",
        pools=pools_of(elements),
    )
    if not _asks_to_be_held(rows.model, [elements[k] for k in active]):
        return problem
    z = transform.unconstrained(theta)
    holding = replace(problem, elastic=np.zeros(len(points.velocity), bool))
    return held_at(holding, z)


def _asks_to_be_held(model: LawModel, elements) -> bool:
    """Whether ε jumps at yield, and the search moves yield."""
    jumps = getattr(model.law_type, "jumps_at_yield", False)
    return jumps and any(e.name.removeprefix(OF_CONTACT) in MOVE_YIELD for e in elements)


def points_of(data: Sequence[RestitutionData]) -> tuple[Points, np.ndarray]:
    """All points in a row, each weighing one; and which impact each is, those of all sets in a row."""
    parts, impacts, first = [], [], 0
    for g, one in enumerate(data):
        for name, rows, value, unit in blocks_of(one):
            count = len(rows)
            code = np.full(count, PLACES[name])
            parts.append((one.velocity[rows], value, np.ones(count), np.full(count, g), code, unit))
            impacts.append(first + rows)
        first += len(one)
    columns = (np.concatenate(column) for column in zip(*parts, strict=True))
    return Points(*columns), np.concatenate(impacts)


def blocks_of(data: RestitutionData):
    """Of each observable its name, which impacts, the values, and their unit."""
    rows = np.flatnonzero(np.isfinite(data.restitution))
    if len(rows):
        yield RESTITUTION, rows, data.restitution[rows], np.ones(len(rows))
    for one in sorted(data.observed, key=lambda one: PLACES[one.name]):
        yield one.name, one.rows, np.ones(len(one)), one.value


def _law_rows(component: Component) -> Rows:
    first = component.specs[0]
    names = dict.fromkeys(local.name for spec in component.specs for local in spec.local)
    every = []
    for spec in component.specs:
        start = {local.name: local.start for local in spec.local}
        every.append({n: (n, start[n] if n in start else _of_bodies(spec, n)) for n in names})
    return _rows(component, first.model, every, first.trees)


def _of_bodies(spec: SetSpec, name: str) -> object:
    """What something is said of for other data sets alone: the value that this one's contact has."""
    return getattr(spec.data.contact, name.removeprefix(OF_CONTACT))


def _empirical_rows(component: Component) -> Rows:
    """The rows of Eq. (17) with the σ, ψ and limit velocity of each data set's own law."""
    model = model_of_class(sj.EmpiricalRestitution, "eq-17", {})
    every = []
    for spec in component.specs:
        told = {"limit_velocity": (LIMIT, spec.data.limit_velocity)}
        told |= {
            local.name.removeprefix(OF_CONTACT): (local.name, local.start)
            for local in spec.local
            if local.name in EMPIRICAL
        }
        every.append(told)
    return _rows(component, model, every)


def _rows(component: Component, model: LawModel, every, trees: tuple[Tree, ...] = ()) -> Rows:
    """Of one law for all data sets, from the element's name and the value of each parameter."""
    sets = []
    for g, spec, told in zip(component.sets, component.specs, every, strict=True):
        places = component.places(g)
        local = {name: (places.get(full, -1), value) for name, (full, value) in told.items()}
        sets.append(SetRows(len(spec.data), spec.data.contact, local))
    return Rows.of(model, sets, trees)


def label_of_law(model: LawModel) -> str:
    """A law's name in tables and pictures."""
    known = KNOWN.get(model.key)
    return model.key if known is None else known.label
