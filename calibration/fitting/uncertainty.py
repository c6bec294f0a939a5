"""Covariance, standard errors and degrees of freedom of the parameters.

Of one likelihood: the inverse of the observed information, the second derivatives of -ln p(data | θ, s)
and of the priors (differences of the exact gradient). Where that is not positive definite in the
directions that show, Gauss and Newton's JᵀJ takes its place and standard errors are not given.

Of `two-step`, which is no likelihood: none. Only rank and null directions are looked at.

Where the noise is itself an estimate, C is a function of variances s_c with covariance R of their
logarithms. A quantile is Student's with (Satterthwaite)

    ν = 2 C² / Σ_cd C_c C_d R_cd,     C_c = s_c ∂C/∂s_c

and C, which takes s for known, is on the average too small by - Σ R_cd s_c s_d ∂²C/∂s_c∂s_d (Kenward and
Roger); both from differences of Gauss and Newton's C, for normal noise.

Source: Satterthwaite, Biometrics Bulletin 2, 110 (1946); Kenward and Roger, Biometrics 53, 983 (1997); Efron and Hinkley,
Biometrika 65, 457 (1978), of the observed information."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import special
from scipy.linalg import block_diag

from calibration.fitting.errors import Errors
from calibration.fitting.methods import TINY
from calibration.fitting.neighbourhoods import binned
from calibration.fitting.problem import BlockResiduals, Problem, acts_on_nothing
from calibration.fitting.variances import differences, relative_covariance
from calibration.parameters import NONE

RANK_TOLERANCE = 1e-9  # smallest over largest singular value, columns scaled to one
NO_ERROR = 50.0  # a standard error in log units that says nothing
DIFFERENCE = 2e-3  # step in z of the fourth-order differences of the exact gradient
OF_ERROR = 0.1  # of that step, in standard errors, where weights of points move with the residuals
NULL_SHARE = 1e-3  # of a null direction, from which on an element counts as undetermined
FOLLOWS = 0.1  # of its error by which an element follows another by a factor of e: it counts as undetermined
# places of these differences and their weights: on both sides, and of third order on one
BOTH_SIDES = np.array([-2.0, -1.0, 1.0, 2.0]), np.array([1.0, -8.0, 8.0, -1.0]) / 12
ONE_SIDE = np.arange(4.0), np.array([-11.0, 18.0, -9.0, 2.0]) / 6
SHORTER = 12  # how often a step is halved that would pass a jump
LEAST_CURVATURE = 0.02  # observed over expected information, below which it counts as none
MOST = 4_000_000  # impacts of second derivatives
NUMBERS = 20_000_000  # of Jacobians that are in memory at once
BY_TIME = 0.1  # of these where each is integrated over time
FEWEST = 1.0  # degrees of freedom

ALL = "all"
NO_PART = 1e-10  # of a variance: a part below is none
MOST_NUMBERS = 50_000  # that a result keeps of one component; beyond, its least degrees of freedom

Matrix = Float[np.ndarray, "p p"]
Stages = Sequence[tuple[Problem, np.ndarray]]  # +1 or -1 for what is at an end of its range


@dataclass(frozen=True, eq=False)
class DegreesOfFreedom:
    """Degrees of freedom of a component's covariance: its parts that depend on each estimated variance."""

    labels: tuple[str, ...]  # of its parameters
    parts: Float[np.ndarray, "c p p"]  # C_c, (c, p, p)
    relative: Float[np.ndarray, "c c"]  # R, covariance of the logarithms of these variances, (c, c)
    sets: tuple[str, ...]  # the data set and observable that each belongs to
    # what each is of: "scatter", "group", "timing", "scale" or "repeats"; "all" where one stands
    # for all variances of all sets
    names: tuple[str, ...]

    def satterthwaite(
        self,
        labels: Sequence[str],
        slopes: Float[np.ndarray, "n p"],
        variance: Float[np.ndarray, " n"],
        block: str = "",
        added: Mapping[str, Any] | None = None,
    ) -> Float[np.ndarray, " n"]:
        """Satterthwaite's ν of a variance, see above; infinite where the noise is known.

        Args:
            labels, slopes: of the parameters that it follows from, and in these.
            variance: itself.
            block, added: the data set (and observable), and what its errors add to the variance, by
                their names.
        """
        place = [self.labels.index(label) for label in labels]
        parts_of = self.parts[:, place][:, :, place]
        parts = np.einsum("np,cpq,nq->nc", slopes, parts_of, slopes)
        for name, value in (added or {}).items():
            acting = [
                (one == block and kind == name) or (kind == ALL and name != "stated")
                for one, kind in zip(self.sets, self.names, strict=True)
            ]
            if any(acting):
                parts[:, acting] += np.reshape(value, (-1, 1)) / sum(acting)
        spread = np.einsum("nc,cd,nd->n", parts, self.relative, parts)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            degrees = np.where(spread > 0, 2 * variance**2 / spread, np.inf)
        return np.maximum(np.where(np.isnan(degrees), np.inf, degrees), FEWEST)

    def physical(
        self, slope: Float[np.ndarray, " p"], covariance_known_noise: Matrix
    ) -> "DegreesOfFreedom":
        """Degrees of freedom in physical parameters, with dθ/dz; `covariance_known_noise` is that in z."""
        both = np.outer(slope, slope)
        if self.parts.size <= MOST_NUMBERS:
            variance = np.diagonal(self.parts, axis1=1, axis2=2)
            acts = variance > NO_PART * np.abs(np.diagonal(covariance_known_noise))
            parts = np.where(acts[:, :, None] & acts[:, None], self.parts, 0.0)
            return replace(self, parts=parts * both)
        least = np.min(
            self.satterthwaite(
                self.labels,
                np.eye(len(covariance_known_noise)),
                np.diagonal(covariance_known_noise),
            )
        )
        kept = {"parts": (covariance_known_noise * both)[None], "relative": np.array([[2 / least]])}
        return replace(self, **kept, sets=("",), names=(ALL,))


