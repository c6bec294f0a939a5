"""The likelihood of a fit's points, and the criteria made of it."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from calibration.fitting.component_fit import ComponentFit
from calibration.fitting.noise import as_measured, errors_of
from calibration.fitting.plan import ErrorPlan
from calibration.fitting.set_errors import SetErrors
from calibration.fitting.variances import Seen, criterion, estimated

ROUNDING = 1e-10  # rms of ε below which there is no noise to speak of


@dataclass(frozen=True)
class Likelihood:
    """ln L at the estimate, and what Akaike's and Schwarz's criteria take of it.

    Attributes:
        log: ln L; the noise of data without stated uncertainties at its own maximum.
        fitted: how many numbers were fitted, those noises among them.
        points: how many points.
    """

    __pydantic_config__: ClassVar = {"extra": "ignore"}  # what files hold besides

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
    """The Gaussian density at the measured velocities, unknown variances at its maximum."""
    problem = as_measured(fit.final.problem, fit.z)
    off = problem.predict(fit.z[None])[0] - problem.points.restitution
    log, noises = 0.0, 0
    for g, plan in enumerate(problem.plans):
        residual = off[problem.points.set == g]
        seen = Seen(residual, np.zeros((len(residual), 0)), np.zeros((0, 0)), np.zeros(0))
        errors = _largest(errors_of(problem, g), seen, plan)
        if plan.unknown and not np.min(errors.diagonal) > ROUNDING**2:
            return None
        noises += len(plan.unknown)
        log -= 0.5 * criterion(errors, seen, restricted=False)
        log -= 0.5 * len(residual) * math.log(2 * math.pi)
    return Likelihood(log, len(fit.z) + noises, problem.count)


def _largest(errors: SetErrors, seen: Seen, plan: ErrorPlan) -> SetErrors:
    """With the unknown variances that make the likelihood largest."""
    if plan.plain:
        return errors.with_variance({"scatter": float(np.mean(seen.residual**2))})
    if not plan.unknown:
        return errors
    return errors.with_variance(estimated(errors, seen, plan.unknown, restricted=False))
