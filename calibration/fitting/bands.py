"""Confidence bands of fitted curves, and of one more measurement."""

import numpy as np
from jaxtyping import Float

from calibration.data.checks import require
from calibration.fitting.curves import curve_and_slopes, of_labels, propagated
from calibration.fitting.estimate import Band
from calibration.fitting.material import MaterialFit


def band(
    material: MaterialFit,
    velocity,
    names: tuple[str, ...],
    covariance: Float[np.ndarray, "p p"],
    quantile: float,
    kind: str = "mean",
) -> Band:
    """ε(v) with a band of `quantile` standard errors; NaN where the fit knows nothing.

    Args:
        names, covariance: of the free parameters, in physical units.
        kind: "mean", of the curve itself, or "prediction", of one more measurement.
    """
    velocity = np.asarray(velocity, float)
    flat = velocity.ravel()
    require("velocity", flat, lambda v: v >= 0, "a speed of 0 m/s or more")
    value, slope = curve_and_slopes(material, flat)
    error = propagated(slope, of_labels(material, names, covariance))
    if kind == "prediction":
        error = np.hypot(error, typical_noise(material))
    known = material.known(flat)
    parts = (value, value - quantile * error, value + quantile * error, error)
    shaped = (np.where(known, part, np.nan).reshape(velocity.shape) for part in parts)
    return Band(velocity, *shaped, kind)


def typical_noise(material: MaterialFit) -> float:
    """Standard deviation of one more measurement: as estimated, or as stated on the average."""
    if material.noise is not None:
        return material.noise
    return float(np.sqrt(np.mean(np.square(material.data.uncertainty))))
