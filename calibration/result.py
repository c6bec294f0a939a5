"""What a fit found, how well it is known, and what to doubt about it."""

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import softjax as sj
from calibration.data import RestitutionData
from calibration.doubt import Doubt
from calibration.parameters import LINE_COLUMNS
from calibration.profiles import Profile
from calibration.stages import Stage

WITHOUT_NAME = "`name` must be one of {names}, but is {name!r}"


@dataclass(frozen=True)
class Estimate:
    """One number with its uncertainty; what is undefined, or an open end, is None.

    `method` says where the interval comes from: "profile" (profile likelihood), "sandwich" (stacked
    estimating equations), "wald" (least squares), or "fixed".
    """

    value: float | None
    standard_error: float | None = None
    low: float | None = None
    high: float | None = None
    method: str = "fixed"
    free: bool = False
    at_bound: bool = False

    def __str__(self) -> str:
        return rounded(self.value, self.standard_error)


@dataclass(frozen=True)
class MaterialFit:
    """The fit of one data set.

    Attributes:
        data: the measurements.
        plan: its objective.
        parameters: estimates by name, the fixed ones too.
        derived: eps_up, critical_velocity [m/s] and the like.
        columns: the physical values that make the curve.
        rms, rms_empirical: of the fitted curve, and of Eq. (17), against the data.
        reduced_chi_squared: with the stated uncertainties; None without.
        status: `softjax.Status` at each point.
        warnings: the doubts about this data set.
    """

    data: RestitutionData
    plan: str
    parameters: dict[str, Estimate]
    derived: dict[str, Estimate]
    columns: dict[str, float]
    rms: float
    rms_empirical: float | None
    reduced_chi_squared: float | None
    converged: bool
    status: tuple[int, ...]
    warnings: tuple[Doubt, ...]
    form: str
    kappa: str

    @property
    def name(self) -> str:
        return self.data.name

    @property
    def n(self) -> int:
        return len(self.data)

    @property
    def contact(self) -> sj.Contact | None:
        """The two bodies with what was fitted of them."""
        if self.data.contact is None:
            return None
        leaves = dict(self.data.contact.leaves())
        for name in ("yield_strength", "youngs_modulus", "limit_velocity"):
            if name in self.parameters:
                leaves[name] = self.columns[name]
        return sj.Contact(**leaves, area=self.data.contact.area)

    @property
    def law(self) -> sj.ContactLaw | None:
        """The fitted law; None without elastic properties.

        Where ε_up was fitted in place of σ and ψ, ψ is a guess from the data and σ such that
        Eq. (17) gives ε_up at v_cr: above yield the law is the fitted one, below it is not known.
        """
        contact = self.contact
        if contact is None or self.plan not in ("two-step", "model"):
            return None
        sigma, psi = self.columns["sigma"], self.columns["psi"]
        if "eps_up" in self.parameters:
            critical = np.mean(np.asarray(contact.critical_velocity))
            ratio = critical / (np.mean(np.asarray(contact.limit_velocity)) - critical)
            sigma = -math.log(self.columns["eps_up"]) / float(ratio) ** psi
        return sj.Zhou(contact, self.columns["chi"], sigma, psi, self.form, self.kappa)


@dataclass(frozen=True)
class Line:
    """Eq. (18), χ̃ = c1 + c2 E/Y, through all materials.

    Attributes:
        c1, c2: fitted directly to all curves at once (None where that was not asked for, then
            through the fitted χ̃).
        rms: of each material's curve with χ̃ from the line.
        chi: what the line gives for each material.
        through_chi: c1 and c2 through the fitted χ̃ with their weights instead.
        method: "curves" or "weighted".
    """

    c1: Estimate
    c2: Estimate
    rms: dict[str, float]
    chi: dict[str, Estimate]
    through_chi: dict[str, Estimate] | None
    converged: bool
    method: str = "curves"


