"""How large the errors of ε are: what weighs each point, and what is not known of it.

    var_i = u_i² + (dε/dv u_v,i)²      u stated, u_v where the velocities have an uncertainty
    var_i = s_g² + (dε/dv u_v,i)²      where nothing is stated: s_g of each data set is estimated

Points without stated uncertainties weigh one as long as nothing else is weighed against them: a
prior, data sets that share a parameter, uncertainties of the velocities. Then s_g is one more
unknown, estimated jointly with the parameters. Points that share errors (groups, bounce trains) are
whitened instead: see `set_errors`.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from calibration.data import RestitutionData
from calibration.fitting.latent import STEP, Curve, Latent, moved, not_moved, residual
from calibration.fitting.losses import MAD
from calibration.fitting.plan import ErrorPlan
from calibration.fitting.pooling import respread
from calibration.fitting.problem import Lanes, Problem
from calibration.fitting.set_errors import SetErrors, Structure
from calibration.fitting.variances import Seen, estimated

LEAST = 1e-4  # of the scatter that is always ε's own, whatever the velocities explain


@dataclass(frozen=True)
class Noise:
    """Errors of ε at each point of a problem, of fits side by side.

    Attributes:
        deviation: standard deviation, (fits, points).
        left: residual degrees of freedom of each data set, (fits, sets).
    """

    deviation: Float[np.ndarray, "fits points"]
    left: Float[np.ndarray, "fits sets"]


def first_weights(problem: Problem, z: np.ndarray) -> Problem:
    """The problem with weights to begin with: what is stated, and what z leaves unexplained."""
    plans = problem.plans
    if all(_stands_alone(problem, g) for g in range(len(plans))):
        return problem.weighed(np.ones(problem.count))
    plain = replace(problem, shared=None)
    return problem.weighed(_weights(plain, z))


def needs_weights(problem: Problem) -> bool:
    """Whether weights depend on where the fit is."""
    alone = all(_stands_alone(problem, g) for g in range(len(problem.plans)))
    stated = all(plan.stated for plan in problem.plans)
    moving = any(p.shares or _has_errors(d) for p, d in _sets(problem)) or bool(problem.pools)
    return not (alone or stated) or moving


def reweighed(problem: Problem, z: np.ndarray) -> Problem:
    """The problem with weights, shared errors, true velocities and spreads of pools as of z."""
    return respread(_reweighed(problem, z), z)


def _reweighed(problem: Problem, z: np.ndarray) -> Problem:
    if any(_has_errors(data) for data in problem.datasets):
        problem = _with_velocities(problem, z)
    if any(plan.shares for plan in problem.plans):
        return _with_shared(problem, z)
    return problem.weighed(_weights(problem, z))


def noise_of(problem: Problem, z: np.ndarray, lanes: Lanes | None = None) -> Noise:
    """As stated; where something is not, from the residuals at z, data set by data set."""
    lanes = lanes or Lanes()
    found = replace(problem, loss="squared").linearise(z, lanes)
    leverage = leverages(found.jacobian)[:, : problem.count]
    sets = [problem.points.set == g for g in range(len(problem.datasets))]
    left = np.stack([np.maximum(np.sum(o) - np.sum(leverage[:, o], 1), 1.0) for o in sets], 1)
    if problem.shared is not None:
        diagonal = np.sqrt(np.concatenate([one.diagonal for one in problem.shared]))
        return Noise(np.broadcast_to(diagonal, leverage.shape), left)
    measured = problem.points.restitution if lanes.restitution is None else lanes.restitution
    off = found.prediction - measured
    deviation = np.ones(off.shape)
    for g, plan in enumerate(problem.plans):
        known = known_variances(problem, g)
        each = zip(off[:, sets[g]], left[:, g], strict=True)
        levels = [level(plan, r, known, n, problem.loss != "squared") for r, n in each]
        scatter, factor = np.array(levels).T[:, :, None]
        deviation[:, sets[g]] = np.sqrt(scatter + factor * known)
    return Noise(deviation, left)


def leverages(jacobian: Float[np.ndarray, "fits m p"]) -> Float[np.ndarray, "fits m"]:
    """Diagonal of J (JᵀJ)⁺ Jᵀ: how many parameters each residual pays for."""
    if not jacobian.shape[2]:
        return np.zeros(jacobian.shape[:2])
    size = np.linalg.norm(jacobian, axis=1, keepdims=True)
    scaled = jacobian / np.where(size > 0, size, 1.0)
    left, singular, _ = np.linalg.svd(scaled, full_matrices=False)
    seen = singular > 1e-9 * np.max(singular, axis=1, keepdims=True)
    return np.einsum("fmp,fp->fm", left**2, seen.astype(float))


def seen_by(problem: Problem, z: np.ndarray) -> list[Seen]:
    """What judges the variances of each data set at z of one fit."""
    bare = replace(problem, shared=None, loss="squared").weighed(np.ones(problem.count))
    raw, weighted = bare.linearise(z[None]), problem.linearise(z[None])
    count = problem.count
    every = []
    for g in range(len(problem.datasets)):
        own = problem.points.set == g
        others = np.concatenate([~own, np.ones(weighted.residual.shape[1] - count, bool)])
        slopes, off = weighted.jacobian[0, others], weighted.residual[0, others]
        part = raw.jacobian[0, :count][own]
        every.append(Seen(raw.residual[0, :count][own], part, slopes.T @ slopes, slopes.T @ off))
    return every


def _sets(problem: Problem):
    return list(zip(problem.plans, problem.datasets, strict=True))


def _has_errors(data: RestitutionData) -> bool:
    return data.velocity_uncertainty is not None or data.errors.size_is_unknown


def _stands_alone(problem: Problem, g: int) -> bool:
    """No stated uncertainties, and nothing that is weighed against the points."""
    priors = bool(problem.pools) or any(e.parameter.prior is not None for e in problem.elements)
    several = problem.joint and len(problem.datasets) > 1
    return problem.plans[g].plain and not (priors or several)


def _weights(problem: Problem, z: np.ndarray) -> Float[np.ndarray, "points"]:
    weight = 1 / noise_of(problem, z[None]).deviation[0]
    for g, (plan, data) in enumerate(_sets(problem)):
        if plan.separate:
            weight[problem.points.set == g] = _evened(data)
    return weight


def _evened(data: RestitutionData) -> Float[np.ndarray, "n"]:
    """Weights of means whose uncertainties are each from few repeats: as if all had one scatter."""
    counts = np.asarray(data.degrees) + 1.0
    assert data.uncertainty is not None
    scatter = np.sum(data.degrees * data.uncertainty**2 * counts) / np.sum(data.degrees)
    return np.sqrt(counts / scatter)


def known_variances(problem: Problem, g: int) -> Float[np.ndarray, "n"]:
    """The part of a data set's variances that is stated, those of the velocities included."""
    data, at = problem.datasets[g], None if problem.latent is None else problem.latent[g]
    errors, slope = (data.errors, 0.0) if at is None else (at.errors, at.slope)
    if data.errors.size_is_unknown:
        return np.zeros(len(data))
    return errors.covariance(slope).diagonal


