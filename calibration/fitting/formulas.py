"""Eq. (17) in NumPy: its curve, its slope, and coefficients read off data."""

import numpy as np

from calibration.data import RestitutionData


def eq_17(velocity, limit_velocity, sigma, psi) -> np.ndarray:
    """ε_17 = exp{-σ [v/(v_lim - v)]^ψ} in double precision, whatever JAX is set to."""
    return np.exp(-sigma * (velocity / (limit_velocity - velocity)) ** psi)


def guess_losses(data: RestitutionData) -> tuple[float, float]:
    """σ and ψ from the straight line ln(-ln ε) = ln σ + ψ ln[v/(v_lim - v)]."""
    inside = (data.restitution > 0) & (data.restitution < 1)
    if np.sum(inside) < 2 or data.limit_velocity is None:
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
