"""Compile functions of impacts for few sizes of batches, and compute batches in them.

A batch of n impacts is padded to N, a power of two up to 256 and an eighth of one beyond, by copies of its
last impact. N is 16 at least: so many different n share one compiled program that a file of measurements
meets two or three. Up to 4096 impacts XLA optimises less (`SOONEST`, `QUICK`), because it takes longer to
compile than to compute. From 2^18 impacts on a batch is cut into blocks of 2^17, one a thread, each of
16 chunks of 8192: one pass over a million impacts would write every intermediate to memory and fetch it again.

    n = 30 measurements                N = 32, computed as 32
    n = 5000                           N = 5120: 5 eighths of 8192
    n = 1 000 000                      8 blocks; the last begins at 1 000 000 - 131 072

>>> from softjax.compiling import padded_size
>>> [padded_size(n) for n in (16, 30, 257, 5000)]
[16, 32, 320, 5120]

Which programs there are depends on shapes, dtypes and static fields, never on values. Arrays that are spread
over devices, or that belong to the caller's own traced program on several devices, are neither cut nor
reshaped: so they stay spread. Inside of a program `softjax.mapping` takes one impact to many.
"""

import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache, lru_cache, partial, reduce
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from softjax.checks import is_traced
from softjax.fields import combine, partition, shared_leaves
from softjax.numerics.derivatives import Shared
from softjax.numerics.roots import SOLVED, elementwise

# impacts in the smallest program: it takes a second to compile and an impact a microsecond
LEAST = 16
FINE = 256  # from here on four sizes an octave, else one
# impacts that are computed sooner than a program that runs faster is compiled: the first 1000 or 4000 by the
# energy balance take 1.8 s in place of 2.4 to 2.8
SOON = 4096
# Measured on two cores at 10^6 impacts: chunks of 2048 to 8192 stay in the cache and are as fast as
# each other; 16 384 and more are slower. One call into compiled code computes a block of chunks.
CHUNK, CHUNKS = 8192, 16
BLOCK = CHUNK * CHUNKS
# in the caller's own program, whose kernels two cores share: 10^6 gradients take 0.10 s, in one piece 0.16
TRACED_CHUNK = 65_536
# Vectors twice as wide as XLA prefers: 10^6 impacts by the energy balance take 28 in place of 39 ms.
WIDE = (("xla_cpu_prefer_vector_width", 512),)
# Code is made an older way, kernel by kernel: two thirds of the time to compile, and for large
# batches of the energy balance twice the time to run. Where few impacts are computed it pays.
# LLVM's first level of optimisation takes another sixth of it off and costs a few percent at most.
QUICK = (("xla_cpu_use_fusion_emitters", False), ("xla_backend_optimization_level", 1))
SOONEST = (QUICK[0], ("xla_backend_optimization_level", 0))  # half that time, for few impacts
KEPT = 32  # compiled functions, those that were used last
# Blocks of a few sizes, where the number of impacts differs from call to call. A block costs what it
# costs, filled or not, and each size is compiled for itself: small ones for all but very many impacts.
# Measured, value and three slopes: 256 impacts take 0.18 ms by the energy balance and 1.4 ms by the
# ODE; in blocks of 8192 0.23 µs an impact, where time steps gain nothing.
SMALL, MEDIUM, LARGE = 256, 2048, 8192
FROM = {LARGE: 32_768, MEDIUM: 8192}  # so many impacts on a size is worth compiling
SOLVED_KEPT = jax.checkpoint_policies.save_only_these_names(SOLVED)


@cache
def accepted(options: tuple[tuple[str, bool | int | str], ...]) -> dict[str, bool | int | str]:
    """Those of the options that the compiler knows: it works without the others, slower.

    Any other error of the compiler is raised, and nothing concluded from it: the next call tries again.
    """
    try:
        jax.jit(lambda x: x + 1, compiler_options=dict(options))(np.zeros(1, np.float32))
    except jax.errors.JaxRuntimeError as error:
        if not str(error).startswith("INVALID_ARGUMENT"):
            raise
        several = options if len(options) > 1 else ()
        return {name: value for option in several for name, value in accepted((option,)).items()}
    return dict(options)


class _Program(NamedTuple):
    """A function of arrays: what it is compiled for."""

    function: Callable
    settings: tuple
    structure: Any
    static: Any  # the leaves of law and route that are no arrays


def _computed(program: _Program, *leaves):
    arrays = jax.tree.unflatten(program.structure, leaves)
    return program.function(*combine(arrays, program.static), *program.settings)


_compiled = jax.jit(_computed, static_argnums=0)


