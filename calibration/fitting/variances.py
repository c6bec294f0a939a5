"""Unknown variances of the errors by restricted maximum likelihood, and the spread of pools.

    -2 ln L_R = -2 ln p(data | θ, s) + ln det (A₀ + Jᵀ V⁻¹ J) - bᵀ (A₀ + Jᵀ V⁻¹ J)⁻¹ b

with J the slopes of the predictions in θ, A₀ and b₀ what the other data and the priors know of the
parameters, b = b₀ + Jᵀ V⁻¹ r. The parameters that the curve costs are accounted for, so that the variance
of residuals of n points and p parameters is Σ r²/(n - p). Student's t has information (ν + 1)/(ν + 3)
Jᵀ V⁻¹ J, and no b: the residuals are those at the minimum once all has settled. Many fits go side by side,
in a damped Newton search of the logarithms.

Pooled parameters of several sets lie around a common mean, z_g ~ N(μ, τ²) on the scale that is searched.
The data give ẑ with covariance A⁻¹, all other parameters at their best; then ẑ ~ N(μ 1, Σ) with
Σ = A⁻¹ + τ² 1, and τ is where -2 ln L_R = ln det Σ + ln 1ᵀ Σ⁻¹ 1 + (ẑ - μ)ᵀ Σ⁻¹ (ẑ - μ) is least.

Source: Patterson and Thompson, Biometrika 58, 545 (1971); Lange, Little and Taylor, J. Am. Stat. Assoc.
84, 881 (1989), of the information of t errors; Harville, J. Am. Stat. Assoc. 72, 320 (1977), of pools."""

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Any

import jax
import numpy as np
from jaxtyping import Float
from scipy import special

from calibration.fitting.errors import Errors
from calibration.fitting.material import Estimate
from calibration.fitting.problem import Batch, BlockResiduals, Pool, Problem

LEAST, MOST = 1e-9, 1e3  # of a variance, over the mean square of the residuals
NONE = 1e-7  # the same, below which it counts as none
STEP = 1e-2  # in the logarithm of a variance
RIDGE = 1e-12  # of the information, where parameters are not separate
LONGEST = 2.0  # step in a logarithm
ROUNDS, HALVINGS = 60, 25
ARRIVED = 1e-8  # of a step: it is the last
FEW = 20_000  # points of all fits, up to which the search begins from several places
SETTLED = 1e-5  # relative change of a variance, or of a spread

Estimated = dict[str, np.ndarray]


def differences(value: Callable[[np.ndarray], Any], count: int, step: float = STEP):
    """Value, first and second derivatives at 0 along `count` directions, as lists, of any array.

    By differences of fourth order, of second order for the mixed ones.
    """
    unit, here = step * np.eye(count), value(np.zeros(count))
    first, second = [], [[0.0 * here for _ in range(count)] for _ in range(count)]
    for i in range(count):
        far_down, down, up, far_up = (value(n * unit[i]) for n in (-2, -1, 1, 2))
        first.append((8 * (up - down) - (far_up - far_down)) / (12 * step))
        second[i][i] = (16 * (up + down) - (far_up + far_down) - 30 * here) / (12 * step**2)
        for j in range(i):
            along, across = unit[i] + unit[j], unit[i] - unit[j]
            mixed = value(along) + value(-along) - value(across) - value(-across)
            second[i][j] = second[j][i] = mixed / (4 * step**2)
    return here, first, second


