"""Named reasons not to trust a fit, each with its cause and what to do about it.

A new one is an entry of `ADVICE`, a function that looks for it, called in `warnings_of`, and a section of the
reference's symptoms. The functions below return the cause in words, or None.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
from jaxtyping import Float
from scipy import special

import softjax as sj
from calibration.data import RestitutionData
from calibration.fitting.noise import Normal

COLLINEAR = 0.99  # correlation from which on two parameters count as one number
SEPARATE = 1.0  # standard error of ln σ from which on σ and ψ count as one number
SEVERAL_DELTA = 4.0  # Δχ² below which another minimum is nearly as good
CONFIDENCE = 0.99  # of the tests on residuals
VELOCITY_ERRORS = 0.15  # of a velocity, up to which intervals were seen to be right
NEAR_YIELD = 2.0  # standard uncertainties of a velocity around the kink at first yield
APART = 2.0  # standard errors between the two objectives
FEWEST_GROUPS = 4  # of which one may be far from the others
FAR_FROM_STATED = 3.0  # times a stated uncertainty
LINE_ROUNDS = 50  # of a straight line and the weights of its points in turn
FROM_PRIOR = 3.0  # of its standard deviations, beyond which an estimate contradicts a prior
OUTSIDE = 1e-3  # of a velocity: less beyond the data's is no extrapolation, as ends are rounded
OTHER_LAWS = "`softjax compare` tries other laws"
MORE = "Sample longer: more `draws`, and as many of `warmup`."
ADVICE = {
    "at-bound": "Widen the bound if it was given, or fix the parameter there; its interval is one-sided.",
    "rank-deficient": "Fix one of the parameters, give it a prior, or measure where it acts.",
    "prior-conflict": (
        "Check the prior's value and unit, the outliers and the law: the estimate is a compromise between "
        "the prior and points that contradict it."
    ),
    "sigma-psi-not-separate": (
        "Use eps_up, which is determined; or measure below the critical velocity, or more precisely."
    ),
    "skewed": "Use the interval, or the posterior: no standard error describes both sides.",
    "collinear": (
        "Report what is determined; or fix one of them, give it a prior, or measure where they differ."
    ),
    "not-converged": "Use more starts or steps, or another optimiser; do not use the values.",
    "several-minima": "Give bounds or a prior that decide, or measure where the curves differ.",
    "model-misfit": (
        f"The misfit exceeds the noise: these intervals are too narrow. Check the law ({OTHER_LAWS}), or "
        "estimate by `extra_scatter` what the stated uncertainties lack (an option, also under [fit])."
    ),
    "stated-uncertainty": (
        f"Check the stated uncertainties (unit, rounding, what they include) and the law ({OTHER_LAWS}). "
        "An estimated scatter takes either fault as noise."
    ),
    "residual-runs": (
        f"The law misses a trend ({OTHER_LAWS}), or points belong together "
        "(name them in a `group` column); intervals are too narrow."
    ),
    "unequal-scatter": "State each point's own uncertainty; intervals take errors to be as stated, else equal.",
    "offset": (
        "Check its bodies, instrument and unit: a scatter that is estimated takes a wrong level as noise. "
        "Leave it out, or give it parameters of its own."
    ),
    "groups": "Say which points belong together (specimen, launch, day) in a `group` column.",
    "plausibility": "Check the unit.",
    "no-velocity-dependence": "Use a constant restitution, or measure over more velocities.",
    "status": "Look at the velocities named and at the law's range; leave them out if need be.",
    "extrapolation": "Measure there before relying on it.",
    "all-below-yield": "Measure above the critical velocity; the unloading factor acts only there.",
    "eps-up-only": "Measure below the critical velocity to separate sigma from psi.",
    "objectives-disagree": (
        "Eq. (17) does not hold over the whole curve, or the law does not: look at both curves; "
        "`model` is the law's own likelihood."
    ),
    "modulus": (
        "Check Young's modulus of the bodies and the unit of the times; name youngs_modulus free, or give it "
        "a prior."
    ),
    "branch-change": "Check the data near the critical velocity; fix the strength or the modulus.",
    "velocity-errors": (
        "Measure velocities to 10 % or better; leave points out that may lie on either side of first yield."
    ),
    "data": "Check the data.",
    # of draws
    "r-hat": f"{MORE} Where it stays, there are several modes: give bounds or a prior that decide.",
    "effective-size": f"{MORE} Limits of intervals are rough until then.",
    "divergences": (
        "A corner is too sharp for the steps and draws miss part of it: give a prior to what the "
        "data do not determine, or fit fewer parameters."
    ),
    "funnel": (
        "Energies are badly explored, as where a spread may be 0: give the spread or the noise a "
        "prior, or measure more data sets."
    ),
    "mass-at-bound": "Widen the bound if it was given; else report that the data do not exclude the bound.",
    "follows-prior": "The data do not determine it: measure where it acts, or state a prior that you can justify.",
}
Column = Float[np.ndarray, "n"]


@dataclass(frozen=True)
class FitWarning:
    """A warning: `code` is its name, `material` the data set it is about (None: all).

    `advice` is what to do about it; of its code where left out.
    """

    __pydantic_config__: ClassVar = {"extra": "ignore"}  # what files hold besides

    code: Literal[tuple(ADVICE)]  # type: ignore[valid-type]
    cause: str
    material: str | None = None
    advice: str = ""

    def __post_init__(self):
        if not self.advice:
            object.__setattr__(self, "advice", ADVICE[self.code])

    def __str__(self) -> str:
        where = "" if self.material is None else f" ({self.material})"
        return f"{self.code}{where}: {self.cause}. {self.advice}"


def is_wide(profile: Any) -> bool:
    """An interval open on a side, or as wide as 4 standard errors of `SEPARATE` log units."""
    if profile.low is None or profile.high is None or profile.low <= 0:
        return True
    return bool(np.log(profile.high / profile.low) > 4 * SEPARATE)


def misfit(reduced: float | None, degrees: float, of_noise: float | None = None) -> str | None:
    """χ² of the residuals larger than noise makes it once in a hundred.

    Args:
        of_noise: degrees of freedom of the noise itself, None where it is stated.
    """
    if reduced is None or degrees < 1 or not np.isfinite(reduced):
        return None
    limit = special.chdtri(degrees, 1 - CONFIDENCE) / degrees
    if of_noise is not None:
        limit = special.fdtri(degrees, of_noise, CONFIDENCE)
    if reduced <= limit:
        return None
    # of points that count unequally rms and noise are no measure of it
    return f"residuals of {reduced**0.5:.3g} times the noise (reduced chi squared {reduced:.3g})"


def far_from_stated(
    standardised: Column, variances: Mapping[str, float], scale: float | None, noise: Normal
) -> str | None:
    """Residuals far larger than the stated uncertainties, or far smaller: by what is estimated, or their median.

    Args:
        scale: estimated factor of the stated variances, None without.
    """
    stated, n = variances.get("stated", variances.get("repeats", 0.0)), len(standardised)
    size, middle = float(np.median(np.abs(standardised))), special.ndtri(0.75)
    if np.isfinite(noise.dof):  # standardised ones are weighted
        size /= max((noise.dof + 1 - size**2) / noise.dof, 1e-4) ** 0.5
        middle = special.stdtrit(noise.dof, 0.75)
    ratio = size / middle
    if scale is not None:
        ratio = scale**0.5
    elif stated <= 0:
        return None
    elif variances.get("scatter"):
        ratio = (1 + variances["scatter"] / stated) ** 0.5
    if ratio > FAR_FROM_STATED or (n >= 10 and ratio < 1 / FAR_FROM_STATED):
        return f"the points scatter by {ratio:.2g} times what was stated"
    return None


def misfit_against_scatter(n: int, rms: float, left: float, about_eq_17: float) -> str | None:
    """Misfit where the noise is estimated from the scatter about Eq. (17): an F test.

    Scatter at rounding level is no noise estimate, but then a larger rms is a misfit all the same.
    """
    degrees, of_noise = max(left, 1), max(n - 2, 1)
    rms, scatter = rms * np.sqrt(n / degrees), about_eq_17 * np.sqrt(n / of_noise)
    ratio = (rms / max(scatter, 1e-16)) ** 2
    if ratio <= special.fdtri(degrees, of_noise, CONFIDENCE) or rms < 1e-9:
        return None
    return f"rms {rms:.3g} where the scatter about Eq. (17) is {scatter:.3g}"


def disagreement(what: str, model: Any, two_step: Any) -> str | None:
    """Two estimates of one number apart by more than their errors."""
    pairs = [(e.value, e.standard_error) for e in (model, two_step) if e is not None]
    if len(pairs) < 2 or None in pairs[0] or None in pairs[1]:
        return None
    (first, error_1), (second, error_2) = pairs
    if not abs(first - second) > APART * np.hypot(error_1, error_2):
        return None
    return f"{what} is {first:.4g} ± {error_1:.2g} by `model`, {second:.4g} ± {error_2:.2g} by `two-step`"


def runs(velocity: Column, residual: Column) -> str | None:
    """Wald and Wolfowitz: fewer changes of sign along the velocity than chance makes."""
    if np.max(np.abs(residual), initial=0.0) < 1e-12:
        return None  # rounding
    sign = residual[np.argsort(velocity, kind="stable")] > 0
    n, plus = len(sign), int(np.sum(sign))
    if n < 10:
        return None
    if plus in (0, n):
        return f"all {n} residuals have one sign"
    count = 1 + int(np.sum(sign[1:] != sign[:-1]))
    mean = 1 + 2 * plus * (n - plus) / n
    variance = (mean - 1) * (mean - 2) / (n - 1)
    if (count - mean) / np.sqrt(max(variance, 1e-12)) >= special.ndtri(1 - CONFIDENCE):
        return None
    return f"{count} runs of one sign in {n} residuals where {mean:.0f} are expected"


def unequal_scatter(velocity: Column, restitution: Column, standardised: Column) -> str | None:
    """The size of the residuals goes with the velocity, or with ε: Spearman's rank correlation."""
    size = np.abs(standardised)
    if len(size) < 10 or np.ptp(size) < 1e-9:
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
    """Those that are equal share the mean of theirs; `scipy.stats` takes half a second to import."""
    _, place, count = np.unique(values, return_inverse=True, return_counts=True)
    return (np.cumsum(count) - 0.5 * (count - 1))[place]


