"""A law of one's own as a table of forces, with what interpolating it costs.

Rows go evenly over the square root of the overlap, in which power laws of contacts are smooth;
columns of the unloading force over the square root of what is left to recover. The unloading force is scaled
so that an impact on the table itself gives back ε² of its energy.
"""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

import softjax as sj
from calibration.errors import InputError
from calibration.particle_codes.target import impacts_of, number_of, unloading_force

ROWS, COLUMNS = 129, 33
BEYOND = 1.1  # the largest overlap target times this is where the table ends
NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)
PARTS = np.array([0.25, 0.5, 0.75])  # of the way between knots, where interpolation is looked at


class Table(eqx.Module):
    """Forces between knots, as the header interpolates them."""

    contact: sj.Contact
    top: float  # largest overlap [m]
    loading: Array
    residual: Array
    squared: Array  # ε²
    unloading: Array

    def row(self, overlap: Any) -> Array:
        return jnp.sqrt(jnp.asarray(overlap) / self.top) * (ROWS - 1)

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


def table_of(law: Any, fastest: float, losses: bool = True) -> Table:
    """The forces of a law up to the overlaps of impacts at `fastest` [m/s] and a bit beyond.

    Raises:
        InputError: where they depend on the rate.
    """
    if isinstance(law, sj.RateDependentLaw):
        problem = f"{type(law).__name__} depends on the rate, which no table of forces holds well"
        raise InputError(None, None, problem, "--export-law auto, or write its force in C yourself")
    many = np.full(ROWS - 1, fastest)  # as many as the rows' impacts: one compilation
    top = BEYOND * float(np.asarray(sj.restitution(law, many).peak_overlap)[0])
    peaks = _overlaps(top, np.arange(ROWS))
    velocity = _velocities(law, peaks)[1:]
    residual = np.asarray(sj.restitution(law, velocity).residual_overlap)
    return Table(
        law.contact,
        top,
        loading=_loading(law, peaks),
        residual=np.append(0.0, residual / peaks[1:]),
        squared=_first_twice(impacts_of(law, velocity, losses).coefficient ** 2),
        unloading=_first_twice(_shape(law, peaks[1:], residual)),
    )


def table_values(table: Table) -> dict[str, Any]:
    """A table for its template in C."""
    values: dict[str, Any] = {"rows": ROWS, "columns": COLUMNS, "top": float(table.top)}
    values |= {name: number_of(getattr(table.contact, name)) for name in ("radius", "mass")}
    names = ("loading", "residual", "squared", "unloading")
    return values | {name: _text(getattr(table, name)) for name in names}


def force_error(law: Any, table: Table) -> float:
    """The largest error of interpolated forces over the largest force."""
    row = (np.arange(ROWS - 1)[:, None] + PARTS).ravel()
    column = (np.arange(COLUMNS - 1)[:, None] + PARTS).ravel()
    overlap = _overlaps(table.top, row)
    rest = np.asarray(overlap * _interpolated(table.residual, row))[:, None]
    back = rest + (overlap[:, None] - rest) * (column / (COLUMNS - 1)) ** 2
    target = jnp.maximum(unloading_force(law, back, overlap[:, None]), 0)
    unloading = jnp.abs(table.unloading_force(back, overlap[:, None]) - target)
    loading = jnp.abs(table.loading_force(overlap) - law.loading_force(overlap))
    return float(jnp.maximum(jnp.max(unloading), jnp.max(loading)) / jnp.max(table.loading))


def _overlaps(top: float, at: np.ndarray) -> np.ndarray:
    return top * (at / (ROWS - 1)) ** 2


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
