"""Velocity Verlet with a fixed number of steps a contact, as particle codes do it."""

import jax
import jax.numpy as jnp
import numpy as np

from calibration.speed.plain_diffrax import loading_force, unloading_force
from calibration.speed.scene import Scene
from calibration.speed.ways import Way

ELASTIC_DURATION = 2.9432751843  # of a Hertzian contact, in largest overlap over impact velocity


def verlet_jax(scene: Scene, batch: int, steps: int) -> Way:
    """In JAX: all contacts of the batch step together until the last has ended."""
    d, steepness, _ = scene.reduced()
    critical = scene.contact.critical_velocity

    @jax.jit
    def value(velocity):
        y = velocity / critical
        h = ELASTIC_DURATION * y**-0.2 / steps
        start = (jnp.zeros_like(y), y, jnp.zeros_like(y), jnp.zeros_like(y), y > 0)

        def step(state):
            x, u, peak, acceleration, touching = state
            half = u + 0.5 * h * acceleration
            x_new = jnp.where(touching, x + h * half, x)
            peak = jnp.maximum(peak, x_new)
            force = _force(x_new, half, peak, d, steepness)
            u_new = jnp.where(touching, half - 0.625 * h * force, u)
            return x_new, u_new, peak, -1.25 * force, touching & ((force > 0) | (half > 0))

        return -jax.lax.while_loop(lambda s: jnp.any(s[4]), step, start)[1] / y

    return Way("Verlet, JAX", f"{steps} steps", batch, value)


def _force(x, u, peak, d, steepness):
    back = jnp.where(x > 0, unloading_force(x, peak, d, steepness), 0.0)
    return jnp.where(u > 0, loading_force(x, d), back)


def verlet_numba(scene: Scene, batch: int, steps: int) -> Way:
    """In numba, contacts spread over the cores. Raises ImportError where numba is not installed."""
    loop = _compiled_loop()
    d, steepness, _ = scene.reduced()
    critical = scene.contact.critical_velocity

    def value(velocity):
        return loop(d, steepness, np.asarray(velocity) / critical, steps, ELASTIC_DURATION)

    return Way("Verlet, numba", f"{steps} steps", batch, value)


def _compiled_loop():
    import numba

    @numba.njit(parallel=True)
    def loop(d, steepness, y, steps, elastic_duration):
        result = np.empty_like(y)
        for i in numba.prange(y.size):
            h = elastic_duration * y[i] ** -0.2 / steps
            x, u, peak, acceleration = 0.0, y[i], 0.0, 0.0
            while True:
                u += 0.5 * h * acceleration
                x += h * u
                s = np.sqrt(max(x, 0.0))
                if u > 0:
                    peak = x
                    force = x * s
                    if x > 1:
                        force += d * (x * x - 1) * (1 - s)
                else:
                    line = 1 - steepness * (1 - x / peak)
                    force = (1 - d * peak) * x * s + d * s + d * (peak * peak - 1) * line
                    if x <= 0:
                        force = 0.0
                acceleration = -1.25 * force
                u += 0.5 * h * acceleration
                if force <= 0 and u <= 0:
                    break
            result[i] = -u / y[i]
        return result

    return loop
