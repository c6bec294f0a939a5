"""Fit a law's parameters to measured restitutions: `fit`, and the `FitResult` that it returns."""

import importlib.metadata
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import jax
import numpy as np
from scipy.linalg import block_diag

import softjax as sj
from calibration.console import progress_of
from calibration.data import RestitutionData
from calibration.data.checks import check_whole, checked_confidence
from calibration.data.inputs import stated_inputs
from calibration.data.json_file import dumps
from calibration.errors import DataError, did_you_mean, listed
from calibration.fitting.budget import (
    Budget,
    budget_of,
    effects_of_one_per_cent,
    with_input_uncertainty,
)
from calibration.fitting.curves import band, of_impact
from calibration.fitting.fit_json import read_result, result_to_dict
from calibration.fitting.laws import LINE
from calibration.fitting.line import Line, fit_line, with_inputs
from calibration.fitting.material import Band, Estimate, MaterialFit
from calibration.fitting.profiles import Profile, profiles_of
from calibration.fitting.refits import Bootstrap, LeaveOneOut, bootstrap, leave_one_out
from calibration.fitting.request import Request, datasets_of
from calibration.fitting.search import OPTIMISERS
from calibration.fitting.stages import (
    ComponentFit,
    Likelihood,
    Stage,
    fitted,
    likelihood_of,
)
from calibration.fitting.summary import results_at, summarise
from calibration.fitting.uncertainty import DegreesOfFreedom
from calibration.fitting.variances import pooled_estimates
from calibration.fitting.warnings import FitWarning, extrapolation
from calibration.observables import OBSERVABLES, RESTITUTION
from calibration.options import FitOptions, documented, idle, merged, require_likelihood
from calibration.output import replacing, write_text

Progress = Callable[..., None]  # called as progress(stage, done, total)
PACKAGES = ("softjax-contact", "jax", "diffrax", "optax", "optimistix", "numpy", "scipy")
KINDS = ("mean", "prediction")
FEW_SETS = 3  # data sets up to which a fit looks at what its exact inputs move
_version = cache(importlib.metadata.version)


def _of_each(name: str, doc: str) -> Any:
    """A property of a fit's data set; for several data sets by name."""

    def get(result: "FitResult") -> Any:
        attributes = {material.name: getattr(material, name) for material in result.materials}
        return attributes if len(attributes) > 1 else attributes.popitem()[1]

    return property(get, doc=doc)


def _of_likelihood(name: str, doc: str) -> Any:
    """A property of a fit's likelihood; None without one."""
    return property(lambda result: getattr(result.likelihood, name, None), doc=doc)


