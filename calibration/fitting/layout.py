"""From data, law and parameters to problems that can be searched.

Each data set has its law and its parameters (`SetSpec`). Sets that share no parameter are fits of their
own, whatever else is fitted beside them: components. A component has one vector z of all its elements,
and one problem a stage, which searches some of them."""

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

import softjax as sj
from calibration.data import RestitutionData
from calibration.data.air import UNCERTAIN
from calibration.errors import DataError, did_you_mean, is_finite_number, listed
from calibration.fitting.branches import held_at
from calibration.fitting.collisions import Route
from calibration.fitting.errors import Errors
from calibration.fitting.laws import (
    EXTRA,
    KNOWN,
    LAWS,
    LINE,
    MOVE_YIELD,
    NOT_GIVEN,
    OF_CONTACT,
    WITHOUT_CONTACT,
    Known,
    LawModel,
    Tree,
    model_of_class,
    model_of_function,
    numbers_in,
    several_yields,
    zhou_model,
)
from calibration.fitting.problem import DRAG, Element, Points, Problem, pools_of
from calibration.fitting.rows import Rows, SetRows
from calibration.fitting.transform import Transform
from calibration.observables import OBSERVABLES, PLACES, RESTITUTION
from calibration.options import OBJECTIVES
from calibration.parameters import Parameter, as_parameter
from softjax.fields import Declared

LEAST_RANGE, POWERS = 0.2, (-1.0, 0.0)  # of ln v, and of what power of v a curve may be
REACH = 5.0  # standard deviations of a prior within which a search is expected to end

Specs = Mapping[str, Any] | Sequence[Any] | None


@dataclass(frozen=True)
class SetSpec:
    """What is asked of one data set."""

    data: RestitutionData  # the measurements, "model" or "two-step"
    objective: str
    model: LawModel  # its law
    local: tuple[Element, ...]  # the law's parameters, free and held
    extra_scatter: bool = False  # as `fit` takes them
    scale_uncertainty: bool = False
    # degrees of freedom of Student's t, or "estimate"; None for normal errors
    dof: float | str | None = None

    @cached_property
    def errors(self) -> tuple[Errors, ...]:
        """The errors of each observable's points: what is stated of them, and what is to be found."""
        data, asked = self.data, (self.extra_scatter, self.scale_uncertainty, self.dof)
        observed = {one.name: one for one in data.observed}
        return tuple(Errors.of(data, *asked, observed.get(name)) for name, *_ in blocks_of(data))

    @property
    def is_in_air(self) -> bool:
        """Whether drag was taken out of its flights, with a coefficient that is not known exactly."""
        return self.objective == "model" and self.data.errors.by_drag is not None

    @property
    def by_eps_up(self) -> bool:
        """Whether ε_up is what it has in place of σ and ψ."""
        return any(one.name == "eps_up" and not one.stands_in for one in self.local)


def specs_of(datasets, law, parameters: Specs, objective: str | None) -> list[SetSpec]:
    """The law and parameters of each data set.

    Raises:
        ValueError: naming what does not fit together and what is accepted.
    """
    said = said_of(parameters, datasets)
    return [_spec(data, law, own, objective) for data, own in zip(datasets, said, strict=True)]


def _spec(data: RestitutionData, law, said: dict[str, Any], objective) -> SetSpec:
    options = {name: value for name, value in said.items() if isinstance(value, str)}
    named = {name: value for name, value in said.items() if name not in options}
    model = law_model(data, law, options, named)
    if model.needs_contact and data.contact is None:
        advice = f"laws that need none are {listed(WITHOUT_CONTACT)}"
        raise data.refusal(f"no elastic properties, which {model.key} needs", advice)
    objective = objective or "model"
    if objective == "two-step" and data.contact is None:
        objective = "model"  # Eq. (17), or a constant, by itself
    if data.observed:
        _check_observed(data, model, objective)
    if objective == "two-step" and model.key != "zhou":
        raise DataError("objective", f"two-step with {model.key}", 'Zhou\'s law, or "model"')
    given = {}
    for name, value in named.items():
        full = _full_name(model, name, value)
        is_whole = full in model.whole and not isinstance(value, Parameter)
        given[full] = Parameter(value, free=False) if is_whole else as_parameter(name, value)
        _check_fixed(model, data, full, given[full])
    if model.key == "zhou" and objective == "model":
        given, model = _identified(data, given, model, options)
    return _located(data, objective, model, given)


