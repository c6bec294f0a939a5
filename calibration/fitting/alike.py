"""Problems of one structure as one: each fit of a search belongs to one of them.

Data sets that share nothing have a problem each, but mostly the same law, parameters and bounds.
Their searches then go side by side, and what these cost beside collisions is spent once.
"""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from calibration.fitting.problem import Lanes, Linear, Problem, Z
from calibration.fitting.rows import Laws, Leaves

Table = Float[np.ndarray, "members points"]


@dataclass(frozen=True, kw_only=True)
class Alike(Problem):
    """The longest of some problems, and the points of all; `Lanes.member` tells them apart.

    Attributes:
        velocity, value, weight: of the points; where a problem has fewer than the longest, its
            last is repeated without weight.
    """

    velocity: Table
    value: Table
    weight: Table

    @classmethod
    def of(cls, problems: Sequence[Problem]) -> Problem:
        """Problems of one `structure` as one; a single one is itself."""
        if len(problems) == 1:
            return problems[0]
        longest = max(problems, key=lambda one: one.count)
        told = {name: getattr(longest, name) for name in Problem.__dataclass_fields__}
        told |= {"laws": _joined(longest.laws, problems), "errors": (), "variances": ()}
        tables = ([one.points[k] for one in problems] for k in range(3))
        velocity, value, weight = (_table(rows, longest.count) for rows in tables)
        for k, one in enumerate(problems):
            weight[k, one.count :] = 0.0
        return cls(**told, velocity=velocity, value=value, weight=weight)

    def linearise(self, z: Z, lanes: Lanes | None = None, slopes: bool = True) -> Linear:
        assert lanes is not None
        k = lanes.member
        told = Lanes(self.value[k], self.weight[k], self.velocity[k], k)
        return super().linearise(z, told, slopes)

    def _leaves(self, theta, lanes: Lanes) -> Leaves:
        """Of one row a fit: found as those of one fit with all these rows."""
        rows, (fits, p) = self.laws.rows, theta.shape
        contact = rows.contact
        own = replace(
            rows,
            contact=contact and {name: leaf[lanes.member] for name, leaf in contact.items()},
            element=np.where(rows.element < 0, -1, rows.element + p * np.arange(fits)),
            held=rows.held[:, lanes.member],
        )
        values, slopes = replace(self.laws, rows=own).leaves(theta.reshape(1, -1))
        turned = [np.swapaxes(leaf, 0, 1) for leaf in values]
        return Leaves(turned, None if slopes is None else np.swapaxes(slopes, 0, 1))


def structure(problem: Problem) -> Hashable:
    """What problems have in common that can be one; of others only they themselves have it."""
    laws, rows = problem.laws, problem.laws.rows
    special = problem.elastic is not None or problem.pools or problem.with_prior
    normal = all(one.is_fixed and one.dof is None for one in problem.errors)
    others = np.any(problem.points.observable)
    if special or others or not normal or rows.size > 1 or any(laws.shape.whole):
        return id(problem)
    arrays = (*problem.transform, problem.active, rows.element)
    of_law = (laws.shape, laws.free, laws.moving, rows.model.build, rows.area, rows.names)
    length = problem.count.bit_length()  # none is filled up to more than twice its points
    return *of_law, problem.route, length, *(a.tobytes() for a in arrays)


def _joined(laws: Laws, problems: Sequence[Problem]) -> Laws:
    """One row for each problem; which elements these are is the same for all."""
    every = [one.laws.rows for one in problems]
    held = np.concatenate([rows.held for rows in every], axis=1)
    contacts = [rows.contact for rows in every if rows.contact is not None]
    names = contacts[0] if contacts else ()
    contact = {name: np.concatenate([one[name] for one in contacts]) for name in names} or None
    return replace(laws, rows=replace(laws.rows, contact=contact, held=held))


def _table(rows: Sequence[np.ndarray], length: int) -> Table:
    """Rows of one length."""
    return np.array([np.append(row, np.repeat(row[-1:], length - len(row))) for row in rows])
