"""Do the intervals hold the truth as often as they say? A simulation, in one batched computation.

    python -m calibration.coverage            # 1000 data sets a case
    python -m calibration.coverage --sets 200 --seed 1

Each case takes a noise-free curve of a material of Table 1, adds Gaussian noise many times
(unclipped), fits every one and counts how often each parameter's interval holds the truth: the value
that the same objective finds on the noise-free curve. The noise's size is not told to the fit. The
curve is Eq. (17) for `two-step`; for `model` it is the model itself with the χ̃ that follows Eq. (17)
best, because the misfit of the two would be counted as noise.

Estimates, standard errors and profiles are those of `calibration.fitting` through the energy balance,
for all sets of a case at once (`calibration.batch`); a test compares them set by set.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass

import jax
import numpy as np

from calibration.assemble import Setup, assemble
from calibration.batch import Batch, minimise
from calibration.data.measurements import RestitutionData
from calibration.data.paper import CURVES, RADIUS, PaperCurve
from calibration.doubt import SEPARATE
from calibration.empirical import eq_17
from calibration.uncertainty import DIFFERENCE, quantile

ROUGH_STEPS = 40  # enough to see whether a profile stays low
NAMES = ("chi", "sigma", "psi")
FOLLOWING_CHI = {"stainless steel": 1.7944, "chrome steel": 0.09867, "nylon": 0.21998}


@dataclass(frozen=True)
class Case:
    """One simulated experiment."""

    material: str
    objective: str
    noise: float = 0.01
    points: int = 30
    below: int = 0  # how many of them below the critical velocity
    profiles: tuple[str, ...] = ("sigma", "psi")  # whose likelihood is profiled


CASES = tuple(
    case
    for curve in CURVES[:2]
    for case in (
        Case(curve.name, "two-step"),
        Case(curve.name, "model", below=10, profiles=("chi",)),  # σ and ψ are not separate
        Case(curve.name, "model", noise=0.001, below=10, profiles=("chi", "sigma", "psi")),
    )
)


@dataclass(frozen=True)
class Coverage:
    """What came out of one case.

    Attributes:
        case, sets: what was simulated, and how often.
        converged: share of the fits that converged.
        covered: share of intervals from standard errors that hold the truth, by parameter.
        profiled: the same of profile-likelihood intervals, where there are any.
        not_separate: share of the fits in which σ and ψ are said not to be separate.
        estimates, errors: (sets,) by parameter: values, and standard errors in log units.
    """

    case: Case
    sets: int
    converged: float
    covered: dict[str, float]
    profiled: dict[str, float]
    not_separate: float
    estimates: dict[str, np.ndarray]
    errors: dict[str, np.ndarray]


def coverage_study(
    cases: Sequence[Case] = CASES, sets: int = 1000, seed: int = 0, confidence: float = 0.95
) -> list[Coverage]:
    """Simulate every case; 1000 sets of all six take well under a minute."""
    # a set whose σ or ψ ran to its limit has a standard error of 0 or infinity
    with jax.enable_x64(True), np.errstate(divide="ignore", invalid="ignore"):
        return [_study(case, sets, (seed, k), confidence) for k, case in enumerate(cases)]


def simulated(case: Case, sets: int, seed) -> tuple[RestitutionData, np.ndarray]:
    """The noise-free data set, and (sets, points) noisy restitutions."""
    data = noise_free(case)
    random = np.random.default_rng(seed)
    return data, data.restitution + case.noise * random.normal(size=(sets, len(data)))


def noise_free(case: Case) -> RestitutionData:
    """The curve at velocities equally spaced below and above the critical one."""
    import softjax as sj

    curve = _curve(case.material)
    contact = sj.Contact.between_spheres(curve.material, curve.material, RADIUS, RADIUS)
    steps = np.arange(1, case.points - case.below + 1) / (case.points - case.below)
    below = np.arange(1, case.below + 1) / (case.below + 1)
    y = np.concatenate([below, 1 + steps * (curve.y_end - 1)])
    velocity = y * float(contact.critical_velocity)
    if case.objective == "model":
        law = sj.Zhou(contact, FOLLOWING_CHI[case.material], curve.sigma, curve.psi)
        ideal = np.asarray(sj.restitution(law, velocity).coefficient)
    else:
        ideal = eq_17(velocity, float(contact.limit_velocity), curve.sigma, curve.psi)
    return RestitutionData(velocity, ideal, contact, name=case.material)


def _curve(name: str) -> PaperCurve:
    return next(curve for curve in CURVES if curve.name == name)


def _study(case: Case, sets: int, seed, confidence: float) -> Coverage:
    data, noisy = simulated(case, sets, seed)
    setup = assemble([data], case.objective, None)
    start = _start(setup, case)
    truth = _fit_all(Batch(setup, data.restitution[None]), start, start, case)
    found = _fit_all(Batch(setup, noisy), truth["z"][0], truth["z"][0], case)
    return _counted(case, setup, found, truth["z"][0], confidence, len(data))


def _start(setup: Setup, case: Case) -> np.ndarray:
    """z of the published σ and ψ, and of X = 10."""
    curve = _curve(case.material)
    z = setup.layout.start()
    for e in setup.elements:
        known = {"sigma": curve.sigma, "psi": curve.psi}
        if e.column in known:
            z[e.position] = np.log(known[e.column])
    return z


def _fit_all(batch: Batch, start, truth, case: Case) -> dict[str, np.ndarray]:
    """z, covariance in z and profile rises of (χ̃, σ, ψ) for every set."""
    chi, sigma, psi = (batch.setup.positions((name,), (case.objective,)) for name in NAMES)
    order = np.concatenate([chi, sigma, psi])
    z = np.tile(start, (batch.sets, 1))
    if case.objective == "model":
        z, squares, good = minimise(batch, z, order, "model")
        variance = squares / (batch.points - 3)
        covariance = _least_squares_covariance(batch, z, order) * variance[:, None, None]
    else:
        z, squares, good = minimise(batch, z, order[1:], "empirical")
        variance = squares / (batch.points - 2)
        z, _, also = minimise(batch, z, order[:1], "model")
        good &= also
        covariance = _sandwich(batch, z, order) * variance[:, None, None]
    rise = np.full((batch.sets, len(NAMES)), np.nan)
    for k, name in enumerate(NAMES):
        if name in case.profiles:
            kind, own = ("model", order) if case.objective == "model" else ("empirical", order[1:])
            risen = _rise(batch, z, truth, own, order[k], kind)
            rise[:, k] = (risen - squares) / variance
    found = {"z": z, "x": z[:, order], "covariance": covariance, "rise": rise, "good": good}
    if case.objective == "model":
        found["open"] = _reaches_far(batch, z, order, squares, variance)
    return found


def _reaches_far(batch: Batch, z, order, squares, variance) -> np.ndarray:
    """Whether the profile of σ or ψ is still low where 4 `SEPARATE` standard errors would end."""
    reach = quantile(0.95, batch.points - 3) ** 2
    low = np.zeros(batch.sets, bool)
    for k in (1, 2):
        for sign in (-1, 1):
            held = np.array(z)
            held[:, order[k]] += sign * 4 * SEPARATE
            rest = minimise(batch, held, np.delete(order, k), "model", ROUGH_STEPS)[1]
            low |= (rest - squares) / variance < reach
    return low


def _least_squares_covariance(batch: Batch, z, order) -> np.ndarray:
    _, jacobian = batch.linearise(z, order, "model")
    return np.linalg.pinv(np.swapaxes(jacobian, 1, 2) @ jacobian, rcond=1e-15)


def _sandwich(batch: Batch, z, order) -> np.ndarray:
    """As `uncertainty.stacked`: Eq. (17)'s step, then the model's, over the noise's variance."""
    _, first = batch.linearise(z, order[1:], "empirical")
    _, second = batch.linearise(z, order[:1], "model")
    scores = np.concatenate([second, first], axis=2)
    bread = np.zeros((batch.sets, 3, 3))
    bread[:, 1:, 1:] = np.swapaxes(first, 1, 2) @ first
    for k, position in enumerate(order):
        bread[:, 0, k] = _score_slope(batch, z, order[:1], position)
    inverse = np.linalg.inv(bread)
    return inverse @ (np.swapaxes(scores, 1, 2) @ scores) @ np.swapaxes(inverse, 1, 2)


