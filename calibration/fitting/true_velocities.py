"""What a measured velocity tells of the true one, where its error is not small against the range of velocities.

A measured velocity v is the true one plus an error of standard uncertainty u_v. Which true velocity is likely depends on
how those are distributed, and on how u_v goes with v. With ln v ~ N(μ, ω²), where μ is the mean of those measured and
ω² + mean (u_v/v)² their variance, and u_v in proportion to v^m, the true velocity is expected to be off by

    d = v [(2m - 1) ω² - (ln v - μ)] u_v²/(u_v² + ω² v²)

Without it curves are too flat, by 0.3 to 0.5 standard errors from 30 velocities to 10 %. m is that of a straight line
through ln u_v over ln v, and u_v is taken from that line, where it misses them by no more than the errors of v do;
else m = ½, which favours no velocity. Velocities of 1, 2 and 4 m/s, each to 20 % (m = 1, ω² = ln² 2 - 0.2²): the
lowest is expected higher, by (ω² + ln 2) 0.2²/(0.2² + ω²) of it, and the highest lower:

>>> velocity = np.array([1.0, 2.0, 4.0])
>>> expected_shift(velocity, 0.2 * velocity, 1.0).round(3)
array([ 0.094,  0.073, -0.084])

Source: Gull, in Maximum Entropy and Bayesian Methods (1989), p. 511, and Carroll, Ruppert, Stefanski and Crainiceanu,
Measurement Error in Nonlinear Models (2006), section 4.5.
"""

from dataclasses import replace

import numpy as np

from calibration.data import PointErrors

POWERS = (-1.5, 2.5)  # of v: errors of heights (-1), of velocities (0, 1), of times (2)
ALONG = 1.5  # times the scatter about a power that errors of v make, of u_v that follow it


def expected_shift(velocity: np.ndarray, uncertainty: np.ndarray, power: float) -> np.ndarray:
    """d of each velocity, (n,) [m/s]; `power` is m."""
    if len(velocity) < 2 or not np.any(uncertainty):
        return np.zeros(len(velocity))
    place, square = np.log(velocity), (uncertainty / velocity) ** 2
    spread = np.maximum(np.var(place, ddof=1) - np.mean(square), 0.0)
    towards = np.mean(place) - place + (2 * power - 1) * spread
    return velocity * towards * square / np.where(square > 0, square + spread, 1.0)


def with_power(points: PointErrors, velocity: np.ndarray) -> tuple[PointErrors, float]:
    """Errors of velocities along a power of these, and m."""
    u_v = points.u_velocity
    if u_v is None or np.any(points.to_velocity) or np.min(u_v) <= 0 or np.ptp(velocity) == 0:
        return points, 0.5
    place, size = np.log(velocity) - np.mean(np.log(velocity)), np.log(u_v)
    power = float(place @ size / (place @ place))
    line = np.mean(size) + power * place
    share = np.exp(line) / velocity  # moves ln v, and the line along
    allowed = ALONG * abs(power) * np.mean(share**2) ** 0.5
    if np.mean((size - line) ** 2) ** 0.5 > allowed + 1e-9 or not POWERS[0] <= power <= POWERS[1]:
        return points, 0.5
    return replace(points, u_velocity=np.exp(line)), power
