"""The estimates of a fit, and what follows from them: curves with bands, refits, draws, the file of a result.

`calibration.FitResult` is such a record that also prints, draws and reports itself.
"""

import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import jax
import numpy as np

from calibration.data.checks import check_whole, checked_confidence
from calibration.data.json_file import dumps
from calibration.errors import DataError, did_you_mean, listed
from calibration.fitting.budget import Budget
from calibration.fitting.components import ComponentFit, Likelihood
from calibration.fitting.curves import band, of_impact
from calibration.fitting.degrees_of_freedom import DegreesOfFreedom
from calibration.fitting.fit_json import read_result, result_to_dict
from calibration.fitting.laws import LINE
from calibration.fitting.left_out import LeaveOneOut, leave_one_out
from calibration.fitting.line import Line
from calibration.fitting.material import Band, Estimate, MaterialFit
from calibration.fitting.profiles import Profile
from calibration.fitting.refits import Bootstrap, bootstrap
from calibration.fitting.request import Request
from calibration.fitting.stages import Stage
from calibration.fitting.warnings import FitWarning, extrapolation
from calibration.observables import OBSERVABLES, RESTITUTION
from calibration.options import require_likelihood
from calibration.output import replacing, write_text

KINDS = ("mean", "prediction")


def _of_each(name: str, doc: str) -> Any:
    """A property of a fit's data set; for several data sets by name."""

    def get(result: "FitEstimates") -> Any:
        attributes = {material.name: getattr(material, name) for material in result.materials}
        return attributes if len(attributes) > 1 else attributes.popitem()[1]

    return property(get, doc=doc)


def _of_likelihood(name: str, doc: str) -> Any:
    """A property of a fit's likelihood; None without one."""
    return property(lambda result: getattr(result.likelihood, name, None), doc=doc)


