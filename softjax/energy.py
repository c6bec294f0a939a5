"""The energy balance: restitution of a rate-independent law without time integration.

The impact energy is the work of loading up to the largest overlap x_m; what the unloading force
gives back down to the residual overlap x* is the rebound energy (all reduced, see `laws.base`):

    W_L(x_m) = (2/5) y²,    p_U(x*; x_m) = 0 or x* = 0,    ε_p² = W_U(x*, x_m)/((2/5) y²)

A law's closed forms are used where it has them (`ReducedClosedForm`); else works are quadratures
and roots are found by optimistix. The contact's duration is ∫ dx/|x'| over both branches.
"""

import math

import jax
import jax.numpy as jnp
from jaxtyping import Array

from softjax._numerics import implicit_root, integrate, safe_sqrt
from softjax.laws.base import Outcome, ReducedClosedForm, ReducedRateIndependent

DURATION_NODES = 32
WORK_NODES = 32
NEWTON_STEPS = 5
JUST_YIELDS = 0.05  # relative: the overlap at yield and the peak this close count as close


def collide(law: ReducedRateIndependent, y: Array) -> Outcome:
    """Overlaps and ε_p² of collisions beyond the elastic limit, at impact velocities y >= 1.

    Elementwise over y and the law's fields, which broadcast. Where no turning point exists the
    overlaps are `law.end()` and ε_p is zero, without a gradient.
    """
    largest = _largest_velocity(law)
    turns = y < largest
    # collisions without an answer compute another one, whose gradient is not used
    y_safe = jnp.where(turns, y, _some_velocity_below(largest))
    peak = _peak(law, y_safe)
    residual, _, work = _release(law, peak)
    # not work/y²: at y = 1e13 float32 would overflow in the derivative of the quotient
    squared = 2.5 * (work * (1 / y_safe)) / y_safe
    end = jax.lax.stop_gradient(law.end())
    return Outcome(
        peak=jnp.where(turns, peak, end),
        residual=jnp.where(turns, residual, end),
        plastic_squared=jnp.where(turns, squared, 0.0),
        turns=turns,
    )


def duration(law: ReducedRateIndependent, y: Array, outcome: Outcome) -> Array:
    """Contact duration [L/V] of collisions beyond the elastic limit; 0 where none turns.

    In s = √x both branches are regular: s = s_m(1 - η²) on loading, s = s_m - (s_m - s*) η² on
    unloading, which is the square root that x' has at the peak taken out.
    """
    turns = outcome.turns
    y_safe = jnp.where(turns, y, 1.5)
    peak = jnp.where(turns, outcome.peak, 1.5)
    residual = jnp.where(turns, outcome.residual, 0.0)
    total = _elastic_stage(law, y_safe) + _yielding_stage(law, y_safe, peak)
    return jnp.where(turns, total + _unloading_stage(law, peak, residual), 0.0)


def elastic_duration(law: ReducedRateIndependent, y: Array) -> Array:
    """Duration [L/V] of a collision that stays within one power law: 2.943… x_m/y for Hertz's."""
    return 2 * elastic_half_duration(law.work_exponent) * y ** (2 / law.work_exponent - 1)


def elastic_half_duration(exponent: float) -> float:
    """∫_0^1 dz/√(1 - z^k) = √π Γ(1 + 1/k)/Γ(1/2 + 1/k)."""
    return math.sqrt(math.pi) * math.gamma(1 + 1 / exponent) / math.gamma(0.5 + 1 / exponent)


def _elastic_stage(law, y):
    """∫_0^{x_y} dx/√(y² - x^k) up to the elastic limit x_y."""
    if law.elastic_limit == 0:
        return jnp.zeros_like(y)
    k = law.work_exponent
    top = y ** (1 / k)  # √x of the elastic turning point
    start = safe_sqrt(1 - law.elastic_limit**0.5 / top)

    def slowness(eta):
        s = top * (1 - eta**2)
        return 4 * top * eta * s / (y * _sqrt_one_minus_power(eta, k))

    return integrate(slowness, start, jnp.ones_like(start), DURATION_NODES)


def _sqrt_one_minus_power(eta, k):
    """√(1 - (1 - η²)^{2k}), without the cancellation at small η."""
    return jnp.sqrt(-jnp.expm1(2 * k * jnp.log1p(-(eta**2))))


def _yielding_stage(law, y, peak):
    """∫ dx/√(y² - (5/2) W_L) from the elastic limit to the peak."""
    top = jnp.sqrt(peak)
    start = safe_sqrt(1 - law.elastic_limit**0.5 / top)
    at_peak = work_to(law, peak)
    just_yields = peak < (1 + JUST_YIELDS) * law.elastic_limit

    def slowness(eta):
        s = top * (1 - eta**2)
        # just above yield the works would cancel
        near = _work_near_peak(law, top, top * eta**2)
        left = jnp.where(just_yields, near, at_peak - work_to(law, s**2))
        left = 2.5 * jnp.maximum(left, 0.0)
        tiny = jnp.finfo(left.dtype).tiny
        return 4 * top * eta * s / jnp.sqrt(jnp.maximum(left, tiny))

    return integrate(slowness, jnp.zeros_like(start), start, DURATION_NODES)


def _work_near_peak(law, top, drop):
    """∫ p_L dx from √x = top - drop to √x = top, a branch so short that five nodes are exact."""

    def force(t):
        s = top - drop * t
        return 2 * drop * s * law.loading(s**2)

    return integrate(force, jnp.zeros_like(top), jnp.ones_like(top), 5)


