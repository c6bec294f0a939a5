"""Arrays that their owner has spread over devices, of this process or of several.

Where it is known how they lie (of arrays themselves, and of traced ones whose type tells it), each
device loops over its own impacts by itself and nothing moves between them. Elsewhere the compiler
follows the shares that it meets (`_rows`).
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import AxisType, NamedSharding, PartitionSpec

from softjax._checks import is_traced
from softjax._rows import across_devices


class Layout(NamedTuple):
    """How a batch lies: for each of its axes the axes of the mesh that share it, or None."""

    mesh: Any
    axes: tuple

    def of(self, leaf) -> PartitionSpec:
        """The same for an array that broadcasts against the batch."""
        shape = np.shape(leaf)
        last = self.axes[len(self.axes) - len(shape) :]
        return PartitionSpec(*(a if n > 1 else None for n, a in zip(shape, last, strict=True)))


def is_spread(leaf) -> bool:
    return isinstance(leaf, jax.Array) and not is_traced(leaf) and len(leaf.sharding.device_set) > 1


def layout(leaves: Sequence, shape: tuple[int, ...]) -> Layout | None:
    """How the arrays among `leaves` lie that are spread, all of them alike; None where unknown."""
    spread = [leaf for leaf in leaves if is_spread(leaf) or _is_typed(leaf)]
    known = [one for one in map(_sharding, spread) if one is not None]
    meshes = {one.mesh for one in known}
    if len(meshes) != 1 or len(known) < len(spread):
        return None
    axes: list = [None] * len(shape)
    for one, leaf in zip(known, spread, strict=True):
        for k, axis in enumerate(one.spec, start=len(shape) - np.ndim(leaf)):
            if axis is not None and axes[k] not in (None, axis):
                return None
            axes[k] = axes[k] if axis is None else axis
    used = [name for axis in axes if axis is not None for name in _names(axis)]
    return Layout(meshes.pop(), tuple(axes)) if len(set(used)) == len(used) else None


def by_device(f: Callable, leaves: Sequence, whole: Sequence[bool], where: Layout):
    """`f(*leaves)`, of arrays over impacts, on each device for what lies there."""
    none = PartitionSpec()
    return jax.shard_map(
        f,
        mesh=where.mesh,
        in_specs=tuple(none if h else where.of(x) for x, h in zip(leaves, whole, strict=True)),
        out_specs=PartitionSpec(*where.axes),
        check_vma=False,
    )(*leaves)


def shard_by_shard(f: Callable, leaves: Sequence, whole: Sequence[bool], where: Layout, shape):
    """`f(*leaves)`, of arrays over impacts, called for each part that this process holds.

    None where some array lies otherwise than the batch.
    """
    each = NamedSharding(where.mesh, PartitionSpec(*where.axes))
    places = each.addressable_devices_indices_map(shape)
    parts = [
        dict.fromkeys(places, leaf) if held else _parts(leaf, where, places)
        for leaf, held in zip(leaves, whole, strict=True)
    ]
    if None in parts:
        return None
    found = [jax.device_put(f(*(part[d] for part in parts if part)), d) for d in places]

    def joined(*results):
        return jax.make_array_from_single_device_arrays(shape, each, results)

    return jax.tree.map(joined, *found)


def _parts(leaf, where: Layout, places) -> dict | None:
    """The part of each device, as NumPy sees it."""
    if isinstance(leaf, jax.Array):
        alike = NamedSharding(where.mesh, where.of(leaf))
        if not leaf.sharding.is_equivalent_to(alike, leaf.ndim):
            return None
        return {shard.device: np.asarray(shard.data) for shard in leaf.addressable_shards}
    array = np.asarray(leaf)

    def part(place):
        last = place[len(place) - array.ndim :]
        return array[
            tuple(p if n > 1 else slice(None) for p, n in zip(last, array.shape, strict=True))
        ]

    return {device: part(place) for device, place in places.items()}


def alike(leaf, like):
    """A traced array that lies as another does, of which every device has what it needs."""
    if not is_traced(like) or np.shape(leaf) != np.shape(like):
        return leaf
    if _is_typed(like):
        return jax.sharding.reshard(leaf, jax.typeof(like).sharding)
    if not across_devices():
        return leaf
    # arrays that meet in one operation are laid alike; what is hidden keeps that from being left out
    same, hidden = jax.lax.optimization_barrier((like == like, leaf))
    return jnp.where(same, leaf, hidden)


def _sharding(leaf) -> NamedSharding | None:
    sharding = jax.typeof(leaf).sharding if is_traced(leaf) else leaf.sharding
    return sharding if isinstance(sharding, NamedSharding) else None


def _is_typed(leaf) -> bool:
    """Whether a traced array's type tells how it lies."""
    kinds = getattr(jax.typeof(leaf).sharding.mesh, "axis_types", ()) if is_traced(leaf) else ()
    return AxisType.Explicit in kinds


def _names(axis) -> tuple:
    return axis if isinstance(axis, tuple) else (axis,)