def _check_observed(data: RestitutionData, model: LawModel, objective: str) -> None:
    """What else than ε was measured is of a collision with a force, and of its likelihood."""
    names = listed(one.name for one in data.observed)
    if objective == "two-step":
        raise DataError("objective", f"two-step with {names}", "model, which takes all of them")
    if issubclass(model.law_type, sj.HardSphereLaw):
        refused = f"{names}, of which {model.key} determines nothing"
        raise data.refusal(refused, "a law with a contact force")


def _full_name(model: LawModel, name: str, value: Any) -> str:
    try:
        return model.canonical(name)
    except DataError as error:
        origin = getattr(value, "origin", None)
        raise error if origin is None else origin.error(error) from None


def _check_fixed(model: LawModel, data: RestitutionData, name: str, parameter: Parameter) -> None:
    """What is fixed has a value: its own, the data's or the law's, and no guess from the data."""
    known = KNOWN.get(model.key)
    told = name.startswith(OF_CONTACT) or name in model.defaults
    if parameter.free or parameter.value is not None or told:
        return
    if known is None or name not in known.held(data):
        raise _placed(parameter, name, DataError("value", "missing", "given where it is fixed"))


def law_model(data: RestitutionData | None, law, options, named) -> LawModel:
    """The law that was asked for: a name, a class, a function; None: what suits the data."""
    law = _default_law(data) if law is None else law
    if isinstance(law, str):
        law = _named_law(law)
    if law is sj.Zhou:
        return zhou_model([name for name in named if name in EXTRA], options)
    key = next((key for key, one in LAWS.items() if one is law), None) or _own_name(law)
    if isinstance(law, type) and issubclass(law, sj.ContactLaw):
        return model_of_class(law, key, options)
    if callable(law) and not isinstance(law, type):
        return model_of_function(law, key, None if data is None else data.contact, options)
    accepted = f"a name ({listed(LAWS)}), a class of contact laws, or a function that builds one"
    raise DataError("law", law, accepted)


def _own_name(law: Any) -> str:
    """The name of an own law in files."""
    name = getattr(law, "__name__", type(law).__name__)
    if name in LAWS:
        raise DataError("law", f"your own {name!r}", "named otherwise than the built-in laws")
    return name


def _default_law(data: RestitutionData | None) -> str:
    if data is None or data.contact is not None:
        return "zhou"
    return "constant" if data.limit_velocity is None else "eq-17"


def _named_law(name: str) -> type:
    if name in OBJECTIVES:
        raise DataError("law", name, f"left out: that is an objective, objective={name!r}")
    if name not in LAWS:
        raise DataError("law", name, f"one of {listed(LAWS)}{did_you_mean(name, LAWS)}")
    return LAWS[name]


def _identified(data, given: dict[str, Parameter], model: LawModel, options):
    """What of Zhou's law these data can tell: ε_up without points below yield, no χ̃ without any above.

    Only where nothing was said of σ, ψ or ε_up; of ε_up wherever prior and bounds let yield be. Bodies
    that yield at several velocities have an ε_up each, and these tell σ from ψ.
    """
    free = {name for name, parameter in given.items() if parameter.free}
    moves = bool(free & {OF_CONTACT + name for name in MOVE_YIELD})
    highest = _highest_yield(data.contact, given)
    told = {"sigma", "psi", "eps_up"} & set(given)
    measured = np.isfinite(data.restitution)
    if not np.any(measured):  # neither enters the force
        given = {"sigma": Parameter(free=False), "psi": Parameter(free=False)} | given
        return given, model
    below = (data.velocity <= highest)[measured]
    if not moves and not data.observed and np.all(below):
        held = {"c1", "c2"} if set(LINE) & set(given) else {"chi"}
        fixed = {name: Parameter(free=False) for name in held}
        return given | fixed, model
    if told or np.any(below) or several_yields(data.contact):
        return given, model
    names = [*(name for name in LINE if name in given), "eps_up"]
    return given, zhou_model(names, options)


