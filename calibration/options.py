"""The settings of a fit, listed once.

`FitOptions` is the `[fit]` table of a material file, the options of `softjax fit` and `softjax
compare`, the keyword arguments of `calibration.fit`, and what `fit.json` keeps of them. A new setting
is one field here, and the line that uses it.
"""

import argparse
import importlib.util
import inspect
import sys
import traceback
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, get_args

from pydantic import (
    BeforeValidator,
    Field,
    PlainSerializer,
    TypeAdapter,
    ValidationError,
    WithJsonSchema,
    model_validator,
)

from calibration.errors import DataError, InputError, did_you_mean, listed, shown
from calibration.schema import Strict, choices, faults

# names of the built-in laws, and their classes in softjax
LAWS = {
    "zhou": "Zhou",
    "thornton": "Thornton",
    "walton-braun": "WaltonBraun",
    "viscoelastic": "ViscoelasticHertz",
    "hertz": "Hertz",
    "hertz-dashpot": "HertzDashpot",
    "linear": "LinearSpringDashpot",
    "constant": "ConstantRestitution",
    "eq-17": "EmpiricalRestitution",
}
KINDS_OF_LAW = f"a name ({listed(LAWS)}), a class of contact laws, or a function that builds one"
OWN_LAW = "FILE.py:NAME is your own, whose code runs"
ROUTES = {"ode": "ODE", "energy balance": "EnergyBalance", "closed form": "ClosedForm"}
OBJECTIVES = ("model", "two-step")
VALUES_ALONE = "intervals come from `model`: `two-step` gives values alone"

DOF = (2.0, 30.0, "a number in [2, 30]")  # of Student's t
# options of a law, and the laws that have them
LAW_OPTIONS = {"form": ("zhou",), "kappa": ("zhou",), "end": ("hertz-dashpot", "linear")}
OF_ONE_FIT = ("law", "objective", "unloading_line", "profiles")  # settings that no comparison has
# settings that act with some values of another only
ACTS_WITH: dict[str, tuple[str, tuple[Any, ...]]] = {
    "rtol": ("route", (None, "ode")),
    "noise_dof": ("noise", ("student-t",)),
}
Function = TypeVar("Function", bound=Callable[..., Any])


def require_likelihood(objective: str | None) -> None:
    """Refuse what needs a likelihood, which `two-step` has none of."""
    if objective == "two-step":
        raise DataError("objective", objective, f"model ({VALUES_ALONE})")


def checked_law(law: Any) -> Any:
    if isinstance(law, str) and law in OBJECTIVES:
        raise DataError("law", law, f"left out: that is an objective, objective={law!r}")
    if law is None or (isinstance(law, str) and law in LAWS) or callable(law):
        return law
    if isinstance(law, str):
        raise DataError("law", law, f"one of {listed(LAWS)}{did_you_mean(law, LAWS)}")
    raise DataError("law", law, KINDS_OF_LAW)


def _check_route(route: Any) -> Any:
    """A route without settings becomes its name; one of the user's own class stays as it is."""
    near = ""
    if route is None:
        return None
    if isinstance(route, str):
        if (name := route.replace("-", " ")) in ROUTES:
            return name
        near = did_you_mean(route, ROUTES)
    else:
        import softjax

        if isinstance(route, softjax.AbstractRoute):
            return _usable(route)
    routes = "softjax.EnergyBalance(), softjax.ClosedForm(), softjax.ODE(...), your own, or a name"
    raise DataError("route", route, f"{routes}: {listed(ROUTES)}{near}")


def _usable(route: Any) -> Any:
    """A route that a fit can compile in, and name in its report."""
    name = getattr(route, "name", None)
    if not isinstance(name, str):
        raise DataError("route", route, f'one with a name: name = "…" in {type(route).__name__}')
    try:
        hash(route)
    except TypeError:
        accepted = "one of numbers and words, without arrays: a fit compiles them in"
        raise DataError("route", route, accepted) from None
    # a class of the user's may have a name of the library's
    is_ours = type(route).__module__.startswith("softjax.")
    return name if is_ours and name in ROUTES and not vars(route) else route


def route_named(name: str, **settings: Any) -> Any:
    """A route of the library by its name, words set apart by spaces or hyphens; None for others."""
    import softjax

    classes = ROUTES | {softjax.TimeODE.name: "TimeODE"}
    found = classes.get(name.replace("-", " "))
    return None if found is None else getattr(softjax, found)(**settings)


def _route_entry(route: Any) -> Any:
    """Entry of a route in files; of one of the user's own, or with a solver of the user's, its name."""
    if not hasattr(route, "name"):
        return route
    settings = vars(route) if type(route).__module__.startswith("softjax.") else {}
    is_written = all(isinstance(x, str | int | float | None) for x in settings.values())
    return {"name": route.name, **(settings if is_written else {})}


