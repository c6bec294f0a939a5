"""The rows of a table in SI: its columns, what is stated for all of them, the bodies, gravity and air.

Rows of one launch, and group, are adjacent. An uncertainty may be stated for all rows, with its unit.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

import softjax as sj
from calibration.data.air import Air, Fall, checked_air
from calibration.data.bodies import Body
from calibration.data.checks import (
    Column,
    as_labels,
    as_number,
    as_numbers,
    check_lengths,
    require,
)
from calibration.data.columns import LABELS, SI_UNITS, SIZES, UNCERTAINTIES
from calibration.data.contact_time import ContactTime
from calibration.data.inputs import corrected
from calibration.data.kinds import OF_HEIGHTS, Kind
from calibration.data.layout import MOST_NAMED, Layout, layout_of
from calibration.data.units import in_si, parted, unit_of
from calibration.data.unused import Unused, as_cells, check_numbered, check_unused, launches_of
from calibration.data.words import BOUNCED
from calibration.errors import DataError, Origin, did_you_mean, listed

STANDARD_GRAVITY = 9.80665  # m/s²
NOT_CORRECTED = (
    "not corrected for air: size and mass of the ball are not given (air = false: none is needed)"
)


class Rows(NamedTuple):
    """The rows of a table in SI, NaN where a cell is empty.

    Attributes:
        relative: uncertainties in parts of their quantity.
        gravity: g [m/s²].
        contact: that of the two bodies, of arrays where a column has their sizes; None if unknown.
        bodies: the two bodies, () if unknown.
        assumed: which units of a file are missing and taken for SI; "" for none.
        air: None where flights are not corrected.
        bounce_contact: what is stated of how long a bounce lasts; None: nothing.
    """

    kind: Kind
    columns: Mapping[str, np.ndarray]
    relative: frozenset[str]
    gravity: float
    contact: sj.Contact | None
    bodies: tuple[Body, ...]
    air: Air | None
    fall: Fall | None
    remarks: tuple[str, ...]
    origin: Origin | None
    assumed: str
    bounce_contact: ContactTime | None = None

    def uncertainty(self, name: str, of: Column) -> Column | None:
        """The uncertainty of `of` in the column of that name, None where there is none."""
        if name not in self.columns:
            return None
        return self.columns[name] * np.abs(of) if name in self.relative else self.columns[name]

    def take(self, rows) -> "Rows":
        columns = {name: column[rows] for name, column in self.columns.items()}
        return self._replace(
            columns=columns,
            contact=contact_of_rows(self.contact, rows),
            bodies=tuple(body.take(rows) for body in self.bodies),
            air=None if self.air is None else self.air.take(rows),
        )


def read_rows(
    table: Mapping[str, Any],
    pair: "Pair",
    uncertainties: Mapping[str, Any],
    gravity: float | None,
    group: Sequence[Any] | None,
    air: Any,
    origin: Origin | None,
    bounce_contact: ContactTime | None,
    instruments: Mapping[str, float],
) -> Rows:
    """The used columns of a table (see `RestitutionData.from_table`), with the bodies of each row.

    `origin`: of a file, whose assumed units are a remark. `instruments`: scales and offsets of readings.
    """
    headers = headers_of(table)
    for_all = dict(_heading(*stated) for stated in uncertainties.items())
    layout = layout_of([*map(str, headers)], [*for_all])
    kind, columns = layout.kind, {}
    # a file's cells are text
    numbers_of: Any = getattr(type(table), "numbers_of", None)
    text_of: Any = getattr(type(table), "text_of", None)
    for name, at in layout.position.items():
        if at < len(headers):
            is_sheet = numbers_of is not None and name not in LABELS
            values = numbers_of(table, headers[at], name) if is_sheet else table[headers[at]]
        else:
            stated = [*for_all.values()][at - len(headers)]
            number = as_number(name, stated, lambda _: True, "a number")
            values = np.full(len(columns[kind.needs[0]]), number)
        with np.errstate(over="ignore"):  # what is not finite is refused as the quantity that it is
            columns[name] = (
                as_labels(name, values)
                if name in LABELS
                else in_si(as_numbers(name, values), layout.units[name])
            )
    for name in uncertainties:
        if name not in columns:
            raise DataError(name, "given", f"left out with {' and '.join(kind.needs)}")
    for name in {*UNCERTAINTIES} & {*columns}:
        _check_unit(name, uncertainties.get(name), layout)
    if group is not None:
        if "group" in columns:
            raise DataError("group", "both a column and an argument", "given once")
        columns["group"] = as_labels("group", group)
    check_lengths(columns)
    columns = corrected(columns, instruments)
    for name in {*kind.uncertainties[:-1]} & {*columns}:
        if kind.uncertainties[-1] in columns:
            raise DataError(name, f"given with {kind.uncertainties[-1]}", "given once")
    unused = [
        Unused(
            str(headers[at]),
            text_of(table, headers[at]) if text_of else as_cells(table[headers[at]]),
        )
        for at in layout.unused
        if str(headers[at]).strip()
    ]
    remarks = _divided(kind, unused, columns)
    if "launch" in columns:
        columns.setdefault("group", _launches(columns["launch"]))
    for name in {*SIZES} & {*columns}:
        require(name, columns[name], lambda x: x > 0, "a positive number in each row")
    if gravity is not None and not kind.is_flight:
        raise DataError("gravity", "given", "left out where velocities are given")
    if bounce_contact is not None and not kind.is_timed:
        accepted = "left out but for times between bounces, and tracks"
        raise DataError("bounce_contact_time", "given", accepted)
    g = checked_gravity(gravity)
    sizes = {name: columns[name] for name in SIZES if name in columns}
    contact, bodies = pair.of_rows(sizes)
    around, of_air = air_of(air, pair.ball.of_rows(**sizes), kind, g)
    assumed = layout.assumed * (origin is not None)
    remarks = (*layout.remarks, *remarks, *filter(None, [assumed]), *of_air)
    fall = _fall(layout, around, g)
    used = kind, columns, layout.relative, g, contact, bodies, around, fall
    return Rows(*used, remarks, origin, assumed, bounce_contact)


def _divided(kind: Kind, unused: Sequence[Unused], columns: dict[str, Any]) -> tuple[str, ...]:
    """Refuse unused columns that make several experiments of the rows; those of bounces give their launches."""
    launches = None
    if kind.is_sequence and "launch" not in columns:
        launches = launches_of(unused)
    rest = [column for column in unused if launches is None or column.heading not in launches[0]]
    if kind.is_numbered:
        check_numbered([column for column in unused if column.words & BOUNCED])
    settings = {n: columns[n] for n in kind.needs[:1] if n in columns and not kind.is_sequence}
    check_unused(rest, settings, "group" in columns or (kind.is_sequence and "launch" in columns))
    left = [
        repr(column.heading[:40])
        for column in rest
        if not (kind.is_numbered and column.words & BOUNCED)
    ]
    more = f" and {len(left) - MOST_NAMED} more" if len(left) > MOST_NAMED else ""
    remarks = [f"columns not used: {listed(left[:MOST_NAMED])}{more}"] * bool(left)
    if launches is not None:
        headings, labels = launches
        columns["launch"] = as_labels("launch", labels)
        count = 1 + int(np.sum(columns["launch"][1:] != columns["launch"][:-1]))
        named = listed(repr(heading[:40]) for heading in headings)
        remarks = [f"{named} is read as the launch: {count} launches", *remarks]
    return tuple(remarks)


def headers_of(table: Any) -> list[Any]:
    """The headings of a mapping, or of a frame."""
    headers = getattr(table, "columns", None)
    return list(getattr(table, "keys", tuple)() if headers is None else headers)


def checked_gravity(gravity: float | None) -> float:
    """g [m/s²]; raises DataError."""
    g = STANDARD_GRAVITY if gravity is None else gravity
    return as_number("gravity", g, lambda g: g > 0, "a positive acceleration in m/s²")


def _heading(name: str, value: Any) -> tuple[str, Any]:
    """An uncertainty that is stated for all rows, as the heading and the cell of a column."""
    if name not in UNCERTAINTIES:
        raise TypeError(f"unexpected keyword argument {name!r}{did_you_mean(name, UNCERTAINTIES)}")
    if not isinstance(value, str):
        return name, value
    number, unit = parted(value, SI_UNITS[name])
    return f"{name} [{unit}]", number


def _check_unit(name: str, for_all: Any, layout: Layout) -> None:
    """Refuse an uncertainty without a unit, in SI, next to columns in another unit."""
    base = "restitution" if name == "uncertainty" else name.removesuffix("_uncertainty")
    si, written = SI_UNITS[name], layout.written
    values = [base] if base in written or name == "uncertainty" else layout.kind.needs
    units = [written.get(column) for column in values if SI_UNITS.get(column) == si]
    other = next((unit for unit in units if unit is not None and unit_of(unit, si) != 1), None)
    if written[name] is None and other is not None:
        value, either = f"without a unit next to [{other}]", (si.replace("1", "-"), other)
        if for_all is None:
            raise DataError(name, value, " or ".join(f"`{name} [{unit}]`" for unit in either))
        accepted = " or ".join(f'"{for_all} {unit}"' for unit in either)
        raise DataError(name, f"{for_all}, {value}", f"one of {accepted}")


def _launches(labels: np.ndarray) -> np.ndarray:
    """Labels of launches, which are adjacent rows; a label that comes again is another launch, `1 (2)`."""
    fresh = np.concatenate([[True], labels[1:] != labels[:-1]])
    count: Counter[str] = Counter()
    names = []
    for label in labels[fresh]:
        count[label] += 1
        names.append(label if count[label] == 1 else f"{label} ({count[label]})")
    return np.array(names, dtype=object)[np.cumsum(fresh) - 1]


def air_of(air: Any, ball: Body, kind: Kind, gravity: float) -> tuple[Air | None, tuple[str, ...]]:
    """The air of flights, or None if it is ignored, and a remark."""
    density = checked_air(air)
    if density is None or not kind.is_flight:
        return None, ()
    if ball.is_ball:
        around = Air(ball, gravity, density)
        if np.any(around.lightness >= 1):
            light = float(np.min(density / around.lightness))
            accepted = f"above that of air, {density:g} kg/m³; air = false corrects nothing"
            raise DataError("density of the ball", f"{light:.3g} kg/m³", accepted)
        return around, ()
    if isinstance(air, bool | None):
        return None, (NOT_CORRECTED,)
    raise DataError("ball", "missing", "given with air: its diameter, and its mass or density")


def _fall(layout: Layout, air: Air | None, gravity: float) -> Fall | None:
    """Conversion of heights to velocities; None for other columns, and for balls of several sizes."""
    needs = layout.kind.needs
    drop, rebound = OF_HEIGHTS
    if drop not in needs or (air is not None and np.ndim(air.ball.diameter * air.ball.mass)):
        return None
    fall = Fall(layout.written[drop] or "m", gravity, has_rebounds=rebound in needs)
    if air is None:
        return fall
    diameter, mass = float(air.ball.diameter), float(air.ball.mass)
    return replace(fall, density=air.density, diameter=diameter, mass=mass)


class Pair(NamedTuple):
    """The bodies that a table's rows are of.

    Attributes:
        ball: the sphere that flies, as far as it is known.
        contact: of one pair of bodies, or a function that gives it of radii [m], (n,).
        bodies: the two, or a function that gives them of radii; () if unknown.
        one_size: whether sizes in the rows are refused.
    """

    ball: Body
    contact: Any
    bodies: Any
    one_size: bool

    def of_rows(self, sizes: Mapping[str, Column]) -> tuple[sj.Contact | None, tuple[Body, ...]]:
        """Contact and bodies, where the rows have these columns of `SIZES`."""
        if not callable(self.contact):
            if sizes and (self.one_size or self.contact is not None):
                accepted = "given once: as a column, or with the bodies (in Python `contact` is a function "
                accepted += "of the radii where they are a column)"
                raise DataError(
                    next(iter(sizes)), "a column, and the bodies have one size", accepted
                )
            return self.contact, tuple(self.bodies)
        radius = self.ball.of_rows(**sizes).radius
        if not sizes or radius is None:
            accepted = (
                "stated with the bodies, or a column diameter, radius or mass (with the density)"
            )
            raise DataError("radius or diameter", "missing", accepted)
        bodies = self.bodies(radius) if callable(self.bodies) else self.bodies
        return self.contact(radius), tuple(bodies)


def contact_of_rows(contact: sj.Contact | None, rows: Any) -> sj.Contact | None:
    """The contact of some rows."""
    if contact is None or not any(map(np.ndim, contact.leaves().values())):
        return contact
    leaves = contact.leaves().items()
    return sj.Contact(**{n: x[rows] if np.ndim(x) else x for n, x in leaves}, area=contact.area)
