"""Wide tables as one row a measurement: repeats in columns, heights of successive bounces in one row.

Drop height, Trial 1, Trial 2, Average    each trial a rebound height of its own
Height 0, Height 1, Height 2              one row: the peaks of one launch
h0, h1, h2, h3                            either of these: the key `repeats` says which
"""

import re
from collections.abc import Sequence
from contextlib import suppress
from typing import NamedTuple

from calibration.data.columns import BARE, plain, read_header
from calibration.data.words import BOUNCED, REPETITIONS, is_statistic_heading, tokens, unit_in
from calibration.errors import DataError, listed

Row = tuple[int, list[str]]  # the line that it begins on, its cells
NUMBERED = re.compile(
    r"(.*?)[\s_.#:-]*(?<!\d)(\d{1,2})(?!\d|\.\d)(?:(?:st|nd|rd|th|er|re|e|ème|º|ª)\b|\.)?(.*)"
)
LETTERED = re.compile(r"(.*\w)[\s_]+([A-Z])")
UNIT_BEHIND = re.compile(r"(.*\d)\s*(?:/|,|_| in )\s*([A-Za-z%][A-Za-z%/]*)\s*")
PEAKS = {
    *[
        "h",
        "height",
        "heights",
        "peak",
        "peaks",
        "apex",
        "höhe",
        "hoehe",
        "hauteur",
        "altezza",
        "altura",
        "hoogte",
        "höjd",
        "h_max",
    ]
}
REBOUNDS = {"restitution", "rebound_velocity", "rebound_height"}
REPEATED_REBOUND = {
    *[
        "rebound",
        "rebounds",
        "rücksprung",
        "rückprall",
        "rebond",
        "rebote",
        "rimbalzo",
        "terugstuit",
    ]
}
AVERAGES = {
    *[
        "mean",
        "average",
        "averages",
        "averaged",
        "avg",
        "ave",
        "mittelwert",
        "mittlere",
        "mittlerer",
        "durchschnitt",
        "moyenne",
        "media",
        "promedio",
        "gemiddelde",
    ]
}
AGREES = 0.02  # of a mean, to which its column is rounded
SAY = (
    "either repeats of one drop, or bounces one after the other: say `repeats = true` or `repeats = false` in "
    "[[material]] (`repeats=` in Python), or name them Trial 1, Trial 2 or one below the other as bounce and height"
)
NAMED = "repeats of what is named, as `rebound height 1`, `COR 1` or `v_out 1`, next to a drop_height or a velocity"
BESIDE_EACH_OTHER = (
    "one table below one header: of several materials one file and one [[material]] each, of several launches "
    "one below the other with a column `launch`"
)


class Family(NamedTuple):
    """Headings that differ by a number: what they have in common, and their places by number."""

    base: str
    unit: str | None
    places: dict[int, int]

    @property
    def words(self) -> set[str]:
        return {*tokens(self.base)} - {""}

    @property
    def name(self) -> str | None:
        """The column that each would be without its number."""
        with suppress(DataError):
            return read_header(self.base).name
        return None

    @property
    def are_repeats(self) -> bool:
        """Whether their words say that they repeat one measurement."""
        if self.words & BOUNCED - REPEATED_REBOUND:
            return False
        return (
            not self.words
            or bool(self.words & (REPETITIONS | REPEATED_REBOUND))
            or self.name in REBOUNDS
        )

    @property
    def may_be_bounces(self) -> bool:
        return bool(self.words & (BOUNCED - REPEATED_REBOUND | PEAKS)) or self.name in (
            "height",
            "rebound_height",
        )


