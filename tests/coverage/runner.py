"""Simulated experiments, fitted as any other: how often do their intervals contain the truth?"""

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

import calibration as cal
import softjax as sj

AT_ONCE = 16  # sets that are fitted side by side


@dataclass(frozen=True)
class Case:
    """One experiment: a law that is measured with independent, equal errors of ε, or `simulate`.

    `law`, `parameters`, `objective` and `options` are those of the fit; `values` are the true ones by label, by
    default those of a fit without noise.
    """

    truth: sj.ContactLaw | None = None
    velocity: Any = None
    law: Any = None
    parameters: Mapping[str, Any] = field(default_factory=dict)
    objective: str = "model"
    noise: float = 0.005
    stated: bool = False  # whether the fit knows the noise
    contact: sj.Contact | None = None  # the two bodies, where the truth is a law without them
    options: Mapping[str, Any] = field(default_factory=dict)
    simulate: Callable[[np.random.Generator], cal.RestitutionData] | None = None
    values: Mapping[str, float] | None = None

    def data(self, random: np.random.Generator | None = None) -> cal.RestitutionData:
        """A simulated data set; without a generator the noise-free one."""
        if self.simulate is not None and random is not None:
            return self.simulate(random)
        restitution = np.asarray(sj.restitution(self.truth, self.velocity).coefficient)
        if random is not None:
            noise = self.noise * random.standard_normal(len(restitution))
            restitution = np.maximum(restitution + noise, 0.0)
        return cal.RestitutionData(
            self.velocity,
            restitution,
            self.contact or getattr(self.truth, "contact", None),
            np.asarray(self.noise) if self.stated else None,
            limit_velocity=getattr(self.truth, "limit_velocity", None),
        )

    def fit(self, data: Any, **options: Any) -> cal.FitResult:
        """Fit one data set, or several side by side."""
        law = type(self.truth) if self.law is None else self.law
        route = sj.EnergyBalance() if self.objective == "two-step" else None
        settings = {"objective": self.objective, "route": route, **self.options, **options}
        return cal.fit(data, law, dict(self.parameters), **settings)

    def true_values(self) -> Mapping[str, float]:
        if self.values is not None:
            return self.values
        exact = self.fit(self.data(), profiles=False)
        derived = [name for name in exact.materials[0].derived if name == "eps_up"]
        return {name: exact.values[name] for name in (*exact.covariance_names, *derived)}


class Sets(NamedTuple):
    """Estimates of one parameter, (sets,): NaN for what a fit does not determine, and for open ends."""

    truth: float
    value: np.ndarray
    error: np.ndarray
    low: np.ndarray
    high: np.ndarray

    @property
    def is_open(self) -> np.ndarray:
        """Sets without an interval: at a bound, or not determined."""
        return np.isnan(self.low) & np.isnan(self.high)

    @property
    def covered(self) -> float:
        """Share of the intervals that contain the truth; an open end contains all on its side."""
        inside = ~(self.low > self.truth) & ~(self.high < self.truth)
        return _mean(np.where(self.is_open, np.nan, inside))

    @property
    def without_error(self) -> float:
        """Share of the sets whose tables print no standard error: skewed, at a bound, or not determined."""
        return float(np.mean(np.isnan(self.error)))

    @property
    def ratio(self) -> float:
        """Root mean square of the standard errors over the actual spread."""
        known = np.isfinite(self.error)
        return _mean(self.error**2) ** 0.5 / np.std(self.value[known])

    @property
    def bias(self) -> float:
        """Mean of the estimates less the truth, in standard errors."""
        known = np.where(np.isfinite(self.error), self.value, np.nan)
        return _mean(known - self.truth) / _mean(self.error**2) ** 0.5


def _mean(values: np.ndarray) -> float:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # no set determines it
        return float(np.nanmean(values))


def study(case: Case, sets: int, seed: Any = (7, 0)) -> tuple[float, dict[str, Sets]]:
    """Share of the fits that converged, and the estimates by label."""
    truth, rows, converged = case.true_values(), [], 0
    for first in range(0, sets, AT_ONCE):
        several = [
            replace(case.data(np.random.default_rng((*seed, k))), name=f"set {k}")
            for k in range(first, min(first + AT_ONCE, sets))
        ]
        result = case.fit(several)
        for material in result.materials:
            converged += material.converged
            label = "{}" if len(several) == 1 else f"{{}}[{material.name}]"
            estimates = [result.estimates[label.format(name)] for name in truth]
            rows.append([(e.value, e.standard_error, e.low, e.high) for e in estimates])
    columns = np.array(rows, float).transpose(1, 2, 0)  # None becomes NaN
    found = {name: Sets(truth[name], *part) for name, part in zip(truth, columns, strict=True)}
    return converged / sets, found
