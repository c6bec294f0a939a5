"""What one would write instead for such a motion: SciPy, diffrax with an event, Verlet."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy.integrate import solve_ivp

from calibration.speed.plain_diffrax import phase
from calibration.speed.plan import BATCH, FEW
from calibration.speed.ways import Way

LONGEST = 20.0  # no contact here lasts so long


@dataclass(frozen=True)
class Motion:
    """x'' = -x^p - c x^q x', until the force vanishes, or the overlap."""

    p: float
    q: float
    to_zero_force: bool
    c: Any

    @property
    def undamped(self) -> float:
        """The duration without damping."""
        return np.pi if self.p == 1 else 3.218065459719043

    def force(self, x, u, power=np.power):
        return power(x, self.p) + self.c * power(x, self.q) * u

    def ends(self, x, u, power=np.power):
        """Negative after the contact, and of one sign from its peak on."""
        return power(x, self.p - self.q) + self.c * u if self.to_zero_force else x

    def kernel(self) -> Callable:
        """The force of (x, u, c) in plain Python, to be compiled."""
        p, q = self.p, self.q
        return lambda x, u, c: x**p + c * x**q * u


def plan(scene, motion: Callable[[Any], Any], quick: bool) -> Iterator[Callable[[], Way]]:
    """All of them, as functions that build them."""
    for rtol in (1e-6,) if quick else (1e-4, 1e-6, 1e-8):
        yield partial(scipy_loop, scene, motion, FEW, rtol)
        yield partial(plain_diffrax, scene, motion, BATCH, rtol)
    if find_spec("numba") is not None:
        for steps in (100, 1000) if quick else (30, 100, 300, 1000, 3000):
            yield partial(verlet_numba, scene, motion, BATCH, steps)


def scipy_loop(scene, motion: Callable[[Any], Any], batch: int, rtol: float) -> Way:
    """`solve_ivp` in a Python loop, with an event."""

    def value(velocity):
        return np.array([_by_scipy(motion(c), rtol) for c in scene.damping(velocity)])

    return Way("SciPy loop", f"DOP853, rtol {rtol:.0e}", batch, value)


def _by_scipy(motion, rtol: float) -> float:
    def field(t, state):
        return state[1], -motion.force(max(state[0], 0.0), state[1])

    def released(t, state):
        # a root of the overlap on touch is none of the end
        inside = max(state[0], 0.0) if motion.to_zero_force else state[0]
        return motion.ends(inside, state[1]) if state[1] < 0 else 1.0

    released.terminal, released.direction = True, -1  # type: ignore[attr-defined]
    options = {"method": "DOP853", "rtol": rtol, "atol": rtol, "events": released}
    return -solve_ivp(field, (0.0, LONGEST), (0.0, 1.0), **options).y_events[0][0][1]


def plain_diffrax(scene, motion: Callable[[Any], Any], batch: int, rtol: float) -> Way:
    """Over time, ended by an `Event` and a root find."""

    @jax.jit
    def by_time(damping):
        return jax.vmap(lambda c: _by_diffrax(motion(c), rtol))(damping)

    def value(velocity):
        return by_time(jnp.asarray(scene.damping(velocity)))

    return Way("diffrax, an event", f"tsit5, rtol {rtol:.0e}", batch, value)


def _by_diffrax(motion, rtol: float):
    def field(t, y, args):
        x, u = y
        return u, -motion.force(jnp.maximum(x, 1e-30), u, jnp.power)

    def released(t, y, args, **kwargs):
        x, u = y
        inside = jnp.maximum(x, 1e-30) if motion.to_zero_force else x
        return jnp.where(u < 0, motion.ends(inside, u, jnp.power), 1.0)

    start = jnp.asarray(0.0), jnp.asarray(1.0)
    return -phase(field, released, start, rtol, LONGEST, direction=False)[1]


def verlet_numba(scene, motion: Callable[[Any], Any], batch: int, steps: int) -> Way:
    """Velocity Verlet over all cores. Raises ImportError where numba is not installed."""
    import numba

    one = motion(0.0)
    to_zero_force, undamped = one.to_zero_force, one.undamped
    force_at = numba.njit(one.kernel(), inline="always")

    @numba.njit(parallel=True)
    def loop(damping):
        result = np.empty_like(damping)
        for i in numba.prange(damping.size):
            c, h = damping[i], undamped / steps
            x, u, acceleration = 0.0, 1.0, -force_at(0.0, 1.0, c)
            while True:
                u += 0.5 * h * acceleration
                x += h * u
                if x <= 0:
                    break
                force = force_at(x, u, c)
                acceleration = -force
                u += 0.5 * h * acceleration
                if to_zero_force and force <= 0 and u <= 0:
                    break
            result[i] = -u
        return result

    def value(velocity):
        return loop(scene.damping(np.asarray(velocity)))

    return Way("Verlet, numba", f"{steps} steps", batch, value)