def criterion(errors: Errors, s: Mapping[str, Any], block: BlockResiduals, restricted: bool = True):
    """-2 ln L_R, or with what is not restricted -2 ln L, (fits,)."""
    at = (s, block.residual, block.slope, block.curvature_variance)
    if block.included is None:
        value = errors.deviance(*at)
    else:
        value = -2 * np.sum(block.included * errors.by_point(*at), axis=1)
    if not restricted or not block.jacobian.shape[2]:
        return value
    factor = errors.factor(s, block.slope, block.curvature_variance)
    columns = np.concatenate([block.jacobian, block.residual[..., None]], axis=2)
    white = errors.whiten(factor, columns * block.weight[..., None])
    residual, shares = white[..., -1], np.sqrt(errors.noise.information)
    jacobian = white[..., :-1] * np.asarray(shares)[..., None]
    information = block.information + np.swapaxes(jacobian, 1, 2) @ jacobian
    # in units that s does not move: a direction that does not show is a constant, and costs no point
    size, free = block.sizes, block.free
    information = np.where(free[:, :, None] & free[:, None], information, 0.0)
    values, vectors = np.linalg.eigh(information / (size[:, :, None] * size[:, None]))
    values = np.where(values > RIDGE * np.max(values, axis=1, keepdims=True), values, RIDGE)
    value = value + np.sum(np.log(values), axis=1) + 2 * np.sum(np.log(size), axis=1)
    if not errors.noise.is_least_squares or block.gradient is None:
        return value
    b = (block.gradient + np.einsum("fnp,fn->fp", jacobian, residual)) * block.free / size
    return value - np.sum(np.einsum("fpq,fp->fq", vectors, b) ** 2 / values, axis=1)


def estimated(
    errors: Errors,
    block: BlockResiduals,
    restricted: bool = True,
    before: Mapping[str, Any] | None = None,
) -> Estimated:
    """The variances of the largest (restricted) likelihood, (fits,) each; searched from `before`."""
    if errors.is_plain and errors.noise.is_least_squares and block.gradient is None:
        return {"scatter": _scatter(_with_own_parameters(block), restricted)}
    search = _Search(errors, block, restricted)
    known = before is not None and set(errors.unknown) <= set(before)
    starts = [search.place(before, most=0.0)] if known else search.starts()
    values = [search.value(y) for y in starts]
    if block.residual.size > FEW and len(starts) > 1:
        starts = [starts[int(np.argmin([float(np.sum(v)) for v in values]))]]
    ends = [search.descended(y) for y in starts]
    values = np.array([search.value(y) for y in ends])
    best = np.array(ends)[np.argmin(values, axis=0), np.arange(len(block.residual))]
    return search.variances(best)


def _scatter(block: BlockResiduals, restricted: bool) -> np.ndarray:
    """s of the largest (restricted) likelihood where V = s 1, (fits,).

    In directions that are orthonormal to A₀ + JᵀJ/s₀, of which the points have the share e, with x = s₀/s,

        d(-2 ln L_R)/d(ln s) = n - x Σ r²/s₀ - Σ e x/(1 - e + e x),

    which falls with x and bends upwards: Newton's steps from the left never pass its zero.
    """
    weight, square = block.weight, block.square
    count = np.sum(weight, axis=1)
    squares = np.sum(weight * block.residual**2, axis=1) / square
    shares = np.zeros((len(square), 0))
    if restricted and block.jacobian.shape[2]:
        size, free = block.sizes, block.free
        jacobian = block.jacobian * (weight[..., None] / np.sqrt(square)[:, None, None])
        of_points = np.swapaxes(jacobian, 1, 2) @ jacobian
        both = size[:, :, None] * size[:, None]
        where = free[:, :, None] & free[:, None]
        of_points, of_all = (
            np.where(where, a / both, 0.0) for a in (of_points, block.information + of_points)
        )
        values, vectors = np.linalg.eigh(of_all)
        seen = values > RIDGE * np.max(values, axis=1, keepdims=True)
        scale = np.where(seen, 1 / np.sqrt(np.where(seen, values, 1.0)), 0.0)
        root = vectors * scale[:, None]
        inner = np.swapaxes(root, 1, 2) @ of_points @ root
        shares = np.clip(np.linalg.eigvalsh(inner), 0.0, 1.0)
    ends = 1 / MOST, 1 / LEAST
    x = np.clip((count - np.sum(shares, axis=1)) / np.maximum(squares, 1e-300), ends[0], 1.0)
    for _ in range(ROUNDS):
        left = 1 - shares + shares * x[:, None]
        value = count - squares * x - np.sum(shares * x[:, None] / left, axis=1)
        slope = -squares - np.sum(shares * (1 - shares) / left**2, axis=1)
        step = np.clip(x - value / np.minimum(slope, -1e-300), *ends) - x
        x = x + step
        if np.all(np.abs(step) <= 1e-14 * x):
            break
    return square / x


