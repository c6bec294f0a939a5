"""A batch of impacts through one compiled function, whatever its size and where it lives.

Concrete batches are filled up to a few sizes, so that few programs are compiled and kept; large ones
go piece by piece (`_pieces`): one pass over ten million impacts would keep every intermediate of the
size of the batch in memory and fetch it from there again. A traced batch belongs to the caller's own
program, which loops over chunks.
"""

import math

import jax
import jax.numpy as jnp
import numpy as np

from softjax._checks import is_traced
from softjax._pieces import PIECE, in_pieces
from softjax.compiler import quick_to_compile
from softjax.fields import whole_leaves

# Inside a traced program there is one call, which uses two cores where chunks are large: 21 ns for
# the value, 67 for value and gradient.
TRACED_CHUNK = 65_536
SOON = 4096  # impacts that are computed sooner than a program that runs faster is compiled
FINE = 256  # from here on four sizes an octave, else one


def in_batches(parts, law, velocity, *settings):
    """`parts(law, velocity, *settings)`, a compiled function that takes impacts one by one."""
    leaves, structure = jax.tree.flatten((law, velocity))
    whole = whole_leaves((law, velocity))
    each = [leaf for leaf, held in zip(leaves, whole, strict=True) if not held]
    shape = np.broadcast_shapes(*(np.shape(leaf) for leaf in each))
    count = math.prod(shape)
    if any(is_traced(leaf) for leaf in leaves):
        if count < 2 * PIECE or _devices() > 1 or not _on_cpu() or any(whole):
            return parts(law, velocity, *settings)
        results = _traced(parts, structure, settings, leaves, shape)
        return jax.tree.map(lambda result: result[:count].reshape(shape), results)
    # a batch that its owner has spread over devices stays there
    if not (shape and count) or any(_is_spread(leaf) for leaf in leaves):
        return parts(law, velocity, *settings)
    many = [np.size(leaf) > 1 and not held for leaf, held in zip(leaves, whole, strict=True)]
    many = many if any(many) else [np.shape(leaf) == shape for leaf in leaves]
    home = next((leaf.device for leaf in leaves if getattr(leaf, "committed", False)), None)
    flat = [
        _flat(leaf, shape) if m else _single(leaf, h)
        for leaf, m, h in zip(leaves, many, whole, strict=True)
    ]
    if count < 2 * PIECE or (home is None and not _on_cpu() and _devices() == 1):
        size = program_size(count)
        filled = [_filled(leaf, size) if m else leaf for leaf, m in zip(flat, many, strict=True)]
        filled = filled if home is None else jax.device_put(filled, home)
        compiled = parts
        if size <= SOON:
            compiled = quick_to_compile(parts.__wrapped__, tuple(range(2, 2 + len(settings))))
        results = compiled(*jax.tree.unflatten(structure, filled), *settings)
        if shape == (size,):
            return results
        return jax.tree.map(lambda r: _placed(np.asarray(r)[:count].reshape(shape), home), results)

    def of_chunk(*leaves):
        return parts(*jax.tree.unflatten(structure, leaves), *settings)

    results = in_pieces(of_chunk, (parts, structure, settings), flat, many, count)
    return jax.device_put(jax.tree.map(lambda result: result.reshape(shape), results), home)


def program_size(count: int) -> int:
    """The size of the program that serves so many impacts: at most a quarter more, or twice a few."""
    octave = 2 ** (count - 1).bit_length()
    step = max(octave // 8, 1) if octave > FINE else octave
    return -(-count // step) * step


def _devices() -> int:
    return len(jax.local_devices())


def _on_cpu() -> bool:
    return jax.local_devices()[0].platform == "cpu"


def _is_spread(leaf) -> bool:
    return isinstance(leaf, jax.Array) and len(leaf.sharding.device_set) > 1


def _flat(leaf, shape) -> np.ndarray:
    """A value for each impact in a row."""
    return np.broadcast_to(np.asarray(leaf), shape).reshape(-1)


def _single(leaf, held: bool):
    return leaf if held else np.asarray(leaf).reshape(())


def _placed(values: np.ndarray, home) -> jax.Array:
    return jax.device_put(values, home)


def _filled(values: np.ndarray, size: int) -> np.ndarray:
    """The same, filled up by its last."""
    missing = size - len(values)
    return np.concatenate([values, np.repeat(values[-1:], missing)]) if missing else values


def _traced(parts, structure, settings, leaves, shape):
    count = math.prod(shape)
    least = math.ceil(count / TRACED_CHUNK)
    # if some number of chunks divides the impacts, nothing has to be copied to fill up the last
    chunks = next((k for k in range(least, 2 * least) if count % k == 0), least)
    missing = -count % chunks
    flat = [
        jnp.broadcast_to(leaf, shape).reshape(-1) if np.size(leaf) > 1 else jnp.reshape(leaf, ())
        for leaf in leaves
    ]
    filled = [jnp.pad(leaf, (0, missing), mode="edge") if leaf.ndim else leaf for leaf in flat]
    # the reverse pass computes a chunk again: faster than to fetch what it would have to store
    recomputed = jax.checkpoint(lambda law, velocity: parts(law, velocity, *settings))

    def one(rows):
        rows = iter(rows)
        chunk = [next(rows) if leaf.ndim else leaf for leaf in filled]
        return recomputed(*jax.tree.unflatten(structure, chunk))

    results = jax.lax.map(one, [leaf.reshape(chunks, -1) for leaf in filled if leaf.ndim])
    return jax.tree.map(lambda result: result.reshape(-1), results)
