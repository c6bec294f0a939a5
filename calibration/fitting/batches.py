"""Many problems as one, and very many points as few.

Data sets that share nothing have a problem each, but mostly the same law, parameters and bounds: their
searches go side by side.

Between neighbours in velocity ε is a straight line to far less than its error: neighbours that a fit
cannot distinguish stand as one, with all their weight. Where searches begin, and how cost rises along a
profile, need no more; where a search ends is always found on all points."""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from calibration.fitting.problem import Lanes, Linear, Points, Problem, Z
from calibration.fitting.rows import Laws, Leaves
from calibration.fitting.steps import condense

Table = Float[np.ndarray, "members points"]


@dataclass(frozen=True, kw_only=True)
class Alike(Problem):
    """The longest of some problems, and the points of all; `Lanes.member` identifies them."""

    # of the points; where a problem has fewer than the longest, its last is repeated without
    # weight
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
        told |= {"laws": _joined_laws(longest.laws, problems), "errors": (), "variances": ()}
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
        """Leaves with one row for each fit, computed as those of one fit with all these rows."""
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
    """Properties that problems of one batch have in common; for others, an object that equals only itself."""
    laws, rows = problem.laws, problem.laws.rows
    special = problem.elastic is not None or problem.pools or problem.with_prior
    normal = all(one.is_fixed and one.is_normal for one in problem.errors)
    others = np.any(problem.points.observable)
    if special or others or not normal or rows.size > 1 or any(laws.shape.whole):
        return id(problem)
    arrays = (*problem.transform, problem.active, rows.element)
    of_law = (laws.shape, laws.free, laws.moving, rows.model.build, rows.area, rows.names)
    length = problem.count.bit_length()  # none is filled up to more than twice its points
    return *of_law, problem.route, length, *(a.tobytes() for a in arrays)


def _joined_laws(laws: Laws, problems: Sequence[Problem]) -> Laws:
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


MANY = 20_000  # points from which on it pays
FEW = 4096  # neighbourhoods, of all data sets together
CLOSE = 1e-3  # standard errors by which the minimum may move


def pooled(problem: Problem) -> Problem:
    """The problem with neighbours as one; itself where points are few, or share errors."""
    if not _can_be_pooled(problem):
        return problem
    return _pooled(problem, _neighbourhoods(problem), problem.points.value)


def pooled_about(
    problem: Problem,
    z: Float[np.ndarray, "elements"],
    errors: Float[np.ndarray, "p"],
) -> Problem:
    """The problem with its minimum replaced by that of all points; unchanged if that cannot be found.

    Args:
        z: the minimum.
        errors: standard errors of the active elements, in z.
    """
    if not _can_be_pooled(problem):
        return problem
    members = _neighbourhoods(problem)
    residual = problem.predict(z[None])[0] - problem.points.value
    few = _pooled(problem, members, residual)
    # each neighbourhood keeps its mean residual, whatever ε does inside of it
    measured = few.predict(z[None])[0] - few.points.value
    few = replace(few, points=few.points._replace(value=measured))
    found = few.linearise(z[None])
    known = np.isfinite(errors) & (errors > 0)  # the others are held at an end of their range
    step = condense(found.residual, found.jacobian, ~known[None]).newton[0]
    return few if np.all(np.abs(step[known]) <= CLOSE * errors[known]) else problem


def _can_be_pooled(problem: Problem) -> bool:
    normal = all(one.is_fixed and one.is_normal for one in problem.errors)
    alone = normal and problem.elastic is None and not np.any(problem.points.observable)
    return alone and problem.count >= MANY


def _neighbourhoods(problem: Problem) -> Int[np.ndarray, "points"]:
    """Index of the neighbourhood of each point: equally many points in each, of one data set and one law."""
    points, rows = problem.points, problem.laws.rows.row
    order = np.lexsort((points.velocity, rows, points.set))
    kind = np.stack([points.set[order], rows[order]])
    size = -(-problem.count // FEW)
    new = np.zeros(problem.count, bool)
    new[1:] = np.any(kind[:, 1:] != kind[:, :-1], axis=0)
    starts = np.flatnonzero(new)
    since = np.arange(problem.count) - np.append(0, starts)[np.cumsum(new)]
    members = np.empty(problem.count, int)
    members[order] = np.cumsum(new | (since % size == 0)) - 1
    return members


def _pooled(problem: Problem, members, value) -> Problem:
    """Weighted means; of what is passed in the place of the values."""
    points, count = problem.points, int(members.max()) + 1
    square = points.weight**2
    weight = np.bincount(members, square, count)
    held = np.maximum(weight, np.finfo(float).tiny)

    def mean(values):
        return np.bincount(members, square * values, count) / held

    _, first = np.unique(members, return_index=True)
    velocity = np.where(weight > 0, mean(points.velocity), points.velocity[first])
    others = (*(a[first] for a in points[3:-1]), mean(points.by_drag))
    few = Points(velocity, mean(value), np.sqrt(weight), *others)
    rows = replace(problem.laws.rows, row=problem.laws.rows.row[first])
    laws = replace(problem.laws, rows=rows)
    return replace(problem, points=few, laws=laws, errors=(), variances=())
