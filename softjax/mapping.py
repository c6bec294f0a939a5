"""From one impact to many: map a function of single numbers over a batch, and differentiate it.

A collision has p inputs (the law's numbers and the velocity) and q outputs, both few. Of n impacts the Jacobian
is n small matrices J_i = ∂output_i/∂input_i of size q × p, and no number of one impact moves another: tangents
p at a time ride along one solve, reverse mode is the transposed product with the same J_i,

    forward  ẏ_i = J_i ẋ_i,      reverse  x̄_i = J_iᵀ ȳ_i,

so either mode of the caller costs one solve with p tangents. Only inputs that are differentiated count for p.
Where p is more than `MANY`, as with the weights of a network, the q rows of J_i come from reverse mode.

>>> import jax, jax.numpy as jnp
>>> from softjax.mapping import over_impacts
>>> fall = lambda height, g: jnp.sqrt(2 * height / g)  # one number each
>>> heights = jnp.array([1.0, 4.0])
>>> times = lambda g: over_impacts(fall, (heights, g), forward=True)
>>> print(times(2.0), jax.grad(lambda g: times(g).sum())(2.0))  # -√(h/(2g³)) each: -1/4 and -1/2
[1. 2.] -0.75

Impacts in the axes of arrays, and those of a `vmap` of the caller's, are rows of one program.
"""

from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp
from jax.custom_batching import custom_vmap
from jax.custom_derivatives import SymbolicZero

from softjax.checks import ArgumentError
from softjax.compiling import SOLVED_KEPT, in_chunks, on_cpu, on_several_devices
from softjax.fields import shared_leaves
from softjax.numerics.derivatives import (
    Shared,
    Single,
    contracted,
    directions,
    value_and_gradients,
    value_and_slopes,
)
from softjax.numerics.roots import mark_for_checkpoint

# Rows of impacts within a program: how many at a time, with times on two idle cores.
# Impacts with all nodes of a quadrature stay in the cache: 16 384 values take 0.33 s, 0.52 with 16 at a
# time, 0.40 with 256; their gradients take 0.58 s with 64 or 4096, 0.75 with 16.
BY_REVERSE = 64
# Impacts, each tangent counting as one more: 65 536 by the ODE take 0.11 s, 0.17 with 128 at a time, 0.20
# with 8192; with a gradient 0.29 s, 0.45 and 0.36.
FORWARD = 2048
# Impacts with a long gradient: 4096 with 12 weights take 0.34 s, the same with 64, 0.51 with all at once.
GRADIENTS = 512
ON_GPU = 2**20  # impacts of any kind: thousands of threads wait for each other after every row
# directions: of more, as of a network, derivatives are taken by reverse mode, which costs less. Of two to five
# numbers of a damped contact it takes 1.3 to 1.7 times as long as forward mode; of 4, 8 and 16 weights 0.5 to 0.4
MANY = 7


def over_impacts(
    function: Callable, batch: tuple, *, forward: bool, reversible: Callable | None = None
):
    """`function(*batch)` for each impact, whatever the shapes in which the leaves of `batch` broadcast.

    Args:
        function: of pytrees whose leaves are single numbers; what is shared (`fields.array_field`) stays
            as it is.
        forward: whether derivatives are taken forward whichever way the caller does. Else the
            reverse pass computes rows again, but for roots, which is faster than to store and fetch them.
        reversible: the same as `function`, differentiable in reverse, for more directions than `MANY`.
    """
    leaves, structure = jax.tree.flatten(batch)
    declared = shared_leaves(batch)
    parts = [leaf for leaf, common in zip(leaves, declared, strict=True) if not common]
    shape = jnp.broadcast_shapes(*(jnp.shape(leaf) for leaf in parts))
    # a number that all impacts have in common stays one: what follows from it is computed once
    shared = [
        common or (shape != () and jnp.shape(x) == ())
        for x, common in zip(leaves, declared, strict=True)
    ]
    full = [
        jnp.asarray(leaf) if common else jnp.broadcast_to(leaf, shape)
        for leaf, common in zip(leaves, shared, strict=True)
    ]

    def of_leaves(of_batch, *leaves):
        return of_batch(*jax.tree.unflatten(structure, leaves))

    single = partial(of_leaves, function)
    if forward:
        _check_not_varying(leaves)
        backwards = None if reversible is None else partial(of_leaves, reversible)
        run = forward_differentiated(single, shared, reversible=backwards)
    else:
        mapped = jax.vmap(single, in_axes=[None if common else 0 for common in shared])
        f = jax.checkpoint(mapped, policy=SOLVED_KEPT)
        run = partial(_in_rows, f, shared, BY_REVERSE)
    if len(shape) > 1 and on_several_devices():
        for _ in shape[1:]:  # in a row, what lies on one device would have to go to another
            run = jax.vmap(run, in_axes=[None if common else 0 for common in shared])
        return run(*full)
    flat = [leaf if common else leaf.ravel() for leaf, common in zip(full, shared, strict=True)]
    return jax.tree.map(lambda a: a.reshape(shape + a.shape[1:]), run(*flat))


