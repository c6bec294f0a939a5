"""The request of a fit: everything that is needed to make it again.

Each data set has its law, and the parameters of the law (`SetSpec`)."""

import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

import softjax as sj
from calibration.data import RestitutionData
from calibration.errors import DataError, is_finite_number, listed
from calibration.fitting.collisions import ROUTES, Route
from calibration.fitting.errors import Errors
from calibration.fitting.laws import (
    EXTRA,
    KNOWN,
    LAWS,
    LINE,
    MOVE_YIELD,
    OF_CONTACT,
    WITHOUT_CONTACT,
    Known,
    LawModel,
    Tree,
    law_name,
    model_of_class,
    model_of_function,
    numbers_in,
    several_yields,
    zhou_model,
)
from calibration.fitting.problem import Element
from calibration.observables import PLACES, RESTITUTION
from calibration.options import KINDS_OF_LAW, FitOptions, checked_law
from calibration.parameters import Parameter, as_parameter
from softjax.fields import Declared

# ε to 1e-11, compiled in half of dopri8's time
DEFAULT_ODE = sj.ODE(steps=16, solver="dopri5")
REACH = 5.0  # standard deviations of a prior within which a search is expected to end
Progress = Callable[[str, int, int], None]
Specs = Mapping[str, Any] | Sequence[Any] | None


@dataclass(frozen=True)
class SetSpec:
    """Law, parameters and options of one data set."""

    data: RestitutionData  # the measurements, "model" or "two-step"
    objective: str
    model: LawModel  # its law
    local: tuple[Element, ...]  # the law's parameters, free and held
    options: FitOptions  # how to fit it

    @cached_property
    def errors(self) -> tuple[Errors, ...]:
        """The errors of each observable's points: what is stated of them, and what is to be found."""
        data, options = self.data, self.options
        dof = options.noise_dof if options.noise == "student-t" else None
        asked = options.extra_scatter, options.scale_uncertainty, dof
        observed = {one.name: one for one in data.observed}
        return tuple(Errors.of(data, *asked, observed.get(name)) for name, *_ in blocks_of(data))

    @property
    def by_eps_up(self) -> bool:
        """Whether ε_up is what it has in place of σ and ψ."""
        return any(one.name == "eps_up" and not one.stands_in for one in self.local)


@dataclass(frozen=True)
class Request:
    """A requested fit.

    Attributes:
        datasets: the measurements.
        parameters: what was said of the law's parameters.
        options: the law, and how to fit it.
        progress: called as progress(stage, done, total).
    """

    datasets: tuple[RestitutionData, ...]
    parameters: Any = None
    options: FitOptions = FitOptions()
    progress: Progress | None = None

    @property
    def route(self) -> Route:
        """The route that the options name; None: what suits the law."""
        route, rtol = self.options.route, self.options.rtol
        if rtol is not None:
            return sj.ODE(rtol=rtol)
        if not isinstance(route, str):
            return route
        return DEFAULT_ODE if route == "ode" else ROUTES[route]()

    def with_options(self, **changed: Any) -> "Request":
        """The request with some other options."""
        return replace(self, options=self.options.model_copy(update=changed))

    def tell(self, stage: str, done: int, total: int) -> None:
        if self.progress is not None:
            self.progress(stage, done, total)

    def specs(self) -> list[SetSpec]:
        """The law and parameters of each data set.

        Raises:
            ValueError: naming what does not fit together and what is accepted.
        """
        said = stated_parameters(self.parameters, self.datasets)
        more, pairs = self.options.law_options, zip(self.datasets, said, strict=True)
        return [_spec(data, {**own, **more}, self.options) for data, own in pairs]

    def chosen_route(self, specs: Sequence[SetSpec]) -> Route:
        """The requested route; else time integration for the paper's procedure, or what suits the law."""
        if self.route is not None:
            return self.route
        return DEFAULT_ODE if any(spec.objective == "two-step" for spec in specs) else None

    def route_of_curve(self, law: type) -> Route:
        """Route from a fitted law to its curve: the energy balance, or the route of the fit."""
        return self.route if issubclass(law, sj.RateDependentLaw) else None


def datasets_of(data: Any) -> tuple[RestitutionData, ...]:
    """One data set, or several, as a tuple."""
    several = not isinstance(data, RestitutionData | Mapping | str | np.ndarray)
    datasets = tuple(data) if several and hasattr(data, "__iter__") else (data,)
    if not datasets or not all(isinstance(one, RestitutionData) for one in datasets):
        raise DataError("data", data, "RestitutionData or a list of them")
    return datasets


def _spec(data: RestitutionData, said: dict[str, Any], asked: FitOptions) -> SetSpec:
    if asked.noise == "student-t" and Errors.of(data).shares:
        accepted = '"normal" where points share errors (groups, bounce sequences)'
        raise DataError("noise", "student-t", accepted)
    options = {name: value for name, value in said.items() if isinstance(value, str)}
    named = {name: value for name, value in said.items() if name not in options}
    model = law_model(data, asked.law, options, named)
    if model.needs_contact and data.contact is None:
        advice = f"laws that need none are {listed(WITHOUT_CONTACT)}"
        raise data.refusal(f"no elastic properties, which {model.key} needs", advice)
    objective = asked.objective or "model"
    if objective == "two-step" and data.contact is None:
        objective = "model"  # Eq. (17), or a constant, by itself
    if data.observed:
        _check_observed(data, model, objective)
    if objective == "two-step" and model.key != "zhou":
        raise DataError("objective", f"two-step with {model.key}", 'Zhou\'s law, or "model"')
    given = {}
    for name, value in named.items():
        try:
            full = model.canonical(name)
        except DataError as error:
            origin = getattr(value, "origin", None)
            raise error if origin is None else origin.error(error) from None
        is_whole = full in model.whole and not isinstance(value, Parameter)
        given[full] = Parameter(value, free=False) if is_whole else as_parameter(name, value)
        _check_fixed(model, data, full, given[full])
    model = model.with_units({name: one.unit for name, one in given.items() if one.unit})
    if model.key == "zhou" and objective == "model":
        given, model = _identified(data, given, model, options)
    local, trees = _located(data, model, given)
    return SetSpec(data, objective, replace(model, trees=trees), local, asked)


