"""Studies in words: tables for the terminal, and columns of CSV."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from calibration import console
from calibration.curves import status_names
from calibration.data.air import Fall
from calibration.fitting.warnings import FitWarning
from calibration.report.layout import table_text
from calibration.studies.designs import Design
from calibration.studies.sensitivities import Sensitivities


def local_table(sensitivities: Sensitivities) -> str:
    """θ ∂ε/∂θ, an input a line, a velocity a column."""
    symbols = [declared.symbol for declared in sensitivities.declared.values()]
    cells = np.vectorize(lambda x: f"{x:z.5f}")(sensitivities.absolute)
    return _table("θ ∂ε/∂θ at v [m/s]", sensitivities.velocity, symbols, cells)


def _table(head: str, velocity: np.ndarray, names: Sequence[str], cells: np.ndarray) -> str:
    columns = [head, *(f"{v:.4g}" for v in velocity)]
    return table_text(pd.DataFrame(np.vstack([names, cells]).T, columns=columns))


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
