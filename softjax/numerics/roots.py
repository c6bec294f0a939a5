"""Roots with one implicit rule, element by element, and what is computed only where it is needed."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jax.custom_batching import custom_vmap
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array


def implicit_root(solve: Callable, residual: Callable, slope: Callable | None = None) -> Callable:
    """A function `root(*params)` with `residual(root, *params) = 0`, differentiated implicitly.

    `solve(*params)` finds the root by any means and is never differentiated. The derivative is
    -(dF/dp)/(dF/dx) at the root, zero where F does not move with x; since the rule asks for the root
    again it is right to any order; one Newton step on a frozen root is right to first order only.
    Elementwise: parameters broadcast, each element of the result is a root of its own.

    Args:
        solve: of a root in [0, 1] it may return the pair (f, 1 - f), each to its own precision: where f
            nears 1 the difference would be lost to rounding.
        slope: dF/dx of (x, *params), where it is known.
    """

    @jax.custom_jvp
    def root(*params: Any) -> Any:
        return solve(*params)

    @root.defjvp
    def rule(params, tangents):
        found = root(*params)
        x = found[0] if isinstance(found, tuple) else found
        if slope is None:
            _, steep = jax.jvp(lambda x: residual(x, *params), (x,), (jnp.ones_like(x),))
        else:
            steep = slope(x, *params)
        _, moved = jax.jvp(lambda *p: residual(x, *p), params, tangents)
        flat = steep == 0
        change = jnp.where(flat, 0.0, -moved / jnp.where(flat, 1.0, steep))
        return found, (change, -change) if isinstance(found, tuple) else change

    return root


def third_order_root(
    expand: Callable,
    finish: Callable,
    rough: Array,
    params: tuple[Array, ...],
    most: int,
    short_steps: int,
    within: tuple[float, float] = (0.0, float("inf")),
):
    """A root of f by steps of third order from a value that is right to some percent.

    `expand(x, *params)` gives f, f' and f''. The first `short_steps` are taken in float32, where
    they cost half; one more in full precision leaves rounding error where it was small itself. Only
    if it was not for some element, those go on by `refine`, from the rough value again. Nothing is
    differentiated here.

    Returns:
        `finish(x, change)`, where the root is x - change and 1 - x without rounding error.
    """

    @elementwise
    def solve(rough, *params):
        return _third_order_root(expand, finish, rough, params, most, short_steps, within)

    return solve(rough, *params)


def elementwise(f: Callable) -> Callable:
    """f, of arrays element by element, which under `vmap` takes a further axis like the others.

    A branch or a loop that asks all elements would otherwise be computed whatever they answer.
    """
    wrapped = custom_vmap(f)

    @wrapped.def_vmap
    def rule(axis_size, batched, *values):
        most = max(jnp.ndim(x) - b for x, b in zip(values, batched, strict=True))
        aligned = [
            x.reshape(axis_size, *(1,) * (most + 1 - x.ndim), *x.shape[1:]) if b else x
            for x, b in zip(values, batched, strict=True)
        ]
        found = wrapped(*aligned)
        return found, jax.tree.map(lambda _: True, found)

    return wrapped


def where_needed(f: Callable, needed: Array, *values: Array) -> Array:
    """f(*values), element by element, computed only if `needed` holds anywhere; else zeros.

    Differentiable to any order, and under `vmap` still computed only where some element needs it.
    """

    @jax.custom_jvp
    def chosen(needed, *values):
        return elementwise(branch)(needed, *values)

    def branch(needed, *values):
        kind = jax.eval_shape(f, *values)
        shape = jnp.broadcast_shapes(needed.shape, *map(jnp.shape, values))
        full = lambda *values: jnp.broadcast_to(f(*values), shape)  # noqa: E731

        def none(*values):
            # made of the same arrays: within `shard_map` both branches have to vary alike
            any_of = sum((x != x for x in values), start=needed)
            zero = jnp.zeros((), kind.dtype)
            return jnp.where(jnp.broadcast_to(any_of, shape), zero, zero)

        return lax.cond(jnp.any(needed), full, none, *values)

    def rule(primals, tangents):
        changes = []
        for k, tangent in enumerate(tangents[1:]):
            if not isinstance(tangent, SymbolicZero):
                slope = where_needed(_slope(f, k), *primals)
                changes.append(jnp.broadcast_to(tangent, slope.shape) * slope)
        return chosen(*primals), sum(changes[1:], start=changes[0])

    chosen.defjvp(rule, symbolic_zeros=True)
    return chosen(needed, *values)


def _slope(f: Callable, k: int) -> Callable:
    """The derivative of f, of arrays element by element, by its k-th argument."""

    def slope(*values):
        shape = jnp.broadcast_shapes(*map(jnp.shape, values))
        at = jnp.broadcast_to(values[k], shape)
        along = lambda x: f(*values[:k], x, *values[k + 1 :])  # noqa: E731
        return jax.jvp(along, (at,), (jnp.ones_like(at),))[1]

    return slope


def _third_order_root(expand, finish, rough, params, most, short_steps, within):
    dtype = params[0].dtype
    short = tuple(param.astype(jnp.float32) for param in params)
    near = rough
    for _ in range(short_steps):
        near = near - nearest_zero(*expand(near, *short))
    near = jnp.where(jnp.isfinite(near), near, rough)
    start = near.astype(dtype)
    f, slope, curvature = expand(start, *params)
    change = _halley(f, slope, curvature, otherwise=jnp.inf)  # no step at all: not done
    done = jnp.abs(change) <= _small(start) * jnp.abs(start)

    def mended(near, change, done, rough, params):
        step = lambda x: jnp.clip(x - parabolic_step(*expand(x, *params)), *within)  # noqa: E731
        begin = jnp.where(done, near, rough).astype(dtype)
        # to the end: near a double root a step may be small and the root as near on either side
        x = refine(step, begin, ~done, most, settled=8 * float(jnp.finfo(dtype).eps))
        last = _halley(*expand(x, *params), otherwise=0.0)
        # what is done stays as it is to the last digit, whatever its neighbours need
        return finish(x, jnp.where(done, change, last))

    # a branch, since even a loop of no steps has what it needs prepared
    as_it_is = lambda near, change, *_: finish(near.astype(dtype), change)  # noqa: E731
    return lax.cond(jnp.all(done), as_it_is, mended, near, change, done, rough, params)


def _halley(f, slope, curvature, otherwise) -> Array:
    """Halley's step, of third order without a square root, where f rises and is nearly straight.

    Elsewhere a small step may be at no root, or at the one on the falling side.
    """
    straight = jnp.abs(f * curvature) <= 4 * _small(f) * slope * slope
    usable = straight & (slope > 0)
    below = jnp.where(usable, 2 * slope * slope - f * curvature, 1.0)
    return jnp.where(usable, 2 * f * slope / below, otherwise)


def _small(x: Array) -> float:
    """The relative step by a method of third order that leaves nothing but rounding error."""
    return 0.5 * float(jnp.finfo(x.dtype).eps) ** (1 / 3)


def refine(
    step: Callable[[Array], Array],
    start: Array,
    moving: Array,
    most: int,
    settled: float | None = None,
) -> Array:
    """A root by `step` from x to a better x, of third order, until no element moves any more.

    An element stops when its own relative step was within `settled`, else so small that a
    third-order method has nothing left to do; it does not move while others still do, so that no
    impact depends on its neighbours. Nothing is differentiated here. Stored after each step: unrolled, XLA computes all earlier steps again
    for every later one (seven times the time, measured).
    """

    settled = _small(start) if settled is None else settled

    def unfinished(state):
        _, moving, count = state
        return jnp.any(moving) & (count < most)

    def one(state):
        x, moving, count = state
        new = step(x)
        still = moving & (jnp.abs(new - x) > settled * jnp.abs(new))
        return jnp.where(moving, new, x), still, count + 1

    return lax.while_loop(unfinished, one, (start, moving, 0))[0]


def nearest_zero(f: Array, slope: Array, curvature: Array) -> Array:
    """The step to the nearest zero of the parabola through f, f' > 0 and f'' (Euler's method).

    Where the parabola has none, twice Newton's step.
    """
    discriminant = jnp.maximum(slope * slope - 2 * f * curvature, 0.0)
    return 2 * f / (slope + jnp.sqrt(discriminant))


def parabolic_step(f: Array, slope: Array, curvature: Array) -> Array:
    """`nearest_zero` for any f' and f''.

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
