"""Loading by Encke's method: integrate the deviation from the elastic collision, by diffrax.

Over what is left of the velocity, x' = y √(1 - ŝ^{2k}), where ŝ = 1 - η² is √x of the elastic
collision at that velocity relative to its peak. The state is what x^k/y² exceeds that of the
elastic collision by: 0 until the law leaves it, and smooth after. The end is known
(Hénon's trick), so that no event has to be searched for.
"""

from typing import Any

import jax.numpy as jnp

from softjax.engine.bridge import solve
from softjax.engine.outcome import Peak
from softjax.fields import Numbers
from softjax.laws.reduced import ReducedRateIndependent
from softjax.numerics.gauss import integrate
from softjax.numerics.powers import near_one_root, safe_sqrt

# p_el/p is capped: where the loading force vanishes the overlap runs away instead of dividing by 0
LARGEST_SOFTENING = 1e8
FIRST_REACH = 1e-5  # ŝ at which a law without an elastic stage starts: 1e-10 of the overlap
SOME_PEAK = 1.5  # of a collision that is computed where there is none


def loading(law: ReducedRateIndependent, y: Numbers, route: Any) -> Peak:
    """Largest overlap, and whether there is one."""
    m = round(2 * law.work_exponent)  # in which the elastic work is s^m with s = √x
    reach = y ** (2 / m)  # √x at the peak of the elastic collision
    if law.elastic_limit == 0:
        start = jnp.full_like(y, (1 - FIRST_REACH) ** 0.5)
    else:  # η at which the law stops being elastic
        start = safe_sqrt(1 - law.elastic_limit**0.5 / reach)

    def field(eta, state):
        """dζ/dη."""
        s_hat = 1 - eta**2
        # ŝ^m is a denominator whose square underflows float32
        s = reach * s_hat * near_one_root(1 + state[0] * (1 / s_hat) ** m, m)
        elastic_force = 0.2 * m * s ** (m - 2)
        floor = elastic_force / LARGEST_SOFTENING
        # not as a quotient: its derivative with d, elastic force times x^{5/2}, overflows float32
        softening = elastic_force * (1 / jnp.maximum(law.loading(s**2), floor))
        return (-2 * m * eta * s_hat ** (m - 1) * (softening - 1),)

    zero = jnp.zeros_like(y)
    (gain,), solved = solve(field, start, zero, (zero,), route, smooth=True)
    overlap = jnp.square(reach * near_one_root(1 + gain, m))
    end = jnp.asarray(law.end(), y.dtype)
    ends, arrived = jnp.isfinite(end), solved & jnp.isfinite(overlap)
    # where the solver gave up a rough look decides whether there was anything to arrive at: whether
    # the work of loading up to the law's end is more than the impact's energy
    top = jnp.sqrt(jnp.where(ends, end, 1.0))
    work = integrate(lambda s: 2 * s * law.loading(s * s), zero, top, 20)
    turns = jnp.where(arrived, overlap < end, ~ends | (2.5 * (work / y) / y > 1))
    overlap = jnp.where(arrived & turns, overlap, SOME_PEAK)
    return Peak(overlap, y, end, turns, arrived | ~turns, zero)
