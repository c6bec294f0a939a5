"""All curves of a comparison over the data, one column a data set."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from calibration.compare.entries import Entry
from calibration.compare.ranking import Ranking
from calibration.data.measurements import RestitutionData
from calibration.plots import style

FINE = 256
PANEL = (4.4, 3.0)  # inches
LEGEND = 1.1
LINES = {
    "zhou": (style.BLUE, "-"),
    "eq-17": (style.ORANGE, "--"),
    "walton-braun-growing": (style.GREEN, (0, (6, 2))),
    "viscoelastic": (style.PURPLE, (0, (3, 1, 1, 1))),
    "thornton-yield-factor": (style.SKY, "-."),
    "thornton": (style.VERMILION, (0, (1, 1))),
    "constant": (style.GREY, (0, (8, 3))),
    "hertz": (style.BLACK, ":"),
}
LABELS = {"constant": "constant ε: hard spheres, both\ndashpots, Walton–Braun with constant k2"}


def comparison_figure(rankings: Sequence[Ranking]) -> Figure:
    """Every ranking in a column of its own: all curves, and below a close-up of the data."""
    columns = len(rankings)
    figure = style.new_figure(max(PANEL[0] * columns, 6.5), 2 * PANEL[1] + LEGEND)
    grid = figure.subplots(2, columns, squeeze=False)
    for (upper, lower), ranking in zip(grid.T, rankings, strict=True):
        plot_ranking(ranking, upper)
        close_up(ranking, plot_ranking(ranking, lower))
        upper.set_xlabel("")
        lower.set_title("")
    for ax in grid[:, 1:].flat:
        ax.set_ylabel("")
    order = [LABELS.get(e.candidate.key, e.candidate.label) for e in rankings[0].entries]
    style.legend_below(figure, list(figure.axes), 3 if columns > 2 else 2, first=["data", *order])
    return figure


def close_up(ranking: Ranking, ax: Axes) -> Axes:
    """The same axes, with the data filling half of their height."""
    low, high = np.min(ranking.data.restitution), np.max(ranking.data.restitution)
    room = 0.5 * max(high - low, 0.02)
    ax.set_ylim(low - room, high + room)
    return ax


def plot_ranking(ranking: Ranking, ax: Axes | None = None) -> Axes:
    """One data set with every curve that is drawn once: laws with the same curve share a line."""
    ax = style.axes_or_new(ax)
    data = ranking.data
    for entry in ranking.entries:
        if not entry.candidate.same_as:
            _plot_entry(ax, entry, data)
    _plot_data(ax, data)
    if style.spans_decades(data.velocity):
        style.logarithmic_x(ax)
    ax.set(xlabel="impact velocity $v$ [m/s]", ylabel=r"restitution $\varepsilon$", title=data.name)
    ax.set_ylim(min(0.0, ax.get_ylim()[0]), None)
    return ax


def _plot_data(ax: Axes, data: RestitutionData) -> None:
    ax.errorbar(
        data.velocity,
        data.restitution,
        yerr=data.uncertainty,
        xerr=data.velocity_uncertainty,
        fmt="o",
        color=style.BLACK,
        markerfacecolor="white",
        markersize=3.5,
        markeredgewidth=0.8,
        elinewidth=0.8,
        zorder=1.8,
        label="data",
    )


def _plot_entry(ax: Axes, entry: Entry, data: RestitutionData) -> None:
    key = entry.candidate.key
    color, linestyle = LINES[key]
    label = LABELS.get(key, entry.candidate.label)
    ax.plot(*_curve(entry, data), color=color, linestyle=linestyle, label=label, lw=1.6)


def _curve(entry: Entry, data: RestitutionData):
    """Velocities and ε; where each impact has bodies of its own, at those impacts alone."""
    if data.contact is not None and any(map(np.ndim, data.contact.leaves().values())):
        order = np.argsort(data.velocity)
        return data.velocity[order], (entry.residual + data.restitution)[order]
    ends = float(np.min(data.velocity)), float(np.max(data.velocity))
    spaced = np.geomspace if style.spans_decades(data.velocity) else np.linspace
    velocity = spaced(*ends, FINE)
    return velocity, entry.curve(data, velocity)
