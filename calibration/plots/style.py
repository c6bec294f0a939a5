"""Colours that colour-blind readers distinguish, and figures without pyplot."""

import errno
import math
import textwrap
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from calibration import output
from calibration.errors import printable

# M. Okabe and K. Ito, Color Universal Design (2008)
BLACK, ORANGE, SKY, GREEN = "#000000", "#E69F00", "#56B4E9", "#009E73"
BLUE, VERMILION, PURPLE, GREY = "#0072B2", "#D55E00", "#CC79A7", "#777777"
SHADES = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, BLACK, GREY)
# one more than shades: curves may coincide, and many laws have as many looks
DASHES: tuple[Any, ...] = (
    *("-", "--", "-.", ":", (0, (5, 1)), (0, (1, 1)), (0, (8, 3))),
    *((0, (3, 1, 1, 1)), (0, (9, 2, 2, 2))),
)

VELOCITY = "impact velocity $v$ [m/s]"
EPSILON = r"restitution $\varepsilon$"
DPI = 150
WIDTH = 6.4  # inches of a picture: scaled to 420 pixels, letters of 10 points are 9 pixels high
COLUMNS = 2  # panels side by side in it
LINE = 72  # letters of a title above all panels
LONGEST = 20  # letters of a name in a small panel
MOST = 24  # panels of one picture: a hundred take a minute to draw
LONGEST_REASON = 200  # letters
NARROW = 4.5  # inches: a narrower picture has smaller letters in its legend
LOG_DECADES = 1.5  # data that span more are drawn over a logarithmic axis


# errors of a device or a folder, which concern all results
OF_DEVICE = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EROFS, errno.EACCES}


@contextmanager
def own_settings() -> Iterator[None]:
    """Matplotlib's defaults in place of the user's settings: a file of results does not depend on these."""
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        yield


def draw(make: Callable[[], Figure | Axes | None], path: Path) -> bool:
    """Make a picture and save it, with settings of its own; False where there is none.

    One that fails is entered in `output.lost`, and nothing else of the results is.
    """
    try:
        with own_settings():
            picture = make()
            if picture is not None:
                save(picture, path)
            return picture is not None
    except Exception as error:
        if isinstance(error, OSError) and error.errno in OF_DEVICE:
            raise
        path.unlink(missing_ok=True)
        reason = " ".join(str(error).split())
        output.lost[path.name] = f"{type(error).__name__}: {reason}"[:LONGEST_REASON]
        return False


def new_figure(height: float, width: float = WIDTH) -> Figure:
    """A figure of this size in inches that draws itself with Agg."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def axes_or_new(ax: Axes | None, height: float) -> Axes:
    return new_figure(height).add_subplot() if ax is None else ax


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
    height: float,
    what: str,
    heights: Sequence[float] = (1.0,),
    legend: float = 0.5,
    size: tuple[float, float] | None = None,
) -> tuple[Figure, Any]:
    """A figure with (panels, len(heights)) axes in up to `COLUMNS` columns, for `MOST` of `count` things.

    `height` is that of a panel and `legend` room below [inches], `heights` the relative ones of its axes,
    `size` (width, height) of the figure where it is stated.
    """
    shown, deep = min(count, MOST), len(heights)
    columns = min(shown, COLUMNS)
    rows = math.ceil(shown / columns)
    width, tall = size or (WIDTH, height * rows + legend * (shown % columns == 0))
    figure = new_figure(tall, width)
    grid: Any = figure.subplots(
        deep * rows, columns, squeeze=False, height_ratios=[*heights] * rows
    )
    each = grid.reshape(rows, deep, columns).swapaxes(1, 2).reshape(-1, deep)
    for ax in each[shown:].flat:
        ax.remove()
    if shown < count:
        set_title(figure, f"the first {shown} of {count} {what}: all are in fit.json")
    return figure, each[:shown]


def set_title(figure: Figure, text: str) -> None:
    """A title above all panels, in as many lines as it needs."""
    figure.suptitle(textwrap.fill(text, LINE), fontsize="medium")


def points(ax: Axes, x, y, up=None, across=None, color=BLACK, marker="o", label: str | None = None):
    """Hollow markers with error bars."""
    look: dict[str, Any] = {"ms": 3.5, "mew": 0.8, "elinewidth": 0.8, "mfc": "white", "zorder": 3}
    ax.errorbar(x, y, up, across, marker, color=color, label=label, **look)


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


def spans_decades(values: np.ndarray) -> bool:
    """Whether positive values span more than a linear axis shows."""
    low, high = np.min(values), np.max(values)
    return bool(low > 0 and np.log10(high / low) > LOG_DECADES)


def mark_velocity(ax: Axes, velocity: float | None, inside: np.ndarray, **style_of_line) -> None:
    """A dotted line at a velocity between those of a curve."""
    if velocity is not None and np.min(inside) < velocity < np.max(inside):
        ax.axvline(velocity, linewidth=1, linestyle=":", **{"color": GREY, **style_of_line})


def legend_below(figure: Figure, axes: Sequence[Axes], columns: int = 2, first: Sequence[str] = ()):
    """One legend for all axes, labels of `first` first; in `columns`, or as many as the figure takes.

    Where the last cell of a grid is free it goes there.
    """
    handles: dict[str, Any] = {}
    for ax in axes:
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    handles = {name: handles[name] for name in first if name in handles} | handles
    place: dict[str, Any] = {"loc": "outside lower center", "frameon": False, "fontsize": "small"}
    place["handlelength"] = 4.0  # room for dashes
    if figure.get_figwidth() < NARROW:
        place |= {"fontsize": "x-small", "handlelength": 2.5}
    last = axes[-1].get_subplotspec()
    if last is not None and not last.is_last_col():
        above, rows = last.rowspan.start, last.get_gridspec().nrows
        place |= {"loc": "center", "bbox_to_anchor": (0.76, 0.5 - 0.5 * above / rows)}
        columns = 1
    for count in range(max(min(columns, len(handles)), 1), 0, -1):
        legend = figure.legend(handles.values(), handles.keys(), ncols=count, **place)
        for line in legend.get_lines():  # dashes are as long as their line is wide
            line.set_linewidth(min(line.get_linewidth(), 1.6))
        if count == 1 or legend.get_window_extent().width <= figure.bbox.width:
            return
        legend.remove()
