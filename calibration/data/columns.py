"""Columns of a table: their names, units and spellings, and how a heading is read.

A heading is a name and a unit: `velocity [m/s]`, `v (cm/s)`, `t / ms`, `drop height, mm`, `h_mm`. Which
columns make a set together is in `calibration.data.kinds`, and how those of a table are chosen in
`calibration.data.layout`. A further column is an entry of `QUANTITIES`; messages, material files and the reference
are made of it.
"""

import re
import unicodedata
from collections.abc import Iterator
from difflib import get_close_matches
from typing import NamedTuple

from calibration.data.units import is_bare_unit, is_other_unit, is_unit
from calibration.errors import DataError


class Quantity(NamedTuple):
    """One column of the format.

    Attributes:
        name: in the format.
        unit: of SI, "1" of a ratio, "" of a label.
        meaning: in words.
        spellings: other names, separated by blanks.
    """

    name: str
    unit: str
    meaning: str
    spellings: str = ""


MEASURED_COLUMNS = (
    Quantity("velocity", "m/s", "impact velocity v", "v speed"),
    Quantity(
        "restitution",
        "1",
        "coefficient of restitution ε",
        "e ε eps epsilon cor e_n restitution_coefficient coefficient_of_restitution "
        "coeff_of_restitution coef_of_restitution normal_restitution",
    ),
    Quantity(
        "impact_velocity",
        "m/s",
        "velocity before the impact",
        "impact_speed v_impact v_imp v_in vin v_i vi v_inc v_0 v0 v_before "
        "v_initial incident_velocity incident_speed incoming_velocity incoming_speed velocity_in "
        "velocity_before initial_velocity approach_velocity collision_velocity",
    ),
    Quantity(
        "rebound_velocity",
        "m/s",
        "velocity after the impact",
        "rebound_speed v_rebound v_reb v_out vout v_r vr v_f vf v_after v_final v' "
        "outgoing_velocity outgoing_speed velocity_out velocity_after final_velocity "
        "separation_velocity",
    ),
    Quantity(
        "drop_height",
        "m",
        "height of the drop",
        "h_drop h_0 h0 h_i hi h_initial initial_height release_height fall_height "
        "falling_height height_before",
    ),
    Quantity(
        "rebound_height",
        "m",
        "height of the rebound",
        "h_rebound h_reb h_bounce h_f hf h_r hr h_final h' h_1 h1 h_2 "
        "h2 bounce_height final_height height_after",
    ),
    Quantity(
        "interval",
        "s",
        "time from one bounce to the next",
        "dt δt delta_t flight_time time_of_flight tof time_interval bounce_interval "
        "interval_time time_between_bounces",
    ),
    Quantity("time", "s", "time of a bounce", "bounce_time impact_time event_time time_of_bounce"),
)
# of a ball in flight, frame by frame; with a time they make a track
TRACK_COLUMNS = (
    Quantity(
        "height",
        "m",
        "height of the ball",
        "h peak_height max_height maximum_height maximal_height apex_height peak apex "
        "altitude elevation absolute_height höhe hoehe hauteur altura altezza",
    ),
    Quantity(
        "position",
        "m",
        "position of the ball",
        "pos x y z x_position y_position z_position "
        "position_x position_y position_z vertical_position",
    ),
)
# what else an impact shows; each is a row of `calibration.observables.OBSERVABLES` too
OBSERVED_COLUMNS = (
    Quantity(
        "contact_time",
        "s",
        "duration of the contact",
        "contact_duration collision_time collision_duration t_c tc t_contact",
    ),
    Quantity(
        "peak_force",
        "N",
        "largest force",
        "f_max fmax max_force maximum_force force_max impact_force",
    ),
    Quantity(
        "peak_overlap",
        "m",
        "largest penetration",
        "penetration max_penetration penetration_depth max_overlap δ_max delta_max",
    ),
    Quantity(
        "dent_diameter", "m", "diameter of the dent", "crater_diameter imprint_diameter d_dent"
    ),
)
# of the sphere that flies, row by row
SIZE_COLUMNS = (
    Quantity("diameter", "m", "diameter of the sphere"),
    Quantity("radius", "m", "radius of the sphere"),
    Quantity("mass", "kg", "mass of the sphere"),
)
LABEL_COLUMNS = (
    Quantity("launch", "", "bounces that follow each other", "train"),
    Quantity("group", "", "rows that share one unknown offset", "specimen"),
)
# standard uncertainties that are of no single column
COMMON_UNCERTAINTIES = (
    Quantity("uncertainty", "1", "standard uncertainty of ε"),
    Quantity("height_uncertainty", "m", "standard uncertainty of both heights"),
    Quantity("timing_uncertainty", "s", "standard uncertainty of intervals, or of times"),
)


def _of(*columns: Quantity) -> dict[str, str]:
    return {column.name: column.unit for column in columns}


