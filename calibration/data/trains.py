"""Points of bounces that follow each other.

    intervals    v = g tₙ/2,  ε = tₙ₊₁/tₙ            δε = (δtₙ₊₁ - ε δtₙ)/tₙ,  δv = g δtₙ/2
    times        tₙ = Tₙ₊₁ - Tₙ in these: the point is that of the bounce at Tₙ₊₁

in vacuum; in air a flight begins and ends with other velocities (`calibration.data.air`).

The rows of one launch, and group, stand together and leave no gap. Cells of `uncertainty` and
`velocity_uncertainty` are read in the row of tₙ, or of Tₙ₊₁, alone.
"""

from dataclasses import replace

import numpy as np

from calibration.data.checks import Column, codes_of, require
from calibration.data.errors_of_points import TOUCHED, PointErrors, three
from calibration.data.points import Measured, Points, of_falls, of_row, with_own
from calibration.errors import DataError

HIGHER = 1.3  # times the interval before: no noise


def train_points(table: Measured) -> Points:
    """The impacts of a table of intervals or times.

    Raises:
        DataError: naming the column, and the row where one is to blame.
    """
    (name,) = table.kind.needs
    span = 1 + (name == "time")  # rows from the first to the last that a point needs
    try:
        train = _trains(table)
        interval = _intervals(table, name, train)
        sizes = _sizes(table, name)
    except DataError as error:
        raise of_row(error, np.arange(len(table.columns[name]))) from None
    first = np.flatnonzero(train[span:] == train[:-span])
    if not first.size:
        accepted = f"of {span + 1} rows or more, which stand together"
        raise DataError("launch", f"of {span} row(s) everywhere", accepted)
    rows, before = first + span - 1, interval[first]
    used, after = table.take(rows), interval[first + 1]
    velocity, restitution = table.gravity * before / 2, after / before
    # derivatives of ε in tₙ and in tₙ₊₁, of v in tₙ, and of both in the drag
    slopes = -restitution / before, 1 / before, np.full(len(first), table.gravity / 2)
    by_drag = None
    in_air: tuple[str, ...] = ()
    if (air := used.air) is not None:
        in_vacuum, velocity = (velocity, restitution), air.landing(before)
        restitution, faster = air.take_off(after) / velocity, air.slope("landing", before)
        slopes = -restitution * faster / velocity, air.slope("take_off", after) / velocity, faster
        slower = air.by_drag("landing", before)
        of_next = air.by_drag("take_off", after) - restitution * slower
        by_drag = np.stack([of_next / velocity, slower], axis=1)
        in_air = air.remarks(velocity, restitution, in_vacuum)
    errors = replace(_errors(first, slopes, sizes, name), by_drag=by_drag)
    try:
        errors, remarks = with_own(errors, used, velocity, restitution)
    except DataError as error:
        raise of_row(error, rows) from None
    group = used.columns.get("group")
    if group is None and "launch" in table.columns:
        group = runs(table.columns["launch"])[rows]
    remarks = (*_lonely(train, span), *remarks, *in_air, *of_falls(velocity, table.gravity))
    return Points(velocity, restitution, errors, rows, group, remarks)


def runs(labels: np.ndarray) -> np.ndarray:
    """Labels of launches, rows that stand together: one that comes back is another, `1 (2)`."""
    fresh = np.concatenate([[True], labels[1:] != labels[:-1]])
    count: dict[str, int] = {}
    names = []
    for label in labels[fresh]:
        count[label] = count.get(label, 0) + 1
        names.append(label if count[label] == 1 else f"{label} ({count[label]})")
    return np.array(names, dtype=object)[np.cumsum(fresh) - 1]


def _trains(table: Measured) -> np.ndarray:
    """A number for each run of rows of one launch and one group."""
    breaks = np.zeros(len(table.columns[table.kind.needs[0]]), bool)
    for name in ("launch", "group"):
        if name in table.columns:
            labels = codes_of(table.columns[name])
            breaks[1:] |= labels[1:] != labels[:-1]
    return np.cumsum(breaks)


def _intervals(table: Measured, name: str, train: np.ndarray) -> Column:
    """Times from each bounce to the next; those from one launch to another mean nothing."""
    values = table.columns[name]
    if name == "interval":
        require(name, values, lambda t: t > 0, "a positive time in s: no gap within a launch")
        steps = values
    else:
        require(name, values, np.isfinite, "a time in s: no gap within a launch")
        steps = np.diff(values)
        back = (steps <= 0) & (train[1:] == train[:-1])
        if np.any(back):
            row = int(np.argmax(back)) + 1
            accepted = "later than the one above it (a launch column separates launches)"
            raise DataError(name, float(values[row]), accepted, row)
    if "launch" not in table.columns and "group" not in table.columns:
        _check_one_launch(values, steps, name)
    return steps


def _check_one_launch(values: Column, steps: Column, name: str) -> None:
    """A bounce much higher than the last is the next launch, in a table that names none."""
    higher = steps[1:] > HIGHER * steps[:-1]
    if np.any(higher):
        row = int(np.argmax(higher)) + 1 + len(values) - len(steps)
        what = "shorter than the one above" if name == "interval" else "sooner"
        accepted = f"{what} (a launch column separates launches)"
        raise DataError(name, float(values[row]), accepted, row)


def _sizes(table: Measured, name: str) -> Column | None:
    """The timing uncertainty of each row; None where it is unknown, one for all."""
    columns = [one for one in (f"{name}_uncertainty", "timing_uncertainty") if one in table.columns]
    if len(columns) == 2:
        raise DataError(columns[1], f"given with {columns[0]}", "given once")
    if not columns:
        return None
    if name == "time" and columns[0] in table.relative:
        raise DataError(columns[0], "in percent", "in s, ms or us, as times have no zero")
    sizes = table.uncertainty(columns[0], table.columns[name])
    assert sizes is not None  # its column is there
    require(columns[0], sizes, lambda u: u > 0, "a positive time in s")
    return sizes


def _errors(first, slopes, sizes, name: str) -> PointErrors:
    """Errors of tₙ and tₙ₊₁, or of Tₙ, Tₙ₊₁ and Tₙ₊₂, for each point."""
    index = first[:, None] + np.arange(TOUCHED)
    down, up, faster = slopes
    if name == "interval":
        index[:, 2] = -1
        to_restitution, to_velocity = three(down, up), three(faster)
    else:
        to_restitution, to_velocity = three(-down, down - up, up), three(-faster, faster)
    used = np.unique(index[index >= 0])
    index = np.where(index < 0, -1, np.searchsorted(used, index))
    sizes = None if sizes is None else sizes[used]
    return PointErrors(index, to_restitution, to_velocity, sizes, f"{name}s")


def _lonely(train: np.ndarray, span: int) -> tuple[str, ...]:
    count = int(np.sum(np.bincount(train) <= span))
    if not count:
        return ()
    what = "a single interval" if span == 1 else "fewer than three bounces"
    return (f"{count} launch(es) of {what} give no restitution and are not used",)
