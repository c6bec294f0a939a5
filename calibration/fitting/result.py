"""Result of a fit: estimates, errors and warnings."""

import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import jax
import numpy as np

from calibration.data.checks import check_whole, checked_confidence
from calibration.data.json_file import dumps
from calibration.errors import DataError, did_you_mean, listed
from calibration.fitting.curves import band, of_impact
from calibration.fitting.fit_json import read_result, result_to_dict
from calibration.fitting.laws import LINE
from calibration.fitting.line import Line
from calibration.fitting.material import Band, Estimate, MaterialFit
from calibration.fitting.profiles import Profile
from calibration.fitting.refits import Bootstrap, LeaveOneOut, bootstrap, leave_one_out
from calibration.fitting.request import Request
from calibration.fitting.stages import ComponentFit, Likelihood, Stage, fitted
from calibration.fitting.uncertainty import Freedom, freedom_of
from calibration.fitting.warnings import FitWarning, extrapolation
from calibration.observables import OBSERVABLES, RESTITUTION
from calibration.output import replacing, write_text

KINDS = ("mean", "prediction")


@dataclass(frozen=True, eq=False)
class FitResult:
    """A fit; prints itself as a table. See `MaterialFit` for one data set of it.

    Attributes:
        request: data, parameters and options.
        materials: one `MaterialFit` a data set.
        unloading_line: Eq. (18) through several materials of Zhou's law, or None.
        covariance_names, covariance: of the free parameters, in physical units.
        of_predictions: the covariance with 0 along what is undetermined: of what follows from the
            parameters together.
        rank, condition_number: of the weighted Jacobian with columns scaled to one.
        likelihood: None where what was minimised is no likelihood, or the data have no noise.
        warnings: all of them.
        optimiser_report: what each stage took.
        profiles: by parameter label.
        freedoms: how well the noise is known that the covariance comes from, of each component.
        pooled: mean and spread of parameters that are pooled, "chi" and "chi_spread"; the spread on
            the scale that is searched, ln θ where θ is positive.
        settings, versions, times: how, with what, how long [s].
        fits: the searches themselves; None in a result that was loaded.
    """

    request: Request
    materials: tuple[MaterialFit, ...]
    unloading_line: Line | None
    covariance_names: tuple[str, ...]
    covariance: np.ndarray
    of_predictions: np.ndarray
    rank: int
    condition_number: float | None
    likelihood: Likelihood | None
    warnings: tuple[FitWarning, ...]
    optimiser_report: tuple[Stage, ...]
    profiles: dict[str, Profile]
    freedoms: tuple[Freedom, ...]
    settings: dict[str, Any]
    versions: dict[str, str]
    times: dict[str, float] = field(default_factory=dict)
    pooled: dict[str, Estimate] = field(default_factory=dict)
    fits: tuple[ComponentFit, ...] | None = field(default=None, repr=False)

    @property
    def confidence(self) -> float:
        """Confidence level of all intervals."""
        return self.request.options.confidence

    @property
    def values(self) -> dict[str, float | None]:
        """Values by name, "chi" or "chi[name]"; the numbers of whole parameters too."""
        table = {label: e.value for label, e in self.estimates.items()}
        for material in self.materials:
            for name, label in material.labels.items():
                if "[" in name:
                    table[label] = float(material.values[name])
        return table

    @property
    def standard_errors(self) -> dict[str, float | None]:
        return {label: e.standard_error for label, e in self.estimates.items()}

    @property
    def intervals(self) -> dict[str, tuple[float | None, float | None]]:
        """Confidence limits; None is an open end."""
        return {label: (e.low, e.high) for label, e in self.estimates.items()}

    @property
    def estimates(self) -> dict[str, Estimate]:
        """All parameters, then the derived numbers that are not parameters.

        What several data sets share has the name of each of them, and that of what they share.
        """
        table: dict[str, Estimate] = {}
        for material in self.materials:
            for name, estimate in {**material.derived, **material.parameters}.items():
                alone = len(self.materials) == 1 or name in LINE
                table[name if alone else f"{name}[{material.name}]"] = estimate
                if name in material.labels:
                    table[material.labels[name]] = estimate
        return table | self.pooled

    @property
    def converged(self) -> bool:
        line = self.unloading_line is None or self.unloading_line.converged
        return line and all(material.converged for material in self.materials)

    @property
    def log_likelihood(self) -> float | None:
        """ln L; None under `two-step`, for pooled parameters, and for data without noise."""
        return None if self.likelihood is None else self.likelihood.log

    @property
    def aic(self) -> float | None:
        """Akaike's criterion, 2k - 2 ln L."""
        return None if self.likelihood is None else self.likelihood.aic

    @property
    def bic(self) -> float | None:
        """Schwarz's criterion, k ln n - 2 ln L."""
        return None if self.likelihood is None else self.likelihood.bic

    @property
    def rms(self):
        """Root mean square of curve minus data; for several data sets by name."""
        return self._each(lambda material: material.rms)

    @property
    def outliers(self):
        """The points that the noise does not explain; for several data sets by name."""
        return self._each(lambda material: material.outliers)

    @property
    def rms_empirical(self):
        """Rms of Eq. (17); None for other laws than Zhou's."""
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
        """Correlations of the free parameters; NaN where undetermined."""
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
        raise DataError("name", repr(name), f"one of {names}")

    def determined(self, velocity, name: str | None = None) -> np.ndarray:
        """Whether the data determine ε at these velocities [m/s].

        Zhou's law by `model`, without points below the critical velocity, is not determined below it;
        without points above, not above.
        """
        return self.material(name).determined(velocity)

    def known(self, velocity, name: str | None = None) -> np.ndarray:
        """The former name of `determined`, until version 0.2."""
        warnings.warn("known(v) is determined(v) now", DeprecationWarning, stacklevel=2)
        return self.determined(velocity, name)

    def band(
        self,
        velocity,
        name: str | None = None,
        confidence: float | None = None,
        *,
        kind: str = "mean",
        draws: Any = None,
        observable: str = RESTITUTION,
        impact: int | None = None,
    ) -> Band:
        """ε(v) of the fitted curve with a confidence band; NaN where `determined` is False.

        Args:
            velocity: [m/s], any shape.
            name: of the data set, where there are several.
            confidence: that of the fit where left out.
            kind: "mean", of the curve itself, or "prediction", of one more measurement.
            draws: a posterior, whose mean, standard deviation and central limits are then given.
            observable: another than ε, "contact_time" and so on, in SI: see `calibration.observables`;
                its prediction where the fit had values of it.
            impact: with the bodies of this one of the data, where they differ; without it as many
                velocities as impacts are needed then.

        Raises:
            ValueError: naming the argument, its value and what is accepted.
        """
        if kind not in KINDS:
            raise DataError("kind", kind, " or ".join(map(repr, KINDS)))
        if observable not in OBSERVABLES:
            accepted = f"one of {listed(OBSERVABLES)}{did_you_mean(observable, OBSERVABLES)}"
            raise DataError("observable", observable, accepted)
        material = self.material(name)
        if impact is not None:
            count = len(material.data)
            if not 0 <= impact < count:
                raise DataError("impact", impact, f"from 0 to {count - 1}")
            material = of_impact(material, impact)
        level = self.confidence if confidence is None else checked_confidence(confidence)
        if draws is not None:
            if observable != RESTITUTION:
                raise DataError("draws", "given", f"left out for {observable}")
            from calibration.fitting.posterior.draws import band_of_draws

            return band_of_draws(draws, material, velocity, level, kind)
        names, covariance = self.covariance_names, self.of_predictions
        freedom = freedom_of(self.freedoms, material.name, material.labels.values())
        route = self.request.route_of_curve(material.model.law_type)
        with np.errstate(over="ignore", invalid="ignore"):  # of numbers near the end of floats
            return band(
                material, velocity, names, covariance, freedom, level, kind, route, observable
            )

    def degrees_of_freedom(self, label: str) -> float | None:
        """Degrees of freedom of the noise in a free parameter's standard error; None if the noise is stated."""
        if label not in self.covariance_names:
            return None
        k = self.covariance_names.index(label)
        freedom = next(one for one in self.freedoms if label in one.labels)
        variance = self.covariance[k, k]
        degrees = freedom.degrees((label,), np.ones((1, 1)), np.array([variance]))[0]
        return float(degrees) if np.isfinite(degrees * variance) else None

    def extrapolation(self, velocity, name: str | None = None) -> FitWarning | None:
        """A warning where velocities lie outside the data."""
        return extrapolation(velocity, self.material(name).data)

    def leave_one_out(self) -> LeaveOneOut:
        """Each point predicted by the fit without it; see `LeaveOneOut`."""
        with jax.enable_x64(True):
            return leave_one_out(self.searched())

    def bootstrap(self, count: int = 1000, seed: int = 0) -> Bootstrap:
        """Fits of data simulated with the fitted curve and noise; see `Bootstrap`.

        Raises:
            ValueError: naming the argument, its value and what is accepted.
        """
        check_whole("count", count, 1)
        check_whole("seed", seed, 0)
        with jax.enable_x64(True):
            return bootstrap(self.searched(), count, seed, self.confidence)

    def posterior(
        self,
        draws: int = 1000,
        chains: int = 4,
        seed: int = 0,
        *,
        warmup: int = 1000,
        progress: Callable[[str, int, int], None] | None = None,
    ) -> Any:
        """Draws from the posterior of all parameters and of what is unknown of the noise, by NUTS.

        Needs `pip install -e ".[bayes]"`. Priors are those stated with `Parameter`, and
        weak ones of `calibration.fitting.posterior.density` elsewhere: the attribute "prior" of each variable.

        Args:
            draws, warmup: of each chain.
            seed: equal draws for equal seeds.
            progress: called as progress(stage, done, total).

        Returns:
            ArviZ data (`InferenceData`, from ArviZ 1 on `DataTree`): posterior, log_likelihood of
            each point, posterior_predictive, sample_stats, observed_data.

        Raises:
            ImportError: without the extra.
            ValueError: naming the argument, its value and what is accepted; for fits that were no
                likelihood (`two-step`).
        """
        from calibration.fitting.posterior.draws import sampled

        return sampled(self, draws, chains, seed, warmup, progress)

    def at_draws(self, posterior: Any, count: int = 16) -> list["FitResult"]:
        """This fit at some draws of its posterior, evenly selected, with the laws that a study needs.

            cal.optimal_velocities(result.at_draws(posterior), 10, (0.1, 5.0))

        places shots by the information expected over these draws.
        """
        from calibration.fitting.posterior.draws import at_draws

        return at_draws(self, posterior, count)

    def searched(self) -> list[ComponentFit]:
        """The searches; a result that was loaded makes them again."""
        return list(self.fits) if self.fits is not None else fitted(self.request)

    def to_dict(self, times: bool = True) -> dict[str, Any]:
        """Contents of `fit.json`; without `times` equal for equal fits."""
        return result_to_dict(self, times)

    def to_json(self, times: bool = True) -> str:
        """The text of `fit.json`; without `times` equal fits are equal texts."""
        return dumps(self.to_dict(times))

    def save(self, path: str | Path) -> None:
        """Write `fit.json`; it appears whole or not at all."""
        with replacing(path) as staged:
            write_text(staged, self.to_json())

    @classmethod
    def load(cls, path: str | Path, law: Any = None) -> "FitResult":
        """The result that `save` wrote.

        Args:
            law: the class or function of your own law: a file names it, and nothing is
                imported or run because a file says so.

        Raises:
            ValueError: where the file is no result, or names a law that was not given.
        """
        return cls(**read_result(path, law))

    def to_frame(self) -> Any:
        """All estimates as a pandas DataFrame, one a row; see `calibration.report.fit`."""
        from calibration.report.fit import estimates

        return estimates(self)

    def report(self, folder: str | Path) -> list[str]:
        """Write what `softjax fit` writes into a folder: fit.json, pictures, report.md, report.html.

        Returns:
            The names of the files.

        Raises:
            OSError: where they cannot be written; none of them is then.
        """
        from calibration.report.fit import write_report

        return write_report(self, folder)

    def plot(self) -> Any:
        """Data, fitted curves with their bands, and residuals, as a Matplotlib figure."""
        from calibration.plots import curves_figure, lines_of

        return curves_figure(self, lines_of(self))

    def _repr_html_(self) -> str:
        from calibration.report.fit import result_html

        return result_html(self)

    def __eq__(self, other) -> bool:
        if not isinstance(other, FitResult):
            return NotImplemented
        return _compared(self) == _compared(other)

    __hash__ = None  # type: ignore[assignment]

    def __str__(self) -> str:
        from calibration.report.fit import result_text

        return result_text(self)

    __repr__ = __str__


def _compared(result: FitResult) -> dict[str, Any]:
    """Fields that equal results share: without times, and of the bodies only the contact."""
    table = result.to_dict(times=False)
    for fit in table["fits"]:
        del fit["data"]["bodies"]
        for outlier in fit["outliers"]:
            del outlier["line"]  # of the file
    return table
