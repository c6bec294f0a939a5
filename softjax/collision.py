"""The equation of motion x'' = -(5/4) p of a rate-independent law, integrated by diffrax.

Nothing of the energy balance is used here: the law gives its forces, and where they end.

Neither branch is integrated over time, because the ends of both are known in other variables
(Hénon's trick), so that no event has to be searched for:

* loading over what is left of the velocity, x' = y √(1 - ŝ^{2k}), where ŝ = 1 - η² is √x of the
  elastic collision at that velocity relative to its peak. The state is what x^k/y² exceeds that
  of the elastic collision by (Encke's trick): 0 until yield, and smooth after;
* unloading over √x, from its value at the peak down to the residual overlap, with x'² as state;
* where time matters, over the angle of x = x* + ρ cosφ, x' = -Ω ρ sinφ, with ρ and t as states.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from softjax._bridge import over_batch, solve
from softjax._numerics import implicit_root, integrate, near_one_root, parabolic_step, safe_sqrt
from softjax.laws.base import Outcome, ReducedRateIndependent
from softjax.routes import ODE

RESIDUAL_STEPS = 16  # from the peak; the worst of 400 000 cases needed 13
ROUNDING = 8.0  # a step this many times the rounding error was the last
HALF_PERIOD = {2.5: 1.4716375921622639, 2.0: 1.5707963267948966}  # ∫_0^1 dz/√(1 - z^k)
# p_el/p is capped: where the loading force vanishes the overlap runs away instead of dividing by 0
LARGEST_SOFTENING = 1e8
CLOCK_NODES = 32
FIRST_REACH = 1e-5  # ŝ at which a law without an elastic stage starts: 1e-10 of the overlap


def collide(law: ReducedRateIndependent, y: Array, route: ODE) -> Outcome:
    """Overlaps and ε_p² of collisions beyond the elastic limit, one ODE for each velocity."""
    return over_batch(_collide_one, law, y, route)


def duration(law: ReducedRateIndependent, y: Array, route: ODE) -> tuple[Array, Array]:
    """Contact duration [L/V] and whether the contact ends."""
    return over_batch(_duration_one, law, y, route)


def _collide_one(law, y, route: ODE) -> Outcome:
    peak, turns = _loading(law, y, route, clock=False)[:2]
    residual = _residual(law, peak)
    energy = _unloading_energy(law, peak, residual, y, route)
    end = jax.lax.stop_gradient(law.end())
    return Outcome(
        peak=jnp.where(turns, peak, end),
        residual=jnp.where(turns, residual, end),
        plastic_squared=jnp.where(turns, energy, 0.0),
        turns=turns,
    )


def _duration_one(law, y, route: ODE):
    peak, turns, loading_time = _loading(law, y, route, clock=True)
    residual = _residual(law, peak)
    time = loading_time + _unloading_time(law, peak, residual, route)
    return jnp.where(turns, time, 0.0), turns


def _loading(law, y, route: ODE, clock: bool):
    """Largest overlap, whether there is one, and the time it takes."""
    reach, start = _elastic_reach(law, y)
    zero = jnp.zeros_like(y)
    state = (zero, zero) if clock else (zero,)
    field = partial(_loading_field, clock=clock)
    (gain, *lag), solved = solve(field, start, zero, state, (law, reach), route)
    found = jnp.square(reach * near_one_root(1 + gain, _roots(law)))
    turns = solved & (found < law.end()) & jnp.isfinite(found)
    peak = jnp.where(turns, found, 1.5)
    if not clock:
        return peak, turns
    return peak, turns, (HALF_PERIOD[law.work_exponent] + lag[0]) * reach**2 / y


def _roots(law) -> int:
    """m = 2k, in which the elastic work is s^m with s = √x."""
    return round(2 * law.work_exponent)


def _elastic_reach(law, y):
    """√x at the peak of the elastic collision, and the η at which the law stops being elastic."""
    reach = y ** (2 / _roots(law))
    if law.elastic_limit == 0:
        return reach, jnp.full_like(y, (1 - FIRST_REACH) ** 0.5)
    return reach, safe_sqrt(1 - law.elastic_limit**0.5 / reach)


def _loading_field(eta, state, args, *, clock):
    """dζ/dη and, with a clock, the lag behind the elastic collision d(t - t_el)/dη [reach²/y]."""
    law, reach = args
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


def _residual(law, peak):
    """x* of p_U(x*) = 0, or 0, from the unloading force alone where it is not written about x*."""
    known = law.residual(peak)
    if known is not None:
        return known
    leaves, structure = jax.tree.flatten(law)

    def force(r, peak, *leaves):
        law = jax.tree.unflatten(structure, leaves)
        return law.unloading(peak * r**2, peak)

    def search(peak, *leaves):
        f = lambda r: force(r, peak, *leaves)  # noqa: E731
        slope = jax.grad(f)
        curvature = jax.grad(slope)

        def step(carry):
            r, _, count = carry
            lower = r - parabolic_step(f(r), jnp.maximum(slope(r), 0.0), curvature(r))
            lower = jnp.clip(lower, 1e-12, 1.0)
            return lower, jnp.abs(lower - r), count + 1

        def unfinished(carry):
            r, change, count = carry
            return (count < RESIDUAL_STEPS) & (change > ROUNDING * jnp.finfo(r.dtype).eps)

        one = jnp.ones_like(peak)
        return jax.lax.while_loop(unfinished, step, (one, one, 0))[0]

    released = law.releases(peak)
    r = implicit_root(search, force)(peak, *leaves)
    return jnp.where(released, peak * r**2, 0.0)


def _unloading_energy(law, peak, residual, y, route: ODE):
    """x'²/y² at the end of the contact."""
    # divided by y twice, not by y²: the derivative of that quotient overflows float32 at y = 1e13
    args = (law, peak, jnp.sqrt(peak), safe_sqrt(residual), 1 / y)

    def field(t, state, args):
        law, peak, top, bottom, per_velocity = args
        s = top - (top - bottom) * t
        force = law.unloading(s**2, peak) * per_velocity
        return (5 * (s * per_velocity) * (top - bottom) * force,)

    zero, one = jnp.zeros_like(peak), jnp.ones_like(peak)
    return solve(field, zero, one, (zero,), args, route)[0][0]


