"""Predicted observables of impacts, with derivatives in the law's leaves: all collisions of a fit.

Impacts are independent of each other, so they go through one compiled function in blocks of one
size. It is compiled once for a type of law, a route, an observable and a set of leaves that move: any number
of impacts, of fits side by side, of data sets and of parameters behind the leaves. Of ε it is ε², signed;
the others are in SI.
"""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

import softjax as sj
from calibration.observables import RESTITUTION, predicted
from softjax.batching import quick_to_compile
from softjax.fields import whole_fields

# A block costs what it costs, filled or not, and each size is compiled for itself: small ones for
# all but very many impacts. Measured, value and three slopes: 256 impacts take 0.18 ms by the energy
# balance and 1.4 ms by the ODE; in blocks of 8192 0.23 µs an impact, where time steps gain nothing.
SMALL = 256
LARGE = 8192
SIZES = {LARGE: 32_768, 2048: 8192}  # of a block: from so many impacts on it is worth compiling

TINY_SQUARED = 1e-6  # below this ε² the root that guides a search is continued by another
BENT_SQUARED = 1e-7  # the same of what a fit is judged by

Route = sj.EnergyBalance | sj.ClosedForm | sj.ODE | None
ROUTES: dict[str, Any] = {route.name: route for route in (sj.ODE, sj.EnergyBalance, sj.ClosedForm)}


class LawShape(NamedTuple):
    """The structure of a law, hashable: what is compiled for."""

    tree: Any  # its structure
    names: tuple[str, ...]  # of its leaves, "contact.radius", "chi"
    whole: tuple[bool, ...]  # which leaves are whole for all impacts
    route: Route  # what suits the law

    @classmethod
    def of(cls, law: sj.ContactLaw) -> "LawShape":
        paths, tree = jax.tree_util.tree_flatten_with_path(law)
        names = tuple(jax.tree_util.keystr(path).lstrip(".") for path, _ in paths)
        held = whole_fields(type(law))
        whole = tuple(getattr(path[0], "name", "") in held for path, _ in paths)
        return cls(tree, names, whole, law.default_route())


class Expansion(NamedTuple):
    """An observable of m impacts around the leaves they have."""

    value: Float[np.ndarray, "m"]  # ε², signed, or another observable in SI, (m,)
    slopes: Float[np.ndarray, "a m"]  # along each moving number of the leaves, (a, m)
    status: Int[np.ndarray, "m"]  # `softjax.Status`, (m,)


def expand(
    shape: LawShape,
    leaves: Sequence[np.ndarray],
    velocity: Float[np.ndarray, "m"],
    moving: tuple[int, ...],
    route: Route,
    elastic: np.ndarray | None = None,
    observable: str = RESTITUTION,
) -> Expansion:
    """Values and slopes, impact by impact.

    Args:
        leaves: of the law; each of one value an impact, (m,), or, where it is whole, an array an
            impact, (m, ...), if it moves, else the array itself.
        moving: positions of the leaves along which slopes are computed; each number of a whole leaf
            has its own.
        elastic: the branch that each impact's ε is held on, None: as the law has it.
        observable: what is predicted, of `calibration.observables`.
    """
    begun, filled = [], []
    route = shape.route if route is None else route  # one name for one program
    for rows, size in _blocks(len(velocity), route):
        some = [
            leaf if shape.whole[k] and k not in moving else _filled(leaf[rows], size)
            for k, leaf in enumerate(leaves)
        ]
        held = None if elastic is None else _filled(elastic[rows], size)
        block = _large_block if size == LARGE else quick_to_compile(_block, (3, 4, 5, 6))
        at = _filled(velocity[rows], size)
        begun.append(block(some, at, held, shape, moving, route, observable))
        filled.append(rows.stop - rows.start)
    # all blocks have begun before the first is waited for
    pairs = zip(begun, filled, strict=True)
    parts = [[np.asarray(a)[..., :count] for a in block] for block, count in pairs]
    if len(parts) == 1:
        return Expansion(*parts[0])
    return Expansion(*(np.concatenate(every, -1) for every in zip(*parts, strict=True)))


def _blocks(count: int, route: Route) -> Iterator[tuple[slice, int]]:
    """Rows and size of each block: large ones as long as they are filled well, then small ones."""
    sizes = {} if isinstance(route, sj.ODE) else SIZES
    first = 0
    while first < count:
        filled = (s for s, least in sizes.items() if count >= least and count - first >= s)
        size = next(filled, SMALL)
        yield slice(first, min(first + size, count)), size
        first += size