def dof_of(
    components: Sequence[DegreesOfFreedom], dataset: str, labels: Iterable[str]
) -> DegreesOfFreedom:
    """Degrees of freedom of the component that contains a data set.

    Nothing of the set may be free, or nothing of its noise estimated; where both is so, any will do.
    """
    requested = set(labels)
    matching = (f for f in components if requested & {*f.labels} or dataset in f.sets)
    return next(matching, components[0])


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


def _of_likelihood(problem: Problem, bound_side, z) -> Uncertainty:
    """Covariance by the observed information; a likelihood searches all its elements."""
    fixed, identity = bound_side != 0, np.eye(len(z))
    scaled = problem.transform.kind[problem.active] != NONE
    jacobian = problem.linearise(z[None]).jacobian
    size = np.where(scaled, 1.0, np.abs(z[problem.active]))
    with_fixed = np.where(acts_on_nothing(jacobian, size[None]), 0.0, jacobian[0])
    jacobian = np.where(fixed, 0.0, with_fixed)
    basis, seen, rank, condition, nulls = _decomposed(jacobian, fixed)
    curved, definite = identity, not _has_network(problem)
    few = binned(problem, z)
    if asks_for_curvature(few):
        ways = np.zeros((len(basis), len(z)))
        ways[:, problem.active] = basis.T
        steady = all(errors.noise.is_least_squares for errors in problem.errors)
        slopes = gradient_slopes(few, z, ways, np.inf if steady else OF_ERROR) @ basis
        curvature = 0.5 * (slopes + slopes.T)
        curvature += np.where(seen[:, None] & seen, 0.0, identity)
        finite = bool(np.all(np.isfinite(curvature)))
        definite = finite and bool(np.linalg.eigvalsh(curvature)[0] > LEAST_CURVATURE)
        curved = curvature if definite else identity
    values, vectors = np.linalg.eigh(curved)
    root = basis @ (vectors * values**-0.5) @ vectors.T
    residual_dof = _residual_dof(problem, np.sum((jacobian @ basis) ** 2, axis=1))
    dof, added = _of_noise(problem, z, residual_dof, basis, root, jacobian)
    covariance_known_noise = root @ root.T
    covariance, before = covariance_known_noise + added, np.diagonal(covariance_known_noise)
    ratio = np.diagonal(covariance) / np.where(before > 0, before, 1.0)
    # what follows an element that grows without bound is only determined together with it
    bound = problem.transform.part(problem.active).bound_beyond(bound_side)
    follows = basis @ (basis.T @ (jacobian.T @ with_fixed[:, fixed & ~np.isfinite(bound)]))
    nulls |= np.any(np.abs(follows) > FOLLOWS * np.sqrt(np.diagonal(covariance))[:, None], axis=1)
    left_out = nulls | fixed
    published = np.where(left_out[:, None] | left_out, np.nan, covariance)
    return Uncertainty(
        covariance=published,
        of_predictions=covariance,
        covariance_known_noise=covariance_known_noise,
        dof=dof,
        rank=rank,
        condition_number=condition,
        undetermined=nulls | (scaled & ~fixed & ~(np.diagonal(published) < NO_ERROR**2)),
        bound_side=bound_side,
        definite=definite,
        deviation=np.sqrt(problem.diagonal(z[None])[0]),
        residual_dof=residual_dof,
        se_inflation=np.sqrt(np.where(before > 0, np.maximum(ratio, 1.0), 1.0)),
    )