def _score_slope(batch: Batch, z, active, position) -> np.ndarray:
    """Derivative of the gradient in χ̃ along an element, by the differences of the fit."""

    def score(step):
        moved = np.array(z)
        moved[:, position] += step
        value, jacobian = batch.linearise(moved, active, "model")
        return np.einsum("sn,sn->s", jacobian[:, :, 0], value)

    h = DIFFERENCE
    return (8 * (score(h) - score(-h)) - (score(2 * h) - score(-2 * h))) / (12 * h)


def _rise(batch: Batch, z, truth, order, held_position, kind) -> np.ndarray:
    """The sum of squares with one element held at the truth, the others refitted from two starts."""
    others = order[order != held_position]
    squares = []
    for begin in (z, np.broadcast_to(truth, z.shape)):
        held = np.array(begin)
        held[:, held_position] = truth[held_position]
        squares.append(minimise(batch, held, others, kind)[1])
    return np.minimum(*squares)


def _true_eps_up(setup, z) -> tuple[np.ndarray, np.ndarray]:
    """ε_up of each z (sets, elements), and its slopes in (ln χ̃, ln σ, ln ψ)."""
    position = {e.column: e.position for e in setup.elements}
    sigma, psi = np.exp(z[:, position["sigma"]]), np.exp(z[:, position["psi"]])
    contact = setup.datasets[0].contact
    critical, limit = float(contact.critical_velocity), float(contact.limit_velocity)
    ratio = critical / (limit - critical)
    loss = sigma * ratio**psi
    up = np.exp(-loss)
    slope = np.stack([0 * loss, -loss * up, -loss * up * psi * np.log(ratio)], axis=1)
    return up, slope