def _check_observed(data: RestitutionData, model: LawModel, objective: str) -> None:
    """Check that observables other than ε have a law with a force, and a likelihood."""
    names = listed(one.name for one in data.observed)
    if objective == "two-step":
        raise DataError("objective", f"two-step with {names}", "model, which takes all of them")
    if issubclass(model.law_type, sj.HardSphereLaw):
        refused = f"{names}, of which {model.key} determines nothing"
        raise data.refusal(refused, "a law with a contact force")


def _check_fixed(model: LawModel, data: RestitutionData, name: str, parameter: Parameter) -> None:
    """Check that fixed parameters have a value: stated, or from the data or the law, not a guess."""
    known = KNOWN.get(model.key)
    told = name.startswith(OF_CONTACT) or name in model.defaults
    if parameter.free or parameter.value is not None or told:
        return
    if known is None or name not in known.held(data):
        raise placed(parameter, name, DataError("value", "missing", "given where it is fixed"))


def law_model(data: RestitutionData | None, law, options, named) -> LawModel:
    """The requested law: a name, a class, a function; None: what suits the data."""
    if law is None and data is not None and data.contact is None:
        law = "constant" if data.limit_velocity is None else "eq-17"
    law = checked_law(law or "zhou")
    law = LAWS[law] if isinstance(law, str) else law
    if law is sj.Zhou:
        return zhou_model([name for name in named if name in EXTRA], options)
    key = law_name(law)
    assert key is not None
    if key in LAWS and LAWS[key] is not law:
        raise DataError("law", f"your own {key!r}", "named otherwise than the built-in laws")
    if isinstance(law, type) and issubclass(law, sj.ContactLaw):
        return model_of_class(law, key, options)
    if isinstance(law, type):
        raise DataError("law", law, KINDS_OF_LAW)
    return model_of_function(law, key, None if data is None else data.contact, options)


def _identified(data, given: dict[str, Parameter], model: LawModel, options):
    """Parameters of Zhou's law for these data: ε_up without points below yield, no χ̃ without points above.

    Only where nothing was said of σ, ψ or ε_up; of ε_up wherever prior and bounds let yield be. Bodies
    that yield at several velocities have an ε_up each, and these separate σ from ψ.
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


def _located(data, model: LawModel, given: dict[str, Parameter]):
    """Start and range of every parameter, and how those that are whole are put together."""
    known = KNOWN.get(model.key)
    if known is None or (data.contact is None and model.key not in WITHOUT_CONTACT):
        known = Known(model.law_type, "")
    guess, held, ranges = dict(known.guess(data)), known.held(data), known.ranges(data)
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
        by_eps_up = name == "psi" and "eps_up" in model.parameters
        unsaid = (
            Parameter(free=False) if name in held or by_eps_up else Parameter(shared=name in LINE)
        )
        parameter = given.get(name, unsaid)
        one = _local(data, model, name, parameter, guess | {**held}, ranges)
        local.append(replace(one, stands_in=by_eps_up and name not in given))
    return tuple(local), tuple(trees)


def _local(data, model: LawModel, name: str, parameter: Parameter, guess, ranges) -> Element:
    declared = model.declared(name)
    try:
        low, high = parameter.range_within(declared)
    except DataError as error:
        raise placed(parameter, name, error) from None
    if name in ranges:
        own = ranges[name]
        low, high = max(low, own[0]), min(high, own[1])
    start = _start(data, model, name, parameter, guess, (low, high))
    if name in LINE and not parameter.shared and parameter.free:
        parameter = replace(parameter, shared=True)  # Eq. (18)'s line belongs to all materials
    return Element(name, parameter, declared, start, (low, high))


def placed(parameter: Parameter, name: str, error: DataError) -> Exception:
    told = DataError(f"{error.argument} of {name}", error.value, error.accepted)
    return told if parameter.origin is None else parameter.origin.error(told)


def _start(data, model: LawModel, name: str, parameter: Parameter, guess, ends) -> Any:
    """Start of a free parameter, or value of a fixed one."""
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
        raise placed(parameter, name, told)
    tree, numbers = Tree.of(name, parameter.value), numbers_in(parameter.value)
    one = Parameter(free=parameter.free, shared=parameter.shared)
    wide = (-np.inf, np.inf)
    pairs = zip(tree.entries, numbers, strict=True)
    return [Element(entry, one, Declared(entry), float(x), wide) for entry, x in pairs], tree


def stated_parameters(parameters: Specs, datasets) -> list[dict[str, Any]]:
    """Stated parameters of each data set, {name: parameter}.

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


def blocks_of(data: RestitutionData):
    """Yield for each observable its name, its impacts, the values and their unit."""
    rows = np.flatnonzero(np.isfinite(data.restitution))
    if len(rows):
        yield RESTITUTION, rows, data.restitution[rows], np.ones(len(rows))
    for one in sorted(data.observed, key=lambda one: PLACES[one.name]):
        yield one.name, one.rows, one.value / one.scale, one.scale
