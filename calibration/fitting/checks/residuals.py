"""Whether noise explains how far the points are from the curve: its size, its trend, its evenness."""

import numpy as np
from scipy import special

from calibration.fitting.errors import Errors
from calibration.fitting.material import Goodness, MaterialFit
from calibration.fitting.warnings import CONFIDENCE, OTHER_LAWS, Column, Found, runs
from calibration.rounding import number

FEWEST_POINTS = 10  # that show a trend
FAR_FROM_STATED = 3.0  # times a stated uncertainty
NOISELESS = 1e-9  # rms of ε about Eq. (17) below which data are a curve and no measurement
MISSES = f"The law misses a trend ({OTHER_LAWS})."
CURVE = f"The data are a curve without noise: the law misses it ({OTHER_LAWS})."
LAW_OR_GROUPS = (
    f"The law misses a trend ({OTHER_LAWS}), or other points belong together than those of the "
    "groups."
)


def of_residuals(part: MaterialFit, goodness: Goodness, errors: Errors, standardised) -> Found:
    """Whether noise explains how far the points of an observable are from the curve."""
    misfit, of_curve, has_intervals = None, False, part.objective == "model"
    advice = (LAW_OR_GROUPS if errors.shares else "") if has_intervals else MISSES
    if errors.is_stated:
        misfit = _misfit(goodness, errors.degrees)
    elif not has_intervals and part.rms_empirical is not None:
        misfit = _misfit_about_eq_17(part, part.rms_empirical)
        of_curve = part.rms_empirical < NOISELESS
    far = None if misfit else _far_from_stated(goodness, errors)
    if errors.is_stated and not far:
        misfit = misfit or _misfit_of_family(goodness, errors.degrees)
    yield "model-misfit", misfit, CURVE if of_curve else "" if has_intervals else MISSES
    yield "stated-uncertainty", far
    if not of_curve:
        yield "residual-runs", runs(errors.velocity, standardised), advice


def _misfit(goodness: Goodness, of_noise: float | None) -> str | None:
    """χ² of the residuals larger than noise makes it once in a hundred.

    Args:
        of_noise: degrees of freedom of the noise itself, None where it is stated.
    """
    reduced, degrees = goodness.reduced_chi_squared, goodness.residual_degrees
    if reduced is None or degrees < 1 or not np.isfinite(reduced):
        return None
    limit = special.chdtri(degrees, 1 - CONFIDENCE) / degrees
    if of_noise is not None:
        limit = special.fdtri(degrees, of_noise, CONFIDENCE)
    if reduced <= limit:
        return None
    # of points that count unequally rms and noise are no measure of it
    size = f"residuals of {number(reduced**0.5, 3)} times the noise"
    return f"{size} (reduced chi squared {number(reduced, 3)})"


def _misfit_of_family(goodness: Goodness, of_noise: float | None) -> str | None:
    """Misfit by errors that have no χ²: by the normal numbers that are as rare as the residuals.

    An outlier counts as much as one at the limit: heavy tails are there to bear a few, however far.
    """
    family, degrees = goodness.family, goodness.residual_degrees
    if family.is_least_squares or degrees < 1:
        return None
    # each has the variance 1: as many degrees of freedom as the fit leaves
    white = np.array(goodness.standardised)
    limit = family.farthest(len(white))
    reduced = float(np.mean(family.normal_of(np.clip(white, -limit, limit)) ** 2))
    probability = float(special.chdtrc(degrees, reduced * degrees))
    if of_noise is not None:
        probability = float(special.fdtrc(degrees, of_noise, reduced))
    if not probability < 1 - CONFIDENCE:
        return None
    size = "less than 1e-12" if probability < 1e-12 else f"{probability:.1g}"
    return f"{family.words} as stated give residuals as large with a probability of {size}"


def _misfit_about_eq_17(part: MaterialFit, about_eq_17: float) -> str | None:
    """Misfit where the noise is estimated from the scatter about Eq. (17): an F test.

    Scatter at rounding level is no noise estimate, but then a larger rms is a misfit all the same.
    """
    degrees, of_noise = max(part.residual_degrees, 1), max(part.n - 2, 1)
    ratio = (part.rms / max(about_eq_17, 1e-16)) ** 2 * of_noise / degrees
    if ratio <= special.fdtri(degrees, of_noise, CONFIDENCE) or part.rms < NOISELESS:
        return None
    exact = about_eq_17 < NOISELESS
    of_eq_17 = (
        "the data follow Eq. (17) exactly" if exact else f"that of Eq. (17) is {about_eq_17:.3g}"
    )
    return f"rms {part.rms:.4g} where {of_eq_17}"


def _far_from_stated(goodness: Goodness, errors: Errors) -> str | None:
    """Residuals far larger than the stated uncertainties, or far smaller: by what is estimated, or their median."""
    if errors.points.uncertainty is None:  # only an error of the velocity is
        return None
    variances, size = goodness.variances, np.abs(goodness.standardised)
    stated = variances.get("stated", variances.get("repeats", 0.0))
    if "scale" in errors.unknown:
        of_stated = float(np.mean(errors.points.uncertainty**2))
        ratio = (goodness.reduced_chi_squared or variances.get("scale", 0.0) / of_stated) ** 0.5
    elif stated <= 0 or errors.points.measured_by.is_precise:
        return None
    elif variances.get("scatter"):
        ratio = (1 + variances["scatter"] / stated) ** 0.5
    else:
        ratio = float(np.median(size) / goodness.family.quantile(0.75))
    few = len(size) < FEWEST_POINTS
    if ratio > FAR_FROM_STATED or (ratio < 1 / FAR_FROM_STATED and not few):
        return f"the points scatter by {ratio:.2g} times what was stated"
    return None


def unequal_scatter(velocity: Column, restitution: Column, standardised: Column) -> str | None:
    """The size of the residuals goes with the velocity, or with ε: Spearman's rank correlation."""
    size = np.abs(standardised)
    if len(size) < FEWEST_POINTS or np.ptp(size) < 1e-9:
        return None
    for name, values in (("velocity", velocity), ("restitution", restitution)):
        if np.ptp(values) == 0:
            continue
        correlation = np.corrcoef(_ranks(values), _ranks(size))[0, 1]
        t = abs(correlation) * np.sqrt((len(size) - 2) / max(1 - correlation**2, 1e-300))
        if special.stdtr(len(size) - 2, -t) < 0.25 * (1 - CONFIDENCE):  # of two that are looked at
            verb = "grow" if correlation > 0 else "shrink"
            return f"the residuals {verb} with the {name} (rank correlation {correlation:.2f})"
    return None


def _ranks(values: Column) -> Column:
    """Ranks of values; equal values share the mean of theirs; `scipy.stats` takes half a second to import."""
    _, place, count = np.unique(values, return_inverse=True, return_counts=True)
    return (np.cumsum(count) - 0.5 * (count - 1))[place]


def alike_neighbours(velocity: Column, standardised: Column) -> str | None:
    """Residuals of neighbouring rows go together, in a file that is not in the order of velocity."""
    n, steps = len(standardised), np.diff(velocity)
    squares = float(np.sum(standardised**2))
    if n < FEWEST_POINTS or np.all(steps >= 0) or np.all(steps <= 0) or squares < 1e-18:
        return None
    correlation = float(np.sum(standardised[1:] * standardised[:-1])) / squares
    if correlation * np.sqrt(n) < special.ndtri(CONFIDENCE):
        return None
    return f"residuals of neighbouring rows are alike (correlation {correlation:.2f})"
