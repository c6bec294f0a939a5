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

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from calibration.fitting.errors import Errors
from calibration.fitting.material import Estimate
from calibration.fitting.problem import Lanes, Pool, Problem, Residuals
from calibration.options import DOF
from calibration.parameters import Transform

LEAST, MOST = 1e-9, 1e3  # of a variance, over the mean square of the residuals
NONE = 1e-7  # the same, below which it counts as none
STEP = 1e-2  # in the logarithm of a variance, of differences of fourth order
RIDGE = 1e-12  # of the information, where parameters are not separate
LONGEST = 2.0  # step in a logarithm
ROUNDS, HALVINGS = 60, 25
ARRIVED = 1e-8  # of a step
FEW = 20_000  # points of all fits, up to which the search begins from several places

Estimated = dict[str, np.ndarray]


def criterion(errors: Errors, s: Mapping[str, Any], seen: Residuals, restricted: bool = True):
    """-2 ln L_R, or with what is not restricted -2 ln L, (fits,)."""
    at = (s, seen.off, seen.slope, seen.bend)
    if seen.kept is None:
        value = errors.deviance(*at)
    else:
        value = -2 * np.sum(seen.kept * errors.by_point(*at), axis=1)
    if not restricted or not seen.jacobian.shape[2]:
        return value
    factor = errors.factor(s, seen.slope, seen.bend)
    columns = np.concatenate([seen.jacobian, seen.off[..., None]], axis=2)
    white = errors.whiten(factor, columns * seen.counted[..., None])
    off, shares = white[..., -1], np.sqrt(errors.family(s).information)
    jacobian = white[..., :-1] * np.asarray(shares)[..., None]
    information = seen.information + np.swapaxes(jacobian, 1, 2) @ jacobian
    size = np.sqrt(np.maximum(np.diagonal(information, axis1=1, axis2=2), 1e-300))
    scaled = information / (size[:, :, None] * size[:, None])
    # a direction that the points leave open is a constant: the rounding of its 0 would move ln det
    values, vectors = np.linalg.eigh(scaled)
    values = np.maximum(values, RIDGE)
    value = value + np.sum(np.log(values), axis=1) + 2 * np.sum(np.log(size), axis=1)
    if not errors.is_normal or seen.gradient is None:
        return value
    b = (seen.gradient + np.einsum("fnp,fn->fp", jacobian, off)) / size
    return value - np.sum(np.einsum("fpq,fp->fq", vectors, b) ** 2 / values, axis=1)


def estimated(
    errors: Errors,
    seen: Residuals,
    restricted: bool = True,
    before: Mapping[str, Any] | None = None,
) -> Estimated:
    """The variances of the largest (restricted) likelihood, (fits,) each; searched from `before`."""
    if _is_proportional(errors, seen):
        return _by_squares(errors, seen, restricted)
    search = _Search(errors, seen, restricted)
    known = before is not None and set(errors.unknown) <= set(before)
    starts = [search.place(before)] if known else search.starts()  # type: ignore[arg-type]
    values = [search.value(y) for y in starts]
    if seen.off.size > FEW and len(starts) > 1:
        starts = [starts[int(np.argmin([float(np.sum(v)) for v in values]))]]
    ends = [search.descended(y) for y in starts]
    values = np.array([search.value(y) for y in ends])
    best = np.array(ends)[np.argmin(values, axis=0), np.arange(len(seen.off))]
    return search.variances(best)


def relative_covariance(errors: Errors, s: Mapping[str, Any], seen: Residuals):
    """Covariance of the logarithms of the variances, (fits, k, k), from the curvature of the criterion."""
    if _is_proportional(errors, seen):
        return (2 / _left(errors, seen))[:, None, None]
    search = _Search(errors, seen, True)
    curvature = 0.5 * search.expanded(search.place(s))[2]
    inside = np.stack([np.broadcast_to(s[kind], len(seen.off)) > 0 for kind in errors.unknown], 1)
    both = inside[:, :, None] & inside[:, None]
    values, vectors = np.linalg.eigh(np.where(both, curvature, np.eye(len(errors.unknown))))
    # a variance that the data hardly determine: as if from one degree of freedom
    inverse = (vectors / np.maximum(values, 0.5)[:, None]) @ np.swapaxes(vectors, 1, 2)
    return np.where(both, inverse, 0.0)