@dataclass(frozen=True, eq=False)
class FitResult:
    """A fit; prints itself as a table. See `MaterialFit` for one data set of it.

    Attributes:
        request: data, parameters and options.
        materials: one `MaterialFit` a data set.
        unloading_line: Eq. (18) through several materials of Zhou's law, or None.
        covariance_names, covariance: of the free parameters, in physical units, with the part of
            uncertain inputs.
        statistical_covariance: that without it.
        of_predictions: the covariance with 0 along what is undetermined: of what follows from the
            parameters together.
        rank, condition_number: of the weighted Jacobian with columns scaled to one.
        likelihood: None under `two-step`, for pooled parameters, and for data without noise.
        warnings: all of them.
        optimiser_report: what each stage took.
        profiles: by parameter label.
        dof_by_component: how well the noise is known that the covariance comes from, of each component.
        pooled: mean and spread of parameters that are pooled, "chi" and "chi_spread"; the spread on
            the scale that is searched, ln θ where θ is positive.
        settings, versions, times: how, with what, how long [s].
        budget: what uncertain inputs add; None where none is stated.
        of_one_per_cent: where none is stated, by name of an input, the changes of results [%] where it is
            1 % larger, to first order; of up to `FEW_SETS` data sets.
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
        """All estimates as a pandas DataFrame, one a row; see `calibration.report.tables`."""
        from calibration.report.tables import estimates

        return estimates(self)

    def to_markdown(self) -> str:
        """The table of parameters in Markdown: value ± standard error, and interval."""
        from calibration.report.papers import markdown

        return markdown(self)

    def to_latex(self) -> str:
        r"""The table of parameters as LaTeX's tabular (package booktabs): $\tilde\chi$, $1.794 \pm 0.052$."""
        from calibration.report.papers import latex

        return latex(self)

    def report(self, folder: str | Path) -> list[str]:
        """Write what `softjax fit` writes into a folder: fit.json, pictures, report.html.

        Returns:
            The names of the files.

        Raises:
            OSError: where they cannot be written; none of them is then.
        """
        from calibration import output
        from calibration.report.fit import write_report

        output.lost.clear()
        names = write_report(self, folder)
        for picture, reason in output.lost.items():
            warnings.warn(f"{picture} could not be drawn ({reason})", stacklevel=2)
        return names

    def plot(
        self,
        ax: Any = None,
        figsize: tuple[float, float] | None = None,
        log: bool = False,
        laws: Mapping[str, sj.ContactLaw] | None = None,
        points: Any = None,
    ) -> Any:
        """Draw data, fitted curves with their bands, and residuals below.

            upper, lower = result.plot(figsize=(3.35, 3.6), log=True)      # 85 mm wide
            upper.figure.savefig("fit.pdf")

        Args:
            ax: Matplotlib's axes to draw into: one for ε, or two with the residuals; of one data set.
            figsize: width and height of a figure of its own [inches].
            log: a logarithmic axis of velocity; without it where the data span more than 1.5 decades.
            laws: further laws, {label: law}, dashed.
            points: False leaves the data out; `RestitutionData` are drawn, too.

        Returns:
            The axes: those given; else two, of several data sets one row of two for each.
        """
        from calibration.plots import plot

        return plot(self, ax, figsize, log, laws, points)

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
    del table["of_one_per_cent"]  # of the file's inputs, or of the contact's
    for fit in table["fits"]:
        del fit["data"]["bodies"]
        for outlier in fit["outliers"]:
            del outlier["line"]  # of the file
    return table


@documented
def fit(
    data: RestitutionData | Sequence[RestitutionData] | str | Path,
    law: str | type | Callable[..., sj.ContactLaw] | None = None,
    parameters: Mapping[str, Any] | Sequence[Mapping[str, Any]] | None = None,
    *,
    inputs: Mapping[str, Any] | None = None,
    progress: Progress | bool | None = None,
    **options: Any,
) -> FitResult:
    """Fit a contact law to one data set or several.

    Args:
        data: one `RestitutionData`, or a list of them with different names; or the path of a material
            file, "my.toml", whose `[fit]` and parameters then act as in `softjax fit my.toml`: options
            given here win, and `parameters` take the place of the file's.
        law: Zhou's where left out (for data without a contact Eq. (17), or a constant); a name of
            `LAWS`, a class of contact laws, or any function that builds one: law(contact, c1, c2).
        parameters: the parameters of the law: {"chi": ...} for all data sets,
            {"chi[name]": ...} for one; a `Parameter`, a number that fixes it, or a text for an
            option such as {"form": "full"}; or a list of such mappings, one a data set. Those of
            the contact are "contact.yield_strength" and so on. All of a law's own are free, except
            what ε does not determine.
        inputs: standard uncertainties of numbers that all points have in common, {"youngs_modulus":
            5e9, "wall.yield_strength": "10 %"}, in SI or as text, for one set {name: {...}}, in addition
            to those that a file states: see `calibration.data.inputs`. They enter standard errors,
            intervals and bands (`FitResult.budget`), not the likelihood.
        progress: True shows it, a bar on a terminal and else a line a stage; or a function that is
            called as progress(stage, done, total).
        OPTIONS

    Returns:
        A `FitResult`. A fit that did not converge is marked so, not raised.

    Data sets that share no parameter are fitted each by itself. All is computed in float64, whatever
    JAX is set to.

    Raises:
        ValueError: naming the argument, its value and what is accepted.

    Example:
        >>> import calibration as cal
        >>> steel = cal.paper_materials()[0]
        >>> result = cal.fit(steel, objective="two-step")
        >>> round(result.values["chi"], 4)
        1.7944
    """
    started = time.perf_counter()
    with progress_of(progress) as shown, jax.enable_x64(True):
        if isinstance(data, str | Path):
            data, law, parameters, options = _of_file(data, law, parameters, options)
        options_of_fit = FitOptions.of(law=law, **options)
        if not (shown is None or callable(shown)):
            accepted = "True, or called as progress(stage, done, total)"
            raise DataError("progress", shown, accepted)
        request = Request(datasets_of(data), parameters, options_of_fit)
        result = _fitted(request, inputs, shown or (lambda *_: None))
    result.times["total"] = time.perf_counter() - started
    return result


