"""What was asked of a fit: everything that is needed to make it again."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import softjax as sj
from calibration.data import RestitutionData
from calibration.errors import DataError
from calibration.fitting.collisions import ROUTES, Route
from calibration.fitting.errors import Errors
from calibration.fitting.layout import Component, SetSpec, assemble, said_of, specs_of
from calibration.fitting.stages import ComponentFit, fit_component
from calibration.options import FitOptions

# ε to 1e-11, compiled in half of dopri8's time
DEFAULT_ODE = sj.ODE(steps=16, solver="dopri5")
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Request:
    """A fit that was asked for.

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
        """The same with some other options."""
        return replace(self, options=self.options.model_copy(update=changed))

    def tell(self, stage: str, done: int, total: int) -> None:
        if self.progress is not None:
            self.progress(stage, done, total)

    def specs(self) -> list[SetSpec]:
        """The law and parameters of each data set."""
        options = self.options
        said = [{**own, **options.law_options} for own in said_of(self.parameters, self.datasets)]
        specs = specs_of(self.datasets, options.law, said, options.objective)
        told: dict[str, Any] = {
            "extra_scatter": options.extra_scatter,
            "scale_uncertainty": options.scale_uncertainty,
            "dof": options.noise_dof if options.noise == "student-t" else None,
        }
        return [replace(spec, **told) for spec in specs]

    def components(self) -> list[Component]:
        """The problems behind it."""
        specs = self.specs()
        return assemble(specs, self.chosen_route(specs))

    def chosen_route(self, specs: list[SetSpec]) -> Route:
        """The route asked for; else time integration for the paper's procedure, or what suits the law."""
        if self.route is not None:
            return self.route
        return DEFAULT_ODE if any(spec.objective == "two-step" for spec in specs) else None

    def route_of_curve(self, law: type) -> Route:
        """From a fitted law to its curve: the energy balance, or the route that its fit went."""
        return self.route if issubclass(law, sj.RateDependentLaw) else None

    def fitted(self) -> list[ComponentFit]:
        """All components, one after the other."""
        return [fit_component(component, self.options) for component in self.components()]


def checked(request: Request) -> Request:
    """The same request, if its options go with the data.

    Raises:
        ValueError: naming the argument, its value and what is accepted.
    """
    if request.progress is not None and not callable(request.progress):
        raise DataError(
            "progress", request.progress, "True, or called as progress(stage, done, total)"
        )
    if request.options.noise == "student-t":
        for data in request.datasets:
            if Errors.of(data).shares:
                accepted = '"normal" where points share errors (groups, bounce trains)'
                raise DataError("noise", "student-t", accepted)
    return request


def datasets_of(data: Any) -> tuple[RestitutionData, ...]:
    """One data set, or several, as a tuple."""
    several = not isinstance(data, RestitutionData | Mapping | str | np.ndarray)
    datasets = tuple(data) if several and hasattr(data, "__iter__") else (data,)
    if not datasets or not all(isinstance(one, RestitutionData) for one in datasets):
        raise DataError("data", data, "RestitutionData or a list of them")
    return datasets
