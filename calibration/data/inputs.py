"""Inputs of a measurement that all its rows have in common, and their standard uncertainties.

    youngs_modulus, poisson_ratio, density, yield_strength    of the first body; of the other body
                                                              wall.… or second.…
    radius or diameter (…_1, …_2), mass, gravity
    height_offset, height_scale, velocity_scale, time_scale   of the instruments

Readings become quantities as h = height_scale · reading + height_offset, and velocities and times
likewise with their scale: the uncertainty of a scale (1 ± 0.002) is a camera's calibration, that of
the offset (0 ± 0.5 mm) a ruler's zero. Data of arrays have the leaves of their contact instead,
contact.youngs_modulus and so on, and velocity_scale.

A text states a number with its standard uncertainty: "115 ± 5 GPa", "115 GPa ± 4 %", "115(5) GPa".

Source: JCGM 100:2008 (GUM), 4.3 and 7.2.2 (the notation).
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol

import numpy as np

from calibration.data.units import NUMBER, parted, quantity
from calibration.errors import DataError, did_you_mean, is_finite_number, listed

PROPERTIES = {"youngs_modulus": "Pa", "poisson_ratio": "1", "density": "kg/m^3"}
PROPERTIES |= {"yield_strength": "Pa"}
SIZES = dict.fromkeys(
    ("radius", "radius_1", "radius_2", "diameter", "diameter_1", "diameter_2"), "m"
)
INSTRUMENTS = {"height_offset": "m", "height_scale": "1", "velocity_scale": "1", "time_scale": "1"}
EXACT = {"height_offset": 0.0, "height_scale": 1.0, "velocity_scale": 1.0, "time_scale": 1.0}
# which readings each instrument's error enters, by the endings of their columns' names
READINGS: dict[str, tuple[str, ...]] = dict.fromkeys(("height_offset", "height_scale"), ("height",))
READINGS |= {"velocity_scale": ("velocity",), "time_scale": ("interval", "time")}
NOT_READ = ("contact_time",)  # of a sensor of its own
OTHERS = ("wall", "second")  # the other body
OF_ENTRY = PROPERTIES | SIZES | {"mass": "kg", "gravity": "m/s^2"} | INSTRUMENTS
OF_FILES = OF_ENTRY | {f"{o}.{name}": unit for o in OTHERS for name, unit in PROPERTIES.items()}
LEAVES = {"youngs_modulus": "Pa", "radius": "m", "mass": "kg", "yield_strength": "Pa"}
LEAVES |= {"limit_velocity": "m/s"}
OF_ARRAYS = {f"contact.{name}": unit for name, unit in LEAVES.items()} | {"velocity_scale": "1"}
UNITS = OF_FILES | OF_ARRAYS

UNIT = r"(?![eE][+-]?\d)[^\d\s.,()±+-][^()±]*?"
BETWEEN = r"\s*(?:±|\+/-|\+-)\s*"
BEHIND = re.compile(rf"({NUMBER}){BETWEEN}({NUMBER})\s*({UNIT})?")
EACH = re.compile(rf"({NUMBER})\s*({UNIT}){BETWEEN}({NUMBER})\s*({UNIT})")
CONCISE = re.compile(rf"([+-]?\d+(?:\.(\d*))?)\((\d+(?:\.\d+)?)\)([eE][+-]?\d+)?\s*({UNIT})?")


def divided(text: str) -> tuple[str, str] | None:
    """The value and the standard uncertainty of a text that states both; None for any other.

    >>> divided("115 ± 5 GPa"), divided("1.15(5)e11 Pa"), divided("0.33 +/- 2 %"), divided("5 mm")
    (('115 GPa', '5 GPa'), ('1.15e11 Pa', '0.05e11 Pa'), ('0.33', '2 %'), None)
    """
    text = text.strip()
    if match := EACH.fullmatch(text):
        number, unit, size, of_size = match.groups()
        return f"{number} {unit}", f"{size} {of_size}"
    if match := BEHIND.fullmatch(text):
        number, size, unit = match.groups()
        own = None if unit == "%" else unit  # a relative one says nothing of the value's unit
        return _with(number, own), _with(size, unit)
    if match := CONCISE.fullmatch(text):
        number, decimals, digits, power, unit = match.groups()
        size = digits if "." in digits else _shifted(digits, len(decimals or ""))
        return _with(number + (power or ""), unit), _with(size + (power or ""), unit)
    return None


def _with(number: str, unit: str | None) -> str:
    return number if unit is None else f"{number} {unit}"


def _shifted(digits: str, decimals: int) -> str:
    """The digits as the last ones of a number with so many decimals."""
    padded = digits.rjust(decimals + 1, "0")
    return padded if not decimals else f"{padded[:-decimals]}.{padded[-decimals:]}"


def standard_uncertainty(name: str, stated: Any, value: float) -> float:
    """A stated uncertainty of an input in SI: a number, or text with its unit or in per cent.

    Raises:
        DataError: naming the input, what was stated and what is accepted.
    """
    si, size = UNITS[name], stated
    accepted = f"a positive number [{si}], or text with its unit or in %"
    if isinstance(stated, str):
        try:
            number, unit = parted(stated, si)
            size = abs(value) * number / 100 if unit == "%" else quantity(stated, si)
        except DataError as error:
            try:
                size = float(stated)
            except ValueError:
                raise DataError(f"{name}_uncertainty", repr(stated), error.accepted) from None
    if not is_finite_number(size) or size <= 0:
        raise DataError(f"{name}_uncertainty", repr(stated), accepted)
    return float(size)


def corrected(
    columns: Mapping[str, np.ndarray], instruments: Mapping[str, float]
) -> dict[str, np.ndarray]:
    """Readings in SI as quantities, scale · reading + offset, by the names of their columns.

    Raises:
        DataError: naming an instrument whose readings the table does not have.
    """
    now = dict(columns)
    for name in sorted(instruments, key=lambda name: name.endswith("offset")):  # the scale first
        read = [c for c in columns if c.endswith(READINGS[name]) and c not in NOT_READ]
        if not read:
            what = name.partition("_")[0]
            raise DataError(name, "given", f"left out where no {what} is measured")
        for column in read:
            change = instruments[name]
            now[column] = now[column] + change if name.endswith("offset") else now[column] * change
    return now


class Input(NamedTuple):
    """An input of one data set, in SI."""

    name: str
    value: float
    uncertainty: float

    @property
    def unit(self) -> str:
        return UNITS[self.name]


def stated_inputs(stated: Mapping[str, Any] | None, names: Sequence[str]) -> list[dict[str, Any]]:
    """Stated uncertainties of each data set: those for all sets, and those under the name of one.

        {"youngs_modulus": 5e9, "wall.yield_strength": "10 %", "brass": {"diameter": "0.02 mm"}}

    Raises:
        DataError: naming an unknown input or data set, and what is accepted.
    """
    if not isinstance(stated, Mapping | None):
        raise DataError(
            "inputs", stated, "a mapping: names of inputs to their standard uncertainties"
        )
    common: dict[str, Any] = {}
    own: dict[str, dict[str, Any]] = {name: {} for name in names}
    for name, size in (stated or {}).items():
        if isinstance(size, Mapping):
            if name not in own:
                raise DataError("inputs", repr(name), f"named after a data set: {listed(names)}")
            own[name] = dict(size)
        else:
            common[name] = size
    for name in (n for each in (common, *own.values()) for n in each):
        if name not in UNITS:
            accepted = f"one of {listed([*OF_ARRAYS, *OF_ENTRY])}, or with wall. or second. before"
            raise DataError("inputs", repr(name), accepted + did_you_mean(name, UNITS))
    return [common | own[name] for name in names]


class Source(Protocol):
    """Inputs of a data set, and the data with some of them moved."""

    @property
    def stated(self) -> tuple[Input, ...]:
        """The inputs whose uncertainty the source states."""

    @property
    def exact(self) -> tuple[str, ...]:
        """Properties and sizes of the bodies that are taken as exact unless they are stated otherwise."""

    def value(self, name: str) -> float:
        """An input in SI; raises DataError for one that the data do not have."""

    def identity(self, name: str) -> Any:
        """Identity of an input: inputs of one identity, in whatever data set, have one error."""

    def moved(self, data: Any, moves: Mapping[str, float]) -> Any:
        """The data, read again with these changes of inputs [SI]."""


@dataclass(frozen=True)
class OfArrays:
    """The inputs of data that were given as arrays: leaves of the contact, and the scale of velocities."""

    contact: Any  # a softjax.Contact, or None
    owner: str  # name of the data set

    stated: tuple[Input, ...] = ()

    @property
    def exact(self) -> tuple[str, ...]:
        known = () if self.contact is None else LEAVES
        return tuple(f"contact.{name}" for name in known if name != "limit_velocity")

    def value(self, name: str) -> float:
        if name == "velocity_scale":
            return EXACT[name]
        if name not in OF_ARRAYS or self.contact is None:
            known = listed(OF_ARRAYS if self.contact is not None else ["velocity_scale"])
            accepted = f"one of {known}, as {self.owner} was not read from a file"
            raise DataError("inputs", repr(name), accepted + did_you_mean(name, OF_ARRAYS))
        return float(np.mean(getattr(self.contact, name.removeprefix("contact."))))

    def identity(self, name: str) -> Any:
        return self.owner, name

    def moved(self, data: Any, moves: Mapping[str, float]) -> Any:
        changed: dict[str, Any] = {}
        leaves = {
            n.removeprefix("contact."): x for n, x in moves.items() if n.startswith("contact.")
        }
        if leaves:
            # of pairs of several sizes all by one part
            now = {
                name: getattr(self.contact, name) * (1 + change / self.value(f"contact.{name}"))
                for name, change in leaves.items()
            }
            changed["contact"] = replace(data.contact, **now)
            changed["limit_velocity"] = now.get("limit_velocity", data.limit_velocity)
        if "velocity_scale" in moves:
            changed["velocity"] = data.velocity * (1 + moves["velocity_scale"])
        return replace(data, **changed)
