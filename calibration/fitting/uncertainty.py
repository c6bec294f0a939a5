"""Covariance and standard errors of the parameters.

The inverse of the observed information of one likelihood at its estimates,

    C = A⁻¹,     A = ∂²/∂z² [-ln p(data | θ, s) - ln p(θ)]

in coordinates W in which Gauss and Newton's JᵀJ is 1 (`directions_of`): directions that no residual moves with have no
variance. Where A is not positive definite in the others, JᵀJ takes its place and standard errors are not given.
What estimated variances of the noise add is in `small_samples`, their degrees of freedom in `degrees_of_freedom`.

Four measurements of one ε scatter by 0.0258 about their mean: it has the standard error 0.0258/√4, with 3 degrees of
freedom:

>>> import calibration as cal
>>> data = cal.RestitutionData([1.0, 1.0, 1.0, 1.0], [0.84, 0.86, 0.90, 0.88])
>>> result = cal.fit(data, "constant", profiles=False, starts=1)
>>> known, fit = result.fits[0].uncertainty, result.fits[0]
>>> float((fit.slope * known.errors)[0].round(4)), float(known.parameter_dof[0].round(4))
(0.0129, 3.0)

`two-step` is no likelihood: only rank and null directions are looked at.

Source: Efron and Hinkley, Biometrika 65, 457 (1978), of the observed information.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from calibration.fitting.curvature import asks_for_curvature, gradient_slopes, has_network
from calibration.fitting.degrees_of_freedom import DegreesOfFreedom, Matrix
from calibration.fitting.neighbourhoods import binned
from calibration.fitting.problem import Problem
from calibration.fitting.rows import acts_on_nothing
from calibration.fitting.small_samples import of_noise
from calibration.parameters import NONE

RANK_TOLERANCE = 1e-9  # smallest over largest singular value, columns scaled to one
NO_ERROR = 50.0  # a standard error in log units that says nothing
# step of differences, in standard errors, where weights of points move with the residuals; 0.01
# and 1 move standard errors by up to 4e-8 in 8 fits
OF_ERROR = 0.1
NULL_SHARE = 1e-3  # of a null direction, from which on an element counts as undetermined
FOLLOWS = 0.1  # of its error by which an element follows another by a factor of e: it counts as undetermined
# observed over expected information, below which it counts as none: of seven fits with a skewed
# likelihood one has less, and more than 2e-4; all others have over 0.5
LEAST_CURVATURE = 0.02

Stages = Sequence[tuple[Problem, np.ndarray]]  # +1 or -1 for what is at an end of its range


@dataclass(frozen=True)
class Uncertainty:
    """Covariance in z of a component's elements."""

    covariance: Matrix  # NaN for what is undetermined or at an end of its range
    # the same with 0 in its place and along null directions, for what follows from the elements
    # together
    of_predictions: Matrix
    covariance_known_noise: Matrix  # as `of_predictions`, were the variances of the noise known
    dof: DegreesOfFreedom  # how well it is known
    rank: int  # of the weighted Jacobian, columns scaled to one; the worst stage's
    condition_number: float
    undetermined: Bool[np.ndarray, " p"]  # elements that lie in a null direction
    bound_side: Int[np.ndarray, " p"]  # elements at an end of their range, +1 or -1, else 0
    definite: bool  # whether the observed information is, or nothing depends on it
    # standard deviation of the errors of each point (or the scale of their family)
    deviation: Float[np.ndarray, " points"]
    residual_dof: Float[np.ndarray, " blocks"]  # of each block
    # standard errors over those of known variances, at least 1
    se_inflation: Float[np.ndarray, " p"]

    @property
    def known(self) -> Bool[np.ndarray, " p"]:
        """Elements that have a variance: determined, of a likelihood, and not at an end of their range."""
        return ~self.undetermined & np.isfinite(np.diagonal(self.covariance))

    @property
    def errors(self) -> Float[np.ndarray, " p"]:
        """Standard errors in z."""
        return np.sqrt(np.diagonal(self.covariance))

    @property
    def parameter_dof(self) -> Float[np.ndarray, " p"]:
        """Degrees of freedom of each standard error; infinite where the noise is known."""
        return self.dof_along(np.eye(len(self.bound_side)))

    def dof_along(self, directions: Float[np.ndarray, "n p"]) -> Float[np.ndarray, " n"]:
        """Degrees of freedom of aᵀ C a."""
        covariance_known_noise = np.einsum(
            "np,pq,nq->n", directions, self.covariance_known_noise, directions
        )
        return self.dof.satterthwaite(self.dof.labels, directions, covariance_known_noise)