def _is_proportional(errors: Errors, seen: Residuals) -> bool:
    """Whether V is one unknown number times what is known, and nothing else is known of the parameters."""
    scales = errors.unknown in (("scale",), ("timing",)) or (
        errors.unknown == ("scatter",) and errors.is_plain
    )
    return scales and errors.is_normal and not np.any(seen.information)


def _by_squares(errors: Errors, seen: Residuals, restricted: bool) -> Estimated:
    """rᵀ V₁⁻¹ r over the residuals' degrees of freedom, of the residuals at the minimum."""
    kind = errors.unknown[0]
    factor = errors.factor({kind: 1.0}, seen.slope, seen.bend)
    off = errors.whiten(factor, (seen.off * seen.counted)[..., None])[..., 0]
    return {kind: np.maximum(np.sum(off**2, axis=1) / _left(errors, seen, restricted), 1e-300)}


def _left(errors: Errors, seen: Residuals, restricted: bool = True) -> np.ndarray:
    """Points less what the parameters cost."""
    left = np.sum(seen.counted, axis=1)
    if restricted and seen.jacobian.shape[2]:
        factor = errors.factor({errors.unknown[0]: 1.0}, seen.slope, seen.bend)
        jacobian = errors.whiten(factor, seen.jacobian * seen.counted[..., None])
        size = np.linalg.norm(jacobian, axis=1, keepdims=True)
        singular = np.linalg.svd(jacobian / np.where(size > 0, size, 1.0), compute_uv=False)
        rank = np.sum(singular > 1e-9 * np.max(singular, axis=1, keepdims=True), axis=1)
        left = np.maximum(left - rank, 1.0)
    return left


