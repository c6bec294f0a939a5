"""A function of one impact over a batch of any shape, and how the batch is differentiated.

Here one impact becomes many, in one `vmap`: impacts in the axes of arrays, and those of a `vmap` of the
caller's, are rows of the same program.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_batching import custom_vmap
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array

from softjax.batching import in_chunks, on_several_devices
from softjax.checks import ArgumentError
from softjax.fields import whole_leaves

Single = Callable[..., Any]  # of leaves of one impact
Shared = Sequence[bool]  # which leaves are the same for all impacts

BY_REVERSE = 64  # impacts, each with all nodes of a quadrature, stay in the cache
FORWARD = 2048  # impacts, each with its tangents counting as one more
GRADIENTS = 64  # impacts, each with a long gradient
MANY = 7  # directions: of more, as of a network, derivatives are taken by reverse mode, which costs less


def over_impacts(one: Callable, batch: tuple, *, forward: bool, reversible: Callable | None = None):
    """`one(*batch)` for each impact, whatever the shapes in which the leaves of `batch` broadcast.

    Args:
        one: of pytrees whose leaves are single numbers; what is shared (`fields.array_field`) stays
            as it is.
        forward: whether derivatives are taken forward whichever way the caller does. Else the
            reverse pass computes rows again, which is faster than to store and fetch them.
        reversible: the same as `one`, differentiable in reverse, for more directions than `MANY`.
    """
    leaves, structure = jax.tree.flatten(batch)
    whole = whole_leaves(batch)
    parts = [leaf for leaf, held in zip(leaves, whole, strict=True) if not held]
    shape = jnp.broadcast_shapes(*(jnp.shape(leaf) for leaf in parts))
    # a number that all impacts have in common stays one: what follows from it is computed once
    shared = [
        held or (shape != () and jnp.shape(x) == ()) for x, held in zip(leaves, whole, strict=True)
    ]
    full = [
        jnp.asarray(leaf) if held else jnp.broadcast_to(leaf, shape)
        for leaf, held in zip(leaves, shared, strict=True)
    ]

    def of_leaves(function, *leaves):
        return function(*jax.tree.unflatten(structure, leaves))

    single = partial(of_leaves, one)
    if forward:
        backwards = None if reversible is None else partial(of_leaves, reversible)
        run = forward_differentiated(single, shared, reversible=backwards)
    else:
        run = _recomputed(single, shared)
    if len(shape) > 1 and on_several_devices():
        for _ in shape[1:]:  # in a row, what lies on one device would have to go to another
            run = jax.vmap(run, in_axes=[None if held else 0 for held in shared])
        return run(*full)
    flat = [leaf if held else leaf.ravel() for leaf, held in zip(full, shared, strict=True)]
    return jax.tree.map(lambda a: a.reshape(shape + a.shape[1:]), run(*flat))


def _recomputed(single: Single, shared: Shared) -> Callable:
    f = jax.checkpoint(jax.vmap(single, in_axes=[None if held else 0 for held in shared]))
    return lambda *leaves: _in_rows(f, leaves, shared, BY_REVERSE)


def _in_rows(f: Callable, leaves: Sequence, shared: Shared, size: int):
    """`f(*leaves)` of a row of impacts, so many at a time: what is stored of them stays in the cache."""
    each = [leaf for leaf, held in zip(leaves, shared, strict=True) if not held]
    if on_several_devices():
        return f(*leaves)

    def of_row(*some):
        parts = iter(some)
        return f(*(x if held else next(parts) for x, held in zip(leaves, shared, strict=True)))

    return in_chunks(of_row, each, -(-len(each[0]) // size))


def _mapped(single: Single, shared: Shared, size: int) -> Callable:
    """`single` of a row of impacts; under `vmap` of as many more impacts in the same row."""

    @custom_vmap
    def mapped(*leaves):
        f = jax.vmap(single, in_axes=[None if held else 0 for held in shared])
        return _in_rows(f, leaves, shared, size)

    @mapped.def_vmap
    def rule(axis_size, batched, *leaves):
        each = zip(leaves, batched, shared, strict=True)
        if any(b and held and jnp.ndim(x) > 1 for x, b, held in each):  # a network each
            found = jax.vmap(mapped.fun, in_axes=[0 if b else None for b in batched])(*leaves)
            return found, jax.tree.map(lambda _: True, found)
        still = [held and not b for held, b in zip(shared, batched, strict=True)]
        rows = [x.shape[b:] for x, b, held in zip(leaves, batched, shared, strict=True) if not held]
        shape = (axis_size, *rows[0])
        flat = []
        for leaf, is_batched, stays in zip(leaves, batched, still, strict=True):
            if is_batched:  # by itself or next to each other impact's
                leaf = leaf.reshape(axis_size, -1)
            flat.append(leaf if stays else jnp.broadcast_to(leaf, shape).ravel())
        found = _mapped(single, still, size)(*flat)
        found = jax.tree.map(lambda x: x.reshape(*shape, *x.shape[1:]), found)
        return found, jax.tree.map(lambda _: True, found)

    return mapped


def forward_differentiated(
    single: Single, shared: Shared, size: int = FORWARD, reversible: Single | None = None
) -> Callable:
    """`single` of a row of impacts, whose matrix of derivatives serves either mode of the caller.

    A collision has few inputs (the law's numbers and the velocity) and few outputs: tangents ride
    along one solve, and reverse mode is the transpose of the small matrix that they make. Only
    the inputs that really are differentiated get a tangent, of what is shared every number one. If
    these are more than `MANY`, the rows of the matrix come from `reversible` by reverse mode. The
    matrix is differentiated forward again.
    """

    @jax.custom_jvp
    def wrapped(*leaves):
        _check_not_told_apart(leaves)
        return _mapped(single, shared, size)(*leaves)

    def rule(primals, tangents):
        active = [i for i, t in enumerate(tangents) if not isinstance(t, SymbolicZero)]
        held = [shared[i] for i in active]
        change = _directions([tangents[i] for i in active], held)
        if reversible is not None and change.shape[-1] > MANY:
            with_slopes = partial(value_and_gradients, reversible, active)
            fewer = GRADIENTS
        else:
            with_slopes = partial(value_and_slopes, single, active)
            fewer = max(size // (1 + change.shape[-1]), 1)
        value, slopes = forward_differentiated(with_slopes, shared, fewer)(*primals)
        return value, _contracted(slopes, change)

    wrapped.defjvp(rule, symbolic_zeros=True)
    return wrapped


def _check_not_told_apart(leaves) -> None:
    """Raise where `shard_map` follows what differs between devices: diffrax's loops do not."""
    for leaf in leaves:
        kind = jax.typeof(leaf)
        varying = getattr(kind, "vma", None) or getattr(getattr(kind, "mat", None), "varying", None)
        if varying:
            raise ArgumentError("`jax.shard_map` must have check_vma=False for the route ODE(...)")


def _directions(tangents, shared: Shared) -> Array:
    """One column for each direction that `value_and_slopes` takes, one row for each impact."""
    count = next((len(t) for t, held in zip(tangents, shared, strict=True) if not held), 1)
    columns = [
        jnp.broadcast_to(t.ravel(), (count, t.size)) if held else t[:, None]
        for t, held in zip(tangents, shared, strict=True)
    ]
    return jnp.concatenate(columns, -1)


def _contracted(slopes, change: Array):
    """Tangents of all outputs, from derivatives by every direction, their last axis."""

    def contract(slope):
        if not jnp.issubdtype(slope.dtype, jnp.inexact):
            return slope[..., 0]
        between = (1,) * (slope.ndim - change.ndim)
        return jnp.sum(slope * change.reshape(*change.shape[:-1], *between, -1), -1)

    return jax.tree.map(contract, slopes)


def along_active(f: Callable, *leaves, slopes: Callable | None = None):
    """`f(*leaves)` of one impact, differentiated along those of its leaves alone that have a tangent.

    A part of a collision would carry a tangent for each number of the law, zeros too: one that acts
    on unloading alone costs nothing on loading.

    Args:
        slopes: of the positions of these leaves and all leaves the value and its derivatives, as
            `value_and_slopes` gives them.
    """
    slopes = partial(value_and_slopes, f) if slopes is None else slopes

    @jax.custom_jvp
    def wrapped(*leaves):
        return f(*leaves)

    def rule(primals, tangents):
        active = [i for i, t in enumerate(tangents) if not isinstance(t, SymbolicZero)]
        value, matrix = slopes(active, *primals)
        return value, _contracted(matrix, jnp.concatenate([jnp.ravel(tangents[i]) for i in active]))

    wrapped.defjvp(rule, symbolic_zeros=True)
    return wrapped(*leaves)


def value_and_slopes(single: Single, active: Sequence[int], *primals):
    """`single` and its derivatives by every number of the active leaves, which are a last axis."""
    of_active, chosen = _of_active(single, active, primals)
    sizes = [jnp.size(x) for x in chosen]
    every = jnp.split(jnp.eye(sum(sizes), dtype=chosen[0].dtype), np.cumsum(sizes)[:-1], axis=1)
    seeds = [part.reshape(-1, *jnp.shape(x)) for part, x in zip(every, chosen, strict=True)]
    push = lambda seeds: jax.jvp(of_active, chosen, seeds)  # noqa: E731
    return jax.vmap(push, out_axes=(None, -1))(seeds)


def value_and_gradients(single: Single, active: Sequence[int], *primals):
    """The same by reverse mode, output by output, each a single number."""
    of_active, chosen = _of_active(single, active, primals)
    value, pull = jax.vjp(of_active, *chosen)
    outputs, structure = jax.tree.flatten(value)
    numbers = [k for k, x in enumerate(outputs) if jnp.issubdtype(x.dtype, jnp.inexact)]
    none = np.zeros(1, jax.dtypes.float0)

    def along(row):
        seeds = [np.zeros((), jax.dtypes.float0)] * len(outputs)
        for place, k in enumerate(numbers):
            seeds[k] = row[place]
        return jnp.concatenate([jnp.ravel(g) for g in pull(jax.tree.unflatten(structure, seeds))])

    rows = iter(jax.vmap(along)(jnp.eye(len(numbers), dtype=chosen[0].dtype)))
    slopes = [next(rows) if k in numbers else none for k in range(len(outputs))]
    return value, jax.tree.unflatten(structure, slopes)


def _of_active(single: Single, active: Sequence[int], primals):
    """`single` as a function of the active leaves alone, and these."""

    def of_active(*some):
        full = list(primals)
        for i, value in zip(active, some, strict=True):
            full[i] = value
        return single(*full)

    return of_active, [primals[i] for i in active]
