"""From data, law and parameters to problems that can be searched.

Each data set has its law and its parameters (`SetSpec`). Sets that share no parameter are fits of their
own, whatever else is fitted beside them: components. A component has one vector z of all its elements,
and one problem a stage, which searches some of them."""

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
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
    model_of_class,
    model_of_function,
    several_yields,
    zhou_model,
)
from calibration.fitting.problem import DRAG, Element, Points, Problem, pools_of
from calibration.fitting.rows import Rows, SetRows, Tree, numbers_in
from calibration.fitting.transform import Transform
from calibration.observables import PLACES, RESTITUTION
from calibration.options import OBJECTIVES
from calibration.parameters import Parameter, as_parameter
from softjax.fields import Declared

LEAST_RANGE, POWERS = 0.2, (-1.0, 0.0)  # of ln v, and of what power of v a curve may be
REACH = 5.0  # standard deviations of a prior within which a search is expected to end

Specs = Mapping[str, Any] | Sequence[Any] | None


@dataclass(frozen=True)
class Local:
    """One parameter of one data set's law.

    Attributes:
        name: in full, an entry of a whole parameter as "weights[3]".
        parameter, declared: what was said of it, and what its law says.
        start: where it starts, or what it is held at; one number, or one an impact.
        range: (lowest, highest).
        stands_in: whether it is held at a number that nobody asked for and that acts nowhere in the
            data: ψ where ε_up is fitted in its place.
    """

    name: str
    parameter: Parameter
    declared: Declared
    start: Any
    range: tuple[float, float]
    stands_in: bool = False

    @property
    def group(self) -> str | None:
        """The group of data sets that it is shared in: "" for all of them, None for none."""
        shared = self.parameter.shared
        if self.parameter.pooled:
            return None
        return ("" if shared else None) if isinstance(shared, bool) else shared


@dataclass(frozen=True)
class SetSpec:
    """What is asked of one data set.

    Attributes:
        data, objective: the measurements, "model" or "two-step".
        model: its law.
        local: the law's parameters, free and held.
        trees: how the numbers of whole parameters make up pytrees.
        extra_scatter, scale_uncertainty: as `fit` takes them.
        dof: degrees of freedom of Student's t, or "estimate"; None for normal errors.
    """

    data: RestitutionData
    objective: str
    model: LawModel
    local: tuple[Local, ...]
    trees: tuple[Tree, ...] = ()
    extra_scatter: bool = False
    scale_uncertainty: bool = False
    dof: float | str | None = None

    @cached_property
    def errors(self) -> tuple[Errors, ...]:
        """The errors of each observable's points: what is stated of them, and what is to be found."""
        data, asked = self.data, (self.extra_scatter, self.scale_uncertainty, self.dof)
        others = sorted(data.observed, key=lambda one: PLACES[one.name])
        every = [None, *others] if np.any(np.isfinite(data.restitution)) else others
        return tuple(Errors.of(data, *asked, one) for one in every)

    @property
    def is_in_air(self) -> bool:
        """Whether drag was taken out of its ε, with a coefficient that is not known exactly."""
        is_measured = bool(np.any(np.isfinite(self.data.restitution)))
        return self.objective == "model" and is_measured and self.data.errors.by_drag is not None

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
        remedy = f"laws that need none are {listed(WITHOUT_CONTACT)}"
        raise data.refusal(f"no elastic properties, which {model.key} needs", remedy)
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
        refused = f"{names}, of which {model.key} tells nothing"
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
    """What files call a law of one's own."""
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
    local: list[Local] = []
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
    return SetSpec(data, objective, model, tuple(local), tuple(trees))


def _guessable(known: Known, data: RestitutionData) -> bool:
    return data.contact is not None or known.law in (LAWS[name] for name in WITHOUT_CONTACT)


def _unsaid(name: str, held, model: LawModel) -> Parameter:
    """A parameter of which nothing was said: free, unless ε does not tell it."""
    if name in held or (name == "psi" and "eps_up" in model.parameters):
        return Parameter(free=False)
    return Parameter(shared=name in LINE)


def _local(data, model: LawModel, name: str, parameter: Parameter, guess, ranges) -> Local:
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
    return Local(name, parameter, declared, start, (low, high))


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


def _whole(name: str, parameter: Parameter) -> tuple[list[Local], Tree]:
    """The numbers of a whole parameter, each a parameter of its own."""
    if parameter.value is None:
        told = DataError("value", "missing", "an array or a pytree of them, where a search starts")
        raise _placed(parameter, name, told)
    tree, numbers = Tree.of(name, parameter.value), numbers_in(parameter.value)
    one = Parameter(free=parameter.free, shared=parameter.shared)
    wide = (-np.inf, np.inf)
    pairs = zip(tree.entries, numbers, strict=True)
    return [Local(entry, one, Declared(entry), float(x), wide) for entry, x in pairs], tree


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
    flights = tuple(g for g, spec in zip(sets, specs, strict=True) if spec.is_in_air)
    if flights:
        name = specs[sets.index(flights[0])].data.name
        label = f"{DRAG}[{name}]" if many > len(sets) else DRAG
        known = Parameter(0.0, prior=(0.0, UNCERTAIN), transform="none")
        ends = (-np.inf, np.inf)
        elements += (Element(label, DRAG, flights, known, Declared(DRAG), 0.0, ends),)
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
            by_drag = by_drag_of(one)[rows] if name == RESTITUTION else np.zeros(count)
            ones, sets = np.ones(count), np.full(count, g)
            parts.append((one.velocity[rows], value, ones, sets, code, unit, by_drag))
            impacts.append(first + rows)
        first += len(one)
    columns = (np.concatenate(column) for column in zip(*parts, strict=True))
    return Points(*columns), np.concatenate(impacts)


def by_drag_of(data: RestitutionData) -> np.ndarray:
    """∂(expected - measured ε)/∂c, (n,), for flights with a drag coefficient of (1 + c) C_d.

    The measured velocity moves too: the curve is taken as the power of v that the points follow.
    """
    by_drag = data.errors.by_drag
    if by_drag is None:
        return np.zeros(len(data))
    seen = (data.restitution > 0) & np.isfinite(data.restitution)
    power, v = 0.0, np.log(data.velocity[seen])
    if len(v) > 2 and np.ptp(v) > LEAST_RANGE:
        power = float(np.clip(np.polyfit(v, np.log(data.restitution[seen]), 1)[0], *POWERS))
    return power * data.restitution / data.velocity * by_drag[:, 1] - by_drag[:, 0]


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
