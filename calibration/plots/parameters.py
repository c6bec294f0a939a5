"""Profile likelihoods of parameters, and their correlations."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse
from matplotlib.ticker import MaxNLocator

from calibration import symbols
from calibration.plots import style

TOP = 1.6  # of a profile's picture, in thresholds
CELL = 0.95  # inches, of two parameters' ellipse
LETTER = 0.09  # inches, of a name next to it
NEARLY_ONE = 0.995  # a correlation that two digits would call 1
MOST_NUMBERS = 12  # with more parameters the numbers in the cells would overlap
SIZE = 0.3  # of a cell: the radius of uncorrelated estimates
COLOURS = "blue: positive; orange: negative"  # of correlations
THIN = 0.02  # of a cell: the least half width of an ellipse


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


def plot_profile(profile, estimate=None, ax: Axes | None = None, model: Any = None) -> Axes:
    """Δχ² over one parameter, the interval's threshold, and where the profile crosses it.

    Args:
        profile: a `Profile` of a fit.
        estimate: the parameter's `Estimate`, whose standard error is drawn as a parabola.
        ax: where to draw; a new figure's where None.
        model: of the law that it is a parameter of, which knows its symbol.
    """
    ax = style.axes_or_new(ax)
    values, rise = _points(profile)
    at_bound = estimate is not None and estimate.at_bound
    logarithmic = style.spans_decades(values) and not at_bound  # a bound of 0 is decades away
    fine = (np.geomspace if logarithmic else np.linspace)(values[0], values[-1], 200)
    ax.plot(*_smooth(values, rise, fine, logarithmic), color=style.BLUE)
    look: dict[str, Any] = {"color": style.BLUE, "marker": "o", "markersize": 3}
    ax.plot(values, rise, linestyle="none", **look)
    ax.plot([], [], label="profile", **look)
    if logarithmic:
        style.logarithmic_x(ax, room=0.0)
    else:
        ax.xaxis.set_major_locator(MaxNLocator(5))
    if estimate is not None and estimate.standard_error:
        parabola = ((fine - estimate.value) / estimate.standard_error) ** 2
        ax.plot(fine, parabola, ":", color=style.ORANGE, label="from the standard error")
    look = {"color": style.VERMILION, "linestyle": "--", "linewidth": 1}
    ax.axhline(profile.threshold, label="threshold of the interval", **look)
    for end, place, side in ((profile.low, 0.02, "left"), (profile.high, 0.98, "right")):
        if end is None:
            look = {"ha": side, "va": "top", "color": style.GREY}
            ax.text(place, 0.96, "open end", transform=ax.transAxes, **look)
        elif np.isfinite(end):
            ax.axvline(end, color=style.GREY, linestyle="-.", linewidth=1, label="interval")
    name, _, owner = profile.parameter.partition("[")
    ax.set_title(style.plain(owner.removesuffix("]")), fontsize="medium")
    ax.set(xlabel=symbols.math(name, model), ylabel=r"$\Delta\chi^2$")
    ax.set_ylim(0, TOP * profile.threshold)
    return ax


def _points(profile) -> tuple[np.ndarray, np.ndarray]:
    """Points of a profile that fit into the picture, and one beyond either end if it is near."""
    values = np.asarray(profile.values, float)
    rise = np.asarray(profile.delta_chi_squared, float)
    finite = np.isfinite(values) & np.isfinite(rise)
    values, first = np.unique(values[finite], return_index=True)
    rise, top = rise[finite][first], TOP * profile.threshold
    inside = np.flatnonzero(rise <= top)
    if len(inside) < 2:
        return values, rise
    near = np.abs(values - np.median(values[inside])) <= 1.5 * np.ptp(values[inside])
    place = np.arange(len(values))
    shown = (place >= inside[0] - 1) & (place <= inside[-1] + 1) & (near | (rise <= top))
    return values[shown], rise[shown]


def _smooth(values: np.ndarray, rise: np.ndarray, fine: np.ndarray, logarithmic: bool):
    """A curve through the points: ±√Δχ² is nearly a straight line, and is what is interpolated."""
    if len(values) < 3:
        return values, rise
    from scipy.interpolate import PchipInterpolator

    scale = np.log if logarithmic else np.array
    side = np.where(np.arange(len(values)) < np.argmin(rise), -1.0, 1.0)
    root = PchipInterpolator(scale(values), side * np.sqrt(np.maximum(rise, 0.0)))
    fine = np.union1d(values, fine)
    return fine, root(scale(fine)) ** 2


def correlation_figure(result: Any) -> Figure | None:
    """Draw the correlations of the fitted parameters; None if there are no two of them.

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
    figure, grid = style.panels(len(blocks), (size, size + 0.25), "data sets", legend=0.4)
    if len(blocks) == 1:
        figure.set_figwidth(size)
    for (owner, labels, matrix), own, (ax,) in zip(blocks, names, grid, strict=False):
        texts = [str(result.estimates.get(label)) for label in labels]
        plot_correlations(matrix, own, ax, texts)
        ax.set_title(style.plain(owner))
    figure.supxlabel(COLOURS, fontsize="small")
    return figure


