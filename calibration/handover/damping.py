"""Damping and ε of the laws whose ε is one at all velocities, for both ends of a contact.

With ξ the fraction of critical damping and w = √(1 - ξ²), of the linear spring and, with
ξ = α/√5, of Hertz's with its dashpot ∝ δ^{1/4}:

    "zero-overlap"  ε = exp(-πξ/w)
    "zero-force"    ε = exp[-(ξ/w) atan2(2ξw, 2ξ² - 1)]
"""

import math

from scipy.optimize import brentq

from calibration.errors import DataError

LEAST = math.exp(-2)  # ε of critical damping where the force never pulls


def rebound(fraction: float, end: str) -> float:
    """ε of a fraction ξ in [0, 1) of critical damping."""
    w = math.sqrt(1 - fraction**2)
    if end == "zero-overlap":
        return math.exp(-math.pi * fraction / w)
    return math.exp(-fraction / w * math.atan2(2 * fraction * w, 2 * fraction**2 - 1))


def fraction_of(restitution: float, end: str) -> float:
    """The fraction ξ of critical damping that gives ε, the inverse of `rebound`.

    Raises:
        ValueError: for an ε that no damping gives.
    """
    least = LEAST if end == "zero-force" else 0.0
    if not least < restitution <= 1:
        accepted = f"in ({least:.4g}, 1], which a contact with the end {end!r} can give"
        raise DataError("restitution", restitution, accepted)
    if restitution == 1:
        return 0.0
    if end == "zero-overlap":
        loss = -math.log(restitution)
        return loss / math.hypot(math.pi, loss)
    return brentq(lambda fraction: rebound(fraction, end) - restitution, 0.0, 1 - 1e-12, xtol=1e-15)


def set_restitution(fraction: float) -> float:
    """What `restitution` of a dashpot law is set to for this damping, whatever its end."""
    return rebound(fraction, "zero-overlap")
