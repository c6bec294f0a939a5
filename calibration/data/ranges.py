"""Plausible ranges of material properties: outside them a warning, far outside a refusal."""

from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np

from calibration.errors import DataError


class Implausible(NamedTuple):
    """A warning about what was read: a name for it, the numbers it rests on, and what to look at."""

    code: str
    cause: str
    advice: str


class Range(NamedTuple):
    """Plausible range of a property, from foam and gel to diamond and osmium, and its hard limits."""

    name: str
    lowest: float
    highest: float
    unit: str
    if_below: str
    if_above: str

    @property
    def accepted(self) -> str:
        return f"{self.lowest:g} to {self.highest:g} {self.unit}"

    def is_far(self, value: Any) -> bool:
        """Whether a number, or one of an array, is more than 100 times outside."""
        return bool(np.any(value > FAR * self.highest) or np.any(value < self.lowest / FAR))


FAR = 100.0
POWER = "Is the power of ten right?"
RANGES = {
    "radius": Range("radius", 1e-6, 1.0, "m", POWER, "Is the radius in millimetres?"),
    "youngs_modulus": Range(
        "Young's modulus", 1e5, 1.3e12, "Pa", "Is the modulus in MPa or GPa?", POWER
    ),
    "density": Range(
        "density", 10.0, 23_000.0, "kg/m³", "Is the density in g/cm³?", "Is the density in kg/m³?"
    ),
    "yield_strength": Range(
        "yield strength", 1e4, 1e11, "Pa", "Is the yield strength in MPa?", POWER
    ),
}
CODES = {"youngs_modulus": "modulus", "yield_strength": "yield-strength"}
AS_IT_IS = "plausibility = false takes it as it is"


def of_bodies(bodies: Iterable[Any], contact: Any) -> Iterator[Implausible]:
    """The properties outside their plausible ranges, of the bodies or else of the contact."""
    for name, properties in _properties(bodies, contact):
        for key, value in properties.items():
            one = RANGES[key]
            low, high = float(np.min(value)), float(np.max(value))
            if low < one.lowest or high > one.highest:
                wrong, question = (
                    (high, one.if_above) if high > one.highest else (low, one.if_below)
                )
                cause = f"the {one.name} of the {name} is {wrong:.3g} {one.unit}"
                cause += f", outside {one.accepted}"
                yield Implausible(
                    CODES.get(key, key), cause.replace("the Young", "Young"), question
                )


def check_far(bodies: Iterable[Any], contact: Any) -> None:
    """Refuse properties more than 100 times outside their plausible ranges.

    Raises:
        DataError: naming the property, its value and its range.
    """
    for name, properties in _properties(bodies, contact):
        for key, value in properties.items():
            if RANGES[key].is_far(value):
                quantity = f"{float(np.ravel(value)[0]):.3g} {RANGES[key].unit}"
                accepted = f"{RANGES[key].accepted}, or 100 times outside at most; {AS_IT_IS}"
                raise DataError(f"{RANGES[key].name} of the {name}", quantity, accepted)


def _properties(bodies: Iterable[Any], contact: Any) -> list[tuple[str, dict[str, Any]]]:
    """Name and properties of each body, or of the two equal spheres (of ν = 0.3) that the contact
    could be."""
    if bodies:
        bodies_of = [(name, {"radius": radius, **one.leaves()}) for name, one, radius in bodies]
    elif contact is None:
        return []
    else:
        leaves = {name: np.asarray(leaf, float) for name, leaf in contact.leaves().items()}
        radius = 2 * leaves["radius"]
        equal = {"radius": radius, "density": 2 * leaves["mass"] / (4 / 3 * np.pi * radius**3)}
        equal["youngs_modulus"] = 2 * (1 - 0.3**2) * leaves["youngs_modulus"]
        equal["yield_strength"] = leaves["yield_strength"]
        bodies_of = [("spheres, if they are equal,", equal)]
    return [
        (name, {key: values[key] for key in RANGES if values[key] is not None})
        for name, values in bodies_of
    ]  # a wall has no radius
