"""Offsets of groups as predictions, and whether they carry the level that the law misses.

Offsets b of variance τ² give the points errors of covariance V = V₀ + τ² Z Zᵀ. Their best linear unbiased
predictions from the residuals r (measured less fitted), and the errors of these, are

    b̂ = τ² Zᵀ V⁻¹ r,    var(b̂ - b) = τ² - var b̂,    var b̂ = τ⁴ diag(Zᵀ V⁻¹ Z) - diag(L C Lᵀ),    L = τ² Zᵀ V⁻¹ X

where X = ∂f/∂z are the slopes of the curve and C is the covariance of z: the curve is itself an estimate.
Four groups of six points, a constant, τ = 0.02 and a scatter of 0.01: an error of 0.0107, and 0.0040 about a
curve that is known.

Offsets scatter about 0. A mean that is not small against their scatter about it (Student's t) is the law's misfit.

Source: Henderson, Biometrics 31, 423 (1975).
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy import special

from calibration.fitting.problem import Problem
from calibration.fitting.warnings import CONFIDENCE


class Offsets(NamedTuple):
    """Predicted offsets of the groups of one observable of a data set, in the order of `Errors.group`."""

    value: Float[np.ndarray, " groups"]  # measured less fitted
    error: Float[np.ndarray, " groups"]  # of the prediction; NaN where the curve's is not known
    standard: Float[np.ndarray, " groups"]  # value over its standard deviation about a known curve

    @property
    def missed_level(self) -> float | None:
        """The mean offset where it is the law's misfit; else None."""
        count = len(self.value)
        if count < 2 or not np.ptp(self.value) > 0:
            return None
        t = np.mean(self.value) / np.std(self.value, ddof=1) * np.sqrt(count)
        if abs(t) <= special.stdtrit(count - 1, 1 - 0.5 * (1 - CONFIDENCE)):
            return None
        return float(np.mean(self.value))


def offsets_of(
    problem: Problem, k: int, z: np.ndarray, residual: Float[np.ndarray, " n"], covariance: Any
) -> Offsets | None:
    """Predicted offsets of a block; None where none were estimated.

    Args:
        residual: fitted less measured values of its points.
        covariance: of all elements of z.
    """
    errors, s, span = problem.errors[k], problem.variances[k], problem.spans[k]
    if errors.group is None or "group" not in s:
        return None
    linear, variance = problem.linearise(z[None]), float(s["group"])
    _, slope, curvature_variance = linear.measured_curve(span)
    factor = errors.factor(s, slope, curvature_variance)
    columns = np.concatenate([-residual[:, None], linear.per[0, span]], axis=1)
    solved = errors.solve(factor, columns[None])[0]
    value, *follows = variance * np.array([np.bincount(errors.group, c) for c in solved.T])
    about_the_curve = variance / (1 + variance * factor.per.reshape(-1))
    lines = np.reshape(follows, (len(problem.active), len(value)))
    of_curve = np.einsum("pg,pq,qg->g", lines, covariance[np.ix_(*[problem.active] * 2)], lines)
    spread = variance - about_the_curve
    with np.errstate(divide="ignore", invalid="ignore"):
        standard = value / np.sqrt(np.where(spread > 0, spread, np.nan))
    return Offsets(value, np.sqrt(about_the_curve + of_curve), standard)