def reshaped(
    header: list[str], rows: list[Row], repeats: bool | None
) -> tuple[list[str], list[Row], list[str]]:
    """Header and rows with one row a measurement, and remarks; raises DataError where two readings are possible."""
    _check_blocks(header, rows)
    named = _names(header)
    others = {name: k for k, name in enumerate(named) if name is not None}
    for family in _families(header):
        own = {*family.places.values()}
        drop = next(
            (k for k in [others.get("drop_height")] if k is not None and k not in own), None
        )
        if family.are_repeats and repeats is not False:
            target = _target(family, others, own)
            if target is not None:
                return _stacked(header, rows, family, target, drop)
            if (
                family.words
                and not {*others} & {*REBOUNDS, "interval", "time"}
                and {"velocity", "impact_velocity", "drop_height", "height"} & {*others}
            ):
                raise DataError(
                    "set of columns", listed(repr(header[k]) for k in sorted(own)), NAMED
                )
        may_be = family.may_be_bounces or (family.are_repeats and repeats is False)
        if not may_be or len(own) + (drop is not None) < 3:
            continue
        is_one_launch = len(rows) == 1 and drop is None and family.words != {"h"}
        if repeats is None and is_one_launch and not family.are_repeats:
            repeats = False
        if repeats is None:
            raise DataError("set of columns", listed(repr(header[k]) for k in sorted(own)), SAY)
        if not repeats:
            return _successive(header, rows, family, drop)
        if drop is None and 0 not in family.places:
            raise DataError(
                "repeats", "true", "given with a column drop_height, or h0, of the drop"
            )
        if drop is None:
            drop = family.places[0]
            family = family._replace(places={n: k for n, k in family.places.items() if n})
        return _stacked(header, rows, family, "rebound_height", drop)
    if repeats is not None:
        raise DataError("repeats", "given", "left out without columns such as h1, h2, h3")
    return _averages_named(header, named), rows, []


def _names(header: Sequence[str]) -> list[str | None]:
    names: list[str | None] = []
    for text in header:
        name = None
        with suppress(DataError):
            name = read_header(text).name
        names.append(name)
    return names


def _families(header: Sequence[str]) -> list[Family]:
    found: dict[str, Family] = {}
    for k, text in enumerate(header):
        unit, base = unit_in(text), re.sub(r"\s*[\[(][^\[\]()]*[\])]\s*$", "", text.strip())
        if unit is None and (behind := UNIT_BEHIND.fullmatch(base)):
            base, unit = behind[1], behind[2]
        if (match := NUMBERED.fullmatch(base)) is not None:
            words, number = plain(f"{match[1]} {match[3]}"), int(match[2])
        elif (match := LETTERED.fullmatch(base)) is not None and {*tokens(match[1])} & REPETITIONS:
            words, number = plain(match[1]), ord(match[2]) - ord("A") + 1
        else:
            continue
        family = found.setdefault(words, Family(words, unit, {}))
        family.places.setdefault(number, k)
        found[words] = family._replace(unit=family.unit or unit)
    return [family for family in found.values() if len(family.places) > 1]


def _target(family: Family, others: dict[str, int], own: set[int]) -> str | None:
    """The column that repeats are of, next to the setting; None if unknown."""
    beside = {name for name, k in others.items() if k not in own}
    units = {"rebound_height": "drop_height", "rebound_velocity": "velocity"}
    if "impact_velocity" in beside:
        beside.add("velocity")
    if family.name in REBOUNDS:
        setting = units.get(str(family.name), "velocity")
        return family.name if setting in beside else None
    for name, setting in units.items():
        header = read_header(f"{name} [{family.unit}]" if family.unit else name)
        if (
            setting in beside
            and header.name is not None
            and (family.unit or name == "rebound_height")
        ):
            return name
    return None


def _stacked(
    header: list[str], rows: list[Row], family: Family, target: str, drop: int | None
) -> tuple[list[str], list[Row], list[str]]:
    """One row for each repeat; means and deviations of these are theirs and not used."""
    places = [family.places[number] for number in sorted(family.places)]
    unit = family.unit
    if unit is None and drop is not None and target == "rebound_height":
        unit = read_header(header[drop]).unit
    left = [k for k in range(len(header)) if k not in places]
    theirs = [k for k in left if k != drop and _is_of_repeats(header, rows, k, places, target)]
    left = [k for k in left if k not in theirs]
    heading = f"{target} [{unit}]" if unit else target
    long = [(line, [*(cells[k] for k in left), cells[at]]) for line, cells in rows for at in places]
    each = f"{header[places[0]]!r} to {header[places[-1]]!r}"
    remarks = [f"{each} are read as repeats of {target}: {len(places)} for each row"]
    if theirs:
        remarks.append(
            f"columns not used, as they are of these repeats: {listed(repr(header[k]) for k in theirs)}"
        )
    return [*(header[k] for k in left), heading], long, remarks


