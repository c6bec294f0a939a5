"""The request of a fit, and the search problems that it asks for.

Each data set has its law, parameters and errors (`SetSpec`). Sets that share no parameter are fits of
their own, whatever else is fitted with them: components. A component has one vector z of all its
elements, and one problem a stage, which searches some of them."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import softjax as sj
from calibration.data import RestitutionData
from calibration.data.air import UNCERTAIN
from calibration.errors import DataError, is_finite_number, listed
from calibration.fitting.collisions import Laws, Route
from calibration.fitting.elements import DRAG, FARTHEST, Element, pools_of
from calibration.fitting.errors import Errors
from calibration.fitting.laws import (
    AFFECTS_YIELD,
    CONTACT_LEAVES,
    EXTRA,
    KNOWN,
    LAWS,
    LINE,
    OF_CONTACT,
    WITHOUT_CONTACT,
    LawModel,
    Start,
    Tree,
    law_name,
    model_of,
    numbers_in,
    several_yields,
    zhou_model,
)
from calibration.fitting.noise import JOINT, LEAST_SQUARES
from calibration.fitting.problem import Problem
from calibration.fitting.rows import Points
from calibration.observables import OBSERVABLES, PLACES, RESTITUTION
from calibration.options import KINDS_OF_LAW, FitOptions, checked_law, route_named
from calibration.parameters import Parameter, Transform, as_parameter
from softjax.fields import Declared

# ε to 1e-11, compiled in half of dopri8's time
DEFAULT_ODE = sj.ODE(steps=16, solver="dopri5")
TRIED = 1e-3  # step in z that shows whether yield moves with a parameter
REACH = 5.0  # standard deviations of a prior within which a search is expected to end
WIDE = (-np.inf, np.inf)
NO_DRAG = (-1.0, np.inf)  # of c: a drag coefficient is not negative
LEAST_RANGE, STEEPEST = 0.2, (-1.0, 0.0)  # of ln v, and of what power of v a curve may be
LIMIT = OF_CONTACT + "limit_velocity"
FREE_FOR_SCATTER = 3  # degrees of freedom from which on a scatter is estimated by itself
EMPIRICAL = ("sigma", "psi", LIMIT)  # searched by Eq. (17)'s stage
Specs = Mapping[str, Any] | Sequence[Any] | None


@dataclass(frozen=True)
class SetSpec:
    """Law, parameters and errors of one data set."""

    data: RestitutionData
    objective: str  # "model" or "two-step"
    model: LawModel
    local: tuple[Element, ...]  # the law's parameters, free and fixed
    errors: tuple[Errors, ...]  # of each observable's points, stated and to be estimated

    @property
    def by_eps_up(self) -> bool:
        """Whether ε_up is what it has in place of σ and ψ."""
        return "eps_up" in self.model.parameters


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


@dataclass(frozen=True)
class Request:
    """A requested fit.

    Attributes:
        datasets: the measurements.
        parameters: what is stated of the law's parameters.
        options: the law, and how to fit it.
    """

    datasets: tuple[RestitutionData, ...]
    parameters: Any = None
    options: FitOptions = FitOptions()

    @property
    def route(self) -> Route:
        """The route that the options name; None: what suits the law."""
        route, rtol = self.options.route, self.options.rtol
        if rtol is not None:
            return sj.ODE(rtol=rtol)
        if not isinstance(route, str):
            return route
        return DEFAULT_ODE if route == "ode" else route_named(route)

    def with_options(self, **changed: Any) -> "Request":
        """The request with some other options."""
        return replace(self, options=self.options.model_copy(update=changed))

    def specs(self) -> list[SetSpec]:
        """The law and parameters of each data set.

        Raises:
            ValueError: naming what does not fit together and what is accepted.
        """
        entries = stated_parameters(self.parameters, self.datasets)
        more, pairs = self.options.law_options, zip(self.datasets, entries, strict=True)
        return [_spec(data, {**stated, **more}, self.options) for data, stated in pairs]

    def route_of_curve(self, law: type) -> Route:
        """Route from a fitted law to its curve: the energy balance, or the route of the fit."""
        return self.route if issubclass(law, sj.RateDependentLaw) else None


def datasets_of(data: Any) -> tuple[RestitutionData, ...]:
    """One data set, or several, as a tuple."""
    several = not isinstance(data, RestitutionData | Mapping | str | np.ndarray)
    datasets = tuple(data) if several and hasattr(data, "__iter__") else (data,)
    if not datasets or not all(isinstance(data, RestitutionData) for data in datasets):
        raise DataError("data", data, "RestitutionData or a list of them")
    return datasets


def stated_parameters(parameters: Specs, datasets: Sequence[RestitutionData]) -> list[dict]:
    """Stated parameters of each data set, {name: parameter}.

    `parameters` is a mapping ("chi" for all sets, "chi[name]" for one; a number fixes, a text is an
    option), or one such mapping per data set.
    """
    several = isinstance(parameters, Iterable) and not isinstance(parameters, Mapping | str)
    one = {} if parameters is None else parameters
    mappings: list[Any] = list(one) if several else [one] * len(datasets)
    if len(mappings) != len(datasets) or not all(isinstance(p, Mapping) for p in mappings):
        raise DataError("parameters", parameters, "a mapping, or one mapping per data set")
    entries = []
    for mapping, data in zip(mappings, datasets, strict=True):
        names, own = [data.name] if several else [d.name for d in datasets], {}
        # names for one set come last, so that they win over those for all
        for key in sorted(mapping, key=lambda key: "[" in str(key)):
            if not isinstance(key, str):
                raise DataError("parameters", key, "by the parameters' names")
            name, _, owner = key.removesuffix("]").partition("[")
            if owner not in ("", *names):
                accepted = f"named after one of: {listed(names)}"
                raise DataError(f"parameters[{key!r}]", owner, accepted)
            if owner in ("", data.name):
                own[name] = mapping[key]
        entries.append(own)
    return entries


def _spec(data: RestitutionData, entries: dict[str, Any], options: FitOptions) -> SetSpec:
    words = {name: value for name, value in entries.items() if isinstance(value, str)}
    named = {name: value for name, value in entries.items() if name not in words}
    model = law_model(data, options.law, words, named)
    # Eq. (17), or a constant, by itself
    objective = "model" if data.contact is None else options.objective or "model"
    _check_law(data, model, objective, options.noise)
    start, stated = KNOWN[model.key].start(data) if model.key in KNOWN else Start(), {}
    for name, value in named.items():
        try:
            full = model.canonical(name)
        except DataError as error:
            origin = getattr(value, "origin", None)
            raise error if origin is None else origin.error(error) from None
        is_array = full in model.arrays and not isinstance(value, Parameter)
        stated[full] = Parameter(value, free=False) if is_array else as_parameter(name, value)
        has_value = full.startswith(OF_CONTACT) or full in {*model.defaults, *start.fixed}
        if not (stated[full].free or stated[full].value is not None or has_value):
            no_value = DataError("value", "missing", "given where it is fixed")  # a guess is none
            raise placed(stated[full], full, no_value)
    model = model.with_units({name: p.unit for name, p in stated.items() if p.unit})
    if model.key == "zhou" and objective == "model":
        stated, model = _identified(data, stated, model, words)
    local, trees = _elements(data, model, start, stated)
    options = _with_scatter(data, sum(element.parameter.free for element in local), options)
    errors = tuple(Errors.of(data, options, observed) for observed, *_ in blocks_of(data))
    return SetSpec(data, objective, replace(model, trees=trees), local, errors)


def _with_scatter(data: RestitutionData, free: int, options: FitOptions) -> FitOptions:
    """The options with `extra_scatter` decided: by itself where readings are surer than balls are alike."""
    if options.extra_scatter is not None or not data.errors.measured_by.is_precise:
        return options
    enough = len(data) - free >= FREE_FOR_SCATTER and not options.scale_uncertainty
    return options.model_copy(update={"extra_scatter": enough})


def law_model(data: RestitutionData | None, law, options, named) -> LawModel:
    """The requested law: a name, a class, a function; None: what suits the data."""
    if law is None and data is not None and data.contact is None:
        law = "constant" if data.limit_velocity is None else "eq-17"
    law = checked_law(law or "zhou")
    law = LAWS[law] if isinstance(law, str) else law
    if law is sj.Zhou:
        return zhou_model([name for name in named if name in EXTRA], options)
    return model_of_class(law, None if data is None else data.contact, options)


def model_of_class(law: Any, contact: sj.Contact | None, options: Mapping[str, Any]) -> LawModel:
    """A class of laws, or a function that builds one, as a fit sees it.

    Raises:
        ValueError: where it is none, or has the name of a built-in law.
    """
    key = law_name(law)
    assert key is not None
    if key in LAWS and LAWS[key] is not law:
        raise DataError("law", f"your own {key!r}", "named otherwise than the built-in laws")
    if isinstance(law, type) and not issubclass(law, sj.ContactLaw):
        raise DataError("law", law, KINDS_OF_LAW)
    return model_of(law, key, contact, options)


def _check_law(data: RestitutionData, model: LawModel, objective: str, noise: str) -> None:
    """Refuse a law that determines nothing of these data, or needs what they do not have."""
    names = listed(observed.name for observed in data.observed)
    if noise not in JOINT and Errors.of(data).shares:
        joint = " or ".join(f'"{name}"' for name in JOINT)
        accepted = f"{joint} where points share errors (groups, bounce sequences)"
        raise DataError("noise", noise, accepted)
    by_force = not issubclass(model.law_type, sj.HardSphereLaw)
    if model.takes_contact and by_force and data.contact is None:
        advice = f"laws that need none are {listed(WITHOUT_CONTACT)}"
        raise data.refusal(f"no elastic properties, which {model.key} needs", advice)
    if names and objective == "two-step":
        raise DataError("objective", f"two-step with {names}", "model, which takes all of them")
    if names and not by_force:
        refused = f"{names}, of which {model.key} determines nothing"
        raise data.refusal(refused, "a law with a contact force")
    if objective == "two-step" and noise not in LEAST_SQUARES:
        least_squares = " or ".join(f'"{name}"' for name in LEAST_SQUARES)
        raise DataError("noise", noise, f'{least_squares} with objective = "two-step"')
    if objective == "two-step" and model.key != "zhou":
        raise DataError("objective", f"two-step with {model.key}", 'Zhou\'s law, or "model"')


def placed(parameter: Parameter, name: str, error: DataError) -> Exception:
    """A refusal of a parameter, with the line of the file that it is from."""
    refusal = DataError(f"{error.argument} of {name}", error.value, error.accepted)
    return refusal if parameter.origin is None else parameter.origin.error(refusal)


def _identified(data, by_name: dict[str, Parameter], model: LawModel, options):
    """Parameters of Zhou's law for these data: ε_up without points below yield, no χ̃ without points above.

    Only where nothing is stated of σ, ψ or ε_up; of ε_up wherever prior and bounds let yield be. Bodies
    that yield at several velocities have an ε_up each, and these separate σ from ψ.
    """
    fixed, measured = Parameter(free=False), np.isfinite(data.restitution)
    if not np.any(measured):  # neither enters the force
        return {"sigma": fixed, "psi": fixed} | by_name, model
    yield_may_move = any(
        by_name[n].free for leaf in AFFECTS_YIELD if (n := OF_CONTACT + leaf) in by_name
    )
    below = (data.velocity <= _highest_yield(data.contact, by_name))[measured]
    if np.all(below) and not yield_may_move and not data.observed:
        names = LINE if {*LINE} & {*by_name} else ("chi",)
        held = {name: p for name, p in by_name.items() if name in names and not p.free}
        return by_name | dict.fromkeys(names, fixed) | held, model
    stated = {"sigma", "psi", "eps_up"} & {*by_name}
    if stated or np.any(below) or several_yields(data.contact):
        return by_name, model
    return by_name, zhou_model([*(name for name in LINE if name in by_name), "eps_up"], options)


def _highest_yield(contact: sj.Contact, parameters: Mapping[str, Parameter]) -> np.ndarray:
    """The highest critical velocity that prior and bounds of the contact's numbers allow [m/s]."""
    corner = {}
    for leaf, power in AFFECTS_YIELD.items():
        parameter = parameters.get(OF_CONTACT + leaf, Parameter(free=False))
        value = getattr(contact, leaf) if parameter.value is None else parameter.value
        if parameter.free:
            low, high = parameter.bounds or (0.0, np.inf)
            if parameter.prior is not None:
                mean, deviation = parameter.prior
                low, high = max(low, mean - REACH * deviation), min(high, mean + REACH * deviation)
            value = high if power > 0 else max(low, 1e-9 * high)
        corner[leaf] = value
    if not all(np.all(np.isfinite(value)) for value in corner.values()):
        return np.array(np.inf)  # anywhere
    return replace(contact, **corner).critical_velocity


