"""How well the parameters are known: the estimating equations of all stages, stacked.

Each stage's estimate solves g_k(z) = Σ_i J_i r_i = 0. With A = ∂g/∂z and G_i = ∂g/∂ε_i of all stages
together, noise of variance u_i² in ε moves the estimate by covariance

    C = A⁻¹ (Σ_i G_i G_iᵀ u_i²) A⁻ᵀ

For one least-squares stage with A = JᵀJ it is the usual (JᵀJ)⁻¹ u². For `two-step` the second
stage's equations contain what the first gave, and the same noise enters both: that is the sandwich.
There A is the exact derivative of the gradient, curvature of the residuals included, because the
model's misfit is no noise and does not average out.
"""

from dataclasses import dataclass, replace

import numpy as np

from calibration.assemble import Setup
from calibration.parameters import NONE
from calibration.problem import Problem
from calibration.stages import raw_residuals

RANK_TOLERANCE = 1e-9  # smallest over largest singular value, columns scaled to one
NO_ERROR = 50.0  # a standard error in log units that says nothing
DIFFERENCE = 2e-3  # step in z of the fourth-order differences of the exact gradient
NULL_SHARE = 1e-3  # of a null direction, from which on an element counts as undetermined


@dataclass(frozen=True)
class Uncertainty:
    """Covariance in z of all searched elements.

    Attributes:
        positions: which elements of z.
        covariance: (p, p).
        rank, condition_number: of the weighted Jacobian, columns scaled to one; the worst stage's.
        undetermined: elements that lie in a null direction.
        noise: standard deviation of ε that was used, at each point.
        degrees: degrees of freedom behind it for each data set, None where it was stated.
    """

    positions: np.ndarray
    covariance: np.ndarray
    rank: int
    condition_number: float
    undetermined: np.ndarray
    noise: np.ndarray
    degrees: tuple[int | None, ...]

    def of(self, position: int) -> int | None:
        """Row of an element of z."""
        found = np.flatnonzero(self.positions == position)
        return int(found[0]) if len(found) else None


def stacked(setup: Setup, problems: list[Problem], exact: bool, noise, degrees) -> Uncertainty:
    """The covariance of all stages' elements together; `problems` are based at the estimate."""
    positions = np.concatenate([problem.active for problem in problems]).astype(int)
    size, points = len(positions), len(setup.obs.velocity)
    bread = np.zeros((size, size))
    scores = np.zeros((points, size))
    prior = np.zeros(size)
    rank, condition, nulls = 0, 1.0, np.zeros(size, bool)
    first = 0
    for k, problem in enumerate(problems):
        rows = slice(first, first + len(problem.active))
        plain = replace(problem, loss="squared")
        _, jacobian = plain.linearise_all(problem.base)
        own = jacobian[:, problem.active]
        follows = problems[0] if k > 0 and problems[0].loss != "squared" else None
        if problem.loss != "squared" or (exact and k > 0):
            bread[rows] = _gradient_slope(problem, positions, follows)
        else:
            bread[rows, rows] = own.T @ own
        spread = _score_spread(problem if follows is None else follows, noise, degrees)
        scores[:, rows] = own[:points] * spread[:, None]
        prior[rows] = np.sum(own[points:] ** 2, axis=0)
        own_rank, own_condition, own_nulls = _diagnose(own)
        rank, condition = rank + own_rank, max(condition, own_condition)
        nulls[rows] = own_nulls
        first += len(problem.active)
    middle = scores.T @ scores + np.diag(prior)
    covariance = _sandwich(bread, middle, nulls)
    scaled = problems[0].layout.kind[positions] != NONE
    nulls = nulls | (scaled & ~(np.diag(covariance) < NO_ERROR**2))
    return Uncertainty(positions, covariance, rank, condition, nulls, noise, degrees)


def _score_spread(problem: Problem, noise, degrees) -> np.ndarray:
    """Standard deviation of what noise adds to each point's equation, over its Jacobian's row.

    Least squares: w u. A robust loss lets an outlier add no more than its ψ: the mean of ψ².
    """
    weighted = np.asarray(problem.obs.weight) * noise
    if problem.loss == "squared":
        return weighted
    residual, scale = raw_residuals(problem), problem.noise.scale
    influence = _influence(residual, scale, problem.loss)
    for g in range(len(degrees)):
        own = (problem.obs.group == g) & (problem.obs.weight > 0)
        if np.any(own):
            count = np.sum(own)
            lost = max(count - len(problem.active), 1)
            weighted[own] = np.sqrt(np.sum(influence[own] ** 2) / lost)
    return weighted