class _Search:
    """The criterion over y = ln of the variances, in units of the residuals' mean square."""

    def __init__(self, errors: Errors, seen: Residuals, restricted: bool):
        self.errors, self.seen, self.restricted = errors, seen, restricted
        counted = seen.counted
        squares = np.sum(counted * seen.off**2, axis=1) / np.sum(counted, axis=1)
        self.square = np.maximum(squares, 1e-30)
        self.unit = np.stack([self._unit(kind) for kind in errors.unknown], axis=1)
        is_dof = np.array([kind == "dof" for kind in errors.unknown])
        self.lower = np.where(is_dof, np.log(DOF[0]), np.log(LEAST))
        self.upper = np.where(is_dof, np.log(DOF[1]), np.log(MOST))
        self.is_dof = is_dof

    def _unit(self, kind: str) -> np.ndarray:
        """Variance that makes ε as uncertain as the residuals are."""
        if kind == "dof":
            return np.ones(len(self.square))
        if kind in ("scatter", "group"):
            return self.square
        one = self.errors.variance({kind: 1.0}, self.seen.slope, self.seen.bend)
        return self.square / np.maximum(np.mean(one + 0 * self.seen.off, axis=1), 1e-300)

    def as_variances(self, y: np.ndarray) -> Estimated:
        values = np.exp(y) * self.unit
        return {kind: values[:, k] for k, kind in enumerate(self.errors.unknown)}

    def variances(self, y: np.ndarray) -> Estimated:
        """0 where it is none; but something has to be left."""
        found = self.as_variances(y)
        none = (np.exp(y) <= NONE) & ~self.is_dof
        bare = {kind: np.zeros(len(y)) for kind in found} | (
            {"dof": found["dof"]} if "dof" in found else {}
        )
        with np.errstate(invalid="ignore"):
            least = np.min(
                self.errors.variance(bare, self.seen.slope, self.seen.bend) + 0 * self.seen.off,
                axis=1,
            )
        indefinite = np.all(none | self.is_dof, axis=1) & ~(least > NONE * self.square)
        none[indefinite, 0] = False
        return {
            kind: np.where(none[:, k], 0.0, found[kind])
            for k, kind in enumerate(self.errors.unknown)
        }

    def place(self, s: Mapping[str, Any]) -> np.ndarray:
        values = np.stack(
            [np.broadcast_to(s[kind], len(self.square)) for kind in self.errors.unknown], axis=1
        )
        return np.clip(np.log(np.maximum(values / self.unit, 1e-300)), self.lower, self.upper)

    def starts(self) -> list[np.ndarray]:
        """Equal shares, and most in each of the variances."""
        k = len(self.unit[0])
        shares = [np.full(k, 0.5 / k), *(np.where(np.arange(k) == j, 0.9, 0.05) for j in range(k))]
        logs = [np.where(self.is_dof, np.log(6.0), np.log(one)) for one in shares[: k + (k > 1)]]
        return [np.repeat(one[None], len(self.unit), axis=0) for one in logs]

    def value(self, y: np.ndarray) -> np.ndarray:
        found = criterion(self.errors, self.as_variances(y), self.seen, self.restricted)
        return np.where(np.isfinite(found), found, np.inf)

    def expanded(self, y: np.ndarray):
        """Value, gradient and curvature."""
        k, h, here = y.shape[1], STEP, self.value(y)
        gradient, curvature = np.zeros(y.shape), np.zeros((*y.shape, k))
        unit = np.eye(k)
        for i in range(k):
            far_down, down, up, far_up = (self.value(y + n * h * unit[i]) for n in (-2, -1, 1, 2))
            gradient[:, i] = (8 * (up - down) - (far_up - far_down)) / (12 * h)
            second = 16 * (up + down) - (far_up + far_down) - 30 * here
            curvature[:, i, i] = second / (12 * h**2)
            for j in range(i):
                a, b = h * unit[i], h * unit[j]
                mixed = self.value(y + a + b) - self.value(y + a - b)
                mixed += self.value(y - a - b) - self.value(y - a + b)
                curvature[:, i, j] = curvature[:, j, i] = mixed / (4 * h**2)
        return here, gradient, curvature

    def descended(self, y: np.ndarray) -> np.ndarray:
        """The nearest minimum of each fit; a variance that is none ends at its lower bound."""
        y, going = np.array(y), np.ones(len(y), bool)
        for _ in range(ROUNDS):
            here, gradient, curvature = self.expanded(y)
            at_end = (y <= self.lower) & (gradient > 0) | (y >= self.upper) & (gradient < 0)
            gradient = np.where(at_end, 0.0, gradient)
            free = ~(at_end[:, :, None] | at_end[:, None])
            values, vectors = np.linalg.eigh(np.where(free, curvature, np.eye(y.shape[1])))
            size = np.abs(values)
            size = np.maximum(size, np.maximum(1e-14 * np.max(size, axis=1, keepdims=True), 1e-14))
            along = np.einsum("fij,fi->fj", vectors, gradient) / size
            step = np.clip(-np.einsum("fij,fj->fi", vectors, along), -LONGEST, LONGEST)
            going &= np.max(np.abs(step), axis=1) > ARRIVED
            if not np.any(going):
                break
            share, moved = np.where(going, 1.0, 0.0), ~going
            for _ in range(HALVINGS):
                trial = np.clip(y + share[:, None] * step, self.lower, self.upper)
                moved |= self.value(trial) <= here + 1e-13 * np.abs(here)
                if np.all(moved):
                    break
                share = np.where(moved, share, 0.5 * share)
            going &= moved & np.any(trial != y, axis=1)
            y = np.where(moved[:, None], trial, y)
        return y


ALIKE = 1e-6  # of V_ii: variances that have settled


def needs_variances(problem: Problem) -> bool:
    """Whether variances are found together with the parameters, as something is weighed against them."""
    if all(stands_alone(problem, g) for g in range(len(problem.errors))):
        return False
    return any(one.unknown for one in problem.errors) or bool(problem.pools)


def stands_alone(problem: Problem, g: int) -> bool:
    """Whether one scatter is all that is unknown of a block, and nothing is weighed against it."""
    priors = bool(problem.pools) or any(e.parameter.prior is not None for e in problem.elements)
    several = problem.joint and len(problem.errors) > 1
    errors = problem.errors[g]
    return errors.is_plain and errors.is_normal and not (priors or several)


def first_variances(problem: Problem, z: np.ndarray) -> Problem:
    """First estimate of the variances, from the residuals at z."""
    off = problem.predict(z[None])[0] - problem.points.value
    pairs = zip(problem.errors, problem.own, strict=True)
    start = [_first_guess(errors, float(np.mean(off[own] ** 2))) for errors, own in pairs]
    problem = problem.with_variances(start)
    return renewed(problem, z) if needs_variances(problem) else problem


def _first_guess(errors: Errors, square: float) -> dict[str, float | None]:
    square = max(square, 1e-30)
    of_second = np.mean(errors.variance({"timing": 1.0}, 0.0, 0.0) + np.zeros(len(errors)))
    first = {
        "scatter": 1.0 if errors.unknown == ("scatter",) and errors.is_plain else square,
        "group": square,
        "scale": 1.0,
        "timing": square / max(float(of_second), 1e-300),
        "dof": errors.dof,
    }
    return {kind: first[kind] for kind in errors.unknown}


