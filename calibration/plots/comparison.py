"""All laws of a comparison over the data, one column a data set."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import cycle
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from calibration.fitting.curves import of_each_impact
from calibration.plots import style
from calibration.plots.curves import plot_data, velocity_label

FINE = 256  # points of a curve
PANEL = (4.4, 3.0)  # inches
LEGEND = 1.1
ROOM = 0.5  # of the data's height, above and below them in the close-up
LOOKS: dict[str, tuple[str, Any]] = {
    "zhou": (style.BLUE, "-"),
    "eq-17": (style.ORANGE, "--"),
    "walton-braun": (style.GREEN, (0, (6, 2))),
    "viscoelastic": (style.PURPLE, (0, (3, 1, 1, 1))),
    "thornton": (style.SKY, "-."),
    "thornton-fixed": (style.VERMILION, (0, (1, 1))),
    "constant": (style.GREY, (0, (8, 3))),
    "hertz": (style.BLACK, ":"),
}
# of laws of one's own, and of dashpot laws whose end of contact sets them apart from a constant ε
OTHERS: tuple[tuple[str, Any], ...] = (
    (style.BLACK, (0, (5, 1))),
    (style.VERMILION, "-"),
    (style.GREEN, (0, (2, 2))),
    (style.PURPLE, (0, (9, 2, 2, 2))),
    (style.ORANGE, (0, (1, 2))),
    (style.SKY, (0, (6, 1, 1, 1, 1, 1))),
)


def comparison_figure(comparisons: Sequence[Any]) -> Figure:
    """Every `Comparison` in a column of its own: all curves, and below a close-up of the data."""
    columns = len(comparisons)
    alike = _alike(comparisons)
    figure = style.new_figure(max(PANEL[0] * columns, 6.5), 2 * PANEL[1] + LEGEND)
    grid = figure.subplots(2, columns, squeeze=False)
    for (upper, lower), comparison in zip(grid.T, comparisons, strict=True):
        plot_comparison(comparison, upper, alike)
        close_up(comparison, plot_comparison(comparison, lower, alike))
        upper.set_xlabel("")
        lower.set_title("")
    for ax in grid[:, 1:].flat:
        ax.set_ylabel("")
    order = [_label(label, alike) for label in comparisons[0].ranking]
    style.legend_below(figure, list(figure.axes), 3 if columns > 2 else 2, first=["data", *order])
    return figure


def plot_comparison(
    comparison: Any, ax: Axes | None = None, alike: Mapping[str, str] | None = None
) -> Axes:
    """One data set with its curves.

    Args:
        comparison: a `Comparison`.
        ax: where to draw; a new figure's where None.
        alike: labels of laws that are not drawn, as their curve is that of another, which each is
            mapped to; those of the comparison itself where None.
    """
    ax = style.axes_or_new(ax)
    alike = _alike([comparison]) if alike is None else alike
    data = comparison.data
    looks = _looks([entry.key for entry in comparison.entries])
    for entry, (color, linestyle) in zip(comparison.entries, looks, strict=True):
        if entry.label not in alike:
            label = _label(entry.label, alike)
            ax.plot(*_curve(entry), color=color, linestyle=linestyle, label=label, lw=1.6)
    plot_data(ax, data)
    if style.spans_decades(data.velocity):
        style.logarithmic_x(ax)
    title = style.plain(data.name)
    ax.set(xlabel=velocity_label(False), ylabel=r"restitution $\varepsilon$", title=title)
    ax.set_ylim(min(0.0, ax.get_ylim()[0]), None)
    return ax


def close_up(comparison: Any, ax: Axes) -> Axes:
    """The same axes, with the data filling half of their height."""
    low, high = np.min(comparison.data.restitution), np.max(comparison.data.restitution)
    room = ROOM * max(high - low, 0.02)
    ax.set_ylim(low - room, high + room)
    return ax


def _looks(keys: Sequence[str]) -> Iterator[tuple[str, Any]]:
    """Colour and dashes of each law: its own, or one of `OTHERS` for a second of that name."""
    others = cycle(OTHERS)
    for place, key in enumerate(keys):
        yield LOOKS[key] if key in LOOKS and key not in keys[:place] else next(others)


def _alike(comparisons: Sequence[Any]) -> dict[str, str]:
    """Laws that have the curve of another one in every comparison, and of which."""
    found = [{e.label: e.same_as for e in one.entries if e.same_as} for one in comparisons]
    return {
        label: other
        for label, other in found[0].items()
        if all(one.get(label) == other for one in found)
    }


def _label(label: str, alike: Mapping[str, str]) -> str:
    """A law's name, with those of laws that are drawn by its line below it."""
    below = [other for other, drawn in alike.items() if drawn == label]
    return "\n= ".join(style.plain(one) for one in (label, *below))


def _curve(entry: Any) -> tuple[np.ndarray, np.ndarray]:
    """Velocities and ε, NaN where it is not known and where nothing rebounds.

    Where each impact has bodies of its own, at those impacts alone.
    """
    result = entry.result
    velocity = result.material().data.velocity
    if not of_each_impact(result.material()):
        spaced = np.geomspace if style.spans_decades(velocity) else np.linspace
        velocity = spaced(np.min(velocity), np.max(velocity), FINE)
    value = result.band(velocity).coefficient
    order = np.argsort(velocity)
    return velocity[order], np.where(value > 0, value, np.nan)[order]
