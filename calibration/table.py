"""Columns as people measure them, turned into impact velocity and restitution.

Headers are a name and, in brackets, a unit; SI without. Accepted together are

    velocity, restitution               and the two heights beside them, to check against
    drop_height, rebound_height         v = √(2 g h₁), ε = √(h₂/h₁); a restitution beside is used
    interval, launch (may be left out)  v = g tₙ/2, ε = tₙ₊₁/tₙ of bounces that follow each other

each with `uncertainty` and `velocity_uncertainty`, both of which always refer to ε and v
themselves, never to a height or a time. With intervals they stand in the row of tₙ; the cells of
a launch's last interval, which gives no ε, are not read.
"""

import re
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from calibration.errors import DataError, did_you_mean, listed

STANDARD_GRAVITY = 9.80665  # m/s²
NOISE_ABOVE_ONE = 0.05  # what ε may be off by where no uncertainty is given
UNCERTAINTIES = 3  # and in uncertainties where one is

Column = Float[np.ndarray, " n"]

# SI value = value / divisor: divisions round correctly, products with 0.01 do not
_SPEED = {"m/s": 1.0, "cm/s": 100.0, "mm/s": 1000.0}
_LENGTH = {"m": 1.0, "cm": 100.0, "mm": 1000.0}
_TIME = {"s": 1.0, "ms": 1000.0}
_NUMBER = {"-": 1.0, "1": 1.0}
UNITS: dict[str, dict[str, float]] = {
    "velocity": _SPEED,
    "restitution": _NUMBER,
    "drop_height": _LENGTH,
    "rebound_height": _LENGTH,
    "interval": _TIME,
    "launch": {},
    "uncertainty": _NUMBER,
    "velocity_uncertainty": _SPEED,
}
ACCEPTED_SETS = (
    "velocity with restitution, drop_height with rebound_height, or interval (with launch)"
)


class Points(NamedTuple):
    """n impacts: v [m/s], ε, their uncertainties, and the row of the table each came from."""

    velocity: Column
    restitution: Column
    uncertainty: Column | None
    velocity_uncertainty: Column | None
    rows: Int[np.ndarray, " n"]
    remarks: tuple[str, ...] = ()


def parse_header(header: str) -> tuple[str, float]:
    """Name and divisor to SI of `name [unit]`; raises DataError for what is not known."""
    match = re.fullmatch(r"\s*([^\[\]]*?)\s*(?:\[\s*([^\[\]]*?)\s*\])?\s*", str(header))
    name = match[1].lower().replace(" ", "_") if match else str(header)
    if match is None or name not in UNITS:
        accepted = f"one of {listed(UNITS)}{did_you_mean(name, UNITS)}"
        raise DataError("column", repr(header), accepted)
    units = UNITS[name]
    if match[2] is not None and match[2] not in units:
        accepted = f"in {listed(units)}" if units else "without a unit"
        raise DataError(f"unit of {name}", f"[{match[2]}]", accepted)
    return name, 1.0 if match[2] is None else units[match[2]]


