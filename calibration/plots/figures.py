"""Whole figures of a fit: one panel a data set or parameter, and one legend for all."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from calibration import symbols
from calibration.plots import style
from calibration.plots.correlation import plot_correlations
from calibration.plots.curves import ORDER, plot_curve, plot_residuals
from calibration.plots.lines import Line
from calibration.plots.profiles import plot_profile

CELL = 0.95  # inches, of two parameters' ellipse
LETTER = 0.09  # inches, of a name beside it


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
    count = len(result.materials)
    figure, grid = style.panels(count, (4.2, 4.4), "data sets", (2.6, 1), 0.75)
    for fit, (upper, lower) in zip(result.materials, grid, strict=False):
        more = (lines or {}).get(fit.name, ())
        plot_curve(result, fit.name, upper, more, ratio, from_rest)
        plot_residuals(result, fit.name, lower, more, ratio)
        if upper.get_xscale() == "log":
            style.logarithmic_x(lower)
        lower.set_xlim(upper.get_xlim())
        upper.tick_params(labelbottom=False)
        mark = "" if fit.converged else " (NOT CONVERGED)"
        upper.set(xlabel="", title=f"{style.plain(fit.name)}{mark}")
        if not upper.get_subplotspec().is_first_col():
            upper.set_ylabel("")
            lower.set_ylabel("")
    columns = upper.get_subplotspec().get_gridspec().ncols
    style.legend_below(figure, list(grid[:, 0]), 4 if columns > 2 else 2, ORDER)
    if title:
        figure.suptitle(". ".join(filter(None, (title, figure.get_suptitle()))), fontsize="medium")
    return figure


def profiles_figure(result: Any) -> Figure | None:
    """A panel a profile; None where the fit has none that leaves its parameter's bound."""
    profiles = {label: one for label, one in result.profiles.items() if len(set(one.values)) > 1}
    if not profiles:
        return None
    figure, grid = style.panels(len(profiles), (3.4, 2.8), "profiles")
    for (label, profile), (ax,) in zip(profiles.items(), grid, strict=False):
        plot_profile(profile, result.estimates.get(label), ax, symbols.model_of(label, result))
    columns = ax.get_subplotspec().get_gridspec().ncols
    style.legend_below(figure, list(grid.flat), 4 if columns > 2 else 2)
    return figure


def correlation_figure(result: Any) -> Figure | None:
    """How the fitted parameters depend on each other; None where no two have a correlation.

    A panel a data set; data sets that share parameters have one together. A parameter at its bound
    has no correlations.
    """
    place = {label: k for k, label in enumerate(result.covariance_names)}
    blocks = []
    for owner, labels in _blocks(result):
        order = [place[label] for label in labels]
        matrix = result.correlations[np.ix_(order, order)]
        if np.any(np.isfinite(np.triu(matrix, 1)) & np.triu(np.ones_like(matrix, bool), 1)):
            blocks.append((owner, labels, matrix))
    if not blocks:
        return None
    names = [[_symbol(result, label, not owner) for label in own] for owner, own, _ in blocks]
    room = max(len(name) for own in names for name in own)
    size = max(0.8, LETTER * room) + CELL * max(map(len, names))
    figure, grid = style.panels(len(blocks), (size, size + 0.25), "data sets", legend=0.0)
    if len(blocks) == 1:
        figure.set_figwidth(size)
    for (owner, labels, matrix), own, (ax,) in zip(blocks, names, grid, strict=False):
        texts = [str(result.estimates.get(label)) for label in labels]
        plot_correlations(matrix, own, ax, texts)
        ax.set_title(style.plain(owner))
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
    return [(names[0] if len(names) == 1 and not alone else "", own) for names, own in blocks]


def _symbol(result: Any, label: str, with_owner: bool) -> str:
    name, _, owner = label.partition("[")
    symbol = symbols.math(name, symbols.model_of(label, result), unit=False)
    own = style.shortened(owner.removesuffix("]"))
    return f"{symbol}, {style.plain(own)}" if with_owner and owner else symbol