def relative_covariance(errors: Errors, s: Mapping[str, Any], block: BlockResiduals):
    """Covariance of the logarithms of the variances, (fits, k, k), from the curvature of the criterion."""
    search = _Search(errors, block, True)
    curvature = 0.5 * search.expanded(search.place(s))[2]
    inside = np.stack([np.broadcast_to(s[k], len(block.residual)) > 0 for k in errors.unknown], 1)
    both = inside[:, :, None] & inside[:, None]
    values, vectors = np.linalg.eigh(np.where(both, curvature, np.eye(len(errors.unknown))))
    # a variance that the data hardly determine: as if from one degree of freedom
    inverse = (vectors / np.maximum(values, 0.5)[:, None]) @ np.swapaxes(vectors, 1, 2)
    return np.where(both, inverse, 0.0)


def _with_own_parameters(block: BlockResiduals) -> BlockResiduals:
    """Select the parameters that the block depends on; the others are at their best for these.

    That changes the criterion by a constant. Each of many sets depends on a few parameters only.
    """
    active = np.any(block.jacobian != 0, axis=(0, 1))
    if np.all(active) or block.gradient is not None:
        return block
    free = block.free[:, :, None] & block.free[:, None]  # what is at an end follows nothing
    information = np.where(free, block.information, 0.0)
    others = information[:, ~active][:, :, ~active]
    size = np.sqrt(np.diagonal(others, axis1=1, axis2=2))
    size = np.where(size > 0, size, 1.0)
    across = information[:, active][:, :, ~active] / size[:, None]
    others = others / (size[:, :, None] * size[:, None]) + RIDGE * np.eye(size.shape[1])
    return block._replace(
        jacobian=block.jacobian[:, :, active],
        information=information[:, active][:, :, active]
        - across @ np.linalg.solve(others, np.swapaxes(across, 1, 2)),
        free=block.free[:, active],
    )


