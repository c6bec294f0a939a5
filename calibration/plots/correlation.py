"""Correlations of the fitted parameters."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from calibration.plots import style
from calibration.report import symbols

MOST_NUMBERS = 12  # with more parameters the numbers in the cells would overlap


def plot_correlations(correlations, names, ax: Axes | None = None, model: Any = None) -> Axes:
    """The matrix of correlations as colours, and as numbers while there is room.

    Args:
        correlations: (p, p), from -1 to 1; NaN where undefined.
        names: the p parameters.
        ax: where to draw; a new figure's where None.
        model: of the law that they are parameters of, which knows their symbols.
    """
    matrix = np.asarray(correlations, float)
    ax = style.axes_or_new(ax)
    # red–blue stays readable with every common colour blindness
    image = ax.imshow(matrix, cmap="RdBu", vmin=-1, vmax=1)
    labels = [symbols.math(name, model, unit=False) for name in names]
    turned: dict[str, Any] = {"rotation": 90} if max(map(len, names)) > 12 else {}
    ax.set_xticks(range(len(names)), labels, **turned)
    ax.set_yticks(range(len(names)), labels)
    if len(names) <= MOST_NUMBERS:
        _write_numbers(ax, matrix)
    ax.figure.colorbar(image, ax=ax, label="correlation", shrink=0.8)
    return ax


def _write_numbers(ax: Axes, matrix: np.ndarray) -> None:
    for (row, column), value in np.ndenumerate(matrix):
        rounded = np.round(value, 2) + 0.0  # -0.00 would be a sign without a number
        text = f"{rounded:.2f}".replace("-", "−") if np.isfinite(value) else "–"
        color = "white" if abs(value) > 0.6 else "black"
        ax.text(column, row, text, ha="center", va="center", color=color, fontsize=8)
