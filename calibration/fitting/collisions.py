"""Laws of all points from the parameters, and what their impacts are predicted to show.

Points with the same contact and the same parameters have one law: a row. Usually a data set is one
row; where its contact differs from impact to impact each point is one.

Impacts are independent of each other, so they go through one compiled function in blocks of one
size. It is compiled once for a type of law, a route, an observable and a set of leaves that move: any
number of impacts, of fits side by side, of data sets and of parameters behind the leaves.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

import softjax as sj
from calibration.errors import DataError
from calibration.fitting.laws import CONTACT_LEAVES, OF_CONTACT, LawModel
from calibration.observables import OBSERVABLES, RESTITUTION, predicted
from softjax.compiling import filled, in_few_sizes
from softjax.fields import shared_fields

PROBES = 3  # places at which it is looked which leaves move
FEW_ROWS = 128  # that are built at once

TINY_SQUARED = 1e-6  # below this ε² the root that guides a search is continued by another
BENT_SQUARED = 1e-7  # the same of what a fit is judged by

Route = sj.AbstractRoute | None
# one data set: how many points it has, its contact, and of each local parameter, by name, which
# element of the fit it is (-1: fixed), and at what it is fixed, one number or one a point
SetOfRows = tuple[int, sj.Contact | None, Mapping[str, tuple[int, Any]]]


class LawShape(NamedTuple):
    """The structure of a law, hashable: what is compiled for."""

    tree: Any
    names: tuple[str, ...]  # of its leaves, "contact.radius", "chi"
    shared: tuple[bool, ...]  # which leaves all impacts share
    route: sj.AbstractRoute  # what suits the law

    @classmethod
    def of(cls, law: sj.ContactLaw) -> "LawShape":
        paths, tree = jax.tree_util.tree_flatten_with_path(law)
        names = tuple(jax.tree_util.keystr(path).lstrip(".") for path, _ in paths)
        fields = shared_fields(type(law))
        shared = tuple(getattr(path[0], "name", "") in fields for path, _ in paths)
        return cls(tree, names, shared, law.default_route())

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle by a law of this structure: in a copy of the structure itself Equinox does not know its own marks."""
        law = jax.tree.unflatten(self.tree, [0.0] * len(self.names))
        return _shape, (law, *self[1:])


def _shape(law: sj.ContactLaw, *others: Any) -> LawShape:
    return LawShape(jax.tree.structure(law), *others)