@dataclass(frozen=True)
class Band:
    """A fitted curve and the confidence band of its mean."""

    velocity: np.ndarray
    coefficient: np.ndarray
    low: np.ndarray
    high: np.ndarray
    standard_error: np.ndarray


@dataclass(frozen=True, eq=False)
class FitResult:
    """A fit; prints itself as a table. See `MaterialFit` for one data set of it.

    Attributes:
        materials: one `MaterialFit` a data set.
        unloading_line: Eq. (18) through several, or None.
        covariance_names, covariance: of the free parameters, in physical units.
        rank, condition_number: of the weighted Jacobian with columns scaled to one.
        confidence: of all intervals.
        warnings: all doubts.
        optimiser_report: what each stage took.
        beside: the same fit by Levenberg–Marquardt through the energy balance, if asked for.
        profiles: by parameter label.
        degrees: degrees of freedom of each data set's noise, None where it was stated.
        settings, versions, times: how, with what, how long [s].
    """

    materials: tuple[MaterialFit, ...]
    unloading_line: Line | None
    covariance_names: tuple[str, ...]
    covariance: np.ndarray
    rank: int
    condition_number: float | None
    confidence: float
    warnings: tuple[Doubt, ...]
    optimiser_report: tuple[Stage, ...]
    beside: dict[str, Any] | None
    profiles: dict[str, Profile]
    degrees: tuple[int | None, ...]
    settings: dict[str, Any]
    versions: dict[str, str]
    times: dict[str, float] = field(default_factory=dict)

    @property
    def values(self) -> dict[str, float | None]:
        """Values by name, "chi" or "chi[name]"."""
        return {label: e.value for label, e in self.estimates.items()}

    @property
    def standard_errors(self) -> dict[str, float | None]:
        return {label: e.standard_error for label, e in self.estimates.items()}

    @property
    def intervals(self) -> dict[str, tuple[float | None, float | None]]:
        """Confidence limits; None is an open end."""
        return {label: (e.low, e.high) for label, e in self.estimates.items()}

    @property
    def estimates(self) -> dict[str, Estimate]:
        """All parameters, then the derived numbers that are not parameters."""
        table: dict[str, Estimate] = {}
        for material in self.materials:
            for name, estimate in {**material.derived, **material.parameters}.items():
                table[self._label(name, material)] = estimate
        return table

    def _label(self, name: str, material: MaterialFit) -> str:
        alone = len(self.materials) == 1 or name in LINE_COLUMNS
        return name if alone else f"{name}[{material.name}]"

    @property
    def converged(self) -> bool:
        line = self.unloading_line is None or self.unloading_line.converged
        return line and all(material.converged for material in self.materials)

    @property
    def rms(self):
        """Root mean square of curve minus data; for several data sets by name."""
        return self._each(lambda material: material.rms)

    @property
    def rms_empirical(self):
        """The same of Eq. (17)."""
        return self._each(lambda material: material.rms_empirical)

    @property
    def law(self):
        """The fitted law; for several data sets by name."""
        return self._each(lambda material: material.law)

    @property
    def data(self):
        return self._each(lambda material: material.data)

    def _each(self, of):
        if len(self.materials) == 1:
            return of(self.materials[0])
        return {material.name: of(material) for material in self.materials}

    @property
    def correlations(self) -> np.ndarray:
        """Of the free parameters; NaN where undetermined."""
        size = np.sqrt(np.diag(self.covariance))
        with np.errstate(invalid="ignore", divide="ignore"):
            return self.covariance / np.outer(size, size)

    def material(self, name: str | None = None) -> MaterialFit:
        """The fit of one data set; the name may be left out where there is one.

        Raises:
            ValueError: naming the accepted names.
        """
        if name is None and len(self.materials) == 1:
            return self.materials[0]
        for material in self.materials:
            if material.name == name:
                return material
        names = ", ".join(repr(material.name) for material in self.materials)
        raise ValueError(WITHOUT_NAME.format(names=names, name=name))

    def band(self, velocity, name: str | None = None, confidence: float | None = None) -> Band:
        """ε(v) of the fitted curve with the confidence band of its mean.

        Raises:
            ValueError: for an unknown name.
        """
        from calibration.bands import band

        return band(self, self.material(name), velocity, confidence or self.confidence)

    def empirical_band(self, velocity, name=None, confidence: float | None = None) -> Band:
        """The same for Eq. (17)."""
        from calibration.bands import band

        material = self.material(name)
        return band(self, material, velocity, confidence or self.confidence, empirical=True)

    def extrapolation(self, velocity, name: str | None = None) -> Doubt | None:
        """A doubt where velocities lie outside the data."""
        from calibration.doubt import extrapolation

        return extrapolation(velocity, self.material(name).data)

    def to_dict(self, times: bool = True) -> dict[str, Any]:
        """What `fit.json` holds; without `times` equal for equal fits."""
        from calibration.result_json import result_to_dict

        return result_to_dict(self, times)

    def to_json(self, times: bool = True) -> str:
        from calibration.result_json import dumps

        return dumps(self.to_dict(times))

    def save(self, path: str | Path) -> None:
        """Write `fit.json`; it appears whole or not at all."""
        from calibration.result_json import save

        save(self, path)

    @classmethod
    def load(cls, path: str | Path) -> "FitResult":
        """The result that `save` wrote.

        Raises:
            ValueError: where the file is no result.
        """
        from calibration.result_json import load

        return load(path)

    def __eq__(self, other) -> bool:
        if not isinstance(other, FitResult):
            return NotImplemented
        return self.to_dict() == other.to_dict()

    __hash__ = None  # type: ignore[assignment]

    def __str__(self) -> str:
        lines = []
        for material in self.materials:
            lines.append(f"{material.name}: {material.n} points, {material.plan}")
            estimates = {**material.parameters, **material.derived}
            width = max(map(len, estimates), default=0)
            for name, e in estimates.items():
                lines.append(f"  {name:{width}}  {e}  {interval_text(e, self.confidence)}".rstrip())
            lines.append(f"  rms {material.rms:.4g}" + _empirical_text(material))
        if self.unloading_line is not None:
            line = self.unloading_line
            lines.append(f"Eq. (18): c1 = {line.c1}, c2 = {line.c2}")
            lines += [f"  rms {name}: {rms:.4g}" for name, rms in line.rms.items()]
        lines.append("converged" if self.converged else "NOT CONVERGED")
        lines += [f"warning: {doubt}" for doubt in self.warnings]
        return "\n".join(lines)

    __repr__ = __str__


