"""Columns of a table: how headings are read, and what the columns mean together.

A heading is a name and a unit: `velocity [m/s]`, `v (cm/s)`, `t / ms`, `drop height, mm`, `h_mm`.
Accepted together are

    impact_velocity, rebound_velocity   ε = v_out/v_in
    drop_height, rebound_height         v = √(2 g h₁), ε = √(h₂/h₁)
    velocity, restitution
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

import re
import unicodedata
from collections.abc import Iterable, Iterator, Mapping, Sequence
from difflib import get_close_matches
from fractions import Fraction
from typing import Any, NamedTuple

from calibration.data.units import PERCENT, is_unit, unit_of
from calibration.errors import DataError, listed

MEASURED = {
    "velocity": "m/s",
    "restitution": "1",
    "impact_velocity": "m/s",
    "rebound_velocity": "m/s",
    "drop_height": "m",
    "rebound_height": "m",
    "interval": "s",
    "time": "s",
}
OBSERVED = {"contact_time": "s", "peak_force": "N", "peak_overlap": "m", "dent_diameter": "m"}
SIZES = {"diameter": "m", "radius": "m", "mass": "kg"}  # of the sphere that flies, row by row
LABELS = ("launch", "group")
UNCERTAINTIES = {
    "uncertainty": "1",
    **{f"{n}_uncertainty": d for n, d in MEASURED.items() if n != "restitution"},
    "height_uncertainty": "m",  # of both heights
    "timing_uncertainty": "s",  # of intervals, or of times
    **{f"{name}_uncertainty": unit for name, unit in OBSERVED.items()},
}
# name: its unit in SI
SI_UNITS = {**MEASURED, **OBSERVED, **SIZES, **UNCERTAINTIES, **dict.fromkeys(LABELS, "")}

SPELLINGS = {
    "restitution": "e ε eps epsilon cor e_n restitution_coefficient coefficient_of_restitution "
    "coeff_of_restitution coef_of_restitution normal_restitution",
    "velocity": "v speed",
    "impact_velocity": "impact_speed v_impact v_imp v_in vin v_i vi v_inc v_0 v0 v_before "
    "v_initial incident_velocity incident_speed incoming_velocity incoming_speed velocity_in "
    "velocity_before initial_velocity approach_velocity collision_velocity",
    "rebound_velocity": "rebound_speed v_rebound v_reb v_out vout v_r vr v_f vf v_after v_final v' "
    "outgoing_velocity outgoing_speed velocity_out velocity_after final_velocity "
    "separation_velocity",
    "drop_height": "h_drop h_0 h0 h_i hi h_initial initial_height release_height fall_height "
    "falling_height height_before",
    "rebound_height": "h_rebound h_reb h_bounce h_f hf h_r hr h_final h' h_1 h1 h_2 "
    "h2 bounce_height final_height height_after",
    "interval": "dt δt delta_t flight_time time_of_flight tof time_interval bounce_interval "
    "interval_time time_between_bounces",
    "time": "bounce_time impact_time event_time time_of_bounce",
    "contact_time": "contact_duration collision_time collision_duration t_c tc t_contact",
    "peak_force": "f_max fmax max_force maximum_force force_max impact_force",
    "peak_overlap": "penetration max_penetration penetration_depth max_overlap δ_max delta_max",
    "dent_diameter": "crater_diameter imprint_diameter d_dent",
    "launch": "train",
    "group": "specimen",
}
KNOWN = {word: name for name, words in SPELLINGS.items() for word in words.split()}
KNOWN |= {name: name for name in SI_UNITS}
# drop and rebound; next to a drop height either is the rebound
FIRST, SECOND = {"h1", "h_1"}, {"h2", "h_2"}
# an uncertainty is one of these words and the name of its quantity, in either order: u_v, v_err
UNCERTAIN = ["uncertainty", "unc", "error", "err", "stdev", "std", "sd", "sigma", "σ", "±"]
BEFORE = (*UNCERTAIN, "u", *(f"{word}_{of}" for word in UNCERTAIN for of in ("of", "in")))
OF = {"h": "height", "height": "height", "t": "timing", "timing": "timing"}
OF |= {w: n for w, n in KNOWN.items() if n in (*MEASURED, *OBSERVED) and w not in FIRST | SECOND}
OF = {w: "uncertainty" if n == "restitution" else f"{n}_uncertainty" for w, n in OF.items()}
SPELLED = {f"{before}_{word}": name for before in BEFORE for word, name in OF.items()}
SPELLED |= {f"{word}_{after}": name for after in UNCERTAIN for word, name in OF.items()}
SPELLED |= {f"±{word}": name for word, name in OF.items()}
ALONE = "unc error err stdev std sd ± standard_deviation standard_uncertainty standard_error"
KNOWN |= dict.fromkeys(ALONE.split(), "uncertainty")
NEAR = 0.82  # of difflib: velocty is near to velocity, interval_index is not to interval
LONGEST = 200  # characters of a heading that may be a name
MOST_NAMED = 10  # columns that a remark names
NO_UNIT = "no unit in the header"  # how a remark begins


class Kind(NamedTuple):
    """Columns that make a set of data together."""

    needs: tuple[str, ...]
    what: str = ""  # input quantities, whose errors enter ε and v
    uncertainties: tuple[str, ...] = ()  # of these; the last is of all of them

    @property
    def is_sequence(self) -> bool:
        return self.what in ("intervals", "times")

    @property
    def is_flight(self) -> bool:
        """Whether velocities are those of free flights."""
        return self.is_sequence or self.what == "heights"

    @property
    def has_restitution(self) -> bool:
        """Whether ε is measured."""
        return self.is_sequence or len(self.needs) > 1


VELOCITIES = ("impact_velocity", "rebound_velocity")
HEIGHTS = ("drop_height", "rebound_height")


def _uncertainties(*names: str) -> tuple[str, ...]:
    return tuple(f"{name}_uncertainty" for name in names)


KINDS = (
    Kind(VELOCITIES, "velocities", _uncertainties(*VELOCITIES, "velocity")),
    Kind(HEIGHTS, "heights", _uncertainties(*HEIGHTS, "height")),
    Kind(("velocity", "restitution")),
    Kind(("interval",), "intervals", _uncertainties("interval", "timing")),
    Kind(("time",), "times", _uncertainties("time", "timing")),
)
# accepted where something else than ε was measured
WITHOUT_RESTITUTION = (
    Kind(("velocity",)),
    Kind(HEIGHTS[:1], "heights", _uncertainties("drop_height", "height")),
)
ACCEPTED_SETS = (
    "velocity with restitution, impact_velocity with rebound_velocity, drop_height with "
    "rebound_height, interval (with launch), or time (with launch); or velocity, or drop_height, with "
    "contact_time, peak_force, penetration or dent_diameter"
)


class Header(NamedTuple):
    """A heading: as written, its name (of `SI_UNITS`, or None), its words, its unit."""

    text: str
    name: str | None
    words: str
    unit: str | None


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


def read_header(text: str) -> Header:
    """Name and unit of one heading; refuses a name near to a known one, or brackets of no unit."""
    text = str(text).strip()
    if len(text) > LONGEST:
        return Header(text, None, "", None)
    for words, unit, is_sure in _readings(text):
        name = _canonical(words)
        if name is not None and (is_sure or is_unit(unit or "", SI_UNITS[name]) or unit == "%"):
            return Header(text, name, plain(words), unit)
    base = re.split(r"[\[(]", text)[0]
    if _canonical(base) is not None:
        raise DataError("column", repr(text), "a name and one unit, as in `velocity [m/s]`")
    in_words = [n for n in KNOWN if len(n) > 3 and min(map(len, n.split("_"))) > 1]  # no symbols
    near = get_close_matches(plain(base), in_words, n=1, cutoff=NEAR)
    if near:
        accepted = f"a known name (did you mean {near[0]!r}?), or a clearly different name"
        raise DataError("column", repr(text), accepted)
    return Header(text, None, plain(text), None)


def _canonical(words: str) -> str | None:
    """The format's name of a column from a user's heading; None if there is none."""
    name = plain(words)
    return KNOWN.get(name) or SPELLED.get(name)


def plain(words: str) -> str:
    """Small letters, one underscore for all that separates, subscripts on the line."""
    text = unicodedata.normalize("NFKC", words).casefold().replace("′", "'")
    return re.sub(r"[\s_.\-(){}$\\]+", "_", text).strip("_")


def _readings(text: str) -> Iterator[tuple[str, str | None, bool]]:
    """(name, unit, whether the unit is surely one) in the ways that a heading may be meant."""
    yield text, None, True
    bracket = re.fullmatch(r"(.*?)\s*(?:\[([^\[\]]*)\]|\(((?:[^()]|\([^()]*\))*)\))", text)
    if bracket:
        yield bracket[1], (bracket[2] or bracket[3] or "").strip() or None, True
    for mark in ("/", ",", " in ", "_"):
        for match in re.finditer(re.escape(mark), text):
            unit = re.sub(r"^\((.*)\)$", r"\1", text[match.end() :].strip())
            if mark == "/" or unit not in ("1", "-"):  # e_1 is the first of several
                yield text[: match.start()], unit, False


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


def _kind_of(names: Iterable[str], read: Sequence[Header]) -> Kind:
    for kind in (*KINDS, *(WITHOUT_RESTITUTION if {*OBSERVED} & {*names} else ())):
        if {*kind.needs} <= {*names}:
            return kind
    others = [repr(header.text) for header in read if header.name is None]
    unknown = f"not known: {listed(others[:MOST_NAMED])}" if others else ""
    description = "; ".join(filter(None, [listed(sorted(names)), unknown])) or "empty"
    raise DataError("set of columns", description, ACCEPTED_SETS)


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
