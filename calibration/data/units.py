"""Units of measured quantities, as people write them, and quantities with their unit as text.

    unit_of("mm s⁻¹", "m/s")         # 1/1000
    quantity("69 GPa", "Pa")         # 6.9e10

What is a unit, and how large it is, pint knows. Sizes are exact fractions, so that 12 cm/s is the
double nearest to 0.12 m/s. Only of lengths, times and speeds may the case of letters be another
(`KM/H`, but never mpa).
"""

import re
from fractions import Fraction
from functools import cache
from typing import Any

from calibration.errors import DataError, did_you_mean, listed, shown

PERCENT = Fraction(1, 100)
# units that a refusal names, for each unit of SI
NAMED = {
    "m/s": "m/s cm/s mm/s km/h ft/s in/s",
    "m": "m cm mm in ft um",
    "s": "s ms us min h",
    "Pa": "Pa kPa MPa GPa TPa psi",
    "kg/m^3": "kg/m^3 g/cm^3 kg/dm^3 t/m^3",
    "m/s^2": "m/s^2 cm/s^2",
    "N": "N kN mN",
    "kg": "kg g mg",
    "1": "- 1 %",
    "": "",
}
ANY_CASE = ("m/s", "m", "s")
# units behind an underscore or a comma; some only as a part of a speed
IN_SPEEDS = ["h", "km"]
BARE = {
    *[
        "m",
        "cm",
        "mm",
        "um",
        "ft",
        "in",
        "s",
        "ms",
        "us",
        "N",
        "kN",
        "g",
        "kg",
        "%",
        "kmh",
        "kmph",
        "kph",
        "mph",
        "mps",
        "fps",
        "sec",
    ],
    *IN_SPEEDS,
}
NEVER = ("c",)  # the speed of light
POWERS = {"G": 9, "M": 6, "k": 3, "c": -2, "m": -3}  # of ten, that prefixes stand for
SIGNS = str.maketrans(
    {"⁻": "-", "−": "-", "¹": "1", "²": "2", "³": "3", "µ": "u", "μ": "u", "_": "/"}
    | dict.fromkeys("⋅·*,.", " ")
    | dict.fromkeys("{}$\\", None)
)
UNIT = re.compile(r"[A-Za-z][A-Za-z/ ^0-9-]{0,39}")
POWER = re.compile(r"(?<=[A-Za-z])\^?(-?[1-4])(?!\d)")
LONGEST = 100  # characters of a quantity that are read
NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"


def unit_of(text: str, si: str) -> Fraction:
    """The unit's size in a unit of SI, that of "" is none; refused with some that are accepted."""
    size = _find(text, si)
    if size is None:
        named = NAMED.get(si, si).split()
        same = next((unit for unit in named if unit.lower() == _plain(text).lower()), None)
        near = f" (did you mean {same!r}?)" if same else did_you_mean(_plain(text), named)
        accepted = f"in {listed(named)}" if named else "left out"
        raise DataError("unit", f"[{shown(text)}]", accepted + near)
    return size


def is_unit(text: str, si: str) -> bool:
    return _find(text, si) is not None


def is_other_unit(text: str, si: str) -> bool:
    """Whether this is a unit, but of another quantity than `si` is."""
    name = _plain(text)
    if _find(text, si) is not None or not UNIT.fullmatch(name) or re.search(r"\d\d", name):
        return False
    try:
        unit = _registry().parse_units(POWER.sub(r"**\1", name))
        target = _registry().parse_units(si if si not in ("1", "") else "dimensionless")
    except Exception:  # for what is no unit pint raises errors of many kinds
        return False
    return unit.dimensionality != target.dimensionality


def is_bare_unit(text: str) -> bool:
    """Whether a unit is plain enough to stand behind an underscore or a comma: `h_mm`, `v, m/s`, never `v_c`."""
    name = _plain(text).replace("µ", "u")
    atoms = [atom for atom in re.split(r"[\s/^·0-9-]+", name) if atom]
    single = len(atoms) == 1 and re.fullmatch(r"[A-Za-z%]+", name)
    of_case = [atom if atom in BARE else atom.lower() for atom in atoms]
    return bool(atoms) and all(a in BARE - {*IN_SPEEDS * bool(single)} for a in of_case)


def in_si(values: Any, unit: Fraction) -> Any:
    """Values, a number or an array, in SI: one product and one quotient of whole numbers, rounded
    as well as can be, so that repeats in other units meet."""
    return values * unit.numerator / unit.denominator


def quantity(text: str, si: str) -> float:
    """A number with its unit, such as `12.7 mm`, in SI; raises DataError."""
    number, unit = parted(text, si)
    return in_si(number, unit_of(unit, si))


def parted(text: str, si: str) -> tuple[float, str]:
    """The number and the unit of such a text."""
    match = re.fullmatch(rf"({NUMBER})\s*([^\d\s.,eE+-].*|-)", text.strip()[:LONGEST])
    if match is None:
        example = NAMED.get(si, si).split()[0]
        raise DataError("quantity", repr(text), f"a number, or one with its unit, `1.5 {example}`")
    return float(match[1]), match[2]


def _plain(text: str) -> str:
    """One spelling: no superscripts, no Greek, one space at most."""
    return " ".join(text.translate(SIGNS).replace(" per ", "/").replace(" / ", "/").split())


@cache
def _find(text: str, si: str) -> Fraction | None:
    name = _plain(text)
    if si in ("1", ""):
        return {"-": Fraction(1), "1": Fraction(1), "%": PERCENT}.get(name) if si else None
    # `kg/m3` too; without pint, which takes a tenth of a short fit
    if POWER.sub(r"^\1", name) == si:
        return Fraction(1)
    if name in NEVER:
        return None
    forms = [name, name.lower()] if si in ANY_CASE else [name]
    # ms-1 is a millisecond's inverse, or a metre a second
    forms += [re.sub(r"(?<=[a-zN])([a-z]\^?-[1-3])$", r" \1", form) for form in forms]
    return next((size for form in forms if (size := _size(form, si)) is not None), None)


def _size(name: str, si: str) -> Fraction | None:
    if not UNIT.fullmatch(name) or re.search(r"\d\d", name):
        return None
    if name.endswith(si) and si[0] != "k" and (prefix := name.removesuffix(si)) in POWERS:
        return Fraction(10) ** POWERS[prefix]
    registry = _registry()
    try:
        stated, target = (registry.parse_units(POWER.sub(r"**\1", unit)) for unit in (name, si))
        if stated.dimensionality != target.dimensionality:
            return None
        return Fraction(registry.Quantity(Fraction(1), stated).m_as(target))
    except Exception:  # for what is no unit pint raises errors of many kinds
        return None


@cache
def _registry() -> Any:
    import pint

    registry = pint.UnitRegistry(non_int_type=Fraction)
    registry.define("kmh = kilometer / hour = kmph")  # and no thousands of mph
    return registry
