"""A law of one's own as a table of forces, with what interpolating it costs.

Rows go evenly over the square root of the overlap, in which power laws of contacts are smooth;
columns of the unloading force over the square root of what is left to recover.
"""

from typing import Any, NamedTuple

import numpy as np

import softjax as sj
from calibration.handover.templates import filled
from calibration.handover.wanted import number_of

ROWS, COLUMNS = 129, 33
BEYOND = 1.1  # the largest overlap wanted times this is where the table ends
NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)


class Table(NamedTuple):
    """C source, and the largest error of its forces over the largest force."""

    source: str
    error: float


def table_of(law: Any, fastest: float, losses: bool) -> Table:
    """The forces of a law up to the overlaps of impacts at `fastest` [m/s] and a bit beyond."""
    top = BEYOND * float(sj.restitution(law, fastest).peak_overlap)
    damped = isinstance(law, sj.RateDependentLaw)
    arrays = _damped(law, top, fastest) if damped else _with_memory(law, top, losses)
    values: dict[str, Any] = {name: _text(array) for name, array in arrays.items()}
    values |= {name: number_of(getattr(law.contact, name)) for name in ("radius", "mass")}
    values |= {"top": top, "rows": ROWS, "columns": COLUMNS, "fastest": BEYOND * fastest}
    name = "table_damped.h.in" if damped else "table_with_memory.h.in"
    error = _error_damped(law, top, fastest, arrays) if damped else _error(law, top, arrays)
    return Table(filled("table.h.in", values) + filled(name, values), error)


def _overlaps(top: float, at: np.ndarray) -> np.ndarray:
    return top * (at / (ROWS - 1)) ** 2


def _with_memory(law: Any, top: float, losses: bool) -> dict[str, np.ndarray]:
    peaks = _overlaps(top, np.arange(ROWS))
    hit = sj.restitution(law, _velocities(law, peaks)[1:])
    plastic, total = np.asarray(hit.plastic_coefficient), np.asarray(hit.coefficient)
    lost = np.where(plastic > 0, np.minimum(total, 1) / np.where(plastic > 0, plastic, 1), 0) ** 2
    residual = np.asarray(hit.residual_overlap)
    return {
        "loading": _loading(law, peaks),
        "residual": np.append(0.0, residual / peaks[1:]),
        "factor": np.append(lost[0], lost) if losses else np.ones(ROWS),
        "unloading": _first_twice(_shape(law, peaks[1:], residual, np.arange(COLUMNS))),
    }


def _first_twice(rows: np.ndarray) -> np.ndarray:
    """At no overlap there is no shape: that of the next row."""
    return np.concatenate([rows[:1], rows])


def _loading(law: Any, overlap: np.ndarray) -> np.ndarray:
    force = np.asarray(law.loading_force(np.where(overlap > 0, overlap, 1.0)))
    return np.where(overlap > 0, force, 0.0)


def _shape(law: Any, peaks, residual, at: np.ndarray) -> np.ndarray:
    """Unloading force over that at the peak, rows over peaks and columns over what is left."""
    part = (at / (COLUMNS - 1)) ** 2
    peak, rest = peaks[:, None], residual[:, None]
    force = np.asarray(law.unloading_force(rest + (peak - rest) * part, peak))
    return np.maximum(force / _loading(law, peak), 0.0)


def _velocities(law: Any, peaks: np.ndarray) -> np.ndarray:
    """The impact velocities of these largest overlaps, ½ M v² = ∫ P dδ."""
    roots = np.sqrt(peaks)
    middle, half = (roots[1:] + roots[:-1]) / 2, (roots[1:] - roots[:-1]) / 2
    root = middle[:, None] + half[:, None] * NODES
    work = np.sum(WEIGHTS * 2 * root * _loading(law, root**2), axis=1) * half
    return np.sqrt(2 * np.append(0.0, np.cumsum(work)) / number_of(law.contact.mass))


def _damped(law: Any, top: float, fastest: float) -> dict[str, np.ndarray]:
    return {"force": _forces(law, top, fastest, np.arange(ROWS), np.arange(COLUMNS))}


def _forces(law: Any, top: float, fastest: float, rows, columns) -> np.ndarray:
    overlap = _overlaps(top, np.maximum(rows, 1e-9))[:, None]
    rate = BEYOND * fastest * (2 * columns / (COLUMNS - 1) - 1)
    return np.asarray(law.force(overlap, rate))


def _error(law: Any, top: float, arrays: dict[str, np.ndarray]) -> float:
    """Of the interpolated forces halfway between knots, where it is largest."""
    rows = np.arange(1, ROWS - 2) + 0.5
    peaks = _overlaps(top, rows)
    loading = _loading(law, peaks)
    residual = peaks * _halfway(arrays["residual"])
    columns = np.arange(1, COLUMNS - 2) + 0.5
    shape = _halfway(_halfway(arrays["unloading"]).T).T
    wrong = (shape - _shape(law, peaks, residual, columns)) * loading[:, None]
    largest = max(np.max(np.abs(wrong)), np.max(np.abs(_halfway(arrays["loading"]) - loading)))
    return float(largest / np.max(arrays["loading"]))


def _error_damped(law: Any, top: float, fastest: float, arrays: dict[str, np.ndarray]) -> float:
    rows, columns = (np.arange(1, n - 2) + 0.5 for n in (ROWS, COLUMNS))
    wrong = _halfway(_halfway(arrays["force"]).T).T - _forces(law, top, fastest, rows, columns)
    return float(np.max(np.abs(wrong)) / np.max(np.abs(arrays["force"])))


def _halfway(y: np.ndarray) -> np.ndarray:
    """The header's cubic halfway between knots, along the first axis."""
    return (9 * (y[1:-2] + y[2:-1]) - (y[:-3] + y[3:])) / 16


def _text(array: np.ndarray) -> str:
    numbers = [f"{value:.9g}" for value in np.ravel(array)]
    lines = (", ".join(numbers[i : i + 8]) for i in range(0, len(numbers), 8))
    return ",\n".join(f"  {line}" for line in lines)
