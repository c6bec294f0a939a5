"""Pairs of parameters as draws show them, with the fit and its intervals drawn in."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from calibration import symbols
from calibration.fitting.posterior.draws import dataset_of
from calibration.plots import style

NOISES = {"noise": "scatter", "group": "between groups", "timing": "of times [s]"}  # as tables say
MOST = 8  # parameters: with more nothing can be read
SHOWN = 2000  # draws of a panel
CELL = 1.9  # inches
BINS = 40
TAIL = 0.002  # of the draws, on either side, beyond the axis


def posterior_figure(
    posterior: Any, result: Any = None, names: Sequence[str] | None = None
) -> Figure:
    """Histograms on the diagonal, draws of each pair below it.

    Args:
        posterior: draws as ArviZ data; those that diverged are marked.
        result: the `FitResult` whose values and intervals are drawn in.
        names: which parameters; the first eight where None.
    """
    draws = {str(k): np.ravel(v) for k, v in dataset_of(posterior, "posterior").data_vars.items()}
    diverging = np.ravel(dataset_of(posterior, "sample_stats")["diverging"])
    names = list(draws)[:MOST] if names is None else list(names)
    count = len(names)
    figure = style.new_figure(max(CELL * count, 5.0), max(CELL * count, 4.0) + 0.4)
    grid = figure.subplots(count, count, squeeze=False)
    ends = {name: _ends(draws[name]) for name in names}
    scales = {name: style.spans_decades(np.array(ends[name])) for name in names}
    for row, column in np.ndindex(count, count):
        ax, x, y = grid[row, column], names[column], names[row]
        if row < column:
            ax.remove()
            continue
        if row == column:
            space = np.geomspace if scales[x] else np.linspace
            ax.hist(draws[x], space(*ends[x], BINS), color=style.SKY, label="draws")
            ax.set_yticks([])
        else:
            _plot_pair(ax, draws[x], draws[y], diverging)
            _limit(ax, "y", ends[y], scales[y])
        _limit(ax, "x", ends[x], scales[x])
        if result is not None:
            _plot_fit(ax, result.estimates.get(x), result.estimates.get(y), x != y)
        ax.tick_params(labelbottom=row == count - 1, labelleft=column == 0 < row)
        ax.set_xlabel(_label(x, result) if row == count - 1 else "")
        ax.set_ylabel(_label(y, result) if column == 0 < row else "")
    style.legend_below(figure, list(figure.axes), columns=4)
    return figure


def _plot_pair(ax: Axes, x: np.ndarray, y: np.ndarray, diverging: np.ndarray) -> None:
    step = max(1, len(x) // SHOWN)
    look: dict[str, Any] = {"linestyle": "none", "marker": "."}
    ax.plot(x[::step], y[::step], color=style.SKY, markersize=2, alpha=0.5, **look)
    if np.any(diverging):
        ax.plot(x[diverging], y[diverging], color=style.VERMILION, label="diverged", **look)


def _limit(ax: Axes, which: str, ends: tuple[float, float], logarithmic: bool) -> None:
    if logarithmic:
        getattr(ax, f"set_{which}scale")("log")
    else:
        getattr(ax, f"{which}axis").set_major_locator(MaxNLocator(3 if which == "y" else 2))
    getattr(ax, f"set_{which}lim")(*ends)


def _plot_fit(ax: Axes, one: Any, other: Any, in_pair: bool) -> None:
    """The fit's value, a cross in a pair's panel, else a line with its interval's ends."""
    if one is None or one.value is None:
        return
    if in_pair:
        if other is not None and other.value is not None:
            ax.plot(one.value, other.value, "+", color=style.BLACK, markersize=9, label="fit")
        return
    ax.axvline(one.value, color=style.BLACK, linewidth=1, label="fit")
    for end in (one.low, one.high):
        if end is not None and np.isfinite(end):
            look: dict[str, Any] = {"linestyle": "-.", "linewidth": 1}
            ax.axvline(end, color=style.GREY, label="the fit's interval", **look)


def _label(name: str, result: Any) -> str:
    """The symbol with its unit, the data set below it."""
    base, _, owner = name.removesuffix("]").partition("[")
    symbol = NOISES.get(base) or symbols.math(base, symbols.model_of(name, result))
    return f"{symbol}\n{style.plain(style.shortened(owner))}" if owner else symbol


def _ends(values: np.ndarray) -> tuple[float, float]:
    low, high = (float(end) for end in np.quantile(values, [TAIL, 1 - TAIL]))
    return (low, high) if high > low else (low - 0.5, high + 0.5)
