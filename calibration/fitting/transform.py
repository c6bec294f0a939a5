"""The one map between the search and physics: θ(z), element by element.

log      θ = lower + eᶻ, or upper - e^{-z} where only the upper end is finite
logit    θ = lower + (upper - lower)/(1 + e⁻ᶻ)
none     θ = z, kept within its bounds
"""

import math
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

NONE, LOG, LOGIT, FROM_ABOVE = range(4)
LARGEST_EXPONENT = 690.0
INSIDE = 1e-12  # a start at a bound, or beyond, is moved that far inside (of the range)

Vector = Float[np.ndarray, "... p"]


class Transform(NamedTuple):
    """Kind and bounds of p elements, each (p,)."""

    kind: np.ndarray
    lower: np.ndarray
    upper: np.ndarray

    @classmethod
    def of(cls, ranges, asked) -> "Transform":
        """For (lowest, highest) of each element and the transform asked for, or None."""
        kinds = [_kind(low, high, name) for (low, high), name in zip(ranges, asked, strict=True)]
        low, high = np.array(ranges, float).reshape(-1, 2).T
        return cls(np.array(kinds, int), low, high)

    def physical(self, z: Any, xp: Any = np) -> Any:
        """θ(z) of (..., p); `xp` is numpy or jax.numpy."""
        low, high = self._finite()
        limit = LARGEST_EXPONENT
        z_safe = xp.clip(z, -limit, limit)
        # each branch sees z only where it is used: no overflow, no NaN in a gradient
        up = xp.exp(xp.where(self.kind == LOG, z_safe, 0.0))
        down = xp.exp(-xp.where(self.kind == FROM_ABOVE, z_safe, 0.0))
        part = 1 / (1 + xp.exp(-xp.where(self.kind == LOGIT, z_safe, 0.0)))
        plain = xp.clip(z, self.lower, self.upper)
        theta = xp.where(self.kind == LOG, low + up, plain)
        theta = xp.where(self.kind == FROM_ABOVE, high - down, theta)
        return xp.where(self.kind == LOGIT, low + (high - low) * part, theta)

    def slope(self, z: Vector) -> Vector:
        """dθ/dz."""
        inside = (self.lower <= z) & (z <= self.upper)
        return np.where(self.kind == NONE, inside, np.exp(self.log_slope(z, np)))

    def log_slope(self, z: Any, xp: Any = jnp) -> Any:
        """ln |dθ/dz| of (..., p): what a density of θ is multiplied by in z."""
        low, high = self._finite()
        at = xp.clip(z, -LARGEST_EXPONENT, LARGEST_EXPONENT)
        logit = np.log(np.where(self.kind == LOGIT, high - low, 1.0)) - xp.logaddexp(0.0, at)
        by_kind = [xp.zeros_like(at), at, logit - xp.logaddexp(0.0, -at), -at]
        return xp.choose(np.broadcast_to(self.kind, at.shape), by_kind, mode="clip")

    def unconstrained(self, theta: Any, xp: Any = np) -> Any:
        """z(θ), the inverse; values at a bound or beyond are moved just inside."""
        theta = xp.asarray(theta, float)
        low, high = self._finite()
        log = xp.log(xp.maximum(theta - low, 1e-290))
        above = -xp.log(xp.maximum(high - theta, 1e-290))
        span = np.where(self.kind == LOGIT, high - low, 1.0)
        part = xp.clip((theta - low) / span, INSIDE, 1 - INSIDE)
        logit = xp.log(part) - xp.log1p(-part)
        kinds = np.broadcast_to(self.kind, theta.shape)
        return xp.choose(kinds, [theta, log, logit, above], mode="clip")

    def bound_beyond(self, direction: Vector) -> Vector:
        """The bound that z nears when it goes up (+1) or down (-1); infinite where there is none."""
        return np.where(direction > 0, self.upper, self.lower)

    def part(self, which) -> "Transform":
        return Transform(*(a[which] for a in self))

    def _finite(self):
        """Bounds with harmless numbers where they are not used."""
        low = np.where(np.isfinite(self.lower), self.lower, 0.0)
        return low, np.where(np.isfinite(self.upper), self.upper, 1.0)


def _kind(low: float, high: float, asked: str | None) -> int:
    """The transform asked for, or the one that the bounds ask for.

    A logarithm between two bounds is the logit, which nears it at small values.
    """
    ends = math.isfinite(low), math.isfinite(high)
    natural = {(True, True): LOGIT, (True, False): LOG, (False, True): FROM_ABOVE}
    return NONE if asked == "none" else natural.get(ends, NONE)
