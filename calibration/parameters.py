"""The one map between the search and physics.

The search runs over an unconstrained vector z; everything else sees physical values. `Layout.table`
is that map, z -> a table of one row per data set and one column per name in `COLUMNS`. Its
Jacobian is taken by autodiff wherever it is needed.
"""

import math
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from calibration.parameters_spec import RANGES, TRANSFORMS, ParameterSpec

# χ̃, σ, ψ, what sound and heat leave at v_cr, a constant ε, Y, E, v_lim, Eq. (18)'s c1 and c2
COLUMNS = tuple(RANGES)
CONTACT_COLUMNS = ("yield_strength", "youngs_modulus", "limit_velocity")
LINE_COLUMNS = ("c1", "c2")
LOG, LOGIT, NONE = range(3)
LARGEST_EXPONENT = 690.0


class Layout(NamedTuple):
    """Where each entry of the table comes from; arrays only, so that equal shapes compile once.

    z is padded by elements that nothing uses, for the same reason.

    Attributes:
        fixed: the table's values where nothing is free, (sets, columns).
        index: position in z of each entry, -1 where it is fixed.
        kind: LOG, LOGIT or NONE for each element of z.
        lower, upper: its bounds.
        on_line: sets whose χ̃ is c1 + c2 E/Y (Eq. 18).
        up_given: sets whose ε_up is a parameter of its own, not Eq. (17) at v_cr.
    """

    fixed: Float[np.ndarray, "sets columns"]
    index: np.ndarray  # type: ignore[assignment]  # a column, not tuple.index
    kind: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    on_line: np.ndarray
    up_given: np.ndarray

    def physical(self, z, xp=jnp) -> Array:
        """θ(z), element by element: lower + eᶻ, lower + (upper - lower)/(1 + e⁻ᶻ), or z itself.

        `xp` is jax.numpy, or numpy where nothing is differentiated.
        """
        is_log, is_logit = self.kind == LOG, self.kind == LOGIT
        lower = xp.where(self.kind == NONE, 0.0, self.lower)
        span = xp.where(is_logit, self.upper, 1.0) - xp.where(is_logit, self.lower, 0.0)
        # each branch sees z only where it is used: no overflow, no NaN in a gradient
        limit = LARGEST_EXPONENT
        log = lower + xp.exp(xp.clip(xp.where(is_log, z, 0.0), -limit, limit))
        logit = xp.clip(xp.where(is_logit, z, 0.0), -limit, limit)
        logit = lower + span / (1 + xp.exp(-logit))
        plain = xp.clip(z, self.lower, self.upper)
        return xp.where(is_log, log, xp.where(is_logit, logit, plain))

    def slope(self, z) -> np.ndarray:
        """∂θ/∂z, element by element, by NumPy."""
        theta = self.physical(z, np)
        with np.errstate(invalid="ignore"):
            logit = (theta - self.lower) * (self.upper - theta) / (self.upper - self.lower)
        inside = (self.lower <= z) & (z <= self.upper)
        bounded = np.where(self.kind == LOG, theta - self.lower, logit)
        return np.where(self.kind == NONE, np.where(inside, 1.0, 0.0), bounded)

    def unconstrained(self, theta) -> np.ndarray:
        """z(θ), the inverse; values at a bound or beyond are moved just inside."""
        theta = np.asarray(theta, float)
        with np.errstate(invalid="ignore", divide="ignore"):
            log = np.log(np.maximum(theta - self.lower, 1e-290))
            part = np.clip((theta - self.lower) / (self.upper - self.lower), 1e-12, 1 - 1e-12)
            logit = np.log(part) - np.log1p(-part)
        return np.where(self.kind == LOG, log, np.where(self.kind == LOGIT, logit, theta))

    def table(self, z, xp=jnp) -> dict[str, Array]:
        """Every physical quantity of every data set: {column: (sets,)}."""
        theta = xp.concatenate([self.physical(z, xp), xp.zeros(1)])
        values = xp.where(self.index >= 0, theta[self.index], self.fixed)
        return {name: values[:, i] for i, name in enumerate(COLUMNS)}

    def numpy_table(self, z) -> dict[str, np.ndarray]:
        """The same by NumPy."""
        return self.table(np.asarray(z), np)

    def start(self) -> np.ndarray:
        """z of the table's own values."""
        theta = np.ones(len(self.kind))
        used = self.index >= 0
        theta[self.index[used]] = np.asarray(self.fixed)[used]
        return self.unconstrained(theta)


def column(name: str) -> int:
    return COLUMNS.index(name)


def kind_and_bounds(spec: ParameterSpec) -> tuple[int, float, float]:
    """The transform in force: the one asked for, or the one that the bounds ask for.

    A logarithm with an upper bound is the logit, which nears it at small values.
    """
    lower, upper = spec.bounds or spec.range
    natural = "logit" if math.isfinite(upper) else "log"
    if not math.isfinite(lower):
        natural = "none"
    kind = TRANSFORMS.index(spec.transform or natural)
    if kind == LOG and math.isfinite(upper):
        kind = LOGIT
    return kind, lower, upper
