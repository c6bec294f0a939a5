"""What a command asks a study: which numbers are inputs, and over which ranges."""

import math
from typing import Any

from calibration.errors import DataError, listed
from calibration.studies.inputs import Inputs, OfBodies, of_law
from calibration.studies.ranges import told_ranges, usual_ranges
from softjax.fields import declarations, options_of, whole_fields


def inputs_of(source: Any) -> Inputs:
    """The bodies' properties where they make the law's contact, else the law's own fields."""
    law, contact = source.law, getattr(source.law, "contact", None)
    if source.properties is None or contact is None or whole_fields(type(law)):
        return of_law(law)
    options = tuple((name, getattr(law, name)) for name in options_of(type(law)))
    fields = {name: float(getattr(law, name)) for name in declarations(type(law))}
    build = OfBodies(source.bodies, type(law), law.contact.area, options)
    inputs = Inputs(source.properties | fields, build)
    return inputs if _same(contact, inputs.law().contact) else of_law(law)


def _same(one: Any, other: Any) -> bool:
    """Whether two contacts are one: a fit may have changed the bodies' properties."""
    pairs = zip(one.leaves().values(), other.leaves().values(), strict=True)
    return all(math.isclose(a, b, rel_tol=1e-9) for a, b in pairs)


def ranges_of(told: list[str] | None, scale: str, inputs: Inputs, source: Any) -> Any:
    """`name=low:high`, or a tenth to either side of every input that moves by itself."""
    if not told:
        fit = None if source.result is None else source.result.material(source.name)
        return usual_ranges(inputs, scale, fit)
    ranges = {}
    for text in told:
        name, _, ends = text.partition("=")
        name = name.strip().replace("-", "_")
        if name not in inputs.values:
            accepted = f"NAME=LOW:HIGH, NAME one of {listed(inputs.values)}"
            raise DataError("--range", text, accepted)
        ranges[name] = pair("--range", text, ends)
    return told_ranges(ranges, scale)


def pair(option: str, text: str, ends: str) -> tuple[float, float]:
    """Both numbers of `low:high`."""
    low, _, high = ends.partition(":")
    return number(option, text, low, "LOW:HIGH"), number(option, text, high, "LOW:HIGH")


def number(option: str, text: str, digits: str, accepted: str) -> float:
    """A number in the text of an option."""
    try:
        return float(digits)
    except ValueError:
        raise DataError(option, text, accepted) from None
