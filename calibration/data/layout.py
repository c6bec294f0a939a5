"""Columns of a table together: which set they make, which of them are used, and in which units."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from fractions import Fraction
from typing import Any, NamedTuple

from calibration.data.columns import (
    FIRST,
    LABELS,
    MEASURED,
    OBSERVED,
    SECOND,
    SI_UNITS,
    SIZES,
    TRACKED,
    Header,
    read_header,
)
from calibration.data.kinds import KINDS, SETS, TIMES, WITHOUT_RESTITUTION, Kind
from calibration.data.units import PERCENT, unit_of
from calibration.errors import DataError, listed

MOST_NAMED = 10  # columns that a remark names
NO_UNIT = "no unit in the header"  # how a remark begins


def accepted_sets() -> str:
    """The sets of columns, as a refusal names them."""
    sets = [
        " with ".join(kind.needs) + " (with launch)" * kind.is_sequence
        for kind in KINDS.values()
        if kind.needs
    ]
    without = ", or ".join(kind.needs[0] for kind in WITHOUT_RESTITUTION)
    *others, last = OBSERVED
    return f"{', '.join(sets[:-1])}, or {sets[-1]}; or {without}, with {listed(others)} or {last}"


class Layout(NamedTuple):
    """The columns that are used: where each is, its unit as a factor and as written, what is in %.

    `remarks` say how headings were read, `assumed` which units are missing.
    """

    kind: Kind
    position: dict[str, int]
    units: dict[str, Fraction]
    written: dict[str, str | None]
    relative: frozenset[str]
    remarks: tuple[str, ...]
    assumed: str = ""


def layout_of(headers: Sequence[str]) -> Layout:
    """Layout of a table from its headings; raises DataError."""
    read = _resolved([read_header(text) for text in headers])
    names = {header.name for header in read if header.name is not None}
    kind = _kind_of(names, read)
    position: dict[str, int] = {}
    for at, header in enumerate(read):
        if header.name is None or not _is_used(header.name, kind, names):
            continue
        if header.name in position:
            both = f"{read[position[header.name]].text!r} and {header.text!r}"
            raise DataError("column", f"{header.name} twice, {both}", "there once")
        position[header.name] = at
    written = {name: read[at].unit for name, at in position.items()}
    percent = {name for name, unit in written.items() if unit == "%" and "uncertainty" in name}
    points = percent & ({"uncertainty"} if written.get("restitution") == "%" else set())
    relative = frozenset(percent - points)
    sizes = {n: PERCENT if n in relative else _size(n, unit) for n, unit in written.items()}
    remarks = [
        *_remarks(read, position),
        *(f"{name} in % is relative to its quantity" for name in sorted(relative)),
        *(f"{name} in % is in percentage points of ε" for name in points),
    ]
    without = [n for n in (*kind.needs, *OBSERVED, *SIZES) if written.get(n, "") is None]
    assumed = [f"{name} in {SI_UNITS[name]}" for name in without if name != "restitution"]
    note = f"{NO_UNIT}, assuming {listed(assumed)}" if assumed else ""
    return Layout(kind, position, sizes, written, relative, tuple(remarks), note)


def _resolved(read: Sequence[Header]) -> list[Header]:
    """The headings with the names that they have next to each other."""
    names, words = {header.name for header in read}, {header.words for header in read}
    first_is_drop = "drop_height" not in names and SECOND & words

    def name_of(header: Header) -> str | None:
        if header.name is None or (first_is_drop and header.words in FIRST):
            return header.name and "drop_height"
        if "rebound_velocity" not in names:
            return header.name.replace("impact_velocity", "velocity")
        return "impact_velocity" if header.name == "velocity" else header.name

    return [header._replace(name=name_of(header)) for header in read]


def is_track(read: Sequence[Header]) -> bool:
    """Whether a table has a time with heights or positions and no other measurement."""
    names = {header.name for header in read}
    has_time = "time" in names or "t" in {header.words for header in read}
    return has_time and bool(names & {*TRACKED}) and not names & ({*MEASURED, *OBSERVED} - {"time"})


def _kind_of(names: Iterable[str], read: Sequence[Header]) -> Kind:
    for kind in (*SETS, *(WITHOUT_RESTITUTION if {*OBSERVED} & {*names} else ()), TIMES):
        if kind is TIMES and is_track(read):
            continue
        if {*kind.needs} <= {*names}:
            return kind
    if is_track(read):
        accepted = f"impacts, one a row: {accepted_sets()}"
        raise DataError("table", "a track, heights or positions at times", accepted)
    others = [repr(header.text) for header in read if header.name is None]
    unknown = f"not known: {listed(others[:MOST_NAMED])}" if others else ""
    description = "; ".join(filter(None, [listed(sorted(names)), unknown])) or "empty"
    raise DataError("set of columns", description, accepted_sets())


def _is_used(name: str, kind: Kind, names: Iterable[str]) -> bool:
    """Whether a column acts in data of this kind, next to columns of these names."""
    if name in LABELS:
        return name == "group" or kind.is_sequence or "group" not in names
    if name == "uncertainty":
        return kind.has_restitution
    if (observed := name.removesuffix("_uncertainty")) in OBSERVED:
        return observed in names
    return name in (*kind.needs, *SIZES, "velocity_uncertainty", *kind.uncertainties)


def _size(name: str, unit: str | None) -> Fraction:
    if unit is None:
        return Fraction(1)
    try:
        return unit_of(unit, SI_UNITS[name])
    except DataError as error:
        accepted = error.accepted.replace("left out", "without a unit")
        raise DataError(f"unit of {name}", error.value, accepted) from None


def _remarks(read: Sequence[Header], used: Mapping[Any, int]) -> Iterator[str]:
    """One line on headings with other names, one on columns that are not used."""
    plain = ("velocity", "impact_velocity")
    found = [h for h in read if h.name in used and h.words not in (h.name, *plain)]
    left = [repr(h.text[:40]) for h in read if h.name not in used and h.text]
    if found:
        yield f"headings read as: {listed(f'{h.name} ({h.text!r})' for h in found)}"
    if left:
        more = f" and {len(left) - MOST_NAMED} more" if len(left) > MOST_NAMED else ""
        yield f"columns not used: {listed(left[:MOST_NAMED])}{more}"
