"""Partial pooling: parameters of several data sets around a common mean, z_g ~ N(μ, τ²).

The data tell ẑ with covariance A⁻¹, all other parameters at their best; then ẑ ~ N(μ 1, Σ) with
Σ = A⁻¹ + τ² 1, and τ is where the restricted likelihood is largest,

    -2 ln L_R = ln det Σ + ln 1ᵀ Σ⁻¹ 1 + (ẑ - μ)ᵀ Σ⁻¹ (ẑ - μ)

z is the scale that is searched: the logarithm of what is positive, so that τ is a relative spread.

Source: Harville, J. Am. Stat. Assoc. 72, 320 (1977).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from calibration.fitting.estimate import Estimate
from calibration.fitting.problem import Pool, Problem
from calibration.fitting.transform import Transform

LEAST, MOST = 1e-4, 30.0  # of a spread, in z
RIDGE = 1e-10  # of the largest information: a data set that tells nothing of its own


@dataclass(frozen=True)
class Seen:
    """What the data tell of a pool's members: ẑ and its covariance."""

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
        """Where L_R is largest."""
        from scipy.optimize import minimize_scalar

        at = lambda log: self.criterion(float(np.exp(log)))  # noqa: E731
        ends = np.log(LEAST), np.log(MOST)
        places = np.linspace(*ends, 25)
        best = places[int(np.argmin([at(x) for x in places]))]
        near = (max(best - 0.6, ends[0]), min(best + 0.6, ends[1]))
        found = minimize_scalar(at, bounds=near, method="bounded", options={"xatol": 1e-8})
        return float(np.exp(found.x)) if found.fun < at(ends[0]) else LEAST

    @property
    def error(self) -> float:
        """Of a member by its data alone, the median of all."""
        return float(np.sqrt(np.median(np.diagonal(self.covariance))))

    def mean(self, spread: float) -> tuple[float, float]:
        """μ and its standard error."""
        inverse = np.linalg.inv(self.covariance + spread**2 * np.eye(len(self.place)))
        information = float(np.sum(inverse))
        return float(np.sum(inverse @ self.place)) / information, information**-0.5


def respread(problem: Problem, z: np.ndarray) -> Problem:
    """The problem with the spread of each pool as the data tell it at z."""
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


def seen_by_pool(problem: Problem, z: np.ndarray, pool: Pool) -> Seen:
    """What the data and the priors of other parameters tell, without what the pool adds."""
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
    information += RIDGE * max(float(np.max(np.diag(information))), 1e-300) * np.eye(len(own))
    covariance = np.linalg.inv(information)
    return Seen(z[list(pool.members)] - covariance @ slopes.T @ off, covariance)


def _without(columns: np.ndarray) -> Any:
    """What is left of values beside all that the columns can make."""
    left, singular, _ = np.linalg.svd(columns, full_matrices=False)
    basis = left[:, singular > 1e-9 * np.max(singular, initial=0.0)]
    return lambda values: values - basis @ (basis.T @ values)


def _rows_of(problem: Problem, pool: Pool) -> slice:
    """Where a pool's rows stand among the residuals: behind the points and the priors."""
    first = problem.count + len(problem.with_prior)
    for one in problem.pools:
        if one.name == pool.name:
            break
        first += len(one.members)
    return slice(first, first + len(pool.members))


def _spread_estimate(seen: Seen, pool: Pool, confidence: float) -> Estimate:
    """With the limits where the restricted likelihood falls by the χ² quantile's half."""
    from scipy import special

    value = pool.spread if pool.spread > 2 * LEAST else 0.0
    level = seen.criterion(pool.spread) + float(special.chdtri(1, 1 - confidence))
    low, high = (_crossing(seen, pool.spread, end, level) for end in (LEAST, MOST))
    return Estimate(value, None, 0.0 if low is None else low, high, "profile", True)


def _crossing(seen: Seen, start: float, end: float, level: float) -> float | None:
    from scipy.optimize import brentq

    excess = lambda log: seen.criterion(float(np.exp(log))) - level  # noqa: E731
    first, last = float(np.log(start)), float(np.log(end))
    if excess(last) <= 0 or first == last:
        return None
    return float(np.exp(brentq(excess, first, last, xtol=1e-10)))


def _physical(transform: Transform, z: float) -> float:
    return float(transform.physical(np.array([z]))[0])


def of_all(fits: Sequence[Any], confidence: float) -> dict[str, Estimate]:
    """Of all components of a fit."""
    return {
        name: estimate
        for fit in fits
        for name, estimate in pooled_estimates(fit.final.problem, fit.z, confidence).items()
    }
