"""Over which ranges inputs are varied unless told, and what of them is left out, and why."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from calibration.errors import listed
from calibration.report.symbols import in_math
from calibration.studies.inputs import Inputs, OfLaw
from softjax.fields import declarations

PART = 0.1  # of an input's value, to either side
SPREAD = {"uniform": "uniform", "log": "uniform in its logarithm"}
IS_ZERO = "0, of which a part is nothing"
IS_HELD = "not fitted"
OF_ONE_SIZE = "of spheres, whose mass follows their radius: the one does not move without the other"
OF_SIZE = ("radius", "mass")  # of a contact


@dataclass(frozen=True)
class Ranges:
    """(low, high) by name, a sentence on how they came about, and reasons for what has none."""

    of: Mapping[str, tuple[float, float]]
    assumed: str
    left_out: Mapping[str, str] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        return {"assumed": self.assumed, "left_out": dict(self.left_out)}

    def text(self, inputs: Inputs) -> str:
        """A line on what is assumed, and one a reason on what is left out."""
        lines = [f"Assumed: {self.assumed}."]
        for why in dict.fromkeys(self.left_out.values()):
            names = [name_of(inputs, name) for name, one in self.left_out.items() if one == why]
            lines.append(f"Left out ({why}): {listed(names)}.")
        return "\n".join(lines)

    def title(self, inputs: Inputs) -> str:
        """The same above a picture: symbols only."""
        symbols = [in_math(inputs.declared(name).symbol) for name in self.left_out]
        return self.assumed + (f"\nleft out: {', '.join(symbols)}" if symbols else "")


def name_of(inputs: Inputs, name: str) -> str:
    """Its symbol, and its name where that says more."""
    symbol = inputs.declared(name).symbol
    return symbol if symbol == name else f"{symbol} ({name})"


def told_ranges(ranges: Mapping[str, tuple[float, float]], scale: str) -> Ranges:
    """Those that were asked for."""
    return Ranges(ranges, f"each input {SPREAD[scale]} over its range, independently")


def usual_ranges(inputs: Inputs, scale: str = "uniform", fit: Any = None) -> Ranges:
    """A tenth to either side of every input that can move by itself.

    Args:
        inputs: of the study.
        scale: "uniform" or "log".
        fit: the `MaterialFit` whose law it is; then what it held is left out too.
    """
    left_out = {n: why for n, x in inputs.values.items() if (why := _why(inputs, n, x, fit))}
    ends = {
        name: (x - PART * abs(x), x + PART * abs(x))
        for name, x in inputs.values.items()
        if name not in left_out
    }
    within = f"within ±{100 * PART:g} % of its value"
    return Ranges(ends, f"each input {SPREAD[scale]} {within}, independently", left_out)


def _why(inputs: Inputs, name: str, value: float, fit: Any) -> str:
    """Why an input is not varied, or nothing."""
    if value == 0:
        return IS_ZERO
    if fit is not None and name in fit.parameters and not fit.parameters[name].free:
        return IS_HELD
    law = getattr(inputs.build, "law", None)
    of_contact = isinstance(inputs.build, OfLaw) and name not in declarations(type(law))
    return OF_ONE_SIZE if of_contact and name.rpartition(".")[2] in OF_SIZE else ""