def _elements(data, model: LawModel, known: Start, stated: Mapping[str, Parameter]):
    """Start and range of every parameter, and how arrays are put together."""
    guess = {**known.guess, **known.fixed}
    local: list[Element] = []
    trees: list[Tree] = []
    for name in dict.fromkeys([*model.parameters, *stated]):
        parameter = stated.get(name)
        if name in model.arrays:
            if parameter is None and name not in model.defaults:
                accepted = "given, as the law has no default"
                raise DataError(f"parameters[{name!r}]", "missing", accepted)
            if parameter is not None:  # each of its numbers is a parameter of its own
                if parameter.value is None:
                    accepted = "an array or a pytree of them, where a search starts"
                    raise placed(parameter, name, DataError("value", "missing", accepted))
                trees.append(Tree.of(name, parameter.value))
                one = Parameter(free=parameter.free, shared=parameter.shared)
                numbers = zip(trees[-1].entries, numbers_in(parameter.value), strict=True)
                local += [Element(n, one, Declared(n), float(x), WIDE) for n, x in numbers]
            continue
        stands_in = name == "psi" and "eps_up" in model.parameters and parameter is None
        if parameter is None:
            parameter = Parameter(free=not (stands_in or name in known.fixed))
        if name in LINE and parameter.free and not parameter.shared:
            # Eq. (18)'s line belongs to all materials
            parameter = parameter.model_copy(update={"shared": True})
        declared = model.declared(name)
        try:
            low, high = parameter.range_within(declared)
        except DataError as error:
            raise placed(parameter, name, error) from None
        least, most = known.ranges.get(name, WIDE)
        ends = max(low, least), min(high, most)
        start = _start(data, model, name, parameter, guess, *ends)
        end = known.ends.get(name, np.inf) if parameter.free and np.isinf(high) else np.inf
        end = max(end, start) if np.isfinite(end) else end
        reach = known.reach.get(name, FARTHEST)
        local.append(
            Element(name, parameter, declared, start, ends, stands_in, end=end, reach=reach)
        )
    return tuple(local), tuple(trees)


