"""Columns of a table together: which set they make, which of them are used, and in which units."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from fractions import Fraction
from typing import Any, NamedTuple

from calibration.data.columns import (
    BARE,
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
from calibration.data.kinds import KINDS, PEAKS, SETS, TIMES, WITHOUT_RESTITUTION, Kind
from calibration.data.units import PERCENT, is_unit, unit_of
from calibration.data.words import BOUNCED, tokens, unit_in
from calibration.errors import DataError, listed

MOST_NAMED = 10  # columns that a remark names
ONCE = "there once (of several materials one file and one [[material]] each; of several launches or trials one below the other)"
OWNED = "named with its quantity, as `u_e`, `u_v` or `SD of rebound height`"
NO_UNIT = "no unit in the header"  # how a remark begins


def accepted_sets() -> str:
    """The sets of columns, as a refusal names them."""
    sets = [kind.named for kind in KINDS.values() if kind.needs]
    without = ", or ".join(kind.needs[0] for kind in WITHOUT_RESTITUTION)
    *others, last = OBSERVED
    return f"{', '.join(sets[:-1])}, or {sets[-1]}; or {without}, with {listed(others)} or {last}"


class Layout(NamedTuple):
    """The columns that are used: where each is, its unit as a factor and as written, what is in %.

    `unused` are the places of the others. `remarks` say how headings were read, `assumed` which units are missing.
    """

    kind: Kind
    position: dict[str, int]
    units: dict[str, Fraction]
    written: dict[str, str | None]
    relative: frozenset[str]
    unused: tuple[int, ...]
    remarks: tuple[str, ...]
    assumed: str = ""


def layout_of(headers: Sequence[str], stated: Sequence[str] = ()) -> Layout:
    """Layout of a table from its headings, and of those that are stated of all rows; raises DataError."""
    read = _resolved([read_header(text) for text in headers])
    read = [*_with_owners(read), *map(read_header, stated)]
    names = {header.name for header in read if header.name is not None}
    kind = _kind_of(names, read)
    position: dict[str, int] = {}
    for at, header in enumerate(read):
        if header.name is None or not _is_used(header.name, kind, names):
            continue
        if header.name in position:
            both = f"{read[position[header.name]].text!r} and {header.text!r}"
            once = ONCE if header.name in MEASURED else "there once"
            raise DataError("column", f"{header.name} twice, {both}", once)
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
    unused = tuple(k for k in range(len(headers)) if k not in position.values())
    return Layout(kind, position, sizes, written, relative, unused, tuple(remarks), note)


def _resolved(read: Sequence[Header]) -> list[Header]:
    """The headings with the names that they have next to each other."""
    names, words = {header.name for header in read}, {header.words for header in read}
    first_is_drop = "drop_height" not in names and SECOND & words
    # heights between bounces that are numbered
    is_numbered = any(map(_numbers_bounces, read))
    are_peaks = is_numbered and not names & {"drop_height", "height"} and not first_is_drop

    def name_of(header: Header) -> str | None:
        if are_peaks and (header.name == "rebound_height"):
            return "height"
        if header.name is None or (first_is_drop and header.words in FIRST):
            return header.name and "drop_height"
        if "rebound_velocity" not in names:
            return header.name.replace("impact_velocity", "velocity")
        return "impact_velocity" if header.name == "velocity" else header.name

    return [header._replace(name=name_of(header)) for header in read]


def _with_owners(read: Sequence[Header]) -> Iterator[Header]:
    """Bare uncertainties (`SD`, `±`) as those of the column before them; raises DataError.

    Two readings are possible where ε stands further to the left, or where a column that is not used
    stands between.
    """
    owner: Header | None = None
    has_own: set[str] = set()  # columns whose uncertainty is known
    for header in read:
        is_bare = header.words in BARE and (
            header.unit is None or not is_unit(header.unit, "1") or header.unit == "%"
        )
        if is_bare and header.words == "uncertainty" and header.unit in (None, "%"):
            is_bare = False  # the format's own name, of ε
        if not is_bare:
            yield header
            if header.name is None or header.name in MEASURED or header.name in OBSERVED:
                owner = header if header.text else owner
            elif header.name.endswith("uncertainty"):
                has_own.add(
                    "restitution"
                    if header.name == "uncertainty"
                    else header.name.removesuffix("_uncertainty")
                )
            continue
        if owner is None or owner.name is None:
            stands = "first" if owner is None else f"behind {owner.text!r}, which is not used"
            raise DataError("column", f"{header.text!r}, {stands}", OWNED)
        left = [h.name for h in read[: read.index(header)]]
        if owner.name != "restitution" and "restitution" in left and "restitution" not in has_own:
            raise DataError("column", f"{header.text!r}, of {owner.text!r} or of ε", OWNED)
        has_own.add(owner.name)
        name = "uncertainty" if owner.name == "restitution" else f"{owner.name}_uncertainty"
        yield header._replace(name=name, unit=header.unit or owner.unit)


def _numbers_bounces(header: Header) -> bool:
    """Whether a column counts bounces; with a unit it measures them."""
    return (
        header.name is None
        and bool({*tokens(header.text)} & BOUNCED)
        and unit_in(header.text) is None
    )


def is_track(read: Sequence[Header]) -> bool:
    """Whether a table has a time with heights or positions and no other measurement."""
    names = {header.name for header in read}
    has_time = "time" in names or any(tokens(h.text) == ["t"] for h in read)
    return has_time and bool(names & {*TRACKED}) and not names & ({*MEASURED, *OBSERVED} - {"time"})


def has_impacts(headers: Sequence[str]) -> bool:
    """Whether columns make a set of impacts, other than bare times; no heading is refused."""
    read = []
    for text in headers:
        with suppress(DataError):
            read.append(read_header(text))
    read = _resolved(read)
    return (
        _impacts_of({header.name for header in read if header.name is not None}, read) is not None
    )


def _impacts_of(names: Iterable[str], read: Sequence[Header]) -> Kind | None:
    """The first set that is complete, but bare times."""
    for kind in (*SETS, *(WITHOUT_RESTITUTION if {*OBSERVED} & {*names} else ())):
        if {*kind.needs} <= {*names}:
            return kind
    measured = {*names} & {*MEASURED, *OBSERVED}
    if PEAKS.needs[0] in names and not measured - {"time"} and any(map(_numbers_bounces, read)):
        return PEAKS
    return None


def _kind_of(names: Iterable[str], read: Sequence[Header]) -> Kind:
    if (kind := _impacts_of(names, read)) is not None:
        return kind
    measured = {*names} & {*MEASURED, *OBSERVED}
    if is_track(read):
        raise DataError(
            "table",
            "a track, heights or positions at times",
            f"impacts, one a row: {accepted_sets()}",
        )
    if measured == {"time"}:
        return TIMES
    for header in read:
        if header.other is not None:
            _size(header.other, header.unit)  # refused with the units that it may have
    others = [repr(header.text) for header in read if header.name is None]
    unknown = f"not known: {listed(others[:MOST_NAMED])}" if others else ""
    stamp = "a time beside others is a stamp, and not used" if "time" in measured else ""
    description = "; ".join(filter(None, [listed(sorted(names)), unknown, stamp])) or "empty"
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
    """A line on headings with other names."""
    plain = ("velocity", "impact_velocity")
    found = [read[at] for at in used.values()]
    found = [h for h in found if h.words not in (h.name, *plain)]
    if found:
        yield f"headings read as: {listed(f'{h.name} ({h.text!r})' for h in found)}"
