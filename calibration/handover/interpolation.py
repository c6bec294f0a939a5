"""Catmull and Rom's cubic between evenly spaced values, as the C header has it."""

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array


def interpolated(values: Array, at: Any) -> Array:
    """Between n values at 0, 1, …, n - 1."""
    index, weight = _points(values.shape[0], at)
    return jnp.sum(weight * values[index], axis=-1)


def interpolated_over_both(table: Array, row: Any, column: Any) -> Array:
    """The same over rows and columns."""
    rows, by_row = _points(table.shape[0], row)
    columns, by_column = _points(table.shape[1], column)
    square = table[rows[..., :, None], columns[..., None, :]]
    return jnp.sum(by_row[..., :, None] * by_column[..., None, :] * square, axis=(-2, -1))


def _points(count: int, at: Any) -> tuple[Array, Array]:
    """The four points about `at` and their weights; beyond an end a parabola goes on."""
    at = jnp.clip(at, 0, count - 1)
    first = jnp.minimum(at.astype(int), count - 2)
    f = at - first
    w = [f * (f * (2 - f) - 1) / 2, 1 + f**2 * (3 * f - 5) / 2]
    w += [f * (1 + f * (4 - 3 * f)) / 2, f**2 * (f - 1) / 2]
    before, after = jnp.where(first == 0, w[0], 0), jnp.where(first == count - 2, w[3], 0)
    w = [
        w[0] - before + after,
        w[1] + 3 * (before - after),
        w[2] - 3 * (before - after),
        w[3] + before - after,
    ]
    index = first[..., None] + jnp.arange(-1, 3)
    return jnp.clip(index, 0, count - 1), jnp.stack(w, axis=-1)
