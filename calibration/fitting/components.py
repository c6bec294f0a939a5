"""Components: data sets that share parameters, fitted together, stage by stage; and their likelihood.

A component of `model` has one stage, the likelihood of all points; one of `two-step` two, each from where the one
before it ended. Four values of a constant ε: one stage, one parameter, and ln L at its maximum, with the variance
σ² = 0.002/4, is -(4/2)(1 + ln 2πσ²); the two numbers fitted, ε and σ, make AIC = 2·2 - 2 ln L.

>>> import calibration as cal
>>> data = cal.RestitutionData([1.0, 1.0, 1.0, 1.0], [0.84, 0.86, 0.90, 0.88])
>>> request = Request((data,)).with_options(law="constant", starts=1)
>>> (fit,) = fitted(request)
>>> [round(float(x), 4) for x in fit.theta], len(fit.stages)
([0.87], 1)
>>> found = likelihood_of([fit], request.options)
>>> round(found.log, 3), round(-2 * (1 + math.log(2 * math.pi * 0.0005)), 3), round(found.aic, 3)
(9.526, 9.526, -15.052)
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

import softjax as sj
from calibration.fitting.laws import SPRINGS
from calibration.fitting.levels import Offsets, offsets_of
from calibration.fitting.methods import QRFactors, factorise
from calibration.fitting.minima import REFINED, in_order, weighing
from calibration.fitting.problem import Problem
from calibration.fitting.request import Component, Request, assemble
from calibration.fitting.search import (
    Ends,
    guided_search,
)
from calibration.fitting.side_by_side import alike, as_one
from calibration.fitting.stages import StageFit, estimate_variances, run_stage
from calibration.fitting.starts import screened
from calibration.fitting.uncertainty import Uncertainty, uncertainty_of
from calibration.fitting.variance_updates import (
    first_variances,
    is_single_variance,
    needs_variances,
    update_variances,
)
from calibration.options import FitOptions

TOGETHER = 32  # components that begin side by side: of more a batch is no faster
NO_NOISE = 1e-10  # rms of ε below which there is no noise to speak of


@dataclass(frozen=True)
class ComponentFit:
    """A fitted component."""

    component: Component  # the request
    stages: tuple[StageFit, ...]  # where each stage ended
    z: np.ndarray  # of all elements
    uncertainty: Uncertainty  # of z; of one fit

    @property
    def final(self) -> StageFit:
        """The stage whose law is the result's."""
        return self.stages[-1]

    @property
    def theta(self) -> np.ndarray:
        """The elements in physical units; those at an end of their range that is a bound, there."""
        transform = self.final.problem.transform
        theta, bound_side = transform.physical(self.z), self.uncertainty.bound_side
        bound = transform.bound_beyond(bound_side)
        theta = np.where((bound_side != 0) & np.isfinite(bound), bound, theta)
        for g, spec in enumerate(self.component.specs):
            places = self.component.places(g)
            if spec.model.law_type is sj.WaltonBraun and {*SPRINGS} <= {*places}:
                first, second = (places[name] for name in SPRINGS)
                theta[second] = max(theta[first], theta[second])
        return theta

    @property
    def slope(self) -> np.ndarray:
        """dθ/dz."""
        return self.final.problem.transform.slope(self.z)

    @cached_property
    def qr_factors(self) -> QRFactors:
        """The last stage at its end."""
        linear = self.final.problem.linearise(self.z[None])
        return factorise(linear.residual, linear.jacobian)

    @property
    def reference_start(self) -> np.ndarray:
        """Starts of elements that are fixed at an end of their range; NaN for the others.

        A search from here then knows them for what they are.
        """
        return np.where(self.uncertainty.bound_side != 0, self.component.start, np.nan)

    @property
    def is_likelihood(self) -> bool:
        """Whether what was minimised is a likelihood: one stage."""
        return len(self.stages) == 1

    @cached_property
    def offsets(self) -> dict[int, Offsets]:
        """Predicted offsets of groups, by the number of the block."""
        first, final = self.stages[0].problem, self.final.problem
        residual = final.linearise(self.z[None]).prediction[0] - final.points.value
        known = self.uncertainty.of_predictions
        parts = {
            k: offsets_of(first, k, self.z, residual[s], known) for k, s in enumerate(first.spans)
        }
        return {k: part for k, part in parts.items() if part is not None}

    def owner(self, sets: Sequence[int]) -> str | None:
        """Name of the data set that something is about; None for several."""
        return self.component.specs[sets[0]].data.name if len(sets) == 1 else None

    @property
    def has_intervals(self) -> bool:
        """Whether intervals hold: of a likelihood, whose law does not miss the level of groups."""
        levels = (part.missed_level for part in self.offsets.values())
        return self.is_likelihood and all(level is None for level in levels)

    @property
    def converged(self) -> bool:
        return all(bool(stage.ends.converged[0]) for stage in self.stages)