def _in_rows(f: Callable, shared: Shared, size: int, *leaves):
    """`f(*leaves)` of a row of impacts, so many at a time: what is stored of them stays in the cache."""
    many = [not common for common in shared]
    chunks = -(-len(leaves[many.index(True)]) // (size if on_cpu() else ON_GPU))
    return f(*leaves) if on_several_devices() else in_chunks(f, leaves, many, chunks)


def _mapped(single: Single, shared: Shared, size: int) -> Callable:
    """`single` of a row of impacts; under `vmap` of as many more impacts in the same row."""
    f = jax.vmap(single, in_axes=[None if common else 0 for common in shared])
    mapped = custom_vmap(partial(_in_rows, f, shared, size))

    @mapped.def_vmap
    def rule(axis_size, batched, *leaves):
        each = zip(leaves, batched, shared, strict=True)
        if any(b and common and jnp.ndim(x) > 1 for x, b, common in each):  # a network each
            results = jax.vmap(mapped.fun, in_axes=[0 if b else None for b in batched])(*leaves)
            return results, jax.tree.map(lambda _: True, results)
        still = [common and not b for common, b in zip(shared, batched, strict=True)]
        rows = [
            x.shape[b:] for x, b, common in zip(leaves, batched, shared, strict=True) if not common
        ]
        shape = (axis_size, *rows[0])
        flat = []
        for leaf, is_batched, stays in zip(leaves, batched, still, strict=True):
            if is_batched:  # by itself or next to each other impact's
                leaf = leaf.reshape(axis_size, -1)
            flat.append(leaf if stays else jnp.broadcast_to(leaf, shape).ravel())
        results = _mapped(single, still, size)(*flat)
        results = jax.tree.map(lambda x: x.reshape(*shape, *x.shape[1:]), results)
        return results, jax.tree.map(lambda _: True, results)

    return mapped


def forward_differentiated(
    single: Single, shared: Shared, size: int = FORWARD, reversible: Single | None = None
) -> Callable:
    """`single` of a row of impacts, whose matrix of derivatives serves either mode of the caller.

    A collision has few inputs (the law's numbers and the velocity) and few outputs: tangents ride
    along one solve, and reverse mode is the transpose of the small matrix that they make. Only
    the inputs that are differentiated get a tangent; each shared number gets its own. If
    these are more than `MANY`, the rows of the matrix come from `reversible` by reverse mode. The
    matrix is differentiated forward again.
    """
    wrapped = jax.custom_jvp(_mapped(single, shared, size))

    def rule(primals, tangents):
        active = [i for i, t in enumerate(tangents) if not isinstance(t, SymbolicZero)]
        active_shared = [shared[i] for i in active]
        change = directions([tangents[i] for i in active], active_shared)
        if reversible is not None and change.shape[-1] > MANY:
            with_slopes = partial(value_and_gradients, reversible, active)
            fewer = GRADIENTS
        else:
            with_slopes = partial(value_and_slopes, single, active)
            fewer = max(size // (1 + change.shape[-1]), 1)
        solved = forward_differentiated(with_slopes, shared, fewer)(*primals)
        value, slopes = jax.tree.map(mark_for_checkpoint, solved)
        return value, contracted(slopes, change)

    wrapped.defjvp(rule, symbolic_zeros=True)
    return wrapped


def _check_not_varying(leaves) -> None:
    """Raise where `shard_map` follows what differs between devices: diffrax's loops do not."""
    for leaf in leaves:
        kind = jax.typeof(leaf)
        varying = getattr(kind, "vma", None) or getattr(getattr(kind, "mat", None), "varying", None)
        if varying:
            raise ArgumentError("`jax.shard_map` must have check_vma=False for the route ODE(...)")
