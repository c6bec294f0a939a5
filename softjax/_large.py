"""Large batches of concrete impacts: in chunks that stay in the cache, over all local devices.

One pass over ten million impacts keeps every intermediate of the size of the batch in memory and
fetches it from there again. In chunks, only the results are that large.
"""

import math

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from softjax._checks import is_traced

# Measured on two cores at 10^6 and 10^7 impacts: the time falls to here, and the memory is the
# results' own; larger chunks leave the cache.
CHUNK = 65_536


def in_chunks(parts, law, velocity, *settings):
    """`parts(law, velocity, *settings)` of one batch, or of its chunks one after the other.

    Only where all values are concrete: a traced batch belongs to the caller's own program.
    """
    leaves = jax.tree.leaves((law, velocity))
    shape = np.broadcast_shapes(*(np.shape(leaf) for leaf in leaves))
    count = math.prod(shape)
    if count <= CHUNK or any(is_traced(leaf) for leaf in leaves):
        return parts(law, velocity, *settings)
    devices = jax.local_devices()
    chunks, size = _divide(count, len(devices))
    rows = jax.tree.map(lambda leaf: _as_rows(leaf, shape, chunks, size), (law, velocity))
    if len(devices) > 1:
        rows = jax.tree.map(lambda leaf: _spread(leaf, devices), rows)
    results = _map_jit(parts, settings)(*rows)
    return jax.tree.map(lambda a: a.reshape(-1)[:count].reshape(shape), results)


def _divide(count: int, devices: int) -> tuple[int, int]:
    """Number and size of chunks, without a remainder where up to twice as many allow it."""
    least = math.ceil(count / (CHUNK * devices))
    for chunks in range(least, 2 * least + 1):
        if count % (chunks * devices) == 0:
            return chunks, count // chunks
    size = math.ceil(count / (least * devices)) * devices
    return least, size


def _as_rows(leaf, shape, chunks, size):
    """(chunks, size) for a leaf with a value for each impact; a single value stays single."""
    if np.size(leaf) == 1:
        return jnp.asarray(leaf).reshape(())
    flat = jnp.broadcast_to(leaf, shape).reshape(-1)
    missing = chunks * size - flat.size
    if missing:
        flat = jnp.concatenate([flat, jnp.broadcast_to(flat[-1], (missing,))])
    return flat.reshape(chunks, size)


def _spread(leaf, devices):
    """Each chunk over all devices."""
    mesh = Mesh(np.array(devices), ("impacts",))
    axes = PartitionSpec(None, "impacts") if np.ndim(leaf) else PartitionSpec()
    return jax.device_put(leaf, NamedSharding(mesh, axes))


_maps: dict = {}


def _map_jit(parts, settings):
    """The compiled loop over chunks, one for each function and its static settings."""
    key = (parts, settings)
    if key not in _maps:
        _maps[key] = jax.jit(lambda law, velocity: _map(parts, law, velocity, settings))
    return _maps[key]


def _map(parts, law, velocity, settings):
    leaves, structure = jax.tree.flatten((law, velocity))
    per_impact = [leaf for leaf in leaves if leaf.ndim]

    def one(rows):
        rows = iter(rows)
        filled = [next(rows) if leaf.ndim else leaf for leaf in leaves]
        return parts(*jax.tree.unflatten(structure, filled), *settings)

    return jax.lax.map(one, per_impact)
