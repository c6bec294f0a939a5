"""Laws of all points from the parameters, and derivatives of the laws' leaves.

Points with the same contact and the same parameters have one law: a row. Usually a data set is one
row; where its contact differs from impact to impact each point is one. A row's parameters are
*local*: which element of the fit each of them is, or at what it is held, is the row's affair.
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
from calibration.fitting.collisions import LawShape
from calibration.fitting.laws import CONTACT_LEAVES, OF_CONTACT, LawModel, built

PROBES = 3  # places at which it is looked which leaves move
FEW_ROWS = 128  # that are built at once


class SetRows(NamedTuple):
    """Parts of the rows of one data set."""

    points: int  # how many it has
    contact: sj.Contact | None  # of its bodies; None without
    # of each local parameter, by name, which element of the fit it is (-1: held), and at what it
    # is held, one number or one a point
    local: Mapping[str, tuple[int, Any]]


@dataclass(frozen=True)
class Rows:
    """The laws of one problem's rows."""

    model: LawModel  # what builds a law
    # leaves of the contact by name, each (rows,); None without
    contact: Mapping[str, np.ndarray] | None
    area: str  # of all contacts
    names: tuple[str, ...]  # the local parameters, those of the contact among them; q of them
    # which element of the fit each is, (q, rows), -1 where it is held
    element: Int[np.ndarray, "q rows"]
    held: Float[np.ndarray, "q rows"]  # at what, (q, rows)
    row: Int[np.ndarray, "points"]  # of each point, (points,)

    @classmethod
    def of(cls, model: LawModel, sets: Sequence[SetRows]) -> "Rows":
        """Rows of some data sets: one for a set, or one for each point if contact or parameters differ in it.

        Without contacts where a set has none: a law that can do without is the same with one.

        Raises:
            ValueError: for contacts of different areas.
        """
        contacts = [one.contact for one in sets if one.contact is not None]
        takes = model.takes_contact and len(contacts) == len(sets)
        names = tuple(sets[0].local)
        element, held, leaves, row, first = [], [], [], [], 0
        for k, one in enumerate(sets):
            which = [one.local[name][0] for name in names]
            values = [one.local[name][1] for name in names]
            own = [contacts[k].leaves()[name] for name in CONTACT_LEAVES] if takes else []
            count = one.points if any(np.ndim(value) for value in [*values, *own]) else 1
            element.append(_spread(which, count))
            held.append(_spread(values, count))
            leaves.append(_spread(own, count))
            row.append(first + (np.arange(count) if count > 1 else np.zeros(one.points, int)))
            first += count
        elements, numbers, of_contacts = (np.hstack(parts) for parts in (element, held, leaves))
        contact = dict(zip(CONTACT_LEAVES, of_contacts, strict=True)) if takes else None
        areas = sorted({one.area for one in contacts})
        if len(areas) > 1:
            raise DataError("area", areas, "the same for contacts that share a parameter")
        area = areas[0] if areas else "zhou"
        return cls(model, contact, area, names, elements.astype(int), numbers, np.concatenate(row))

    @property
    def size(self) -> int:
        return self.element.shape[1]

    def local(self, theta: Float[np.ndarray, "fits p"]) -> Float[np.ndarray, "q fits rows"]:
        """The local parameters of each fit and row."""
        padded = np.concatenate([theta, np.zeros((len(theta), 1))], axis=1)
        found = np.moveaxis(padded[:, self.element], 1, 0)
        return np.where(self.element[:, None] >= 0, found, self.held[:, None])

    def law(self, theta: Any, rows: Any, xp: Any = np) -> sj.ContactLaw:
        """The law of one row, of single numbers, or of several, of arrays; of NumPy or JAX."""
        values: dict[str, Any] = {}
        for name, element, held in zip(self.names, self.element, self.held, strict=True):
            at = np.ravel(rows)[0] if "[" in name else rows  # networks are whole for all rows
            place, values[name] = element[at], held[at]
            if np.any(place >= 0):
                values[name] = xp.where(place >= 0, theta[place], held[at])
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

    def bind(self, theta: Float[np.ndarray, "p"], active: Sequence[int] | np.ndarray) -> "Laws":
        """The structure of the laws, and which of their leaves move with the active elements."""
        law = self.law(theta, 0)
        shape = LawShape.of(law)
        sizes = tuple(int(np.size(leaf)) for leaf in jax.tree.leaves(law))
        searched = np.any(np.isin(self.element, list(active)), axis=1)
        free = tuple(int(k) for k in np.flatnonzero(searched))
        if self.model.direct and not self.model.trees:
            moving = tuple(shape.names.index(self.names[k]) for k in free)
            return Laws(self, shape, sizes, free, moving, False)
        if not free:
            return Laws(self, shape, sizes, free, (), True)
        return Laws(self, shape, sizes, free, tuple(range(len(sizes))), True).trimmed(theta)