def uncertainty_of(stages: Stages, z: Float[np.ndarray, " p"]) -> Uncertainty:
    """The covariance at the estimates z; of several stages, which are no likelihood, none."""
    return _of_likelihood(*stages[0], z) if len(stages) == 1 else _of_values(stages, z)


class Directions(NamedTuple):
    """Directions of the parameters that the rows of a Jacobian move with."""

    basis: Matrix  # W with Wᵀ JᵀJ W = 1 along these, 0 along the others
    seen: Bool[np.ndarray, " p"]  # which columns of W are such
    rank: int
    condition_number: float  # of J, columns scaled to one
    nulls: Bool[np.ndarray, " p"]  # elements that lie in a direction that is not seen


def directions_of(
    jacobian: Float[np.ndarray, "m p"], fixed: Bool[np.ndarray, " p"] | bool = False
) -> Directions:
    """Singular value decomposition of J with columns scaled to one; fixed elements count for none.

    >>> J = np.array([[1.0, 2.0], [2.0, 4.0], [3.0, 6.0]])  # the columns are in proportion
    >>> found = directions_of(J)
    >>> found.rank, found.nulls
    (1, array([ True,  True]))
    """
    m, p = jacobian.shape
    fixed = np.broadcast_to(fixed, p)
    size = np.linalg.norm(jacobian, axis=0)
    none, size = size == 0, np.where(size > 0, size, 1.0)
    filled = np.pad(jacobian / size, ((0, max(p - m, 0)), (0, 0)))
    _, singular, directions = np.linalg.svd(filled, full_matrices=False)
    largest = np.max(singular, initial=0.0)
    is_seen = singular > RANK_TOLERANCE * largest
    per = is_seen / np.where(is_seen, singular, 1.0)
    counted = np.arange(p) < min(m, np.sum(~fixed))
    share = np.sqrt(np.sum(np.where((counted & ~is_seen)[:, None], directions, 0.0) ** 2, axis=0))
    with np.errstate(divide="ignore", invalid="ignore"):
        condition = float(largest / np.min(singular[counted])) if np.any(counted) else 1.0
    nulls = ~fixed & (none | (share > NULL_SHARE))
    rank = int(np.sum(counted & is_seen))
    return Directions(directions.T * per / size[:, None], is_seen, rank, condition, nulls)


def _of_likelihood(problem: Problem, bound_side, z) -> Uncertainty:
    """Covariance by the observed information; a likelihood searches all its elements."""
    fixed = bound_side != 0
    scaled = problem.transform.kind[problem.active] != NONE
    jacobian = problem.linearise(z[None]).jacobian
    size = np.where(scaled, 1.0, np.abs(z[problem.active]))
    with_fixed = np.where(acts_on_nothing(jacobian, size[None]), 0.0, jacobian[0])
    jacobian = np.where(fixed, 0.0, with_fixed)
    directions = directions_of(jacobian, fixed)
    basis = directions.basis
    observed, definite = _observed_information(problem, z, directions)
    values, vectors = np.linalg.eigh(observed)
    root = basis @ (vectors * values**-0.5) @ vectors.T
    residual_dof = _residual_dof(problem, np.sum((jacobian @ basis) ** 2, axis=1))
    dof, added = of_noise(problem, z, residual_dof, basis, root, jacobian)
    known_noise = root @ root.T
    covariance, before = known_noise + added, np.diagonal(known_noise)
    ratio = np.diagonal(covariance) / np.where(before > 0, before, 1.0)
    # what follows an element that grows without bound is only determined together with it
    bound = problem.transform.part(problem.active).bound_beyond(bound_side)
    follows = basis @ (basis.T @ (jacobian.T @ with_fixed[:, fixed & ~np.isfinite(bound)]))
    size = np.sqrt(np.diagonal(covariance))[:, None]
    nulls = directions.nulls | np.any(np.abs(follows) > FOLLOWS * size, axis=1)
    left_out = nulls | fixed
    published = np.where(left_out[:, None] | left_out, np.nan, covariance)
    return Uncertainty(
        covariance=published,
        of_predictions=covariance,
        covariance_known_noise=known_noise,
        dof=dof,
        rank=directions.rank,
        condition_number=directions.condition_number,
        undetermined=nulls | (scaled & ~fixed & ~(np.diagonal(published) < NO_ERROR**2)),
        bound_side=bound_side,
        definite=definite,
        deviation=np.sqrt(problem.diagonal(z[None])[0]),
        residual_dof=residual_dof,
        se_inflation=np.sqrt(np.where(before > 0, np.maximum(ratio, 1.0), 1.0)),
    )