def _unloading_stage(law, peak, residual):
    """∫ dx/√((5/2) W_U) from the residual overlap to the peak."""
    top, bottom = jnp.sqrt(peak), safe_sqrt(residual)
    drop = top - bottom

    def slowness(eta):
        s = top - drop * eta**2
        recovered = drop * eta**2 * (top + s)
        speed = jnp.sqrt(2.5 * jnp.maximum(_unloading_work(law, peak, recovered), 0.0))
        moves = speed > 0
        return jnp.where(moves, 4 * drop * eta * s / jnp.where(moves, speed, 1.0), 0.0)

    return integrate(slowness, jnp.zeros_like(drop), jnp.ones_like(drop), DURATION_NODES)


def work_to(law: ReducedRateIndependent, x: Array) -> Array:
    """W_L(x): the law's own, or the loading force integrated in √x."""
    if isinstance(law, ReducedClosedForm):
        return law.loading_work(x)
    limit = law.elastic_limit
    elastic = 0.4 * jnp.minimum(x, limit) ** law.work_exponent
    bottom, top = jnp.sqrt(limit), jnp.sqrt(jnp.maximum(x, limit))
    force = lambda s: 2 * s * law.loading(s**2)  # noqa: E731
    yielded = integrate(force, bottom + 0 * top, top, WORK_NODES)
    return elastic + yielded


def _unloading_work(law, peak, recovered):
    if isinstance(law, ReducedClosedForm):
        return law.unloading_work(peak, recovered)
    top, bottom = jnp.sqrt(peak), safe_sqrt(peak - recovered)
    force = lambda s: 2 * s * law.unloading(s**2, peak)  # noqa: E731
    return integrate(force, bottom, top, WORK_NODES)


def _largest_velocity(law):
    if isinstance(law, ReducedClosedForm):
        return law.largest_velocity()
    end = law.end()
    ends = jnp.isfinite(end)
    reach = safe_sqrt(2.5 * work_to(law, jnp.where(ends, end, 1.0)))
    return jnp.where(ends, reach, jnp.inf)


def _some_velocity_below(largest):
    """A velocity with a turning point, where there is one."""
    return jax.lax.stop_gradient(jnp.where(jnp.isfinite(largest), 0.5 * (1 + largest), 2.0))


def _peak(law, y):
    """x_m of any law that works monotonically: bracketed by optimistix, then Newton."""
    if isinstance(law, ReducedClosedForm):
        return law.peak(y)
    elastic = y ** (2 / law.work_exponent)
    top = jnp.where(jnp.isfinite(law.end()), law.end(), 1e6 * elastic)
    residual = lambda x, law, y: 2.5 * work_to(law, x) / y**2 - 1  # noqa: E731
    return _bracketed_root(residual, jnp.zeros_like(y), top, law, y)


def _release(law, peak):
    """x* where the unloading force vanishes (0 where it never does), recovery and work."""
    if isinstance(law, ReducedClosedForm):
        return law.release(peak)
    at_zero = law.unloading(jnp.zeros_like(peak), peak)
    has_root = at_zero < 0
    scale = jnp.abs(law.unloading(peak, peak))
    residual = lambda x, law, peak, scale: law.unloading(x, peak) / scale  # noqa: E731
    root = _bracketed_root(residual, jnp.zeros_like(peak), peak, law, peak, scale)
    root = jnp.where(has_root, root, 0.0)
    return root, peak - root, _unloading_work(law, peak, peak - root)


def _bracketed_root(residual, lower, upper, *params):
    """A root between two arrays of bounds; the law is a pytree, its leaves are what moves it."""
    leaves, structure = jax.tree.flatten(params)

    def flat(x, *leaves):
        return residual(x, *jax.tree.unflatten(structure, leaves))

    def solve(lower, upper, *leaves):
        return _newton(flat, _bisect(flat, lower, upper, leaves), lower, upper, leaves)

    # the bounds are arguments too, though the root does not depend on them: what is traced must
    # not come in by the back door
    bounds = jax.lax.stop_gradient((lower, upper))
    return implicit_root(solve, lambda x, lower, upper, *leaves: flat(x, *leaves))(*bounds, *leaves)


def _bisect(f, lower, upper, leaves):
    import optimistix as optx  # here: no law with closed forms pays for the import

    shape = jnp.broadcast_shapes(jnp.shape(lower), *(jnp.shape(leaf) for leaf in leaves))
    lower, upper, *leaves = (jnp.broadcast_to(a, shape).ravel() for a in (lower, upper, *leaves))

    def one(lower, upper, leaves):
        result = optx.root_find(
            lambda x, leaves: f(x, *leaves),
            optx.Bisection(rtol=1e-6, atol=0.0, flip="detect"),
            0.5 * (lower + upper),
            args=leaves,
            options={"lower": lower, "upper": upper},
            max_steps=128,
            throw=False,
        )
        return result.value

    return jax.vmap(one)(lower, upper, leaves).reshape(shape)


def _newton(f, x, lower, upper, leaves):
    def step(_, x):
        value, slope = jax.jvp(lambda x: f(x, *leaves), (x,), (jnp.ones_like(x),))
        change = jnp.where(slope != 0, value / jnp.where(slope != 0, slope, 1.0), 0.0)
        return jnp.clip(x - change, lower, upper)

    return jax.lax.fori_loop(0, NEWTON_STEPS, step, x)
