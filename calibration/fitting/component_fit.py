"""All stages of one component: fitted in their order, and how well that is known."""

from dataclasses import dataclass, replace

import numpy as np

from calibration.fitting.assembly import Component
from calibration.fitting.noise import stands_alone
from calibration.fitting.problem import Problem
from calibration.fitting.stages import StageFit, run_stage
from calibration.fitting.uncertainty import Settled, Uncertainty, stacked
from calibration.options import FitOptions


@dataclass(frozen=True)
class ComponentFit:
    """A fitted component.

    Attributes:
        component: what was asked.
        stages: where each stage ended.
        z: of all elements.
        uncertainty: of z; of one fit.
    """

    component: Component
    stages: tuple[StageFit, ...]
    z: np.ndarray
    uncertainty: Uncertainty

    @property
    def final(self) -> StageFit:
        """The stage whose law is the result's."""
        return self.stages[-1]

    @property
    def theta(self) -> np.ndarray:
        """The elements in physical units; those at an end of their range that is a bound, there."""
        transform = self.final.problem.transform
        theta, limits = transform.physical(self.z), self.uncertainty.limits[0]
        bound = transform.bound_beyond(limits)
        return np.where((limits != 0) & np.isfinite(bound), bound, theta)

    @property
    def begun(self) -> np.ndarray:
        """Where elements that are held at an end of their range came from; NaN for the others.

        A search from here then knows them for what they are.
        """
        return np.where(self.uncertainty.limits[0] != 0, self.component.start, np.nan)

    @property
    def is_likelihood(self) -> bool:
        """Whether what was minimised is a likelihood: one stage."""
        return len(self.stages) == 1

    @property
    def converged(self) -> bool:
        return all(bool(stage.found.converged[0]) for stage in self.stages)


def fit_component(component: Component, options: FitOptions) -> ComponentFit:
    """Run the stages, each from where the one before it ended."""
    z = component.start
    fits: list[StageFit] = []
    for name, problem in component.stages:
        if not fits:
            fits.append(run_stage(name, problem, z, options))
        else:
            fits.append(run_stage(name, _after(fits[0], problem), z, options, weigh=False))
        z = fits[-1].z
    settled = [Settled(stage.problem, stage.found.limits) for stage in fits]
    return ComponentFit(component, tuple(fits), z, stacked(settled, z[None]))


def _after(first: StageFit, problem: Problem) -> Problem:
    """A later stage's problem: each point weighs by its own variance, as the first stage found it.

    The law's misfit, which the first stage has none of, would enter whitened residuals with the sizes
    of what points share.
    """
    told = first.problem
    if all(stands_alone(told, g) for g in range(len(told.errors))):
        return replace(problem, errors=(), variances=())  # all points weigh alike
    weight = told.diagonal(first.z[None])[0] ** -0.5
    points = problem.points._replace(weight=weight)
    return replace(problem, points=points, errors=(), variances=())
