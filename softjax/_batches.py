"""A batch of impacts through one compiled function, whatever its size and where it lives.

Concrete batches are filled up to a few sizes, so that few programs are compiled and kept; large ones
go piece by piece (`_pieces`): one pass over ten million impacts would keep every intermediate of the
size of the batch in memory and fetch it from there again. A traced batch belongs to the caller's own
program, which loops over chunks.
"""

import math
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from softjax._checks import is_traced
from softjax._pieces import PIECE, in_pieces
from softjax._rows import across_devices, in_chunks, shares
from softjax._spread import Layout, by_device, is_spread, layout, shard_by_shard
from softjax.compiler import quick_to_compile
from softjax.fields import released, whole_leaves
from softjax.impact import known_regime

# Inside a traced program there is one call, which uses two cores where chunks are large: 21 ns for
# the value, 67 for value and gradient.
TRACED_CHUNK = 65_536
SOON = 4096  # impacts that are computed sooner than a program that runs faster is compiled
# Where devices share it they agree after every step of a search on whether to take another one.
SHARED_CHUNK = 262_144  # on each device
LEAST = 16  # a program takes a second or more to compile and an impact a microsecond
FINE = 256  # from here on four sizes an octave, else one


def in_batches(parts, asked, velocity, *settings, cut=True):
    """`parts(asked, velocity, *settings)`, a compiled function that takes impacts one by one.

    Args:
        asked: the law, and the tolerance of its integration.
        cut: whether large batches are gone through in chunks: not where what comes out, with
            further axes of its own, is much more than what goes in; there one program serves all
            small ones.
    """
    leaves, structure = jax.tree.flatten((asked, velocity))
    whole = whole_leaves((asked, velocity))
    each = [leaf for leaf, held in zip(leaves, whole, strict=True) if not held]
    shape = np.broadcast_shapes(*(np.shape(leaf) for leaf in each))
    count = math.prod(shape)
    # within the caller's own program whatever is computed is traced, of constants too
    # (`device_put` tells without anything to compile)
    if any(is_traced(leaf) for leaf in leaves) or is_traced(jax.device_put(0.0)):
        return _traced(leaves, parts, structure, settings, cut, whole, each, shape)
    if not count:
        return parts(asked, velocity, *settings)
    if any(is_spread(leaf) for leaf in leaves):
        where = layout(each, shape)
        large = cut and _on_cpu() and count >= 2 * PIECE * jax.device_count()
        if large and where is not None:
            results = _by_shard(leaves, parts, structure, settings, where, shape)
            if results is not None:
                return results
        return _spread(leaves, parts, structure, settings, cut, where)
    if not shape:
        leaves[-1] = np.reshape(velocity, 1)
    alone = (shape or (1,)) if count == 1 else None  # one impact is a row, of which there is one
    many = [
        not held and (np.size(leaf) > 1 or np.shape(leaf) == alone)
        for leaf, held in zip(leaves, whole, strict=True)
    ]
    home = next((leaf.device for leaf in leaves if getattr(leaf, "committed", False)), None)
    flat = [
        _flat(leaf, shape or (1,)) if m else _single(leaf, h)
        for leaf, m, h in zip(leaves, many, whole, strict=True)
    ]
    at_once = not cut or (home is None and not _on_cpu() and _devices() == 1)
    if count < PIECE * max(2, _devices()) or at_once:
        size = program_size(max(count, LEAST))
        filled = [_filled(leaf, size) if m else leaf for leaf, m in zip(flat, many, strict=True)]
        filled = filled if home is None else jax.device_put(filled, home)
        compiled = parts
        if size <= SOON:
            compiled = quick_to_compile(parts.__wrapped__, tuple(range(2, 2 + len(settings))))
        results = compiled(*jax.tree.unflatten(structure, filled), *settings)
        if shape == (size,):
            return results
        return _shaped(results, count, shape, home) if shape else _first(results)

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


