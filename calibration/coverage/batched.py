"""All data sets of a case fitted side by side.

Each case takes a law's own curve (for `two-step` Eq. 17's), adds Gaussian noise many times, fits
every set as `fit` does, and counts how often each parameter's interval holds the truth: the value
that the same fit finds without noise. Estimates, standard errors and profiles are the fit's own.
"""

from collections.abc import Sequence

import jax
import numpy as np
from jaxtyping import Float

import softjax as sj
from calibration.coverage.cases import Case, standard_cases
from calibration.coverage.table import Coverage
from calibration.data.checks import check_whole, checked_confidence
from calibration.fitting.component_fit import ComponentFit, fit_component
from calibration.fitting.problem import Lanes
from calibration.fitting.refits import settled
from calibration.fitting.request import Request
from calibration.fitting.search import Found, search
from calibration.fitting.stages import Options
from calibration.fitting.uncertainty import Settled, Uncertainty, quantile, stacked

PLAIN = Options(optimiser="levenberg-marquardt", starts=1)


def coverage_study(
    cases: Sequence[Case] | None = None,
    sets: int = 500,
    seed: int = 0,
    confidence: float = 0.95,
) -> list[Coverage]:
    """Simulate every case.

    Raises:
        ValueError: naming the argument, its value and what is accepted.
    """
    check_whole("sets", sets, 1)
    check_whole("seed", seed, 0)
    checked_confidence(confidence)
    cases = standard_cases() if cases is None else list(cases)

    with jax.enable_x64(True), np.errstate(divide="ignore", invalid="ignore"):
        return [_study(case, sets, (seed, k), confidence) for k, case in enumerate(cases)]


def simulated(case: Case, sets: int, seed) -> Float[np.ndarray, "sets n"]:
    """Noisy restitutions around the noise-free ones."""
    curve = case.data().restitution
    noise = np.random.default_rng(seed).standard_normal((sets, len(curve)))
    return np.maximum(curve + case.noise * noise, 0.0)


def _study(case: Case, sets: int, seed, confidence: float) -> Coverage:
    law = case.law or type(case.truth)
    exactly = sj.EnergyBalance() if case.objective == "two-step" else None
    ideal = Request((case.data(),), law, case.parameters, case.objective, exactly)
    component = ideal.components()[0]
    exact = fit_component(component, PLAIN)
    lanes = Lanes(restitution=simulated(case, sets, seed))
    begin = np.repeat(exact.z[None], sets, axis=0)
    z, stages, arrived = settled((stage.problem for stage in exact.stages), begin, lanes)
    known = stacked(stages, z, lanes)
    reach = quantile(confidence, known.degrees)
    off = np.abs(z - exact.z) <= reach * known.errors
    held = off if len(stages) > 1 else _profiled(exact, stages[0], z, lanes, known, reach)
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


def _profiled(exact: ComponentFit, stage: Settled, z, lanes: Lanes, known: Uncertainty, reach):
    """Which likelihood intervals hold the truth: those in which the cost there is low enough."""
    problem, held = stage.problem, np.zeros(z.shape, bool)
    lowest = np.sum(problem.linearise(z, lanes, slopes=False).residual ** 2, axis=1)
    variance = (known.noise.deviation[:, 0] * problem.points.weight[0]) ** 2
    for column, k in enumerate(problem.active):
        risen = np.min(
            [found.cost for found in _at_truth(exact, problem, z, lanes, column)], axis=0
        )
        held[:, k] = (2 * risen - lowest) / variance <= reach[:, k] ** 2
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