def _is_of_repeats(
    header: list[str], rows: list[Row], k: int, places: list[int], target: str
) -> bool:
    """Whether a column is the mean, the deviation or the like of the repeats."""
    words = plain(re.sub(r"\s*[\[(].*", "", header[k]))
    if is_statistic_heading(header[k]) or words in BARE:
        return True
    if _names([header[k]]) != [target]:
        return False
    for _, cells in rows:
        with suppress(ValueError):
            values = [float(cells[at].replace(",", ".")) for at in places if cells[at]]
            mean, stated = sum(values) / max(len(values), 1), float(cells[k].replace(",", "."))
            if abs(stated - mean) > AGREES * abs(mean):
                return False
    return True


def _successive(
    header: list[str], rows: list[Row], family: Family, drop: int | None
) -> tuple[list[str], list[Row], list[str]]:
    """Peaks one below the other, with the launch of each row."""
    places = [family.places[number] for number in sorted(family.places)]
    unit = family.unit
    if drop is not None:
        of_drop = read_header(header[drop]).unit
        if unit is not None and of_drop != unit:
            raise DataError(
                "unit", f"{unit!r} next to {of_drop!r} of the drop", "the same for both"
            )
        unit, places = unit or of_drop, [drop, *places]
    left = [
        k for k in range(len(header)) if k not in places and not is_statistic_heading(header[k])
    ]
    has_launch = "launch" in _names([header[k] for k in left])
    long = []
    for number, (line, cells) in enumerate(rows, start=1):
        filled = [at for at in places if cells[at]]
        for bounce, at in enumerate(filled):
            row = [*(cells[k] for k in left), str(bounce), cells[at]]
            long.append((line, row if has_launch else [*row, str(number)]))
    heading = f"height [{unit}]" if unit else "height"
    made = ["bounce", heading, *([] if has_launch else ["launch"])]
    each = f"{header[places[0]]!r} to {header[places[-1]]!r}"
    return (
        [*(header[k] for k in left), *made],
        long,
        [f"{each} are read as heights between bounces"],
    )


def _averages_named(header: list[str], named: Sequence[str | None]) -> list[str]:
    """Headings such as `Average rebound height (cm)` by what is averaged, where nothing else has that name."""
    result = [*header]
    for k, text in enumerate(header):
        words = [
            word
            for word in re.split(r"[\s_]+", text.strip())
            if word.casefold().strip(".") not in AVERAGES
        ]
        rest = " ".join(words)
        if named[k] is None and rest != " ".join(re.split(r"[\s_]+", text.strip())) and rest:
            (name,) = _names([rest])
            if name in REBOUNDS and name not in named:
                result[k] = rest
    return result


def _check_blocks(header: list[str], rows: list[Row]) -> None:
    """Refuse tables next to each other, with an empty column between, or with pandas' numbers behind names."""
    names = [plain(re.sub(r"\.\d+$", "", text)) for text in header]
    gaps = [
        k for k, text in enumerate(header) if not text and not any(cells[k] for _, cells in rows)
    ]
    gaps += [k for k, text in enumerate(header) if re.fullmatch(r"Unnamed: \d+", text)]
    known = [
        name or words
        for name, words in zip(
            _names([re.sub(r"\.\d+$", "", h) for h in header]), names, strict=True
        )
    ]
    for gap in gaps:
        both = {word for word in known[:gap] if word} & {word for word in known[gap + 1 :] if word}
        if both:
            text = f"{listed(sorted(both))} on both sides of empty column {gap + 1}"
            raise DataError("table", text, BESIDE_EACH_OTHER)
    mangled = [
        text
        for text in header
        if re.fullmatch(r".+\.\d+", text) and text.rpartition(".")[0] in header
    ]
    for text in mangled:
        if _names([text.rpartition(".")[0]]) != [None]:
            raise DataError("table", f"{text.rpartition('.')[0]!r} and {text!r}", BESIDE_EACH_OTHER)