def _flat(leaf, shape) -> np.ndarray:
    """A value for each impact in a row."""
    return np.broadcast_to(np.asarray(leaf), shape).reshape(-1)


def _single(leaf, held: bool):
    return leaf if held else np.asarray(leaf).reshape(())


@jax.jit
def _first(results):
    """Of one impact: by a program, which is there sooner than arrays made of NumPy's."""
    return jax.tree.map(lambda result: result[0], results)


def _shaped(results, count, shape, home):
    """What is not of the fill, in the batch's shape; further axes stay behind it."""

    def one(result):
        values = np.asarray(result)[:count]
        return values.reshape(shape + values.shape[1:])

    return jax.device_put(jax.tree.map(one, results), home)


def _filled(values: np.ndarray, size: int) -> np.ndarray:
    """The same, filled up by its last."""
    missing = size - len(values)
    return np.concatenate([values, np.repeat(values[-1:], missing)]) if missing else values


def _by_shard(leaves, parts, structure, settings, where: Layout, shape):
    """Large parts of a batch go piece by piece, as a batch of one's own."""
    route, regime, *rest = settings

    def here(*leaves):
        asked, velocity = jax.tree.unflatten(structure, leaves)
        # of all impacts no process may know what each knows of its own
        known = known_regime(released(asked[0]), velocity) if regime == "mixed" else regime
        return in_batches(parts, asked, velocity, route, known, *rest)

    whole = whole_leaves(jax.tree.unflatten(structure, leaves))
    return shard_by_shard(here, leaves, whole, where, shape)


@partial(jax.jit, static_argnames=("parts", "structure", "settings", "cut", "where"))
def _spread(leaves, parts, structure, settings, cut, where: Layout | None):
    """A batch that its owner has spread over devices, which stays there."""

    def here(*leaves):
        return in_batches(parts, *jax.tree.unflatten(structure, leaves), *settings, cut=cut)

    if where is None:
        return here(*leaves)
    return by_device(here, leaves, whole_leaves(jax.tree.unflatten(structure, leaves)), where)


def _traced(leaves, parts, structure, settings, cut, whole, each, shape):
    """One call for all, or for chunk after chunk, on whichever devices the caller has them."""
    where = layout(each, shape)
    if where is not None:
        return _spread(leaves, parts, structure, settings, cut, where)
    count = math.prod(shape)
    parted = len(shape) > 1 and across_devices()  # by whichever of their axes
    few = count < 2 * PIECE * shares(count)
    if few or not cut or parted or not _on_cpu() or any(whole):
        return parts(*jax.tree.unflatten(structure, leaves), *settings)
    results = _in_chunks(leaves, parts, structure, settings, shape)
    return jax.tree.map(lambda result: result.reshape(shape), results)


@partial(jax.jit, static_argnames=("parts", "structure", "settings", "shape"))
def _in_chunks(leaves, parts, structure, settings, shape):
    count = math.prod(shape)
    share = count // shares(count)
    least = math.ceil(share / (TRACED_CHUNK if share == count else SHARED_CHUNK))
    # if some number of chunks divides the impacts, nothing has to be copied to fill up the last
    chunks = next((k for k in range(least, 2 * least) if share % k == 0), least)
    flat = [
        jnp.broadcast_to(leaf, shape).reshape(-1) if np.size(leaf) > 1 else jnp.reshape(leaf, ())
        for leaf in leaves
    ]
    # the reverse pass computes a chunk again: faster than to fetch what it would have to store
    recomputed = jax.checkpoint(lambda law, velocity: parts(law, velocity, *settings))

    def one(*rows):
        rows = iter(rows)
        chunk = [next(rows) if leaf.ndim else leaf for leaf in flat]
        return recomputed(*jax.tree.unflatten(structure, chunk))

    return in_chunks(one, [leaf for leaf in flat if leaf.ndim], chunks)
