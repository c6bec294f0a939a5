"""One impact after the other: a function of single numbers over a batch of any shape."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

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
    flat = [
        jnp.asarray(leaf) if held else jnp.broadcast_to(leaf, shape).ravel()
        for leaf, held in zip(leaves, whole, strict=True)
    ]

    def single(*leaves):
        return one(*jax.tree.unflatten(structure, leaves))

    mapped = jax.vmap(single, in_axes=[None if held else 0 for held in whole])
    result = around(mapped, whole)(*flat)
    return jax.tree.map(lambda a: a.reshape(shape + a.shape[1:]), result)


def in_rows(f: Mapped, leaves: tuple, whole: list[bool], size: int):
    """`f(*leaves)`, so many impacts at a time: what is stored of them stays in the cache."""
    count = next(len(leaf) for leaf, held in zip(leaves, whole, strict=True) if not held)
    rows = -(-count // size)
    if rows <= 1:
        return f(*leaves)
    missing = -count % rows

    def row(leaf):
        return jnp.pad(leaf, (0, missing), mode="edge").reshape(rows, -1)

    filled = [row(leaf) for leaf, held in zip(leaves, whole, strict=True) if not held]

    def of_row(some):
        parts = iter(some)
        return f(*(leaf if held else next(parts) for leaf, held in zip(leaves, whole, strict=True)))

    results = jax.lax.map(of_row, filled)
    return jax.tree.map(lambda a: a.reshape(-1, *a.shape[2:])[:count], results)


def recomputed_in_rows(size: int) -> Callable[[Mapped, list[bool]], Mapped]:
    """Rows whose reverse pass computes them again, which is faster than to store and fetch them."""

    def around(f, whole):
        return lambda *leaves: in_rows(jax.checkpoint(f), leaves, whole, size)

    return around