def variances_at(
    problem: Problem, z: Float[np.ndarray, "fits p"], lanes: Lanes | None = None, restricted=True
) -> tuple[dict[str, np.ndarray], ...]:
    """s of each data set and fit, from the residuals at z."""
    lanes = lanes or Lanes()
    before = problem.variances if lanes.variances is None else lanes.variances
    found = []
    for errors, s, seen in zip(problem.errors, before, problem.seen(z, lanes), strict=True):
        found.append(estimated(errors, seen, restricted, s) if errors.unknown else {})
    return tuple(found)


def renewed(problem: Problem, z: np.ndarray, restricted: bool = True) -> Problem:
    """The problem with variances and spreads of pools as of z."""
    if any(one.unknown for one in problem.errors):
        found = variances_at(problem, z[None], None, restricted)
        problem = problem.with_variances([_single(one) for one in found])
    return respread(problem, z)


def with_noise(problem: Problem, z: np.ndarray) -> Problem:
    """A problem whose scatter is weighed against nothing, in units of its estimate at z."""
    found = [_single(one) for one in variances_at(problem, z[None])]
    if problem.joint or len(problem.errors) == 1:
        return problem.with_variances(found)
    return replace(problem, variances=tuple(found))  # each set weighs as it did


def have_settled(one: Problem, other: Problem) -> bool:
    """Whether two problems have the same variances and spreads of pools."""
    pools = zip(one.pools, other.pools, strict=True)
    return all(np.isclose(a.spread, b.spread, rtol=1e-5, atol=0) for a, b in pools) and all(
        _same_variances(errors, a, b)
        for errors, a, b in zip(one.errors, one.variances, other.variances, strict=True)
    )


