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
BLACK = "#000000"
ORANGE = "#E69F00"
SKY = "#56B4E9"
GREEN = "#009E73"
BLUE = "#0072B2"
VERMILION = "#D55E00"
PURPLE = "#CC79A7"
GREY = "#777777"

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
    figure = picture if isinstance(picture, Figure) else picture.get_figure(root=True)
    assert figure is not None
    engine = figure.get_layout_engine()
    if engine is not None:  # once: saving would do it twice
        engine.execute(figure)
        figure.set_layout_engine("none")
    figure.savefig(path, dpi=DPI, metadata={"Software": None})


def plain(text: str) -> str:
    """A name as it is: Matplotlib reads formulas between dollars, and no label that begins with _."""
    text = printable(text).replace("$", r"\$")
    return f"\N{ZERO WIDTH SPACE}{text}" if text.startswith("_") else text


def shortened(text: str, most: int = LONGEST) -> str:
    """A name that leaves room for what it names."""
    return text if len(text) <= most else text[: most - 1] + "…"


def panels(
    count: int,
    size: tuple[float, float],
    what: str,
    heights: Sequence[float] = (1.0,),
    legend: float = 0.5,
) -> tuple[Figure, Any]:
    """A figure of as square an array of panels as three columns allow, for `MOST` things at most.

    Args:
        count: of the things; that some are not shown stands above the panels.
        size: width and height of a panel [inches].
        what: the things are, in words.
        heights: of the axes above each other in a panel, relative.
        legend: room for the legend [inches].

    Returns:
        The figure, and its axes: (panels, len(heights)).
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
        figure.suptitle(
            f"the first {shown} of {count} {what}: all are in fit.json", fontsize="medium"
        )
    return figure, each[:shown]


def logarithmic_x(ax: Axes, room: float = 3.2) -> None:
    """A logarithmic axis with plain numbers, at 1, 2 and 5 too where it spans < `room` decades."""
    ax.set_xscale("log")
    low, high = ax.get_xlim()
    if np.log10(high / low) < room:
        ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    if low >= 1e-4 and high < 1e5:
        ax.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    ax.xaxis.set_minor_formatter(NullFormatter())


def in_prefixed_unit(ax: Axes, unit: str, values: np.ndarray) -> str:
    """A y axis of positive SI values in a unit with a prefix, "µs"; logarithmic where they span decades."""
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


def mark_velocity(ax: Axes, velocity: float | None, of: np.ndarray, label: str) -> None:
    """A line at this velocity, if it lies inside those of a curve."""
    if velocity is not None and np.min(of) < velocity < np.max(of):
        ax.axvline(velocity, color=GREY, linestyle=":", linewidth=1, label=label)


def legend_below(figure: Figure, axes: list[Axes], columns: int, first: Sequence[str] = ()) -> None:
    """One legend for all axes, each label once, those of `first` first.

    In this number of columns, or in as many fewer as the figure's width takes.
    """
    found: dict[str, Any] = {}
    for ax in axes:
        handles, labels = ax.get_legend_handles_labels()
        for handle, label in zip(handles, labels, strict=True):
            found.setdefault(label, handle)
    labels = [*(name for name in first if name in found), *(n for n in found if n not in first)]
    handles = [found[label] for label in labels]
    place = {"loc": "outside lower center", "frameon": False}
    for count in range(max(min(columns, len(found)), 1), 0, -1):
        legend = figure.legend(handles, labels, ncols=count, **place)
        if count == 1 or legend.get_window_extent().width <= figure.bbox.width:
            return
        legend.remove()