def _filled(values: np.ndarray, size: int) -> np.ndarray:
    """The block, padded to its size with its last row."""
    missing = size - len(values)
    return np.concatenate([values, np.repeat(values[-1:], missing, 0)]) if missing else values


def _block(
    leaves,
    velocity,
    elastic,
    shape: LawShape,
    moving: tuple[int, ...],
    route: Route,
    observable: str,
):
    """Values, slopes and statuses of one block, by one forward pass."""
    each = [k for k in range(len(leaves)) if not shape.whole[k] or k in moving]

    def collide(some, velocity, elastic):
        every = list(leaves)
        for k, values in zip(each, some, strict=True):
            every[k] = values
        law = jax.tree.unflatten(shape.tree, every)
        if observable != RESTITUTION:
            hit = sj.restitution(law, velocity, route)
            return predicted(observable, hit), hit.status
        return tuple(sj.signed_restitution(law, velocity, route, elastic=elastic))

    if any(shape.whole[k] for k in moving):  # each impact has a network of its own
        axes = (0, 0, None if elastic is None else 0)
        collide_all = jax.vmap(collide, in_axes=axes)
    else:
        collide_all = collide
    places = [each.index(k) for k in moving]

    def of_moving(*some):
        every = [leaves[k] for k in each]
        for place, values in zip(places, some, strict=True):
            every[place] = values
        return collide_all(every, velocity, elastic)

    chosen = [leaves[k] for k in moving]
    if not chosen:
        value, status = of_moving()
        return value, jnp.zeros((0, len(velocity))), status

    def along(seed):
        tangents = [jnp.broadcast_to(s, x.shape) for s, x in zip(seed, chosen, strict=True)]
        return jax.jvp(lambda *some: of_moving(*some), chosen, tangents, has_aux=True)

    return jax.vmap(along, out_axes=(None, 0, None))(_seeds(chosen))


_large_block = jax.jit(_block, static_argnums=(3, 4, 5, 6))


def _seeds(chosen):
    """One direction for each number of the moving leaves, as a leading axis of each leaf's shape."""
    sizes = [int(np.prod(leaf.shape[1:], dtype=int)) for leaf in chosen]
    eye = np.eye(sum(sizes))
    ends = np.cumsum(sizes)[:-1]
    parts = zip(np.split(eye, ends, axis=1), chosen, strict=True)
    return [part.reshape(len(eye), *leaf.shape[1:])[:, None] for part, leaf in parts]


def extended_root(squared: np.ndarray) -> np.ndarray:
    """√(ε²), continued with a slope to where nothing rebounds, so that a search finds its way back.

    For ε² < s = 1e-6 it is 2√s - √(2s - ε²). It guides a search; what a fit is judged by is `root`.
    """
    s = TINY_SQUARED
    inside = squared > s
    root = np.sqrt(np.where(inside, squared, s))
    return np.where(inside, root, 2 * s**0.5 - np.sqrt(2 * s - np.where(inside, s, squared)))


def extended_root_slope(squared: np.ndarray) -> np.ndarray:
    """Its derivative."""
    s = TINY_SQUARED
    return 0.5 / np.sqrt(np.where(squared > s, squared, 2 * s - np.minimum(squared, s)))


def root(squared: Any, xp: Any = np) -> Any:
    """The law's own ε: √(ε²), and 0 where nothing rebounds.

    Between ε² = -s and s = 1e-7 it is bent smoothly from the one to the other, √s (2u² - u³) with
    u = (ε² + s)/2s, at most 1.2e-4 off: a fit may well end where an impact just stops to rebound.
    """
    s = BENT_SQUARED
    u = xp.clip((squared + s) / (2 * s), 0.0, 1.0)
    plain = xp.sqrt(xp.where(squared > s, squared, s))
    return xp.where(squared > s, plain, s**0.5 * (2 - u) * u**2)


def root_slope(squared: np.ndarray) -> np.ndarray:
    """Its derivative."""
    s = BENT_SQUARED
    u = np.clip((squared + s) / (2 * s), 0.0, 1.0)
    return np.where(
        squared > s, 0.5 / np.sqrt(np.maximum(squared, s)), (4 - 3 * u) * u / (2 * s**0.5)
    )