def _unloading_time(law, peak, residual, route: ODE):
    """The time since the peak."""
    frequency, (_, phase) = _solve_angle(law, peak, residual, route)
    return phase / frequency


def _solve_angle(law, peak, residual, route: ODE, save=None):
    """Ω, and the states of `_angle_field` at the end of the contact or on the way there."""
    frequency = jnp.sqrt(1.25 * law.unloading(peak, peak) / (peak - residual))
    args = (law, peak, residual, frequency)
    zero, end = jnp.zeros_like(peak), jnp.full_like(peak, 0.5 * jnp.pi)
    return frequency, solve(_angle_field, zero, end, (zero + 1, zero), args, route, save)[0]


def _angle_field(phi, state, args):
    """d/dφ of ρ/(x_m - x*) and of Ω t, for x = x* + ρ cosφ and x' = -Ω ρ sinφ."""
    law, peak, residual, frequency = args
    stretch, _ = state
    sin, cos = jnp.sin(phi), jnp.cos(phi)
    radius = (peak - residual) * stretch
    x = jnp.clip(residual + radius * cos, residual, peak)
    pull = 1.25 * law.unloading(x, peak) / (frequency**2 * radius)
    turn = sin**2 + pull * cos  # dφ/d(Ω t)
    return stretch * sin * (pull - cos) / turn, 1 / turn