def _of_file(path: str | Path, law: Any, parameters: Any, options: dict[str, Any]) -> tuple:
    """Data, law, parameters and options of a material file, with those that were given in place of its own."""
    from calibration.data.materials import read_problem

    file = read_problem(path)
    stated = {
        name: x for name, x in file.settings.items() if name != "area"
    }  # the contacts have it
    settings = merged(stated, options if law is None else {"law": law, **options})
    data = file.datasets[0] if len(file.datasets) == 1 else file.datasets
    law = settings.pop("law", None)
    return data, law, file.parameters if parameters is None else parameters, settings


def _fitted(request: Request, stated: Mapping[str, Any] | None, tell: Progress) -> FitResult:
    options, started = request.options, time.perf_counter()
    names = [data.name for data in request.datasets]
    pairs = zip(request.datasets, stated_inputs(stated, names), strict=True)
    inputs = [data.uncertain_inputs(own) for data, own in pairs]
    fits = fitted(request, lambda done, count: tell("fit", done, count))
    line = fit_line(request, fits)
    seconds = time.perf_counter() - started
    curves: list[dict[str, Profile]] = [{} for _ in fits]
    if options.profiles:
        done = lambda count: tell("profiles", count, len(fits))  # noqa: E731
        curves = profiles_of(fits, options.confidence, done)
        done(len(fits))
    found_warnings: list[FitWarning] = []
    materials: dict[int, MaterialFit] = {}
    pooled = pooled_estimates(fits, options.confidence)
    for fit, profiles in zip(fits, curves, strict=True):
        parts, of_several, drag = summarise(fit, profiles, options)
        materials |= dict(zip(fit.component.sets, parts, strict=True))
        found_warnings += of_several
        pooled |= drag
    ordered = tuple(materials[g] for g in sorted(materials))
    found_warnings += [warning for material in ordered for warning in material.warnings]
    stages = [stage for fit in fits for stage in fit.stages]
    if line is not None:
        stage = replace(line.fit.final, report=replace(line.fit.final.report, stage="Eq. (18)"))
        stages.append(stage)
        if not stage.ends.converged[0]:
            found_warnings.append(FitWarning("not-converged", f"Eq. (18): {stage.report.reason}"))
    found_warnings.sort(key=lambda warning: warning.rank)
    condition = max(float(fit.uncertainty.condition_number) for fit in fits)
    names, covariance, of_predictions = _covariances(fits)
    result = FitResult(
        request=request,
        materials=ordered,
        unloading_line=None if line is None else line.line,
        covariance_names=names,
        covariance=covariance,
        of_predictions=of_predictions,
        rank=sum(int(fit.uncertainty.rank) for fit in fits),
        condition_number=condition if np.isfinite(condition) else None,
        likelihood=likelihood_of(fits, options),
        warnings=tuple(dict.fromkeys(found_warnings)),
        optimiser_report=tuple(stage.report for stage in stages),
        profiles={label: curve for profiles in curves for label, curve in profiles.items()},
        dof_by_component=tuple(
            f.uncertainty.dof.physical(f.slope, f.uncertainty.covariance_known_noise) for f in fits
        ),
        settings=_settings(request, fits),
        versions={name: _version(name) for name in PACKAGES},
        times={"searches": seconds},
        pooled=pooled,
        fits=tuple(fits),
    )
    if not all(fit.is_likelihood for fit in fits):
        return result
    results = partial(results_at, len(ordered))
    if not any(inputs):
        if len(ordered) > FEW_SETS:
            return result
        return replace(result, of_one_per_cent=effects_of_one_per_cent(request, fits, results))
    tell("inputs", 0, 1)
    curvature = dict(zip(names, np.sqrt(np.diag(covariance)).tolist(), strict=True))
    budget = budget_of(request, fits, inputs, result.estimates, curvature, results)
    if budget is None:
        return result
    if line is not None:
        named = dict(zip((data.name for data in request.datasets), inputs, strict=True))
        by_name = {material.name: material for material in ordered}
        result = replace(result, unloading_line=with_inputs(line, named, budget, by_name))
    return _with_inputs(result, budget)