def batched(function: Callable, parameters, velocity, *settings, cut: bool = True):
    """`function(parameters, velocity, *settings)`, compiled, of impacts one by one.

    Args:
        parameters: a pytree whose leaves broadcast against the velocity, shared fields left out
            (`fields.array_field`); leaves that are no arrays are compiled in.
        settings: hashable, compiled in.
        cut: whether large batches are cut: not where the result of an impact has axes of its own,
            and is much more than what goes in.
    """
    arrays, static = partition((parameters, velocity))
    leaves, structure = jax.tree.flatten(arrays)
    program = _Program(function, settings, structure, static)
    shared = shared_leaves(arrays)
    shape = np.broadcast_shapes(
        *(np.shape(x) for x, w in zip(leaves, shared, strict=True) if not w)
    )
    # within the caller's own program whatever is computed is traced, of constants too
    # (`device_put` knows without anything to compile)
    if any(is_traced(leaf) for leaf in leaves) or is_traced(jax.device_put(0.0)):
        return _of_traced(program, *leaves, shared=shared, cut=cut)
    count = math.prod(shape)
    arrays_of_jax = [leaf for leaf in leaves if isinstance(leaf, jax.Array)]
    if not count or any(len(leaf.sharding.device_set) > 1 for leaf in arrays_of_jax):
        return _compiled(program, *leaves)
    home = next((leaf.device for leaf in leaves if getattr(leaf, "committed", False)), None)
    many = [not w and np.size(leaf) > 1 for leaf, w in zip(leaves, shared, strict=True)]
    many[-1] = True  # of velocities there is a row in any case

    def flattened(leaf, many: bool, is_shared: bool):
        if many:
            return np.broadcast_to(np.asarray(leaf), shape).reshape(-1)
        return leaf if is_shared else np.asarray(leaf).reshape(())

    flat = list(map(flattened, leaves, many, shared))
    if cut and count >= 2 * BLOCK and on_cpu(home):
        results = _in_blocks(program, flat, tuple(many), count)
    else:
        size = padded_size(max(count, LEAST))
        padded = [filled(leaf, size) if m else leaf for leaf, m in zip(flat, many, strict=True)]
        compiled = _quick(size <= FINE) if size <= SOON else _compiled
        results = compiled(program, *jax.device_put(padded, home))
        if shape == (size,):
            return results
    return jax.device_put(jax.tree.map(partial(_shaped, shape=shape), results), home)


