"""What estimated variances of the noise add to a covariance, and which of its parts depend on each of them.

A covariance C = A⁻¹ takes the variances s of A = Jᵀ V(s)⁻¹ J for known. Estimates of them move C, on the average to too
small a one. With R the covariance of their logarithms, and A, its derivatives and C in coordinates in which A is 1,

    ΔC = - Σ_cd R_cd (A_c A_d + A_d A_c - A_cd + δ_cd A_c),     A_c = ∂A/∂ln s_c,   A_cd = ∂²A/∂ln s_c ∂ln s_d

is added, by Kenward and Roger. Example: a mean weighted by two estimated variances, of weights w = 0.8 and 0.2, known
with 4 and 9 degrees of freedom (R = 2/ν). A_c = -w_c and A_cc = w_c give Meier's 4 Σ w (1 - w)/ν,

>>> w, relative = np.array([0.8, 0.2]), np.diag([2 / 4, 2 / 9])
>>> first = [np.array([[-x]]) for x in w]
>>> second = [[np.array([[w[c] if c == d else 0.0]]) for d in (0, 1)] for c in (0, 1)]
>>> kenward_roger(first, second, relative).round(4)
array([[0.2311]])

so that the standard error is √1.2311 times that of known variances. One variance of all points scales C,
and nothing is to be added: A_c = -1, A_cc = 1.

Source: Kenward and Roger, Biometrics 53, 983 (1997); Meier, Biometrics 9, 59 (1953).
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.linalg import block_diag

from calibration.fitting.degrees_of_freedom import DegreesOfFreedom, Matrix
from calibration.fitting.errors import Errors
from calibration.fitting.problem import Problem
from calibration.fitting.rows import BlockResiduals
from calibration.fitting.variances import differences, relative_covariance

Derivatives = Sequence[Matrix]


def of_noise(
    problem: Problem,
    z: Float[np.ndarray, " p"],
    residual_dof: Float[np.ndarray, " blocks"],
    basis: Matrix,
    root: Matrix,
    jacobian: Float[np.ndarray, "m p"],
) -> tuple[DegreesOfFreedom, Matrix]:
    """Degrees of freedom of the covariance, and what Kenward and Roger add to it.

    Args:
        residual_dof: residual degrees of freedom of each block.
        basis, root: W and C^½, with Wᵀ A W = 1 and C = root rootᵀ.
        jacobian: of the weighted rows at z.
    """
    parts, sets, names, blocks = [], [], [], []
    added = np.zeros(root.shape)
    unknown = any(e.unknown or e.degrees is not None for e in problem.errors)
    residuals_of = problem.residuals_at(z[None]) if unknown else ()
    every = zip(problem.errors, problem.variances, residuals_of, strict=False)
    for g, (errors, s, block) in enumerate(every):
        kinds, relative = _estimated_variances(errors, s, block, float(residual_dof[g]))
        if not kinds:
            continue
        turned = block._replace(jacobian=block.jacobian @ basis)
        first, second = _derivatives(errors, s, turned, kinds, jacobian[problem.spans[g]] @ basis)
        parts += [-row for row in first]
        sets += [problem.block_names[g]] * len(kinds)
        names += kinds
        blocks.append(relative)
        if errors.noise.is_least_squares:
            added += kenward_roger(first, second, relative)
    in_z = np.array([root @ part @ root.T for part in parts]).reshape(len(parts), *root.shape)
    labels = tuple(e.label for e in problem.elements)
    all_relative = block_diag(*blocks) if blocks else np.zeros((0, 0))
    dof = DegreesOfFreedom(labels, in_z, all_relative, tuple(sets), tuple(names))
    return dof, root @ added @ root.T


def kenward_roger(
    first: Derivatives, second: Sequence[Derivatives], relative: Float[np.ndarray, "c c"]
) -> Matrix:
    """ΔC of the variances of one block, in coordinates in which A is 1."""
    added = np.zeros(np.shape(first[0]))
    for c, d in np.ndindex(relative.shape):
        bent = first[c] @ first[d] + first[d] @ first[c] - second[c][d]
        bent += first[c] if c == d else 0.0
        added -= relative[c, d] * bent
    return added


def _estimated_variances(
    errors: Errors, s, block: BlockResiduals, residual_dof: float
) -> tuple[list[str], Float[np.ndarray, "c c"]]:
    """Estimated variances of a block, and the covariance R of their logarithms."""
    if not errors.unknown:
        if errors.degrees is None:
            return [], np.zeros((0, 0))
        return ["repeats"], np.array([[2 / errors.degrees]])
    kinds = list(errors.unknown)
    if not errors.noise.is_least_squares:
        variance = errors.noise.variance_of_scale(residual_dof)
        return kinds[:1], np.full((len(kinds[:1]),) * 2, variance)
    return kinds, relative_covariance(errors, s, block)[0]


def _derivatives(errors: Errors, s, block: BlockResiduals, kinds: list[str], white):
    """∂A/∂ln s and ∂²A/∂ln s∂ln s of A = Jᵀ V⁻¹ J of one block."""
    if kinds == ["repeats"] or not errors.noise.is_least_squares:
        return [-white.T @ white], [[white.T @ white]]

    def information(step: np.ndarray) -> Matrix:
        at = {**s, **{kind: s[kind] * np.exp(h) for kind, h in zip(kinds, step, strict=True)}}
        factor = errors.factor(at, block.slope, block.curvature_variance)
        columns = errors.whiten(factor, block.jacobian)[0]
        return columns.T @ columns

    return differences(information, len(kinds))[1:]
