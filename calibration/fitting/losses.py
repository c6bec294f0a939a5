"""Losses that resist outliers: τ(r) with ½τ² the loss, and its influence ψ = τ τ'."""

import numpy as np

LOSSES = ("squared", "huber", "soft-l1")
MAD = 1.4826  # median absolute deviation of Gaussian noise to its standard deviation


def transformed(residual: np.ndarray, scale: np.ndarray | None, loss: str):
    """τ(r) and dτ/dr; r itself for the squared loss. Beyond `scale` residuals weigh less."""
    if loss == "squared":
        return residual, np.ones_like(residual)
    assert scale is not None
    if loss == "soft-l1":
        root = np.sqrt(1 + (residual / scale) ** 2)
        factor = np.sqrt(2 / (1 + root))
        value = residual * factor
    else:
        size = np.abs(residual)
        beyond = size > scale
        bent = np.sqrt(2 * scale * np.where(beyond, size, scale) - scale**2)
        value = np.where(beyond, np.sign(residual) * bent, residual)
    safe = np.where(value == 0, 1.0, value)
    return value, np.where(value == 0, 1.0, influence(residual, scale, loss) / safe)


def influence(residual: np.ndarray, scale: np.ndarray | None, loss: str) -> np.ndarray:
    """ψ(r), the derivative of the loss."""
    if loss == "squared":
        return residual
    assert scale is not None
    if loss == "huber":
        return np.clip(residual, -scale, scale)
    return residual / np.sqrt(1 + (residual / scale) ** 2)


def scale_of(residual: np.ndarray, sets: np.ndarray) -> np.ndarray:
    """1.4826 times the median absolute residual of each data set, at each point."""
    scale = np.ones(len(residual))
    for g in np.unique(sets):
        members = sets == g
        scale[members] = max(MAD * float(np.median(np.abs(residual[members]))), 1e-15)
    return scale