@dataclass(frozen=True, eq=False)
class FitEstimates:
    """Estimates of a fit, and what is computed from them; `FitResult` describes the attributes."""

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
    dof_by_component: tuple[DegreesOfFreedom, ...]
    settings: dict[str, Any]
    versions: dict[str, str]
    times: dict[str, float] = field(default_factory=dict)
    pooled: dict[str, Estimate] = field(default_factory=dict)
    fits: tuple[ComponentFit, ...] | None = field(default=None, repr=False)
    budget: Budget | None = None
    statistical_covariance: np.ndarray = None  # type: ignore[assignment]  # filled in
    of_one_per_cent: dict[str, dict[str, float]] = field(default_factory=dict)

    def __post_init__(self):
        if self.statistical_covariance is None:
            object.__setattr__(self, "statistical_covariance", self.covariance)

    @property
    def confidence(self) -> float:
        """Confidence level of all intervals."""
        return self.request.options.confidence

    @property
    def values(self) -> dict[str, float | None]:
        """Values by name, "chi" or "chi[name]"; the numbers of whole parameters too."""
        table = {label: e.value for label, e in self.estimates.items()}
        labels = ((m, name, label) for m in self.materials for name, label in m.labels.items())
        return table | {label: float(m.values[n]) for m, n, label in labels if "[" in n}

    @property
    def standard_errors(self) -> dict[str, float | None]:
        """Standard errors by name; NaN of a free parameter that has none, at a bound, say, or skewed."""
        return {
            label: np.nan if e.free and e.standard_error is None else e.standard_error
            for label, e in self.estimates.items()
        }

    @property
    def statistical_errors(self) -> dict[str, float | None]:
        """Standard errors without what uncertain inputs add."""
        parts = {label: e.statistical_error for label, e in self.estimates.items()}
        return {
            label: size if parts[label] is None else parts[label]
            for label, size in self.standard_errors.items()
        }

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
                is_single = len(self.materials) == 1 or name in LINE
                table[name if is_single else f"{name}[{material.name}]"] = estimate
                if name in material.labels:
                    table[material.labels[name]] = estimate
        return table | self.pooled

    @property
    def converged(self) -> bool:
        line = self.unloading_line is None or self.unloading_line.converged
        return line and all(material.converged for material in self.materials)

    log_likelihood = _of_likelihood(
        "log", "ln L; None under `two-step`, for pooled parameters, and for data without noise."
    )
    aic = _of_likelihood("aic", "Akaike's criterion, 2k - 2 ln L.")
    bic = _of_likelihood("bic", "Schwarz's criterion, k ln n - 2 ln L.")
    rms = _of_each("rms", "Root mean square of curve minus data; for several data sets by name.")
    rms_empirical = _of_each("rms_empirical", "Rms of Eq. (17); None for other laws than Zhou's.")
    outliers = _of_each("outliers", "The points that the noise does not explain; by name as well.")
    law = _of_each("law", "The fitted law; for several data sets by name.")
    data = _of_each("data", "The measurements; for several data sets by name.")

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
        known = {material.name: material for material in self.materials}
        if name not in known:
            raise DataError("name", repr(name), f"one of {', '.join(map(repr, known))}")
        return known[name]

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

        The limits alone are NaN where parameters move the curve that the data do not determine
        (the warning `rank-deficient`); not for the weights of a network.

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

        Returns:
            A `Band` with the fields velocity [m/s], coefficient (ε), low, high (limits), standard_error,
            all as long as the velocities, and kind.

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
        with np.errstate(over="ignore", invalid="ignore"):  # of numbers near the end of floats
            return band(self, material, velocity, level, kind, observable, impact)

    def degrees_of_freedom(self, label: str) -> float | None:
        """Degrees of freedom of the noise in a free parameter's standard error; None if the noise is stated."""
        if label not in self.covariance_names:
            return None
        k = self.covariance_names.index(label)
        dof = next(f for f in self.dof_by_component if label in f.labels)
        variance = self.covariance[k, k]
        degrees = dof.satterthwaite((label,), np.ones((1, 1)), np.array([variance]))[0]
        return float(degrees) if np.isfinite(degrees * variance) else None

    def extrapolation(self, velocity, name: str | None = None) -> FitWarning | None:
        """A warning where velocities lie outside the data."""
        return extrapolation(velocity, self.material(name).data)

    def leave_one_out(self) -> LeaveOneOut:
        """Each point predicted by the fit without it; see `LeaveOneOut`."""
        self._require_likelihood()
        with jax.enable_x64(True):
            return leave_one_out(self.searched("leave_one_out"))

    def bootstrap(self, count: int = 1000, seed: int = 0) -> Bootstrap:
        """Fits of data simulated with the fitted curve and noise; see `Bootstrap`.

        Raises:
            ValueError: naming the argument, its value and what is accepted.
        """
        check_whole("count", count, 1)
        check_whole("seed", seed, 0)
        self._require_likelihood()
        with jax.enable_x64(True):
            return bootstrap(self.searched("bootstrap"), count, seed, self.confidence)

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

        self.searched("posterior")
        return sampled(self, draws, chains, seed, warmup, progress)

    def _require_likelihood(self) -> None:
        for material in self.materials:
            require_likelihood(material.objective)

    def searched(self, purpose: str) -> list[ComponentFit]:
        """The searches, for what makes more of them.

        Raises:
            ValueError: of a result that was loaded, which has none.
        """
        if self.fits is None:
            accepted = f"fitted here for {purpose}: fit the data again by cal.fit"
            raise DataError("result", "loaded from a file", accepted)
        return list(self.fits)

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
    def load(cls, path: str | Path, law: Any = None) -> Self:
        """The result that `save` wrote.

        Args:
            law: the class or function of your own law: a file names it, and nothing is
                imported or run because a file says so.

        Raises:
            ValueError: where the file is no result, or names a law that was not given.
        """
        return cls(**read_result(path, law))

    def __eq__(self, other) -> bool:
        if not isinstance(other, FitEstimates):
            return NotImplemented
        return _compared(self) == _compared(other)

    __hash__ = None  # type: ignore[assignment]


def _compared(result: FitEstimates) -> dict[str, Any]:
    """Fields that equal results share: without times, and of the bodies only the contact."""
    table = result.to_dict(times=False)
    del table["of_one_per_cent"]  # of the file's inputs, or of the contact's
    for fit in table["fits"]:
        del fit["data"]["bodies"]
        for outlier in fit["outliers"]:
            del outlier["line"]  # of the file
    return table
