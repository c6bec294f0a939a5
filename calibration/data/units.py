"""Units of measured quantities, as people write them, and quantities with their unit as text.

    unit_of("mm s⁻¹", "speed")          # 1/1000
    quantity("69 GPa", "pressure")      # 6.9e10
    quantity("5 %", "speed")            # Relative(0.05): of the quantity itself

Micro is u, µ or μ; powers are ^-1, -1 or ⁻¹; factors are separated by a space, a point or nothing.
Only of lengths, times and speeds may the case of letters be another (`KM/H`, but never mpa).
"""

import re
from fractions import Fraction
from itertools import product
from typing import Any

from calibration.errors import DataError, did_you_mean, listed, shown

PERCENT = Fraction(1, 100)
LENGTHS = {"m": Fraction(1), "cm": Fraction(1, 100), "mm": Fraction(1, 1000)}
LENGTHS |= {"in": Fraction(254, 10000), "ft": Fraction(3048, 10000)}
LENGTHS |= {"um": Fraction(1, 10**6), "km": Fraction(1000)}
TIMES = {"s": Fraction(1), "ms": Fraction(1, 1000), "us": Fraction(1, 10**6)}
TIMES |= {"sec": Fraction(1), "min": Fraction(60), "h": Fraction(3600)}
MASSES = {"kg": Fraction(1), "g": Fraction(1, 1000), "t": Fraction(1000)}
VOLUMES = {"m": Fraction(1), "cm": Fraction(1, 10**6), "dm": Fraction(1, 1000)}  # of such edges
PSI = Fraction(8896443230521, 1290320000)  # 0.45359237 kg · 9.80665 m/s² over a square inch


def _quotients(above: dict, below: dict, power: str = "") -> dict[str, Fraction]:
    """`m/s`, `m s^-1`, `m s-1`, and `ms^-1`, `ms-1`, `m_s` where the lower unit is one letter."""
    found = {}
    for (one, size), (two, divisor) in product(above.items(), below.items()):
        down = power or "1"
        forms = [f"{one}/{two}^{power}", f"{one}/{two}{power}"] if power else [f"{one}/{two}"]
        forms += [f"{one} {two}^-{down}", f"{one} {two}-{down}"]
        if len(two) == 1:  # else mms-1 could be a metre a millisecond
            forms += [f"{one}{two}^-{down}", f"{one}{two}-{down}", f"{one}_{two}{power}"]
        found |= dict.fromkeys(forms, size / divisor)
    return found


# the first of each are those that a refusal names
UNITS: dict[str, dict[str, Fraction]] = {
    "speed": {"m/s": Fraction(1), "cm/s": Fraction(1, 100), "mm/s": Fraction(1, 1000)}
    | {"km/h": Fraction(5, 18), "ft/s": LENGTHS["ft"], "in/s": LENGTHS["in"]}
    | _quotients(LENGTHS, TIMES)
    | {"mps": Fraction(1), "fps": LENGTHS["ft"], "kmh": Fraction(5, 18), "kph": Fraction(5, 18)}
    | {"mph": Fraction(1609344, 3600000)},
    "length": LENGTHS,
    "time": TIMES,
    "ratio": {"-": Fraction(1), "1": Fraction(1), "%": PERCENT},
    "pressure": {"Pa": Fraction(1), "kPa": Fraction(10**3), "MPa": Fraction(10**6)}
    | {"GPa": Fraction(10**9), "TPa": Fraction(10**12), "psi": PSI, "ksi": 1000 * PSI}
    | _quotients({"N": Fraction(1)}, {"m": Fraction(1), "mm": Fraction(1, 10**6)}, "2"),
    "density": {"kg/m^3": Fraction(1), "g/cm^3": Fraction(1000)}
    | _quotients(MASSES, VOLUMES, "3")
    | {"g/cc": Fraction(1000), "g/ml": Fraction(1000), "kg/l": Fraction(1000)},
    "acceleration": _quotients({"m": Fraction(1), "cm": LENGTHS["cm"]}, {"s": Fraction(1)}, "2"),
    "label": {},
}
TOLD = 6  # units of a dimension that a refusal names
LONGEST = 100  # characters of a quantity that are looked at
ANY_CASE = ("speed", "length", "time")
SIGNS = str.maketrans(
    {"⁻": "-", "−": "-", "¹": "1", "²": "2", "³": "3", "µ": "u", "μ": "u"}
    | dict.fromkeys("⋅·*,", " ")
    | dict.fromkeys("{}$\\", None)
)
NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"


class Relative(float):
    """An uncertainty told as a fraction of the quantity itself: 0.05 for 5 %."""


def unit_of(text: str, dimension: str) -> Fraction:
    """The unit's size in SI.

    Raises:
        DataError: for a unit that is not of this dimension, with those that are.
    """
    size = _find(text, dimension)
    if size is None:
        accepted = f"in {listed(list(UNITS[dimension])[:TOLD])}" if UNITS[dimension] else "left out"
        name = _plain(text)
        alike = next((unit for unit in UNITS[dimension] if unit.lower() == name.lower()), None)
        near = f" (did you mean {alike!r}?)" if alike else did_you_mean(name, UNITS[dimension])
        raise DataError("unit", f"[{shown(text)}]", accepted + near)
    return size


def is_unit(text: str, dimension: str) -> bool:
    return _find(text, dimension) is not None


def in_si(values: Any, unit: Fraction) -> Any:
    """Values, a number or an array, in SI: one product and one quotient of whole numbers.

    They round as well as can be: 12 cm/s is the double nearest to 0.12 m/s, so that repeats in
    other units meet.
    """
    return values * unit.numerator / unit.denominator


def quantity(text: str, dimension: str) -> float:
    """A number with its unit, such as `12.7 mm`, in SI; a percentage is a `Relative`.

    Raises:
        DataError: for anything else.
    """
    match = re.fullmatch(rf"({NUMBER})\s*([^\d\s.,eE+-].*)", text.strip()[:LONGEST])
    if match is None:
        example = next(iter(UNITS[dimension]))
        raise DataError("quantity", repr(text), f"a number, or one with its unit, `1.5 {example}`")
    if _plain(match[2]) == "%":
        return Relative(_exactly(match[1], PERCENT))
    return _exactly(match[1], unit_of(match[2], dimension))


def _exactly(text: str, unit: Fraction) -> float:
    """The double nearest to a decimal number of units."""
    if 1e-200 < abs(float(text)) < 1e200:  # else as a fraction it may have any number of digits
        return float(Fraction(text) * unit)
    return in_si(float(text), unit)


def _find(text: str, dimension: str) -> Fraction | None:
    units, name = UNITS[dimension], _plain(text)
    lower = units.get(name.lower()) if dimension in ANY_CASE else None
    return units.get(name, lower)


def _plain(text: str) -> str:
    """One spelling: no superscripts, no Greek, one space at most."""
    return " ".join(text.translate(SIGNS).replace(" per ", "/").replace(" / ", "/").split())