class _Search:
    """The criterion over y = ln of the variances, in units of the residuals' mean square."""

    def __init__(self, errors: Errors, block: BlockResiduals, restricted: bool):
        block = _with_own_parameters(block)
        self.errors, self.block, self.restricted = errors, block, restricted
        self.square = block.square
        self.unit = np.stack([self._unit(kind) for kind in errors.unknown], axis=1)
        self.lower, self.upper = np.log([LEAST, MOST])

    def select(self, fits: np.ndarray) -> "_Search":
        """Select fits."""
        part = copy(self)
        part.block = jax.tree.map(lambda leaf: leaf[fits], self.block)
        part.square, part.unit = self.square[fits], self.unit[fits]
        return part

    def _unit(self, kind: str) -> np.ndarray:
        """Variance that makes ε as uncertain as the residuals are."""
        if kind in ("scatter", "group"):
            return self.square
        unit = self.errors.variance({kind: 1.0}, self.block.slope, self.block.curvature_variance)
        return self.square / np.maximum(np.mean(unit + 0 * self.block.residual, axis=1), 1e-300)

    def as_variances(self, y: np.ndarray) -> Estimated:
        values = np.exp(y) * self.unit
        return {kind: values[:, k] for k, kind in enumerate(self.errors.unknown)}

    def variances(self, y: np.ndarray) -> Estimated:
        """0 where it is none; but something has to be left."""
        variances = self.as_variances(y)
        none = np.exp(y) <= NONE
        bare = dict.fromkeys(variances, 0.0)
        with np.errstate(invalid="ignore"):
            rest = (
                self.errors.variance(bare, self.block.slope, self.block.curvature_variance)
                + 0 * self.block.residual
            )
        # offsets alone leave no error between the points of a group
        apart = np.array(self.errors.unknown) != "group"
        indefinite = np.all(none | ~apart, axis=1)
        indefinite &= ~(np.min(rest, axis=1) > NONE * self.square)
        none[indefinite, 0] = False
        kinds = enumerate(self.errors.unknown)
        return {kind: np.where(none[:, k], 0.0, variances[kind]) for k, kind in kinds}

    def place(self, s: Any, most: float = np.inf) -> np.ndarray:
        every = [np.broadcast_to(s[kind], len(self.square)) for kind in self.errors.unknown]
        logs = np.log(np.maximum(np.stack(every, axis=1) / self.unit, 1e-300))
        return np.clip(logs, self.lower, min(self.upper, most))

    def starts(self) -> list[np.ndarray]:
        """Equal shares, and most in each of the variances."""
        k = len(self.unit[0])
        shares = [np.full(k, 0.5 / k), *(np.where(np.arange(k) == j, 0.9, 0.05) for j in range(k))]
        return [np.repeat(np.log(x)[None], len(self.unit), 0) for x in shares[: k + (k > 1)]]

    def value(self, y: np.ndarray) -> np.ndarray:
        result = criterion(self.errors, self.as_variances(y), self.block, self.restricted)
        return np.where(np.isfinite(result), result, np.inf)

    def expanded(self, y: np.ndarray):
        """Value, gradient and curvature."""
        here, first, second = differences(lambda step: self.value(y + step), y.shape[1])
        return here, np.stack(first, axis=1), np.moveaxis(np.array(second), 2, 0)

    def descended(self, y: np.ndarray) -> np.ndarray:
        """The nearest minimum of each fit; a variance that is none ends at its lower bound."""
        y, going, search = np.array(y), np.arange(len(y)), self
        for _ in range(ROUNDS):
            here, gradient, curvature = search.expanded(at := y[going])
            at_end = (at <= self.lower) & (gradient > 0) | (at >= self.upper) & (gradient < 0)
            gradient = np.where(at_end, 0.0, gradient)
            free = ~(at_end[:, :, None] | at_end[:, None])
            values, vectors = np.linalg.eigh(np.where(free, curvature, np.eye(y.shape[1])))
            size = np.abs(values)
            size = np.maximum(size, np.maximum(1e-14 * np.max(size, axis=1, keepdims=True), 1e-14))
            along = np.einsum("fij,fi->fj", vectors, gradient) / size
            # not cut element by element: along such a step the value may rise
            along = np.clip(along, -LONGEST, LONGEST)
            step = -np.einsum("fij,fj->fi", vectors, along)
            last = np.max(np.abs(step), axis=1) <= ARRIVED
            share, moved = np.ones(len(at)), np.array(last)
            trial = np.clip(at + share[:, None] * step, self.lower, self.upper)
            for _ in range(HALVINGS):
                if np.all(moved):
                    break
                moved |= search.value(trial) <= here + 1e-13 * np.abs(here)
                share = np.where(moved, share, 0.5 * share)
                trial = np.clip(at + share[:, None] * step, self.lower, self.upper)
            y[going] = np.where(moved[:, None], trial, at)
            further = moved & ~last & np.any(trial != at, axis=1)
            if not np.any(further):
                break
            going, search = going[further], search.select(further)
        return y


FIRST_GROUP = 0.1  # of the variance of a point, offsets of groups where a search begins


def needs_variances(problem: Problem) -> bool:
    """Whether variances are found together with the parameters, as something is weighed against them."""
    if all(is_single_variance(problem, g) for g in range(len(problem.errors))):
        return False
    return any(errors.unknown for errors in problem.errors) or bool(problem.pools)


def is_single_variance(problem: Problem, g: int) -> bool:
    """Whether one scatter is all that is unknown of a block, and nothing is weighed against it."""
    priors = bool(problem.pools) or any(e.parameter.prior is not None for e in problem.elements)
    several = problem.joint and len(problem.errors) > 1
    errors = problem.errors[g]
    return errors.is_plain and errors.noise.is_least_squares and not (priors or several)


def first_variances(problem: Problem, z: np.ndarray) -> Problem:
    """First estimate of the variances, from the residuals at z."""
    starts = []
    first = problem.bare.linearise(z[None], slopes=False).prediction[0]
    for errors, span in zip(problem.errors, problem.spans, strict=True):
        square = max(float(np.mean((first - problem.points.value)[span] ** 2)), 1e-30)
        of_second = float(np.mean(errors.variance({"timing": 1.0}, 0.0, 0.0) + np.zeros(1)))
        guess = {
            "scatter": 1.0 if errors.unknown == ("scatter",) and errors.is_plain else square,
            "group": square,
            "scale": 1.0,
            "timing": square / max(of_second, 1e-300),
        }
        starts.append({kind: guess[kind] for kind in errors.unknown})
    problem = replace(problem, variances=tuple(starts))
    return update_variances(problem, z) if needs_variances(problem) else problem


