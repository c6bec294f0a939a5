"""One impact of a law by its forces in newtons: quadrature and SciPy's roots, or its integration in time.

Of the law only the forces, their kinks and the end of the contact are evaluated, so a force that is off by a
factor or in other units differs from what the library finds.
"""

import itertools
from typing import NamedTuple

import jax
import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import bisect, brentq

ENDS = {"xtol": 1e-22, "rtol": 1e-14}


class Collision(NamedTuple):
    """ε_p² [-], δ_max and δ* [m], duration [s] where the motion was integrated."""

    squared: float
    peak: float
    residual: float
    duration: float = np.nan


_T = np.linspace(-3.2, 3.2, 161)  # tanh-sinh, whatever power a force has at an end
_SINH = 0.5 * np.pi * np.sinh(_T)
NODES = np.tanh(_SINH)
WEIGHTS = (_T[1] - _T[0]) * 0.5 * np.pi * np.cosh(_T) / np.cosh(_SINH) ** 2


def by_works(law, velocity: float) -> Collision:
    """A rate-independent law: the peak where the work of loading is the energy, back to the last zero."""
    energy = 0.5 * float(law.contact.mass) * velocity**2
    kinks = [float(x) for x in (*law.breakpoints(), law.elastic_overlap()) if np.isfinite(x)]
    loading, unloading = jax.jit(law.loading_force), jax.jit(law.unloading_force)

    def work(force, low, high):
        cuts = {low, high, *(k for k in kinks if low < k < high), *np.linspace(low, high, 5)}
        parts = itertools.pairwise(sorted(cuts))
        return sum((b - a) / 2 * WEIGHTS @ force(a + (b - a) / 2 * (1 + NODES)) for a, b in parts)

    def lacking(x):
        return work(loading, 0.0, x) / energy - 1

    top = (2.5 * energy / float(law.contact.stiffness)) ** 0.4
    while lacking(top) < 0:
        top *= 1.5
    peak = brentq(lacking, 0.0, top, **ENDS)
    back = lambda x: unloading(x, peak)  # noqa: E731
    steps = peak * np.linspace(1, 0, 400)
    below = np.flatnonzero(np.asarray(back(steps[:-1])) <= 0)
    rest = 0.0
    if below.size:  # some laws' force is 0 below its zero
        ends = steps[below[0]], steps[below[0] - 1]
        rest = bisect(lambda x: float(back(x)) or -1.0, *ends, **ENDS)
    return Collision(float(work(back, rest, peak)) / energy, peak, rest)


def by_motion(law, velocity: float) -> Collision:
    """A rate-dependent law: M δ'' = -P up to rest, and from there to the end of the contact."""
    force = jax.jit(law.force)
    mass = float(law.contact.mass)
    pace = (mass / float(law.contact.stiffness)) ** 0.4 * velocity**-0.2

    def until(sign, start, ended):
        """One way; the force has one sign of the velocity throughout, and may jump where that changes."""

        def push(x, v):
            return float(force(max(x, 0.0), sign * (abs(v) + 1e-300)))

        def event(_, state):
            return ended(*state, push)

        event.terminal, event.direction = True, -1
        # steps so short that the event is found to 1e-13, by the polynomial of its step
        steps = {"first_step": 1e-9 * pace, "max_step": 0.03 * pace, "rtol": 3e-14, "atol": 1e-19}
        motion = lambda _, s: [s[1], -push(*s) / mass]  # noqa: E731
        span = (0, 1e3 * pace)
        found = solve_ivp(motion, span, start, events=event, method="DOP853", **steps)
        return found.t_events[0][0], found.y_events[0][0]

    def released(x, v, push):
        return min(x, push(x, v)) if law.end == "zero-force" else x

    up, (peak, _) = until(1, [0.0, velocity], lambda x, v, push: v)
    back, (rest, speed) = until(-1, [peak, 0.0], released)
    return Collision((speed / velocity) ** 2, peak, rest, up + back)
