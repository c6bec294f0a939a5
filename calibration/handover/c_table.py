"""A law of one's own as a table of forces, with what interpolating it costs.

Rows go evenly over the square root of the overlap, in which power laws of contacts are smooth;
columns of the unloading force over the square root of what is left to recover, columns of a damped
force over the rate.
"""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

import softjax as sj
from calibration.handover.forces import end_of, unloading_force
from calibration.handover.impacts import impacts_of
from calibration.handover.templates import filled
from calibration.handover.wanted import number_of

ROWS, COLUMNS = 129, 33
BEYOND = 1.1  # the largest overlap wanted times this is where the table ends
NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)
PARTS = np.array([0.25, 0.5, 0.75])  # of the way between knots, where interpolation is looked at


class Table(eqx.Module):
    """What tables have in common; forces between the knots are those of the header."""

    contact: sj.Contact
    top: float  # largest overlap [m]

    def row(self, overlap: Any) -> Array:
        return jnp.sqrt(jnp.asarray(overlap) / self.top) * (ROWS - 1)


class TableWithMemory(Table):
    """Of a force that does not depend on the rate."""

    loading: Array
    residual: Array
    factor: Array
    unloading: Array

    def loading_force(self, overlap: Any) -> Array:
        """[N]"""
        return _interpolated(self.loading, self.row(overlap))

    def unloading_force(self, overlap: Any, peak_overlap: Any) -> Array:
        """[N], without the factor."""
        row = self.row(peak_overlap)
        rest = peak_overlap * _interpolated(self.residual, row)
        part = jnp.maximum((overlap - rest) / (peak_overlap - rest), 0.0)
        shape = _interpolated_over_both(self.unloading, row, jnp.sqrt(part) * (COLUMNS - 1))
        return self.loading_force(peak_overlap) * jnp.where(part > 0, shape, 0.0)


class DampedTable(Table):
    """Of a force that depends on the rate."""

    fastest: float  # largest rate [m/s]
    values: Array
    end: str = eqx.field(static=True)

    def force(self, overlap: Any, velocity: Any) -> Array:
        """[N]"""
        column = (velocity / self.fastest + 1) * (COLUMNS - 1) / 2
        return _interpolated_over_both(self.values, self.row(overlap), column)


def table_of(law: Any, fastest: float, losses: bool = True) -> Table:
    """The forces of a law up to the overlaps of impacts at `fastest` [m/s] and a bit beyond."""
    many = np.full(ROWS - 1, fastest)  # as many as the rows' impacts: one compilation
    top = BEYOND * float(np.asarray(sj.restitution(law, many).peak_overlap)[0])
    if isinstance(law, sj.RateDependentLaw):
        return _damped(law, top, BEYOND * fastest)
    return _with_memory(law, top, losses)


def source_of(table: Table) -> str:
    """A table in C."""
    values: dict[str, Any] = {"rows": ROWS, "columns": COLUMNS}
    values |= {name: number_of(getattr(table.contact, name)) for name in ("radius", "mass")}
    for name, value in vars(table).items():
        if name not in ("contact", "end"):
            values[name] = _text(value) if np.ndim(value) else float(value)
    name = "table_damped.h.in" if isinstance(table, DampedTable) else "table_with_memory.h.in"
    return filled("table.h.in", values) + filled(name, values)


def force_error(law: Any, table: Table) -> float:
    """The largest error of interpolated forces over the largest force."""
    row = (np.arange(ROWS - 1)[:, None] + PARTS).ravel()
    column = (np.arange(COLUMNS - 1)[:, None] + PARTS).ravel()
    overlap = _overlaps(table.top, row)
    if isinstance(table, DampedTable):
        rate = table.fastest * (2 * column / (COLUMNS - 1) - 1)
        wanted, found = (one.force(overlap[:, None], rate) for one in (law, table))
        return float(jnp.max(jnp.abs(found - wanted)) / jnp.max(jnp.abs(table.values)))
    rest = np.asarray(overlap * _interpolated(table.residual, row))[:, None]
    back = rest + (overlap[:, None] - rest) * (column / (COLUMNS - 1)) ** 2
    wanted = jnp.maximum(unloading_force(law, back, overlap[:, None]), 0)
    unloading = jnp.abs(table.unloading_force(back, overlap[:, None]) - wanted)
    loading = jnp.abs(table.loading_force(overlap) - law.loading_force(overlap))
    return float(jnp.maximum(jnp.max(unloading), jnp.max(loading)) / jnp.max(table.loading))