def fitted(request: Request, tell: Callable[..., None] = lambda *_: None) -> list[ComponentFit]:
    """All components; `tell` hears how many are done, of how many."""
    components, fits = assemble(request), dict[int, ComponentFit]()
    for members in alike([component.stages[0][1] for component in components]):
        for k in range(0, len(members), TOGETHER):
            tell(len(fits), len(components))
            some = members[k : k + TOGETHER]
            every = _first_ends([components[i] for i in some], request.options)
            for i, ends in zip(some, every, strict=True):
                tell(len(fits), len(components))
                fits[i] = fit_component(components[i], request.options, ends)
    tell(len(fits), len(components))
    return [fits[i] for i in range(len(components))]


def _first_ends(components: list[Component], options: FitOptions) -> list[list[Ends] | None]:
    """Ends of the searches from each one's first starts, made side by side; None for one alone."""
    if len(components) == 1:
        return [None]
    problems = [
        first_variances(component.stages[0][1], component.start) for component in components
    ]
    starts = [
        screened(problem, component.start, options.starts, options.seed, REFINED)
        for problem, component in zip(problems, components, strict=True)
    ]
    problem, batch = as_one(problems)
    of = np.repeat(np.arange(len(problems)), list(map(len, starts)))
    places, beside, limit = np.concatenate(starts), batch.select(of), options.max_steps
    ends = guided_search(problem, places, options.optimiser, batch=beside, limit=limit)
    for own, count in zip(problems, problem.evaluated, strict=True):
        own.evaluated[0] += count
    return [in_order(ends.select(of == k)) for k in range(len(problems))]


def fit_component(
    component: Component, options: FitOptions, ends: list[Ends] | None = None
) -> ComponentFit:
    """Run the stages, each from where the one before it ended; `ends` as of `run_stage`."""
    z, fits = component.start, list[StageFit]()
    for name, problem in component.stages:
        if fits:
            problem, ends = _after(fits[0], problem), None
        fits.append(run_stage(name, problem, z, options, ends))
        z = fits[-1].z
    ends_of = [(stage.problem, stage.bound_side) for stage in fits]
    return ComponentFit(component, tuple(fits), z, uncertainty_of(ends_of, z))


def _after(first: StageFit, problem: Problem) -> Problem:
    """A later stage's problem: each point weighs by its own variance, as the first stage found it.

    The law's misfit, which the first stage has none of, would enter whitened residuals with the sizes
    of what points share.
    """
    of_first = first.problem
    variance = of_first.diagonal(first.z[None])[0]
    if all(is_single_variance(of_first, g) for g in range(len(of_first.errors))):
        variance = np.ones(of_first.count)  # all points weigh alike
    return weighing(problem, [variance[span] for span in of_first.spans])


@dataclass(frozen=True)
class Likelihood:
    """ln L at its maximum, and what follows from it.

    Attributes:
        log: ln L, parameters and unknown variances where it is largest.
        fitted: how many numbers were fitted, those variances among them.
        points: how many points.
        aic, bic: Akaike's and Schwarz's criteria.
    """

    log: float
    fitted: int
    points: int
    aic: float
    bic: float


def likelihood_of(fits: list[ComponentFit], options: FitOptions) -> Likelihood | None:
    """Log-likelihood of all components; None if the objective is no likelihood, or the data have no noise.

    None where parameters are pooled, too: how many numbers were fitted is then no whole number.
    """
    log, fitted, points = 0.0, 0, 0
    for fit in fits:
        if not fit.is_likelihood or fit.final.problem.pools:
            return None
        problem, end = fit.final.problem, fit.final.ends
        if needs_variances(problem) and end.converged[0]:
            problem, end = estimate_variances(problem, end, options, restricted=False)
        else:
            problem = update_variances(problem, fit.z, restricted=False)
        unknown = sum(len(errors.unknown) for errors in problem.errors)
        if unknown and np.min(problem.diagonal(end.z)) <= NO_NOISE**2:
            return None
        log -= 0.5 * float(problem.deviance(end.z)[0])
        fitted, points = fitted + len(fit.z) + unknown, points + problem.count
    aic, bic = 2 * fitted - 2 * log, fitted * math.log(points) - 2 * log
    return Likelihood(log, fitted, points, aic, bic)
