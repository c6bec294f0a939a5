"""Arrays, numbers and labels as they come in, turned into what is computed with."""

import math
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from calibration.errors import DataError, printable
from softjax.units import has_unit

Column = Float[np.ndarray, " n"]
LEAST = 1e-60  # of an uncertainty: squares of what is divided by it are numbers


def as_numbers(name: str, values: Any) -> Column:
    """A column of real numbers as float64; raises DataError for anything else."""
    if has_unit(values):
        raise DataError(
            name, values, "an array of numbers in SI units, without a unit of their own"
        )
    if np.ma.isMaskedArray(values):  # what is masked was not measured
        values = np.ma.filled(values.astype(float), np.nan)
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


def checked_confidence(value: Any) -> float:
    """A confidence level; raises DataError for one in per cent, 0 or 1."""
    return as_number("confidence", value, lambda level: 0 < level < 1, "between 0 and 1")


def check_whole(name: str, value: Any, lowest: int) -> None:
    """Raise DataError unless the value is a whole number of at least `lowest`."""
    is_whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not is_whole or value < lowest:
        raise DataError(name, value, f"a whole number >= {lowest}")


def as_labels(name: str, values: Any) -> np.ndarray:
    """Labels as text, (n,), equal ones the same object; raises DataError for one that is empty."""
    if isinstance(values, str) or np.ndim(values) != 1 or not len(values):
        raise DataError(name, values, "one label for each point")
    known: dict[Any, str] = {}
    labels = np.empty(len(values), dtype=object)
    for i, value in enumerate(values):
        if value not in known:
            known[value] = _label(name, value, i)
        labels[i] = known[value]
    return labels


def _label(name: str, value: Any, row: int) -> str:
    is_number = isinstance(value, float | np.floating)
    text = f"{value:g}" if is_number else str(value).strip()
    if not text or value is None or (is_number and math.isnan(value)):
        raise DataError(name, "empty", "a label of the specimen, the launch or the day", row)
    return printable(text)


def codes_of(labels: Iterable[str]) -> Int[np.ndarray, " n"]:
    """A number for each label, from 0 in the order in which they appear."""
    codes: dict[str, int] = {}
    return np.array([codes.setdefault(label, len(codes)) for label in labels], int)


def require(
    name: str, values: Column, holds: Callable[[Column], Bool[np.ndarray, " n"]], accepted: str
) -> None:
    """Raise DataError for the first value for which `holds` is not true (NaN never is)."""
    with np.errstate(invalid="ignore", over="ignore"):
        bad = np.flatnonzero(~(np.isfinite(values) & holds(values)))
    if bad.size:
        raise DataError(name, float(values[bad[0]]), accepted, int(bad[0]))


def require_size(name: str, values: Column, unit: str = "") -> None:
    """Raise DataError for the first value that is no positive number, or too small to divide by."""
    require(name, values, lambda u: u > 0, f"a positive number{unit and ' in '}{unit}")
    require(name, values, lambda u: u >= LEAST, f"{LEAST:g} {unit}".strip() + " or more")


def check_lengths(columns: Mapping[str, np.ndarray]) -> None:
    """Raise DataError where the columns differ in length."""
    first = next(iter(columns), "")
    for name, column in columns.items():
        if column.shape != columns[first].shape:
            accepted = f"as long as `{first}`, {len(columns[first])}"
            raise DataError(name, f"{len(column)} long", accepted)
