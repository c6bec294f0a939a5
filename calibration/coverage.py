"""Do the intervals hold the truth as often as they say? Simulated, all data sets side by side.

    python -m calibration.coverage            # 500 data sets a case
    python -m calibration.coverage --sets 200 --seed 1 --case viscoelastic

Each case takes a law's own curve (for `two-step` Eq. 17's), adds Gaussian noise many times, fits
every set as `fit` does, and counts how often each parameter's interval holds the truth: the value
that the same fit finds without noise. Estimates, standard errors and profiles are the fit's own.
"""

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

import softjax as sj
from calibration.data import RestitutionData
from calibration.fitting.assembly import Component
from calibration.fitting.component_fit import ComponentFit, fit_component
from calibration.fitting.problem import Lanes
from calibration.fitting.request import Request
from calibration.fitting.search import Found, search
from calibration.fitting.stages import Options
from calibration.fitting.uncertainty import Settled, Uncertainty, quantile, stacked

PLAIN = Options(optimiser="levenberg-marquardt", starts=1)
STEPS = 200


@dataclass(frozen=True)
class Case:
    """One simulated experiment.

    Attributes:
        name: what tables call it.
        truth: the law whose curve is measured.
        velocity: of the impacts [m/s].
        law, parameters, objective: what is fitted, as `fit` takes it; the truth's own class where
            left out, each search starting at the truth.
        noise: standard deviation of ε.
        stated: whether the fit is told of it.
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

    def data(self, restitution=None) -> RestitutionData:
        """The noise-free measurements, or others at the same velocities."""
        velocity = np.asarray(self.velocity, float)
        if restitution is None:
            restitution = np.asarray(sj.restitution(self.truth, velocity).coefficient)
        told = self.noise if self.stated else None
        contact = self.contact or getattr(self.truth, "contact", None)
        limit = getattr(self.truth, "limit_velocity", None)
        return RestitutionData(
            velocity, restitution, contact, told, self.name, limit_velocity=limit
        )


@dataclass(frozen=True)
class Coverage:
    """What came out of one case; arrays by parameter label.

    Attributes:
        case, sets: what was simulated, and how often.
        converged: share of the fits that did.
        covered: share of the intervals that hold the truth: profiles where there is a likelihood,
            else those from standard errors.
        by_error: share of the intervals from standard errors that do.
        spread, error: standard deviation of the estimates, and root mean square of the standard
            errors, both in z (log units for most).
        estimates, errors: of each set, in z.
    """

    case: Case
    sets: int
    converged: float
    covered: dict[str, float]
    by_error: dict[str, float]
    spread: dict[str, float]
    error: dict[str, float]
    estimates: dict[str, Float[np.ndarray, "sets"]]
    errors: dict[str, Float[np.ndarray, "sets"]]


def coverage_study(
    cases: Sequence[Case] | None = None, sets: int = 500, seed: int = 0, confidence: float = 0.95
) -> list[Coverage]:
    """Simulate every case."""
    cases = standard_cases() if cases is None else cases
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
    z, stages, arrived = _fitted(exact, component, lanes)
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
        case=case,
        sets=sets,
        converged=float(np.mean(arrived)),
        covered={n: float(np.mean(v)) for n, v in by(held).items()},
        by_error={n: float(np.mean(v)) for n, v in by(off).items()},
        spread=spread,
        error=error,
        estimates=by(z),
        errors=by(known.errors),
    )


def _fitted(exact: ComponentFit, component: Component, lanes: Lanes):
    """All sets through all stages: z, the stages, and which of them converged."""
    sets = len(lanes.restitution)  # type: ignore[arg-type]
    z, arrived, settled = np.repeat(exact.z[None], sets, axis=0), np.ones(sets, bool), []
    for stage in exact.stages:
        found = search(stage.problem, z, lanes=lanes, limit=STEPS)
        z, arrived = found.z, arrived & found.converged
        settled.append(Settled(stage.problem, found.limits))
    return z, settled, arrived


def _profiled(exact: ComponentFit, stage: Settled, z, lanes: Lanes, known: Uncertainty, reach):
    """Which likelihood intervals hold the truth: those in which the cost there is low enough."""
    problem, held = stage.problem, np.zeros(z.shape, bool)
    lowest = np.sum(problem.linearise(z, lanes).residual ** 2, axis=1)
    variance = (known.noise.deviation[:, 0] * problem.points.weight[0]) ** 2
    for column, k in enumerate(problem.active):
        risen = np.min([found.cost for found in _at_truth(exact, problem, z, lanes, column)], axis=0)
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
        starts.append(search(problem, moved, held=mask, lanes=lanes, limit=STEPS))
    return starts


def standard_cases(points: Sequence[int] = (8, 30)) -> list[Case]:
    """Every built-in law with free parameters, with and without stated uncertainty."""
    cases = []
    for n in points:
        for case in _laws(n):
            for stated in (False, True):
                told = f"{case.name}, n = {n}" + ", stated" * stated
                cases.append(replace(case, name=told, stated=stated))
    return cases


def _laws(n: int) -> list[Case]:
    from calibration.data.paper import CURVES, RADIUS

    steel, chrome, nylon = (curve.material for curve in CURVES)
    pair = sj.Contact.between_spheres(nylon, nylon, RADIUS, RADIUS)
    critical = float(pair.critical_velocity)
    above = np.geomspace(1.3, 80, n) * critical
    both = np.concatenate([np.linspace(0.1, 0.95, n // 3), np.geomspace(1.3, 80, n - n // 3)])
    zhou = sj.Zhou(pair, 0.22, 0.4355, 0.5414)
    empirical = sj.EmpiricalRestitution(float(pair.limit_velocity), 0.4355, 0.5414)
    spring = float(pair.stiffness) * float(pair.radius) ** 0.5
    return [
        Case("zhou, eps_up", zhou, above),
        Case("zhou, sigma and psi", zhou, both * critical, noise=0.0005),
        Case("zhou, two-step", empirical, above, sj.Zhou, objective="two-step", contact=pair),
        Case("thornton", sj.Thornton(pair, 1.6), above),
        Case("walton-braun", sj.WaltonBraun(pair, spring, 1.2 * spring, 60.0), above),
        Case("viscoelastic", sj.ViscoelasticHertz(pair, 2e-5), above),
        Case("hertz-dashpot", sj.HertzDashpot(pair, 0.8), above),
        Case("linear", sj.LinearSpringDashpot(pair, spring, 0.8), above),
        Case("constant", sj.ConstantRestitution(pair, 0.8), above),
        Case("eq-17", empirical, above),
    ]


def report(study: Sequence[Coverage]) -> str:
    """The study as a table: per cent of intervals that hold the truth, error over spread."""
    lines = []
    for one in study:
        parts = [
            f"{label} {100 * share:.1f} ({one.error[label] / one.spread[label]:.2f})"
            for label, share in one.covered.items()
        ]
        told = f"{', '.join(parts)}; converged {100 * one.converged:.1f} %"
        lines.append(f"{one.case.name:36}{told}")
    return "\n".join(["per cent covered (rms standard error over spread)", *lines])


def main(arguments: Sequence[str] | None = None) -> int:
    """The documented command."""
    parser = argparse.ArgumentParser(prog="python -m calibration.coverage", description=__doc__)
    parser.add_argument("--sets", type=int, default=500, help="simulated data sets a case")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--case", default="", help="only those whose name begins so")
    chosen = parser.parse_args(arguments)
    cases = [case for case in standard_cases() if case.name.startswith(chosen.case)]
    print(report(coverage_study(cases, chosen.sets, chosen.seed)))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
