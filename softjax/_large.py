"""Large batches of impacts: in chunks that stay in the cache, on all cores and devices.

One pass over ten million impacts keeps every intermediate of the size of the batch in memory and
fetches it from there again. In chunks, only the results are that large.
"""

import math

import jax
import jax.numpy as jnp
import numpy as np

from softjax._checks import is_traced
from softjax._pieces import PIECE, in_pieces

# Inside a traced program there is one call, which uses two cores where chunks are large: 21 ns for
# the value, 67 for value and gradient.
TRACED_CHUNK = 65_536


def in_chunks(parts, law, velocity, *settings):
    """`parts(law, velocity, *settings)` of one batch, or of its chunks one after the other.

    Concrete values use all cores and devices; a traced batch belongs to the caller's own program,
    which loops over the chunks.
    """
    leaves, structure = jax.tree.flatten((law, velocity))
    shape = np.broadcast_shapes(*(np.shape(leaf) for leaf in leaves))
    count = math.prod(shape)
    traced = any(is_traced(leaf) for leaf in leaves)
    devices = jax.local_devices()
    one_cpu = devices[0].platform == "cpu" and len(devices) == 1
    one_pass = not one_cpu and (traced or len(devices) == 1)
    if count < 2 * PIECE or one_pass:
        return parts(law, velocity, *settings)
    if traced:
        results = _traced(parts, structure, settings, leaves, shape)
        return jax.tree.map(lambda result: result[:count].reshape(shape), results)

    def of_chunk(*leaves):
        return parts(*jax.tree.unflatten(structure, leaves), *settings)

    flat = [_flat(leaf, shape, np) for leaf in leaves]
    results = in_pieces(of_chunk, (parts, structure, settings), flat, count)
    return jax.device_put(jax.tree.map(lambda result: result.reshape(shape), results))


def _flat(leaf, shape, xp):
    """A value for each impact in a row; a single value stays single."""
    leaf = xp.asarray(leaf)
    return leaf.reshape(()) if leaf.size == 1 else xp.broadcast_to(leaf, shape).reshape(-1)


def _traced(parts, structure, settings, leaves, shape):
    count = math.prod(shape)
    least = math.ceil(count / TRACED_CHUNK)
    # if some number of chunks divides the impacts, nothing has to be copied to fill up the last
    chunks = next((k for k in range(least, 2 * least) if count % k == 0), least)
    missing = -count % chunks
    flat = [_flat(leaf, shape, jnp) for leaf in leaves]
    filled = [jnp.pad(leaf, (0, missing), mode="edge") if leaf.ndim else leaf for leaf in flat]
    # the reverse pass computes a chunk again: faster than to fetch what it would have to store
    recomputed = jax.checkpoint(lambda law, velocity: parts(law, velocity, *settings))

    def one(rows):
        rows = iter(rows)
        chunk = [next(rows) if leaf.ndim else leaf for leaf in filled]
        return recomputed(*jax.tree.unflatten(structure, chunk))

    results = jax.lax.map(one, [leaf.reshape(chunks, -1) for leaf in filled if leaf.ndim])
    return jax.tree.map(lambda result: result.reshape(-1), results)
