"""Named reasons not to trust a fit, each with its cause and what to do about it.

Which warnings belong to what:

- a data set: what its points show, and parameters and searches that are its alone; `material` is its name
- a component (data sets that share parameters): what is shared; no name, and each of its sets has it
- the result: all of these, each once, and those of the fit of Eq. (18); in the order of `ADVICE`

A new one is an entry of `ADVICE`, a function in the room of `checks` of its subject that looks for it, and a
row of the reference's symptoms.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from jaxtyping import Float
from scipy import special

from calibration.data import RestitutionData

CONFIDENCE = 0.99  # of the tests on residuals
OUTSIDE = 1e-3  # of a velocity: less beyond the data's is no extrapolation, as ends are rounded
OTHER_LAWS = "`softjax compare` tries other laws"
MORE = "Sample longer: more `draws`, and as many of `warmup`."
# code: advice; warnings are listed in this order
ADVICE = {
    "plausibility": "Check the unit.",
    "not-converged": "Use more starts or steps, or another optimiser; do not use the values.",
    "level": (
        f"Offsets of groups scatter about 0: this one is the law's misfit, and no interval holds. Check the law "
        f"({OTHER_LAWS}), the bodies and the unit."
    ),
    "model-misfit": (
        f"Check the outliers and the law ({OTHER_LAWS}), or let `extra_scatter` estimate the noise."
    ),
    "residual-runs": (
        f"The law misses a trend ({OTHER_LAWS}), or points belong together "
        "(name them in a `group` column)."
    ),
    "several-minima": "Give bounds or a prior that decide, or measure where the curves differ.",
    "at-bound": "Widen the bound if it was given, or fix the parameter there; its interval is one-sided.",
    "prior-conflict": (
        "Check the prior's value and unit, the outliers and the law: the estimate is a compromise between "
        "the prior and points that contradict it."
    ),
    "rank-deficient": "Fix one of the parameters, give it a prior, or measure where it acts.",
    "skewed": "Use the interval, or the posterior: no standard error describes both sides.",
    "collinear": (
        "Report ε(v) rather than either; or fix one of them, give it a prior, or measure where they differ."
    ),
    "eps-up-only": "Measure below the critical velocity to separate sigma from psi.",
    "sigma-psi-not-separate": (
        "Use eps_up, which is determined; or measure below the critical velocity, or more precisely."
    ),
    "data": "Check the data.",
    "track": "Export the track as it was measured, without smoothing, and mind the lens at the edges of the picture.",
    "stated-uncertainty": (
        f"Check the stated uncertainties (unit, rounding, what they include) and the law ({OTHER_LAWS}). "
        "An estimated scatter takes either fault as noise."
    ),
    "unequal-scatter": "State each point's own uncertainty; intervals take errors to be as stated, else equal.",
    "offset": (
        "Check its bodies, instrument and unit: a scatter that is estimated takes a wrong level as noise. "
        "Leave it out, or give it parameters of its own."
    ),
    "groups": "Say which points belong together (specimen, launch, day) in a `group` column.",
    "no-velocity-dependence": "Use a constant restitution, or measure over more velocities.",
    "velocity-errors": (
        "Measure velocities to 10 % or better; leave points out that may lie on either side of first yield."
    ),
    "status": "Look at the velocities named and at the law's range; leave them out if need be.",
    "all-below-yield": "Measure above the critical velocity; the unloading factor acts only there.",
    "overlap": "Contact laws are for small overlaps: use slower impacts, or larger or stiffer bodies.",
    "yield-jump": (
        "Measure farther from the critical velocity on both sides, or fix what yield depends on: the side "
        "that such a point is on decides where yield is."
    ),
    "extrapolation": "Measure there before relying on it.",
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
# the warnings under which no interval holds, and what the first sentence of a report says then, "" for the cause up
# to its colon
NO_INTERVAL_HOLDS = {
    "not-converged": "the search did not converge",
    "level": "",
    "model-misfit": "the law misses the points by more than their noise",
    "residual-runs": "the law misses a trend in the points",
    "several-minima": "another minimum fits nearly as well",
}
FIRST = ("plausibility", *NO_INTERVAL_HOLDS)  # before these no other warning matters
ORDER = tuple(ADVICE)
Column = Float[np.ndarray, "n"]
# code, cause in words (None: there is none), and advice where that of the code does not fit
Found = Iterable[tuple[str, str | None] | tuple[str, str | None, str]]


@dataclass(frozen=True)
class FitWarning:
    """A warning: `code` is its name, `material` the data set that it is about (None: about several).

    `advice` is what to do about it; of its code where left out.
    """

    code: Literal[tuple(ADVICE)]  # type: ignore[valid-type]
    cause: str
    material: str | None = None
    advice: str = ""

    def __post_init__(self):
        if not self.advice:
            object.__setattr__(self, "advice", ADVICE[self.code])

    @property
    def reason(self) -> str:
        """Why no interval holds, in the first sentence of a report; of codes of `NO_INTERVAL_HOLDS`."""
        return NO_INTERVAL_HOLDS[self.code] or self.cause.partition(":")[0]

    def __str__(self) -> str:
        where = "" if self.material is None else f" ({self.material})"
        return f"{self.code}{where}: {self.cause}. {self.advice}"


def raised(material: str | None, found: Found) -> list[FitWarning]:
    """One warning for each cause."""
    return [FitWarning(code, cause, material, *advice) for code, cause, *advice in found if cause]


def in_order(found: Iterable[FitWarning]) -> tuple[FitWarning, ...]:
    """Each warning once, in the order of `ADVICE`."""
    return tuple(sorted(dict.fromkeys(found), key=lambda warning: ORDER.index(warning.code)))


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