def errors_of(problem: Problem, g: int) -> SetErrors:
    """V of a data set where its points are taken to be, with the variances found so far."""
    data, at = problem.datasets[g], None if problem.latent is None else problem.latent[g]
    errors, slope = (data.errors, np.zeros(len(data))) if at is None else (at.errors, at.slope)
    group = data.group_index if "group" in problem.plans[g].unknown else None
    before = {} if problem.shared is None else problem.shared[g].variance
    return SetErrors(Structure(errors, slope, group), before)


def level(plan: ErrorPlan, residual, known, left: float, robust: bool = False):
    """s² and κ of variances s² + κ known, from residuals with `left` degrees of freedom."""
    if "scale" in plan.unknown:
        return 0.0, max(float(np.sum(residual**2 / known)) / left, 1e-300)
    if "scatter" not in plan.unknown:
        return 0.0, 1.0
    return _scatter(residual, known, left, robust), 1.0


def _scatter(residual, known, left: float, robust: bool) -> float:
    """s² with Σ r²/(s² + known) equal to the degrees of freedom (Paule and Mandel).

    A robust loss takes the median absolute deviation.
    """
    if robust:
        whole = (MAD * float(np.median(np.abs(residual)))) ** 2
        return max(whole - float(np.median(known)), LEAST * whole, 1e-300)
    squares = residual**2
    plain = float(np.sum(squares)) / left
    if not np.any(known):
        return max(plain, 1e-300)
    from scipy.optimize import brentq

    excess = lambda s: float(np.sum(squares / (s + known))) - left  # noqa: E731
    least = LEAST * plain
    return least if excess(least) <= 0 else float(brentq(excess, least, plain, rtol=1e-12))


