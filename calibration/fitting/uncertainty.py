"""How well the parameters are known.

Of one likelihood: the inverse of the observed information, the second derivatives of -ln p(data | θ, s)
and of the priors (differences of the exact gradient). Where that is not positive definite in the
directions that show, Gauss and Newton's JᵀJ takes its place and standard errors are not told.

Of `two-step`: the estimating equations of both stages, stacked. Each stage's estimate solves
g_k(z) = Σ_i J_i r_i = 0. With A = ∂g/∂z and G = ∂g/∂ε of both together, noise of covariance V moves
the estimate by covariance

    C = A⁻¹ (Gᵀ V G + priors) A⁻ᵀ

There A is the exact derivative of the gradient: the model's misfit is no noise and does not average out.

Where the noise is itself an estimate, C is a function of variances s_c with covariance R of their
logarithms. A quantile is Student's with (Satterthwaite)

    ν = 2 C² / Σ_cd C_c C_d R_cd,     C_c = s_c ∂C/∂s_c

and C, which takes s for known, is on the average too small by - Σ R_cd s_c s_d ∂²C/∂s_c∂s_d (Kenward and
Roger); both from differences of Gauss and Newton's C, for normal noise.

All of it for many fits side by side; one fit is one of one.

Source: Newey and McFadden, Handbook of Econometrics 4, 2111 (1994), section 6; Satterthwaite,
Biometrics Bulletin 2, 110 (1946); Kenward and Roger, Biometrics 53, 983 (1997); Efron and Hinkley,
Biometrika 65, 457 (1978), of the observed information."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from calibration.fitting.problem import Lanes, Problem, Residuals
from calibration.fitting.transform import NONE
from calibration.fitting.variances import in_units, relative_covariance

RANK_TOLERANCE = 1e-9  # smallest over largest singular value, columns scaled to one
NO_ERROR = 50.0  # a standard error in log units that says nothing
DIFFERENCE = 2e-3  # step in z of the fourth-order differences of the exact gradient
NULL_SHARE = 1e-3  # of a null direction, from which on an element counts as undetermined
SIDES = np.array([-2, -1, 1, 2])
LEAST_CURVATURE = 0.02  # observed over expected information, below which it counts as none
MOST = 4_000_000  # impacts of second derivatives
NUMBERS = 20_000_000  # of Jacobians that are in memory at once
BY_TIME = 0.1  # of these where each is integrated over time
OF_VARIANCE = 1e-2  # step in the logarithm of a variance
FEWEST = 1.0  # degrees of freedom

Fits = Bool[np.ndarray, "fits p"]
Matrices = Float[np.ndarray, "fits p p"]


@dataclass(frozen=True)
class Noise:
    """Errors of ε at each point of a problem, of fits side by side.

    Attributes:
        deviation: standard deviation (of Student's t the scale), (fits, points).
        left: residual degrees of freedom of each block, (fits, blocks).
    """

    deviation: Float[np.ndarray, "fits points"]
    left: Float[np.ndarray, "fits blocks"]


@dataclass(frozen=True)
class Parts:
    """What of a covariance goes with each variance that is an estimate; of fits side by side.

    Attributes:
        whole: the covariance, 0 for what is not determined, (fits, p, p).
        parts: C_c, (fits, c, p, p).
        relative: R, (fits, c, c).
        sets: the block of each part, (c,).
        names: what each part's variance is of.
    """

    whole: Float[np.ndarray, "fits p p"]
    parts: Float[np.ndarray, "fits c p p"]
    relative: Float[np.ndarray, "fits c c"]
    sets: Int[np.ndarray, "c"]
    names: tuple[str, ...]

    def along(self, directions: Float[np.ndarray, "n p"]) -> Float[np.ndarray, "fits n"]:
        """Degrees of freedom of aᵀ C a, infinite where nothing of it is estimated."""
        whole = np.einsum("np,fpq,nq->fn", directions, self.whole, directions)
        parts = np.einsum("np,fcpq,nq->fnc", directions, self.parts, directions)
        return satterthwaite(whole, parts, self.relative)


def satterthwaite(whole, parts, relative) -> Float[np.ndarray, "fits n"]:
    """ν of variances (fits, n) with parts (fits, n, c), see above."""
    spread = np.einsum("fnc,fcd,fnd->fn", parts, relative, parts)
    with np.errstate(divide="ignore", invalid="ignore"):
        degrees = np.where(spread > 0, 2 * whole**2 / spread, np.inf)
    return np.maximum(np.where(np.isnan(degrees), np.inf, degrees), FEWEST)


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
        definite: whether the observed information is, or nothing depends on it, (fits,).
        noise: the errors of ε that were used.
        parts: of `covariance`, by the variances that are estimates.
        widened: the errors over those of known variances, 1 where none shares an error.
    """

    covariance: Matrices
    of_predictions: Matrices
    rank: Int[np.ndarray, "fits"]
    condition_number: Float[np.ndarray, "fits"]
    undetermined: Fits
    limits: Int[np.ndarray, "fits p"]
    definite: Bool[np.ndarray, "fits"]
    noise: Noise
    parts: Parts
    widened: Float[np.ndarray, "fits p"]

    @property
    def known(self) -> Fits:
        """What is determined, and at no end of its range."""
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
        lanes: the values that each fit is one to, where they differ.
    """
    lanes = in_units(stages[0].problem, z, lanes or Lanes())
    found = _of_likelihood if len(stages) == 1 else _of_equations
    return found(stages, z, lanes)


def _of_likelihood(stages: Sequence[Settled], z, lanes: Lanes) -> Uncertainty:
    """By the observed information of one stage."""
    problem, limits = stages[0].problem, stages[0].limits
    held, size = limits != 0, z.shape[1]
    linear = problem.linearise(z, lanes)
    jacobian = np.where(held[:, None], 0.0, linear.jacobian)
    rank, condition, nulls = diagnose(jacobian, held)
    basis, seen = _basis(jacobian)
    identity = np.eye(basis.shape[2])
    curved, definite = np.repeat(identity[None], len(z), axis=0), np.ones(len(z), bool)
    if asks_for_curvature(problem, len(z)):
        slopes = gradient_slopes(problem, z, problem.active, lanes)
        turned = np.swapaxes(basis, 1, 2)
        curvature = turned @ (0.5 * (slopes + np.swapaxes(slopes, 1, 2))) @ basis
        curvature += np.where(seen[:, :, None] & seen[:, None], 0.0, identity)
        with np.errstate(invalid="ignore"):
            finite = np.all(np.isfinite(curvature), axis=(1, 2))
        curvature = np.where(finite[:, None, None], curvature, identity)
        definite = finite & (np.linalg.eigvalsh(curvature)[:, 0] > LEAST_CURVATURE)
        curved = np.where(definite[:, None, None], curvature, identity)
    else:
        definite[:] = not any("[" in problem.elements[k].name for k in problem.active)
    values, vectors = np.linalg.eigh(curved)
    root = basis @ (vectors * values[:, None] ** -0.5) @ np.swapaxes(vectors, 1, 2)
    covariance = root @ np.swapaxes(root, 1, 2)
    noise, parts, added = _of_noise(problem, z, lanes, basis, root, jacobian)
    before = np.diagonal(covariance, axis1=1, axis2=2)
    covariance = covariance + added
    ratio = np.diagonal(covariance, axis1=1, axis2=2) / np.where(before > 0, before, 1.0)
    widened = np.sqrt(np.where(before > 0, np.maximum(ratio, 1.0), 1.0))
    order = np.argsort(problem.active)
    if len(order) < size:
        raise AssertionError("a likelihood searches all its elements")
    left_out = nulls | held
    told = np.where(left_out[:, :, None] | left_out[:, None], np.nan, covariance)
    scaled = problem.transform.kind[problem.active] != NONE
    error = np.diagonal(told, axis1=1, axis2=2)
    nulls = nulls | (scaled & ~held & ~(error < NO_ERROR**2))
    back = lambda a: a[:, order]  # noqa: E731
    both = lambda a: a[:, order][:, :, order]  # noqa: E731
    parts = replace(parts, whole=both(parts.whole), parts=parts.parts[:, :, order][..., order])
    return Uncertainty(
        both(told),
        both(covariance),
        rank,
        condition,
        back(nulls),
        back(limits),
        definite,
        noise,
        parts,
        back(widened),
    )


def asks_for_curvature(problem: Problem, fits: int) -> bool:
    """Whether second derivatives are taken: not of a network, and not where they would take long."""
    import softjax as sj

    if any("[" in problem.elements[k].name for k in problem.active) or not len(problem.active):
        return False
    impacts = 4 * len(problem.active) * problem.count * (5 if problem.moves else 1)
    return impacts <= MOST * (BY_TIME if isinstance(problem.route, sj.ODE) else 1.0)


def _basis(jacobian: Float[np.ndarray, "fits m p"]):
    """W with Wᵀ JᵀJ W = 1 along what the rows move with, 0 elsewhere; and which columns are such."""
    size = np.linalg.norm(jacobian, axis=1)
    size = np.where(size > 0, size, 1.0)
    missing = max(jacobian.shape[2] - jacobian.shape[1], 0)
    filled = np.pad(jacobian / size[:, None], ((0, 0), (0, missing), (0, 0)))
    _, singular, directions = np.linalg.svd(filled, full_matrices=False)
    seen = singular > RANK_TOLERANCE * np.max(singular, axis=1, keepdims=True, initial=0.0)
    per = np.where(seen, 1 / np.where(seen, singular, 1.0), 0.0)
    return np.swapaxes(directions, 1, 2) * per[:, None] / size[:, :, None], seen


def _of_noise(problem: Problem, z, lanes: Lanes, basis, root, jacobian):
    """The noise, what of the covariance goes with each estimated variance, and what that adds to it."""
    deviation = np.sqrt(problem.diagonal(z, lanes))
    white = jacobian @ basis
    squares = np.einsum("fnk,fnk->fn", white, white)[:, : problem.count]
    counts = [own.stop - own.start - np.sum(squares[:, own], axis=1) for own in problem.own]
    left = np.maximum(np.stack(counts, axis=1), 1.0)
    variances = problem.variances if lanes.variances is None else lanes.variances
    parts, sets, names, blocks = [], [], [], []
    k, fits = basis.shape[2], len(z)
    added = np.zeros((fits, k, k))
    unknown = any(e.unknown or e.degrees is not None for e in problem.errors)
    every = problem.seen(z, lanes) if unknown else []
    for g, (errors, s, seen) in enumerate(zip(problem.errors, variances, every, strict=False)):
        kinds, relative = _estimates(errors, s, seen, left[:, g])
        if not kinds:
            continue
        own = seen._replace(jacobian=seen.jacobian @ basis)
        first, second = _changes(errors, s, own, kinds, jacobian[:, problem.own[g]] @ basis)
        parts += [-one for one in first]
        sets += [g] * len(kinds)
        names += kinds
        blocks.append(relative)
        if errors.dof is not None:
            continue
        for c in range(len(kinds)):
            for d in range(len(kinds)):
                bent = first[c] @ first[d] + first[d] @ first[c] - second[c][d]
                bent += first[c] if c == d else 0.0  # - δ_cd ∂C/∂ln s
                added -= relative[:, c, d, None, None] * bent
    relative = _diagonal(blocks, fits)
    carried = lambda m: root @ m @ np.swapaxes(root, 1, 2)  # noqa: E731
    found = (
        np.stack([carried(p) for p in parts], 1)
        if parts
        else np.zeros((fits, 0, *[root.shape[1]] * 2))
    )
    whole = root @ np.swapaxes(root, 1, 2)
    of_noise = Parts(whole, found, relative, np.array(sets, int), tuple(names))
    return Noise(deviation, left), of_noise, carried(added)


def _estimates(errors, s, seen: Residuals, left):
    """Which variances of a data set are estimates, and the covariance R of their logarithms."""
    if not errors.unknown:
        if errors.degrees is None:
            return [], np.zeros((len(left), 0, 0))
        return ["repeats"], np.full((len(left), 1, 1), 2 / errors.degrees)
    kinds = [kind for kind in errors.unknown if kind != "dof"]
    if errors.dof is not None:  # of Student's t: as if from that many residuals
        return kinds[:1], np.broadcast_to(
            (2 / left)[:, None, None], (len(left), len(kinds[:1]), len(kinds[:1]))
        )
    return kinds, relative_covariance(errors, s, seen)


def _changes(errors, s, seen: Residuals, kinds: list[str], white):
    """∂A/∂ln s and ∂²A/∂ln s∂ln s of A = Jᵀ V⁻¹ J of one data set."""
    if kinds == ["repeats"] or errors.dof is not None:
        own = np.swapaxes(white, 1, 2) @ white
        return [-own], [[own]]
    h = OF_VARIANCE

    def information(*moves: tuple[str, float]):
        at = dict(s)
        for kind, step in moves:
            at[kind] = at[kind] * np.exp(step)
        factor = errors.factor(at, seen.slope, seen.bend)
        columns = errors.whiten(factor, seen.jacobian)
        return np.swapaxes(columns, 1, 2) @ columns

    here = information()
    first, second = [], [[0 * here for _ in kinds] for _ in kinds]
    for c, kind in enumerate(kinds):
        far_down, down, up, far_up = (information((kind, n * h)) for n in SIDES)
        first.append((8 * (up - down) - (far_up - far_down)) / (12 * h))
        second[c][c] = (16 * (up + down) - (far_up + far_down) - 30 * here) / (12 * h**2)
        for d, other in enumerate(kinds[:c]):
            ends = [
                information((kind, a * h), (other, b * h))
                for a, b in ((1, 1), (1, -1), (-1, 1), (-1, -1))
            ]
            second[c][d] = second[d][c] = (ends[0] - ends[1] - ends[2] + ends[3]) / (4 * h**2)
    return first, second


def _diagonal(blocks, fits: int):
    """Matrices of each fit in a row along the diagonal."""
    size = sum(one.shape[1] for one in blocks)
    found, first = np.zeros((fits, size, size)), 0
    for one in blocks:
        rows = slice(first, first + one.shape[1])
        found[:, rows, rows], first = one, rows.stop
    return found


def _of_equations(stages: Sequence[Settled], z, lanes: Lanes) -> Uncertainty:
    """By the stacked estimating equations of several stages."""
    first_problem = stages[0].problem
    order = np.concatenate([stage.problem.active for stage in stages]).astype(int)
    fits, size, points = len(z), len(order), first_problem.count
    bread, prior = np.zeros((2, fits, size, size))
    scores = np.zeros((fits, points, size))
    nulls, limits = np.zeros((fits, size), bool), np.zeros((fits, size), int)
    rank, condition = np.zeros(fits, int), np.ones(fits)
    leverage, first = np.zeros((fits, points)), 0
    for k, stage in enumerate(stages):
        problem = stage.problem
        columns = slice(first, first + len(problem.active))
        first, held = columns.stop, stage.limits != 0
        own = lanes if k == 0 else Lanes(value=lanes.value, weight=lanes.weight)
        jacobian = np.where(held[:, None], 0.0, problem.linearise(z, own).jacobian)
        if k:
            bread[:, columns] = gradient_slopes(problem, z, order, own)
        else:
            bread[:, columns, columns] = np.swapaxes(jacobian, 1, 2) @ jacobian
            leverage = leverages(jacobian)[:, :points]
        scores[:, :, columns] = _scores(problem, z, own, jacobian[:, :points], held)
        of_priors = jacobian[:, points:]
        prior[:, columns, columns] = np.swapaxes(of_priors, 1, 2) @ of_priors
        told = diagnose(jacobian, held)
        rank, condition = rank + told[0], np.maximum(condition, told[1])
        nulls[:, columns], limits[:, columns] = told[2], stage.limits
    left = np.stack([o.stop - o.start - np.sum(leverage[:, o], 1) for o in first_problem.own], 1)
    noise = Noise(np.sqrt(first_problem.diagonal(z, lanes)), np.maximum(left, 1.0))
    middles, relative, sets, names = _middles(first_problem, z, lanes, scores, noise.left)
    left_out = nulls | (limits != 0)
    inverse = _inverse(bread, left_out)
    carried = lambda m: inverse @ m @ np.swapaxes(inverse, 1, 2)  # noqa: E731
    whole = carried(sum(middles[0]) + prior)
    covariance = np.where(left_out[:, :, None] | left_out[:, None], np.nan, whole)
    scaled = first_problem.transform.kind[order] != NONE
    error = np.diagonal(covariance, axis1=1, axis2=2)
    nulls |= scaled & (limits == 0) & ~(error < NO_ERROR**2)
    back = np.argsort(order)
    both = lambda a: a[..., back, :][..., back]  # noqa: E731
    parts = (
        np.stack([carried(m) for m in middles[1]], 1)
        if middles[1]
        else np.zeros((fits, 0, size, size))
    )
    of_noise = Parts(both(whole), both(parts), relative, np.array(sets, int), tuple(names))
    return Uncertainty(
        both(covariance),
        np.nan_to_num(both(covariance)),
        rank,
        condition,
        nulls[:, back],
        limits[:, back],
        np.ones(fits, bool),
        noise,
        of_noise,
        np.ones((fits, size)),
    )


def _scores(problem: Problem, z, lanes: Lanes, white, held):
    """What an error in each ε adds to a stage's equations."""
    if problem.is_fixed:
        weight = problem.points.weight if lanes.weight is None else lanes.weight
        return white * np.broadcast_to(weight, white.shape[:2])[..., None]
    variances = problem.variances if lanes.variances is None else lanes.variances
    found = []
    for errors, s, seen in zip(problem.errors, variances, problem.seen(z, lanes), strict=True):
        factor = errors.factor(s, seen.slope, seen.bend)
        found.append(errors.solve(factor, np.where(held[:, None], 0.0, seen.jacobian)))
    return np.concatenate(found, axis=1)


def _middles(problem: Problem, z, lanes: Lanes, scores, left):
    """Gᵀ V G of each data set, its parts by the variances that are estimates, and how well these are known."""
    variances = problem.variances if lanes.variances is None else lanes.variances
    whole, parts, sets, names, blocks = [], [], [], [], []
    every = problem.seen(z, lanes) if problem.errors else []
    if not problem.errors:
        weight = problem.points.weight
        white = scores / np.where(weight > 0, weight, 1.0)[:, None]
        whole.append(np.swapaxes(white, 1, 2) @ white)
    for g, (errors, s, seen) in enumerate(zip(problem.errors, variances, every, strict=True)):
        own = scores[:, problem.own[g]]

        def middle(at, errors=errors, seen=seen, own=own):
            factor = errors.factor(at, seen.slope, seen.bend)
            return np.swapaxes(own, 1, 2) @ errors.times(factor, own)

        whole.append(middle(s))
        kinds, relative = _estimates(errors, s, seen, left[:, g])
        if errors.is_plain:
            relative = (2 / left[:, g])[:, None, None]
        blocks.append(relative)
        for kind in kinds:
            if kind == "repeats":
                parts.append(middle(s))
            else:  # V is linear in it
                twice = {**s, kind: 2 * np.asarray(s[kind])}
                parts.append(middle(twice) - whole[-1])
        sets += [g] * len(kinds)
        names += kinds
    return (whole, parts), _diagonal(blocks, len(z)), sets, names


def gradient_slopes(
    problem: Problem, z, order, lanes: Lanes | None = None, by_row: bool = False
) -> np.ndarray:
    """∂(Jᵀ r)/∂z: the curvature of -ln p, or the slope of a stage's own equations in other elements.

    (fits, own, p); what each row adds to that, (fits, m, own, p), `by_row`.

    Fourth-order differences of the exact gradient, all in one batch: no second derivative of a time
    integration is compiled, and the error stays near 1e-11.
    """
    fits, size = len(z), len(order)
    scaled = problem.transform.kind[order] != NONE
    steps = DIFFERENCE * np.where(scaled, 1.0, np.maximum(np.abs(z[:, order]), 1e-6))
    places = np.repeat(z[:, None, None], size, axis=1).repeat(4, axis=2)
    for k, position in enumerate(order):
        places[:, k, :, position] += steps[:, k, None] * SIDES
    repeated = (lanes or Lanes()).some(np.repeat(np.arange(fits), size * 4))
    flat = places.reshape(fits * size * 4, z.shape[1])
    most = max(1, NUMBERS // (problem.count * max(len(problem.active), 1)))
    parts = []
    product = "fmp,fm->fmp" if by_row else "fmp,fm->fp"
    for first in range(0, len(flat), most):
        some = np.arange(first, min(first + most, len(flat)))
        found = problem.linearise(flat[some], repeated.some(some))
        parts.append(np.einsum(product, found.jacobian, found.residual))
    gradient = np.concatenate(parts).reshape(fits, size, 4, *parts[0].shape[1:])
    far_down, down, up, far_up = np.moveaxis(gradient, 2, 0)
    steps = steps.reshape(*steps.shape, *[1] * (up.ndim - 2))
    slope = (8 * (up - down) - (far_up - far_down)) / (12 * steps)
    return np.moveaxis(slope, 1, -1)


def leverages(jacobian: Float[np.ndarray, "fits m p"]) -> Float[np.ndarray, "fits m"]:
    """Diagonal of J (JᵀJ)⁺ Jᵀ: how many parameters each row pays for."""
    white = jacobian @ _basis(jacobian)[0]
    return np.einsum("fmk,fmk->fm", white, white)


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


ALL = "all"
NO_PART = 1e-10  # of a variance: a part below is none
MOST_NUMBERS = (
    50_000  # numbers that a result keeps of one component; beyond, its least degrees of freedom
)


@dataclass(frozen=True, eq=False)
class Freedom:
    """The parts of a component's covariance, in physical units.

    Attributes:
        labels: of its parameters.
        parts: (c, p, p), one for each variance that is an estimate.
        relative: covariance of the logarithms of these variances, (c, c).
        sets: names of the data sets that they belong to.
        names: what each is of: "scatter", "group", "timing", "scale" or "repeats"; "all" where one
            stands for all variances of all sets.
    """

    labels: tuple[str, ...]
    parts: Float[np.ndarray, "c p p"]
    relative: Float[np.ndarray, "c c"]
    sets: tuple[str, ...]
    names: tuple[str, ...]

    @classmethod
    def of(
        cls, parts: Parts, slope, labels: tuple[str, ...], datasets: tuple[str, ...]
    ) -> "Freedom":
        """Of a fit's parts in z, with dθ/dz."""
        both = np.outer(slope, slope)
        sets = tuple(datasets[g] for g in parts.sets)
        if parts.parts[0].size <= MOST_NUMBERS:
            own = np.diagonal(parts.parts[0], axis1=1, axis2=2)
            acts = own > NO_PART * np.abs(np.diagonal(parts.whole[0]))
            found = np.where(acts[:, :, None] & acts[:, None], parts.parts[0], 0.0)
            return cls(labels, found * both, parts.relative[0], sets, parts.names)
        least = np.min(parts.along(np.eye(len(labels))))
        whole = (parts.whole[0] * both)[None]
        return cls(labels, whole, np.array([[2 / least]]), ("",), (ALL,))

    def degrees(
        self,
        labels: tuple[str, ...],
        slopes: Float[np.ndarray, "n p"],
        variance: Float[np.ndarray, "n"],
        material: str,
        added: Mapping[str, Any] | None = None,
    ) -> Float[np.ndarray, "n"]:
        """Degrees of freedom of a variance, infinite where the noise is known.

        Args:
            labels, slopes: of the parameters that it follows from, and in these.
            variance: itself.
            material, added: the data set, and what its errors add to the variance, by their names.
        """
        if not len(self.names):
            return np.full(len(variance), np.inf)
        place = [self.labels.index(label) for label in labels]
        parts = np.einsum("np,cpq,nq->nc", slopes, self.parts[:, place][:, :, place], slopes)
        for name, value in (added or {}).items():
            own = [
                (m == material and k == name) or (k == ALL and name != "stated")
                for m, k in zip(self.sets, self.names, strict=True)
            ]
            if any(own):
                parts[:, own] += np.reshape(value, (-1, 1)) / sum(own)
        return satterthwaite(variance[None], parts[None], self.relative[None])[0]

    @classmethod
    def from_dict(cls, table: dict[str, Any]) -> "Freedom":
        size, count = len(table["labels"]), len(table["names"])
        return cls(
            tuple(table["labels"]),
            np.array(table["parts"], float).reshape(count, size, size),
            np.array(table["relative"], float).reshape(count, count),
            tuple(table["sets"]),
            tuple(table["names"]),
        )


def freedom_of(freedoms: Sequence[Freedom], dataset: str, labels: Iterable[str]) -> Freedom:
    """That of the component which a data set belongs to.

    Nothing of the set may be free, or nothing of its noise estimated; where both is so, any will do.
    """
    own = set(labels)
    told = (one for one in freedoms if own & set(one.labels) or dataset in one.sets)
    return next(told, freedoms[0])