def _spread(values: Sequence[Any], count: int) -> Float[np.ndarray, "q count"]:
    """Each as often as there are rows."""
    rows = [np.broadcast_to(np.asarray(value, float), count) for value in values]
    return np.array(rows).reshape(len(values), count)


class Leaves(NamedTuple):
    """The laws' leaves for some fits, and their slopes in the local parameters."""

    values: list[np.ndarray]  # a leaf each, (fits, rows, ...)
    # of the moving numbers, (fits, rows, a, free); None where a moving leaf is a parameter
    slopes: Float[np.ndarray, "fits rows a free"] | None


@dataclass(frozen=True)
class Laws:
    """Rows with the structure of their laws."""

    rows: Rows
    shape: LawShape  # the structure, and how many numbers each leaf has
    sizes: tuple[int, ...]
    free: tuple[int, ...]  # which local parameters are differentiated
    moving: tuple[int, ...]  # which leaves of the law move with them
    built: bool  # whether leaves have to be built, or are the parameters themselves

    def leaves(self, theta: Float[np.ndarray, "fits p"]) -> Leaves:
        """Leaves of each fit and row."""
        local = self.rows.local(theta)
        return self._built(local) if self.built else Leaves(self._direct(local), None)

    def trimmed(self, theta) -> "Laws":
        """Rows without the leaves that do not change with any parameter."""
        random = np.random.default_rng(0)
        near = np.asarray(theta) * (1 + 0.1 * random.random((PROBES, len(theta))))
        slopes = self.leaves(near).slopes
        assert slopes is not None
        acts = np.split(np.any(slopes != 0, axis=(0, 1, 3)), np.cumsum(self.sizes)[:-1])
        return replace(self, moving=tuple(k for k, part in enumerate(acts) if np.any(part)))

    def _direct(self, local) -> list[np.ndarray]:
        rows = self.rows
        where = {name: k for k, name in enumerate(rows.names)}
        values = []
        for name in self.shape.names:
            if name in where:
                values.append(local[where[name]])
            else:
                leaf = rows.contact[name.removeprefix(OF_CONTACT)]  # type: ignore[index]
                values.append(np.broadcast_to(leaf, local.shape[1:]))
        return values

    def _built(self, local) -> Leaves:
        rows = self.rows
        fits, count = local.shape[1:]
        flat = {name: np.ravel(values) for name, values in zip(rows.names, local, strict=True)}
        contact = None
        if rows.contact is not None:
            tiled = {name: np.tile(leaf, fits) for name, leaf in rows.contact.items()}
            contact = {name: _padded(values) for name, values in tiled.items()}
        values, slopes = _build(
            contact,
            {name: _padded(values) for name, values in flat.items()},
            rows.model.build,
            rows.model.takes_contact,
            rows.area,
            tuple(rows.names[k] for k in self.free),
            rows.model.trees,
        )
        apart = lambda a: np.asarray(a)[: fits * count].reshape(fits, count, *a.shape[1:])  # noqa: E731
        leaves = [apart(leaf) for leaf in values]
        if not self.moving:
            return Leaves(leaves, None)
        parts = [apart(slopes[k]) for k in self.moving]
        joined = [part.reshape(fits, count, -1, part.shape[-1]) for part in parts]
        return Leaves(leaves, np.concatenate(joined, axis=2))


def _padded(values: np.ndarray) -> np.ndarray:
    """Filled up to a power of eight rows by the last, so that few sizes are compiled."""
    size = FEW_ROWS
    while size < len(values):
        size *= 8
    return np.concatenate([values, np.repeat(values[-1:], size - len(values))])


@partial(jax.jit, static_argnames=("build", "takes_contact", "area", "free", "trees"))
def _build(contact, values, build, takes_contact: bool, area: str, free, trees):
    """The leaves of the laws of many rows, and their slopes in the free local parameters."""

    def leaves_of(some, contact, values):
        pair = None if contact is None else sj.Contact(**contact, area=area)
        law = built(build, takes_contact, trees, pair, values | some)
        return [jnp.asarray(leaf, float) for leaf in jax.tree.leaves(law)]

    def one(contact, values):
        some = {name: values[name] for name in free}
        if not free:
            return leaves_of(some, contact, values), []
        slopes = jax.jacfwd(leaves_of)(some, contact, values)
        stacked = [jnp.stack([leaf[name] for name in free], -1) for leaf in slopes]
        return leaves_of(some, contact, values), stacked

    return jax.vmap(one)(contact, values)
