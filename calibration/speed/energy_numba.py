"""The energy balance's formulas in a numba loop over all cores: what C would give."""

import numpy as np

from calibration.speed.scene import Scene
from calibration.speed.ways import Way

# Newton steps in the peak and in the residual overlap; one less loses digits on this scene
PEAK_STEPS = 4
RELEASE_STEPS = 4


def energy_numba(scene: Scene, batch: int) -> Way:
    """Raises ImportError where numba is not installed."""
    loop = _compiled_loop()
    d, steepness, _ = scene.reduced()
    critical = scene.contact.critical_velocity
    up_loss = _sound_and_heat(scene)

    def value(velocity):
        return loop(d, steepness, np.asarray(velocity), critical, up_loss)[1]

    return Way("energy balance, numba", "exact", batch, value)


def _sound_and_heat(scene: Scene) -> float:
    """ε_up² - 1 of Eq. (16): one number for a whole curve."""
    law, critical = scene.law, scene.contact.critical_velocity
    ratio = critical / (law.contact.limit_velocity - critical)
    return float(np.expm1(-2 * law.sigma * ratio**law.psi))


def compiled_collision():
    """ε_p² of one impact at y > 1, and its derivative by the steepness X."""
    import numba

    @numba.njit(inline="always")  # a call of its own takes three times as long
    def collision(d, steepness, y):
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

    return collision


def _compiled_loop():
    import numba

    collision = compiled_collision()

    @numba.njit(parallel=True)
    def loop(d, steepness, velocity, critical, up_loss):
        total = np.empty_like(velocity)
        plastic = np.empty_like(velocity)
        for j in numba.prange(velocity.size):
            squared, _ = collision(d, steepness, velocity[j] / critical)
            plastic[j] = np.sqrt(squared)
            total[j] = np.sqrt(max(squared + up_loss, 0.0))
        return total, plastic

    return loop