def _start(data, model: LawModel, name: str, parameter: Parameter, guess, low, high) -> Any:
    """Start of a free parameter, inside its range, or value of a fixed one."""
    if parameter.value is not None:
        return float(parameter.value)
    if name.startswith(OF_CONTACT):
        values = getattr(data.contact, name.removeprefix(OF_CONTACT))
        return float(np.mean(values)) if parameter.free else values
    default = model.defaults.get(name)
    value = guess.get(name, default if is_finite_number(default) else None)
    if parameter.prior is not None:
        value = parameter.prior[0]
    if not parameter.free:
        return value
    if value is not None and low < float(np.mean(value)) < high:
        return float(np.mean(value))
    if np.isfinite(low):
        return 0.5 * (low + high) if np.isfinite(high) else low + max(abs(low), 1.0)
    return high - max(abs(high), 1.0) if np.isfinite(high) else 1.0


def assemble(request: Request) -> list[Component]:
    """The components of a fit.

    Raises:
        ValueError: naming what does not fit together and what is accepted.
    """
    specs = request.specs()
    names = [spec.data.name for spec in specs]
    if len(set(names)) < len(names):
        raise DataError("data", names, "sets of different names")
    elements = _shared(specs)
    together = _together(specs, elements)
    two_step = any(spec.objective == "two-step" for spec in specs)
    route = request.route or (DEFAULT_ODE if two_step else None)  # the paper's procedure
    return [_component(sets, specs, elements, route) for sets in together]