def winsorised(first: Problem, z, obs):
    """`obs` with every ε as far from Eq. (17)'s robust curve as its influence reaches, no farther.

    So the model's step sees the same bounded noise as Eq. (17)'s, and its own misfit is not taken
    for outliers.
    """
    curve = first.prediction(z)
    weight = np.where(first.obs.weight > 0, first.obs.weight, 1.0)
    residual = (curve - first.obs.restitution) * weight
    bounded = _influence(residual, first.noise.scale, first.loss) / weight
    return obs._replace(restitution=curve - bounded)


def _influence(residual, scale, loss) -> np.ndarray:
    """ψ(r), the derivative of the loss."""
    if loss == "huber":
        return np.clip(residual, -scale, scale)
    return residual / np.sqrt(1 + (residual / scale) ** 2)


def _gradient_slope(problem: Problem, positions, follows: Problem | None) -> np.ndarray:
    """∂(Jᵀr)/∂z of a stage's own elements, along all `positions`.

    `follows` is the robust stage that winsorised the data of this one.

    Fourth-order differences of the exact gradient: no second derivative of a time integration is
    compiled, and the error stays near 1e-11.
    """

    def gradient(position, step):
        z = np.array(problem.base)
        z[position] += step
        own = problem
        if follows is not None:
            own = replace(problem, obs=winsorised(follows, z, problem.obs))
        value, jacobian = own.linearise_all(z)
        return jacobian[:, problem.active].T @ value

    columns = []
    for position in positions:
        h = DIFFERENCE * _unit(problem, position)
        near = gradient(position, h) - gradient(position, -h)
        far = gradient(position, 2 * h) - gradient(position, -2 * h)
        columns.append((8 * near - far) / (12 * h))
    return np.transpose(columns)


def _unit(problem: Problem, position) -> float:
    """One in transformed units, the value's own size in physical ones."""
    bounded = problem.layout.kind[position] != NONE
    return 1.0 if bounded else max(abs(float(problem.base[position])), 1e-6)


def _diagnose(jacobian) -> tuple[int, float, np.ndarray]:
    """Rank, condition number, and which elements lie in null directions."""
    size = np.linalg.norm(jacobian, axis=0)
    silent = size == 0
    scaled = jacobian / np.where(silent, 1.0, size)
    if not scaled.shape[1]:
        return 0, 1.0, silent
    _, singular, directions = np.linalg.svd(scaled, full_matrices=False)
    seen = singular > RANK_TOLERANCE * singular[0] if singular[0] > 0 else singular > 0
    share = np.sqrt(np.sum(directions[~seen] ** 2, axis=0))
    smallest = singular[-1]
    condition = float(singular[0] / smallest) if smallest > 0 else np.inf
    return int(np.sum(seen)), condition, silent | (share > NULL_SHARE)


def _sandwich(bread, middle, nulls) -> np.ndarray:
    """A⁻¹ M A⁻ᵀ on the determined elements; NaN on the others."""
    covariance = np.full(bread.shape, np.nan)
    known = ~nulls
    if not np.any(known):
        return covariance
    a, m = bread[np.ix_(known, known)], middle[np.ix_(known, known)]
    size = np.sqrt(np.abs(np.diag(a)))
    size = np.where(size > 0, size, 1.0)
    inverse = np.linalg.pinv(a / np.outer(size, size), rcond=1e-16) / np.outer(size, size)
    covariance[np.ix_(known, known)] = inverse @ m @ inverse.T
    return covariance


def noise_of(setup: Setup, problem: Problem) -> tuple[np.ndarray, tuple[int | None, ...]]:
    """Standard deviation of ε at each point, and the degrees of freedom it was estimated with.

    As stated; where nothing is, from this problem's residuals, data set by data set. A robust loss
    takes their median absolute deviation.
    """
    obs = problem.obs
    noise, degrees = np.ones(len(obs.velocity)), []
    residual = problem.prediction(problem.base) - obs.restitution
    for g, data in enumerate(setup.datasets):
        rows = setup.rows(g)
        own = residual[rows]
        left = max(len(own) - parameters_of(setup, problem, g), 1)
        degrees.append(None if data.uncertainty is not None else left)
        if setup.uncertainties[g] is not None:
            noise[rows] = setup.uncertainties[g]
        elif problem.loss == "squared":
            noise[rows] = np.sqrt(np.sum(own**2) / left)
        else:
            noise[rows] = 1.4826 * np.median(np.abs(own))
    return noise, tuple(degrees)


def parameters_of(setup: Setup, problem: Problem, g: int) -> int:
    """How many searched elements a data set has."""
    searched = set(problem.active.tolist())
    return sum(e.position in searched and g in e.sets for e in setup.elements)


def quantile(confidence: float, degrees: int | None) -> float:
    """Two-sided: Student's t, or the normal one where the noise is known."""
    from scipy import stats

    at = 0.5 * (1 + confidence)
    return float(stats.norm.ppf(at) if degrees is None else stats.t.ppf(at, degrees))