def _highest_yield(contact: sj.Contact, given: Mapping[str, Parameter]) -> np.ndarray:
    """The highest critical velocity that prior and bounds of the contact's numbers allow [m/s]."""
    leaves = [name for name in MOVE_YIELD if OF_CONTACT + name in given]
    ends = [_reach(given[OF_CONTACT + name], getattr(contact, name)) for name in leaves]
    if not all(np.all(np.isfinite(pair)) for pair in ends):
        return np.array(np.inf)  # anywhere
    corners = [dict(zip(leaves, values, strict=True)) for values in itertools.product(*ends)]
    return np.max([replace(contact, **one).critical_velocity for one in corners], axis=0)


def _reach(parameter: Parameter, own: Any) -> tuple[Any, Any]:
    """Between which values a search looks for a positive number; infinite where nothing says so."""
    if not parameter.free:
        value = own if parameter.value is None else parameter.value
        return value, value
    low, high = parameter.bounds or (0.0, np.inf)
    if parameter.prior is not None:
        mean, deviation = parameter.prior
        low, high = max(low, mean - REACH * deviation), min(high, mean + REACH * deviation)
    return max(low, 1e-9 * high), high


def _located(data, objective: str, model: LawModel, given: dict[str, Parameter]) -> SetSpec:
    """Start and range of every parameter."""
    known = KNOWN.get(model.key)
    guess = dict(known.guess(data)) if known and _guessable(known, data) else {}
    held = dict(known.held(data)) if known and _guessable(known, data) else {}
    ranges = dict(known.ranges(data)) if known and _guessable(known, data) else {}
    local: list[Element] = []
    trees: list[Tree] = []
    for name in model.whole:
        if name not in given and name not in model.defaults:
            raise DataError(f"parameters[{name!r}]", "missing", "given, as the law has no default")
    names = [name for name in model.parameters if name not in model.whole or name in given]
    names += [name for name in given if name not in names]
    for name in names:
        if name in model.whole:
            entries, tree = _whole(name, given[name])
            local, trees = [*local, *entries], [*trees, tree]
            continue
        parameter = given.get(name) or _unsaid(name, held, model)
        one = _local(data, model, name, parameter, guess | held, ranges)
        by_eps_up = name == "psi" and "eps_up" in model.parameters
        local.append(replace(one, stands_in=by_eps_up and name not in given))
    return SetSpec(data, objective, replace(model, trees=tuple(trees)), tuple(local))


def _guessable(known: Known, data: RestitutionData) -> bool:
    return data.contact is not None or known.law in (LAWS[name] for name in WITHOUT_CONTACT)


def _unsaid(name: str, held, model: LawModel) -> Parameter:
    """A parameter of which nothing was said: free, unless ε does not tell it."""
    if name in held or (name == "psi" and "eps_up" in model.parameters):
        return Parameter(free=False)
    return Parameter(shared=name in LINE)


def _local(data, model: LawModel, name: str, parameter: Parameter, guess, ranges) -> Element:
    declared = model.declared(name)
    try:
        low, high = parameter.range_within(declared)
    except DataError as error:
        raise _placed(parameter, name, error) from None
    if name in ranges:
        own = ranges[name]
        low, high = max(low, own[0]), min(high, own[1])
    start = _start(data, model, name, parameter, guess, (low, high))
    if name in LINE and not parameter.shared and parameter.free:
        parameter = replace(parameter, shared=True)  # Eq. (18)'s line belongs to all materials
    return Element(name, parameter, declared, start, (low, high))


def _placed(parameter: Parameter, name: str, error: DataError) -> Exception:
    told = DataError(f"{error.argument} of {name}", error.value, error.accepted)
    return told if parameter.origin is None else parameter.origin.error(told)