def history(
    law: ReducedRateIndependent, y: Array, fractions: tuple[np.ndarray, np.ndarray], route: ODE
) -> tuple[Array, Array, Array, Array]:
    """Time, overlap, velocity and force at fixed fractions of loading and of unloading.

    Args:
        fractions: two increasing arrays in [0, 1]. Loading is sampled over 1 - η with x' falling
            from y to 0, unloading over φ/(π/2) with x falling from its peak; the peak is sampled
            once, as the end of loading.
        y: impact velocities beyond the elastic limit.

    Returns:
        Four arrays, a last axis of samples beyond the shape of y, zero where nothing turns.
    """
    along, back = fractions

    def one(law, y, route):
        loading, turns = _loading_history(law, y, along, route)
        time, overlap = loading[0][-1], jnp.where(turns, loading[1][-1], 1.5)
        unloading = _unloading_history(law, overlap, time, back, route)
        joined = (jnp.concatenate(parts) for parts in zip(loading, unloading, strict=True))
        return tuple(jnp.where(turns, part, 0.0) for part in joined)

    return over_batch(one, law, y, route)


def elastic_history(
    law: ReducedRateIndependent, y: Array, fractions: tuple[np.ndarray, np.ndarray]
) -> tuple[Array, Array, Array, Array]:
    """The same for a collision that stays elastic: loading, and its mirror image."""
    along, back = fractions
    there = _elastic_states(law, y[..., None], along)
    mirrored = _elastic_states(law, y[..., None], 1 - back)
    period = 2 * HALF_PERIOD[law.work_exponent] * y[..., None] ** (4 / _roots(law) - 1)
    returned = (period - mirrored[0], mirrored[1], -mirrored[2], mirrored[3])
    return tuple(jnp.concatenate(parts, -1) for parts in zip(there, returned, strict=True))


def _elastic_states(law, y, fraction):
    """Time, overlap, velocity and force on elastic loading at 1 - η = fraction."""
    m = _roots(law)
    s_hat, speed = _elastic_speed(fraction, m)
    reach = y ** (2 / m)
    s = reach * s_hat
    time = reach**2 / y * _elastic_clock(m, fraction)
    return time, s**2, y * speed, 0.2 * m * s ** (m - 2)


def _elastic_speed(fraction, m: int):
    """ŝ and x'/y where 1 - η = fraction."""
    eta = 1 - fraction
    s_hat = 1 - eta**2
    return s_hat, eta / _slowness(s_hat, m)


def _elastic_clock(m: int, fraction: np.ndarray) -> Array:
    """Time [reach²/y] to 1 - η = fraction of an elastic collision, by quadrature."""

    def slowness(eta):
        s_hat = 1 - eta**2
        return 4 * s_hat * _slowness(s_hat, m)

    start = jnp.asarray(1 - fraction)
    return integrate(slowness, start, jnp.ones_like(start), CLOCK_NODES)


def _loading_history(law, y, along, route: ODE):
    m = _roots(law)
    reach, start = _elastic_reach(law, y)
    # before yield, η > η_0, the deviation from the elastic collision is zero
    portion = jnp.clip(1 - (1 - along) / start, 0.0, 1.0)
    field = partial(_loading_field, clock=True)
    zero = jnp.zeros_like(y)
    (gain, lag), solved = solve(field, start, zero, (zero, zero), (law, reach), route, save=portion)
    s_hat, speed = _elastic_speed(along, m)
    s = reach * s_hat * near_one_root(1 + gain / jnp.where(s_hat > 0, s_hat, 1.0) ** m, m)
    time = reach**2 / y * (_elastic_clock(m, along) + lag)
    return (time, s**2, y * speed, law.loading(s**2)), solved & (s[-1] ** 2 < law.end())


def _unloading_history(law, peak, loading_time, back, route: ODE):
    residual = _residual(law, peak)
    frequency, (stretch, phase) = _solve_angle(law, peak, residual, route, save=back)
    phi = 0.5 * jnp.pi * back
    radius = (peak - residual) * stretch
    x = residual + radius * jnp.cos(phi)
    time = loading_time + phase / frequency
    return time, x, -frequency * radius * jnp.sin(phi), law.unloading(x, peak)
