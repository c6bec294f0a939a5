"""Numbers with their uncertainty: one of them, and a band around a curve."""

from dataclasses import dataclass

import numpy as np

from calibration.rounding import with_error


@dataclass(frozen=True)
class Estimate:
    """One number with its uncertainty; what is undefined, or an open end, is None.

    `method` says where the interval comes from: "profile" (profile likelihood), "sandwich" (stacked
    estimating equations), "wald" (least squares), "derived" (carried over), "undetermined", or
    "fixed".

    `skewed`: whether the likelihood is so skewed that the standard error, though it is the curvature's,
    describes no interval: it is not printed then. None: that was not looked at.
    """

    value: float | None
    standard_error: float | None = None
    low: float | None = None
    high: float | None = None
    method: str = "fixed"
    free: bool = False
    at_bound: bool = False
    skewed: bool | None = False

    @property
    def printed_error(self) -> float | None:
        """The standard error where it describes the interval; else None."""
        return None if self.skewed else self.standard_error

    def __str__(self) -> str:
        return with_error(self.value, self.printed_error)


@dataclass(frozen=True)
class Band:
    """A fitted curve and its confidence band; all as long as `velocity` [m/s], NaN where the fit
    knows nothing.

    `kind` says of what: "mean", the curve itself, or "prediction", one more measurement.
    """

    velocity: np.ndarray
    coefficient: np.ndarray
    low: np.ndarray
    high: np.ndarray
    standard_error: np.ndarray
    kind: str = "mean"