@dataclass(frozen=True)
class Laws:
    """The laws of a problem's rows, each of q local parameters."""

    model: LawModel
    contact: Mapping[str, np.ndarray] | None  # leaves of the contacts by name, each (rows,)
    area: str
    names: tuple[str, ...]  # of the local parameters, those of the contact among them
    element: Int[np.ndarray, "q rows"]  # which element of the fit each is, -1 where it is fixed
    fixed: Float[np.ndarray, "q rows"]  # at what
    row: Int[np.ndarray, " points"]  # of each point
    shape: Any = None  # see `bind`
    sizes: tuple[int, ...] = ()  # how many numbers each leaf of a law has
    free: tuple[int, ...] = ()  # which local parameters are differentiated
    moving: tuple[int, ...] = ()  # which leaves of the law move with them
    direct: bool = False  # whether the leaves are the parameters themselves, not to be built

    @classmethod
    def of(cls, model: LawModel, sets: Sequence[SetOfRows]) -> "Laws":
        """One row for a data set, or one for each point if contact or parameters differ in it.

        Without contacts where a set has none: a law that can do without is the same with one.

        Raises:
            ValueError: for contacts of different areas.
        """
        contacts = [contact for _, contact, _ in sets if contact is not None]
        takes = model.takes_contact and len(contacts) == len(sets)
        names = tuple(sets[0][2])
        element, fixed, leaves, row, first = [], [], [], [], 0
        for k, (points, _, local) in enumerate(sets):
            which, values = zip(*(local[n] for n in names), strict=True) if names else ((), ())
            of_contact = [contacts[k].leaves()[name] for name in CONTACT_LEAVES] if takes else []
            count = points if any(np.ndim(value) for value in [*values, *of_contact]) else 1
            for stack, some in ((element, which), (fixed, values), (leaves, of_contact)):
                rows = [np.broadcast_to(np.asarray(value, float), count) for value in some]
                stack.append(np.array(rows).reshape(len(some), count))
            row.append(first + (np.arange(count) if count > 1 else np.zeros(points, int)))
            first += count
        elements, numbers, of_contacts = (np.hstack(parts) for parts in (element, fixed, leaves))
        contact = dict(zip(CONTACT_LEAVES, of_contacts, strict=True)) if takes else None
        areas = sorted({contact.area for contact in contacts})
        if len(areas) > 1:
            raise DataError("area", areas, "the same for contacts that share a parameter")
        area = areas[0] if areas else "zhou"
        return cls(model, contact, area, names, elements.astype(int), numbers, np.concatenate(row))

    @property
    def size(self) -> int:
        """How many rows there are."""
        return self.element.shape[1]

    def law(self, theta: Any, rows: Any, xp: Any = np) -> sj.ContactLaw:
        """The law of one row, of single numbers, or of several, of arrays; of NumPy or JAX."""
        values: dict[str, Any] = {}
        for name, element, fixed in zip(self.names, self.element, self.fixed, strict=True):
            at = np.ravel(rows)[0] if "[" in name else rows  # all rows share a network
            place, values[name] = element[at], fixed[at]
            if np.any(place >= 0):
                values[name] = xp.where(place >= 0, theta[place], fixed[at])
        contact = None
        if self.contact is not None:
            leaves = {name: leaf[rows] for name, leaf in self.contact.items()}
            contact = sj.Contact(**leaves, area=self.area)
        if xp is np:
            values = self.model.inside({name: float(value) for name, value in values.items()})
        return self.model.law(contact, values)

    def of_points(self, theta: Any, points: Any) -> sj.ContactLaw:
        """The law of some points in JAX, of single numbers where they have one row."""
        rows = self.row[points]
        return self.law(theta, rows[0] if np.all(rows == rows[0]) else rows, jnp)

    def bind(self, theta: Float[np.ndarray, " p"], active: Sequence[int] | np.ndarray) -> "Laws":
        """Add the structure of the laws, and which of their leaves move with active elements."""
        law = self.law(theta, 0)
        shape, leaves = LawShape.of(law), jax.tree.leaves(law)
        free = np.flatnonzero(np.any(np.isin(self.element, list(active)), axis=1)).tolist()
        sizes, direct = tuple(map(int, map(np.size, leaves))), self.model.direct
        if direct and not self.model.trees:
            moving = [shape.names.index(self.names[k]) for k in free]
            return replace(
                self, shape=shape, sizes=sizes, free=tuple(free), moving=tuple(moving), direct=True
            )
        every = tuple(range(len(sizes))) if free else ()
        laws = replace(self, shape=shape, sizes=sizes, free=tuple(free), moving=every)
        if not free:
            return laws
        random = np.random.default_rng(0)
        near = np.asarray(theta) * (1 + 0.1 * random.random((PROBES, len(theta))))
        slopes = laws.leaves(near)[1]
        assert slopes is not None
        acts = np.split(np.any(slopes != 0, axis=(0, 1, 3)), np.cumsum(sizes)[:-1])
        return replace(laws, moving=tuple(k for k, part in enumerate(acts) if np.any(part)))

    def leaves(self, theta: Float[np.ndarray, "fits p"], contact=None, fixed=None):
        """Leaves of the laws, a list of (fits, rows, ...), and their slopes in the free local parameters.

        These are of the moving numbers, (fits, rows, a, free); None where a moving leaf is a parameter.

        Args:
            contact, fixed: leaves of the contacts, (fits, rows) each, and what is fixed, (fits, q, rows),
                where fits differ in them.
        """
        padded = np.concatenate([theta, np.zeros((len(theta), 1))], axis=1)
        at_element = np.moveaxis(padded[:, self.element], 1, 0)
        fixed = self.fixed[:, None] if fixed is None else np.moveaxis(fixed, 1, 0)
        local = np.where(self.element[:, None] >= 0, at_element, fixed)
        fits, count = local.shape[1:]
        contact = contact or self.contact or {}
        if self.direct:
            size = local.shape[1:]
            inputs = {OF_CONTACT + n: np.broadcast_to(x, size) for n, x in contact.items()}
            inputs |= dict(zip(self.names, local, strict=True))
            return [inputs[name] for name in self.shape.names], None
        flat = {name: _padded(np.ravel(x)) for name, x in zip(self.names, local, strict=True)}
        every = {name: np.broadcast_to(leaf, (fits, count)) for name, leaf in contact.items()}
        tiled = {name: _padded(leaf.ravel()) for name, leaf in every.items()}
        free = tuple(self.names[k] for k in self.free)
        values, slopes = _build(tiled or None, flat, self.model, self.area, free)
        apart = lambda a: np.asarray(a)[: fits * count].reshape(fits, count, *a.shape[1:])  # noqa: E731
        leaves = [apart(leaf) for leaf in values]
        if not self.moving:
            return leaves, None
        parts = [apart(slopes[k]) for k in self.moving]
        joined = [part.reshape(fits, count, -1, part.shape[-1]) for part in parts]
        return leaves, np.concatenate(joined, axis=2)


def _padded(values: np.ndarray) -> np.ndarray:
    """Filled up to a power of eight rows by the last, so that few sizes are compiled."""
    size = FEW_ROWS
    while size < len(values):
        size *= 8
    return filled(values, size)


