"""The same collisions in compiled loops over all cores: what one would write in C.

Everything is in units of first yield: overlaps over δ_cr, velocities over v_cr, forces over k δ_cr^{3/2};
d and X are Zhou's plasticity and steepness.
"""

import numba
import numpy as np

ELASTIC_DURATION = 2.9432751843  # of a Hertzian contact, in largest overlap over impact velocity
# Newton steps in the peak and in the residual overlap; one less loses digits between 1.5 and 250 v_cr
PEAK_STEPS = RELEASE_STEPS = 4


@numba.njit(inline="always")  # a call of its own takes three times as long
def collision(d, steepness, y):
    """ε_p² of one impact at y > 1 by the energy balance, and its derivative by the steepness X."""
    s = y**0.4
    target = 0.4 * y * y
    for _ in range(PEAK_STEPS):
        e = s - 1
        work = 0.4 * s**5 - d * e**3 * (8 / 3 + e * (5 + e * (4 + e * (5 / 3 + e * 2 / 7))))
        force = s**3 - d * e * e * (2 + e) * (2 + e * (2 + e))
        s -= (work - target) / (2 * s * force)
    x = s * s
    yielded = d * (x * x - 1) / (x * s)
    c3, c2, c1, c0 = 1 - d * x, yielded * steepness, d / x, yielded * (steepness - 1)
    r = min(np.sqrt(c0 / c2), (c0 / c3) ** (1 / 3), c0 / c1)
    for _ in range(RELEASE_STEPS):
        value = ((c3 * r + c2) * r + c1) * r - c0
        r -= value / ((3 * c3 * r + 2 * c2) * r + c1)
    part = 1 - r * r
    bracket = 0.4 * c3 * (1 - r**5) + 2 / 3 * c1 * (1 - r**3)
    bracket += yielded * part * (1 - 0.5 * steepness * part)
    scale = 2.5 * s**5 / (y * y)
    # the force vanishes where unloading ends: that end moves the work in second order only
    return scale * bracket, -0.5 * scale * yielded * part * part


@numba.njit(parallel=True)
def energy_balance(d, steepness, y, up_loss):
    """ε and ε_p at y > 1, with ε_up² - 1 of Eq. (16)."""
    total, plastic = np.empty_like(y), np.empty_like(y)
    for j in numba.prange(y.size):
        squared, _ = collision(d, steepness, y[j])
        plastic[j] = np.sqrt(squared)
        total[j] = np.sqrt(max(squared + up_loss, 0.0))
    return total, plastic


@numba.njit(parallel=True)
def verlet(d, steepness, y, steps):
    """ε_p by velocity Verlet with so many steps in an elastic contact, as particle codes step."""
    result = np.empty_like(y)
    for i in numba.prange(y.size):
        h = ELASTIC_DURATION * y[i] ** -0.2 / steps
        x, u, peak, acceleration = 0.0, y[i], 0.0, 0.0
        while True:
            u += 0.5 * h * acceleration
            x += h * u
            if x <= 0:
                break
            peak = max(peak, x)
            s = np.sqrt(x)
            if u > 0:
                force = x * s + (d * (x * x - 1) * (1 - s) if x > 1 else 0.0)
            else:
                line = 1 - steepness * (1 - x / peak)
                force = (1 - d * peak) * x * s + d * s + d * (peak * peak - 1) * line
            acceleration = -1.25 * force
            u += 0.5 * h * acceleration
            if force <= 0 and u <= 0:
                break
        result[i] = -u / y[i]
    return result


@numba.njit
def curve(y, d, steepness, sigma, psi, limit):
    """ε and its derivatives by ln χ̃, ln σ and ln ψ: below first yield Eq. (17), above it Eq. (16)."""
    value = np.empty(y.size)
    jacobian = np.zeros((y.size, 3))
    for j in range(y.size):
        at = min(y[j], 1.0)
        log = np.log(at / (limit - at))
        exponent = sigma * np.exp(psi * log)
        if y[j] <= 1:
            value[j] = np.exp(-exponent)
            jacobian[j, 1] = -exponent * value[j]
            jacobian[j, 2] = jacobian[j, 1] * psi * log
            continue
        plastic, slope = collision(d, steepness, y[j])
        squared = plastic + np.expm1(-2 * exponent)
        if squared <= 0:
            value[j] = 0.0
            continue
        value[j] = np.sqrt(squared)
        lost = -2 * exponent * np.exp(-2 * exponent)
        jacobian[j, 0] = 0.5 * slope * steepness / value[j]
        jacobian[j, 1] = 0.5 * lost / value[j]
        jacobian[j, 2] = jacobian[j, 1] * psi * log
    return value, jacobian
