"""Variances that are not known, of one data set beside others: by restricted maximum likelihood.

    -2 ln L_R = ln det V + ln det (A₀ + Jᵀ V⁻¹ J) + rᵀ V⁻¹ r - bᵀ (A₀ + Jᵀ V⁻¹ J)⁻¹ b

with r the residuals at the fit and J their slopes, A₀ and b₀ what the other data sets and the priors
know of the parameters, b = b₀ + Jᵀ V⁻¹ r. The parameters that the curve costs are accounted for, so
that the variance of residuals of n points and p parameters is Σ r²/(n - p).

Source: Patterson and Thompson, Biometrika 58, 545 (1971).
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from calibration.fitting.set_errors import SetErrors

LEAST, MOST = 1e-9, 1e3  # of a variance, over the mean square of the residuals
NONE = 1e-7  # the same, below which it counts as none
STEP = 1e-4  # of a variance, of central differences
CURVED = 3e-2  # in the logarithm of a variance, of second differences
RIDGE = 1e-12  # of the information, where parameters are not told apart
TOLERANCES = {"ftol": 1e-9, "gtol": 1e-5}  # Newton steps follow


@dataclass(frozen=True)
class Seen:
    """What a data set's variances are judged by.

    Attributes:
        residual, jacobian: not weighted, (n,) and (n, p).
        information, gradient: A₀ and b₀.
    """

    residual: Float[np.ndarray, "n"]
    jacobian: Float[np.ndarray, "n p"]
    information: Float[np.ndarray, "p p"]
    gradient: Float[np.ndarray, "p"]


def criterion(errors: SetErrors, seen: Seen, restricted: bool = True) -> float:
    """-2 ln L_R up to a constant, or with r for what is left over -2 ln L."""
    both = errors.whiten(np.concatenate([seen.residual[:, None], seen.jacobian], axis=1))
    residual, jacobian = both[:, 0], both[:, 1:]
    value = errors.log_determinant + float(residual @ residual)
    if not restricted or not jacobian.shape[1]:
        return value
    information = seen.information + jacobian.T @ jacobian
    size = np.sqrt(np.maximum(np.diagonal(information), 1e-300))
    scaled = information / np.outer(size, size) + RIDGE * np.eye(len(size))
    gradient = (seen.gradient + jacobian.T @ residual) / size
    value += float(np.linalg.slogdet(scaled)[1] + 2 * np.sum(np.log(size)))
    return value - float(gradient @ np.linalg.solve(scaled, gradient))


def estimated(
    errors: SetErrors, seen: Seen, unknown: tuple[str, ...], restricted: bool = True
) -> dict[str, float]:
    """The variances of the largest (restricted) likelihood, from those that `errors` has, if any."""
    from scipy.optimize import minimize

    search = _Search(errors, seen, unknown, restricted)
    ends = [
        minimize(
            search.value,
            start,
            jac=search.slope,
            method="L-BFGS-B",
            bounds=[(LEAST, MOST)] * len(unknown),
            options=TOLERANCES,
        )
        for start in search.starts()
    ]
    best = min(ends, key=lambda end: end.fun)
    return search.variances(search.polished(best.x))


def relative_covariance(errors: SetErrors, seen: Seen) -> Float[np.ndarray, "k k"]:
    """Of the logarithms of the variances, from the curvature of the criterion; 0 for one that is 0."""
    unknown = tuple(errors.variance)
    search = _Search(errors, seen, unknown, True)
    x = search.place(errors.variance)
    inside = [k for k in range(len(unknown)) if errors.variance[unknown[k]] > 0]
    covariance = np.zeros((len(unknown), len(unknown)))
    if inside:
        curvature = search.curvature(x)[np.ix_(inside, inside)]
        values, vectors = np.linalg.eigh(0.5 * curvature)
        # a variance that the data hardly tell: as if from one degree of freedom
        covariance[np.ix_(inside, inside)] = (vectors / np.maximum(values, 0.5)) @ vectors.T
    return covariance


class _Search:
    """The criterion over the variances, in units of the residuals' mean square.

    On this scale and not in logarithms: where a variance is 0 the slope tells whether it should be.
    """

    def __init__(self, errors: SetErrors, seen: Seen, unknown, restricted: bool):
        self.errors, self.seen, self.restricted = errors, seen, restricted
        self.unknown = unknown
        self.square = max(float(np.mean(seen.residual**2)), 1e-30)
        self.unit = np.array([self.square / _of_unit(errors, kind) for kind in unknown])

    def variances(self, x) -> dict[str, float]:
        """0 where it is none; but something has to be left."""
        values = np.where(x > NONE, x, 0.0) * self.unit
        if not np.any(values > 0) and not self._is_definite():
            values[0] = NONE * self.unit[0]
        return dict(zip(self.unknown, map(float, values), strict=True))

    def place(self, variance: Mapping[str, float]) -> np.ndarray:
        values = np.array([variance[kind] for kind in self.unknown]) / self.unit
        return np.clip(values, LEAST, MOST)

    def starts(self) -> list[np.ndarray]:
        """Where the search was; else equal shares, and most in each of the variances."""
        if all(kind in self.errors.variance for kind in self.unknown):
            return [self.place(self.errors.variance)]
        k = len(self.unknown)
        return [np.full(k, 0.5 / k)] + [np.where(np.arange(k) == j, 0.9, 0.05) for j in range(k)]

    def value(self, x) -> float:
        variance = dict(zip(self.unknown, map(float, x * self.unit), strict=True))
        return criterion(self.errors.with_variance(variance), self.seen, self.restricted)

    def slope(self, x) -> np.ndarray:
        return np.array([self._difference(x, k) for k in range(len(x))])

    def _difference(self, x, k: int) -> float:
        ends = np.array([x, x])
        step = STEP * max(x[k], NONE)
        ends[0, k], ends[1, k] = max(x[k] - step, 0.5 * LEAST), x[k] + step
        low, high = (self.value(end) for end in ends)
        return (high - low) / (ends[1, k] - ends[0, k])

    def curvature(self, x) -> np.ndarray:
        """Second derivatives in the logarithms."""
        count, steps = len(x), CURVED * np.eye(len(x))
        found = np.empty((count, count))
        for i in range(count):
            for j in range(i + 1):
                a, b = steps[i], steps[j]
                ends = [(1, a + b), (-1, a - b), (-1, b - a), (1, -a - b)]
                total = sum(sign * self.value(x * np.exp(step)) for sign, step in ends)
                found[i, j] = found[j, i] = total / (4 * CURVED**2)
        return found

    def polished(self, x) -> np.ndarray:
        """Two Newton steps along what is above 0, so that equal fits end at equal numbers."""
        inside = np.flatnonzero(x > NONE)
        for _ in range(2 if len(inside) else 0):
            slope = (x * self.slope(x))[inside]
            values, vectors = np.linalg.eigh(self.curvature(x)[np.ix_(inside, inside)])
            if np.min(values) <= 0:
                break
            step = np.zeros(len(x))
            step[inside] = -(vectors / values) @ (vectors.T @ slope)
            moved = np.clip(x * np.exp(np.clip(step, -1.0, 1.0)), LEAST, MOST)
            if self.value(moved) > self.value(x):
                break
            x = moved
        return x

    def _is_definite(self) -> bool:
        """Whether every point has a variance without any of the unknown ones."""
        if self.errors.points.size_is_unknown:
            return False
        return np.min(self.errors.with_variance({}).alone.diagonal) > NONE * self.square


def _of_unit(errors: SetErrors, kind: str) -> float:
    """The mean variance of ε that a variance of one makes."""
    if kind in ("scatter", "group"):
        return 1.0
    ones = errors.with_variance({"timing": 1.0} if errors.points.size_is_unknown else {})
    return max(float(np.mean(ones.alone.diagonal)), 1e-300)
