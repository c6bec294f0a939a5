"""Curves of all laws of a comparison, one column for each data set."""

from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from calibration.fitting.curves import of_each_impact
from calibration.plots import style
from calibration.plots.curves import EPSILON, plot_data, velocity_label

FINE = 256  # points of a curve
ROOM = 0.5  # room above and below the data in the close-up, relative to their height
WIDTHS = (3.4, 0.3, 1.2)  # of the first line drawn, how much less of each further one, the least
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
# for users' laws, and for dashpot laws with another end of contact
OTHERS: tuple[tuple[str, Any], ...] = (
    (style.BLACK, (0, (5, 1))),
    (style.VERMILION, "-"),
    (style.GREEN, (0, (2, 2))),
    (style.PURPLE, (0, (9, 2, 2, 2))),
    (style.ORANGE, (0, (1, 2))),
    (style.SKY, (0, (6, 1, 1, 1, 1, 1))),
)


def comparison_figure(comparisons: Sequence[Any]) -> Figure:
    """Draw each `Comparison` in one column: all curves, and below a close-up of the data."""
    columns, same = len(comparisons), _same_curves(comparisons)
    figure = style.new_figure(max(4.4 * columns, 6.5), 7.1)
    grid = figure.subplots(2, columns, squeeze=False)
    for (upper, lower), comparison in zip(grid.T, comparisons, strict=True):
        for ax in (upper, lower):
            plot_comparison(comparison, ax, same)
        low, high = np.min(comparison.data.restitution), np.max(comparison.data.restitution)
        room = ROOM * max(high - low, 0.02)
        lower.set(ylim=(low - room, high + room), title="")
        upper.set_xlabel("")
    for ax in grid[:, 1:].flat:
        ax.set_ylabel("")
    order = ["data", *(_label(label, same) for label in comparisons[0].ranking)]
    style.legend_below(figure, list(figure.axes), 3 if columns > 2 else 2, order)
    return figure


def plot_comparison(
    comparison: Any, ax: Axes | None = None, same: Mapping[str, str] | None = None
) -> Axes:
    """Draw one data set and the curves of all laws, each thinner than those below it.

    Args:
        comparison: a `Comparison`.
        ax: axes to draw in; a new figure if None.
        same: labels of laws that are not drawn because their curve is that of another law, mapped to
            the label of that law; None: those of this comparison.
    """
    ax = style.axes_or_new(ax)
    same = _same_curves([comparison]) if same is None else same
    others, seen = cycle(OTHERS), set()
    for entry in comparison.entries:
        width = max(WIDTHS[0] - WIDTHS[1] * len(ax.lines), WIDTHS[2])
        first = entry.key in LOOKS and entry.key not in seen
        color, linestyle = LOOKS[entry.key] if first else next(others)
        seen.add(entry.key)
        if entry.label not in same:
            look: dict[str, Any] = {"color": color, "linestyle": linestyle, "lw": width}
            ax.plot(*_curve(entry), label=_label(entry.label, same), **look)
    data = comparison.data
    plot_data(ax, data)
    if style.spans_decades(data.velocity):
        style.logarithmic_x(ax)
    ax.set(xlabel=velocity_label(), ylabel=EPSILON, title=style.plain(data.name))
    low, high = ax.get_ylim()
    ax.set_ylim(min(0.0, low), 1.04 * high)
    return ax


def _same_curves(comparisons: Sequence[Any]) -> dict[str, str]:
    """Laws that have the curve of another law in every comparison, mapped to that law."""
    equal = [{e.label: e.same_as for e in one.entries if e.same_as} for one in comparisons]
    pairs = equal[0].items()
    return {law: other for law, other in pairs if all(one.get(law) == other for one in equal)}


def _label(label: str, same: Mapping[str, str]) -> str:
    """Name of a law, and below it the names of laws with the same curve; p_y as a formula."""
    below = [other for other, drawn in same.items() if drawn == label]
    text = "\n= ".join(style.plain(one) for one in (label, *below))
    return text.replace("p_y/Y", "$p_y/Y$").replace("p_y = Y", "$p_y = Y$")


def _curve(entry: Any) -> tuple[np.ndarray, np.ndarray]:
    """Velocities and ε; NaN where ε is not determined and where nothing rebounds.

    If the bodies differ from impact to impact, only at these impacts.
    """
    fit = entry.result.material()
    velocity = np.sort(fit.data.velocity)
    if not of_each_impact(fit):
        spaced = np.geomspace if style.spans_decades(velocity) else np.linspace
        velocity = spaced(velocity[0], velocity[-1], FINE)
    value = entry.result.band(velocity).coefficient
    return velocity, np.where(value > 0, value, np.nan)