def _counted(case, setup, found, truth, confidence, n) -> Coverage:
    """Which share of the intervals holds the truth."""
    names = NAMES
    order = [next(e.position for e in setup.elements if e.column == name) for name in names]
    reach = quantile(confidence, n - (2 if case.objective == "two-step" else 3))
    errors = np.sqrt(np.diagonal(found["covariance"], axis1=1, axis2=2))
    off = np.abs(found["x"] - truth[order]) / errors
    covered = {name: float(np.mean(off[:, i] <= reach)) for i, name in enumerate(names)}
    estimates = {name: np.exp(found["x"][:, i]) for i, name in enumerate(names)}
    spreads = {name: errors[:, i] for i, name in enumerate(names)}
    up, slope = _true_eps_up(setup, found["z"])
    up_error = np.sqrt(np.einsum("si,sij,sj->s", slope, found["covariance"], slope))
    true_up = _true_eps_up(setup, truth[None])[0]
    covered["eps_up"] = float(np.mean(np.abs(up - true_up) <= reach * up_error))
    estimates["eps_up"], spreads["eps_up"] = up, up_error
    profiled = {
        name: float(np.mean(found["rise"][:, i] <= reach**2))
        for i, name in enumerate(names)
        if np.all(np.isfinite(found["rise"][:, i]))
    }
    apart = (np.max(errors[:, 1:], axis=1) <= SEPARATE) & ~found.get("open", False)
    return Coverage(
        case=case,
        sets=len(up),
        converged=float(np.mean(found["good"])),
        covered=covered,
        profiled=profiled,
        not_separate=float(np.mean(~apart)) if case.objective == "model" else 0.0,
        estimates=estimates,
        errors=spreads,
    )


def report(study: Sequence[Coverage]) -> str:
    """The study as a table: per cent of intervals that hold the truth."""
    lines = [f"{'material':16}{'objective':11}{'noise':>7}{'below':>6}  per cent covered (profile)"]
    for one in study:
        case = one.case
        parts = []
        for name, share in one.covered.items():
            profiled = one.profiled.get(name)
            beside = "" if profiled is None else f" ({100 * profiled:.1f})"
            parts.append(f"{name} {100 * share:.1f}{beside}")
        notes = (
            f"; not separate {100 * one.not_separate:.0f} %, converged {100 * one.converged:.1f} %"
        )
        lines.append(
            f"{case.material:16}{case.objective:11}{case.noise:7g}{case.below:6}  "
            + ", ".join(parts)
            + notes
        )
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """The documented command."""
    parser = argparse.ArgumentParser(prog="python -m calibration.coverage", description=__doc__)
    parser.add_argument("--sets", type=int, default=1000, help="simulated data sets a case")
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args(arguments)
    print(report(coverage_study(sets=chosen.sets, seed=chosen.seed)))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
