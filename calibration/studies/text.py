"""Studies in words: tables for the terminal, and sensitivities over velocity as CSV."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from calibration import console
from calibration.curves import status_names
from calibration.data.air import Fall
from calibration.errors import listed
from calibration.fitting.warnings import FitWarning
from calibration.studies.design import Design
from calibration.studies.information import Information
from calibration.studies.local import Sensitivities
from calibration.studies.sobol import SobolIndices


def local_table(found: Sensitivities) -> str:
    """θ ∂ε/∂θ, an input a line, a velocity a column."""
    lines = (
        (one.symbol, [f"{round(x, 5) + 0.0:.5f}" for x in found.of(name)])
        for name, one in found.declared.items()
    )
    return _table("θ ∂ε/∂θ at v [m/s]", found.velocity, lines, 11)


def limits_table(found: Sensitivities, limits: Mapping[str, tuple], confidence: float) -> str:
    """Central limits of θ ∂ε/∂θ over draws of a posterior, an input a line."""
    lines = (
        (one.symbol, [f"{a + 0.0:.4f} … {b + 0.0:.4f}" for a, b in zip(*limits[name], strict=True)])
        for name, one in found.declared.items()
    )
    head = f"{100 * confidence:g} % of draws at v [m/s]"
    return _table(head, found.velocity, lines, 20)


def sobol_table(found: SobolIndices) -> str:
    """First-order and total indices, an input a line, a velocity a column; what does not rebound."""
    pairs = zip(found.symbols, found.first.T, found.total.T, strict=True)
    lines = (
        (symbol, [f"{a + 0.0:.3f} ({b + 0.0:.3f})" for a, b in zip(*both, strict=True)])
        for symbol, *both in ((s, first.round(3), total.round(3)) for s, first, total in pairs)
    )
    velocity = np.ravel(found.velocity)
    table = _table("Sobol indices, first (total) at v [m/s]", velocity, lines, 18)
    still = zip(np.ravel(found.zeros), velocity, strict=True)
    shares = listed(f"{100 * share:.3g} % at {v:.4g} m/s" for share, v in still if share)
    return table + (f"\nSamples that do not rebound, ε = 0: {shares}." if shares else "")


def information_text(found: Information) -> str:
    """Directions in words, then the standard errors."""
    lines = [wrapped(str(found))]
    every = zip(found.symbols, found.truth, found.standard_errors.items(), strict=True)
    for symbol, value, (name, error) in every:
        text = f"expected standard error of {symbol}: {_error(error)}"
        if found.before is not None:
            now = found.before[name]
            text += f" (now {_error(None if now is None else now * abs(value or 1.0))})"
        lines.append(text)
    return "\n".join(lines)


def _error(error: float | None) -> str:
    return "not determined" if error is None else f"{error:.3g}"


def sensitivities_csv(found: Sensitivities) -> str:
    """θ ∂ε/∂θ and ∂ln ε/∂ln θ of every input; an empty cell where ε = 0."""
    kinds = [f"{n} d(eps)/d({n})" for n in found.names], [f"dln(eps)/dln({n})" for n in found.names]
    header = ["velocity [m/s]", "restitution", *kinds[0], *kinds[1], "status"]
    columns = [found.velocity, found.coefficient, *found.absolute.T, *found.logarithmic.T]
    lines = [",".join(header)]
    for *numbers, status in zip(*columns, found.status, strict=True):
        cells = ["" if x != x else f"{x:.17g}" for x in numbers]
        lines.append(",".join([*cells, status_names(int(status))]))
    return "\n".join(lines) + "\n"


def design_csv(found: Design, fall: Fall | None) -> str:
    """The velocities to shoot at, how often, and drop heights in the unit of the data, in their air."""
    fall = fall or Fall()
    velocity = np.array([v for v, _ in found.support])
    pairs = zip(found.support, fall.height(velocity), strict=True)
    rows = [f"{v:.6g},{shots},{height:.6g}" for (v, shots), height in pairs]
    where = " without air" * (fall.density is None)
    return "\n".join([f"velocity [m/s],shots,drop height{where} [{fall.unit}]", *rows]) + "\n"


def warnings_text(found: Sequence[FitWarning]) -> str:
    """Warnings of the fit that a plan starts from."""
    head = "The plan trusts this fit, which has these warnings:"
    return "\n".join([head, *console.wrapped(map(str, found), "  ! ", "    ")])


def wrapped(text: str) -> str:
    """Each line as wide as the terminal."""
    return "\n".join(console.wrapped(text.splitlines()))


def _table(
    head: str, velocity: Iterable[float], lines: Iterable[tuple[str, list[str]]], width: int
) -> str:
    first = head + "".join(f"{v:>{width}.4g}" for v in velocity)
    rest = (
        f"{name:<{len(head)}}" + "".join(f"{cell:>{width}}" for cell in cells)
        for name, cells in lines
    )
    return "\n".join([first, *rest])