def _shared(specs: Sequence[SetSpec]) -> list[Element]:
    """The free parameters of all data sets, those that are shared only once."""
    elements: dict[tuple[str, str], Element] = {}
    for g, spec in enumerate(specs):
        for element in spec.local:
            if not element.parameter.free:
                continue
            where = f"set {g}" if element.group is None else f"group {element.group}"
            owner = spec.data.name if element.group is None else element.group
            label = f"{element.name}[{owner}]" if len(specs) > 1 and owner else element.name
            first = elements.get((element.name, where), replace(element, label=label))
            elements[element.name, where] = replace(first, sets=(*first.sets, g))
    return list(elements.values())


def _together(specs: Sequence[SetSpec], elements: Sequence[Element]) -> list[tuple[int, ...]]:
    """Data sets that share or pool a parameter, directly or through others, in their order.

    Pools are of several sets by `model`; no group is named like a data set outside it, as results call
    "chi[name]" what either has.
    """
    pools: dict[str, tuple[int, ...]] = {}
    names, first = [spec.data.name for spec in specs], list(range(len(specs)))
    for element in elements:
        if element.parameter.pooled:
            pools[element.name] = (*pools.get(element.name, ()), *element.sets)
        if element.group in names and names.index(element.group) not in element.sets:
            accepted = "the name of a group that no data set outside the group has"
            error = DataError("shared", element.group, accepted)
            raise placed(element.parameter, element.name, error)
    for name, pool in pools.items():
        if len(pool) < 2:
            raise DataError(f"shared of {name}", "pooled", "left out for one data set alone")
        if any(specs[g].objective != "model" for g in pool):
            raise DataError(f"shared of {name}", "pooled", 'left out, or objective="model"')
    for sets in (*(element.sets for element in elements), *pools.values()):
        joined = {first[g] for g in sets}
        first = [min(joined) if k in joined else k for k in first]
    return [tuple(g for g, k in enumerate(first) if k == own) for own in sorted({*first})]


