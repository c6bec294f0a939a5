"""The likelihood of a fit's points, and the criteria made of it."""

import math
from dataclasses import dataclass

import numpy as np

from calibration.fitting.component_fit import ComponentFit
from calibration.fitting.noise import seen_by
from calibration.fitting.problem import Problem
from calibration.fitting.variances import criterion, estimated

ROUNDING = 1e-10  # rms of ε below which there is no noise to speak of


@dataclass(frozen=True)
class Likelihood:
    """ln L at the estimate, and what Akaike's and Schwarz's criteria take of it.

    Attributes:
        log: ln L; the noise of data without stated uncertainties at its own maximum.
        fitted: how many numbers were fitted, those noises among them.
        points: how many points.
    """

    log: float
    fitted: int
    points: int

    @property
    def aic(self) -> float:
        return 2 * self.fitted - 2 * self.log

    @property
    def bic(self) -> float:
        return self.fitted * math.log(self.points) - 2 * self.log

    def to_dict(self) -> dict[str, float]:
        """What `fit.json` holds of it."""
        return {**vars(self), "aic": self.aic, "bic": self.bic}


def likelihood_of(fits: list[ComponentFit]) -> Likelihood | None:
    """Of all components; None where what was minimised is none, or the data have no noise.

    None where parameters are pooled, too: how many numbers were fitted is then no whole number.
    """
    log, fitted, points = 0.0, 0, 0
    for fit in fits:
        if not fit.is_likelihood or fit.final.problem.pools:
            return None
        part = _of_component(fit)
        if part is None:
            return None
        log, fitted, points = log + part.log, fitted + part.fitted, points + part.points
    return Likelihood(log, fitted, points)


def _of_component(fit: ComponentFit) -> Likelihood | None:
    problem = fit.final.problem
    if problem.shared is not None:
        return _of_shared(fit, problem)
    residual = problem.predict(fit.z[None])[0] - problem.points.restitution
    log, noises = 0.0, 0
    for g in range(len(problem.datasets)):
        own = problem.points.set == g
        deviation = fit.uncertainty.noise.deviation[0, own]
        squares = (residual[own] / deviation) ** 2
        if not problem.plans[g].stated:
            noises += 1
            # from the estimate with fewer degrees of freedom to the maximum
            deviation = deviation * math.sqrt(float(np.mean(squares)))
            if not np.min(deviation) > ROUNDING:
                return None
            squares = (residual[own] / deviation) ** 2
        log -= 0.5 * float(np.sum(squares + np.log(2 * math.pi * deviation**2)))
    return Likelihood(log, len(fit.z) + noises, problem.count)


def _of_shared(fit: ComponentFit, problem: Problem) -> Likelihood:
    """Where points share errors: with the variances at the maximum."""
    assert problem.shared is not None
    log, noises = 0.0, 0
    parts = zip(problem.shared, problem.plans, seen_by(problem, fit.z), strict=True)
    for errors, plan, seen in parts:
        if plan.unknown:
            largest = estimated(errors, seen, plan.unknown, restricted=False)
            errors = errors.with_variance(largest)
        noises += len(plan.unknown)
        points = len(seen.residual)
        log -= 0.5 * (criterion(errors, seen, restricted=False) + points * math.log(2 * math.pi))
    return Likelihood(log, len(fit.z) + noises, problem.count)
