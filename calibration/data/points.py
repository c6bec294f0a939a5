"""The rows of a table as impacts: velocity, restitution, and the errors of what was measured.

How readings become v and ε is in `calibration.data.kinds`. Rows of which something needed was not measured (NaN) are left out, with a remark; those of
one launch, and group, are adjacent and leave no gap: their cells of `uncertainty` and
`velocity_uncertainty` are read in the row of tₙ, or of Tₙ₊₁, alone.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Int

from calibration.data.checks import (
    Column,
    codes_of,
    require,
)
from calibration.data.columns import LABELS, OBSERVED, SI_UNITS
from calibration.data.contact_time import of_bodies
from calibration.data.point_errors import PointErrors, paired
from calibration.data.rows import (
    Rows,
)
from calibration.errors import DataError, listed

FASTEST_FALL = 20.0  # m/s, of more than 20 m
FALLEN = "impact velocities follow from the "  # a remark: drop heights or times of flight
FALLS = "falls as fast as"  # a remark on those that are faster
HIGHER = 0.05  # of ε above 1, from which on no noise brings a bounce that is higher than the last
SURE = 4.0  # standard errors


class Points(NamedTuple):
    """n impacts: v [m/s], ε, their errors, the row of each, and remarks.

    Attributes:
        degrees: degrees of freedom behind the errors, (n,); None where they are stated or unknown.
        tracks: the `calibration.data.tracks.BounceTrack`s that they are from.
        group: a label for each, (n,), where that is not in a column.
    """

    velocity: Column
    restitution: Column
    errors: PointErrors
    rows: Int[np.ndarray, " n"]
    remarks: tuple[str, ...]
    degrees: Column | None = None
    tracks: tuple[Any, ...] = ()
    group: np.ndarray | None = None


@contextmanager
def rows_blamed(rows: np.ndarray | None = None) -> Iterator[None]:
    """Refusals of points as those of their rows in the table, where NaN is an empty cell."""
    try:
        yield
    except DataError as error:
        index = error.index if rows is None or error.index is None else int(rows[error.index])
        value = "empty" if error.value == "nan" else error.value
        raise DataError(error.argument, value, error.accepted, index) from None


def points_of(rows: Rows) -> Points:
    """The impacts of the rows; raises DataError with the row to blame."""
    with np.errstate(all="ignore"):  # what is not finite in the end is refused
        return (_sequences if rows.kind.is_sequence else _single_impacts)(rows)


def observed_of(rows: Rows, points: Points) -> dict[str, np.ndarray]:
    """Observables other than ε of each point, and their uncertainties."""
    rows = rows.take(points.rows)
    columns = {name: rows.columns[name] for name in OBSERVED if name in rows.columns}
    for name in [*columns]:
        if (uncertainty := rows.uncertainty(f"{name}_uncertainty", columns[name])) is not None:
            columns[f"{name}_uncertainty"] = uncertainty
    if rows.kind.is_flight and "contact_time" in columns:
        flight = 2 * points.velocity / rows.gravity
        for row in np.flatnonzero(columns["contact_time"] >= flight):
            accepted = f"shorter than the flight, {flight[row]:.3g} s"
            raise DataError(
                "contact_time", float(columns["contact_time"][row]), accepted, int(points.rows[row])
            )
    return columns


# ---------------------------------------------------------------- an impact by two quantities


def _impacts(rows: Rows, first: Column, second: Column, floor: Column, index: Any, sizes: Any):
    """v, ε, their errors, and remarks, of what was measured before and after.

    `floor`: where the slope in `second` is taken; `index`, `sizes`: of the input errors.
    """
    kind, gravity, air = rows.kind, rows.gravity, rows.air
    if kind.is_flight and kind.needs[0] in rows.assumed:
        _check_assumed(rows, first)
    impacts = kind.impacts(first, second, floor, gravity, air)
    velocity, restitution = impacts.velocity, impacts.restitution
    remarks: tuple[str, ...] = ()
    if air is not None:
        vacuum = kind.impacts(first, second, floor, gravity, None)
        remarks = air.remarks(velocity, restitution, (vacuum.velocity, vacuum.restitution))
    if kind.is_flight:
        remarks = (*remarks, FALLEN + kind.fallen)
        fastest = float(np.max(velocity))
        if FASTEST_FALL < fastest < np.inf:  # from higher than anybody drops a ball, in air too
            height = fastest * (fastest / (2 * gravity))
            remarks = (*remarks, f"{FALLS} {fastest:.3g} m/s, from {height:.3g} m")
    to_restitution, to_velocity = kind.shared(impacts)
    errors = PointErrors(
        index, to_restitution, to_velocity, sizes, kind.name, by_drag=impacts.by_drag
    )
    return velocity, restitution, errors, remarks


def _check_assumed(rows: Rows, first: Column) -> None:
    """Refuse readings without a unit that would be of falls from higher than anybody drops a ball."""
    fastest = float(np.nanmax(rows.kind.in_vacuum(first, rows.gravity)))
    if fastest > FASTEST_FALL:
        name, height = rows.kind.needs[0], fastest**2 / (2 * rows.gravity)
        si = SI_UNITS[name]
        accepted = f"with its unit in the header, as in `{name} [m{si}]`: in {si} balls would fall {height:.3g} m"
        raise DataError(name, f"{float(np.nanmax(first)):.6g} without a unit", accepted)


def _with_own(errors: PointErrors, rows: Rows, velocity: Column, restitution: Column):
    """The errors with what is stated of each ε and each v, and remarks on it."""
    u = rows.uncertainty("uncertainty", restitution)
    of_velocity = rows.uncertainty("velocity_uncertainty", velocity)
    remarks: tuple[str, ...] = ()
    if u is not None:
        u = np.where(np.isnan(restitution), 1.0, u)  # of what was not measured
        if errors.size_is_unknown:  # stated of each ε: nothing is left to estimate
            errors = replace(PointErrors.independent(len(errors)), by_drag=errors.by_drag)
        elif errors.measured_by.has_readings:
            remarks = (f"uncertainty is added to that of the {errors.kind}",)
    if errors.measured_by.has_velocity:
        of_velocity = None
    return replace(errors, u_restitution=u, u_velocity=of_velocity), remarks


# ---------------------------------------------------------------- single impacts, one a row


def _single_impacts(rows: Rows) -> Points:
    complete, left_out = _complete(rows)
    rows, count = rows.take(complete), len(complete)
    with rows_blamed(complete):
        if rows.kind.has_readings:
            velocity, restitution, errors, remarks = _of_pairs(rows)
        else:
            velocity = rows.columns["velocity"]
            restitution = rows.columns.get("restitution", np.full(count, np.nan))
            errors, remarks = PointErrors.independent(count), ()
        errors, added = _with_own(errors, rows, velocity, restitution)
    return Points(velocity, restitution, errors, complete, (*left_out, *remarks, *added))


def _complete(rows: Rows) -> tuple[np.ndarray, tuple[str, ...]]:
    """The rows with all needed values; another observable may replace a rebound."""
    first, *others = (np.isnan(rows.columns[name]) for name in rows.kind.needs)
    is_measured = [np.isfinite(rows.columns[name]) for name in OBSERVED if name in rows.columns]
    other, nothing = np.any(is_measured, axis=0), not rows.kind.has_restitution
    missing = first | ((np.any(others, axis=0) | nothing) & ~other)
    if not np.any(missing):
        return np.arange(len(missing)), ()
    if np.all(missing):
        raise DataError("set of rows", "empty", f"one with {listed(rows.kind.needs)}, or more")
    count, row, origin = int(np.sum(missing)), int(np.argmax(missing)), rows.origin
    first_is = f"row {row + 1}" if origin is None else f"line {origin.line_of(row)}"
    remark = f"{count} row(s) without a measurement are left out, the first of them {first_is}"
    return np.flatnonzero(~missing), (remark,)


def _of_pairs(rows: Rows) -> tuple[Column, Column, PointErrors, tuple[str, ...]]:
    """v, ε and errors of two velocities, or of two heights, of which the second may be missing."""
    names, positive, not_negative, swapped = rows.kind.limits
    first = rows.columns[names[0]]
    second = rows.columns[names[1]] if names[1] in rows.kind.needs else np.full(len(first), np.nan)
    is_measured = np.isfinite(second)
    second = np.where(is_measured, second, 0.0)
    remarks: tuple[str, ...] = ()
    of_one_sign = np.all(first > 0) or np.all(first < 0)
    if rows.kind.has_signs and of_one_sign and np.all(first * second <= 0):
        first, second = np.abs(first), np.abs(second)
        remarks = ("the signs of velocities before and after the impact are ignored",)
    require(names[0], first, lambda x: x > 0, positive)
    require(names[1], second, lambda x: x >= 0, not_negative)
    for row in np.flatnonzero(second > swapped * first):
        accepted = f"at most its {names[0]}, {first[row]:.6g}, or little more; "
        accepted += "are both in the same unit, and in this order?"
        raise DataError(names[1], float(second[row]), accepted, int(row))
    sizes, stated = _sizes_of_pairs(rows, names, (first, second))
    # the slope of √h is infinite at h = 0: there u(ε) is to be the ε that a height of u gives
    floor = second if sizes is None else np.maximum(second, sizes[1] / 4)
    every_size = None if sizes is None else np.ravel(sizes, "F")
    index = paired(len(first))
    velocity, restitution, errors, added = _impacts(rows, first, second, floor, index, every_size)
    if sizes is None:
        errors = replace(PointErrors.independent(len(first)), by_drag=errors.by_drag)
    restitution = np.where(is_measured, restitution, np.nan)
    return velocity, restitution, errors, (*remarks, *stated, *added)


def _sizes_of_pairs(rows: Rows, names: tuple[str, str], values: tuple[Column, Column]):
    """Standard uncertainties of both columns, None where none is stated, and remarks on them."""
    both, each = rows.kind.uncertainties[-1], [f"{name}_uncertainty" for name in names]
    if both in rows.columns:
        each, remarks = [both] * 2, [f"{both} applies to both {names[0]} and {names[1]}"]
    elif not {*each} & {*rows.columns}:
        return None, ()
    else:
        exact = [n for n in names if f"{n}_uncertainty" not in rows.columns]
        remarks = [f"{n} is treated as exact: no uncertainty of it is stated" for n in exact]
    sizes = []
    for name, x in zip(each, values, strict=True):
        size = rows.uncertainty(name, x)
        sizes.append(np.zeros(len(x)) if size is None else size)
        what = f"uncertainty of the {rows.kind.name}"
        require(what, sizes[-1], lambda u: u >= 0, "a number of 0 or more")
    return sizes, remarks if names[1] in rows.kind.needs else ()


# ---------------------------------------------------------------- bounces that follow each other


def _sequences(rows: Rows) -> Points:
    kept, left_out = _without_last(rows)
    rows = rows.take(kept)
    (name,) = rows.kind.needs
    span = rows.kind.span
    with rows_blamed(kept):
        sequence = np.cumsum(_breaks(rows))
        sizes = _timing(rows, name)
        reading, of_contact = _without_contact(
            rows, name, _flights(rows, name, sequence, sizes), sequence
        )
    first = np.flatnonzero(sequence[span:] == sequence[:-span])
    if not first.size:
        accepted = f"of {span + 1} adjacent rows or more"
        raise DataError("launch", f"of {span} row(s) everywhere", accepted)
    taken, after = first + span - 1, reading[first + 1]
    used = rows.take(taken)
    index = first[:, None] + np.arange(3)
    index[:, 1 + span :] = -1
    numbers = np.unique(index[index >= 0])
    index = np.where(index < 0, -1, np.searchsorted(numbers, index))
    sizes = None if sizes is None else sizes[numbers]
    velocity, restitution, errors, of_air = _impacts(
        used, reading[first], after, after, index, sizes
    )
    with rows_blamed(kept[taken]):
        errors, added = _with_own(errors, used, velocity, restitution)
    short = int(np.sum(np.bincount(sequence) <= span))
    remarks = [
        f"{short} launch(es) of {rows.kind.too_short} give no restitution and are not used"
    ] * bool(short)
    if rows.kind.is_timed and not of_contact:
        of_contact = _contact_left_in(reading[first], restitution)
    remarks = [*left_out, *remarks, *of_contact, *added, *of_air]
    return Points(velocity, restitution, errors, kept[taken], tuple(remarks))


def _without_contact(
    rows: Rows, name: str, interval: Column, sequence: np.ndarray
) -> tuple[Column, tuple[str, ...]]:
    """Times of flight: from bounce to bounce less the contact that each interval begins with, and a remark.

    Hertz's duration is taken at the velocity of the arrival, g T/2 of the flight before it; of the first bounce at
    that of its own flight over the ratio of the next two. Example: of 0.396 s with a contact of 4 ms at ε = 0.8
    remain 0.392 s, which lowers ε by 0.2 · 4/396 = 0.002.
    """
    contact = of_bodies(rows.contact) if rows.bounce_contact is None else rows.bounce_contact
    if contact is None or not rows.kind.is_timed:
        return interval, ()
    count = len(interval)
    follows = np.append(False, sequence[1:] == sequence[:-1])[:count]
    before, after = np.append(interval[:1], interval[:-1]), np.append(interval[1:], interval[-1:])
    ratio = np.where(np.append(follows[1:], False), after / np.maximum(interval, 1e-300), 1.0)
    arrival = 0.5 * rows.gravity * np.where(follows, before, interval / np.maximum(ratio, 0.1))
    duration = contact.take(count).at(np.maximum(arrival, 1e-300))
    of_launch = np.append(sequence[1:] == sequence[:-1], True)[:count]
    is_one = of_launch | (len(sequence) == count)
    for row in np.flatnonzero((duration >= interval) & is_one):
        accepted = f"shorter than the interval that it is part of, {interval[row]:.4g} s"
        index = None if rows.bounce_contact is not None else int(row)
        raise DataError("bounce_contact_time", f"{float(duration[row]):.4g} s", accepted, index)
    least, most = 1000 * float(np.min(duration)), 1000 * float(np.max(duration))
    size = f"{most:.3g}" if most - least < 1e-3 * most else f"{least:.3g} to {most:.3g}"
    return interval - duration, (f"intervals less the contact of {size} ms, {contact.source}",)


def _contact_left_in(interval: Column, restitution: Column) -> tuple[str, ...]:
    """A remark on how much an unknown contact raises ε."""
    size = float(np.max(1e-3 * (1 - restitution) / interval))
    return (
        f"intervals include the contact: each ms of it raises ε by {size:.2g} at most "
        "(bounce_contact_time takes it out)",
    )


def _without_last(rows: Rows) -> tuple[Int[np.ndarray, " k"], list[str]]:
    """The rows without empty ones at the end of a launch, or an interval of 0 there, as programs write them."""
    values = rows.columns[rows.kind.needs[0]]
    sequence = np.cumsum(_breaks(rows))
    is_none = np.isnan(values) | ((values == 0) & (not rows.kind.has_no_zero))
    # the last of each launch that is there
    last = np.zeros(sequence[-1] + 1, int) - 1
    last[sequence[~is_none]] = np.flatnonzero(~is_none)
    left = np.flatnonzero(np.arange(len(values)) > last[sequence])
    if not len(left) or len(left) == len(values):
        return np.arange(len(values)), []
    text = "empty or 0" if np.any(np.isnan(values[left])) else "0"
    remark = f"{len(left)} {rows.kind.needs[0]}(s) at the end of a launch, {text}, are left out"
    return np.delete(np.arange(len(values)), left), [remark]


def _breaks(rows: Rows) -> np.ndarray:
    """Whether each row begins another launch or group than the one above it."""
    breaks = np.zeros(len(rows.columns[rows.kind.needs[0]]), bool)
    for name in {*LABELS} & {*rows.columns}:
        labels = codes_of(rows.columns[name])
        breaks[1:] |= labels[1:] != labels[:-1]
    return breaks


def _flights(rows: Rows, name: str, sequence: np.ndarray, sizes: Column | None) -> Column:
    """Readings of the flights from each bounce to the next; those from one launch to another mean nothing."""
    values, kind = rows.columns[name], rows.kind
    follows = np.append(False, sequence[1:] == sequence[:-1])
    refused = kind.refused(values, follows)
    if refused is not None:
        row, accepted = refused
        raise DataError(name, float(values[row]), accepted, row)
    flights = kind.flights(values)
    if "group" not in rows.columns and len(flights) > 1:
        # a bounce that is surely higher than the last is the next launch, in a table that names none
        highest = flights[:-1] * (1 + HIGHER) ** (1 / kind.power)
        of_eps = rows.uncertainty("uncertainty", np.ones(len(values)))
        if sizes is not None:
            highest = flights[:-1] + SURE * kind.difference(sizes)
        elif of_eps is not None:
            before = of_eps[kind.span - 1 : kind.span - 1 + len(highest)]
            highest = flights[:-1] * (1 + SURE * np.nan_to_num(before)) ** (1 / kind.power)
        for row in np.flatnonzero(flights[1:] > highest) + 1 + len(values) - len(flights):
            raise DataError(name, float(values[row]), kind.follows, int(row))
    return flights


def _timing(rows: Rows, name: str) -> Column | None:
    """The timing uncertainty of each row; None where it is unknown, one for all."""
    stated = [column for column in rows.kind.uncertainties if column in rows.columns]
    if not stated:
        return None
    if rows.kind.has_no_zero and stated[0] in rows.relative:
        raise DataError(stated[0], "in percent", "in s, ms or us, as times have no zero")
    sizes = rows.uncertainty(stated[0], rows.columns[name])
    require(stated[0], sizes, lambda u: u > 0, "a positive time in s")  # type: ignore[arg-type]
    return sizes
