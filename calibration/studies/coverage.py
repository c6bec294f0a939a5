"""Do confidence intervals contain the truth as often as they say? Simulated experiments, fitted as any other."""

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from jaxtyping import Float

import softjax as sj
from calibration.data import RestitutionData
from calibration.data.checks import check_whole, checked_confidence
from calibration.errors import DataError
from calibration.fitting.result import FitResult, fit

AT_ONCE = 16  # sets that are fitted side by side


@dataclass(frozen=True)
class CoverageCase:
    """One simulated experiment: a known law, measured again and again.

    Attributes:
        name: of the case, in tables.
        truth: the law whose curve is measured.
        velocity: of the impacts [m/s].
        law, parameters, objective: what is fitted, as `fit` takes it; the truth's own class where
            left out.
        noise: standard deviation of the independent, equal errors of ε.
        stated: whether the fit knows it.
        contact: the two bodies, where the truth is a law without them.
        options: further ones of `fit`, such as {"extra_scatter": True} or {"profiles": False}.
        simulate: makes a data set from a `numpy.random.Generator`; replaces velocity, noise and stated.
        values: true values by label; those that the same fit finds without noise where left out.
    """

    name: str
    truth: sj.ContactLaw | None = None
    velocity: Any = None
    law: Any = None
    parameters: Mapping[str, Any] = field(default_factory=dict)
    objective: str = "model"
    noise: float = 0.005
    stated: bool = False
    contact: sj.Contact | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    simulate: Callable[[np.random.Generator], RestitutionData] | None = None
    values: Mapping[str, float] | None = None

    def data(self, random: np.random.Generator | None = None) -> RestitutionData:
        """A simulated data set; without a generator the noise-free one."""
        if self.simulate is not None and random is not None:
            return self.simulate(random)
        if self.truth is None:
            raise DataError("truth", None, "a law, or `simulate` and `values` in its place")
        velocity = np.asarray(self.velocity, float)
        restitution = np.asarray(sj.restitution(self.truth, velocity).coefficient)
        if random is not None:
            noise = self.noise * random.standard_normal(len(velocity))
            restitution = np.maximum(restitution + noise, 0.0)
        return RestitutionData(
            velocity,
            restitution,
            self.contact or getattr(self.truth, "contact", None),
            np.asarray(self.noise) if self.stated else None,
            self.name,
            limit_velocity=getattr(self.truth, "limit_velocity", None),
        )

    def fit(self, data: RestitutionData | Sequence[RestitutionData], **options: Any) -> FitResult:
        """Fit one data set, or several side by side."""
        law = type(self.truth) if self.law is None else self.law
        route = sj.EnergyBalance() if self.objective == "two-step" else None
        settings = {"objective": self.objective, "route": route, **self.options, **options}
        return fit(data, law, dict(self.parameters), **settings)


@dataclass(frozen=True, eq=False)
class Coverage:
    """Results of one case, by parameter label unless stated otherwise.

    Attributes:
        name: of the case.
        truth: the true values.
        estimates, errors, low, high: of each set, (sets,): value, standard error and interval; NaN for
            what the fit does not determine, and for open ends.
        converged: share of the fits that did.
        covered: share of the intervals that contain the truth; an open end contains all on its side.
        without_interval: share of the fits without any (at a bound, or not determined): not counted.
        without_error: share of those whose tables print no standard error: besides these, where the likelihood is
            skewed. Where it is large, `ratio` is that of errors that are not printed.
        spread: standard deviation of the estimates that have a standard error.
        error: root mean square of the standard errors.
        ratio: standard error over the actual spread.
        bias: mean of the estimates less the truth, in standard errors.
    """

    name: str
    truth: Mapping[str, float]
    estimates: Mapping[str, Float[np.ndarray, " sets"]] = field(repr=False)
    errors: Mapping[str, Float[np.ndarray, " sets"]] = field(repr=False)
    low: Mapping[str, Float[np.ndarray, " sets"]] = field(repr=False)
    high: Mapping[str, Float[np.ndarray, " sets"]] = field(repr=False)
    converged: float
    covered: Mapping[str, float]
    without_interval: Mapping[str, float]
    without_error: Mapping[str, float]
    spread: Mapping[str, float]
    error: Mapping[str, float]
    ratio: Mapping[str, float]
    bias: Mapping[str, float]


def coverage_study(
    cases: Sequence[CoverageCase],
    sets: int = 500,
    seed: int = 0,
    confidence: float = 0.95,
    progress: Callable[[str, int, int], None] | None = None,
) -> list[Coverage]:
    """Simulate every case, fit every set as `fit` does, and count how often intervals contain the truth.

    Raises:
        ValueError: naming the argument, its value and what is accepted.
    """
    check_whole("sets", sets, 1)
    check_whole("seed", seed, 0)
    checked_confidence(confidence)
    return [_study(case, sets, (seed, k), confidence, progress) for k, case in enumerate(cases)]


def _study(case: CoverageCase, sets: int, seed, confidence: float, progress: Any) -> Coverage:
    truth = case.values
    if truth is None:
        exact = case.fit(case.data(), profiles=False)
        derived = [name for name in exact.materials[0].derived if name == "eps_up"]
        truth = {name: exact.values[name] for name in (*exact.covariance_names, *derived)}  # type: ignore[misc]
    rows, converged = [], 0
    is_shared = any(getattr(parameter, "shared", False) for parameter in case.parameters.values())
    at_once = 1 if is_shared else AT_ONCE
    for first in range(0, sets, at_once):
        several = [
            replace(case.data(np.random.default_rng((*seed, k))), name=f"set {k}")
            for k in range(first, min(first + at_once, sets))
        ]
        result = case.fit(several, confidence=confidence)
        for material in result.materials:
            converged += material.converged
            label = "{}" if len(several) == 1 else f"{{}}[{material.name}]"
            estimates = [result.estimates[label.format(name)] for name in truth]
            rows.append(
                [(e.value, e.standard_error, e.low, e.high, e.printed_error) for e in estimates]
            )
        if progress is not None:
            progress(case.name, len(rows), sets)
    x, errors, low, high, printed = np.array(rows, float).transpose(2, 1, 0)  # None becomes NaN
    is_open = np.isnan(low) & np.isnan(high)
    true = np.array(list(truth.values()), float)[:, None]
    inside = np.where(is_open, np.nan, ~(low > true) & ~(high < true))
    known = np.where(np.isfinite(errors), x, np.nan)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # no set determines it, or it is one set
        covered, error = np.nanmean(inside, axis=1), np.nanmean(errors**2, axis=1) ** 0.5
        spread, bias = np.nanstd(known, axis=1), np.nanmean(known - true, axis=1) / error
        missing = np.mean(is_open, axis=1), np.mean(np.isnan(printed), axis=1)
        statistics = covered, *missing, spread, error, error / spread, bias
    x, errors, low, high = (dict(zip(truth, a, strict=True)) for a in (x, errors, low, high))
    shares = (dict(zip(truth, column.tolist(), strict=True)) for column in statistics)
    return Coverage(case.name, truth, x, errors, low, high, converged / sets, *shares)