def with_level(problem: Problem) -> Problem | None:
    """The problem with offsets of groups too small to carry the curve's level; None without groups.

    Far from the points residuals have a mean that an estimate takes for offsets, and these leave the level free:
    a search may end there, and another that begins with the level does not.
    """
    if not any("group" in s for s in problem.variances):
        return None
    pairs = zip(problem.errors, problem.variances, strict=True)
    return replace(problem, variances=tuple(_with_level(*pair) for pair in pairs))


def _with_level(errors: Errors, s: Mapping[str, Any]) -> dict[str, Any]:
    if "group" not in s:
        return dict(s)
    rest = {kind: value for kind, value in s.items() if kind != "group"}
    apart = float(np.mean(errors.variance(rest, 0.0, 0.0) + np.zeros(1)))
    return {**s, "group": min(float(s["group"]), FIRST_GROUP * apart)}


def variances_at(
    problem: Problem, z: Float[np.ndarray, "fits p"], batch: Batch | None = None, restricted=True
) -> tuple[dict[str, np.ndarray], ...]:
    """s of each data set and fit, from the residuals at z."""
    before = problem.variances if batch is None or batch.variances is None else batch.variances
    estimates = []
    every = zip(problem.errors, before, problem.residuals_at(z, batch), strict=True)
    for errors, s, block in every:
        estimates.append(estimated(errors, block, restricted, s) if errors.unknown else {})
    return tuple(estimates)


def update_variances(
    problem: Problem, z: np.ndarray, restricted: bool = True, bound_side: Any = None
) -> Problem:
    """The problem with variances and spreads of pools as of z, `bound_side` as of `estimate_of_pool`."""
    if any(errors.unknown for errors in problem.errors):
        estimates = variances_at(problem, z[None], None, restricted)
        single = [{kind: float(value[0]) for kind, value in table.items()} for table in estimates]
        problem = replace(problem, variances=tuple(single))
    pools = [
        p._replace(spread=estimate_of_pool(problem, z, p, bound_side).spread) for p in problem.pools
    ]
    return replace(problem, pools=tuple(pools)) if pools else problem


def variances_converged(before: Problem, after: Problem) -> bool:
    """Whether two problems have the same variances and spreads of pools."""
    was, now = (
        [*(s[kind] for s in p.variances for kind in s), *(pool.spread for pool in p.pools)]
        for p in (before, after)
    )
    return np.allclose(was, now, rtol=SETTLED, atol=0)


LEAST_SPREAD, MOST_SPREAD = 1e-4, 30.0  # of a spread, in z
POOL_RIDGE = 1e-10  # of the largest information: a data set without information of its own


