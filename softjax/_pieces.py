"""A function of many concrete impacts, piece by piece on all cores and devices.

A piece is one call into compiled code, which loops over chunks. What a call reads and writes is
memory that the call before it has used: fresh memory costs as much as a third of the arithmetic.
"""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import jax
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from softjax.compiler import accepted

# Measured on two cores at 10^6 impacts: chunks of 2048 to 8192 stay in the cache and are as fast
# as each other; 16 384 and more are slower.
CHUNK = 8192
CHUNKS = 16
PIECE = CHUNK * CHUNKS
# Two threads, a piece each, take 17 to 20 ns an impact by the energy balance where one takes 27, and
# 143 by the ODE where one takes 279; all impacts in one program of the caller's 31 and 470.
# One thread works on a piece, so no kernel of it need be shared out among threads, which costs
# half as much again; vectors twice as wide as XLA prefers take 0.8 of the time.
FOR_ONE_THREAD = (
    ("xla_cpu_prefer_vector_width", 512),
    ("xla_disable_hlo_passes", "cpu-parallel-task-assigner"),
)


def in_pieces(of_chunk: Callable, key, flat: list, many: list[bool], count: int):
    """`of_chunk(*flat)` as NumPy arrays, of `count` impacts.

    Args:
        key: tells one function from another: what is compiled is kept.
        flat: arrays of impacts where `many` is true, else what is the same for all.
    """
    program = _program(of_chunk, key, flat, many)
    results = [_aligned(count, kind.dtype) for kind in program.kinds]
    starts = iter(range(0, count, program.size))
    each = [leaf for leaf, m in zip(flat, many, strict=True) if m]
    single = jax.device_put([leaf for leaf, m in zip(flat, many, strict=True) if not m])

    with_x64 = jax.config.jax_enable_x64  # which is the calling thread's own

    def some(_):
        with jax.enable_x64(with_x64):
            work()

    def work():
        try:
            space = program.spare.pop()
        except IndexError:
            space = program.space(each)
        for start in starts:
            stop = min(start + program.size, count)
            # the last piece is filled up by the impacts before it, so that all have one shape
            start = max(stop - program.size, 0)
            values = program.run(space, each, single, start)
            for result, value in zip(results, values, strict=True):
                result[start:stop] = value
        program.spare.append(space)

    with ThreadPoolExecutor(program.threads) as pool:
        list(pool.map(some, range(program.threads)))
    return jax.tree.unflatten(program.structure, results)


def _cores() -> int:
    affinity = getattr(os, "sched_getaffinity", None)  # not on every system
    return len(affinity(0)) if affinity else os.cpu_count() or 1


def _aligned(count, dtype) -> np.ndarray:
    """An empty array that JAX takes over as it is: its data must begin at a cache line."""
    line = 64
    memory = np.empty(count * dtype.itemsize + line, np.uint8)
    first = -memory.ctypes.data % line
    return memory[first : first + count * dtype.itemsize].view(dtype)


class _Space(NamedTuple):
    """The memory of a thread: of a piece's impacts, and of its results."""

    impacts: list[np.ndarray]
    results: list[jax.Array]


class _Program(NamedTuple):
    compiled: Callable
    size: int  # impacts in a piece, over all devices
    kinds: list
    structure: Any
    sharding: Any
    threads: int
    spare: list[_Space]

    def space(self, each) -> _Space:
        impacts = [_aligned(self.size, leaf.dtype) for leaf in each]
        results = [np.empty(self.size, kind.dtype) for kind in self.kinds]
        return _Space(impacts, jax.device_put(results, self.sharding))

    def run(self, space: _Space, each, single, start):
        """Results of a piece, which are valid until the next one."""
        for here, leaf in zip(space.impacts, each, strict=True):
            here[:] = leaf[start : start + self.size]
        impacts = jax.device_put(space.impacts, self.sharding)
        space.results[:] = jax.block_until_ready(self.compiled(space.results, impacts, single))
        return space.results


KEPT = 8  # programs, each with the memory that its threads have used: some 6 MiB a thread
_programs: dict = {}


def _program(of_chunk, key, flat, many) -> _Program:
    """The compiled loop over the chunks of a piece, one for each function and static settings.

    Kept are those that were used last.
    """
    devices = jax.local_devices()
    kinds = tuple((leaf.dtype, m or np.shape(leaf)) for leaf, m in zip(flat, many, strict=True))
    key = (key, kinds, len(devices), jax.config.jax_enable_x64)
    program = _programs.pop(key, None) or _compile(of_chunk, flat, many, devices)
    _programs[key] = program
    for oldest in list(_programs)[:-KEPT]:
        _programs.pop(oldest, None)
    return program


def _compile(of_chunk, flat, many, devices) -> _Program:
    each, all_same = PartitionSpec("impacts"), PartitionSpec()
    mesh = Mesh(np.array(devices), ("impacts",))

    def of_piece(results, impacts, single):
        return _over_chunks(of_chunk, results, impacts, single, many)

    if len(devices) > 1:
        of_piece = jax.shard_map(
            of_piece,
            mesh=mesh,
            in_specs=(each, each, all_same),
            out_specs=each,
            check_vma=False,
        )
    on_cpu = devices[0].platform == "cpu"
    one = [leaf[:1] if m else leaf for leaf, m in zip(flat, many, strict=True)]
    kinds, structure = jax.tree.flatten(jax.eval_shape(of_chunk, *one))
    return _Program(
        compiled=jax.jit(
            of_piece, donate_argnums=0, compiler_options=accepted(FOR_ONE_THREAD) if on_cpu else {}
        ),
        size=PIECE * len(devices),
        kinds=kinds,
        structure=structure,
        sharding=NamedSharding(mesh, each) if len(devices) > 1 else None,
        # one device's work is single-threaded where it loops, and several calls run at once
        threads=_cores() if on_cpu and len(devices) == 1 else 1,
        spare=[],
    )


def _over_chunks(of_chunk, results, impacts, single, many):
    """Results of a chunk after the other, in place."""

    def one(k, results):
        start = (k * CHUNK,)
        rows = iter([jax.lax.dynamic_slice(leaf, start, (CHUNK,)) for leaf in impacts])
        same = iter(single)
        values = jax.tree.leaves(of_chunk(*(next(rows) if m else next(same) for m in many)))
        put = jax.lax.dynamic_update_slice
        return [put(all_, some, start) for all_, some in zip(results, values, strict=True)]

    return jax.lax.fori_loop(0, CHUNKS, one, list(results))
