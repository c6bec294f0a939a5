"""The likelihood of one data set's residuals in JAX, shared errors and unknown variances included.

    V = κ C + s_t² C_t + s² 1 + τ² Z Zᵀ

as in `set_errors`, with V a function of the parameters: unknown variances are among them, and
errors of velocities enter by the curve's slope at the measured velocity, to first order.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax.scipy.linalg import cho_solve, solve_triangular
from jaxtyping import Array

from calibration.data import RestitutionData
from calibration.errors import DataError
from calibration.fitting.plan import ErrorPlan

# what θ calls the square root of each unknown variance
CALLED = {"scatter": "noise", "scale": "scale", "timing": "timing", "group": "group"}
LN_2PI = math.log(2 * math.pi)


@dataclass(frozen=True, eq=False)
class SetLikelihood:
    """Of one data set.

    Attributes:
        data, plan: the measurements, and what of their errors is not stated.
        labels: what θ calls the square root of each unknown variance, by the names of
            `ErrorPlan.unknown`.
    """

    data: RestitutionData
    plan: ErrorPlan
    labels: Mapping[str, str]

    @property
    def needs_slope(self) -> bool:
        """Whether dε/dv of the curve is needed."""
        errors = self.data.errors
        alone = errors.velocity_alone is not None and np.any(errors.velocity_alone > 0)
        return bool(alone or np.any(errors.to_velocity))

    @property
    def per_second(self) -> float:
        """What errors of 1 s of all times make in ε, root mean square."""
        factors = self.data.errors.to_restitution * self.data.errors.sizes_at(1.0)
        return max(float(np.sqrt(np.mean(np.sum(factors**2, axis=1)))), 1e-300)

    def log_likelihood(self, theta: Mapping[str, Any], residual: Array, slope: Any) -> Array:
        """ln p of all points together."""
        if not self.plan.shares:
            return jnp.sum(self.by_point(theta, residual, slope))
        root = self.root(theta, residual, slope)
        white = solve_triangular(root, residual, lower=True)
        log_root = jnp.sum(jnp.log(jnp.diagonal(root)))
        return -0.5 * jnp.sum(white**2) - log_root - 0.5 * len(self.data) * LN_2PI

    def by_point(self, theta: Mapping[str, Any], residual: Array, slope: Any) -> Array:
        """ln p of each point; where points share errors, of each where the others are known.

        Source: Bürkner, Gabry and Vehtari, Comput. Stat. 36, 1243 (2021), Eq. 8.
        """
        if not self.plan.shares:
            variance = self.root(theta, residual, slope) ** 2
            return -0.5 * (residual**2 / variance + jnp.log(variance) + LN_2PI)
        root = self.root(theta, residual, slope)
        inverse = cho_solve((root, True), jnp.eye(len(self.data)))
        precision = jnp.diagonal(inverse)
        return -0.5 * ((inverse @ residual) ** 2 / precision - jnp.log(precision) + LN_2PI)

    def whitened(self, theta: Mapping[str, Any], residual: Array, slope: Any) -> Array:
        """Residuals over their standard deviations, without what they share; over 1 where θ tells none."""
        if self.plan.plain and self.labels["scatter"] not in theta:
            return residual
        root = self.root(theta, residual, slope)
        if not self.plan.shares:
            return residual / root
        return solve_triangular(root, residual, lower=True)

    def root(self, theta: Mapping[str, Any], residual: Array, slope: Any) -> Array:
        """Standard deviations (n,), or the Cholesky factor (n, n) of V where points share errors."""
        of_stated = self._deviation(theta, "timing", residual) * self._deviation(
            theta, "scale", residual
        )
        errors, slopes = self.data.errors, jnp.broadcast_to(jnp.asarray(slope), (len(self.data),))
        alone = of_stated**2 * jnp.asarray(errors.variance_alone(slopes))
        alone += self._deviation(theta, "scatter", residual, absent=0.0) ** 2
        factors = errors.factors(slopes) * errors.sizes_at(1.0) * of_stated
        if not self.plan.shares:
            return jnp.sqrt(alone + jnp.sum(factors**2, axis=1))
        rows = jnp.arange(len(self.data))[:, None]
        spread = jnp.zeros((len(self.data), errors.count + 1)).at[rows, errors.index].add(factors)
        spread = spread[:, :-1]  # the last stands for none
        covariance = spread @ spread.T + jnp.diag(alone)
        if "group" in self.plan.unknown:
            covariance += self._deviation(theta, "group", residual) ** 2 * self._together
        return jnp.linalg.cholesky(covariance)

    def _deviation(self, theta, kind: str, residual: Array, absent: float = 1.0) -> Any:
        """The square root of an unknown variance as θ has it."""
        if kind not in self.plan.unknown:
            return absent
        label = self.labels[kind]
        if label in theta:
            return jnp.asarray(theta[label])
        if not self.plan.plain:
            raise DataError("theta", f"without {label!r}", "with it: only plain noise is profiled")
        return jnp.sqrt(jnp.mean(residual**2))  # the noise of the largest likelihood

    @property
    def _together(self) -> np.ndarray:
        """Z Zᵀ: 1 where two points are of one group."""
        group = self.data.group_index
        assert group is not None
        return (group[:, None] == group[None, :]).astype(float)