def plot_correlations(
    correlations, labels: Sequence[str], ax: Axes | None = None, texts: Sequence[str] = ()
) -> Axes:
    """Ellipses below the diagonal, correlations above it.

    Args:
        correlations: (p, p), from -1 to 1; NaN where undefined.
        labels: of the p parameters.
        ax: where to draw; a new figure's where None.
        texts: texts on the diagonal, such as "1.79 ± 0.05".
    """
    matrix, count = np.asarray(correlations, float), len(labels)
    ax = style.axes_or_new(ax)
    for (row, column), value in np.ndenumerate(matrix):
        place = column, count - 1 - row
        digits = 2 if abs(value) < NEARLY_ONE else 4
        text = f"{np.round(value, digits) + 0.0:.{digits}f}" if np.isfinite(value) else "–"
        text = text.replace("-", "−")
        if row == column:
            text = texts[row].replace(" ± ", "\n± ") if texts else ""
        elif (row > column or count > MOST_NUMBERS) and np.isfinite(value):
            long, short = (2 * max(SIZE * np.sqrt(1 + s * abs(value)), THIN) for s in (1, -1))
            color, angle = (style.BLUE, 45) if value >= 0 else (style.VERMILION, -45)
            ax.add_patch(Ellipse(place, long, short, angle=angle, color=color, alpha=0.6))
            continue
        if text:
            ax.text(*place, text, ha="center", va="center", fontsize=7.5)
    turned = 90 if any(", " in label for label in labels) else 0  # data sets are named
    ax.set_xticks(range(count), labels, rotation=turned)
    ax.set_yticks(range(count), labels[::-1])
    ax.set(xlim=(-0.5, count - 0.5), ylim=(-0.5, count - 0.5), aspect="equal")
    ax.tick_params(length=0)
    for edge in np.arange(count - 1) + 0.5:
        ax.axhline(edge, color=style.GREY, linewidth=0.3)
        ax.axvline(edge, color=style.GREY, linewidth=0.3)
    return ax


def _blocks(result: Any) -> list[tuple[str, list[str]]]:
    """(data set, labels) of parameters that belong together; "" for several data sets, or the only one.

    The numbers of a network are left out.
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
    return [
        (names[0] if len(names) == 1 and not alone else "", labels_of)
        for names, labels_of in blocks
    ]


def _symbol(result: Any, label: str, with_owner: bool) -> str:
    name, _, owner = label.partition("[")
    symbol = symbols.math(name, symbols.model_of(label, result), unit=False)
    material = style.shortened(owner.removesuffix("]"))
    return f"{symbol}, {style.plain(material)}" if with_owner and owner else symbol
