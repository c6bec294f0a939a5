"""Whole figures: one panel a material, residuals below it, one legend for all."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from calibration import symbols
from calibration.plots import style
from calibration.plots.correlation import plot_correlations
from calibration.plots.curves import ORDER, plot_curve, plot_residuals
from calibration.plots.lines import Line
from calibration.plots.profiles import plot_profile

PANEL = (4.2, 4.4)  # inches, residuals included
LEGEND_ROW = 0.25  # inches
CELL = 0.95  # inches, of two parameters' ellipse
LETTER = 0.09  # inches, of a name beside it
MOST = 24  # panels of one picture: nobody reads more, and a hundred take a minute to draw


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
    shown = result.materials[:MOST]
    rows, columns = style.grid_shape(len(shown))
    figure = style.new_figure(max(PANEL[0] * columns, 5.5), PANEL[1] * rows + 3 * LEGEND_ROW)
    grid: Any = figure.subplots(2 * rows, columns, squeeze=False, height_ratios=[2.6, 1] * rows)
    drawn = []
    for i, fit in enumerate(shown):
        row, column = divmod(i, columns)
        upper, lower = grid[2 * row, column], grid[2 * row + 1, column]
        more = lines.get(fit.name, ())
        plot_curve(result, fit.name, upper, more, ratio, from_rest)
        plot_residuals(result, fit.name, lower, more, ratio)
        _join(upper, lower, fit, column)
        drawn.append(upper)
    _remove_empty(grid)
    style.legend_below(figure, drawn, columns=4 if columns > 2 else 2, first=ORDER)
    cut = _cut(len(shown), len(result.materials), "data sets")
    if title or cut:
        figure.suptitle(". ".join(filter(None, (title, cut))), fontsize="medium")
    return figure


def _cut(shown: int, count: int, what: str) -> str | None:
    """What is said above a picture that does not show all."""
    return f"the first {shown} of {count} {what}: all are in fit.json" if shown < count else None


def profiles_figure(result: Any) -> Figure | None:
    """A panel a profile; None where the fit has none that leaves its parameter's bound."""
    profiles = {label: one for label, one in result.profiles.items() if len(set(one.values)) > 1}
    if not profiles:
        return None
    cut = _cut(min(len(profiles), MOST), len(profiles), "profiles")
    profiles = dict(list(profiles.items())[:MOST])
    rows, columns = style.grid_shape(len(profiles))
    figure = style.new_figure(max(3.4 * columns, 5.5), 2.8 * rows + 2 * LEGEND_ROW)
    grid = figure.subplots(rows, columns, squeeze=False)
    for ax, (label, profile) in zip(grid.flat, profiles.items(), strict=False):
        plot_profile(profile, result.estimates.get(label), ax, _model(result, label))
    _remove_empty(grid)
    style.legend_below(figure, list(figure.axes), columns=4 if columns > 2 else 2)
    if cut:
        figure.suptitle(cut, fontsize="medium")
    return figure


def correlation_figure(result: Any) -> Figure | None:
    """How the fitted parameters depend on each other; None where no two have a correlation.

    A panel a data set; data sets that share parameters have one together. A parameter at its bound
    has no correlations.
    """
    blocks = [block for block in _blocks(result) if _has_correlations(result, block[1])]
    if not blocks:
        return None
    cut = _cut(min(len(blocks), MOST), len(blocks), "data sets")
    blocks = blocks[:MOST]
    rows, columns = style.grid_shape(len(blocks))
    room = max(len(_symbol(result, label, not owner)) for owner, own in blocks for label in own)
    size = max(0.8, LETTER * room) + CELL * max(len(labels) for _, labels in blocks)
    figure = style.new_figure(size * columns, (size + LEGEND_ROW) * rows)
    grid = figure.subplots(rows, columns, squeeze=False)
    place = {label: k for k, label in enumerate(result.covariance_names)}
    for ax, (owner, labels) in zip(grid.flat, blocks, strict=False):
        order = [place[label] for label in labels]
        names = [_symbol(result, label, not owner) for label in labels]
        told = [str(result.estimates.get(label)) for label in labels]
        plot_correlations(result.correlations[np.ix_(order, order)], names, ax, told)
        ax.set_title(style.plain(owner))
    _remove_empty(grid)
    if cut:
        figure.suptitle(cut, fontsize="medium")
    return figure


def _blocks(result: Any) -> list[tuple[str, list[str]]]:
    """(data set, labels) of parameters that belong together; "" for several data sets, or the only one.

    The numbers of a network are no parameters that anybody reads.
    """
    blocks: list[tuple[list[str], list[str]]] = []
    for fit in result.materials:
        owners = [fit.name]
        labels = [label for name, label in fit.labels.items() if "[" not in name]
        for block in [block for block in blocks if set(block[1]) & set(labels)]:
            blocks.remove(block)
            owners, labels = block[0] + owners, list(dict.fromkeys(block[1] + labels))
        blocks.append((owners, labels))
    alone = len(result.materials) == 1
    return [(names[0] if len(names) == 1 and not alone else "", of) for names, of in blocks]


def _has_correlations(result: Any, labels: list[str]) -> bool:
    """Whether two of them have one."""
    place = [result.covariance_names.index(label) for label in labels]
    known = np.isfinite(result.correlations[np.ix_(place, place)])
    return bool(np.any(np.triu(known, 1)))


def _symbol(result: Any, label: str, with_owner: bool) -> str:
    name, _, owner = label.partition("[")
    symbol = symbols.math(name, _model(result, label), unit=False)
    own = style.shortened(owner.removesuffix("]"))
    return f"{symbol}, {style.plain(own)}" if with_owner and owner else symbol


def _join(upper: Axes, lower: Axes, fit: Any, column: int) -> None:
    """One x axis for a curve and its residuals, and the panel's title."""
    if upper.get_xscale() == "log":
        style.logarithmic_x(lower)
    lower.set_xlim(upper.get_xlim())
    upper.tick_params(labelbottom=False)
    upper.set_xlabel("")
    mark = "" if fit.converged else " (NOT CONVERGED)"
    upper.set_title(f"{style.plain(fit.name)}{mark}")
    if column:
        upper.set_ylabel("")
        lower.set_ylabel("")


def _remove_empty(grid: Any) -> None:
    for ax in grid.flat:
        if not ax.has_data():
            ax.remove()


def _model(result: Any, label: str) -> Any:
    """What is known of the law that a label belongs to."""
    owners = [fit for fit in result.materials if label in fit.labels.values()]
    return (owners or result.materials)[0].model
