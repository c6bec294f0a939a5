"""A function of many impacts, some of them at a time, in a program that may be spread over devices.

Where a traced array lies is not known: only the compiled program tells. Cut into one part a device,
each of which is then looped over, it stays where it lies whichever devices share it; a loop over
the whole of it would have every device fetch every part.
"""

from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp
from jaxtyping import Array


def across_devices() -> bool:
    """Whether a traced array may be spread; inside `shard_map` each device has its own."""
    return jax.device_count() > 1 and not jax.sharding.get_abstract_mesh().manual_axes


def shares(count: int) -> int:
    """Into how many equal parts a batch is cut, so that whichever devices share it keep theirs."""
    devices = jax.device_count() if across_devices() else 1
    return 1 if count % devices else devices


def in_chunks(f: Callable, leaves: Sequence[Array], chunks: int):
    """`f(*leaves)` of arrays (count,) as so many calls in a row, each of all devices.

    The last of them is filled up. What `f` gives may have further axes behind the one of impacts.
    """
    count = len(leaves[0])
    parts = shares(count)
    share = count // parts
    missing = -share % chunks

    def rows(leaf):
        leaf = leaf.reshape(parts, share)
        if missing:
            leaf = jnp.pad(leaf, ((0, 0), (0, missing)), mode="edge")
        return jnp.moveaxis(leaf.reshape(parts, chunks, -1), 1, 0)

    def one(some):
        return f(*(leaf.reshape(-1) for leaf in some))

    def joined(result):
        beyond = result.shape[2:]
        result = jnp.moveaxis(result.reshape(chunks, parts, -1, *beyond), 0, 1)
        result = result.reshape(parts, share + missing, *beyond)
        return result[:, :share].reshape(count, *beyond)

    return jax.tree.map(joined, jax.lax.map(one, [rows(leaf) for leaf in leaves]))