def _check_dof(dof: Any) -> Any:
    """ν of Student's t: a number, also as the text of one."""
    with suppress(TypeError, ValueError):
        if not isinstance(dof, bool) and DOF[0] <= float(dof) <= DOF[1]:
            return float(dof)
    raise DataError("noise_dof", dof, DOF[2])


def _names(names: Iterable[str]) -> WithJsonSchema:
    return WithJsonSchema({"enum": [*names, None]})


Law = Annotated[Any, BeforeValidator(checked_law), _names(LAWS)]
Dof = Annotated[float, BeforeValidator(_check_dof), WithJsonSchema({"accepted": DOF[2]})]
Objective = Literal["model", "two-step"] | None
Route = Annotated[
    Any,
    BeforeValidator(_check_route),
    PlainSerializer(_route_entry),
    _names(ROUTES),
]
Line = Annotated[
    Literal["curves"] | None,
    BeforeValidator(lambda given: None if given == "none" else given),
]


class FitOptions(Strict):
    """Settings of a fit; None is chosen to suit the law and the data."""

    law: Law = Field(default=None, description="contact law to fit (default: zhou)")
    objective: Objective = Field(
        default=None,
        description="model (default): the likelihood of all points, all parameters at once; "
        "two-step: the paper's procedure for Zhou's law, σ and ψ from Eq. (17), then χ̃",
    )
    route: Route = Field(
        default=None,
        description="from a law to ε; default: the law's cheapest route, under two-step ode",
    )
    rtol: float | None = Field(
        default=None, ge=1e-14, le=0.1, description="relative tolerance of the time integration"
    )
    optimiser: Literal["l-bfgs", "levenberg-marquardt"] = Field(
        default="l-bfgs", description="search"
    )
    noise: Literal["normal", "student-t"] = Field(
        default="normal",
        description="distribution of independent errors; under student-t outliers lose their pull, "
        "and a stated uncertainty is its scale, not its standard deviation",
    )
    noise_dof: Dof = Field(default=4.0, description="degrees of freedom of student-t, in [2, 30]")
    form: Literal["first-order", "full"] | None = Field(
        default=None, description="form of Zhou's law (default: first-order)"
    )
    kappa: Literal["consistent", "printed"] | None = Field(
        default=None,
        description="κ of Zhou's law: consistent with the forces (default), or as printed",
    )
    end: Literal["zero-overlap", "zero-force"] | None = Field(
        default=None, description="end of a dashpot law's contact (default: zero-overlap)"
    )
    unloading_line: Line = Field(
        default="curves",
        description="Eq. (18) for several materials of Zhou's law: through all curves, or not at all",
    )
    starts: int = Field(
        default=32, ge=1, description="starts that are screened; the best are refined"
    )
    seed: int = Field(default=0, ge=0, description="seed of the starts")
    max_steps: int = Field(default=200, ge=1, description="iterations of one search")
    confidence: float = Field(default=0.95, gt=0, lt=1, description="confidence of all intervals")
    profiles: bool = Field(
        default=True, description="profile likelihoods; without them intervals from standard errors"
    )
    extra_scatter: bool | None = Field(
        default=None,
        description="estimate scatter in addition to the stated uncertainties; left out it is estimated for "
        "tracks of three points more than free parameters",
    )
    scale_uncertainty: bool = Field(
        default=False, description="stated uncertainties are right up to a factor: scale by √(χ²/ν)"
    )

    @model_validator(mode="after")
    def _act(self) -> "FitOptions":
        """Refuse settings that would do nothing, or exclude each other."""
        for name, acting in idle(dict(self)).items():
            value = getattr(self, name)
            if value != type(self).model_fields[name].default:
                raise DataError(name, value, f"left out: {acting}")
        if self.extra_scatter and self.scale_uncertainty:
            raise DataError("scale_uncertainty", True, "left out with extra_scatter")
        return self

    @property
    def law_options(self) -> dict[str, str]:
        """Options of the law that are stated, by name."""
        options = {name: getattr(self, name) for name in LAW_OPTIONS}
        return {name: value for name, value in options.items() if value is not None}


def idle(settings: Mapping[str, Any]) -> dict[str, str]:
    """Settings that would do nothing with the others, each with what they act with."""
    without_effect = {}
    for name, (other, acting) in ACTS_WITH.items():
        value = settings.get(other)
        if name in settings and getattr(value, "name", value) not in acting:
            words = " or ".join(f'"{value}"' for value in acting if value)
            without_effect[name] = f"it only applies to {other} {words}"
    return without_effect


def add_options(parser: Any, names: Iterable[str] = tuple(FitOptions.model_fields)) -> None:
    """The command-line options of some settings, `--max-steps` for `max_steps`."""
    for name in names:
        field = FitOptions.model_fields[name]
        help = (field.description or "").replace("%", "%%")
        help += f"; {OWN_LAW}" * (name == "law")
        if field.annotation is bool:
            keywords: dict[str, Any] = {"action": "store_const", "const": not field.default}
            help = f"no {help}" if field.default else help
        elif field.annotation == bool | None:
            keywords = {"action": argparse.BooleanOptionalAction}
        else:
            words = _words(name)
            keywords = {"type": partial(_parsed, name), "metavar": "X"}
            keywords |= {"metavar": f"{{{','.join(words)}}}"} if words else {}
            help += "" if field.default is None else f" (default: {field.default})"
        parser.add_argument(flag(name), dest=name, help=help, **keywords)


