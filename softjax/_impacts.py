"""One impact after the other: a function of single numbers over a batch of any shape."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from softjax._rows import across_devices, in_chunks, shares
from softjax.fields import whole_leaves

Mapped = Callable[..., Any]


def over_impacts(one: Callable, batch: tuple, around: Callable[[Mapped, list[bool]], Mapped]):
    """`one(*batch)` for each impact, whatever the shapes in which the leaves of `batch` broadcast.

    Args:
        one: of pytrees whose leaves are single numbers; what is whole (`fields.array_field`) stays
            as it is.
        around: made of the function of flat leaves and of which are whole, what is called instead:
            how it is cut into rows, and differentiated.
    """
    leaves, structure = jax.tree.flatten(batch)
    whole = whole_leaves(batch)
    parts = [leaf for leaf, held in zip(leaves, whole, strict=True) if not held]
    shape = jnp.broadcast_shapes(*(jnp.shape(leaf) for leaf in parts))
    # a number that all impacts have in common stays one: what follows from it is computed once
    whole = [
        held or (shape != () and jnp.shape(x) == ()) for x, held in zip(leaves, whole, strict=True)
    ]
    full = [
        jnp.asarray(leaf) if held else jnp.broadcast_to(leaf, shape)
        for leaf, held in zip(leaves, whole, strict=True)
    ]

    def single(*leaves):
        return one(*jax.tree.unflatten(structure, leaves))

    axes = [None if held else 0 for held in whole]
    run = around(jax.vmap(single, in_axes=axes), whole)
    if len(shape) > 1 and across_devices():
        for _ in shape[1:]:  # in a row, what lies on one device would have to go to another
            run = jax.vmap(run, in_axes=axes)
        return run(*full)
    flat = [leaf if held else leaf.ravel() for leaf, held in zip(full, whole, strict=True)]
    return jax.tree.map(lambda a: a.reshape(shape + a.shape[1:]), run(*flat))


def in_rows(f: Mapped, leaves: tuple, whole: list[bool], size: int):
    """`f(*leaves)`, so many impacts at a time: what is stored of them stays in the cache."""
    each = [leaf for leaf, held in zip(leaves, whole, strict=True) if not held]
    count = len(each[0])
    rows = -(-(count // shares(count)) // size)
    if rows <= 1:
        return f(*leaves)

    def of_row(*some):
        parts = iter(some)
        return f(*(leaf if held else next(parts) for leaf, held in zip(leaves, whole, strict=True)))

    return in_chunks(of_row, each, rows)


def recomputed_in_rows(size: int) -> Callable[[Mapped, list[bool]], Mapped]:
    """Rows whose reverse pass computes them again, which is faster than to store and fetch them."""

    def around(f, whole):
        return lambda *leaves: in_rows(jax.checkpoint(f), leaves, whole, size)

    return around