def _start(data, model: LawModel, name: str, parameter: Parameter, guess, ends) -> Any:
    """Where a parameter starts, or what it is held at."""
    if parameter.value is not None:
        return float(parameter.value)
    if name.startswith(OF_CONTACT):
        values = getattr(data.contact, name.removeprefix(OF_CONTACT))
        return float(np.mean(values)) if parameter.free else values
    if parameter.prior is not None:
        return _inside(parameter.prior[0], ends)
    default = model.defaults.get(name)
    value = guess.get(name, default if is_finite_number(default) else None)
    return _inside(value, ends) if parameter.free else value


def _inside(value: float | None, ends: tuple[float, float]) -> float:
    """A guess that respects the bounds; their middle, or 1, where there is none."""
    low, high = ends
    if value is not None and low < float(np.mean(value)) < high:
        return float(np.mean(value))
    if np.isfinite(low) and np.isfinite(high):
        return 0.5 * (low + high)
    if np.isfinite(low):
        return low + max(abs(low), 1.0)
    return high - max(abs(high), 1.0) if np.isfinite(high) else 1.0


def _whole(name: str, parameter: Parameter) -> tuple[list[Element], Tree]:
    """The numbers of a whole parameter, each a parameter of its own."""
    if parameter.value is None:
        told = DataError("value", "missing", "an array or a pytree of them, where a search starts")
        raise _placed(parameter, name, told)
    tree, numbers = Tree.of(name, parameter.value), numbers_in(parameter.value)
    one = Parameter(free=parameter.free, shared=parameter.shared)
    wide = (-np.inf, np.inf)
    pairs = zip(tree.entries, numbers, strict=True)
    return [Element(entry, one, Declared(entry), float(x), wide) for entry, x in pairs], tree


def said_of(parameters: Specs, datasets) -> list[dict[str, Any]]:
    """What is said of each data set's parameters: {name: what}, one dict a set.

    `parameters` is a mapping ("chi" for all sets, "chi[name]" for one; a number fixes, a text is an
    option), or one such mapping per data set.
    """
    if parameters is None:
        return [{} for _ in datasets]
    if isinstance(parameters, Mapping):
        return _from_mapping(parameters, datasets)
    several = isinstance(parameters, Iterable) and not isinstance(parameters, str)
    given = list(parameters) if several else []
    if len(given) != len(datasets) or not all(isinstance(p, Mapping) for p in given):
        raise DataError("parameters", parameters, "a mapping, or one mapping per data set")
    return [_from_mapping(own, [d])[0] for own, d in zip(given, datasets, strict=True)]


def _from_mapping(parameters: Mapping[str, Any], datasets) -> list[dict[str, Any]]:
    said: list[dict[str, Any]] = [{} for _ in datasets]
    odd = [key for key in parameters if not isinstance(key, str)]
    if odd:
        raise DataError("parameters", odd[0], "by the parameters' names")
    # names for one set come last, so that they win over those for all
    for key in sorted(parameters, key=lambda key: "[" in key):
        name, _, owner = key.partition("[")
        owner = owner.removesuffix("]")
        owners = [g for g, data in enumerate(datasets) if owner in ("", data.name)]
        if not owners:
            known = listed(data.name for data in datasets)
            raise DataError(f"parameters[{key!r}]", owner, f"named after one of: {known}")
        for g in owners:
            said[g][name] = parameters[key]
    return said


LIMIT = OF_CONTACT + "limit_velocity"
EMPIRICAL = ("sigma", "psi", LIMIT)  # searched by Eq. (17)'s stage


@dataclass(frozen=True)
class Component:
    """Data sets that share parameters, and the stages of their fit."""

    sets: tuple[int, ...]  # which of the fit's data sets these are, and what is asked of each
    specs: tuple[SetSpec, ...]
    elements: tuple[Element, ...]  # the free parameters
    stages: tuple[tuple[str, Problem], ...] = ()  # names and problems, in their order

    @property
    def start(self) -> np.ndarray:
        """z where everything starts."""
        transform = self.stages[0][1].transform
        return transform.unconstrained(np.array([e.start for e in self.elements]))

    def places(self, g: int) -> dict[str, int]:
        """Which element each free parameter of a data set is, by its name."""
        return {e.name: k for k, e in enumerate(self.elements) if g in e.sets}


