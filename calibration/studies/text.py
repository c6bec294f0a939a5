"""Studies in words: tables for the terminal, and columns of CSV."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from calibration import console
from calibration.curves import status_names
from calibration.data.air import Fall
from calibration.errors import listed
from calibration.fitting.warnings import FitWarning
from calibration.studies.designs import Design
from calibration.studies.plans import Information
from calibration.studies.sensitivities import Sensitivities, SobolIndices


def local_table(sensitivities: Sensitivities) -> str:
    """θ ∂ε/∂θ, an input a line, a velocity a column."""
    cells = np.vectorize(lambda x: f"{round(x, 5) + 0.0:.5f}")(sensitivities.absolute)
    return _table(
        "θ ∂ε/∂θ at v [m/s]", sensitivities.velocity, _symbols(sensitivities), cells.T, 11
    )


def sobol_table(indices: SobolIndices) -> str:
    """First-order and total indices, an input a line, a velocity a column; what does not rebound."""
    first, total = (x.T.round(3) + 0.0 for x in (indices.first, indices.total))
    cells = np.vectorize(lambda a, b: f"{a:.3f} ({b:.3f})")(first, total)
    velocity = np.ravel(indices.velocity)
    table = _table("Sobol indices, first (total) at v [m/s]", velocity, indices.symbols, cells, 18)
    still = zip(indices.zeros, velocity, strict=True)
    shares = listed(f"{100 * share:.3g} % at {v:.4g} m/s" for share, v in still if share)
    return table + (f"\nSamples that do not rebound, ε = 0: {shares}." if shares else "")


def information_text(information: Information) -> str:
    """Directions in words, then the standard errors."""

    def shown(error: float | None, unit: float = 1.0) -> str:
        return "not determined" if error is None else f"{error * unit:.3g}"

    lines = [wrapped(str(information))]
    parameters = zip(
        information.symbols, information.truth, information.standard_errors.items(), strict=True
    )
    for symbol, value, (name, error) in parameters:
        now = (
            "" if information.before is None else shown(information.before[name], abs(value or 1.0))
        )
        text = f"expected standard error of {symbol}: {shown(error)}"
        lines.append(text + (f" (now {now})" if now else ""))
    return "\n".join(lines)


def sensitivities_csv(sensitivities: Sensitivities) -> str:
    """θ ∂ε/∂θ and ∂ln ε/∂ln θ of every input; an empty cell where ε = 0."""
    kinds = (
        [f"{n} d(eps)/d({n})" for n in sensitivities.names],
        [f"dln(eps)/dln({n})" for n in sensitivities.names],
    )
    lines = [["velocity [m/s]", "restitution", *kinds[0], *kinds[1], "status"]]
    columns = [
        sensitivities.velocity,
        sensitivities.coefficient,
        *sensitivities.absolute.T,
        *sensitivities.logarithmic.T,
    ]
    for *numbers, status in zip(*columns, sensitivities.status, strict=True):
        cells = ["" if x != x else f"{x:.17g}" for x in numbers]
        lines.append([*cells, status_names(int(status))])
    return "".join(",".join(line) + "\n" for line in lines)


def design_csv(design: Design, fall: Fall | None) -> str:
    """The velocities to shoot at, how often, and drop heights in the unit of the data, in their air."""
    fall = fall or Fall()
    rows = [f"{v:.6g},{n},{height}" for (v, n), height in zip(*_drops(design, fall), strict=True)]
    where = " without air" * (fall.density is None)
    return "\n".join([f"velocity [m/s],shots,drop height{where} [{fall.unit}]", *rows]) + "\n"


def drops_text(design: Design, fall: Fall) -> str:
    """The heights of planned drops."""
    drops = [
        f"{n} from {height} {fall.unit}"
        for (_, n), height in zip(*_drops(design, fall), strict=True)
    ]
    return f"Drop heights: {', '.join(drops)}."


def _drops(design: Design, fall: Fall) -> tuple[list[tuple[float, int]], list[str]]:
    """Velocity and number of the shots, and the heights that they fall from, to four digits."""
    heights = fall.height(np.array([v for v, _ in design.support]))
    return design.support, [f"{float(f'{height:.4g}'):g}" for height in heights]


def warnings_text(warnings: Sequence[FitWarning]) -> str:
    """Warnings of the fit that a plan starts from."""
    head = "The plan relies on this fit, which has these warnings:"
    return "\n".join([head, *console.wrapped(map(str, warnings), "  ! ", "    ")])


def wrapped(text: str) -> str:
    """Each line as wide as the terminal."""
    return "\n".join(console.wrapped(text.splitlines()))


def _symbols(sensitivities: Sensitivities) -> list[str]:
    return [declared.symbol for declared in sensitivities.declared.values()]


def _table(head: str, velocity: Any, names: Iterable[str], cells: Any, width: int) -> str:
    lines = [head + "".join(f"{v:>{width}.4g}" for v in velocity)]
    for name, row in zip(names, cells, strict=True):
        lines.append(f"{name:<{len(head)}}" + "".join(f"{cell:>{width}}" for cell in row))
    return "\n".join(lines)
