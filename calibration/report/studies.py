"""Studies in words: tables for the terminal, and columns of CSV."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from calibration import console
from calibration.curves import status_names
from calibration.data.air import Fall
from calibration.errors import listed
from calibration.fitting.warnings import FitWarning
from calibration.report.layout import table_text
from calibration.studies.designs import Design
from calibration.studies.plans import Information
from calibration.studies.sensitivities import Sensitivities, SobolIndices


def local_table(sensitivities: Sensitivities) -> str:
    """θ ∂ε/∂θ, an input a line, a velocity a column."""
    symbols = [declared.symbol for declared in sensitivities.declared.values()]
    cells = np.vectorize(lambda x: f"{x:z.5f}")(sensitivities.absolute)
    return _table("θ ∂ε/∂θ at v [m/s]", sensitivities.velocity, symbols, cells)


def sobol_table(indices: SobolIndices) -> str:
    """First-order and total indices, an input a line, a velocity a column; what does not rebound."""
    cells = np.vectorize(lambda a, b: f"{a:z.3f} ({b:z.3f})")(indices.first, indices.total)
    head = "Sobol indices, first (total) at v [m/s]"
    table = _table(head, indices.velocity, indices.symbols, cells)
    still = zip(indices.zeros, indices.velocity, strict=True)
    shares = listed(f"{100 * share:.3g} % at {v:.4g} m/s" for share, v in still if share)
    return table + (f"\nSamples that do not rebound, ε = 0: {shares}." if shares else "")


def _table(head: str, velocity: np.ndarray, names: Sequence[str], cells: np.ndarray) -> str:
    columns = [head, *(f"{v:.4g}" for v in velocity)]
    return table_text(pd.DataFrame(np.vstack([names, cells]).T, columns=columns))


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
    of = sensitivities
    table = pd.DataFrame({"velocity [m/s]": of.velocity, "restitution": of.coefficient})
    table[[f"{n} d(eps)/d({n})" for n in of.names]] = of.absolute
    table[[f"dln(eps)/dln({n})" for n in of.names]] = of.logarithmic
    table["status"] = [status_names(int(status)) for status in of.status]
    return table.to_csv(index=False, lineterminator="\n")


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
