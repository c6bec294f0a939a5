"""One independent impact per row.

    velocity, restitution
    two velocities    v = v_in,         ε = v_out/v_in     δε = (δv_out - ε δv_in)/v_in
    two heights       v = √(2 g h₁),    ε = √(h₂/h₁)       δε = ε (δh₂/h₂ - δh₁/h₁)/2

in vacuum; in air heights become velocities by `calibration.data.air`.

Rows of which something needed was not measured (NaN) are left out, with a remark.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from calibration.data.checks import Column, require
from calibration.data.columns import HEIGHTS, VELOCITIES
from calibration.data.errors_of_points import PointErrors, paired, three
from calibration.data.names import OBSERVED
from calibration.data.points import Measured, Points, of_falls, of_row, with_own
from calibration.data.trains import runs
from calibration.errors import DataError, listed

OFF = 4.0  # standard uncertainties by which ε may differ from the other columns of its row
OFF_UNKNOWN = 0.05  # the same where none is stated
SWAPPED = 1.25  # ε beyond which two columns are exchanged or not in one unit
HEIGHT = "a height of 0 m or more"


def single_points(table: Measured) -> Points:
    """The impacts of a table of single rows.

    Raises:
        DataError: naming the column, and the row where one is to blame.
    """
    rows, left_out = _complete(table)
    table = table.take(rows)
    columns = table.columns
    try:
        velocity, restitution, errors, remarks = _MAKERS[table.kind.needs](table)
        if set(HEIGHTS) <= set(columns):
            _check_heights(table, restitution)
        elif table.kind.needs == VELOCITIES and "restitution" in columns:
            _check(table, restitution, f"{VELOCITIES[1]}/{VELOCITIES[0]}")
        if "restitution" in columns and not (
            table.air is not None and _without_air(table, restitution)
        ):
            restitution = columns["restitution"]
        elif "restitution" in columns:
            remarks = (
                *remarks,
                "restitution is √(rebound_height/drop_height): it is corrected for air too",
            )
        errors, added = with_own(errors, table, velocity, restitution)
    except DataError as error:
        raise of_row(error, rows) from None
    group = columns.get("group")
    if group is None and "launch" in columns:
        group = runs(columns["launch"])
    return Points(velocity, restitution, errors, rows, group, (*left_out, *remarks, *added))


def _complete(table: Measured) -> tuple[np.ndarray, tuple[str, ...]]:
    """The rows where all that is needed was measured; something else may stand for a rebound."""
    first, *others = (np.isnan(table.columns[name]) for name in table.kind.needs)
    seen = [np.isfinite(table.columns[name]) for name in OBSERVED if name in table.columns]
    other, nothing = np.any(seen, axis=0), not table.kind.has_restitution
    missing = first | ((np.any(others, axis=0) | nothing) & ~other)
    if not np.any(missing):
        return np.arange(len(missing)), ()
    if np.all(missing):
        raise DataError("set of rows", "empty", f"one with {listed(table.kind.needs)}, or more")
    count, first = int(np.sum(missing)), int(np.argmax(missing)) + 1
    remark = f"{count} row(s) without a measurement are left out, the first of them row {first}"
    return np.flatnonzero(~missing), (remark,)


def _as_they_are(table: Measured):
    velocity, restitution = table.columns["velocity"], table.columns["restitution"]
    return velocity, restitution, PointErrors.alone(len(velocity)), ()


def _velocity_alone(table: Measured):
    velocity = table.columns["velocity"]
    return velocity, np.full(len(velocity), np.nan), PointErrors.alone(len(velocity)), ()


def _fall_alone(table: Measured):
    """The fall of two heights of which the second was not measured."""
    rebound = np.zeros(len(table.columns[HEIGHTS[0]]))
    both = table._replace(columns={**table.columns, HEIGHTS[1]: rebound})
    velocity, _, errors, remarks = _two_heights(both)
    remarks = tuple(one for one in remarks if HEIGHTS[1] not in one)
    return velocity, np.full(len(velocity), np.nan), errors, remarks


def _two_velocities(table: Measured):
    before, after = (table.columns[name] for name in VELOCITIES)
    seen = np.isfinite(after)
    after = np.where(seen, after, 0.0)
    remarks: tuple[str, ...] = ()
    if np.all(before * after <= 0) and (np.all(before > 0) or np.all(before < 0)):
        before, after = np.abs(before), np.abs(after)
        remarks = ("the signs of velocities before and after the impact are ignored",)
    require(VELOCITIES[0], before, lambda v: v > 0, "a positive speed in m/s")
    require(VELOCITIES[1], after, lambda v: v >= 0, "a speed of 0 m/s or more")
    _require_less(VELOCITIES, before, after, SWAPPED)
    restitution = np.where(seen, after / before, np.nan)
    sizes, more = _sizes(table, VELOCITIES, "velocity_uncertainty", (before, after))
    to_restitution = three(-(after / before) / before, 1 / before)
    errors = _paired(to_restitution, three(np.ones(len(before))), sizes, "velocities")
    return before, restitution, errors, remarks + more


def _two_heights(table: Measured):
    drop, rebound = (table.columns[name] for name in HEIGHTS)
    seen = np.isfinite(rebound)
    rebound = np.where(seen, rebound, 0.0)
    require(HEIGHTS[0], drop, lambda h: h > 0, "a positive height in m")
    require(HEIGHTS[1], rebound, lambda h: h >= 0, HEIGHT)
    _require_less(HEIGHTS, drop, rebound, SWAPPED**2)
    restitution, velocity = np.sqrt(rebound / drop), np.sqrt(2 * table.gravity * drop)
    sizes, remarks = _sizes(table, HEIGHTS, "height_uncertainty", (drop, rebound))
    # the slope of √h is infinite at h = 0: there u(ε) is to be the ε that a height of u gives
    least = rebound if sizes is None else np.maximum(rebound, sizes[1] / 4)
    to_rebound = np.where(least > 0, 0.5 / np.sqrt(drop * np.where(least > 0, least, 1)), 0.0)
    by_drop, faster, by_drag = -restitution / (2 * drop), velocity / (2 * drop), None
    if (air := table.air) is not None:
        before, velocity = (velocity, restitution), air.fall(drop)
        restitution, faster = air.rise(rebound) / velocity, air.slope("fall", drop)
        by_drop, to_rebound = -restitution * faster / velocity, air.slope("rise", least) / velocity
        slower = air.by_drag("fall", drop)
        of_rebound = air.by_drag("rise", rebound) - restitution * slower
        by_drag = np.stack([of_rebound / velocity, slower], axis=1)
        remarks = (*remarks, *air.remarks(velocity, restitution, before))
    errors = _paired(three(by_drop, to_rebound), three(faster), sizes, "heights")
    errors, restitution = replace(errors, by_drag=by_drag), np.where(seen, restitution, np.nan)
    return velocity, restitution, errors, (*remarks, *of_falls(velocity, table.gravity))


def _require_less(names, before: Column, after: Column, most: float) -> None:
    """Raise where more comes back than noise brings: `most` times what came."""
    slip = after > most * before
    if not np.any(slip):
        return
    row = int(np.argmax(slip))
    accepted = (
        f"at most its {names[0]}, {before[row]:.6g}, or little more; are both in the same unit, "
        "and in this order?"
    )
    raise DataError(names[1], float(after[row]), accepted, row)


_MAKERS: dict[tuple[str, ...], Callable[[Measured], Any]] = {
    ("velocity", "restitution"): _as_they_are,
    ("velocity",): _velocity_alone,
    HEIGHTS[:1]: _fall_alone,
    VELOCITIES: _two_velocities,
    HEIGHTS: _two_heights,
}


def _sizes(table: Measured, names, of_both: str, values):
    """Standard uncertainties of two measured columns; None where neither is stated."""
    each = [table.uncertainty(f"{n}_uncertainty", x) for n, x in zip(names, values, strict=True)]
    if of_both in table.columns:
        twice = [name for name, one in zip(names, each, strict=True) if one is not None]
        if twice:
            raise DataError(f"{twice[0]}_uncertainty", f"given with {of_both}", "given once")
        remarks = (f"{of_both} applies to both {names[0]} and {names[1]}",)
        return [table.uncertainty(of_both, x) for x in values], remarks
    exact = [name for name, one in zip(names, each, strict=True) if one is None]
    if len(exact) == len(names):
        return None, ()
    guessed = tuple(f"{name} is treated as exact: no uncertainty of it is stated" for name in exact)
    return [np.zeros(len(values[0])) if one is None else one for one in each], guessed


def _paired(to_restitution, to_velocity, sizes, kind: str) -> PointErrors:
    """Two input errors a point, which no other point has."""
    count = len(to_restitution)
    if sizes is None:
        return PointErrors.alone(count)
    for size in sizes:  # here, where the row is known
        require(f"uncertainty of the {kind}", size, lambda u: u >= 0, "a number of 0 or more")
    size = np.stack(sizes, axis=1).ravel()
    return PointErrors(paired(count), to_restitution, to_velocity, size, kind)


def _check_heights(table: Measured, restitution: Column) -> None:
    """A restitution given with both heights must be the root of their ratio, not the ratio (ε²)."""
    drop, rebound = (table.columns[name] for name in HEIGHTS)
    if "restitution" in table.columns:
        require(HEIGHTS[0], drop, lambda h: h > 0, "a positive height in m")
        measured = np.isfinite(table.columns["restitution"])
        require(HEIGHTS[1], np.where(measured, rebound, 0.0), lambda h: h >= 0, HEIGHT)
        ratio = rebound / drop
        expected = np.sqrt(ratio) if table.kind.needs != HEIGHTS else restitution
        formula = f"√({HEIGHTS[1]}/{HEIGHTS[0]})" + (" in air" if table.air is not None else "")
        _check(table, expected, formula, ratio)


def _without_air(table: Measured, in_air: Column) -> bool:
    """Whether the restitutions given with two heights were computed from these as if in vacuum."""
    drop, rebound = (table.columns[name] for name in HEIGHTS)
    off = [
        np.nanmedian(np.abs(table.columns["restitution"] - one))
        for one in (np.sqrt(rebound / drop), in_air)
    ]
    return bool(off[0] < off[1])


def _check(table: Measured, expected: Column, formula: str, slip: Column | None = None) -> None:
    """The restitutions given with other measurements must be as expected, and not the likely slip."""
    listed_values = table.columns["restitution"]
    measured = np.where(np.isnan(expected), 0.0, listed_values)
    require("restitution", measured, lambda e: e >= 0, "a number of 0 or more")
    stated = table.uncertainty("uncertainty", listed_values)
    noise = OFF_UNKNOWN if stated is None else OFF * stated
    off = np.abs(listed_values - expected)
    wrong, is_slip = off > noise, np.zeros(len(listed_values), bool)
    if slip is not None:
        is_slip = (np.abs(listed_values - slip) < off) & (np.abs(listed_values - slip) <= noise)
        if 2 * np.sum(is_slip) > len(
            listed_values
        ):  # noise hides it in a point near ε = 1, not in most
            wrong = is_slip
    if np.any(wrong):
        row = int(np.argmax(wrong))
        blame = "the ratio of the heights" if is_slip[row] else "not the one of the same row"
        accepted = f"{formula}, {expected[row]:.6g}, or left out"
        raise DataError("restitution", f"{listed_values[row]:.6g}, {blame}", accepted, row)