def _has_network(problem: Problem) -> bool:
    return any("[" in problem.elements[k].name for k in problem.active)


def asks_for_curvature(problem: Problem) -> bool:
    """Whether second derivatives are taken: not of a network, and not where they would take long."""
    import softjax as sj

    if _has_network(problem) or not len(problem.active):
        return False
    impacts = 4 * len(problem.active) * problem.count * (5 if problem.has_velocity_errors else 1)
    return impacts <= MOST * (BY_TIME if isinstance(problem.route, sj.ODE) else 1.0)


def _decomposed(jacobian: Float[np.ndarray, "m p"], fixed=False):
    """W with Wᵀ JᵀJ W = 1 along what the rows move with, 0 elsewhere; and which columns are such.

    Also rank, condition number, and which elements lie in null directions; held ones count for none.
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
    return directions.T * per / size[:, None], is_seen, rank, condition, nulls


def _residual_dof(problem: Problem, leverage) -> Float[np.ndarray, " blocks"]:
    """Residual degrees of freedom of each block."""
    counts = [span.stop - span.start - np.sum(leverage[span]) for span in problem.spans]
    return np.maximum(counts, 1.0)


def _of_noise(
    problem: Problem, z, residual_dof, basis, root, jacobian
) -> tuple[DegreesOfFreedom, Matrix]:
    """Part of the covariance that depends on each estimated variance, and the correction that this adds."""
    parts, sets, names, blocks = [], [], [], []
    added = np.zeros(root.shape)
    unknown = any(e.unknown or e.degrees is not None for e in problem.errors)
    residuals_of = problem.residuals_at(z[None]) if unknown else ()
    every = zip(problem.errors, problem.variances, residuals_of, strict=False)
    for g, (errors, s, block) in enumerate(every):
        kinds, relative = _estimates(errors, s, block, residual_dof[g])
        if not kinds:
            continue
        turned = block._replace(jacobian=block.jacobian @ basis)
        first, second = _changes(errors, s, turned, kinds, jacobian[problem.spans[g]] @ basis)
        parts += [-row for row in first]
        sets += [problem.block_names[g]] * len(kinds)
        names += kinds
        blocks.append(relative)
        if not errors.noise.is_least_squares:
            continue
        for c, d in np.ndindex(relative.shape):
            bent = first[c] @ first[d] + first[d] @ first[c] - second[c][d]
            bent += first[c] if c == d else 0.0  # - δ_cd ∂C/∂ln s
            added -= relative[c, d] * bent
    parts_in_z = np.array([root @ part @ root.T for part in parts]).reshape(len(parts), *root.shape)
    labels = tuple(e.label for e in problem.elements)
    dof = DegreesOfFreedom(labels, parts_in_z, _diagonal(blocks), tuple(sets), tuple(names))
    return dof, root @ added @ root.T


def _estimates(errors: Errors, s, block: BlockResiduals, residual_dof: float):
    """Estimated variances of a block, and the covariance R of their logarithms."""
    if not errors.unknown:
        if errors.degrees is None:
            return [], np.zeros((0, 0))
        return ["repeats"], np.array([[2 / errors.degrees]])
    kinds = list(errors.unknown)
    if not errors.noise.is_least_squares:
        return kinds[:1], np.full(
            (len(kinds[:1]),) * 2, errors.noise.variance_of_scale(residual_dof)
        )
    return kinds, relative_covariance(errors, s, block)[0]


def _changes(errors: Errors, s, block: BlockResiduals, kinds: list[str], white):
    """∂A/∂ln s and ∂²A/∂ln s∂ln s of A = Jᵀ V⁻¹ J of one block."""
    if kinds == ["repeats"] or not errors.noise.is_least_squares:
        return [-white.T @ white], [[white.T @ white]]

    def information(step: np.ndarray) -> Matrix:
        at = {**s, **{kind: s[kind] * np.exp(h) for kind, h in zip(kinds, step, strict=True)}}
        factor = errors.factor(at, block.slope, block.curvature_variance)
        columns = errors.whiten(factor, block.jacobian)[0]
        return columns.T @ columns

    return differences(information, len(kinds))[1:]


def _diagonal(blocks: Sequence[np.ndarray]) -> np.ndarray:
    """Matrices in a row along the diagonal."""
    return block_diag(*blocks) if blocks else np.zeros((0, 0))


def _of_values(stages: Stages, z) -> Uncertainty:
    """Rank and null directions of each stage; no variances."""
    size = len(z)
    nulls, bound_side = np.zeros(size, bool), np.zeros(size, int)
    rank, condition = 0, 1.0
    for problem, own_side in stages:
        jacobian = np.where(own_side != 0, 0.0, problem.linearise(z[None]).jacobian[0])
        found = _decomposed(jacobian, own_side != 0)
        *_, own_rank, own_condition, nulls[problem.active] = found
        rank, condition = rank + own_rank, max(condition, own_condition)
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


def gradient_slopes(
    problem: Problem, z, ways: Float[np.ndarray, "n elements"], longest: float = np.inf
) -> Float[np.ndarray, "n p"]:
    """∂(Jᵀ r)/∂z along some ways, of the curvature of -ln p.

    Fourth-order differences of the exact gradient, all in one batch: no second derivative of a time
    integration is compiled, and the error stays near 1e-11. No step is longer than so many of its way. Where
    the cost jumps they stay between two jumps, or go to one side.
    """
    scaled = problem.transform.kind != NONE
    moved = np.abs(ways) / np.where(scaled, 1.0, np.maximum(np.abs(z), 1e-6))
    steps = np.minimum(DIFFERENCE / np.maximum(np.max(moved, axis=1), TINY), longest)
    sides, weights = (np.tile(a, (len(ways), 1)) for a in BOTH_SIDES)
    if problem.jumps:
        for k, way in enumerate(ways):
            steps[k], sides[k], weights[k] = _between_jumps(problem, z, way, steps[k])
    flat = (z + steps[:, None, None] * ways[:, None] * sides[..., None]).reshape(-1, len(z))
    most = max(1, NUMBERS // (problem.count * max(len(problem.active), 1)))
    gradient = np.concatenate(
        [problem.linearise(flat[k : k + most]).gradient for k in range(0, len(flat), most)]
    ).reshape(len(ways), 4, -1)
    return np.einsum("ns,nsp->np", weights, gradient) / steps[:, None]


def _between_jumps(problem: Problem, z, way, step: float):
    """The longest step of differences along a way that passes no jump, their places and weights."""
    (sides, weights), here = ONE_SIDE, problem.is_elastic_at(z[None])
    for _ in range(SHORTER):
        for at, factors in (BOTH_SIDES, ONE_SIDE, (-sides, -weights)):
            if np.all(problem.is_elastic_at(z + step * at[:, None] * way) == here):
                return step, at, factors
        step *= 0.5
    return step, *ONE_SIDE


def leverages(jacobian: Float[np.ndarray, "m p"]) -> Float[np.ndarray, " m"]:
    """Diagonal of J (JᵀJ)⁺ Jᵀ: how many parameters each row pays for."""
    return np.sum((jacobian @ _decomposed(jacobian)[0]) ** 2, axis=1)


def quantile(confidence: float, degrees: float | np.ndarray | None):
    """Two-sided: Student's t, or the normal one where the noise is known (None, or infinite)."""
    at = 0.5 * (1 + confidence)
    if degrees is None:
        return float(special.ndtri(at))
    value = np.where(np.isinf(degrees), special.ndtri(at), special.stdtrit(degrees, at))
    return float(value) if value.ndim == 0 else value
