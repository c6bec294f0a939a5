"""The fit of one data set: estimates with their uncertainty, its law, how closely the law follows."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal

import jax
import numpy as np
from scipy import special

import softjax as sj
from calibration.data import RestitutionData
from calibration.fitting.laws import LawModel, Tree
from calibration.fitting.noise import FAMILIES, Family
from calibration.fitting.warnings import FitWarning
from calibration.observables import OBSERVABLES, RESTITUTION
from calibration.rounding import NO_ERROR, with_error

HIDDEN = 2.0  # sizes by a robust fit over that by the fit, from which on a scatter hides a point
USUAL_REACH = 2.0  # standard errors from a value to an end of its interval


@dataclass(frozen=True)
class Estimate:
    """One number with its uncertainty; what is undefined, or an open end, is None.

    `method` says where the interval comes from: "profile" (profile likelihood), "wald" (least
    squares), "derived" (carried over), "undetermined", "none" (of no likelihood, or of a law that misses the
    level of groups), or "fixed".

    `skewed`: whether the likelihood is so skewed that the curvature's standard error, which the covariance
    has, describes no interval: there is none here then. None: that was not looked at.

    `statistical_error`: the part of `standard_error` that comes from the points; None where all does.
    """

    value: float | None
    standard_error: float | None = None
    low: float | None = None
    high: float | None = None
    method: str = "fixed"
    free: bool = False
    at_bound: bool = False
    skewed: bool | None = False
    statistical_error: float | None = None

    def __post_init__(self):
        error = self.standard_error
        if self.value and error is not None and error <= NO_ERROR * abs(self.value):  # rounding
            changed = {"standard_error": None, "low": None, "high": None, "skewed": False}
            vars(self).update(changed)

    @property
    def printed_error(self) -> float | None:
        """The standard error where it describes the interval; else None."""
        return None if self.skewed else self.standard_error

    @property
    def rounding_error(self) -> float | None:
        """Size that value and ends are rounded by: the standard error, or of a skewed one the narrower side's part."""
        if self.printed_error is not None or self.value is None:
            return self.printed_error
        sides = [abs(end - self.value) for end in (self.low, self.high) if end is not None]
        sides = [side for side in sides if np.isfinite(side) and side > NO_ERROR * abs(self.value)]
        return min(sides) / USUAL_REACH if sides else None

    def __str__(self) -> str:
        return with_error(self.value, self.standard_error)


@dataclass(frozen=True)
class Band:
    """A fitted curve and its confidence band; all as long as `velocity` [m/s], NaN where the data
    determine nothing.

    `kind` says of what: "mean", the curve itself, or "prediction", one more measurement.
    """

    velocity: np.ndarray
    coefficient: np.ndarray
    low: np.ndarray
    high: np.ndarray
    standard_error: np.ndarray
    kind: str = "mean"


@dataclass(frozen=True)
class Outlier:
    """A point that the noise does not explain.

    Attributes:
        row: of the data set, from 1.
        line: of the file it came from, None where there is none.
        velocity, value: as measured, in SI.
        residual: measured less fitted value, over the standard deviation of that difference: of the
            noise (of Student's t the scale), less what the point itself moves the curve.
        weight: in the fit, over that of a point on the curve.
        observable: what was measured, of `calibration.observables`.
        robust: whether a robust fit (Student's t, its scale estimated) leaves it apart from the others;
            None where none was made.
        robust_residual: of one that is apart, about the curve of the robust fit, over the standard deviation
            of the others.
    """

    row: int
    line: int | None
    velocity: float
    value: float
    residual: float
    weight: float
    observable: str = RESTITUTION
    robust: bool | None = None
    robust_residual: float | None = None

    @property
    def restitution(self) -> float | None:
        """ε; None for another observable."""
        return self.value if self.observable == RESTITUTION else None

    def __str__(self) -> str:
        place = f"row {self.row}" if self.line is None else f"line {self.line}"
        of = OBSERVABLES[self.observable]
        what = f"{of.symbol} = {self.value:.4g}" + ("" if of.unit == "-" else f" {of.unit}")
        point = f"{place}, v = {self.velocity:.4g} m/s, {what}"
        weight = "" if self.weight == 1 else f", weight {self.weight:.2g}"
        text = f"{point}: {self.residual:+.3g} standard deviations{weight}"
        by_robust = self.robust_residual or 0.0
        is_hidden = abs(by_robust) > HIDDEN * abs(self.residual)
        return text + f", {by_robust:+.3g} by a robust fit" * is_hidden