def _with_shared(problem: Problem, z: np.ndarray) -> Problem:
    """The variances of what points share, from the residuals at z."""
    fresh = problem.shared is None
    problem = problem.weighed(np.ones(problem.count)) if not fresh else problem
    found = []
    for g, (plan, seen) in enumerate(zip(problem.plans, seen_by(problem, z), strict=True)):
        errors = errors_of(problem, g)
        variance = estimated(errors, seen, plan.unknown) if plan.unknown else {}
        found.append(errors.with_variance(variance))
    return replace(problem.weighed(np.ones(problem.count)), shared=tuple(found))


def _with_velocities(problem: Problem, z: np.ndarray) -> Problem:
    """Points moved to their true velocities as far as z tells them."""
    curves = _curves(problem, z)
    found = []
    for g, (plan, data) in enumerate(_sets(problem)):
        own = problem.points.set == g
        if problem.latent is None or not plan.moves:
            found.append(not_moved(data, curves[g].slope))
            continue
        at = problem.latent[g]
        off = residual(data, at, curves[g])
        if problem.shared is None:
            weight = problem.points.weight[own] ** 2
            solved, variance = weight * off, 1 / weight
        else:
            solved = problem.shared[g].solved(off[:, None])[:, 0]
            variance = problem.shared[g].diagonal
        found.append(moved(data, at, curves[g], solved, variance))
    return placed(problem, tuple(found))


def placed(problem: Problem, latent: tuple[Latent, ...]) -> Problem:
    """The points where they are taken to be."""
    points = problem.points._replace(
        velocity=np.concatenate([one.velocity for one in latent]),
        restitution=np.concatenate([one.target for one in latent]),
    )
    return replace(problem, points=points, latent=latent)


def _curves(problem: Problem, z: np.ndarray) -> list[Curve]:
    """ε and its derivatives at the points, each on the branch that it is on."""
    velocity = problem.points.velocity
    limit = problem.yields_at(z)
    measured = np.concatenate([data.velocity for data in problem.datasets])
    elastic = None if limit is None else measured <= limit
    held = replace(problem, elastic=elastic)
    at = [held.at_velocity(velocity * (1 + k * STEP)).predict(z[None])[0] for k in (-1, 0, 1)]
    down, value, up = at
    slope = (up - down) / (2 * STEP * velocity)
    bend = (up - 2 * value + down) / (STEP * velocity) ** 2
    lowest = np.zeros(len(velocity))
    ends = [np.broadcast_to(np.asarray(_limit(d)), len(d)) for d in problem.datasets]
    highest = np.concatenate(ends) * (1 - 1e-9)
    if limit is not None:
        lowest = np.where(measured > limit, limit * (1 + 1e-9), 0.0)
        highest = np.where(measured <= limit, np.minimum(limit, highest), highest)
    rows = [problem.points.set == g for g in range(len(problem.datasets))]
    return [Curve(value[o], slope[o], bend[o], lowest[o], highest[o]) for o in rows]


def as_measured(problem: Problem, z: np.ndarray) -> Problem:
    """The problem at the measured velocities, whose errors are carried into ε by dε/dv at z."""
    if problem.latent is None:
        return problem
    at = placed(problem, tuple(not_moved(data, np.zeros(len(data))) for data in problem.datasets))
    limit = at.yields_at(z)
    if limit is not None:
        at = replace(at, elastic=at.points.velocity <= limit)
    return with_slopes(at, slopes_at(at, z[None])[0])


def with_slopes(problem: Problem, slope: Float[np.ndarray, "points"]) -> Problem:
    """A problem at the measured velocities with these dε/dv of the curve."""
    ends = np.cumsum([len(data) for data in problem.datasets])[:-1]
    pairs = zip(problem.datasets, np.split(slope, ends), strict=True)
    at = replace(problem, latent=tuple(not_moved(data, own) for data, own in pairs))
    if problem.shared is None:
        return at
    return replace(at, shared=tuple(errors_of(at, g) for g in range(len(at.datasets))))


def slopes_at(problem: Problem, z: Float[np.ndarray, "fits p"]) -> Float[np.ndarray, "fits points"]:
    """dε/dv at the points, each on the branch that it is on, by differences of fourth order."""
    velocity = problem.points.velocity
    far_down, down, up, far_up = (
        problem.at_velocity(velocity * (1 + k * STEP)).predict(z) for k in (-2, -1, 1, 2)
    )
    return (8 * (up - down) - (far_up - far_down)) / (12 * STEP * velocity)


def _limit(data: RestitutionData):
    return np.inf if data.limit_velocity is None else data.limit_velocity
