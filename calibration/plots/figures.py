"""Whole figures: one panel a material, residuals below it, one legend for all."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from calibration.plots import style
from calibration.plots.correlation import plot_correlations
from calibration.plots.curves import ORDER, plot_curve, plot_residuals
from calibration.plots.lines import Line
from calibration.plots.profiles import plot_profile

PANEL = (4.2, 4.4)  # inches, residuals included
LEGEND_ROW = 0.25  # inches


def curves_figure(
    result: Any,
    lines: Mapping[str, Sequence[Line]] | None = None,
    ratio: bool = False,
    from_rest: bool = False,
    title: str | None = None,
) -> Figure:
    """Every data set with its fit, and the residuals below each.

    Args:
        result: a `FitResult`.
        lines: further curves for data sets, by name.
        ratio, from_rest: as `plot_curve` takes them.
        title: above all panels.
    """
    lines = lines or {}
    rows, columns = style.grid_shape(len(result.materials))
    figure = style.new_figure(max(PANEL[0] * columns, 5.5), PANEL[1] * rows + 3 * LEGEND_ROW)
    grid = figure.subplots(2 * rows, columns, squeeze=False, height_ratios=[2.6, 1] * rows)
    drawn = []
    for i, fit in enumerate(result.materials):
        row, column = divmod(i, columns)
        upper, lower = grid[2 * row, column], grid[2 * row + 1, column]
        more = lines.get(fit.name, ())
        plot_curve(result, fit.name, upper, more, ratio, from_rest)
        plot_residuals(result, fit.name, lower, more, ratio)
        _join(upper, lower, fit, column)
        drawn.append(upper)
    _remove_empty(grid)
    style.legend_below(figure, drawn, columns=4 if columns > 2 else 2, first=ORDER)
    if title:
        figure.suptitle(title, fontsize="medium")
    return figure


def profiles_figure(result: Any) -> Figure | None:
    """A panel a profile; None where the fit has none."""
    if not result.profiles:
        return None
    rows, columns = style.grid_shape(len(result.profiles))
    figure = style.new_figure(max(3.4 * columns, 5.5), 2.8 * rows + 2 * LEGEND_ROW)
    grid = figure.subplots(rows, columns, squeeze=False)
    for ax, (label, profile) in zip(grid.flat, result.profiles.items(), strict=False):
        plot_profile(profile, _estimate(result, label), ax, _model(result, label))
    _remove_empty(grid)
    style.legend_below(figure, list(figure.axes), columns=4 if columns > 2 else 2)
    return figure


def correlation_figure(result: Any) -> Figure | None:
    """The correlations of the fitted parameters; None where fewer than two are fitted."""
    whole = {tree.name for fit in result.materials for tree in fit.trees}
    names = result.covariance_names
    order = [i for i in _by_material(result, names) if names[i].partition("[")[0] not in whole]
    if len(order) < 2:
        return None
    matrix = result.correlations[np.ix_(order, order)]
    size = 3.0 + 0.45 * len(order)
    figure = style.new_figure(size + 0.8, size)
    names = tuple(names[i] for i in order)
    plot_correlations(matrix, names, figure.add_subplot(), _model(result, names[0]))
    return figure


def _by_material(result: Any, names: Sequence[str]) -> list[int]:
    """Positions of the parameters, those of each material together."""
    place = {fit.name: i for i, fit in enumerate(result.materials)}
    owners = [name.partition("[")[2].rstrip("]") for name in names]
    return sorted(range(len(names)), key=lambda i: place.get(owners[i], len(place)))


def _join(upper: Axes, lower: Axes, fit: Any, column: int) -> None:
    """One x axis for a curve and its residuals, and the panel's title."""
    if upper.get_xscale() == "log":
        style.logarithmic_x(lower)
    lower.set_xlim(upper.get_xlim())
    upper.tick_params(labelbottom=False)
    upper.set_xlabel("")
    mark = "" if fit.converged else " (NOT CONVERGED)"
    upper.set_title(f"{fit.name}{mark}")
    if column:
        upper.set_ylabel("")
        lower.set_ylabel("")


def _remove_empty(grid: Any) -> None:
    for ax in grid.flat:
        if not ax.has_data():
            ax.remove()


def _estimate(result: Any, label: str) -> Any:
    """The `Estimate` of a label such as "sigma[nylon]"."""
    return result.estimates.get(label)


def _model(result: Any, label: str) -> Any:
    """What is known of the law that a label belongs to."""
    owners = [fit for fit in result.materials if label in fit.labels.values()]
    return (owners or result.materials)[0].model
