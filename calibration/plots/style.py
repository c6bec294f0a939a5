"""Colours that colour-blind readers distinguish, and figures without pyplot."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from calibration.errors import printable

# M. Okabe and K. Ito, Color Universal Design (2008)
BLACK, ORANGE, SKY, GREEN = "#000000", "#E69F00", "#56B4E9", "#009E73"
BLUE, VERMILION, PURPLE, GREY = "#0072B2", "#D55E00", "#CC79A7", "#777777"

VELOCITY = "impact velocity $v$ [m/s]"
EPSILON = r"restitution $\varepsilon$"
DPI = 150
LONGEST = 20  # letters of a name in a small panel
MOST = 24  # panels of one picture: a hundred take a minute to draw
PREFIXES = {-3: "n", -2: "µ", -1: "m", 0: "", 1: "k", 2: "M"}  # of powers of 1000
LOG_DECADES = 1.5  # data that span more are drawn over a logarithmic axis


def new_figure(width: float, height: float) -> Figure:
    """A figure of this size in inches that draws itself with Agg."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def axes_or_new(ax: Axes | None, width: float = 5.0, height: float = 4.0) -> Axes:
    return new_figure(width, height).add_subplot() if ax is None else ax


def save(picture: Figure | Axes, path: str | Path) -> None:
    """Write a figure, or that of some axes, as PNG; without a date, so that equal figures are equal files."""
    figure: Any = picture.figure
    engine = figure.get_layout_engine()
    if engine is not None:  # once: saving would do it twice
        engine.execute(figure)
        figure.set_layout_engine("none")
    figure.savefig(path, dpi=DPI, metadata={"Software": None})


def plain(text: str) -> str:
    """A name as it is: Matplotlib reads formulas between dollars, and no label that begins with _."""
    text = printable(text).replace("$", r"\$")
    return f"\N{ZERO WIDTH SPACE}{text}" if text.startswith("_") else text


def shortened(text: str) -> str:
    """A name that leaves room for what it names."""
    return text if len(text) <= LONGEST else text[: LONGEST - 1] + "…"


def panels(
    count: int,
    size: tuple[float, float],
    what: str,
    heights: Sequence[float] = (1.0,),
    legend: float = 0.5,
) -> tuple[Figure, Any]:
    """A figure with (panels, len(heights)) axes in up to three columns, for `MOST` of `count` things.

    `size` is that of a panel and `legend` room below [inches], `heights` the relative ones of its axes.
    """
    shown, deep = min(count, MOST), len(heights)
    columns = 3 if shown == 3 else min(3, math.ceil(math.sqrt(shown)))
    rows = math.ceil(shown / columns)
    figure = new_figure(max(size[0] * columns, 5.5), size[1] * rows + legend)
    grid: Any = figure.subplots(
        deep * rows, columns, squeeze=False, height_ratios=[*heights] * rows
    )
    each = grid.reshape(rows, deep, columns).swapaxes(1, 2).reshape(-1, deep)
    for ax in each[shown:].flat:
        ax.remove()
    if shown < count:
        title = f"the first {shown} of {count} {what}: all are in fit.json"
        figure.suptitle(title, fontsize="medium")
    return figure, each[:shown]


def points(ax: Axes, x, y, up=None, across=None, color=BLACK, marker="o", label: str | None = None):
    """Hollow markers with error bars."""
    style_of_points: dict[str, Any] = {"markersize": 3.5, "markeredgewidth": 0.8, "elinewidth": 0.8}
    style_of_points |= {"markerfacecolor": "white", "color": color, "fmt": marker, "zorder": 3}
    ax.errorbar(x, y, up, across, label=label, **style_of_points)


def band(ax: Axes, x, low, high, color: str = BLUE, alpha: float = 0.25, label: str | None = None):
    """The area between two curves."""
    ax.fill_between(x, low, high, color=color, alpha=alpha, linewidth=0, label=label)


def logarithmic_x(ax: Axes, room: float = 3.2) -> None:
    """A logarithmic axis with plain numbers, also at 2 and 5 if it spans fewer than `room` decades."""
    ax.set_xscale("log")
    low, high = ax.get_xlim()
    if np.log10(high / low) < room:
        ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    if low >= 1e-4 and high < 1e5:
        ax.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    ax.xaxis.set_minor_formatter(NullFormatter())


def in_prefixed_unit(ax: Axes, unit: str, values: np.ndarray) -> str:
    """Set a y axis of positive SI values to a unit with a prefix, and return it; logarithmic over decades."""
    place = math.floor(math.log10(float(np.median(values))) / 3)
    place = min(max(place, min(PREFIXES)), max(PREFIXES))
    size = 1000.0**place
    if spans_decades(values):
        ax.set_yscale("log")
        ax.yaxis.set_minor_formatter(NullFormatter())
    ax.yaxis.set_major_formatter(lambda y, _: f"{y / size:.5g}")
    return PREFIXES[place] + unit


def spans_decades(values: np.ndarray) -> bool:
    """Whether positive values span more than a linear axis shows."""
    low, high = np.min(values), np.max(values)
    return bool(low > 0 and np.log10(high / low) > LOG_DECADES)


def mark_velocity(ax: Axes, velocity: float | None, inside: np.ndarray, **style_of_line) -> None:
    """A dotted line at a velocity between those of a curve."""
    if velocity is not None and np.min(inside) < velocity < np.max(inside):
        ax.axvline(velocity, linewidth=1, linestyle=":", **{"color": GREY, **style_of_line})


def legend_below(figure: Figure, axes: Sequence[Axes], columns: int, first: Sequence[str] = ()):
    """One legend for all axes, labels of `first` first; in `columns`, or as many as the figure takes."""
    handles: dict[str, Any] = {}
    for ax in axes:
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    handles = {name: handles[name] for name in first if name in handles} | handles
    place = {"loc": "outside lower center", "frameon": False}
    for count in range(max(min(columns, len(handles)), 1), 0, -1):
        legend = figure.legend(handles.values(), handles.keys(), ncols=count, **place)
        if count == 1 or legend.get_window_extent().width <= figure.bbox.width:
            return
        legend.remove()