def si_columns(table: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """The columns by name, in SI; raises DataError for a column twice, or of another length."""
    columns: dict[str, np.ndarray] = {}
    names = getattr(table, "columns", None)  # a frame's
    if names is None:
        names = getattr(table, "keys", tuple)()
    for header in names:
        name, divisor = parse_header(header)
        if name in columns:
            raise DataError("column", repr(header), "named once, but this is its second time")
        values = table[header]
        is_label = name == "launch"
        columns[name] = np.asarray(values) if is_label else as_numbers(name, values) / divisor
    check_lengths(columns)
    return columns


def points_of(columns: Mapping[str, np.ndarray], gravity: float | None = None) -> Points:
    """Impact velocities and restitutions of columns in SI (see the module's text).

    Args:
        columns: by name, in SI.
        gravity: g [m/s²], standard gravity unless given; only heights and intervals use it.

    Raises:
        DataError: naming the column, and the row where one is to blame.
    """
    measured = set(columns) - {"uncertainty", "velocity_uncertainty"}
    heights = {"drop_height", "rebound_height"}
    if measured in ({"velocity", "restitution"}, {"velocity", "restitution"} | heights):
        if gravity is not None:
            raise DataError("gravity", "given", "left out where velocities are given")
        return _from_velocities(columns)
    g = STANDARD_GRAVITY if gravity is None else gravity
    if measured in (heights, heights | {"restitution"}):
        return _from_heights(columns, g)
    if measured in ({"interval"}, {"interval", "launch"}):
        return _from_intervals(columns, g)
    raise DataError("set of columns", listed(sorted(columns)) or "empty", ACCEPTED_SETS)


def allowance(uncertainty: Column | None) -> Column | float:
    """How far ε may be from what it should be and still be noise."""
    return NOISE_ABOVE_ONE if uncertainty is None else UNCERTAINTIES * uncertainty


def require(
    name: str, values: Column, holds: Callable[[Column], Bool[np.ndarray, " n"]], accepted: str
) -> None:
    """Raise DataError for the first value for which `holds` is not true (NaN never is)."""
    with np.errstate(invalid="ignore"):
        bad = np.flatnonzero(~(np.isfinite(values) & holds(values)))
    if bad.size:
        raise DataError(name, float(values[bad[0]]), accepted, int(bad[0]))


def as_numbers(name: str, values: Any) -> Column:
    """A column of real numbers as float64; raises DataError for anything else."""
    array = np.asarray(values)
    if array.dtype.kind == "O" and not any(isinstance(item, str | bool) for item in array.flat):
        with suppress(TypeError, ValueError):  # decimals, fractions, a frame's missing values
            array = np.asarray(values, dtype=float)
    if array.dtype.kind not in "fiu":
        raise DataError(name, values, "an array of real numbers")
    if array.ndim != 1 or not array.size:
        raise DataError(name, f"of shape {array.shape}", "a one-dimensional array with numbers in")
    return array.astype(float)


def as_number(name: str, value: Any, holds: Callable[[float], bool], accepted: str) -> float:
    """A single finite number for which `holds`; raises DataError for anything else."""
    try:
        (number,) = as_numbers(name, [value])
    except DataError:
        raise DataError(name, value, accepted) from None
    if not (np.isfinite(number) and holds(number)):
        raise DataError(name, float(number), accepted)
    return float(number)


def check_lengths(columns: Mapping[str, np.ndarray]) -> None:
    """Raise DataError where the columns differ in length."""
    first = next(iter(columns), "")
    for name, column in columns.items():
        if column.shape != columns[first].shape:
            accepted = f"as long as `{first}`, {len(columns[first])}"
            raise DataError(name, f"{len(column)} long", accepted)


def _from_velocities(columns: Mapping[str, np.ndarray]) -> Points:
    if "drop_height" in columns:
        _check_against_heights(columns)
    rows = np.arange(len(columns["velocity"]))
    return Points(columns["velocity"], columns["restitution"], *_uncertainties(columns), rows)


def _from_heights(columns: Mapping[str, np.ndarray], gravity: float) -> Points:
    drop = columns["drop_height"]
    root = np.sqrt(_height_ratio(columns))
    if "restitution" in columns:
        _check_against_heights(columns)
    restitution = columns.get("restitution", root)
    velocity = np.sqrt(2 * gravity * drop)
    return Points(velocity, restitution, *_uncertainties(columns), np.arange(len(drop)))


def _from_intervals(columns: Mapping[str, np.ndarray], gravity: float) -> Points:
    interval = columns["interval"]
    require("interval", interval, lambda t: t > 0, "a positive time in s")
    label = columns.get("launch", np.zeros(len(interval)))
    same = np.asarray(label[1:] == label[:-1], dtype=bool)  # a launch's rows stand together
    rows = np.flatnonzero(same)
    if not rows.size:
        raise DataError("launch", "of one interval everywhere", "of two or more, rows together")
    velocity = gravity * interval[rows] / 2
    restitution = interval[rows + 1] / interval[rows]
    used = {name: column[rows] for name, column in columns.items()}
    return Points(velocity, restitution, *_uncertainties(used), rows, _single_intervals(same))


def _single_intervals(same: np.ndarray) -> tuple[str, ...]:
    linked = np.concatenate([[False], same]) | np.concatenate([same, [False]])
    count = int(np.sum(~linked))
    if not count:
        return ()
    return (f"{count} launch(es) of a single interval give no restitution and are not used",)


def _uncertainties(columns: Mapping[str, np.ndarray]) -> tuple[Column | None, Column | None]:
    return columns.get("uncertainty"), columns.get("velocity_uncertainty")


def _height_ratio(columns: Mapping[str, np.ndarray]) -> Column:
    require("drop_height", columns["drop_height"], lambda h: h > 0, "a positive height in m")
    require(
        "rebound_height", columns["rebound_height"], lambda h: h >= 0, "a height of 0 m or more"
    )
    return columns["rebound_height"] / columns["drop_height"]


def _check_against_heights(columns: Mapping[str, np.ndarray]) -> None:
    """A restitution beside both heights must be the root of their ratio, not the ratio (ε²)."""
    given, ratio = columns["restitution"], _height_ratio(columns)
    root = np.sqrt(ratio)
    noise = allowance(columns.get("uncertainty"))
    off = np.abs(given - root) > noise
    is_ratio = (np.abs(given - ratio) < np.abs(given - root)) & (np.abs(given - ratio) <= noise)
    # near ε = 1 noise hides the difference in one point, not in most of them
    slips = is_ratio if 2 * np.sum(is_ratio) > len(given) else off
    if not np.any(slips):
        return
    row = int(np.flatnonzero(slips)[0])
    blame = "the ratio of the heights" if is_ratio[row] else "not what the heights give"
    accepted = f"√(rebound_height/drop_height), {root[row]:.6g}, or left out"
    raise DataError("restitution", f"{given[row]:.6g}, {blame}", accepted, row)