def assemble(specs: Sequence[SetSpec], route: Route) -> list[Component]:
    """The components of a fit.

    Raises:
        ValueError: naming what does not fit together and what is accepted.
    """
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
            raise _placed(one.parameter, one.name, DataError("shared", one.group, accepted))


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
    flights = tuple(g for g, spec in zip(sets, own, strict=True) if spec.is_in_air)
    if flights:
        label = f"{DRAG}[{specs[flights[0]].data.name}]" if len(specs) > len(sets) else DRAG
        known = Parameter(0.0, prior=(0.0, UNCERTAIN), transform="none")
        ends, declared = (-np.inf, np.inf), Declared(DRAG)
        elements = [*elements, Element(DRAG, known, declared, 0.0, ends, False, label, flights)]
    component = Component(tuple(sets), tuple(own), tuple(elements))
    _check_counts(component)
    return replace(component, stages=tuple(_stages(component, route)))


def _of_one_kind(specs: Sequence[SetSpec]) -> Sequence[SetSpec]:
    """Zhou's law by ε_up for some data sets and by σ for others, told as one law of both."""
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
    """More values than free parameters in every data set; not of those that more than these tell.

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
            problem = f"{count} points for {len(own)} free parameters ({', '.join(own)})"
            raise spec.data.refusal(problem, "more points than free parameters")


def _stages(component: Component, route: Route):
    """One stage by `model`; by `two-step` Eq. (17)'s, then the law's with what that gave."""
    every = range(len(component.elements))
    if component.specs[0].objective == "model":
        yield "model", _problem(component, _law_rows(component), list(every), route)
        return
    first = [k for k in every if component.elements[k].name in EMPIRICAL]
    yield "Eq. (17)", _problem(component, _empirical_rows(component), first, None)
    rest = [k for k in every if k not in first]
    # by the energy balance more slopes cost next to nothing: then curve and band share the program
    more = [] if isinstance(route, sj.ODE) else every
    yield "model", _problem(component, _law_rows(component), rest, route, more)


def _problem(
    component: Component, rows: Rows, active: list[int], route: Route, more: Sequence[int] = ()
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


def blocks_of(data: RestitutionData):
    """Of each observable its name, which impacts, the values, and their unit."""
    rows = np.flatnonzero(np.isfinite(data.restitution))
    if len(rows):
        yield RESTITUTION, rows, data.restitution[rows], np.ones(len(rows))
    for one in sorted(data.observed, key=lambda one: PLACES[one.name]):
        yield one.name, one.rows, one.value / one.scale, one.scale


def _law_rows(component: Component) -> Rows:
    """Of each data set's law; what is said for others alone has the value of this one's contact."""
    first = component.specs[0]
    names = dict.fromkeys(one.name for spec in component.specs for one in spec.local)
    every = []
    for spec in component.specs:
        start = {one.name: one.start for one in spec.local}
        bodies = {n: getattr(spec.data.contact, n.removeprefix(OF_CONTACT), None) for n in names}
        every.append({n: (n, start.get(n, bodies[n])) for n in names})
    return _rows(component, first.model, every)


def _empirical_rows(component: Component) -> Rows:
    """The rows of Eq. (17) with the σ, ψ and limit velocity of each data set's own law."""
    model = model_of_class(sj.EmpiricalRestitution, "eq-17", {})
    every = []
    for spec in component.specs:
        told = {"limit_velocity": (LIMIT, spec.data.limit_velocity)}
        for one in spec.local:
            if one.name in EMPIRICAL:
                told[one.name.removeprefix(OF_CONTACT)] = (one.name, one.start)
        every.append(told)
    return _rows(component, model, every)


def _rows(component: Component, model: LawModel, every) -> Rows:
    """Of one law for all data sets, from the element's name and the value of each parameter."""
    sets = []
    for g, spec, told in zip(component.sets, component.specs, every, strict=True):
        places = component.places(g)
        local = {name: (places.get(full, -1), value) for name, (full, value) in told.items()}
        sets.append(SetRows(len(spec.data), spec.data.contact, local))
    return Rows.of(model, sets)


def label_of_law(model: LawModel) -> str:
    """A law's name in tables and pictures."""
    known = KNOWN.get(model.key)
    return model.key if known is None else known.label