def _empirical_text(material: MaterialFit) -> str:
    if material.rms_empirical is None or material.plan in ("empirical", "constant"):
        return ""
    return f" (Eq. 17: {material.rms_empirical:.4g})"


def interval_text(e: Estimate, confidence: float) -> str:
    """The interval in brackets; an open end is told as such."""
    if not e.free and e.standard_error is None:
        return "(fixed)" if e.method == "fixed" and e.value is not None else ""
    if e.standard_error is None and e.low is None and e.high is None:
        return "(undetermined)"
    low = "open" if e.low is None else f"{e.low:.4g}"
    high = "open" if e.high is None else f"{e.high:.4g}"
    return f"[{low}, {high}] {100 * confidence:g} % {e.method}"


def rounded(value: float | None, error: float | None) -> str:
    """A value to the second digit of its error: 1.794 ± 0.052."""
    if value is None:
        return "—"
    if error is None or not math.isfinite(error) or error <= abs(value) * 1e-9:
        return f"{value:.6g}"
    digits = 1 - math.floor(math.log10(error))
    if digits - 1 >= -4 and digits <= 8:
        places = max(digits, 0)
        return f"{value:.{places}f} ± {error:.{places}f}"
    significant = max(digits + math.floor(math.log10(abs(value) or 1.0)), 1)
    return f"{value:.{significant}e} ± {error:.1e}"
