"""Loading by Encke's method: integrate the deviation from the elastic collision, by diffrax.

Over what is left of the velocity, x' = y √(1 - ŝ^{2k}), where ŝ = 1 - η² is √x of the elastic
collision at that velocity relative to its peak. The state is what x^k/y² exceeds that of the
elastic collision by: 0 until the law leaves it, and smooth after. The end is known
(Hénon's trick), so that no event has to be searched for.
"""

from functools import partial
from typing import Any

import jax.numpy as jnp
import numpy as np

from softjax.engine.bridge import solve
from softjax.engine.outcome import Peak
from softjax.fields import Numbers
from softjax.laws.reduced import ReducedRateIndependent
from softjax.numerics.gauss import gauss_legendre, integrate
from softjax.numerics.powers import near_one_root, safe_sqrt

HALF_PERIOD = {2.5: 1.4716375921622639, 2.0: 1.5707963267948966}  # ∫_0^1 dz/√(1 - z^k)
# p_el/p is capped: where the loading force vanishes the overlap runs away instead of dividing by 0
LARGEST_SOFTENING = 1e8
CLOCK_NODES = 32
FIRST_REACH = 1e-5  # ŝ at which a law without an elastic stage starts: 1e-10 of the overlap
SOME_PEAK = 1.5  # of a collision that is computed where there is none


def loading(law: ReducedRateIndependent, y: Numbers, route: Any, clock: bool = False) -> Peak:
    """Largest overlap, whether there is one, and with a clock the time it takes."""
    (gain, *lag), reach, solved = _solved(law, y, route, clock)
    overlap = jnp.square(reach * near_one_root(1 + gain, _roots(law)))
    peak = _peak(law, y, overlap, solved)
    if not clock:
        return peak
    return peak._replace(time=(HALF_PERIOD[law.work_exponent] + lag[0]) * reach**2 / y)


def history(law: ReducedRateIndependent, y: Numbers, along: np.ndarray, route: Any):
    """The peak, and time, overlap, velocity and force at fixed shares of 1 - η."""
    (gain, lag), reach, solved = _solved(law, y, route, True, along)
    m = _roots(law)
    s_hat, speed = _elastic_speed(along, m)
    s = reach * s_hat * near_one_root(1 + gain / jnp.where(s_hat > 0, s_hat, 1.0) ** m, m)
    time = reach**2 / y * (_elastic_clock(m, along) + lag)
    peak = _peak(law, y, s[-1] ** 2, solved)._replace(time=time[-1])
    return peak, (time, s**2, y * speed, law.loading(s**2))


def elastic_history(
    exponent: float, y: Numbers, fractions: tuple[np.ndarray, np.ndarray]
) -> tuple[Numbers, Numbers, Numbers, Numbers]:
    """The same for a collision that stays elastic: loading, and its mirror image."""
    along, back = fractions
    m = round(2 * exponent)
    # of both at once: what is compiled for one serves the other
    fraction = np.concatenate([along, 1 - back])
    s_hat, share = _elastic_speed(fraction, m)
    reach, y = y[..., None] ** (2 / m), y[..., None]
    s, speed = reach * s_hat, y * share
    time, force = reach**2 / y * _elastic_clock(m, fraction), 0.2 * m * s ** (m - 2)
    returns = np.arange(len(along) + len(back)) >= len(along)
    period = 2 * HALF_PERIOD[exponent] * y ** (4 / m - 1)
    time = jnp.where(returns, period - time, time)
    return time, s**2, jnp.where(returns, -speed, speed), force


def _peak(law, y, peak_overlap, solved) -> Peak:
    end = jnp.asarray(law.end(), y.dtype)
    ends = jnp.isfinite(end)
    arrived = solved & jnp.isfinite(peak_overlap)
    # where the solver gave up a rough look decides whether there was anything to arrive at: whether
    # the work of loading up to the law's end is more than the impact's energy
    top = jnp.sqrt(jnp.where(ends, end, 1.0))
    work = integrate(lambda s: 2 * s * law.loading(s * s), jnp.zeros_like(y), top, 20)
    turns = jnp.where(arrived, peak_overlap < end, ~ends | (2.5 * (work / y) / y > 1))
    overlap = jnp.where(arrived & turns, peak_overlap, SOME_PEAK)
    return Peak(overlap, y, jnp.where(ends, end, 0.0), turns, arrived | ~turns)


def _solved(law, y, route: Any, clock: bool, along=None):
    reach = y ** (2 / _roots(law))  # √x at the peak of the elastic collision
    if law.elastic_limit == 0:
        start = jnp.full_like(y, (1 - FIRST_REACH) ** 0.5)
    else:  # η at which the law stops being elastic
        start = safe_sqrt(1 - law.elastic_limit**0.5 / reach)
    zero = jnp.zeros_like(y)
    # before yield, η > η_0, the deviation from the elastic collision is zero
    save = None if along is None else jnp.clip(1 - (1 - along) / start, 0.0, 1.0)
    field = partial(_field, law, reach, clock)
    state = (zero, zero) if clock else (zero,)
    states, solved = solve(field, start, zero, state, route, save, smooth=True)
    return states, reach, solved


def _roots(law) -> int:
    """m = 2k, in which the elastic work is s^m with s = √x."""
    return round(2 * law.work_exponent)


def _field(law, reach, clock: bool, eta, state):
    """dζ/dη and, with a clock, the lag behind the elastic collision d(t - t_el)/dη [reach²/y]."""
    m = _roots(law)
    s_hat = 1 - eta**2
    # √x over that of the elastic collision; ŝ^m is a denominator whose square underflows float32
    stretch = near_one_root(1 + state[0] * (1 / s_hat) ** m, m)
    s = reach * s_hat * stretch
    elastic_force = 0.2 * m * s ** (m - 2)
    floor = elastic_force / LARGEST_SOFTENING
    # not as a quotient: its derivative with d, elastic force times x^{5/2}, overflows float32
    softening = elastic_force * (1 / jnp.maximum(law.loading(s**2), floor))
    change = -2 * m * eta * s_hat ** (m - 1) * (softening - 1)
    if not clock:
        return (change,)
    weaker = softening / stretch ** (m - 2)  # the elastic collision's force at this x' over p
    return change, -4 * s_hat * (weaker - 1) * _slowness(s_hat, m)


def _slowness(s_hat, m: int):
    """η y/x' = 1/√[(1 - ŝ^m)/(1 - ŝ)], the geometric sum of ŝ."""
    total = jnp.ones_like(s_hat)
    for _ in range(m - 1):
        total = 1 + s_hat * total
    return total**-0.5


def _elastic_speed(fraction, m: int):
    """ŝ and x'/y where 1 - η = fraction."""
    eta = 1 - fraction
    s_hat = 1 - eta**2
    return s_hat, eta / _slowness(s_hat, m)


def _elastic_clock(m: int, fraction: np.ndarray) -> np.ndarray:
    """Time [reach²/y] to 1 - η = fraction of an elastic collision, by quadrature."""
    node, weight = gauss_legendre(CLOCK_NODES)
    width: np.ndarray = fraction.astype(np.float64)
    s_hat = 1 - np.square(1 - np.outer(width, 1 - node))
    slowness = 4 * s_hat / np.sqrt(sum(s_hat**j for j in range(m)))
    return (width * (slowness @ weight)).astype(fraction.dtype)