def alike_neighbours(velocity: Column, standardised: Column) -> str | None:
    """Residuals of neighbouring rows go together, in a file that is not in the order of velocity."""
    n, steps = len(standardised), np.diff(velocity)
    squares = float(np.sum(standardised**2))
    if n < 10 or np.all(steps >= 0) or np.all(steps <= 0) or squares < 1e-18:
        return None
    correlation = float(np.sum(standardised[1:] * standardised[:-1])) / squares
    if correlation * np.sqrt(n) < special.ndtri(CONFIDENCE):
        return None
    return f"residuals of neighbouring rows are alike (correlation {correlation:.2f})"


def far_group(offsets: Mapping[str, tuple[float, float]], deviation: float) -> str | None:
    """One of the groups' offsets is farther from the others than of normal ones once in a hundred: Grubbs' test.

    Source: Grubbs, Ann. Math. Stat. 21, 27 (1950).
    """
    standard, m = standard_offsets(offsets, deviation), len(offsets)
    if m < FEWEST_GROUPS or not len(standard):
        return None
    k = int(np.argmax(np.abs(standard - np.mean(standard))))
    others = np.delete(standard, k)
    spread = np.std(others, ddof=1) * np.sqrt(1 + 1 / (m - 1))
    far = abs(standard[k] - np.mean(others)) / max(spread, 1e-300)
    if far <= special.stdtrit(m - 2, 1 - 0.5 * (1 - CONFIDENCE) / m):
        return None
    label, (offset, _) = list(offsets.items())[k]
    return f"group {label} is off by {offset:.2g}, {far:.2g} times the scatter of the other groups"


