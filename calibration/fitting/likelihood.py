"""ln L of a fit at its maximum, and the criteria made of it."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from calibration.fitting.component_fit import ComponentFit
from calibration.fitting.noise import needs_variances, renewed
from calibration.fitting.stages import settle
from calibration.options import FitOptions

ROUNDING = 1e-10  # rms of ε below which there is no noise to speak of


@dataclass(frozen=True)
class Likelihood:
    """ln L at its maximum, and what Akaike's and Schwarz's criteria take of it.

    Attributes:
        log: ln L, parameters and unknown variances where it is largest.
        fitted: how many numbers were fitted, those variances among them.
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


def likelihood_of(fits: list[ComponentFit], options: FitOptions) -> Likelihood | None:
    """Of all components; None where what was minimised is none, or the data have no noise.

    None where parameters are pooled, too: how many numbers were fitted is then no whole number.
    """
    log, fitted, points = 0.0, 0, 0
    for fit in fits:
        if not fit.is_likelihood or fit.final.problem.pools:
            return None
        problem, found = fit.final.problem, fit.final.found
        if needs_variances(problem) and found.converged[0]:
            found, problem, _ = settle(problem, found, options, restricted=False)
        else:
            problem = renewed(problem, fit.z, restricted=False)
        unknown = sum(len(one.unknown) for one in problem.errors)
        if unknown and np.min(problem.diagonal(found.z)) <= ROUNDING**2:
            return None
        log -= 0.5 * float(problem.deviance(found.z)[0])
        fitted, points = fitted + len(fit.z) + unknown, points + problem.count
    return Likelihood(log, fitted, points)
