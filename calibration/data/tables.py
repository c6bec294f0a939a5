"""A mapping or a frame of named columns, as points."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from calibration.data.air import Air, Ball, Fall, checked_air
from calibration.data.checks import as_labels, as_number, as_numbers, check_lengths, require
from calibration.data.columns import Kind, Layout, accepts, layout_of
from calibration.data.names import LABELS, OBSERVED, SI_UNITS, SIZES, UNCERTAINTIES
from calibration.data.points import STANDARD_GRAVITY, Measured, Points
from calibration.data.singles import single_points
from calibration.data.trains import train_points
from calibration.data.units import Relative, in_si, quantity, unit_of
from calibration.errors import DataError, did_you_mean

NOT_CORRECTED = (
    "not corrected for air: the ball's diameter, and its mass or density, are not given "
    "(air = false says that no correction is needed)"
)


def read_points(
    table: Mapping[str, Any],
    gravity: float | None,
    group: Sequence[Any] | None,
    uncertainties: Mapping[str, Any],
    of_file: bool = False,
    air: Any = None,
    ball: Callable[[Mapping[str, Any]], Ball | None] = lambda columns: None,
) -> Points:
    """The points of a table (see `RestitutionData.from_table`).

    Args:
        of_file: whether a bare number is refused with a column in another unit than SI's.
        air: True or None, False, or the density of air.
        ball: from the columns, what flies, where that is known.

    Raises:
        DataError: naming the column, and the row where one is to blame.
        TypeError: for an uncertainty that has no such name.
    """
    headers = getattr(table, "columns", None)  # a frame's
    headers = list(getattr(table, "keys", tuple)() if headers is None else headers)
    layout = layout_of([str(header) for header in headers])
    columns = {
        name: _column(name, table[headers[at]], layout) for name, at in layout.position.items()
    }
    relative = set(layout.relative)
    for name in layout.written if of_file else ():
        if name.endswith("uncertainty") and layout.written[name] is None:
            _check_unit(name, None, layout)
    count = len(columns[layout.kind.needs[0]])
    for name, value in uncertainties.items():
        if value is not None:
            if of_file and not isinstance(value, str | Relative):
                _check_unit(name, value, layout)
            stated = _stated(name, value, columns, layout)
            columns[name] = np.full(count, float(stated))
            relative |= {name} if isinstance(stated, Relative) else set()
    if group is not None:
        if "group" in columns:
            raise DataError("group", "both a column and an argument", "given once")
        columns["group"] = as_labels("group", group)
    check_lengths(columns)
    g = _gravity(gravity, layout.kind)
    around, remark = _air(air, ball(columns), layout.kind, g)
    measured = Measured(layout.kind, columns, frozenset(relative), g, around)
    for name in {*SIZES} & {*columns}:
        require(name, columns[name], lambda x: x > 0, "a positive number in each row")
    with np.errstate(all="ignore"):  # what is not finite in the end is refused
        points = train_points(measured) if layout.kind.is_train else single_points(measured)
    more = _more(measured.take(points.rows), points)
    remarks = (*layout.remarks, *points.remarks, *remark)
    return points._replace(remarks=remarks, more=more, fall=_fall(layout, around, g))


def _fall(layout: Layout, air: Air | None, gravity: float) -> Fall | None:
    """Conversion of heights to velocities; None for other columns, and for balls of several sizes."""
    if "drop_height" not in layout.kind.needs:
        return None
    unit = layout.written.get("drop_height") or "m"
    if air is None:
        return Fall(unit, gravity)
    size = air.ball.diameter, air.ball.mass
    return None if any(map(np.ndim, size)) else Fall(unit, gravity, air.density, *map(float, size))


def _more(table: Measured, points: Points) -> dict[str, np.ndarray]:
    """Observables other than ε, their uncertainties, and sizes."""
    found = {name: table.columns[name] for name in (*OBSERVED, *SIZES) if name in table.columns}
    for name in {*OBSERVED} & {*found}:
        uncertainty = table.uncertainty(f"{name}_uncertainty", found[name])
        if uncertainty is not None:
            found[f"{name}_uncertainty"] = uncertainty
    if table.kind.is_flight and "contact_time" in found:
        flight = 2 * points.velocity / table.gravity
        for row in np.flatnonzero(found["contact_time"] >= flight):
            accepted = f"shorter than the flight, {flight[row]:.3g} s"
            value = float(found["contact_time"][row])
            raise DataError("contact_time", value, accepted, int(points.rows[row]))
    return found


def _column(name: str, values: Any, layout: Layout) -> np.ndarray:
    if name in LABELS:
        return as_labels(name, values)
    with np.errstate(over="ignore"):  # what is not finite is refused as the quantity that it is
        return in_si(as_numbers(name, values), layout.units[name])


def _stated(name: str, value: Any, columns: Mapping[str, np.ndarray], layout: Layout) -> float:
    """An uncertainty that is stated for all rows, in SI or `Relative`."""
    if name not in UNCERTAINTIES:
        raise TypeError(f"unexpected keyword argument {name!r}{did_you_mean(name, UNCERTAINTIES)}")
    if name in columns:
        raise DataError(name, "both a column and a number for the set", "given once")
    if not accepts(layout.kind, name, layout.position):
        raise DataError(name, "given", f"left out with {' and '.join(layout.kind.needs)}")
    if isinstance(value, str):
        value = quantity(value, SI_UNITS[name])
    number = as_number(name, value, lambda u: u >= 0, "a number of 0 or more")
    return Relative(number) if isinstance(value, Relative) else number


def _check_unit(name: str, value: Any, layout: Layout) -> None:
    """Refuse a bare number, which is in SI, next to columns in another unit: either may be meant.

    Args:
        value: the number, or None for a column without a unit.
    """
    if name == "uncertainty":
        values: Sequence[str] = ("restitution",)
    else:
        base = name.removesuffix("_uncertainty")
        values = [base] if base in layout.written else layout.kind.needs
    si = SI_UNITS[name]
    units = [layout.written.get(one) for one in values if SI_UNITS.get(one) == si]
    other = next((unit for unit in units if unit is not None and unit_of(unit, si) != 1), None)
    if other is None:
        return
    if value is None:
        accepted = f"`{name} [{si}]` or `{name} [{other}]`"
        raise DataError(name, f"without a unit next to [{other}]", accepted)
    if si != "1":
        both = f'"{value} {si}" or "{value} {other}"'
        raise DataError(name, f"{value}, without a unit next to [{other}]", f"one of {both}")
    require(name, np.atleast_1d(value), lambda u: u <= 1, f"of ε itself, 0.02 for 2 [{other}]")


def _gravity(gravity: float | None, kind: Kind) -> float:
    if gravity is None:
        return STANDARD_GRAVITY
    if not kind.is_flight:
        raise DataError("gravity", "given", "left out where velocities are given")
    return as_number("gravity", gravity, lambda g: g > 0, "a positive acceleration in m/s²")


def _air(air: Any, ball: Ball | None, kind: Kind, gravity: float):
    """The air of flights, or None if it is ignored, and a remark."""
    density = checked_air(air)
    if density is None or not kind.is_flight:
        return None, ()
    if ball is not None:
        return Air(ball, gravity, density), ()
    if isinstance(air, bool | None):
        return None, (NOT_CORRECTED,)
    raise DataError("ball", "missing", "given with air: its diameter, and its mass or density")
