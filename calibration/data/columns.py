"""Columns of a table: which are used, what they mean together, and remarks about the others.

Accepted together are

    velocity, restitution               with the two heights, to check against
    impact_velocity, rebound_velocity   ε = v_out/v_in; a restitution as well is checked and used
    drop_height, rebound_height         v = √(2 g h₁), ε = √(h₂/h₁); the same
    interval                            v = g tₙ/2, ε = tₙ₊₁/tₙ of bounces that follow each other
    time                                of the bounces themselves: the intervals between them
    velocity, or drop_height            with one or more of contact_time, peak_force, peak_overlap
                                        (penetration) and dent_diameter, without a restitution

where several are complete the first of these. With each: `uncertainty` (of ε),
`velocity_uncertainty`, `<column>_uncertainty` of what is measured (`height_uncertainty`: of both
heights, `timing_uncertainty`: of intervals or times), `group` (also `specimen`): rows with a
common error, and `launch`: rows of one bounce sequence, which are a group too; contact_time and so on,
empty where not measured; `diameter`, `radius` or `mass` of the sphere where it changes.
"""

from collections.abc import Iterable, Sequence
from fractions import Fraction
from typing import NamedTuple

from calibration.data.names import AMBIGUOUS, OBSERVED, SI_UNITS, SIZES, Header, read_header
from calibration.data.units import PERCENT, unit_of
from calibration.errors import DataError, listed, shown

MOST_NAMED = 10  # names of columns in a remark


class Kind(NamedTuple):
    """Columns that make a set of data together."""

    needs: tuple[str, ...]
    uncertainties: tuple[str, ...]  # in addition to those of ε and of v
    beside: tuple[str, ...] = ()  # used where all of them are there

    @property
    def is_train(self) -> bool:
        return self.needs in (("interval",), ("time",))

    @property
    def is_flight(self) -> bool:
        """Whether velocities are those of free flights."""
        return self.is_train or HEIGHTS[0] in self.needs

    @property
    def has_restitution(self) -> bool:
        """Whether ε is measured."""
        return self.is_train or len(self.needs) > 1


VELOCITIES = ("impact_velocity", "rebound_velocity")
HEIGHTS = ("drop_height", "rebound_height")
KINDS = (
    Kind(("velocity", "restitution"), (), HEIGHTS),
    Kind(VELOCITIES, tuple(f"{name}_uncertainty" for name in VELOCITIES), ("restitution",)),
    Kind(
        HEIGHTS,
        (*(f"{name}_uncertainty" for name in HEIGHTS), "height_uncertainty"),
        ("restitution",),
    ),
    Kind(("interval",), ("interval_uncertainty", "timing_uncertainty")),
    Kind(("time",), ("time_uncertainty", "timing_uncertainty")),
)
# accepted where something else than ε was measured
WITHOUT_RESTITUTION = (
    Kind(("velocity",), ()),
    Kind(HEIGHTS[:1], ("drop_height_uncertainty", "height_uncertainty")),
)
ACCEPTED_SETS = (
    "velocity with restitution, impact_velocity with rebound_velocity, drop_height with "
    "rebound_height, interval (with launch), or time (with launch); or velocity, or drop_height, with "
    "contact_time, peak_force, penetration or dent_diameter"
)
NO_UNIT = "no unit in the header"  # how a remark begins
OF_EACH_POINT = ("uncertainty", "velocity_uncertainty")


class Layout(NamedTuple):
    """The columns that are used.

    Attributes:
        kind: what they are together.
        position: the place of each among the headers, by name.
        units: the size of each one's unit in SI, by name.
        written: the unit of each as the header has it, None without one.
        relative: the uncertainties among them that are parts of the quantity itself, in percent.
        remarks: how headings were read, and which columns are not used.
        assumed: the same of missing units; empty where none is missing.
    """

    kind: Kind
    position: dict[str, int]
    units: dict[str, Fraction]
    written: dict[str, str | None]
    relative: frozenset[str]
    remarks: tuple[str, ...]
    assumed: str = ""


def layout_of(headers: Sequence[str], units: Sequence[str] | None = None) -> Layout:
    """Meaning of a table's headers, with units that stand in a separate row.

    Raises:
        DataError: for columns that make no set together, a name twice or near to a known one, an
            unknown unit.
    """
    read = [read_header(text) for text in headers]
    if units is not None:
        read = [_with_unit(header, unit) for header, unit in zip(read, units, strict=True)]
    names = _resolved(read)
    kind = _kind_of(names, read)
    used = _used(kind, names)
    _check_once(read, names, used)
    position = {name: place for place, name in enumerate(names) if name in used}
    percent = {name for name in position if read[position[name]].unit == "%"}
    points = {"uncertainty"} if "restitution" in percent else set()  # percentage points
    relative = frozenset(name for name in percent - points if name.endswith("uncertainty"))
    sizes = {
        name: PERCENT if name in relative else _unit(read[place], name)
        for name, place in position.items()
    }
    measured = (*kind.needs, *OBSERVED, *SIZES)
    untold = [name for name in measured if name in position and read[position[name]].unit is None]
    remarks = (*_remarks(read, names, used), *_of_percent(relative, percent & points))
    written = {name: read[place].unit for name, place in position.items()}
    return Layout(kind, position, sizes, written, relative, remarks, _assumed(untold))


