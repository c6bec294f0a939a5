"""Matrices of derivatives of one impact, by those of its inputs alone that have a tangent.

Of a function f of numbers x_1 … x_p the rule ḟ = Σ_j (∂f/∂x_j) ẋ_j needs ∂f/∂x_j only where ẋ_j is no constant
zero. `value_and_slopes` takes these columns forward, one tangent each in one pass; `value_and_gradients` takes the
rows of the outputs in reverse. `contracted` is the sum over j.

>>> import jax.numpy as jnp
>>> from softjax.numerics.derivatives import contracted, value_and_slopes
>>> energy = lambda mass, speed: 0.5 * mass * speed**2
>>> value, slopes = value_and_slopes(energy, [1], jnp.asarray(2.0), jnp.asarray(3.0))  # by the speed: M v
>>> print(value, slopes, contracted(slopes, jnp.array([0.5])))
9.0 [6.] 3.0
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array

Single = Callable[..., Any]  # of leaves of one impact
Shared = Sequence[bool]  # which leaves are the same for all impacts


def differentiate_active_inputs(f: Callable, *trees, slopes: Callable | None = None):
    """`f(*trees)` of one impact, differentiated along those of its leaves alone that have a tangent.

    A part of a collision would carry a tangent for each number of the law, zeros too: one that acts
    on unloading alone costs nothing on loading.

    Args:
        slopes: of the positions of these leaves and all leaves the value and its derivatives, as
            `value_and_slopes` gives them.
    """
    leaves, structure = jax.tree.flatten(trees)

    @jax.custom_jvp
    def of_leaves(*leaves):
        return f(*jax.tree.unflatten(structure, leaves))

    slopes = partial(value_and_slopes, of_leaves.fun) if slopes is None else slopes

    def rule(primals, tangents):
        active = [i for i, t in enumerate(tangents) if not isinstance(t, SymbolicZero)]
        value, matrix = slopes(active, *primals)
        return value, contracted(matrix, jnp.concatenate([jnp.ravel(tangents[i]) for i in active]))

    of_leaves.defjvp(rule, symbolic_zeros=True)
    return of_leaves(*leaves)


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
    value, transposed = jax.vjp(of_active, *chosen)
    outputs, structure = jax.tree.flatten(value)
    numbers = [k for k, x in enumerate(outputs) if jnp.issubdtype(x.dtype, jnp.inexact)]
    none = np.zeros(1, jax.dtypes.float0)

    def along(row):
        seeds = [np.zeros((), jax.dtypes.float0)] * len(outputs)
        for place, k in enumerate(numbers):
            seeds[k] = row[place]
        return jnp.concatenate(
            [jnp.ravel(g) for g in transposed(jax.tree.unflatten(structure, seeds))]
        )

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


def directions(tangents, shared: Shared) -> Array:
    """One column for each direction that `value_and_slopes` takes, one row for each impact."""
    count = next((len(t) for t, common in zip(tangents, shared, strict=True) if not common), 1)
    columns = [
        jnp.broadcast_to(t.ravel(), (count, t.size)) if common else t[:, None]
        for t, common in zip(tangents, shared, strict=True)
    ]
    return jnp.concatenate(columns, -1)


def contracted(slopes, change: Array):
    """Tangents of all outputs, from derivatives by every direction, their last axis."""

    def contract(slope):
        if not jnp.issubdtype(slope.dtype, jnp.inexact):
            return slope[..., 0]
        between = (1,) * (slope.ndim - change.ndim)
        return jnp.sum(slope * change.reshape(*change.shape[:-1], *between, -1), -1)

    return jax.tree.map(contract, slopes)
