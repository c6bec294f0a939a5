"""From ε² to ε, continued to where nothing rebounds, so that a search finds its way back."""

from typing import Any

import numpy as np

TINY_SQUARED = 1e-6  # below this ε² the root is continued by another
NO_REBOUND_BELOW = (2 - 2**0.5) * TINY_SQUARED**0.5  # what `extended_root` gives at ε² = 0


def extended_root(squared: Any, xp: Any = np) -> Any:
    """√(ε²), continued with a slope to below zero.

    For ε² < s = 1e-6 it is 2√s - √(2s - ε²). Data points near a fit are far from it.
    """
    s = TINY_SQUARED
    inside = squared > s
    root = xp.sqrt(xp.where(inside, squared, s))
    return xp.where(inside, root, 2 * s**0.5 - xp.sqrt(2 * s - xp.where(inside, s, squared)))


def root_slope(squared: np.ndarray) -> np.ndarray:
    """Its derivative."""
    s = TINY_SQUARED
    return 0.5 / np.sqrt(np.where(squared > s, squared, 2 * s - np.minimum(squared, s)))