def merged(stated: Mapping[str, Any], overrides: Mapping[str, Any]) -> dict[str, Any]:
    """The settings of a file and of the command line, which wins; none may do nothing.

    Of the file's not what was for another law, or would do nothing now.
    """
    others = LAW_OPTIONS if overrides.get("law", stated.get("law")) != stated.get("law") else ()
    settings = {name: value for name, value in stated.items() if name not in others} | {**overrides}
    for name, acting in idle(settings).items():
        if name in overrides:
            raise DataError(flag(name), "given", f"left out: {acting}")
        del settings[name]
    return settings


def flag(name: str) -> str:
    """The command-line option of a setting; one that switches off what is on by default is `--no-…`."""
    is_on = FitOptions.model_fields[name].default is True
    return f"--{'no-' if is_on else ''}{name.replace('_', '-')}"


def given_options(arguments: argparse.Namespace) -> dict[str, Any]:
    """The settings that the command line gives."""
    table = {name: getattr(arguments, name, None) for name in FitOptions.model_fields}
    return {name: value for name, value in table.items() if value is not None}


def documented(function: Function, without: Iterable[str] = ()) -> Function:
    """Fill `**options` of a function: its signature and docstring list the settings one by one."""
    signature = inspect.signature(function)
    parameters = list(signature.parameters.values())[:-1]
    fields = FitOptions.model_fields
    more = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=field.default)
        for name, field in fields.items()
        if name not in {*signature.parameters, *without}
    ]
    parameters.sort(key=lambda parameter: parameter.kind)
    function.__signature__ = signature.replace(parameters=[*parameters, *more])  # type: ignore[attr-defined]
    table = "\n".join(f"        {p.name}: {fields[p.name].description}." for p in more)
    function.__doc__ = (function.__doc__ or "").replace("        OPTIONS", table)
    return function


def _words(name: str) -> tuple[str, ...]:
    """The words that a setting may be on the command line; what Python leaves out is "none"."""
    words = choices(FitOptions, name)
    may_be_none = type(None) in get_args(FitOptions.model_fields[name].annotation)
    is_on = FitOptions.model_fields[name].default is not None
    allowed = (*words, "none") if words and may_be_none and is_on else words
    return tuple(word.replace(" ", "-") for word in allowed)


def law_of_file(text: str) -> Any:
    """The class or function of FILE.py:NAME, whose code runs: a command line names it, never a file.

    Raises:
        InputError: where there is none, or its code fails.
    """
    path, _, name = text.rpartition(":")
    if not Path(path).is_file():
        raise InputError(path, None, "no such file", "FILE.py:NAME of your own law is needed")
    spec = importlib.util.spec_from_file_location(Path(path).stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules.setdefault(spec.name, module)  # as its dataclasses look it up
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        lines = [f.lineno for f in traceback.extract_tb(error.__traceback__) if f.filename == path]
        problem = f"{type(error).__name__}: {' '.join(str(error).split())}"
        raise InputError(path, [None, *lines][-1], problem, "it must run") from None
    names = [n for n, x in vars(module).items() if getattr(x, "__module__", "") == spec.name]
    if name not in names:
        accepted = f"one of {listed(names) or 'a class of a contact law'}"
        raise InputError(path, None, f"no {name!r}", f"{accepted}{did_you_mean(name, names)}")
    return getattr(module, name)


def add_law_option(add: Callable[..., Any], default: str) -> None:
    """`--law` of a command: a built-in law, or one of the user's own."""
    text = f"default: {default}; {OWN_LAW}"
    add("--law", type=partial(_parsed, "law"), metavar=f"{{{','.join(LAWS)}}}", help=text)


def _parsed(name: str, text: str) -> Any:
    """A setting from the command line."""
    if name == "law" and ".py:" in text:
        try:
            return law_of_file(text)
        except InputError as error:
            raise argparse.ArgumentTypeError(str(error)) from None
    field = FitOptions.model_fields[name]
    adapter = TypeAdapter(Annotated[(field.annotation, Field(), *field.metadata)])  # type: ignore[arg-type]
    try:
        value = adapter.validate_python(text, strict=False)
        return text if value is None else value  # "none": None is left out
    except ValidationError as error:
        words = _words(name)
        known = f"one of {listed(words)}" if words else next(faults(error, FitOptions)).accepted
        problem = f"{shown(repr(text))} is not {known}{did_you_mean(text, words)}"
        raise argparse.ArgumentTypeError(problem) from None
