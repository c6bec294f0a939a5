"""What estimated variances add to the covariance of few points, after Kenward and Roger.

The covariance Φ = (Jᵀ V⁻¹ J)⁻¹ takes V for known. With V = Σ θ_c V_c and R the covariance of the
ln θ_c, the estimates scatter by more, and Φ is on the average too small by as much again:

    Φ + 2 Φ [Σ_cd R_cd (Q_cd - P_c Φ P_d)] Φ,
    P_c = xᵀ θ_c V_c x,  Q_cd = (θ_c V_c x)ᵀ V⁻¹ (θ_d V_d x),  x = V⁻¹ J.

Source: Kenward and Roger, Biometrics 53, 983 (1997), for variances that V is linear in.
"""

import numpy as np
from jaxtyping import Float

from calibration.fitting.noise import seen_by
from calibration.fitting.problem import Problem
from calibration.fitting.set_errors import SetErrors
from calibration.fitting.variances import relative_covariance

Matrices = Float[np.ndarray, "fits p p"]


def inflation(problem: Problem, z, inverse: Matrices) -> Matrices:
    """What is added to Φ = `inverse`; 0 where points share no errors. All fits share one V."""
    if problem.shared is None:
        return np.zeros_like(inverse)
    middle = np.zeros(inverse.shape[1:])
    for errors, seen in zip(problem.shared, seen_by(problem, z[0]), strict=True):
        if errors.variance:
            relative = relative_covariance(errors, seen)
            middle += missing(errors, seen.jacobian, relative, inverse[0])
    return 2 * inverse @ middle @ inverse


def missing(errors: SetErrors, jacobian, relative, inverse) -> Float[np.ndarray, "p p"]:
    """Σ R_cd (Q_cd - P_c Φ P_d)."""
    solved = errors.unwhiten(errors.whiten(jacobian))
    applied = errors.applied(solved, jacobian)
    white = [errors.whiten(part) for part in applied]
    within = [solved.T @ part for part in applied]
    total = np.zeros_like(inverse)
    for c, (one, p_one) in enumerate(zip(white, within, strict=True)):
        for d, (two, p_two) in enumerate(zip(white, within, strict=True)):
            total += relative[c, d] * (one.T @ two - p_one @ inverse @ p_two)
    return total
