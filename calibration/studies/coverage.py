"""Do confidence intervals hold the truth as often as they say? All data sets of a case fitted side by side.

Each case takes a law's own curve (for `two-step` Eq. 17's), adds Gaussian noise many times, fits
every set as `fit` does, and counts how often each parameter's interval holds the truth: the value
that the same fit finds without noise. Estimates, standard errors and profiles are the fit's own.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

import softjax as sj
from calibration.data import RestitutionData
from calibration.data.checks import check_whole, checked_confidence
from calibration.fitting.component_fit import ComponentFit, fit_component
from calibration.fitting.noise import in_units
from calibration.fitting.problem import Lanes
from calibration.fitting.refits import settled
from calibration.fitting.request import Request
from calibration.fitting.search import Found, search
from calibration.fitting.uncertainty import Settled, quantile, stacked
from calibration.options import FitOptions

PLAIN = FitOptions(optimiser="levenberg-marquardt", starts=1)


@dataclass(frozen=True)
class CoverageCase:
    """One simulated experiment: a known law, measured with independent, equal errors.

    Attributes:
        name: of the case, in tables.
        truth: the law whose curve is measured.
        velocity: of the impacts [m/s].
        law, parameters, objective: what is fitted, as `fit` takes it; the truth's own class where
            left out, each search starting at the truth.
        noise: standard deviation of ε.
        stated: whether the fit knows it.
        contact: the two bodies, where the truth is a law without them.
    """

    name: str
    truth: sj.ContactLaw
    velocity: Any
    law: Any = None
    parameters: Mapping[str, Any] = field(default_factory=dict)
    objective: str = "model"
    noise: float = 0.005
    stated: bool = False
    contact: sj.Contact | None = None

    def data(self) -> RestitutionData:
        """The noise-free measurements."""
        velocity = np.asarray(self.velocity, float)
        restitution = np.asarray(sj.restitution(self.truth, velocity).coefficient)
        stated = np.asarray(self.noise) if self.stated else None
        contact = self.contact or getattr(self.truth, "contact", None)
        limit = getattr(self.truth, "limit_velocity", None)
        return RestitutionData(
            velocity, restitution, contact, stated, self.name, limit_velocity=limit
        )


@dataclass(frozen=True)
class Coverage:
    """What came out of one case; arrays by parameter label.

    Attributes:
        name, sets: what was simulated, and how often.
        converged: share of the fits that did.
        covered: share of the confidence intervals that hold the truth.
        by_error: share of the intervals from standard errors alone that do.
        spread, error: standard deviation of the estimates, and root mean square of the standard
            errors, both in z (log units for most).
        estimates, errors: of each set, in z.
    """

    name: str
    sets: int
    converged: float
    covered: dict[str, float]
    by_error: dict[str, float]
    spread: dict[str, float]
    error: dict[str, float]
    estimates: dict[str, Float[np.ndarray, "sets"]]
    errors: dict[str, Float[np.ndarray, "sets"]]

    @property
    def ratio(self) -> dict[str, float]:
        """Root mean square standard error over the actual spread."""
        return {name: self.error[name] / self.spread[name] for name in self.error}


def coverage_study(
    cases: Sequence[CoverageCase], sets: int = 500, seed: int = 0, confidence: float = 0.95
) -> list[Coverage]:
    """Simulate every case, and count how often its intervals hold the truth.

    Raises:
        ValueError: naming the argument, its value and what is accepted.
    """
    check_whole("sets", sets, 1)
    check_whole("seed", seed, 0)
    checked_confidence(confidence)

    with jax.enable_x64(True), np.errstate(divide="ignore", invalid="ignore"):
        return [_study(case, sets, (seed, k), confidence) for k, case in enumerate(cases)]


def _simulated(case: CoverageCase, sets: int, seed) -> Float[np.ndarray, "sets n"]:
    """Noisy restitutions around the noise-free ones."""
    curve = case.data().restitution
    noise = np.random.default_rng(seed).standard_normal((sets, len(curve)))
    return np.maximum(curve + case.noise * noise, 0.0)


def _study(case: CoverageCase, sets: int, seed, confidence: float) -> Coverage:
    law = case.law or type(case.truth)
    exactly = sj.EnergyBalance() if case.objective == "two-step" else None
    options = FitOptions.of(law=law, objective=case.objective, route=exactly)
    ideal = Request((case.data(),), case.parameters, options)
    component = ideal.components()[0]
    exact = fit_component(component, PLAIN)
    drawn = _simulated(case, sets, seed)
    lanes = Lanes(drawn, None if case.stated else np.ones(drawn.shape))
    begin = np.repeat(exact.z[None], sets, axis=0)
    z, stages, arrived, lanes = settled((stage.problem for stage in exact.stages), begin, lanes)
    lanes = in_units(stages[0].problem, z, lanes)
    known = stacked(stages, z, lanes)
    reach = quantile(confidence, known.degrees)
    off = np.abs(z - exact.z) <= reach * known.errors
    held = off if len(stages) > 1 else _profiled(exact, stages[0], z, lanes, reach)
    labels = [e.label for e in component.elements]
    by = lambda table: {label: table[:, k] for k, label in enumerate(labels)}  # noqa: E731
    sound = known.known
    spread = {n: float(np.std(z[sound[:, k], k])) for k, n in enumerate(labels)}
    error = {
        n: float(np.sqrt(np.mean(known.errors[sound[:, k], k] ** 2))) for k, n in enumerate(labels)
    }
    return Coverage(
        name=case.name,
        sets=sets,
        converged=float(np.mean(arrived)),
        covered={n: float(np.mean(v)) for n, v in by(held).items()},
        by_error={n: float(np.mean(v)) for n, v in by(off).items()},
        spread=spread,
        error=error,
        estimates=by(z),
        errors=by(known.errors),
    )


def _profiled(exact: ComponentFit, stage: Settled, z, lanes: Lanes, reach):
    """Which likelihood intervals hold the truth: those in which the cost there is low enough."""
    problem, held = stage.problem, np.zeros(z.shape, bool)
    lowest = problem.linearise(z, lanes, slopes=False).cost
    for column, k in enumerate(problem.active):
        risen = np.min(
            [found.cost for found in _at_truth(exact, problem, z, lanes, column)], axis=0
        )
        held[:, k] = 2 * (risen - lowest) <= reach[:, k] ** 2
    return held


def _at_truth(exact: ComponentFit, problem, z, lanes: Lanes, column: int) -> list[Found]:
    """One element at the truth, the others searched from where they were, and from the truth."""
    k = problem.active[column]
    mask = np.zeros((len(z), len(problem.active)), bool)
    mask[:, column] = True
    starts = []
    for start in (z, np.repeat(exact.z[None], len(z), axis=0)):
        moved = np.array(start)
        moved[:, k] = exact.z[k]
        starts.append(search(problem, moved, held=mask, lanes=lanes))
    return starts
