"""Small numerical tools that know nothing of collisions."""

from collections.abc import Callable
from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array


def implicit_root(
    solve: Callable[..., Array], residual: Callable[..., Array]
) -> Callable[..., Array]:
    """A function `root(*params)` with `residual(root, *params) = 0`, differentiated implicitly.

    `solve(*params)` finds the root by any means and is never differentiated. The derivative is
    -(dF/dp)/(dF/dx) at the root, and since the rule asks for the root again it is right to any
    order; one Newton step on a frozen root is right to first order only. Elementwise: parameters
    broadcast, each element of the result is a root of its own.
    """

    @jax.custom_jvp
    def root(*params: Array) -> Array:
        return solve(*params)

    @root.defjvp
    def root_jvp(params, tangents):
        x = root(*params)
        return x, implicit_tangent(residual, x, params, tangents)

    return root


def implicit_fraction(solve: Callable, residual: Callable) -> Callable:
    """As `implicit_root` for a root f in [0, 1], as the pair (f, 1 - f), each to its own precision.

    Where f nears 1 the difference 1 - f would be lost to rounding; `solve` returns both.
    """

    @jax.custom_jvp
    def root(*params: Array) -> tuple[Array, Array]:
        return solve(*params)

    @root.defjvp
    def root_jvp(params, tangents):
        fraction, rest = root(*params)
        change = implicit_tangent(residual, fraction, params, tangents)
        return (fraction, rest), (change, -change)

    return root


def implicit_tangent(residual, x, params, tangents):
    """dx = -(dF/dp · dp)/(dF/dx), zero where F does not move with x."""
    _, slope = jax.jvp(lambda x: residual(x, *params), (x,), (jnp.ones_like(x),))
    _, change = jax.jvp(lambda *p: residual(x, *p), params, tangents)
    flat = slope == 0
    return jnp.where(flat, 0.0, -change / jnp.where(flat, 1.0, slope))


def refine(step: Callable[[Array], Array], start: Array, most: int) -> Array:
    """A root by `step` from x to a better x, of third order, until no element moves any more.

    An element stops when its own step was so small that a third-order method has nothing left to
    do; it does not move while others still do, so that no impact depends on its neighbours. Nothing
    is differentiated here. Stored after each step: unrolled, XLA computes all earlier steps again
    for every later one (seven times the time, measured).
    """
    settled = 0.5 * float(jnp.finfo(start.dtype).eps) ** (1 / 3)

    def unfinished(state):
        _, moving, count = state
        return jnp.any(moving) & (count < most)

    def one(state):
        x, moving, count = state
        new = step(x)
        still = moving & (jnp.abs(new - x) > settled * jnp.abs(new))
        return jnp.where(moving, new, x), still, count + 1

    # zero of the kind that start is: under `shard_map` and `vmap` the loop's values must match
    moving = start == start
    return lax.while_loop(unfinished, one, (start, moving, 0))[0]


def parabolic_step(f: Array, slope: Array, curvature: Array) -> Array:
    """The step to the nearest zero of the parabola through f, f' >= 0 and f'' (Euler's method).

    Third order, and still fast where f has nearly a double root, where Newton's method halves the
    error at best: 7 steps from the elastic overlap where Newton took over 20. Where the
    parabola has no zero, or lies on its falling side away from one, the step goes to the vertex.
    """
    discriminant = slope * slope - 2 * f * curvature
    # beyond the top of a concave parabola (slope < 0 < f) this is its zero on the rising side
    reach = slope + jnp.sqrt(jnp.maximum(discriminant, 0.0))
    none = (discriminant < 0) | (reach <= 0) | ((slope < 0) & (curvature > 0))
    bent = jnp.where(curvature != 0, curvature, 1.0)
    return jnp.where(none, slope, 2 * f) / jnp.where(none, bent, reach)


@lru_cache
def gauss_legendre(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and weights on [0, 1]."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return 0.5 * (nodes + 1), 0.5 * weights


def integrate(f: Callable[[Array], Array], lower: Array, upper: Array, count: int) -> Array:
    """Gauss–Legendre quadrature, elementwise in `lower` and `upper`.

    Summed node by node in a loop, so that nothing of the size (batch, nodes) is stored, and the
    integrand is compiled once: written out, it took three times as long to compile and to run the same.
    """
    width = upper - lower
    nodes, weights = (jnp.asarray(a, width.dtype) for a in gauss_legendre(count))

    def add(total, node_and_weight):
        node, weight = node_and_weight
        return total + weight * f(lower + node * width), None

    total, _ = jax.lax.scan(add, jnp.zeros_like(width), (nodes, weights))
    return total * width


def safe_power(base: Array, exponent) -> Array:
    """base**exponent for base >= 0, with value and derivatives 0 at base = 0."""
    positive = base > 0
    return jnp.where(positive, jnp.where(positive, base, 1.0) ** exponent, 0.0)


def rough_power(base: Array, exponent: float) -> Array:
    """base**exponent to six digits, for starting values: a third of the cost of the full power.

    A cube root, the other way to it, is a library call for each element, which keeps the whole
    surrounding loop from being vectorised.
    """
    tiny, huge = 1e-37, 1e37
    short = jnp.clip(base, tiny, huge).astype(jnp.float32)
    return jnp.exp2(jnp.float32(exponent) * jnp.log2(short)).astype(base.dtype)


def near_one_root(x: Array, degree: int) -> Array:
    """The `degree`-th root of x by one step of Halley's method from six digits: 13 of them right.

    A third of the cost of a full power; value and derivative converge together. 0 for x <= 0.
    """
    positive = x > 0
    safe = jnp.where(positive, x, 1.0)
    start = lax.stop_gradient(rough_power(safe, 1 / degree))
    power = start**degree
    up, down = degree + 1, degree - 1
    root = start * (down * power + up * safe) / (up * power + down * safe)
    return jnp.where(positive, root, 0.0)


def safe_sqrt(x: Array) -> Array:
    """√x with value and derivatives 0 where x <= 0."""
    positive = x > 0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, x, 1.0)), 0.0)
