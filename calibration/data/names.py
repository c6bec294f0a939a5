"""Names of columns: those of the format, what people call them, and how a header is read.

A header is a name and a unit: `velocity [m/s]`, `v (cm/s)`, `t / ms`, `drop height, mm`, `h_mm`.
"""

import re
import unicodedata
from difflib import get_close_matches
from typing import NamedTuple

from calibration.data.units import is_unit
from calibration.errors import DataError

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

SYNONYMS = {
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
    "rebound_height": "h_rebound h_reb h_bounce h_f hf h_r hr h_final h' bounce_height "
    "final_height height_after",
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
KNOWN = {word: name for name, words in SYNONYMS.items() for word in words.split()}
KNOWN |= {name: name for name in SI_UNITS}
# headings with two meanings, and the names that they may stand for
AMBIGUOUS: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(("t", "t_n", "times"), ("interval", "time")),
    **dict.fromkeys(("h", "height", "h_1", "h1", "h_2", "h2"), ("drop_height", "rebound_height")),
    **dict.fromkeys(("v_1", "v1", "v_2", "v2"), ("impact_velocity", "rebound_velocity")),
    **dict.fromkeys(("rebound", "bounce"), ("rebound_height", "rebound_velocity")),
    **dict.fromkeys(("drop", "fall"), ("drop_height", "launch")),
    "u": ("impact_velocity", "uncertainty"),
    **dict.fromkeys(("dv", "δv", "delta_v"), ("velocity_uncertainty",)),
    **dict.fromkeys(("de", "δe", "delta_e", "δε"), ("uncertainty",)),
    **dict.fromkeys(("dh", "δh", "delta_h"), ("height_uncertainty",)),
    **dict.fromkeys(("geschwindigkeit", "vitesse", "velocidad", "velocità"), ("velocity",)),
    **dict.fromkeys(("stosszahl", "stoßzahl", "restitutionskoeffizient"), ("restitution",)),
    **dict.fromkeys(("coefficient_de_restitution", "coeficiente_de_restitución"), ("restitution",)),
    **dict.fromkeys(("aufprallgeschwindigkeit", "vitesse_d'impact"), ("impact_velocity",)),
    **dict.fromkeys(("rückprallgeschwindigkeit", "vitesse_de_rebond"), ("rebound_velocity",)),
    **dict.fromkeys(("fallhöhe", "hauteur_de_chute"), ("drop_height",)),
    **dict.fromkeys(("rücksprunghöhe", "sprunghöhe", "hauteur_de_rebond"), ("rebound_height",)),
    **dict.fromkeys(("unsicherheit", "incertitude"), ("uncertainty",)),
    **dict.fromkeys(("höhe", "hauteur", "altura"), ("drop_height", "rebound_height")),
    **dict.fromkeys(("zeit", "temps", "tiempo"), ("interval", "time")),
    **dict.fromkeys(("gruppe", "probe", "groupe"), ("group",)),
}
# an uncertainty is one of these words and the name of its quantity, in either order: u_v, v_err
UNCERTAIN = ["uncertainty", "unc", "error", "err", "stdev", "std", "sd", "sigma", "σ", "±"]
BEFORE = (*UNCERTAIN, "u", *(f"{word}_{of}" for word in UNCERTAIN for of in ("of", "in")))
OF = {"h": "height", "height": "height", "t": "timing", "timing": "timing"}
OF |= {word: name for word, name in KNOWN.items() if name in (*MEASURED, *OBSERVED)}
OF = {w: "uncertainty" if n == "restitution" else f"{n}_uncertainty" for w, n in OF.items()}
SPELLED = {f"{before}_{word}": name for before in BEFORE for word, name in OF.items()}
SPELLED |= {f"{word}_{after}": name for after in UNCERTAIN for word, name in OF.items()}
SPELLED |= {f"±{word}": name for word, name in OF.items()}
ALONE = "unc error err stdev std sd ± standard_deviation standard_uncertainty standard_error"
KNOWN |= dict.fromkeys(ALONE.split(), "uncertainty")
NEAR = 0.82  # of difflib: velocty is near to velocity, interval_index is not to interval
LONGEST = 200  # characters of a header that may be a name


class Header(NamedTuple):
    """One column's header.

    Attributes:
        text: as written.
        name: one of `SI_UNITS`, or a key of `AMBIGUOUS`, or None for a column that is not known.
        words: `text` without its unit, as `plain` writes it.
        unit: as written, or None.
    """

    text: str
    name: str | None
    words: str
    unit: str | None


def read_header(text: str) -> Header:
    """Name and unit of one header.

    Raises:
        DataError: for a name near to a known one, or brackets that are no unit's.
    """
    text = str(text).strip()
    if len(text) > LONGEST:
        return Header(text, None, "", None)
    for words, unit, is_sure in _readings(text):
        name = canonical(words) or (plain(words) if plain(words) in AMBIGUOUS else None)
        if name is not None and (is_sure or is_unit(unit, si_unit_of(name)) or unit == "%"):
            return Header(text, name, plain(words), unit)
    base = re.split(r"[\[(]", text, maxsplit=1)[0]
    if canonical(base) is not None:
        raise DataError("column", repr(text), "a name and one unit, as in `velocity [m/s]`")
    near = get_close_matches(plain(base), [n for n in KNOWN if len(n) > 3], n=1, cutoff=NEAR)
    if near:
        accepted = f"a known name (did you mean {near[0]!r}?), or a clearly different name"
        raise DataError("column", repr(text), accepted)
    return Header(text, None, plain(text), None)


def si_unit_of(name: str) -> str:
    return SI_UNITS[AMBIGUOUS[name][0] if name in AMBIGUOUS else name]


def canonical(words: str) -> str | None:
    """The format's name for what a person calls a column; None where there is none."""
    name = plain(words)
    return KNOWN.get(name) or SPELLED.get(name)


def plain(words: str) -> str:
    """Small letters, one underscore for all that separates, subscripts on the line."""
    text = unicodedata.normalize("NFKC", words).casefold().replace("′", "'")
    return re.sub(r"[\s_.\-(){}$\\]+", "_", text).strip("_")


def _readings(text: str):
    """(name, unit, whether the unit is surely one) in the ways that a header may be meant."""
    yield text, None, True
    bracket = re.fullmatch(r"(.*?)\s*(?:\[([^\[\]]*)\]|\(((?:[^()]|\([^()]*\))*)\))", text)
    if bracket:
        yield bracket[1], (bracket[2] or bracket[3] or "").strip() or None, True
    for mark in ("/", ",", " in ", "_"):
        for match in re.finditer(re.escape(mark), text):
            unit = re.sub(r"^\((.*)\)$", r"\1", text[match.end() :].strip())
            if mark == "/" or unit not in ("1", "-"):  # e_1 is the first of several
                yield text[: match.start()], unit, False