def _observed_information(
    problem: Problem, z: Float[np.ndarray, " p"], directions: Directions
) -> tuple[Matrix, bool]:
    """Wᵀ A W, and whether it is positive definite; 1 (Gauss and Newton's) where it is not, or is not computed."""
    identity, few = np.eye(len(z)), binned(problem, z)
    if not asks_for_curvature(few):
        return identity, not has_network(problem)
    basis, seen, _, _, _ = directions
    ways = np.zeros((len(basis), len(z)))
    ways[:, problem.active] = basis.T
    steady = all(errors.noise.is_least_squares for errors in problem.errors)
    slopes = gradient_slopes(few, z, ways, np.inf if steady else OF_ERROR) @ basis
    curvature = 0.5 * (slopes + slopes.T)
    curvature += np.where(seen[:, None] & seen, 0.0, identity)
    finite = bool(np.all(np.isfinite(curvature)))
    definite = finite and bool(np.linalg.eigvalsh(curvature)[0] > LEAST_CURVATURE)
    return (curvature if definite else identity), definite


def _residual_dof(problem: Problem, leverage) -> Float[np.ndarray, " blocks"]:
    """Residual degrees of freedom of each block."""
    counts = [span.stop - span.start - np.sum(leverage[span]) for span in problem.spans]
    return np.maximum(counts, 1.0)


def _of_values(stages: Stages, z) -> Uncertainty:
    """Rank and null directions of each stage; no variances."""
    size = len(z)
    nulls, bound_side = np.zeros(size, bool), np.zeros(size, int)
    rank, condition = 0, 1.0
    for problem, own_side in stages:
        jacobian = np.where(own_side != 0, 0.0, problem.linearise(z[None]).jacobian[0])
        found = directions_of(jacobian, own_side != 0)
        nulls[problem.active] = found.nulls
        rank, condition = rank + found.rank, max(condition, found.condition_number)
        bound_side[problem.active] = own_side
    first, unknown = stages[0][0], np.full((size, size), np.nan)
    labels, none = tuple(e.label for e in first.elements), np.zeros((0, size, size))
    return Uncertainty(
        covariance=unknown,
        of_predictions=unknown,
        covariance_known_noise=unknown,
        dof=DegreesOfFreedom(labels, none, np.zeros((0, 0)), (), ()),
        rank=rank,
        condition_number=condition,
        undetermined=nulls,
        bound_side=bound_side,
        definite=True,
        deviation=np.sqrt(first.diagonal(z[None])[0]),
        residual_dof=np.ones(len(first.spans)),
        se_inflation=np.ones(size),
    )


def leverages(jacobian: Float[np.ndarray, "m p"]) -> Float[np.ndarray, " m"]:
    """Diagonal of J (JᵀJ)⁺ Jᵀ: how many parameters each row pays for."""
    return np.sum((jacobian @ directions_of(jacobian).basis) ** 2, axis=1)
