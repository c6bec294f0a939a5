"""A user's law as a table of forces, and the error of ε by interpolation.

Rows are even in the square root of the overlap, in which power laws of contacts are smooth; columns of
the unloading force in the square root of the overlap that is left to recover. The unloading force is scaled
so that an impact on the table itself returns ε² of its energy.
"""

from typing import Any

import numpy as np
from scipy.interpolate import CubicHermiteSpline

import softjax as sj
from calibration.errors import InputError
from calibration.particle_codes.target import Impacts, impacts_of, number_of, unloading_force

ROWS, COLUMNS = 129, 33
BEYOND = 1.1  # the table ends at this many times the largest overlap of the range
NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)
AT_KINKS = 5e-5  # error of ε at a kink of the force, where 2e-5 was seen
PANELS, FINE = (
    16,
    16,
)  # of the header's sums of works; with as many times more they are exact in comparison
TEN = np.polynomial.legendre.leggauss(10)


def table_of(law: Any, impacts: Impacts, losses: bool = True) -> tuple[dict[str, Any], float]:
    """Values of the table's template, and the largest error of ε over the impacts.

    Raises:
        InputError: for a force that depends on the rate.
    """
    if isinstance(law, sj.RateDependentLaw):
        problem = f"{type(law).__name__} depends on the rate, which no table of forces holds well"
        raise InputError(None, None, problem, "--export-law auto, or write its force in C yourself")
    top = BEYOND * float(impacts.peak[-1])
    peaks = top * np.linspace(0, 1, ROWS) ** 2
    velocity = _velocities(law, peaks)[1:]
    residual = np.asarray(sj.restitution(law, velocity).residual_overlap)
    squared = _first_twice(impacts_of(law, velocity, losses).coefficient ** 2)
    tables = {
        "loading": _loading(law, peaks),
        "residual": np.append(0.0, residual / peaks[1:]),
        "squared": squared,
        "unloading": _first_twice(_shape(law, peaks[1:], residual)),
    }
    values: dict[str, Any] = {"rows": ROWS, "columns": COLUMNS, "top": top}
    values |= {name: number_of(getattr(law.contact, name)) for name in ("radius", "mass")}
    at_knots = np.gradient(squared, edge_order=2)  # Catmull and Rom's cubic, as in the header
    curve = CubicHermiteSpline(np.linspace(0, 1, ROWS), squared, (ROWS - 1) * at_knots)
    by_table = np.sqrt(np.clip(curve(np.sqrt(impacts.peak / top)), 0, 1))
    sums = _returned(law, impacts.peak, FINE * PANELS) / _returned(law, impacts.peak, PANELS)
    error = float(np.max(np.abs(by_table * np.sqrt(sums) - impacts.coefficient)))
    return values | {name: _text(table) for name, table in tables.items()}, error + AT_KINKS


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


def _returned(law: Any, peak: np.ndarray, panels: int) -> np.ndarray:
    """Work on unloading over work on loading, by the header's rule in √δ."""
    nodes, weights = TEN
    root = np.ravel(np.arange(panels)[:, None] + (1 + nodes) / 2)[:, None] / panels
    weight, overlap = np.tile(weights, panels)[:, None] * root, peak * root**2
    unloading = np.maximum(np.asarray(unloading_force(law, overlap, peak)), 0.0)
    return np.sum(weight * unloading, axis=0) / np.sum(weight * _loading(law, overlap), axis=0)


def _text(array: np.ndarray) -> str:
    numbers = [f"{value:.9g}" for value in np.ravel(array)]
    lines = (", ".join(numbers[i : i + 8]) for i in range(0, len(numbers), 8))
    return ",\n".join(f"  {line}" for line in lines)