def padded_size(count: int) -> int:
    """The size of the program for so many impacts: at most a quarter more, or twice a few."""
    octave = 2 ** (count - 1).bit_length()
    step = octave // 8 if octave > FINE else octave
    return -(-count // step) * step


@lru_cache(maxsize=2)
def _quick(few: bool) -> Callable:
    """`_compiled`, compiled sooner to run slower."""
    options = accepted(SOONEST if few else QUICK)
    return jax.jit(_computed, static_argnums=0, compiler_options=options)


def on_cpu(home=None) -> bool:
    device = home or jax.config.jax_default_device or jax.local_devices()[0]
    return getattr(device, "platform", device) == "cpu"


def filled(values: np.ndarray, size: int) -> np.ndarray:
    """The same, filled up to a size by its last row."""
    missing = size - len(values)
    return np.concatenate([values, np.repeat(values[-1:], missing, 0)]) if missing else values


def _shaped(result, shape) -> np.ndarray:
    """Without the padding, in the batch's shape; further axes stay behind it."""
    values = np.asarray(result)[: math.prod(shape)]
    return values.reshape(shape + values.shape[1:])


def _in_blocks(program: _Program, flat: list, many: tuple[bool, ...], count: int):
    """The results of many impacts, block by block on all cores."""
    compiled = _block(program, many, jax.config.jax_enable_x64)
    kinds, structure = jax.tree.flatten(jax.eval_shape(compiled, *_cut(flat, many, 0)))
    results = [np.empty(count, kind.dtype) for kind in kinds]
    with_x64 = jax.config.jax_enable_x64  # which is the calling thread's own

    def compute(start):
        start = min(start, count - BLOCK)  # the last block overlaps, so that all have one size
        with jax.enable_x64(with_x64):
            values = jax.tree.leaves(compiled(*_cut(flat, many, start)))
        for result, value in zip(results, values, strict=True):
            result[start : start + BLOCK] = value

    affinity = getattr(os, "sched_getaffinity", None)  # not on every system
    with ThreadPoolExecutor(len(affinity(0)) if affinity else os.cpu_count() or 1) as pool:
        list(pool.map(compute, range(0, count, BLOCK)))
    return jax.tree.unflatten(structure, results)


def _cut(flat, many, start: int) -> list:
    return [leaf[start : start + BLOCK] if m else leaf for leaf, m in zip(flat, many, strict=True)]


@lru_cache(maxsize=KEPT)
def _block(program: _Program, many: tuple[bool, ...], _x64: bool) -> Callable:
    """The compiled function of a block, which loops over chunks."""

    def block(*leaves):
        return in_chunks(partial(_computed, program), leaves, many, CHUNKS)

    return jax.jit(block, compiler_options=accepted(WIDE))


def in_few_sizes(
    function: Callable, inputs, many: Sequence[bool], *settings, long: bool, by_time: bool
) -> list[np.ndarray]:
    """`function(inputs, *settings)`, compiled, of impacts whose number differs from call to call.

    Args:
        function: of arrays; impacts are the last axis of each array that it gives.
        inputs: a pytree of arrays of the host, with one row an impact where `many` says so.
        settings: hashable, compiled in.
        long: whether an impact takes long, so that compiling for speed pays.
        by_time: whether it takes time steps, which gain nothing in large blocks.
    """
    leaves, structure = jax.tree.flatten(inputs)
    count = next(len(leaf) for leaf, m in zip(leaves, many, strict=True) if m)
    begun: list[tuple[Any, int]] = []
    first = 0
    while first < count:  # large blocks as long as they are filled well, then small ones
        left = count - first
        sizes = {} if by_time else FROM
        size = next((k for k, least in sizes.items() if count >= least and left >= k), SMALL)
        rows = slice(first, first + size)
        pairs = zip(leaves, many, strict=True)
        some = [filled(leaf[rows], size) if m else leaf for leaf, m in pairs]
        compiled = _forpadded_size(function, size, long or by_time, len(settings))
        begun.append((compiled(jax.tree.unflatten(structure, some), *settings), min(size, left)))
        first += size
    # all blocks have begun before the first is waited for
    parts = [[np.asarray(a)[..., :few] for a in block] for block, few in begun]
    return [np.concatenate(a, -1) if len(parts) > 1 else a[0] for a in zip(*parts, strict=True)]


@lru_cache(maxsize=KEPT)
def _forpadded_size(function: Callable, size: int, long: bool, settings: int) -> Callable:
    """The function, compiled the sooner the less there is to compute."""
    options = {SMALL: QUICK if long else SOONEST, MEDIUM: QUICK, LARGE: ()}[size]
    static = tuple(range(1, 1 + settings))
    return jax.jit(function, static_argnums=static, compiler_options=accepted(options))


def _of_traced(program: _Program, *leaves, shared: Shared, cut: bool):
    """Of impacts in the caller's own program: one call for all, or for chunk after chunk."""
    if not any(shared) and _mapped_here(leaves):  # a `vmap` of an impact computes an array of them
        here = partial(_of_traced, program, shared=shared, cut=cut)
        return elementwise(here, here)(*leaves)
    shape = () if any(shared) else np.broadcast_shapes(*map(np.shape, leaves))
    few = math.prod(shape) < 2 * BLOCK
    if few or not cut or on_several_devices() or not on_cpu():
        return _compiled(program, *leaves)
    many = [np.size(leaf) > 1 for leaf in leaves]
    flat = [
        jnp.broadcast_to(x, shape).reshape(-1) if m else jnp.reshape(x, ())
        for x, m in zip(leaves, many, strict=True)
    ]
    # the reverse pass computes a chunk again, but for what was solved: faster than to fetch it all
    of_chunk = jax.checkpoint(partial(_compiled, program), policy=SOLVED_KEPT)
    results = in_chunks(of_chunk, flat, many, -(-math.prod(shape) // TRACED_CHUNK))
    return jax.tree.map(lambda result: result.reshape(shape), results)


def _mapped_here(leaves) -> bool:
    """Whether a `vmap` is the innermost of what the caller transforms: what is computed here has its axis."""
    traced = [leaf for leaf in leaves if is_traced(leaf)]
    if not any(hasattr(leaf, "batch_dim") for leaf in traced) or not all(map(jnp.size, traced)):
        return False
    return hasattr(
        reduce(jnp.add, [x[(0,) * x.ndim] if x.ndim else x for x in traced]), "batch_dim"
    )


def on_several_devices() -> bool:
    """Whether a traced array may be spread: where it lies only the compiled program knows."""
    return jax.device_count() > 1


def in_chunks(function: Callable, leaves: Sequence, many: Sequence[bool], chunks: int):
    """`function(*leaves)`, computed chunk by chunk of those leaves that are `many`, in one program.

    The last chunk is padded. What the function gives may have axes behind the one of impacts.
    """
    if chunks <= 1:
        return function(*leaves)
    each = [leaf for leaf, m in zip(leaves, many, strict=True) if m]
    count = len(each[0])
    # if some number of chunks divides the impacts, nothing has to be copied to pad the last
    chunks = next((k for k in range(chunks, 2 * chunks) if count % k == 0), chunks)
    missing = -count % chunks

    def rows(leaf):
        return jnp.pad(leaf, (0, missing), mode="edge").reshape(chunks, -1)

    def of_chunk(some):
        row = iter(some)
        return function(*(next(row) if m else x for x, m in zip(leaves, many, strict=True)))

    results = jax.lax.map(of_chunk, [rows(leaf) for leaf in each])
    return jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:])[:count], results)
