"""Picture of an uncertainty budget: what each input, and the scatter of the points, contributes."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from calibration.fitting.elements import DRAG
from calibration.plots import style
from calibration.symbols import in_math, input_words, of_label

SMALL = 1e-3  # of the combined uncertainty: a contribution below is left out
MOST_BARS = 8  # inputs in a panel, the largest
STATISTICAL = "scatter of the points"


def plot_budget(result: Any, label: str, ax: Axes | None = None) -> Axes:
    """Draw |contributions| to one result in per cent of it, the largest on top, and the combined one as a line.

    Args:
        label: of the result, a free parameter.
    """
    ax = style.axes_or_new(ax, 3.2)
    budget = result.budget
    size = 100 / abs(budget.values[label])
    parts = [
        (input_words(part.name).removeprefix("the "), abs(part.of(label))) for part in budget.inputs
    ]
    scatter = budget.statistical[label]
    combined = np.sqrt(sum(c**2 for _, c in parts) + (scatter or 0.0) ** 2)
    shown = sorted((p for p in parts if p[1] > SMALL * combined), key=lambda p: -p[1])[:MOST_BARS]
    if scatter is not None:
        shown = sorted([*shown, (STATISTICAL, scatter)], key=lambda p: -p[1])
    names, sizes = zip(*shown[::-1], strict=True)
    colors = [style.GREY if name == STATISTICAL else style.BLUE for name in names]
    ax.barh(range(len(names)), np.array(sizes) * size, color=colors, height=0.7, tick_label=names)
    ax.axvline(combined * size, color=style.VERMILION, linestyle="--", label="combined")
    ax.set_xlim(0, 1.1 * combined * size)
    letter = in_math(of_label(label, result))
    ax.set_xlabel(f"standard uncertainty of {letter} [%]")
    return ax


def budget_figure(result: Any) -> Figure | None:
    """`plot_budget` of each free parameter that inputs move; None without a budget."""
    budget = result.budget
    labels = [] if budget is None else [n for n in result.covariance_names if budget.values.get(n)]
    labels = [n for n in labels if budget.input_error(n) > 0 and not n.startswith(DRAG)]
    if not labels:
        return None
    shown = labels[: style.MOST]
    figure = style.new_figure(0.6 + 2.6 * len(shown))
    axes = list(figure.subplots(len(shown), squeeze=False)[:, 0])
    for label, ax in zip(shown, axes, strict=True):
        plot_budget(result, label, ax)
    style.legend_below(figure, axes)
    return figure
