"""A user's law as a table of forces, and the error of ε by interpolation.

Rows are even in the square root of the overlap, in which power laws of contacts are smooth; columns of
the unloading force in the square root of the overlap that is left to recover. The unloading force is scaled
so that an impact on the table itself returns ε² of its energy. How a user's law depends on the sizes of
the bodies is not known: a table is of one pair of them.
"""

from typing import Any

import jax
import numpy as np
from scipy.interpolate import CubicHermiteSpline

import softjax as sj
from calibration.errors import InputError
from calibration.particle_codes.target import Impacts, coefficient_of, number_of
from softjax.many_body import loading_work, unloading_force

FORMULAS = {  # laws that need no table, and their templates
    sj.Zhou: "zhou.h",
    sj.Thornton: "thornton.h",
    sj.WaltonBraun: "walton_braun.h",
    **dict.fromkeys(
        (sj.LinearSpringDashpot, sj.Hertz, sj.HertzDashpot, sj.ViscoelasticHertz), "damped.h"
    ),
}
ROWS, COLUMNS = 129, 33
BEYOND = 1.1  # the table ends at this many times the largest overlap of the range
AT_KINKS = 5e-5  # error of ε at a kink of the force, where 2e-5 was seen
PANELS = 16  # of the header's sums of works


def table_of(law: Any, impacts: Impacts, losses: bool = True) -> tuple[dict[str, Any], float]:
    """Values of the table's template, and the largest error of ε over the impacts.

    Raises:
        InputError: for a force that depends on the rate.
    """
    if isinstance(law, sj.RateDependentLaw):
        problem = f"{type(law).__name__} depends on the rate, which no table of forces holds well"
        raise InputError(None, None, problem, "--export-law auto, or write its force in C yourself")
    top = BEYOND * float(np.max(impacts.peak))
    roots = np.linspace(0, 1, ROWS)
    peaks = top * roots[1:] ** 2
    knots = np.sqrt(top) * roots
    works = np.cumsum(jax.jit(loading_work)(law, knots[:-1], knots[1:]))
    velocity = np.sqrt(2 * works / number_of(law.contact.mass))
    hit = sj.restitution(law, velocity)
    residual = np.asarray(hit.residual_overlap)
    part = np.linspace(0, 1, COLUMNS) ** 2  # of what is left to recover
    peak, rest = peaks[:, None], residual[:, None]
    force = np.asarray(jax.jit(unloading_force)(law, rest + (peak - rest) * part, peak))
    loading = np.asarray(law.loading_force(peaks))
    shape = np.maximum(force / loading[:, None], 0.0)
    squared = _first_twice(coefficient_of(hit, losses) ** 2)
    tables = {
        "loading": np.append(0.0, loading),
        "residual": np.append(0.0, residual / peaks),
        "squared": squared,
        "unloading": _first_twice(shape),
    }
    at_knots = np.gradient(squared, edge_order=2)  # Catmull and Rom's cubic, as in the header
    curve = CubicHermiteSpline(roots, squared, (ROWS - 1) * at_knots)
    by_table = np.sqrt(np.clip(curve(np.sqrt(impacts.peak / top)), 0, 1))
    error = float(np.max(np.abs(by_table - impacts.coefficient)))
    values: dict[str, Any] = {"rows": ROWS, "columns": COLUMNS, "top": top, "panels": PANELS}
    values |= {name: number_of(getattr(law.contact, name)) for name in ("radius", "mass")}
    return values | {name: _text(table) for name, table in tables.items()}, error + AT_KINKS


def _first_twice(rows: np.ndarray) -> np.ndarray:
    """At no overlap there is neither a shape nor a factor: those of the next row."""
    return np.concatenate([rows[:1], rows])


def _text(array: np.ndarray) -> str:
    numbers = [f"{value:.9g}" for value in np.ravel(array)]
    lines = (", ".join(numbers[i : i + 8]) for i in range(0, len(numbers), 8))
    return ",\n".join(f"  {line}" for line in lines)
