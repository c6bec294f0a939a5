"""Pairs of parameters as draws show them, with the fit and its intervals drawn in."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from calibration import symbols
from calibration.fitting.posterior.inference_data import dataset_of
from calibration.plots import style

MOST = 8  # parameters: with more nothing can be read
SHOWN = 2000  # draws of a panel
CELL = 1.9  # inches
BINS = 40
TAIL = 0.002  # of the draws, on either side, beyond the axis


def posterior_figure(
    posterior: Any,
    result: Any = None,
    names: Sequence[str] | None = None,
) -> Figure:
    """Histograms on the diagonal, draws of each pair below it.

    Args:
        posterior: draws as ArviZ data; those that diverged are marked.
        result: the `FitResult` whose values and intervals are drawn in.
        names: which; the first eight where None.
    """
    draws = {str(k): v.values for k, v in dataset_of(posterior, "posterior").data_vars.items()}
    diverging = np.asarray(dataset_of(posterior, "sample_stats")["diverging"])
    names = list(draws)[:MOST] if names is None else list(names)
    count = len(names)
    figure = style.new_figure(max(CELL * count, 5.0), max(CELL * count, 4.0) + 0.4)
    grid = figure.subplots(count, count, squeeze=False)
    values = {name: np.ravel(draws[name]) for name in names}
    scales = {name: style.spans_decades(_middle(v)) for name, v in values.items()}
    for row, column in np.ndindex(count, count):
        ax, x, y = grid[row, column], names[column], names[row]
        if row < column:
            ax.remove()
            continue
        if row == column:
            _histogram(ax, values[x], scales[x])
        else:
            _pair(ax, values[x], values[y], np.ravel(diverging))
            _limits(ax, values[y], scales[y], "y")
        _limits(ax, values[x], scales[x], "x")
        _of_fit(ax, result, x, None if row == column else y)
        _labelled(ax, x, y, row, column, count)
    style.legend_below(figure, list(figure.axes), columns=4)
    return figure


def _histogram(ax: Axes, values: np.ndarray, logarithmic: bool) -> None:
    low, high = _ends(values)
    space = np.geomspace if logarithmic else np.linspace
    ax.hist(values, space(low, high, BINS), color=style.SKY, label="draws")
    ax.set_yticks([])


def _pair(ax: Axes, x: np.ndarray, y: np.ndarray, diverging: np.ndarray) -> None:
    step = max(1, len(x) // SHOWN)
    look: dict[str, Any] = {"linestyle": "none", "marker": "."}
    ax.plot(x[::step], y[::step], color=style.SKY, markersize=2, alpha=0.5, **look)
    if np.any(diverging):
        ax.plot(x[diverging], y[diverging], color=style.VERMILION, label="diverged", **look)


def _limits(ax: Axes, values: np.ndarray, logarithmic: bool, which: str) -> None:
    if logarithmic:
        getattr(ax, f"set_{which}scale")("log")
    else:
        getattr(ax, f"{which}axis").set_major_locator(MaxNLocator(3))
    getattr(ax, f"set_{which}lim")(*_ends(values))


def _of_fit(ax: Axes, result: Any, x: str, y: str | None) -> None:
    """The fit's value, a cross in a pair's panel, and its interval."""
    if result is None or x not in result.estimates:
        return
    one = result.estimates[x]
    if y is not None:
        other = result.estimates.get(y)
        if other is not None and None not in (one.value, other.value):
            ax.plot(one.value, other.value, "+", color=style.BLACK, markersize=9, label="fit")
        return
    if one.value is not None:
        ax.axvline(one.value, color=style.BLACK, linewidth=1, label="fit")
    for end in (one.low, one.high):
        if end is not None and np.isfinite(end):
            look: dict[str, Any] = {"linestyle": "-.", "linewidth": 1}
            ax.axvline(end, color=style.GREY, label="the fit's interval", **look)


def _labelled(ax: Axes, x: str, y: str, row: int, column: int, count: int) -> None:
    if row == count - 1:
        ax.set_xlabel(symbols.math(x))
    else:
        ax.tick_params(labelbottom=False)
    if column == 0 and row:
        ax.set_ylabel(symbols.math(y))
    else:
        ax.tick_params(labelleft=False)


def _middle(values: np.ndarray) -> np.ndarray:
    low, high = np.quantile(values, [TAIL, 1 - TAIL])
    return values[(values >= low) & (values <= high)]


def _ends(values: np.ndarray) -> tuple[float, float]:
    low, high = (float(end) for end in np.quantile(values, [TAIL, 1 - TAIL]))
    return (low, high) if high > low else (low - 0.5, high + 0.5)
