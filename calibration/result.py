"""What a fit found, how well it is known, and what to doubt about it."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from calibration.doubt import Doubt
from calibration.estimate import Band, Estimate, Line
from calibration.material_fit import MaterialFit
from calibration.parameters import LINE_COLUMNS
from calibration.profiles import Profile
from calibration.stages import Stage

WITHOUT_NAME = "`name` must be one of {names}, but is {name!r}"


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
        from calibration.result_text import fit_text

        return fit_text(self)

    __repr__ = __str__
