"""Inputs of a study on the command line: names, ranges, and inputs that are not varied."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from calibration.errors import DataError, listed
from calibration.studies.inputs import Inputs, OfBodies, OfLaw, as_fitted, check_ranges, of_law
from calibration.symbols import in_math
from softjax.fields import declarations, options_of, whole_fields

PART = 0.1  # half-width of a range, relative to the value of the input
SPREAD = {"uniform": "uniform", "log": "uniform in its logarithm"}
IS_ZERO = "zero, so that ±10 % is no range"
IS_NEGATIVE = "below zero, without a logarithm"
IS_FIXED = "fixed in the fit"
OF_ONE_SIZE = "radius and mass of a sphere change together"
OF_SIZE = ("radius", "mass")  # of a contact


@dataclass(frozen=True)
class Ranges:
    """(low, high) by name, a sentence on their origin, and reasons for inputs without a range."""

    of: Mapping[str, tuple[float, float]]
    assumed: str
    left_out: Mapping[str, str] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        return {"assumed": self.assumed, "left_out": dict(self.left_out)}

    def text(self, inputs: Inputs) -> str:
        """Lines on the assumption, and on the inputs that are not varied."""
        lines = [f"Assumed: {self.assumed}."]
        for why in dict.fromkeys(self.left_out.values()):
            names = [_name_of(inputs, name) for name, one in self.left_out.items() if one == why]
            lines.append(f"Not varied ({why}): {listed(names)}.")
        return "\n".join(lines)

    def title(self, inputs: Inputs) -> str:
        """Title of a picture: the assumption, with symbols only."""
        symbols = [in_math(inputs.declared(name).symbol) for name in self.left_out]
        return self.assumed + (f"\nnot varied: {', '.join(symbols)}" if symbols else "")


def _name_of(inputs: Inputs, name: str) -> str:
    """Symbol and name of an input; the symbol alone if they are equal."""
    symbol = inputs.declared(name).symbol
    return symbol if symbol == name else f"{symbol} ({name})"


def inputs_of(source: Any) -> Inputs:
    """Inputs of a study: the bodies' properties if they determine the contact, else the fields of the law.

    If a fit determines σ and ψ only through ε_up, ε_up replaces them.
    """
    inputs = _inputs_of(source)
    return (
        inputs if source.result is None else as_fitted(inputs, source.result.material(source.name))
    )


def _inputs_of(source: Any) -> Inputs:
    law, contact = source.law, getattr(source.law, "contact", None)
    if source.properties is None or contact is None or whole_fields(type(law)):
        return of_law(law)
    options = tuple((name, getattr(law, name)) for name in options_of(type(law)))
    fields = {name: float(getattr(law, name)) for name in declarations(type(law))}
    build = OfBodies(source.bodies, type(law), contact.area, options)
    inputs = Inputs(source.properties | fields, build)
    built = inputs.law().contact  # type: ignore[attr-defined]
    one, other = (list(each.leaves().values()) for each in (contact, built))
    # a fit may have changed the bodies' properties
    return inputs if np.allclose(one, other, rtol=1e-9, atol=0) else of_law(law)


def ranges_of(stated: list[str] | None, scale: str, inputs: Inputs, source: Any) -> Ranges:
    """Read `name=low:high`, or take ±10 % of every independent input.

    Raises:
        DataError: for a text that is no range, or a range over which the law does not exist.
    """
    if not stated:
        fit = None if source.result is None else source.result.material(source.name)
        return _usual(inputs, scale, fit)
    ranges = {}
    for text in stated:
        name, _, ends = text.partition("=")
        name = name.strip().replace("-", "_")
        if name not in inputs.values:
            accepted = f"NAME=LOW:HIGH, NAME one of {listed(inputs.values)}"
            raise DataError("--range", text, accepted)
        ranges[name] = pair("--range", text, ends)
    check_ranges(inputs, ranges, "--range")
    return Ranges(ranges, f"each input {SPREAD[scale]} over its range, independently")


def _usual(inputs: Inputs, scale: str, fit: Any) -> Ranges:
    """±10 % of every independent input, inside its declared range.

    Args:
        inputs: inputs of the study.
        scale: "uniform" or "log".
        fit: the `MaterialFit` of the law, whose fixed parameters are not varied; None without a fit.
    """
    left_out = {n: why for n, x in inputs.values.items() if (why := _why(inputs, n, x, scale, fit))}
    ends, cut = {}, []
    for name in (name for name in inputs.values if name not in left_out):
        value, declared = inputs[name], inputs.declared(name)
        low, high = value - PART * abs(value), value + PART * abs(value)
        ends[name] = max(low, declared.lower), min(high, declared.upper)
        if ends[name] != (low, high):
            end = declared.lower if low < declared.lower else declared.upper
            cut.append(f"{declared.symbol} no further than {end:g}")
    within = f"within ±{100 * PART:g} % of its value" + (f" ({listed(cut)})" if cut else "")
    assumed = f"each input {SPREAD[scale]} {within}, independently"
    check_ranges(inputs, ends, "--range")
    return Ranges(ends, assumed, left_out)


def _why(inputs: Inputs, name: str, value: float, scale: str, fit: Any) -> str:
    """The reason why an input is not varied, or an empty text."""
    if value == 0:
        return IS_ZERO
    if value < 0 and scale == "log":
        return IS_NEGATIVE
    if fit is not None and name in fit.parameters and not fit.parameters[name].free:
        return IS_FIXED
    law = getattr(inputs.build, "law", None)
    of_contact = isinstance(inputs.build, OfLaw) and name not in declarations(type(law))
    return OF_ONE_SIZE if of_contact and name.rpartition(".")[2] in OF_SIZE else ""


def pair(option: str, text: str, ends: str) -> tuple[float, float]:
    """Read both numbers of `low:high`."""
    low, _, high = ends.partition(":")
    return number(option, text, low, "LOW:HIGH"), number(option, text, high, "LOW:HIGH")


def number(option: str, text: str, digits: str, accepted: str) -> float:
    """A number in the text of an option."""
    try:
        return float(digits)
    except ValueError:
        raise DataError(option, text, accepted) from None