def _with_inputs(result: FitResult, budget: Budget) -> FitResult:
    """The result with what uncertain inputs add to its errors and intervals."""

    def of(estimates: Mapping[str, Estimate], labels: Mapping[str, str]) -> dict[str, Estimate]:
        return {
            name: with_input_uncertainty(
                estimate, budget, labels.get(name, name), result.confidence
            )
            for name, estimate in estimates.items()
        }

    is_single = len(result.materials) == 1
    materials = []
    for material in result.materials:
        derived = {n: n if is_single else f"{n}[{material.name}]" for n in material.derived}
        parameters = of(material.parameters, material.labels)
        derived_too = of(material.derived, derived)
        materials.append(replace(material, parameters=parameters, derived=derived_too))
    return replace(
        result,
        materials=tuple(materials),
        pooled=of(result.pooled, {}),
        covariance=result.covariance + budget.covariance(result.covariance_names),
        statistical_covariance=result.covariance,
        budget=budget,
    )


def _covariances(fits: list[ComponentFit]):
    """Covariance of all free parameters in physical units, D C D with D = ∂θ/∂z; zero between components."""
    names = tuple(e.label for fit in fits for e in fit.component.elements)
    both = block_diag(*(np.outer(fit.slope, fit.slope) for fit in fits))
    known = np.concatenate([fit.uncertainty.known & fit.has_intervals for fit in fits])
    covariance = both * block_diag(*(np.nan_to_num(fit.uncertainty.covariance) for fit in fits))
    covariance[~known], covariance[:, ~known] = np.nan, np.nan
    parts = (f.uncertainty.of_predictions * (1.0 if f.has_intervals else np.nan) for f in fits)
    return names, covariance, both * block_diag(*parts)


def _settings(request: Request, fits: list[ComponentFit]) -> dict[str, Any]:
    specs = [spec for fit in fits for spec in fit.component.specs]
    contacts = [spec.data.contact for spec in specs if spec.data.contact is not None]
    options, integrated = request.options, fits[0].final.problem.route
    without_effect = idle(dict(options))
    names = ("noise", "noise_dof", "starts", "seed", "max_steps")
    table: dict[str, Any] = {
        "objective": ", ".join(sorted({spec.objective for spec in specs})),
        "law": ", ".join(dict.fromkeys(spec.model.key for spec in specs)),
        "route": fits[0].final.report.route,
        "optimiser": OPTIMISERS[options.optimiser],
        "area": contacts[0].area if contacts else None,
        **{name: value for spec in specs for name, value in spec.model.options.items()},
        "x64": True,
        **{name: getattr(options, name) for name in names if name not in without_effect},
    }
    if isinstance(integrated, sj.ODE):
        steps = integrated.steps
        how = {"rtol": integrated.tolerance} if steps is None else {"steps": steps}
        table |= {"solver": integrated.solver, **how}
    groups = {
        e.label: [fit.component.specs[g].data.name for g in e.sets]
        for fit in fits
        for e in fit.component.elements
        if len(e.sets) > 1
    }
    return table | ({"shared": groups} if groups else {})