def _overlaps(top: float, at: np.ndarray) -> np.ndarray:
    return top * (at / (ROWS - 1)) ** 2


def _with_memory(law: Any, top: float, losses: bool) -> TableWithMemory:
    peaks = _overlaps(top, np.arange(ROWS))
    velocity = _velocities(law, peaks)[1:]
    residual = np.asarray(sj.restitution(law, velocity).residual_overlap)
    return TableWithMemory(
        law.contact,
        top,
        loading=_loading(law, peaks),
        residual=np.append(0.0, residual / peaks[1:]),
        factor=_first_twice(impacts_of(law, velocity, losses).factor),
        unloading=_first_twice(_shape(law, peaks[1:], residual)),
    )


def _first_twice(rows: np.ndarray) -> np.ndarray:
    """At no overlap there is neither a shape nor a factor: those of the next row."""
    return np.concatenate([rows[:1], rows])


def _loading(law: Any, overlap: np.ndarray) -> np.ndarray:
    force = np.asarray(law.loading_force(np.where(overlap > 0, overlap, 1.0)))
    return np.where(overlap > 0, force, 0.0)


def _shape(law: Any, peaks: np.ndarray, residual: np.ndarray) -> np.ndarray:
    """Unloading force over that at the peak, rows over peaks and columns over what is left."""
    part = np.linspace(0, 1, COLUMNS) ** 2
    peak, rest = peaks[:, None], residual[:, None]
    force = np.asarray(unloading_force(law, rest + (peak - rest) * part, peak))
    return np.maximum(force / _loading(law, peak), 0.0)


def _velocities(law: Any, peaks: np.ndarray) -> np.ndarray:
    """The impact velocities of these largest overlaps, ½ M v² = ∫ P dδ."""
    roots = np.sqrt(peaks)
    middle, half = (roots[1:] + roots[:-1]) / 2, (roots[1:] - roots[:-1]) / 2
    root = middle[:, None] + half[:, None] * NODES
    work = np.sum(WEIGHTS * 2 * root * _loading(law, root**2), axis=1) * half
    return np.sqrt(2 * np.append(0.0, np.cumsum(work)) / number_of(law.contact.mass))


def _damped(law: Any, top: float, fastest: float) -> DampedTable:
    overlap = _overlaps(top, np.maximum(np.arange(ROWS), 1e-9))[:, None]
    values = np.asarray(law.force(overlap, fastest * np.linspace(-1, 1, COLUMNS)))
    return DampedTable(law.contact, top, fastest=fastest, values=values, end=end_of(law))


def _text(array: np.ndarray) -> str:
    numbers = [f"{value:.9g}" for value in np.ravel(array)]
    lines = (", ".join(numbers[i : i + 8]) for i in range(0, len(numbers), 8))
    return ",\n".join(f"  {line}" for line in lines)


def _interpolated(values: Array, at: Any) -> Array:
    """Catmull and Rom's cubic between n values at 0, 1, …, n - 1, as the C header has it."""
    index, weight = _points(values.shape[0], at)
    return jnp.sum(weight * values[index], axis=-1)


def _interpolated_over_both(table: Array, row: Any, column: Any) -> Array:
    """The same over rows and columns."""
    rows, by_row = _points(table.shape[0], row)
    columns, by_column = _points(table.shape[1], column)
    square = table[rows[..., :, None], columns[..., None, :]]
    return jnp.sum(by_row[..., :, None] * by_column[..., None, :] * square, axis=(-2, -1))


def _points(count: int, at: Any) -> tuple[Array, Array]:
    """The four points about `at` and their weights; beyond an end a parabola goes on."""
    at = jnp.clip(at, 0, count - 1)
    first = jnp.minimum(at.astype(int), count - 2)
    f = at - first
    w = [f * (f * (2 - f) - 1) / 2, 1 + f**2 * (3 * f - 5) / 2]
    w += [f * (1 + f * (4 - 3 * f)) / 2, f**2 * (f - 1) / 2]
    before, after = jnp.where(first == 0, w[0], 0), jnp.where(first == count - 2, w[3], 0)
    w = [
        w[0] - before + after,
        w[1] + 3 * (before - after),
        w[2] - 3 * (before - after),
        w[3] + before - after,
    ]
    index = first[..., None] + jnp.arange(-1, 3)
    return jnp.clip(index, 0, count - 1), jnp.stack(w, axis=-1)
