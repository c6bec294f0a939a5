"""Confidence bands of fitted curves, and of one more measurement."""

import numpy as np
from jaxtyping import Float

from calibration.data.checks import require
from calibration.fitting.collisions import Route
from calibration.fitting.curves import curve_and_slopes, of_labels, propagated
from calibration.fitting.estimate import Band
from calibration.fitting.freedom import Freedom
from calibration.fitting.material import MaterialFit
from calibration.fitting.uncertainty import quantile


def band(
    material: MaterialFit,
    velocity,
    names: tuple[str, ...],
    covariance: Float[np.ndarray, "p p"],
    freedom: Freedom,
    confidence: float,
    kind: str = "mean",
    route: Route = None,
) -> Band:
    """ε(v) with a confidence band; NaN where the fit knows nothing.

    Args:
        names, covariance: of the free parameters, in physical units.
        freedom: how well the covariance is known.
        kind: "mean", of the curve itself, or "prediction", of one more measurement.
        route: from the law to ε; None: what suits the law.
    """
    velocity = np.asarray(velocity, float)
    flat = velocity.ravel()
    require("velocity", flat, lambda v: v >= 0, "a speed of 0 m/s or more")
    value, slope = curve_and_slopes(material, flat, route)
    added = dict(material.variances) if kind == "prediction" else {}
    variance = propagated(slope, of_labels(material, names, covariance)) ** 2 + sum(added.values())
    labels = tuple(material.labels[name] for name in material.values if name in material.labels)
    degrees = freedom.degrees(labels, slope, variance, material.name, added)
    error = np.sqrt(variance)
    reach = quantile(confidence, degrees) * error
    known = material.known(flat)

    def shaped(part: np.ndarray) -> np.ndarray:
        return np.where(known, part, np.nan).reshape(velocity.shape)

    low, high = shaped(value - reach), shaped(value + reach)
    return Band(velocity, shaped(value), low, high, shaped(error), kind)
