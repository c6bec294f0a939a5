"""Pooled parameters: members of several data sets that lie around a common mean.

On the scale z that is searched z_g ~ N(μ, τ²). The data give ẑ with covariance A⁻¹, all other parameters at
their best; then ẑ ~ N(μ 1, Σ) with Σ = A⁻¹ + τ² 1, and τ is where the restricted

    -2 ln L_R = ln det Σ + ln 1ᵀ Σ⁻¹ 1 + (ẑ - μ)ᵀ Σ⁻¹ (ẑ - μ)

is least. Two members at 0 and 2, each known to the variance 0.5, have the sample variance 2, of which 0.5 is
their own: τ² = 1.5, and the mean 1 has the standard error √(2/2).

>>> members = PoolEstimate(np.array([0.0, 2.0]), np.diag([0.5, 0.5]))
>>> round(members.spread**2, 4)
1.5
>>> [round(float(x), 4) for x in members.mean(members.spread)[:2]]
[1.0, 1.0]

Source: Harville, J. Am. Stat. Assoc. 72, 320 (1977).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import special

from calibration.fitting.elements import Pool
from calibration.fitting.material import Estimate
from calibration.fitting.problem import Problem

LEAST_SPREAD, MOST_SPREAD = 1e-4, 30.0  # of τ, in z: one number, and factors of e^30
PLACES = 25  # of ln τ in which the least -2 ln L_R is looked for: every half in the logarithm
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
        places = np.linspace(*ends, PLACES)
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
