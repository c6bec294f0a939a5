"""The linear spring–dashpot in closed form, for either end of its contact.

With the angle a of the damping, ξ = cos a and √(1 - ξ²) = sin a, the motion is
δ ∝ e^{-ω0 t cos a} sin(ω0 t sin a) and the two ends are at ω0 T sin a = π and = 2a:

    end of the contact       ω0 T           ε                  as ε_in → 0 (a → 0)
    δ = 0                    π/sin a        e^{-π cot a}       T → ∞
    zero force               2a/sin a       e^{-2a cot a}      T → 2/ω0, ε → e^{-2}

T. Schwager and T. Pöschel, Granular Matter 9, 465 (2007).
"""

import math

import numpy as np
from jaxtyping import ArrayLike, Float

ENDS = ("zero-overlap", "zero-force")
Values = Float[ArrayLike, "..."]


def damping_angle(restitution: Values) -> np.ndarray:
    """a in (0, π/2], the angle whose damping ξ = cos a gives ε with the δ = 0 end.

    Args:
        restitution: ε in (0, 1] [-], the law's input.
    """
    return np.arctan2(math.pi, -np.log(restitution))


def duration(restitution: Values, end: str) -> np.ndarray:
    """ω0 T [-] of the law whose input is `restitution`."""
    angle = damping_angle(restitution)
    return _reach(angle, end) / np.sin(angle)


def rebound(restitution: Values, end: str) -> np.ndarray:
    """ε [-] of the law whose input is `restitution`."""
    angle = damping_angle(restitution)
    return np.exp(-_reach(angle, end) / np.tan(angle))


def restitution_that_gives(wanted: float, end: str) -> float | None:
    """The input with which the law rebounds with `wanted`; None where no damping does that.

    The zero-force end leaves no rebound below e^{-2} = 0.135.
    """
    if not 0 < wanted <= 1:
        return None
    if end == "zero-overlap" or wanted == 1:
        return float(wanted)
    if wanted <= math.exp(-2):
        return None
    from scipy.optimize import brentq

    loss = -math.log(wanted)
    angle = brentq(lambda a: 2 * a / math.tan(a) - loss, 1e-9, math.pi / 2, xtol=1e-15)
    return math.exp(-math.pi / math.tan(angle))


def _reach(angle, end: str):
    """ω0 T sin a."""
    if end not in ENDS:
        raise ValueError(f"`end` must be one of {ENDS}, but is {end!r}")
    return np.pi if end == "zero-overlap" else 2 * angle