@dataclass(frozen=True)
class Goodness:
    """Goodness of fit for one observable of a data set, and its errors.

    Attributes:
        rms: of fitted less measured values; relative but for ε.
        reduced_chi_squared: with the stated uncertainties; None without.
        variances: mean variance by where it comes from, of one more measurement: "stated",
            "scatter", "group" (of another specimen, launch or day), "timing", "scale", "repeats";
            relative but for ε.
        timing: standard deviation of times that was found [s].
        noise_family: distribution of the errors.
        noise_dof: degrees of freedom of Student's t; None for normal errors.
        outliers: the points beyond what the noise explains, the farthest first.
        standardised: residuals, fitted less measured, over their standard deviations, of each point.
        deviations: standard deviations of the values as the fit has them, of each point; relative but
            for ε.
        weights: in the fit, over that of a point on the curve, of each point; empty where all are 1.
        residuals: fitted less measured values, of each point; relative but for ε.
        residual_degrees: degrees of freedom of the residuals.
        group_offsets: by label of the group its predicted offset and the standard error of that, None
            under `two-step`; the largest first. Empty without groups; relative but for ε.
    """

    rms: float
    reduced_chi_squared: float | None = None
    variances: Mapping[str, float] = field(default_factory=dict)
    timing: float | None = None
    noise_family: Literal[tuple(FAMILIES)] = "normal"  # type: ignore[valid-type]
    noise_dof: float | None = None
    outliers: tuple[Outlier, ...] = ()
    standardised: tuple[float, ...] = field(default=(), repr=False)
    deviations: tuple[float, ...] = field(default=(), repr=False)
    weights: tuple[float, ...] = field(default=(), repr=False)
    residuals: tuple[float, ...] = field(default=(), repr=False)
    residual_degrees: float = 0.0
    group_offsets: Mapping[str, tuple[float, float | None]] = field(default_factory=dict)

    @property
    def family(self) -> Family:
        """The distribution of the errors."""
        kind = FAMILIES[self.noise_family]
        return kind() if self.noise_dof is None else kind(self.noise_dof)

    @property
    def noise(self) -> float | None:
        """The standard deviation of a single value that was estimated; None where it was stated."""
        estimated = [v for k, v in self.variances.items() if k not in ("stated", "group", "scale")]
        return float(np.sqrt(sum(estimated))) if estimated else None


@dataclass(frozen=True, kw_only=True)
class MaterialFit(Goodness):
    """The fit of one data set; as a `Goodness` that of ε, with the outliers of all observables.

    Attributes:
        data: the measurements.
        objective: "model" or "two-step".
        model: its law, as a fit sees it.
        parameters: estimates by name, the fixed ones too; a whole parameter has none.
        derived: numbers that follow from them, of Zhou's law eps_up and critical_velocity [m/s]; of
            bodies that differ from impact to impact the highest v_cr (`law.contact` has each), no ε_up.
        values: all parameters that make the law, physical, the numbers of whole ones too.
        labels: what the covariance calls those that were free.
        rms_empirical: of Eq. (17); None for other laws than Zhou's.
        empirical: limit_velocity, sigma and psi of Eq. (17) against all points; None as well.
        converged: whether the searches arrived.
        status: `softjax.Status` at each point.
        known_from, known_to: velocities between which the fit knows anything of the curve [m/s], of
            all bodies where they differ.
        observed: how the curve follows what else than ε was measured, by name.
        warnings: those about this data set.
    """

    data: RestitutionData
    objective: str
    model: LawModel
    parameters: dict[str, Estimate]
    derived: dict[str, Estimate]
    values: Mapping[str, Any]
    labels: Mapping[str, str]
    rms_empirical: float | None
    empirical: Mapping[str, float] | None
    converged: bool
    status: tuple[int, ...]
    known_from: float = 0.0
    known_to: float = np.inf
    observed: Mapping[str, Goodness] = field(default_factory=dict)
    warnings: tuple[FitWarning, ...] = field(default=())

    @property
    def name(self) -> str:
        return self.data.name

    @property
    def trees(self) -> tuple[Tree, ...]:
        """Structures of the parameters that are pytrees."""
        return self.model.trees

    @property
    def n(self) -> int:
        return len(self.data)

    @property
    def measured(self) -> list[str]:
        """The observables that were measured."""
        has_own = bool(np.any(np.isfinite(self.data.restitution)))
        return [*[RESTITUTION] * has_own, *self.observed]

    def goodness(self, observable: str) -> Goodness | None:
        """How the curve follows one observable; None for one that was not measured and is not ε."""
        return self if observable == RESTITUTION else self.observed.get(observable)

    @property
    def free(self) -> dict[str, str]:
        """Free parameters, in the order of `values`, and their labels in the covariance."""
        return {name: self.labels[name] for name in self.values if name in self.labels}

    @property
    def group_deviation(self) -> float | None:
        """The standard deviation of the groups' offsets in ε; None without groups."""
        return float(np.sqrt(self.variances["group"])) if "group" in self.variances else None

    @property
    def probability(self) -> float | None:
        """Probability of a χ² at least as large, if the law and the stated uncertainties are right."""
        if self.reduced_chi_squared is None:
            return None
        dof = self.residual_degrees
        return float(special.chdtrc(dof, dof * self.reduced_chi_squared))

    @cached_property
    def law(self) -> sj.ContactLaw:
        """The fitted law.

        Where ε_up was fitted in place of σ and ψ, ψ is a guess from the data and σ such that
        Eq. (17) gives ε_up at v_cr: above yield the law is the fitted one, below it is not known.
        """
        with jax.enable_x64(True), jax.ensure_compile_time_eval():  # within a trace too
            law = self.model.law(self.data.contact, self.model.inside(self.values))
            return jax.tree.map(_plain, law)

    @property
    def contact(self) -> sj.Contact | None:
        """The two bodies with what was fitted of them; None for a law without them."""
        return getattr(self.law, "contact", None)

    def determined(self, velocity: Any) -> np.ndarray:
        """Whether the data determine ε at these velocities [m/s]."""
        velocity = np.asarray(velocity, float)
        return (velocity >= self.known_from) & (velocity <= self.known_to)


def _plain(leaf: Any) -> Any:
    """Single numbers as Python floats, arrays as NumPy's."""
    if not hasattr(leaf, "dtype"):
        return leaf
    array = np.asarray(leaf)
    return float(array) if array.ndim == 0 and array.dtype.kind == "f" else array
