"""How well the parameters are known: the estimating equations of all stages, stacked.

Each stage's estimate solves g_k(z) = Σ_i J_i r_i = 0. With A = ∂g/∂z and G_i = ∂g/∂ε_i of all stages
together, noise of variance u_i² in ε moves the estimate by covariance

    C = A⁻¹ (Σ_i G_i G_iᵀ u_i²) A⁻ᵀ

For one least-squares stage with A = JᵀJ it is the usual (JᵀJ)⁻¹ u². For `two-step` the second
stage's equations contain what the first gave, and the same noise enters both: that is the sandwich.
There A is the exact derivative of the gradient, curvature of the residuals included, because the
model's misfit is no noise and does not average out.

Where the noise is itself an estimate, C is a sum of parts, one for each variance, and a quantile is
Student's with the degrees of freedom that these have together (Satterthwaite).

All of it for many fits side by side; one fit is one of one.

Source: Newey and McFadden, Handbook of Econometrics 4, 2111 (1994), section 6; Satterthwaite,
Biometrics Bulletin 2, 110 (1946).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from calibration.fitting.degrees import Parts, inflation, noise_parts, shared_of
from calibration.fitting.losses import influence
from calibration.fitting.noise import Noise, noise_of
from calibration.fitting.problem import Lanes, Problem
from calibration.fitting.transform import NONE

RANK_TOLERANCE = 1e-9  # smallest over largest singular value, columns scaled to one
NO_ERROR = 50.0  # a standard error in log units that says nothing
DIFFERENCE = 2e-3  # step in z of the fourth-order differences of the exact gradient
NEAR_KINKS = 1e-6  # the same where a robust loss bends between points
NULL_SHARE = 1e-3  # of a null direction, from which on an element counts as undetermined
SIDES = np.array([-2, -1, 1, 2])

Fits = Bool[np.ndarray, "fits p"]
Matrices = Float[np.ndarray, "fits p p"]


@dataclass(frozen=True)
class Uncertainty:
    """Covariance in z of a component's elements, of some fits side by side.

    Attributes:
        covariance: (fits, elements, elements), NaN for what is undetermined or at an end of its
            range.
        of_predictions: the same with 0 in its place and along null directions, for what follows
            from the elements together.
        rank, condition_number: of the weighted Jacobian, columns scaled to one; the worst stage's.
        undetermined: elements that lie in a null direction.
        limits: elements held at an end of their range, +1 or -1, else 0.
        noise: the errors of ε that were used.
        parts: of `covariance`, by the variances that are estimates.
        widened: the errors over those of known variances, 1 where points share none.
    """

    covariance: Matrices
    of_predictions: Matrices
    rank: Int[np.ndarray, "fits"]
    condition_number: Float[np.ndarray, "fits"]
    undetermined: Fits
    limits: Int[np.ndarray, "fits p"]
    noise: Noise
    parts: Parts
    widened: Float[np.ndarray, "fits p"]

    @property
    def known(self) -> Fits:
        """What has a standard error."""
        return ~self.undetermined & (self.limits == 0)

    @property
    def errors(self) -> Float[np.ndarray, "fits p"]:
        """Standard errors in z."""
        return np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))

    @property
    def degrees(self) -> Float[np.ndarray, "fits p"]:
        """Degrees of freedom of each standard error; infinite where the noise is known."""
        return self.parts.along(np.eye(self.covariance.shape[1]))


@dataclass(frozen=True)
class Settled:
    """One stage of fits side by side: its problem, and what is held at an end of its range."""

    problem: Problem
    limits: Int[np.ndarray, "fits p"]


def stacked(
    stages: Sequence[Settled], z: Float[np.ndarray, "fits p"], lanes: Lanes | None = None
) -> Uncertainty:
    """The covariance of all stages' elements together, at the estimates z.

    Args:
        lanes: the restitutions that each fit is one to, where they differ.
    """
    lanes = lanes or Lanes()
    first_problem = stages[0].problem
    noise = noise_of(first_problem, z, lanes)
    order = np.concatenate([stage.problem.active for stage in stages]).astype(int)
    fits, size, points = len(z), len(order), first_problem.count
    bread, prior = np.zeros((2, fits, size, size))
    scores = np.zeros((fits, points, size))
    nulls, limits = np.zeros((fits, size), bool), np.zeros((fits, size), int)
    rank, condition = np.zeros(fits, int), np.ones(fits)
    first, seen = 0, None
    for k, stage in enumerate(stages):
        problem = stage.problem
        columns = slice(first, first + len(problem.active))
        first = columns.stop
        held = stage.limits != 0
        plain = replace(problem, loss="squared").linearise(z, lanes).jacobian
        jacobian = np.where(held[:, None, :], 0.0, plain)
        drawn = first_problem if k and first_problem.loss != "squared" else None
        if k or problem.loss != "squared":
            bread[:, columns] = np.sum(gradient_slopes(problem, z, order, drawn, lanes), axis=1)
        else:
            bread[:, columns, columns] = np.swapaxes(jacobian, 1, 2) @ jacobian
        spread = _score_spread(problem if drawn is None else drawn, z, noise, lanes)
        if problem.shared is None and first_problem.shared is not None:
            weight = problem.points.weight[None, :, None]
            scores[:, :, columns] = first_problem.coloured(weight * jacobian[:, :points])
        else:
            scores[:, :, columns] = jacobian[:, :points] * spread[:, :, None]
        of_priors = jacobian[:, points:]
        prior[:, columns, columns] = np.swapaxes(of_priors, 1, 2) @ of_priors
        told = diagnose(jacobian, held)
        rank, condition = rank + told[0], np.maximum(condition, told[1])
        nulls[:, columns], limits[:, columns] = told[2], stage.limits
        seen = (
            _along_seen(jacobian, spread)
            if len(stages) == 1 and problem.loss == "squared"
            else None
        )
    middle = np.swapaxes(scores, 1, 2) @ scores + prior
    left_out = nulls | (limits != 0)
    inverse = _inverse(bread, left_out)
    covariance = inverse @ middle @ np.swapaxes(inverse, 1, 2)
    covariance[left_out[:, :, None] | left_out[:, None, :]] = np.nan
    scaled = first_problem.transform.kind[order] != NONE
    error = np.diagonal(covariance, axis1=1, axis2=2)
    nulls |= scaled & (limits == 0) & ~(error < NO_ERROR**2)
    if seen is None:
        seen = np.nan_to_num(covariance)
    else:  # what is known for sure is known whatever lies along the null directions
        covariance = np.where(np.isnan(covariance), np.nan, seen)
    widened = np.ones((fits, size))
    shared = shared_of(first_problem, z[0])
    if shared and len(stages) == 1:
        added = inflation(shared, inverse)
        before = np.diagonal(seen, axis1=1, axis2=2)
        covariance, seen = covariance + added, seen + added
        ratio = np.diagonal(seen, axis1=1, axis2=2) / np.where(before > 0, before, 1.0)
        widened = np.sqrt(np.where(before > 0, ratio, 1.0))
    back = np.argsort(order)
    covariance, seen = (a[:, back][:, :, back] for a in (covariance, seen))
    parts = noise_parts(first_problem, noise, shared, scores, inverse).turned(back)
    nulls, limits, widened = nulls[:, back], limits[:, back], widened[:, back]
    return Uncertainty(covariance, seen, rank, condition, nulls, limits, noise, parts, widened)


def _along_seen(jacobian, spread) -> Matrices:
    """The covariance along the directions that the residuals move with."""
    size = np.linalg.norm(jacobian, axis=1)
    size = np.where(size > 0, size, 1.0)
    inverse = np.linalg.pinv(jacobian / size[:, None, :], rcond=RANK_TOLERANCE) / size[:, :, None]
    extra = np.ones((len(jacobian), jacobian.shape[1] - spread.shape[1]))  # of the priors
    inverse = inverse * np.concatenate([spread, extra], axis=1)[:, None, :]
    return inverse @ np.swapaxes(inverse, 1, 2)


def _score_spread(problem: Problem, z, noise: Noise, lanes: Lanes) -> Float[np.ndarray, "fits n"]:
    """Standard deviation of what noise adds to each point's equation, over its Jacobian's row.

    Least squares: w u; one where points are whitened. A robust loss lets an outlier add no more than
    its ψ: the mean of ψ².
    """
    if problem.shared is not None:
        return np.ones(noise.deviation.shape)
    weighted = problem.points.weight * noise.deviation
    if problem.loss == "squared":
        return weighted
    told = influence(problem.raw_residuals(z, lanes), problem.scale, problem.loss)
    for g in range(len(problem.datasets)):
        own = problem.points.set == g
        lost = max(int(np.sum(own)) - len(problem.active), 1)
        weighted[:, own] = np.sqrt(np.sum(told[:, own] ** 2, axis=1) / lost)[:, None]
    return weighted


def winsorised(first: Problem, z, lanes: Lanes | None = None) -> Float[np.ndarray, "fits n"]:
    """Every ε as far from the first stage's robust curve as its influence reaches, no farther.

    So the second step sees the same bounded noise as the first, and its own misfit is not taken for
    outliers.
    """
    residual = first.raw_residuals(z, lanes)
    drawn = influence(residual, first.scale, first.loss) / first.points.weight
    return first.predict(z) - drawn


def gradient_slopes(
    problem: Problem, z, order, drawn: Problem | None = None, lanes: Lanes | None = None
) -> Float[np.ndarray, "fits m own p"]:
    """∂(J_i r_i)/∂z of each residual: what it adds to the slope of a stage's own equations.

    `drawn` is the robust stage that winsorised the data of this one.

    Fourth-order differences of the exact gradient, all in one batch: no second derivative of a time
    integration is compiled, and the error stays near 1e-11.
    """
    fits, size = len(z), len(order)
    scaled = problem.transform.kind[order] != NONE
    bent = problem.loss != "squared" or drawn is not None
    step = NEAR_KINKS if bent else DIFFERENCE
    steps = step * np.where(scaled, 1.0, np.maximum(np.abs(z[:, order]), 1e-6))
    places = np.repeat(z[:, None, None], size, axis=1).repeat(4, axis=2)
    for k, position in enumerate(order):
        places[:, k, :, position] += steps[:, k, None] * SIDES
    flat = places.reshape(fits * size * 4, -1)
    repeated = (lanes or Lanes()).some(np.repeat(np.arange(fits), size * 4))
    if drawn is not None:
        repeated = Lanes(restitution=winsorised(drawn, flat, repeated))
    found = problem.linearise(flat, repeated)
    gradient = found.jacobian * found.residual[:, :, None]
    shaped = gradient.reshape(fits, size, 4, *gradient.shape[1:])
    far_down, down, up, far_up = np.moveaxis(shaped, 2, 0)
    slope = (8 * (up - down) - (far_up - far_down)) / (12 * steps)[:, :, None, None]
    return np.moveaxis(slope, 1, 3)


def diagnose(jacobian: Float[np.ndarray, "fits m p"], held: Fits):
    """Rank, condition number, and which columns lie in null directions; held ones count for none."""
    fits, _, p = jacobian.shape
    if not p:
        return np.zeros(fits, int), np.ones(fits), np.zeros((fits, 0), bool)
    size = np.linalg.norm(jacobian, axis=1)
    silent = (size == 0) & ~held
    scaled = jacobian / np.where(size == 0, 1.0, size)[:, None, :]
    _, singular, directions = np.linalg.svd(scaled, full_matrices=False)
    kept = np.arange(singular.shape[1]) < np.sum(~held, axis=1)[:, None]
    largest = singular[:, :1]
    seen = kept & (singular > RANK_TOLERANCE * largest)
    unseen = np.where((kept & ~seen)[:, :, None], directions, 0.0)
    share = np.sqrt(np.sum(unseen**2, axis=1))
    smallest = np.min(np.where(kept, singular, np.inf), axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        condition = np.where(np.isfinite(smallest), largest[:, 0] / smallest, 1.0)
    return np.sum(seen, axis=1), condition, ~held & (silent | (share > NULL_SHARE))


def _inverse(bread: Matrices, left_out: Fits) -> Matrices:
    """A⁻¹ on what is determined, 0 on the rest."""
    both = left_out[:, :, None] | left_out[:, None, :]
    a = np.where(both, np.eye(bread.shape[1]), bread)
    size = np.sqrt(np.abs(np.diagonal(a, axis1=1, axis2=2)))
    size = np.where(size > 0, size, 1.0)
    outer = size[:, :, None] * size[:, None, :]
    return np.where(both, 0.0, np.linalg.pinv(a / outer, rcond=1e-16) / outer)


def quantile(confidence: float, degrees: float | np.ndarray | None):
    """Two-sided: Student's t, or the normal one where the noise is known (None, or infinite)."""
    from scipy import special

    at = 0.5 * (1 + confidence)
    if degrees is None:
        return float(special.ndtri(at))
    found = np.where(np.isinf(degrees), special.ndtri(at), special.stdtrit(degrees, at))
    return float(found) if found.ndim == 0 else found