def accepts(kind: Kind, uncertainty: str, names: Iterable[str | None]) -> bool:
    """Whether an uncertainty of this name acts for data of this kind, of columns of these names."""
    if uncertainty.removesuffix("_uncertainty") in OBSERVED:
        return uncertainty.removesuffix("_uncertainty") in names
    extra = OF_EACH_POINT if kind.has_restitution else OF_EACH_POINT[1:]
    return uncertainty in (*extra, *kind.uncertainties)


def _with_unit(header: Header, unit: str) -> Header:
    unit = unit.strip().strip("[]()").strip()
    if not unit or header.name is None:
        return header
    if header.unit is not None and header.unit != unit:
        problem = f"[{header.unit}] in its name and [{shown(unit)}] below"
        raise DataError(f"unit of {header.name}", problem, "given once")
    return header._replace(unit=unit)


def _resolved(read: Sequence[Header]) -> list[str | None]:
    """The name of each column, pairs identified by each other."""
    names = [header.name for header in read]
    if "rebound_height" not in names:
        first, second = ("h1", "h_1"), ("h2", "h_2")
        if "drop_height" not in names and {*second} & {*names}:
            _rename(names, first, "drop_height")
        if "drop_height" in names:
            _rename(names, second if {*second} & {*names} else first, "rebound_height")
    for end in ("", "_uncertainty"):
        if "rebound_velocity" not in names:
            _rename(names, (f"impact_velocity{end}",), f"velocity{end}")
        elif not end:
            _rename(names, ("velocity",), "impact_velocity")
    return names


def _rename(names: list, old: Sequence[str], new: str) -> None:
    """Give the columns named `old` another name in place."""
    names[:] = [new if name in old else name for name in names]


def _check_once(read: Sequence[Header], names: Sequence[str | None], used: set[str]) -> None:
    """Refuse a name that two columns have, where it is used."""
    for name in used:
        repeated = [header.text for header, one in zip(read, names, strict=True) if one == name]
        if len(repeated) > 1:
            both = " and ".join(map(repr, repeated[:2]))
            raise DataError("column", f"{name} twice, {both}", "there once")


def _kind_of(names: Sequence[str | None], read: Sequence[Header]) -> Kind:
    for kind in (*KINDS, *(WITHOUT_RESTITUTION if {*OBSERVED} & {*names} else ())):
        if set(kind.needs) <= set(names):
            return kind
    found = [name for name in names if name in SI_UNITS]
    questions = [_question(name) for name in names if name in AMBIGUOUS]
    accepted = ACCEPTED_SETS + "".join(f"; {question}" for question in questions[:MOST_NAMED])
    others = [repr(h.text) for h, name in zip(read, names, strict=True) if name not in SI_UNITS]
    unknown = f"not known: {listed(others[:MOST_NAMED])}" if others else ""
    description = "; ".join(filter(None, [listed(sorted(found)), unknown])) or "empty"
    raise DataError("set of columns", description, accepted)


def _used(kind: Kind, names: Sequence[str | None]) -> set[str]:
    used = {*kind.needs, *(name for name in names if name and accepts(kind, name, names))}
    used |= {name for name in (*OBSERVED, *SIZES) if name in names}
    if set(kind.beside) <= set(names):
        used |= set(kind.beside)
    if kind.is_train or "group" not in names:
        used.add("launch")
    return used | {"group"}


def _unit(header: Header, name: str) -> Fraction:
    if header.unit is None:
        return Fraction(1)
    try:
        return unit_of(header.unit, SI_UNITS[name])
    except DataError as error:
        accepted = error.accepted.replace("left out", "without a unit")
        raise DataError(f"unit of {name}", error.value, accepted) from None


def _of_percent(relative: Iterable[str], points: Iterable[str]) -> list[str]:
    """Quantity that a percentage refers to; there are two possibilities."""
    remarks = [f"{name} in % is relative to its quantity" for name in sorted(relative)]
    return remarks + [f"{name} in % is in percentage points of ε" for name in points]


def _assumed(names: Sequence[str]) -> str:
    """Remark on units that are assumed for columns without one."""
    remarks = [f"{name} in {SI_UNITS[name]}" for name in names if SI_UNITS[name] != "1"]
    return f"{NO_UNIT}, assuming {listed(remarks)}" if remarks else ""


def _question(name: str) -> str:
    return f"is {name!r} {' or '.join(AMBIGUOUS[name])}?"


def _remarks(read, names, used) -> tuple[str, ...]:
    """One line on headings with other names, one on columns that are not used."""
    as_written = ("velocity", "impact_velocity")
    pairs = list(zip(read, names, strict=True))
    renamed = [
        f"{name} ({header.text!r})"
        for header, name in pairs
        if name in used and header.words != name and header.words not in as_written
    ]
    left = [
        repr(header.text[:40]) + (f" ({_question(name)})" if name in AMBIGUOUS else "")
        for header, name in pairs
        if name not in used and header.text
    ]
    remarks = [f"headings read as: {listed(renamed)}"] if renamed else []
    if left:
        more = f" and {len(left) - MOST_NAMED} more" if len(left) > MOST_NAMED else ""
        remarks.append(f"columns not used: {listed(left[:MOST_NAMED])}{more}")
    return tuple(remarks)