# name: its unit in SI
MEASURED, OBSERVED = _of(*MEASURED_COLUMNS), _of(*OBSERVED_COLUMNS)
TRACKED = _of(*TRACK_COLUMNS)
SIZES, LABELS = _of(*SIZE_COLUMNS), _of(*LABEL_COLUMNS)
UNCERTAINTIES = {
    "uncertainty": "1",
    **{f"{n}_uncertainty": unit for n, unit in MEASURED.items() if n != "restitution"},
    **_of(*COMMON_UNCERTAINTIES),
    **{f"{name}_uncertainty": unit for name, unit in OBSERVED.items()},
}
SI_UNITS = {**MEASURED, **TRACKED, **OBSERVED, **SIZES, **UNCERTAINTIES, **LABELS}
QUANTITIES = (
    *MEASURED_COLUMNS,
    *TRACK_COLUMNS,
    *OBSERVED_COLUMNS,
    *SIZE_COLUMNS,
    *LABEL_COLUMNS,
    *COMMON_UNCERTAINTIES,
)

KNOWN = {word: column.name for column in QUANTITIES for word in column.spellings.split()}
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
ALONE = (
    "unc error err stdev std sd ± standard_deviation standard_uncertainty standard_error "
    "stddev std_dev std_deviation std_error st_dev standardabweichung stabw standardfehler fehler unsicherheit "
    "écart_type incertitude erreur incertezza errore deviazione_standard desviación_estándar incertidumbre"
)
KNOWN |= dict.fromkeys(ALONE.split(), "uncertainty")
BARE = {*ALONE.split(), "uncertainty"}
QUANTITY = {
    column.name for column in (*MEASURED_COLUMNS, *TRACK_COLUMNS, *OBSERVED_COLUMNS, *SIZE_COLUMNS)
}
# how symbols of a quantity begin, as in `drop height (h)`
SYMBOLS = {
    **dict.fromkeys(("velocity", "impact_velocity", "rebound_velocity"), "v|u|w"),
    **dict.fromkeys(("drop_height", "rebound_height", "height"), "h|y|z|x|d|s"),
    **{"restitution": "e|ε|k|r|cor|cr|c_r|eps", "interval": "t|τ|δt|dt", "time": "t|τ"},
    **{"contact_time": "t|τ|δt", "peak_force": "f", "peak_overlap": "δ|x|d", "dent_diameter": "d"},
    **{"diameter": "d|ø|⌀", "radius": "r", "mass": "m", "position": "x|y|z|s"},
}
MARKED = 2  # letters of a name that a symbol may follow
NEAR = 0.82  # of difflib: velocty is near to velocity, interval_index is not to interval
LONGEST = 200  # characters of a heading that may be a name


class Header(NamedTuple):
    """A heading: as written, its name (of `SI_UNITS`, or None), its words, its unit.

    `other` is the name that its words have, where the unit is of another quantity.
    """

    text: str
    name: str | None
    words: str
    unit: str | None
    other: str | None = None


def read_header(text: str) -> Header:
    """Name and unit of one heading; refuses a name near to a known one, or brackets of no unit."""
    text = str(text).strip()
    if len(text) > LONGEST:
        return Header(text, None, "", None)
    for words, unit, is_sure in _readings(text):
        name = _canonical(words)
        if name is None or not (is_sure or is_unit(unit or "", SI_UNITS[name]) or unit == "%"):
            continue
        is_other = unit is not None and not is_unit(unit, SI_UNITS[name])
        if is_other and plain(str(unit)) != plain(words) and is_symbol(str(unit), name):
            return Header(text, name, plain(words), None)
        if is_other and name in QUANTITY and is_other_unit(str(unit), SI_UNITS[name]):
            return Header(text, None, plain(words), unit, name)
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
    known = KNOWN.get(name) or SPELLED.get(name)
    before, _, last = name.rpartition("_")
    if known is None and len(before) > MARKED and is_symbol(last, KNOWN.get(before, "")):
        return KNOWN[before]  # drop height h, coefficient of restitution (e)
    return known


def is_symbol(text: str, name: str) -> bool:
    """Whether a text is the symbol of a quantity, as in `drop height (h)` or `velocity v1`."""
    symbol = plain(text)
    if KNOWN.get(symbol) == name and name in QUANTITY:
        return True
    return bool(re.fullmatch(rf"(?:{SYMBOLS.get(name, '(?!)')})(?:_?[a-z0-9]{{0,3}})'?", symbol))


def plain(words: str) -> str:
    """Small letters, one underscore for all that separates, subscripts on the line."""
    text = unicodedata.normalize("NFKC", words).casefold().replace("′", "'")
    return re.sub(r"[\s_.,\-(){}$\\]+", "_", text.replace("\ufeff", "")).strip("_")


def _readings(text: str) -> Iterator[tuple[str, str | None, bool]]:
    """(name, unit, whether the unit is surely one) in the ways that a heading may be meant."""
    yield text, None, True
    bracket = re.fullmatch(r"(.*?)\s*(?:\[([^\[\]]*)\]|\(((?:[^()]|\([^()]*\))*)\))", text)
    if bracket:
        yield bracket[1], (bracket[2] or bracket[3] or "").strip() or None, True
    for mark in ("/", ",", " in ", "_", " "):
        for match in re.finditer(re.escape(mark), text):
            unit = re.sub(r"^\((.*)\)$", r"\1", text[match.end() :].strip())
            if mark == "/" and unit in ("c", "min", "h"):
                continue
            if mark == " " and len(unit) < 2:
                continue
            if mark in ("/", " in ") or is_bare_unit(unit):  # e_1 is the first of several
                yield text[: match.start()], unit, False