def _component(sets, specs, elements, route: Route) -> Component:
    own_specs = tuple(specs[g] for g in sets)
    if len({(spec.model.key, spec.objective) for spec in own_specs}) > 1:
        text = ", ".join(f"{spec.data.name}: {spec.model.key}" for spec in own_specs)
        raise DataError("parameters", f"shared between {text}", "shared within one law")
    free = [
        replace(e, sets=tuple(sets.index(g) for g in e.sets)) for e in elements if e.sets[0] in sets
    ]
    for g, spec in enumerate(own_specs):
        _check_count(spec, [e for e in free if e.sets == (g,)])
    # drag was taken out of these with a coefficient that is not known exactly
    flights = tuple(
        k
        for k, spec in enumerate(own_specs)
        if spec.objective == "model" and spec.data.errors.by_drag is not None
    )
    if flights:
        label = f"{DRAG}[{own_specs[flights[0]].data.name}]" if len(specs) > len(sets) else DRAG
        known = Parameter(0.0, prior=(0.0, UNCERTAIN), transform="none")
        free.append(Element(DRAG, known, Declared(DRAG), 0.0, NO_DRAG, False, label, flights))
    component = Component(sets, own_specs, tuple(free))
    return replace(component, stages=tuple(_stages(component, route)))


def _check_count(spec: SetSpec, own: Sequence[Element]) -> None:
    """More values than free parameters; not of those that a prior, or the other sets of a pool, determine too.

    Of a network its predictions do.
    """
    arrays = {tree.name for tree in spec.model.trees}
    names = [
        e.name
        for e in own
        if e.parameter.prior is None and not e.parameter.pooled
        if e.name.partition("[")[0] not in arrays
    ]
    count = sum(len(rows) for *_, rows, _, _ in blocks_of(spec.data))
    if count <= len(names):
        free = f"{len(names)} free parameter{'s' * (len(names) != 1)} ({', '.join(names)})"
        problem = f"{count} point{'s' * (count != 1)} for {free}"
        raise spec.data.refusal(problem, "more points than free parameters are needed")


def _stages(component: Component, route: Route) -> Iterator[tuple[str, Problem]]:
    """One stage by `model`; by `two-step` Eq. (17)'s, then the law's with what that gave."""
    all_elements, specs = list(range(len(component.elements))), component.specs
    # sets with ε_up and sets with σ are of one law of both
    model = next((spec.model for spec in specs if not spec.model.direct), specs[0].model)
    declared = {name: what for spec in specs for name, what in spec.model.parameters.items()}
    names = {local.name: local.name for spec in specs for local in spec.local}
    laws = component, replace(model, parameters=declared), names
    if specs[0].objective == "model":
        yield "model", _problem(*laws, all_elements, route)
        return
    first = [k for k in all_elements if component.elements[k].name in EMPIRICAL]
    eq_17 = model_of(sj.EmpiricalRestitution, "eq-17", None, {})
    names_17 = {name.removeprefix(OF_CONTACT): name for name in EMPIRICAL}
    yield "Eq. (17)", _problem(component, eq_17, names_17, first, None)
    rest = [k for k in all_elements if k not in first]
    yield "model", _problem(*laws, rest, route)


