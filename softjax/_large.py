"""Large batches of concrete impacts: in chunks that stay in the cache, on all cores and devices.

One pass over ten million impacts keeps every intermediate of the size of the batch in memory and
fetches it from there again. In chunks, only the results are that large.
"""

import math
import os
from concurrent.futures import ThreadPoolExecutor

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, PartitionSpec

from softjax._checks import is_traced

# Measured on two cores at 10^6 impacts: 34 to 38 ns an impact with chunks of 2048 to 8192, which
# stay in the cache, 81 ns in one pass.
CHUNK = 8192
CHUNKS = 16  # in a piece, which is one call into compiled code: 1 MiB of each result
PIECE = CHUNK * CHUNKS
# Inside a traced program there is one call, which uses two cores where chunks are large: 40 ns for
# the value, 110 for value and gradient, against 72 and 138 in one pass.
TRACED_CHUNK = 65_536


def in_chunks(parts, law, velocity, *settings):
    """`parts(law, velocity, *settings)` of one batch, or of its chunks one after the other.

    Concrete values use all cores and devices; a traced batch belongs to the caller's own program,
    which loops over the chunks.
    """
    leaves, structure = jax.tree.flatten((law, velocity))
    shape = np.broadcast_shapes(*(np.shape(leaf) for leaf in leaves))
    count = math.prod(shape)
    devices = jax.local_devices()
    one_cpu = devices[0].platform == "cpu" and len(devices) == 1
    traced = any(is_traced(leaf) for leaf in leaves)
    if count < 2 * PIECE or (traced and not one_cpu):
        return parts(law, velocity, *settings)
    if traced:
        results = _traced(parts, structure, settings, leaves, shape)
        return jax.tree.map(lambda result: result[:count].reshape(shape), results)
    flat = [_flat(leaf, shape, np) for leaf in leaves]
    each = _compiled(parts, structure, settings, len(devices))
    # one device's work is single-threaded where it loops, and several calls of it run at once
    results = _in_pieces(each, flat, count, PIECE * len(devices), _cores() if one_cpu else 1)
    return jax.tree.map(lambda result: jax.device_put(result.reshape(shape)), results)


def _flat(leaf, shape, xp):
    """A value for each impact in a row; a single value stays single."""
    leaf = xp.asarray(leaf)
    return leaf.reshape(()) if leaf.size == 1 else xp.broadcast_to(leaf, shape).reshape(-1)


def _traced(parts, structure, settings, leaves, shape):
    count = math.prod(shape)
    chunks = math.ceil(count / TRACED_CHUNK)
    missing = -count % chunks
    flat = [_flat(leaf, shape, jnp) for leaf in leaves]
    filled = [jnp.pad(leaf, (0, missing), mode="edge") if leaf.ndim else leaf for leaf in flat]
    # the reverse pass computes a chunk again: faster than to fetch what it would have to store
    recomputed = jax.checkpoint(lambda law, velocity: parts(law, velocity, *settings))
    return _over_chunks(recomputed, structure, (), filled, (count + missing) // chunks)


def _cores() -> int:
    affinity = getattr(os, "sched_getaffinity", None)  # not on every system
    return len(affinity(0)) if affinity else os.cpu_count() or 1


def _in_pieces(each, flat, count, size, threads):
    """Results of all pieces in a few arrays made once, each piece written where it belongs."""
    kinds = jax.eval_shape(each, *(leaf[:1].repeat(size) if leaf.ndim else leaf for leaf in flat))
    results = jax.tree.map(lambda kind: _aligned(count, kind.dtype), kinds)

    def one(start):
        stop = min(start + size, count)
        # the last piece is filled up by the impacts before it, so that all have one shape
        start = max(stop - size, 0)
        piece = each(*(leaf[start:stop] if leaf.ndim else leaf for leaf in flat))
        for result, values in zip(jax.tree.leaves(results), jax.tree.leaves(piece), strict=True):
            result[start:stop] = values

    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(one, range(0, count, size)))
    return results


def _aligned(count, dtype) -> np.ndarray:
    """An empty array that JAX takes over as it is: its data must begin at a cache line."""
    line = 64
    memory = np.empty(count * dtype.itemsize + line, np.uint8)
    first = -memory.ctypes.data % line
    return memory[first : first + count * dtype.itemsize].view(dtype)


_programs: dict = {}


def _compiled(parts, structure, settings, devices):
    """The compiled loop over the chunks of a piece, one for each function and static settings."""
    key = (parts, structure, settings, devices)
    if key not in _programs:

        def program(*leaves):
            return _over_chunks(parts, structure, settings, leaves)

        _programs[key] = jax.jit(_over_devices(program) if devices > 1 else program)
    return _programs[key]


def _over_devices(program):
    """Each device has its own part of the impacts and loops over it by itself."""
    mesh = Mesh(np.array(jax.local_devices()), ("impacts",))

    def spread(*leaves):
        axes = tuple(PartitionSpec("impacts") if leaf.ndim else PartitionSpec() for leaf in leaves)
        return jax.shard_map(
            program, mesh=mesh, in_specs=axes, out_specs=PartitionSpec("impacts"), check_vma=False
        )(*leaves)

    return spread


def _over_chunks(parts, structure, settings, leaves, size=CHUNK):
    """`parts` of a chunk after the other; leaves with a value for each impact have a row each."""
    rows = [leaf.reshape(-1, size) for leaf in leaves if leaf.ndim]

    def one(chunk):
        chunk = iter(chunk)
        filled = [next(chunk) if leaf.ndim else jnp.asarray(leaf) for leaf in leaves]
        return parts(*jax.tree.unflatten(structure, filled), *settings)

    results = jax.lax.map(one, rows)
    return jax.tree.map(lambda result: result.reshape(-1), results)
