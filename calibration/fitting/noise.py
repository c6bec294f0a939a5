"""How large the errors of ε are: what weighs each point, and what is not known of it.

    var_i = u_i² + (dε/dv u_v,i)²      u stated, u_v where the velocities have an uncertainty
    var_i = s_g² + (dε/dv u_v,i)²      where nothing is stated: s_g of each data set is estimated

Points without stated uncertainties weigh one as long as nothing else is weighed against them: a
prior, data sets that share a parameter, uncertainties of the velocities. Then s_g is one more
unknown, estimated jointly with the parameters.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from calibration.data import RestitutionData
from calibration.fitting.losses import MAD
from calibration.fitting.problem import Lanes, Problem

STEP = 1e-4  # of a velocity, in the difference that gives dε/dv
LEAST = 1e-4  # of the scatter that is always ε's own, whatever the velocities explain


@dataclass(frozen=True)
class Noise:
    """Errors of ε at each point of a problem, of fits side by side.

    Attributes:
        deviation: standard deviation, (fits, points).
        degrees: degrees of freedom behind it for each data set, None where it was stated; those of
            the first fit.
    """

    deviation: Float[np.ndarray, "fits points"]
    degrees: tuple[float | None, ...]


def is_stated(data: RestitutionData) -> bool:
    return data.uncertainty is not None


def weights(problem: Problem, z: np.ndarray) -> Float[np.ndarray, "points"]:
    """1/deviation of each point at z of one fit; one where nothing is weighed against the others."""
    if all(_stands_alone(problem, data) for data in problem.datasets):
        return np.ones(problem.count)
    return 1 / noise_of(problem, z[None]).deviation[0]


def need_weights(problem: Problem) -> bool:
    """Whether weights depend on where the fit is."""
    alone = all(_stands_alone(problem, data) for data in problem.datasets)
    return _move(problem) or not (alone or all(is_stated(d) for d in problem.datasets))


def _stands_alone(problem: Problem, data: RestitutionData) -> bool:
    """No stated uncertainties, and nothing that is weighed against the points."""
    priors = any(e.parameter.prior is not None for e in problem.elements)
    several = problem.joint and len(problem.datasets) > 1
    return not (is_stated(data) or priors or several or data.velocity_uncertainty is not None)


def noise_of(problem: Problem, z: np.ndarray, lanes: Lanes | None = None) -> Noise:
    """As stated; where nothing is, from the residuals at z, data set by data set."""
    lanes = lanes or Lanes()
    found = replace(problem, loss="squared").linearise(z, lanes)
    measured = problem.points.restitution if lanes.restitution is None else lanes.restitution
    residual = found.prediction - measured
    leverage = leverages(found.jacobian)[:, : problem.count]
    slope = velocity_slope(problem, z) if _move(problem) else np.zeros(residual.shape)
    carried = _carried(problem, slope)
    deviation = np.ones(residual.shape)
    degrees: list[float | None] = []
    for g, data in enumerate(problem.datasets):
        own = problem.points.set == g
        if is_stated(data):
            deviation[:, own] = _stated(data, slope[:, own])
            degrees.append(None)
            continue
        left = np.maximum(np.sum(own) - np.sum(leverage[:, own], axis=1), 1.0)
        rows = zip(residual[:, own], carried[:, own], left, strict=True)
        variance = np.array([_scatter(problem, *row) for row in rows])
        deviation[:, own] = np.sqrt(variance[:, None] + carried[:, own])
        degrees.append(float(left[0]))
    return Noise(deviation, tuple(degrees))


def _scatter(problem: Problem, residual, carried, left: float) -> float:
    """s² with Σ r²/(s² + carried) equal to the degrees of freedom (Paule and Mandel).

    A robust loss takes the median absolute deviation.
    """
    if problem.loss != "squared":
        return float(max(MAD * np.median(np.abs(residual)), 1e-300)) ** 2
    squares = residual**2
    plain = float(np.sum(squares)) / left
    if not np.any(carried):
        return max(plain, 1e-300)
    from scipy.optimize import brentq

    excess = lambda s: float(np.sum(squares / (s + carried))) - left  # noqa: E731
    least = LEAST * plain
    return least if excess(least) <= 0 else float(brentq(excess, least, plain, rtol=1e-12))


def leverages(jacobian: Float[np.ndarray, "fits m p"]) -> Float[np.ndarray, "fits m"]:
    """Diagonal of J (JᵀJ)⁺ Jᵀ: how many parameters each residual pays for."""
    if not jacobian.shape[2]:
        return np.zeros(jacobian.shape[:2])
    size = np.linalg.norm(jacobian, axis=1, keepdims=True)
    scaled = jacobian / np.where(size > 0, size, 1.0)
    left, singular, _ = np.linalg.svd(scaled, full_matrices=False)
    seen = singular > 1e-9 * np.max(singular, axis=1, keepdims=True)
    return np.einsum("fmp,fp->fm", left**2, seen.astype(float))


def _move(problem: Problem) -> bool:
    """Whether velocities have an uncertainty."""
    return any(data.velocity_uncertainty is not None for data in problem.datasets)


def _stated(data: RestitutionData, slope) -> Float[np.ndarray, "fits points"]:
    """√var(δε - slope δv): what ε and v share of their errors counts."""
    if data.velocity_uncertainty is None:
        return np.broadcast_to(data.uncertainty, slope.shape)
    return np.sqrt([data.covariance_of(one).diagonal for one in slope])


def _carried(problem: Problem, slope) -> Float[np.ndarray, "fits points"]:
    """(dε/dv u_v)² of each point."""
    carried = np.zeros(slope.shape)
    for g, data in enumerate(problem.datasets):
        if data.velocity_uncertainty is not None:
            own = problem.points.set == g
            carried[:, own] = (slope[:, own] * data.velocity_uncertainty) ** 2
    return carried


def velocity_slope(problem: Problem, z) -> Float[np.ndarray, "fits points"]:
    """dε/dv at each point [s/m]."""
    velocity = problem.points.velocity
    up, down = (problem.at_velocity(velocity * (1 + s)).predict(z) for s in (STEP, -STEP))
    return (up - down) / (2 * STEP * velocity)