def _problem(
    component: Component,
    model: LawModel,
    names: Mapping[str, str],
    active: list[int],
    route: Route,
) -> Problem:
    """The problem of one law for all data sets.

    What is stated for other sets alone has the value of this one's contact, or none.

    Args:
        names: in full of each of the law's parameters.
        active: elements that are searched.
    """
    elements, specs = component.elements, component.specs
    sets = []
    for g, spec in enumerate(specs):
        contact, places = spec.data.contact, component.places(g)
        known = {OF_CONTACT + leaf: getattr(contact, leaf, None) for leaf in CONTACT_LEAVES}
        if "limit_velocity" in names:  # Eq. (17)'s own
            known[LIMIT] = spec.data.limit_velocity
        known |= {element.name: element.start for element in spec.local}
        local = {name: (places.get(full, -1), known.get(full)) for name, full in names.items()}
        sets.append((len(spec.data), contact, local))
    rows, data = Laws.of(model, sets), tuple(spec.data for spec in specs)
    points, impact = points_of(data)
    theta = np.array([e.start for e in elements])
    problem = Problem(
        data,
        elements,
        transform_of(elements),
        replace(rows, row=rows.row[impact]).bind(theta, active),
        points,
        np.array(active, int),
        route,
        tuple(errors for spec in specs for errors in spec.errors),
        joint=specs[0].objective == "model",
        pools=pools_of(elements),
    )
    if not getattr(model.law_type, "jumps_at_yield", False):
        return problem
    moved = [k in active and _moves_yield(problem, theta, k) for k in range(len(elements))]
    return replace(problem, affects_yield=np.array(moved)) if any(moved) else problem


def _moves_yield(problem: Problem, theta: np.ndarray, k: int) -> bool:
    """Whether the critical velocity depends on an element; of a law that a function builds it is tried."""
    name, model = problem.elements[k].name, problem.laws.model
    if name.startswith(OF_CONTACT):
        return name.removeprefix(OF_CONTACT) in AFFECTS_YIELD
    if model.direct or model.key in KNOWN:
        return False
    first = np.flatnonzero(np.isin(problem.points.set, problem.elements[k].sets))[:1]
    both = np.tile(problem.transform.unconstrained(theta), (2, 1))
    both[1, k] += TRIED * max(abs(both[1, k]), TRIED)
    here, moved = np.asarray(problem.yields_at(both, first))
    return not np.allclose(here, moved, rtol=1e-12, atol=0)


def blocks_of(data: RestitutionData) -> Iterator[tuple[Any, str, np.ndarray, np.ndarray, Any]]:
    """For each observable (None for ε) its name, impacts, values and unit."""
    rows = np.flatnonzero(np.isfinite(data.restitution))
    if len(rows):
        yield None, RESTITUTION, rows, data.restitution[rows], np.ones(len(rows))
    for part in sorted(data.observed, key=lambda part: PLACES[part.name]):
        yield part, part.name, part.rows, part.value / part.scale, part.scale


def transform_of(elements: Sequence[Element]) -> Transform:
    asked = [e.parameter.transform for e in elements]
    transform, ends = Transform.of([e.range for e in elements], asked), [e.end for e in elements]
    return transform._replace(upper=np.minimum(transform.upper, ends))


def points_of(data: Sequence[RestitutionData]) -> tuple[Points, np.ndarray]:
    """All points in a row, each weighing one; and which impact each is, those of all sets in a row."""
    parts, impacts, first = [], [], 0
    for g, measured in enumerate(data):
        for _, name, rows, value, unit in blocks_of(measured):
            ones, by_drag = np.ones(len(rows)), by_drag_of(measured, name)[rows]
            sets, code = np.full(len(rows), g), np.full(len(rows), PLACES[name])
            parts.append((measured.velocity[rows], value, ones, sets, code, unit, by_drag))
            impacts.append(first + rows)
        first += len(measured)
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
    is_measured = np.isfinite(eps) & (eps > 0)
    if not np.any(is_measured):
        return np.zeros(len(data))
    degree = min(2, int(np.sum(is_measured)) // 4) if np.ptp(v[is_measured]) > LEAST_RANGE else 0
    curve = np.polyfit(v[is_measured], np.log(eps[is_measured]), degree)
    smooth, power = np.exp(np.polyval(curve, v)), np.polyval(np.polyder(curve), v)
    cubed = np.where(is_measured, eps, 1.0) ** 3
    cubic = np.where(is_measured, (by_drag[:, 0] + eps * slower) / cubed, 0.0)
    of_eps = cubic * smooth**3 - smooth * slower
    return np.where(np.isfinite(eps), np.clip(power, *STEEPEST) * smooth * slower - of_eps, 0.0)