@partial(jax.jit, static_argnames=("model", "area", "free"))
def _build(contact, values, model: LawModel, area: str, free):
    """The leaves of the laws of many rows, and their slopes in the free local parameters."""

    def leaves_of(some, contact, values):
        pair = None if contact is None else sj.Contact(**contact, area=area)
        law = model.law(pair, values | some)
        return [jnp.asarray(leaf, float) for leaf in jax.tree.leaves(law)]

    def at_row(contact, values):
        some = {name: values[name] for name in free}
        if not free:
            return leaves_of(some, contact, values), []
        slopes = jax.jacfwd(leaves_of)(some, contact, values)
        stacked = [jnp.stack([leaf[name] for name in free], -1) for leaf in slopes]
        return leaves_of(some, contact, values), stacked

    return jax.vmap(at_row)(contact, values)


def expand(
    shape: LawShape,
    leaves: Sequence[np.ndarray],
    velocity: Float[np.ndarray, " m"],
    moving: tuple[int, ...],
    route: Route,
    observable: str = RESTITUTION,
) -> list[np.ndarray]:
    """Predictions of m impacts, their slopes along each moving number of the leaves (a, m), and the status.

    Of ε it is ε², signed; of other observables they are in SI.

    Args:
        leaves: of the law; each of one value an impact, (m,), or, where it is shared, an array an
            impact, (m, ...), if it moves, else the array itself.
        moving: positions of the leaves along which slopes are computed; each number of a shared leaf
            has its own.
        observable: what is predicted, of `calibration.observables`.
    """
    route = shape.route if route is None else route  # one name for one program
    single = [shape.shared[k] and k not in moving for k in range(len(leaves))]
    many = [*(not one for one in single), True]
    inputs, settings = (list(leaves), velocity), (shape, moving, route, observable)
    long, by_time = any(shape.shared[k] for k in moving), route.by_time
    return in_few_sizes(_block, inputs, many, *settings, long=long, by_time=by_time)


def _block(inputs, shape: LawShape, moving, route: Route, observable: str):
    """Values, slopes and statuses of one block, by one forward pass."""
    leaves, velocity = inputs
    each = [k for k in range(len(leaves)) if not shape.shared[k] or k in moving]

    def collide(some, velocity):
        inputs = list(leaves)
        for k, values in zip(each, some, strict=True):
            inputs[k] = values
        law = jax.tree.unflatten(shape.tree, inputs)
        if not OBSERVABLES[observable].is_signed_square:
            hit = sj.restitution(law, velocity, route)
            return predicted(observable, hit), hit.status
        return tuple(sj.signed_restitution(law, velocity, route))

    each_has_a_network = any(shape.shared[k] for k in moving)
    collide_all = jax.vmap(collide) if each_has_a_network else collide
    places = [each.index(k) for k in moving]

    def of_moving(*some):
        inputs = [leaves[k] for k in each]
        for place, values in zip(places, some, strict=True):
            inputs[place] = values
        return collide_all(inputs, velocity)

    chosen = [leaves[k] for k in moving]
    if not chosen:
        value, status = of_moving()
        return value, jnp.zeros((0, len(velocity))), status

    def along(seed):
        tangents = [jnp.broadcast_to(s, x.shape) for s, x in zip(seed, chosen, strict=True)]
        return jax.jvp(lambda *some: of_moving(*some), chosen, tangents, has_aux=True)

    return jax.vmap(along, out_axes=(None, 0, None))(_seeds(chosen))


def _seeds(chosen):
    """One direction for each number of the moving leaves, as a leading axis of each leaf's shape."""
    sizes = [int(np.prod(leaf.shape[1:], dtype=int)) for leaf in chosen]
    eye = np.eye(sum(sizes))
    ends = np.cumsum(sizes)[:-1]
    parts = zip(np.split(eye, ends, axis=1), chosen, strict=True)
    return [part.reshape(len(eye), *leaf.shape[1:])[:, None] for part, leaf in parts]


def extended_root(squared: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """√(ε²), continued with a slope to where nothing rebounds, and that slope: what guides a search.

    For ε² < s = 1e-6 it is 2√s - √(2s - ε²).
    """
    s = TINY_SQUARED
    inside = squared > s
    root = np.sqrt(np.where(inside, squared, 2 * s - np.minimum(squared, s)))
    return np.where(inside, root, 2 * s**0.5 - root), 0.5 / root


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
    """Derivative of `root`."""
    s = BENT_SQUARED
    u = np.clip((squared + s) / (2 * s), 0.0, 1.0)
    plain = 0.5 / np.sqrt(np.maximum(squared, s))
    return np.where(squared > s, plain, (4 - 3 * u) * u / (2 * s**0.5))