@dataclass(frozen=True)
class PoolEstimate:
    """The data's estimate of a pool's members: ẑ and its covariance."""

    place: np.ndarray
    covariance: np.ndarray

    def mean(self, spread: float) -> tuple[float, float, float]:
        """μ, its standard error, and -2 ln L_R."""
        total = self.covariance + spread**2 * np.eye(len(self.place))
        inverse = np.linalg.inv(total)
        information = float(np.sum(inverse))
        mean = float(np.sum(inverse @ self.place)) / information
        logs = float(np.linalg.slogdet(total)[1]) + float(np.log(information))
        residual = self.place - mean
        return mean, information**-0.5, logs + float(residual @ inverse @ residual)

    def minus_two_log(self, spread: float) -> float:
        """Term that integrating over the members and their mean adds to -2 ln p at their best."""
        count = len(self.place)
        around = (np.eye(count) - 1 / count) / spread**2
        determinant = np.linalg.slogdet(np.linalg.inv(self.covariance) + around)[1]
        return float(determinant) + 2 * (count - 1) * float(np.log(spread))

    def at(self, log: float) -> float:
        """-2 ln L_R at the logarithm of a spread."""
        return self.mean(float(np.exp(log)))[2]

    @property
    def spread(self) -> float:
        """Spread at the maximum of L_R."""
        from scipy.optimize import minimize_scalar

        ends = np.log(LEAST_SPREAD), np.log(MOST_SPREAD)
        places = np.linspace(*ends, 25)
        best = places[int(np.argmin([self.at(x) for x in places]))]
        near = (max(best - 0.6, ends[0]), min(best + 0.6, ends[1]))
        minimum = minimize_scalar(self.at, bounds=near, method="bounded", options={"xatol": 1e-8})
        return float(np.exp(minimum.x)) if minimum.fun < self.at(ends[0]) else LEAST_SPREAD

    def crossing(self, start: float, end: float, level: float) -> float | None:
        """The spread between two of them where -2 ln L_R reaches a level."""
        from scipy.optimize import brentq

        first, last = float(np.log(start)), float(np.log(end))
        if self.at(last) <= level or first == last:
            return None
        return float(np.exp(brentq(lambda log: self.at(log) - level, first, last, xtol=1e-10)))


def estimate_of_pool(
    problem: Problem, z: np.ndarray, pool: Pool, bound_side: Any = None
) -> PoolEstimate:
    """Estimates of a pool's members from the data and the priors of other parameters, without the pool.

    Args:
        bound_side: +1 or -1 for active elements at an end of their range, which follow nothing, else 0.
    """
    linear = problem.linearise(z[None])
    first = problem.count + len(problem.with_prior)
    for other in problem.pools:
        if other.name == pool.name:
            break
        first += len(other.members)
    rows = np.arange(linear.residual.shape[1])
    others = (rows < first) | (rows >= first + len(pool.members))
    jacobian, residual = linear.jacobian[0, others], linear.residual[0, others]
    members = np.searchsorted(problem.active, pool.members)
    held = (
        np.zeros(len(problem.active), bool) if bound_side is None else np.asarray(bound_side) != 0
    )
    rest = np.delete(np.where(held, 0.0, jacobian), members, axis=1)
    mine = np.c_[jacobian[:, members], residual]  # less what the others make up for
    mine = mine - rest @ np.linalg.lstsq(rest, mine, rcond=1e-9)[0]
    slopes, residual = mine[:, :-1], mine[:, -1]
    information = slopes.T @ slopes
    count = len(pool.members)
    information += POOL_RIDGE * max(float(np.max(np.diag(information))), 1e-300) * np.eye(count)
    covariance = np.linalg.inv(information)
    return PoolEstimate(z[list(pool.members)] - covariance @ slopes.T @ residual, covariance)


def pooled_estimates(fits: Sequence[Any], confidence: float) -> dict[str, Estimate]:
    """Mean, in physical units, and spread of each pool of all components, "chi" and "chi_spread".

    The limits of a spread are where the restricted likelihood falls by half the χ² quantile.
    """
    estimates = {}
    every = ((f.final, f.z, p) for f in fits for p in f.final.problem.pools)
    for final, z, pool in every:
        problem, bound_side = final.problem, final.bound_side
        estimate = estimate_of_pool(problem, z, pool, bound_side)
        transform = problem.transform.part(np.array(pool.members[:1]))
        mean, error, least = estimate.mean(pool.spread)
        reach = float(special.stdtrit(len(pool.members) - 1, 0.5 * (1 + confidence))) * error
        value, low, high = (
            float(transform.physical(np.array([mean + sign * reach]))[0]) for sign in (0, -1, 1)
        )
        slope = abs(float(transform.slope(np.array([mean]))[0]))
        estimates[pool.name] = Estimate(value, slope * error, low, high, "wald", True)
        level = least + float(special.chdtri(1, 1 - confidence))
        ends = [estimate.crossing(pool.spread, end, level) for end in (LEAST_SPREAD, MOST_SPREAD)]
        value = pool.spread if pool.spread > 2 * LEAST_SPREAD else 0.0
        estimates[pool.spread_name] = Estimate(
            value, None, ends[0] or 0.0, ends[1], "profile", True
        )
    return estimates