def standard_offsets(offsets: Mapping[str, tuple[float, float]], deviation: float) -> np.ndarray:
    """Predicted offsets of groups over the standard deviations that they have as predictions; none at τ = 0."""
    if not offsets:
        return np.zeros(0)
    value, error = np.transpose([*offsets.values()])
    spread = deviation**2 - error**2
    return value / np.sqrt(spread) if np.all(spread > 0) else np.zeros(0)


def off_as_a_whole(standardised: Column, off: float) -> str | None:
    """Student's test of the mean of residuals, or of groups' offsets, which a scatter took as noise.

    Args:
        off: mean of what is fitted less what was measured.
    """
    n = len(standardised)
    if n < FEWEST_GROUPS or not np.ptp(standardised) > 0:
        return None
    far = abs(np.mean(standardised)) / np.std(standardised, ddof=1) * np.sqrt(n)
    if far <= special.stdtrit(n - 1, 1 - 0.5 * (1 - CONFIDENCE)):
        return None
    side = "below" if off > 0 else "above"
    return f"its points lie {side} the curve as a whole, by {abs(off):.2g} on the average"


def no_velocity_dependence(
    velocity: Column, restitution: Column, uncertainty: Column | None, noise: Normal
) -> str | None:
    """A straight line's slope is zero within its 95 % interval, by the noise of the fit.

    Scatter that is not stated is estimated about the line, in turn with the weights of the points.
    """
    if np.ptp(velocity) == 0:
        return f"all points have one velocity, {velocity[0]:.4g} m/s"
    left, unit = len(velocity) - 2, 1.0 if uncertainty is None else uncertainty
    design = np.stack([np.ones(len(velocity)), velocity - np.mean(velocity)], 1)
    white, target = design / np.reshape(unit, (-1, 1)), restitution / unit
    weight, scale = np.ones(len(velocity)), 1.0
    for _ in range(1 if type(noise) is Normal else LINE_ROUNDS):
        line = np.linalg.pinv(white * weight[:, None] ** 0.5) @ (target * weight**0.5)
        off = target - white @ line
        if uncertainty is None:
            scale = float(np.sum(weight * off**2) / left) ** 0.5 if left > 0 else np.inf
        weight = noise.weight(off / max(scale, 1e-300))
    error = scale * float(np.linalg.inv(white.T @ white * noise.information)[1, 1]) ** 0.5
    slope, quantile = float(line[1]), float(special.ndtri(0.975))
    if uncertainty is None and left > 0:
        quantile = float(special.stdtrit(left, 0.975))
    if abs(slope) > quantile * error or (error == 0 and abs(slope) * np.ptp(velocity) > 1e-9):
        return None
    return f"the slope of restitution is {slope:.2g} ± {error:.2g} per m/s, 0 within its error"


