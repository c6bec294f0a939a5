"""What was asked of a fit: everything that is needed to make it again."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import softjax as sj
from calibration.data import RestitutionData
from calibration.data.checks import as_number, check_whole, checked_confidence
from calibration.errors import DataError
from calibration.fitting.assembly import Component, assemble
from calibration.fitting.component_fit import ComponentFit, fit_component
from calibration.fitting.losses import LOSSES
from calibration.fitting.methods import OPTIMISERS
from calibration.fitting.plan import plan_of
from calibration.fitting.specs import SetSpec, specs_of
from calibration.fitting.stages import Options

# ε to 1e-11, compiled in half of dopri8's time
DEFAULT_ODE = sj.ODE(steps=16, solver="dopri5")
LINES = ("curves", "weighted", None)
FLAGS = ("profiles", "extra_scatter", "scale_uncertainty")


@dataclass(frozen=True)
class Request:
    """A fit that was asked for.

    Attributes:
        datasets: the measurements.
        law: None, a name, a class, or a function that builds one.
        parameters: what was said of them.
        objective: "model", "two-step" or None.
        route: from the law to ε; None: what suits the law.
        options: how to search.
        confidence: of all intervals.
        profiles: whether likelihoods are profiled.
        unloading_line: how Eq. (18) is fitted, or None.
        extra_scatter, scale_uncertainty: what stated uncertainties leave open.
    """

    datasets: tuple[RestitutionData, ...]
    law: Any = None
    parameters: Any = None
    objective: str | None = None
    route: sj.EnergyBalance | sj.ClosedForm | sj.ODE | None = None
    options: Options = Options()
    confidence: float = 0.95
    profiles: bool = True
    unloading_line: str | None = "curves"
    extra_scatter: bool = False
    scale_uncertainty: bool = False

    def specs(self) -> list[SetSpec]:
        """The law and parameters of each data set."""
        specs = specs_of(self.datasets, self.law, self.parameters, self.objective)
        open_ = (self.extra_scatter, self.scale_uncertainty)
        return [replace(s, extra_scatter=open_[0], scale_uncertainty=open_[1]) for s in specs]

    def components(self) -> list[Component]:
        """The problems behind it."""
        specs = self.specs()
        return assemble(specs, self.chosen_route(specs))

    def chosen_route(
        self, specs: list[SetSpec]
    ) -> sj.EnergyBalance | sj.ClosedForm | sj.ODE | None:
        """The route asked for; else time integration for the paper's procedure, or what suits the law."""
        if self.route is not None:
            return self.route
        return DEFAULT_ODE if any(spec.objective == "two-step" for spec in specs) else None

    def route_of_curve(self, law: type) -> sj.EnergyBalance | sj.ClosedForm | sj.ODE | None:
        """From a fitted law to its curve: the energy balance, or the route that its fit went."""
        return self.route if issubclass(law, sj.RateDependentLaw) else None

    def fitted(self) -> list[ComponentFit]:
        """All components, one after the other."""
        return [fit_component(component, self.options) for component in self.components()]


def checked(request: Request) -> Request:
    """The same request, its numbers plain ones.

    Raises:
        ValueError: naming the argument, its value and what is accepted.
    """
    options, route = request.options, request.route
    if route is not None and not isinstance(route, sj.EnergyBalance | sj.ClosedForm | sj.ODE):
        raise DataError(
            "route", route, "softjax.EnergyBalance(), softjax.ClosedForm() or softjax.ODE(...)"
        )
    _check_choice("optimiser", options.optimiser, tuple(OPTIMISERS))
    _check_choice("loss", options.loss, LOSSES)
    _check_choice("unloading_line", request.unloading_line, LINES)
    for name, least in (("starts", 1), ("seed", 0), ("max_steps", 1)):
        check_whole(name, getattr(options, name), least)
    scale = as_number("loss_scale", options.loss_scale, lambda x: x > 0, "positive")
    level = checked_confidence(request.confidence)
    flags: dict[str, Any] = {name: as_flag(name, getattr(request, name)) for name in FLAGS}
    if options.progress is not None and not callable(options.progress):
        raise DataError("progress", options.progress, "called as progress(stage, done, total)")
    if flags["extra_scatter"] and flags["scale_uncertainty"]:
        raise DataError("scale_uncertainty", True, "left out beside extra_scatter")
    if options.loss != "squared":
        for data in request.datasets:
            if plan_of(data, False, False).shares:
                accepted = "'squared' where points share errors (groups, bounce trains)"
                raise DataError("loss", options.loss, accepted)
    options = replace(options, loss_scale=scale)
    return replace(request, options=options, confidence=level, **flags)


def _check_choice(name: str, value: Any, choices: tuple[Any, ...]) -> None:
    if not (value is None or isinstance(value, str)) or value not in choices:
        raise DataError(name, value, " or ".join(repr(choice) for choice in choices))


def as_flag(name: str, value: Any) -> bool:
    """A truth value, raises DataError for anything else."""
    if not isinstance(value, bool | np.bool_):
        raise DataError(name, value, "true or false")
    return bool(value)


def datasets_of(data: Any) -> tuple[RestitutionData, ...]:
    """One data set, or several, as a tuple."""
    several = not isinstance(data, RestitutionData | Mapping | str | np.ndarray)
    datasets = tuple(data) if several and hasattr(data, "__iter__") else (data,)
    if not datasets or not all(isinstance(one, RestitutionData) for one in datasets):
        raise DataError("data", data, "RestitutionData or a list of them")
    return datasets
