"""The request of a fit, and what it makes of each data set: its law, parameters and errors (`SetSpec`)."""

import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
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
    model_of,
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
WIDE = (-np.inf, np.inf)
Progress = Callable[[str, int, int], None]
Specs = Mapping[str, Any] | Sequence[Any] | None


@dataclass(frozen=True)
class SetSpec:
    """Law, parameters and errors of one data set."""

    data: RestitutionData
    objective: str  # "model" or "two-step"
    model: LawModel
    local: tuple[Element, ...]  # the law's parameters, free and held
    errors: tuple[
        Errors, ...
    ]  # of each observable's points: what is stated, and what is to be found

    @property
    def by_eps_up(self) -> bool:
        """Whether ε_up is what it has in place of σ and ψ."""
        return "eps_up" in self.model.parameters


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


def stated_parameters(parameters: Specs, datasets: Sequence[RestitutionData]) -> list[dict]:
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


def _spec(data: RestitutionData, said: dict[str, Any], asked: FitOptions) -> SetSpec:
    if asked.noise == "student-t" and Errors.of(data).shares:
        accepted = '"normal" where points share errors (groups, bounce sequences)'
        raise DataError("noise", "student-t", accepted)
    options = {name: value for name, value in said.items() if isinstance(value, str)}
    named = {name: value for name, value in said.items() if name not in options}
    model = law_model(data, asked.law, options, named)
    # Eq. (17), or a constant, by itself
    objective = "model" if data.contact is None else asked.objective or "model"
    _check_law(data, model, objective)
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
    local, trees = _elements(data, model, given)
    dof = asked.noise_dof if asked.noise == "student-t" else None
    errors = tuple(
        Errors.of(data, asked.extra_scatter, asked.scale_uncertainty, dof, observed)
        for observed, *_ in blocks_of(data)
    )
    return SetSpec(data, objective, replace(model, trees=trees), local, errors)


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
    if isinstance(law, type) and not issubclass(law, sj.ContactLaw):
        raise DataError("law", law, KINDS_OF_LAW)
    return model_of(law, key, None if data is None else data.contact, options)


def _check_law(data: RestitutionData, model: LawModel, objective: str) -> None:
    """Refuse a law that determines nothing of these data, or needs what they do not have."""
    names = listed(one.name for one in data.observed)
    if model.needs_contact and data.contact is None:
        advice = f"laws that need none are {listed(WITHOUT_CONTACT)}"
        raise data.refusal(f"no elastic properties, which {model.key} needs", advice)
    if names and objective == "two-step":
        raise DataError("objective", f"two-step with {names}", "model, which takes all of them")
    if names and issubclass(model.law_type, sj.HardSphereLaw):
        refused = f"{names}, of which {model.key} determines nothing"
        raise data.refusal(refused, "a law with a contact force")
    if objective == "two-step" and model.key != "zhou":
        raise DataError("objective", f"two-step with {model.key}", 'Zhou\'s law, or "model"')


def _check_fixed(model: LawModel, data: RestitutionData, name: str, parameter: Parameter) -> None:
    """Check that fixed parameters have a value: stated, or from the data or the law, not a guess."""
    known = KNOWN.get(model.key)
    told = name.startswith(OF_CONTACT) or name in model.defaults
    if parameter.free or parameter.value is not None or told:
        return
    if known is None or name not in known.held(data):
        raise placed(parameter, name, DataError("value", "missing", "given where it is fixed"))


def placed(parameter: Parameter, name: str, error: DataError) -> Exception:
    """A refusal of a parameter, with the line of the file that it is from."""
    told = DataError(f"{error.argument} of {name}", error.value, error.accepted)
    return told if parameter.origin is None else parameter.origin.error(told)


def _identified(data, given: dict[str, Parameter], model: LawModel, options):
    """Parameters of Zhou's law for these data: ε_up without points below yield, no χ̃ without points above.

    Only where nothing was said of σ, ψ or ε_up; of ε_up wherever prior and bounds let yield be. Bodies
    that yield at several velocities have an ε_up each, and these separate σ from ψ.
    """
    held, measured = Parameter(free=False), np.isfinite(data.restitution)
    if not np.any(measured):  # neither enters the force
        return {"sigma": held, "psi": held} | given, model
    moves = any(given[n].free for leaf in MOVE_YIELD if (n := OF_CONTACT + leaf) in given)
    below = (data.velocity <= _highest_yield(data.contact, given))[measured]
    if np.all(below) and not moves and not data.observed:
        return given | dict.fromkeys(LINE if {*LINE} & {*given} else ("chi",), held), model
    told = {"sigma", "psi", "eps_up"} & {*given}
    if told or np.any(below) or several_yields(data.contact):
        return given, model
    return given, zhou_model([*(name for name in LINE if name in given), "eps_up"], options)


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


def _elements(data, model: LawModel, given: dict[str, Parameter]):
    """Start and range of every parameter, and how those that are whole are put together."""
    known = KNOWN.get(model.key) or Known(model.law_type, "")
    held, ranges = known.held(data), known.ranges(data)
    guess = known.guess(data) | held
    local: list[Element] = []
    trees: list[Tree] = []
    for name in dict.fromkeys([*model.parameters, *given]):
        if name in model.whole:
            if name in given:
                entries, tree = _whole(name, given[name])
                local, trees = [*local, *entries], [*trees, tree]
            elif name not in model.defaults:
                accepted = "given, as the law has no default"
                raise DataError(f"parameters[{name!r}]", "missing", accepted)
            continue
        stands_in = name == "psi" and "eps_up" in model.parameters and name not in given
        is_free, declared = not (stands_in or name in held), model.declared(name)
        parameter = given.get(name, Parameter(free=is_free, shared=is_free and name in LINE))
        try:
            low, high = parameter.range_within(declared)
        except DataError as error:
            raise placed(parameter, name, error) from None
        least, most = ranges.get(name, WIDE)
        ends = max(low, least), min(high, most)
        start = _start(data, model, name, parameter, guess, ends)
        if name in LINE and parameter.free and not parameter.shared:
            parameter = replace(parameter, shared=True)  # Eq. (18)'s line belongs to all materials
        local.append(Element(name, parameter, declared, start, ends, stands_in))
    return tuple(local), tuple(trees)


def _start(data, model: LawModel, name: str, parameter: Parameter, guess, ends) -> Any:
    """Start of a free parameter, or value of a fixed one."""
    if parameter.value is not None:
        return float(parameter.value)
    if name.startswith(OF_CONTACT):
        values = getattr(data.contact, name.removeprefix(OF_CONTACT))
        return float(np.mean(values)) if parameter.free else values
    default = model.defaults.get(name)
    value = guess.get(name, default if is_finite_number(default) else None)
    if parameter.prior is not None:
        value = parameter.prior[0]
    return _inside(value, *ends) if parameter.free else value


def _inside(value: Any, low: float, high: float) -> float:
    """A guess that respects the bounds; their middle, or 1, where there is none."""
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
    pairs = zip(tree.entries, numbers, strict=True)
    return [Element(entry, one, Declared(entry), float(x), WIDE) for entry, x in pairs], tree


def blocks_of(data: RestitutionData) -> Iterator[tuple[Any, str, np.ndarray, np.ndarray, Any]]:
    """Each observable (None for ε), its name, its impacts, the values and their unit."""
    rows = np.flatnonzero(np.isfinite(data.restitution))
    if len(rows):
        yield None, RESTITUTION, rows, data.restitution[rows], np.ones(len(rows))
    for one in sorted(data.observed, key=lambda one: PLACES[one.name]):
        yield one, one.name, one.rows, one.value / one.scale, one.scale