def velocity_errors(velocity: Column, uncertainty: Any, yields: Any) -> str | None:
    """Errors of velocities that their treatment to second order does not carry.

    Args:
        yields: the velocity of first yield [m/s], where the curve has a kink; NaN without one.
    """
    if uncertainty is None:
        return None
    most = float(np.max(np.asarray(uncertainty) / velocity))
    near = int(np.sum(np.abs(velocity - yields) < NEAR_YIELD * np.asarray(uncertainty)))
    causes = []
    if most > VELOCITY_ERRORS:
        causes.append(f"velocities are uncertain by up to {100 * most:.2g} %")
    if near:
        causes.append(
            f"{near} of {len(velocity)} points are nearer to first yield than {NEAR_YIELD:g} "
            "standard uncertainties of their velocity"
        )
    return "; ".join(causes) or None


def statuses(status: Any, velocity: Column) -> Iterator[str]:
    """Each flag that is raised at data points, other than elastic."""
    for flag in sj.Status:
        at = velocity[(np.asarray(status, int) & int(flag)) != 0]
        if flag in (sj.Status.PLAIN, sj.Status.ELASTIC) or not len(at):
            continue
        span = f"{np.min(at):.3g} to {np.max(at):.3g} m/s" if len(at) > 1 else f"{at[0]:.3g} m/s"
        yield f"{flag.name} at {len(at)} of {len(status)} points ({span})"


def is_outside(velocity: Any, low: float, high: float) -> np.ndarray:
    """Whether velocities lie outside a range by more than rounding."""
    velocity = np.asarray(velocity)
    return (velocity < (1 - OUTSIDE) * low) | (velocity > (1 + OUTSIDE) * high)


def extrapolation(velocity: Any, data: RestitutionData) -> FitWarning | None:
    """Velocities outside the data's, by more than rounding."""
    low, high = float(np.min(data.velocity)), float(np.max(data.velocity))
    count = int(np.sum(is_outside(velocity, low, high)))
    if not count:
        return None
    cause = f"{count} velocities lie outside the data's {low:.3g} to {high:.3g} m/s"
    return FitWarning("extrapolation", cause, data.name)
