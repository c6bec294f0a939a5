"""How estimates depend on each other: ellipses of equal probability, with their correlations.

A cell's ellipse is where two estimates lie together, in their standard errors: a circle for none,
a line leaning right (left) for a correlation of 1 (-1).
"""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Ellipse

from calibration.plots import style

MOST_NUMBERS = 12  # with more parameters the numbers in the cells would overlap
SIZE = 0.3  # of a cell: the radius of uncorrelated estimates
THIN = 0.02  # of a cell: the least half width of an ellipse


def plot_correlations(
    correlations, labels: Sequence[str], ax: Axes | None = None, texts: Sequence[str] = ()
) -> Axes:
    """Ellipses below the diagonal, correlations above it.

    Args:
        correlations: (p, p), from -1 to 1; NaN where undefined.
        labels: of the p parameters.
        ax: where to draw; a new figure's where None.
        texts: what stands on the diagonal, such as "1.79 ± 0.05".
    """
    matrix, count = np.asarray(correlations, float), len(labels)
    ax = style.axes_or_new(ax)
    for (row, column), value in np.ndenumerate(matrix):
        place = column, count - 1 - row
        text = f"{np.round(value, 2) + 0.0:.2f}".replace("-", "−") if np.isfinite(value) else "–"
        if row == column:
            text = texts[row].replace(" ± ", "\n± ") if texts else ""
        elif (row > column or count > MOST_NUMBERS) and np.isfinite(value):
            long, short = (2 * max(SIZE * np.sqrt(1 + s * abs(value)), THIN) for s in (1, -1))
            color, angle = (style.BLUE, 45) if value >= 0 else (style.VERMILION, -45)
            ax.add_patch(Ellipse(place, long, short, angle=angle, color=color, alpha=0.6))
            continue
        if text:
            ax.text(*place, text, ha="center", va="center", fontsize=7.5)
    turned = 90 if any(", " in label for label in labels) else 0  # data sets are named
    ax.set_xticks(range(count), labels, rotation=turned)
    ax.set_yticks(range(count), labels[::-1])
    ax.set(xlim=(-0.5, count - 0.5), ylim=(-0.5, count - 0.5), aspect="equal")
    ax.tick_params(length=0)
    for edge in np.arange(count - 1) + 0.5:
        ax.axhline(edge, color=style.GREY, linewidth=0.3)
        ax.axvline(edge, color=style.GREY, linewidth=0.3)
    return ax
