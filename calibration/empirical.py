"""Eq. (17) by itself, and what the uncertainty of velocities does to ε."""

import numpy as np

from calibration.data.measurements import RestitutionData
from calibration.data.paper import eq_17

ROUNDS = 4  # weights move the curve, and its slope the weights


def guess_losses(data: RestitutionData) -> tuple[float, float]:
    """σ and ψ from the straight line ln(-ln ε) = ln σ + ψ ln[v/(v_lim - v)]."""
    inside = (data.restitution > 0) & (data.restitution < 1)
    if np.sum(inside) < 2:
        return 0.5, 0.5
    ratio = data.velocity / (np.asarray(data.limit_velocity) - data.velocity)
    x = np.log(ratio[inside])
    loss = -np.log(data.restitution[inside])
    centred = x - np.average(x, weights=loss)
    spread = np.sum(loss * centred**2)
    slope = np.sum(loss * centred * np.log(loss)) / spread if spread > 0 else 0.5
    psi = float(np.clip(slope, 0.05, 3.0))
    level = np.average(np.log(loss) - psi * x, weights=loss)
    return float(np.exp(np.clip(level, -20, 20))), psi


def reference_losses(data: RestitutionData, uncertainty=None) -> tuple[float, float]:
    """σ and ψ of Eq. (17) against all points by weighted least squares."""
    from scipy.optimize import least_squares

    weight = np.ones(len(data)) if uncertainty is None else 1 / uncertainty
    ratio = np.log(data.velocity / (np.asarray(data.limit_velocity) - data.velocity))

    def residual(x):
        loss = np.exp(np.clip(x[0] + np.exp(x[1]) * ratio, -300, 300))
        return weight * (np.exp(-loss) - data.restitution)

    start = np.log(guess_losses(data))
    found = least_squares(residual, start, x_scale="jac", xtol=1e-14, ftol=1e-14, gtol=1e-14)
    return float(np.exp(found.x[0])), float(np.exp(found.x[1]))


def effective_uncertainty(data: RestitutionData) -> np.ndarray | None:
    """√(u² + (dε/dv u_v)²), with Eq. (17)'s slope; None where nothing is known.

    Where only velocities have an uncertainty, the scatter about Eq. (17) holds both, and what the
    velocities do not explain is ε's own.
    """
    stated = data.uncertainty
    if data.velocity_uncertainty is None or data.limit_velocity is None:
        return stated
    uncertainty = stated
    for _ in range(ROUNDS):
        sigma, psi = reference_losses(data, uncertainty)
        carried = (slope(data, sigma, psi) * data.velocity_uncertainty) ** 2
        own = _own_scatter(data, sigma, psi, carried) if stated is None else stated**2
        uncertainty = np.sqrt(own + carried)
    return uncertainty


def slope(data: RestitutionData, sigma: float, psi: float) -> np.ndarray:
    """dε_17/dv [s/m]."""
    limit = np.asarray(data.limit_velocity)
    ratio = data.velocity / (limit - data.velocity)
    per_ratio = -sigma * psi * ratio ** (psi - 1) * np.exp(-sigma * ratio**psi)
    return per_ratio * limit / (limit - data.velocity) ** 2


def _own_scatter(data, sigma, psi, carried) -> float:
    residual = data.restitution - eq_17(data.velocity, data.limit_velocity, sigma, psi)
    scatter = float(np.sum(residual**2)) / max(len(data) - 2, 1)
    return max(scatter - float(np.mean(carried)), 1e-4 * scatter)