def _same_variances(errors: Errors, one: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    """Equal in what each variance adds to that of ε."""
    if set(one) != set(other):
        return False
    whole = float(np.mean(errors.diagonal(one) + np.zeros(len(errors))))
    for kind in one:
        apart = {**one, kind: other[kind]}
        moved = float(np.mean(errors.diagonal(apart) + np.zeros(len(errors))))
        same = abs(moved - whole) <= ALIKE * whole
        if kind == "dof":
            same = abs(other[kind] - one[kind]) <= 1e-3 * one[kind]
        if not same:
            return False
    return True


def _single(s: Mapping[str, np.ndarray]) -> dict[str, float]:
    return {kind: float(value[0]) for kind, value in s.items()}


LEAST_SPREAD, MOST_SPREAD = 1e-4, 30.0  # of a spread, in z
POOL_RIDGE = 1e-10  # of the largest information: a data set without information of its own


@dataclass(frozen=True)
class PoolEstimate:
    """The data's estimate of a pool's members: ẑ and its covariance."""

    place: np.ndarray
    covariance: np.ndarray

    def criterion(self, spread: float) -> float:
        """-2 ln L_R."""
        total = self.covariance + spread**2 * np.eye(len(self.place))
        inverse = np.linalg.inv(total)
        information = float(np.sum(inverse))
        off = self.place - float(np.sum(inverse @ self.place)) / information
        logs = float(np.linalg.slogdet(total)[1]) + float(np.log(information))
        return logs + float(off @ inverse @ off)

    @property
    def spread(self) -> float:
        """Spread at the maximum of L_R."""
        from scipy.optimize import minimize_scalar

        at = lambda log: self.criterion(float(np.exp(log)))  # noqa: E731
        ends = np.log(LEAST_SPREAD), np.log(MOST_SPREAD)
        places = np.linspace(*ends, 25)
        best = places[int(np.argmin([at(x) for x in places]))]
        near = (max(best - 0.6, ends[0]), min(best + 0.6, ends[1]))
        found = minimize_scalar(at, bounds=near, method="bounded", options={"xatol": 1e-8})
        return float(np.exp(found.x)) if found.fun < at(ends[0]) else LEAST_SPREAD

    @property
    def error(self) -> float:
        """Error of a member from its data alone, the median of all."""
        return float(np.sqrt(np.median(np.diagonal(self.covariance))))

    def mean(self, spread: float) -> tuple[float, float]:
        """μ and its standard error."""
        inverse = np.linalg.inv(self.covariance + spread**2 * np.eye(len(self.place)))
        information = float(np.sum(inverse))
        return float(np.sum(inverse @ self.place)) / information, information**-0.5


def respread(problem: Problem, z: np.ndarray) -> Problem:
    """The problem with the spread of each pool estimated at z."""
    pools = []
    for pool in problem.pools:
        pools.append(pool._replace(spread=seen_by_pool(problem, z, pool).spread))
    return replace(problem, pools=tuple(pools)) if pools else problem


def pooled_estimates(problem: Problem, z: np.ndarray, confidence: float) -> dict[str, Estimate]:
    """Mean, in physical units, and spread of each pool, "chi" and "chi_spread"."""
    from scipy import special

    found = {}
    for pool in problem.pools:
        seen = seen_by_pool(problem, z, pool)
        transform = problem.transform.part(np.array(pool.members[:1]))
        mean, error = seen.mean(pool.spread)
        reach = float(special.stdtrit(len(pool.members) - 1, 0.5 * (1 + confidence))) * error
        low, high = (_physical(transform, mean + sign * reach) for sign in (-1, 1))
        slope = abs(float(transform.slope(np.array([mean]))[0]))
        value = _physical(transform, mean)
        found[pool.name] = Estimate(value, slope * error, low, high, "wald", True)
        found[pool.spread_name] = _spread_estimate(seen, pool, confidence)
    return found


def seen_by_pool(problem: Problem, z: np.ndarray, pool: Pool) -> PoolEstimate:
    """Estimates of a pool's members from the data and the priors of other parameters, without the pool."""
    found = problem.linearise(z[None])
    kept = np.ones(found.residual.shape[1], bool)
    kept[_rows_of(problem, pool)] = False
    jacobian, residual = found.jacobian[0, kept], found.residual[0, kept]
    place = {int(k): column for column, k in enumerate(problem.active)}
    own = [place[k] for k in pool.members]
    rest = [column for column in range(jacobian.shape[1]) if column not in own]
    orthogonal = _without(jacobian[:, rest])
    slopes, off = orthogonal(jacobian[:, own]), orthogonal(residual[:, None])[:, 0]
    information = slopes.T @ slopes
    information += POOL_RIDGE * max(float(np.max(np.diag(information))), 1e-300) * np.eye(len(own))
    covariance = np.linalg.inv(information)
    return PoolEstimate(z[list(pool.members)] - covariance @ slopes.T @ off, covariance)


def _without(columns: np.ndarray) -> Any:
    """Values minus their projection on the columns."""
    left, singular, _ = np.linalg.svd(columns, full_matrices=False)
    basis = left[:, singular > 1e-9 * np.max(singular, initial=0.0)]
    return lambda values: values - basis @ (basis.T @ values)


def _rows_of(problem: Problem, pool: Pool) -> slice:
    """Rows of a pool among the residuals, after the points and the priors."""
    first = problem.count + len(problem.with_prior)
    for one in problem.pools:
        if one.name == pool.name:
            break
        first += len(one.members)
    return slice(first, first + len(pool.members))


def _spread_estimate(seen: PoolEstimate, pool: Pool, confidence: float) -> Estimate:
    """Estimate of a spread, with limits where the restricted likelihood falls by half the χ² quantile."""
    from scipy import special

    value = pool.spread if pool.spread > 2 * LEAST_SPREAD else 0.0
    level = seen.criterion(pool.spread) + float(special.chdtri(1, 1 - confidence))
    low, high = (_crossing(seen, pool.spread, end, level) for end in (LEAST_SPREAD, MOST_SPREAD))
    return Estimate(value, None, 0.0 if low is None else low, high, "profile", True)


def _crossing(seen: PoolEstimate, start: float, end: float, level: float) -> float | None:
    from scipy.optimize import brentq

    excess = lambda log: seen.criterion(float(np.exp(log))) - level  # noqa: E731
    first, last = float(np.log(start)), float(np.log(end))
    if excess(last) <= 0 or first == last:
        return None
    return float(np.exp(brentq(excess, first, last, xtol=1e-10)))


def _physical(transform: Transform, z: float) -> float:
    return float(transform.physical(np.array([z]))[0])


def of_all(fits: Sequence[Any], confidence: float) -> dict[str, Estimate]:
    """Variances of all components of a fit."""
    return {
        name: estimate
        for fit in fits
        for name, estimate in pooled_estimates(fit.final.problem, fit.z, confidence).items()
    }
