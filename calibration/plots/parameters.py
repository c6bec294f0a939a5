"""Parameters: profile likelihoods, correlations, posterior draws, and χ̃ over E/Y."""

import textwrap
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse
from matplotlib.ticker import MaxNLocator, NullFormatter

from calibration import symbols
from calibration.errors import DataError
from calibration.fitting.uncertainty import quantile
from calibration.plots import style

TOP = 1.6  # of a profile's picture, in thresholds
CELL = 0.95  # inches, of two parameters' ellipse, at most
WITH_ESTIMATE, WITH_NUMBER = 0.55, 0.4  # inches, of a cell that has room for these
LETTER = 0.09  # inches, of a name next to it
NEARLY_ONE = 0.995  # a correlation that two digits would call 1
SIZE = 0.3  # of a cell: the radius of uncorrelated estimates
THIN = 0.02  # of a cell: the least half width of an ellipse
NOISES = {"noise": "scatter", "group": "between groups", "timing": "of times [s]"}  # as tables say
MOST_PAIRED = 8  # parameters of posterior.png: with more nothing can be read
CROWDED = 5  # of them, from which on letters are small, numbers turned and names wrapped
NARROW = 11  # letters of a line of a name then
SHOWN = 2000  # draws of a panel
BINS = 40
SHORT = 3  # powers of ten beyond which these stand in the label
TAIL = 0.002  # of the draws, on either side, beyond the axis
EXPLAINED = (
    "above the diagonal: correlations; below: ellipses\n"
    "of equal probability (blue: positive, orange: negative)"
)
BEYOND = 1.3  # how far the line of χ̃ goes beyond the materials, as a factor


def profiles_figure(result: Any) -> Figure | None:
    """Δχ² over each parameter, the interval's threshold, and where the profile crosses it.

    None if no profile leaves its parameter's bound.
    """
    profiles = {k: p for k, p in result.profiles.items() if len(set(p.values)) > 1}
    if not profiles:
        return None
    figure, grid = style.panels(len(profiles), 2.8, "profiles")
    for (label, profile), (ax,) in zip(profiles.items(), grid, strict=False):
        _plot_profile(ax, profile, result.estimates.get(label))
        name, _, owner = label.partition("[")
        ax.set_title(style.plain(owner.removesuffix("]")), fontsize="medium")
        ax.set_xlabel(symbols.math(name, symbols.model_of(label, result)))
    style.legend_below(figure, list(grid.flat))
    return figure


def _plot_profile(ax: Axes, profile: Any, estimate: Any) -> None:
    values, rise = _points(profile)
    at_bound = estimate is not None and estimate.at_bound
    logarithmic = style.spans_decades(values) and not at_bound  # a bound of 0 is decades away
    fine = (np.geomspace if logarithmic else np.linspace)(values[0], values[-1], 200)
    ax.plot(*_smooth(values, rise, fine, logarithmic), color=style.BLUE)
    ax.plot(values, rise, "o", color=style.BLUE, ms=3)
    ax.plot([], [], "-o", color=style.BLUE, ms=3, label="profile")
    if logarithmic:
        style.logarithmic_x(ax, room=0.0)
    else:
        ax.xaxis.set_major_locator(MaxNLocator(5))
    if estimate is not None and estimate.standard_error:
        parabola = ((fine - estimate.value) / estimate.standard_error) ** 2
        ax.plot(fine, parabola, ":", color=style.ORANGE, label="from the standard error")
    text = "threshold of the interval"
    ax.axhline(profile.threshold, label=text, color=style.VERMILION, ls="--", lw=1)
    for end, place, side in ((profile.low, 0.02, "left"), (profile.high, 0.98, "right")):
        if end is None:
            where: dict[str, Any] = {"ha": side, "va": "top", "transform": ax.transAxes}
            ax.text(place, 0.96, "open end", color=style.GREY, **where)
        elif np.isfinite(end):
            ax.axvline(end, color=style.GREY, linestyle="-.", linewidth=1, label="interval")
    ax.set(ylim=(0, TOP * profile.threshold), ylabel=r"$\Delta\chi^2$")


def _points(profile: Any) -> tuple[np.ndarray, np.ndarray]:
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
    scale = np.log if logarithmic else np.array
    side = np.where(np.arange(len(values)) < np.argmin(rise), -1.0, 1.0)
    fine = np.union1d(values, fine)
    root = np.interp(scale(fine), scale(values), side * np.sqrt(np.maximum(rise, 0.0)))
    return fine, root**2


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
        if np.any(np.isfinite(matrix[np.triu_indices_from(matrix, 1)])):
            names = [_name(result, label, not owner) for label in labels]
            texts = [str(result.estimates.get(label)) for label in labels]
            blocks.append((owner, matrix, names, texts))
    if not blocks:
        return None
    room = max(0.8, LETTER * max(len(name) for *_, names, _ in blocks for name in names))
    count = max(len(matrix) for _, matrix, *_ in blocks)
    cell = min(CELL, (style.WIDTH / min(len(blocks), style.COLUMNS) - room) / count)
    size = room + cell * count
    figure, grid = style.panels(len(blocks), size + 0.25, "data sets", legend=0.6)
    if len(blocks) == 1:
        figure.set_figwidth(size)
    for (owner, matrix, names, texts), (ax,) in zip(blocks, grid, strict=False):
        _plot_correlations(ax, matrix, names, texts, cell)
        ax.set_title(style.plain(owner))
    figure.supxlabel(EXPLAINED, fontsize="small")
    return figure


def _plot_correlations(ax: Axes, matrix: np.ndarray, names, texts: Sequence[str], cell: float):
    """Ellipses below the diagonal, correlations above it, estimates on it, as far as cells have room."""
    count = len(names)
    for (row, column), value in np.ndenumerate(matrix):
        place = column, count - 1 - row
        digits = 2 if abs(value) < NEARLY_ONE else 4
        text = f"{np.round(value, digits) + 0.0:.{digits}f}" if np.isfinite(value) else "–"
        text = text.replace("-", "−")
        if row == column:
            text = texts[row].replace(" ± ", "\n± ") if cell > WITH_ESTIMATE else ""
        elif (row > column or cell < WITH_NUMBER) and np.isfinite(value):
            long, short = (2 * max(SIZE * np.sqrt(1 + s * abs(value)), THIN) for s in (1, -1))
            color, angle = (style.BLUE, 45) if value >= 0 else (style.VERMILION, -45)
            ax.add_patch(Ellipse(place, long, short, angle=angle, color=color, alpha=0.6))
            continue
        ax.text(*place, text, ha="center", va="center", fontsize=7.5)
    turned = 90 if any(", " in name for name in names) else 0  # data sets are named
    ax.set_xticks(range(count), names, rotation=turned)
    ax.set_yticks(range(count), names[::-1])
    ax.set(xlim=(-0.5, count - 0.5), ylim=(-0.5, count - 0.5), aspect="equal")
    ax.tick_params(length=0)
    for edge in np.arange(count - 1) + 0.5:
        ax.axhline(edge, color=style.GREY, linewidth=0.3)
        ax.axvline(edge, color=style.GREY, linewidth=0.3)


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
    several = len(result.materials) > 1
    return [(names[0] if len(names) == 1 and several else "", labels) for names, labels in blocks]


def _name(result: Any, label: str, with_owner: bool) -> str:
    name, _, owner = label.partition("[")
    symbol = symbols.math(name, symbols.model_of(label, result), unit=False)
    material = style.plain(style.shortened(owner.removesuffix("]")))
    return f"{symbol}, {material}" if with_owner and owner else symbol


def posterior_figure(posterior: Any, result: Any = None) -> Figure:
    """Histograms of the first eight parameters on the diagonal, draws of each pair below it.

    Args:
        posterior: draws as ArviZ data; those that diverged are marked.
        result: the `FitResult` whose values and intervals are drawn in.
    """
    from calibration.fitting.posterior.draws import dataset_of

    variables = dataset_of(posterior, "posterior").data_vars.items()
    draws = {str(name): np.ravel(values) for name, values in [*variables][:MOST_PAIRED]}
    diverging = np.ravel(dataset_of(posterior, "sample_stats")["diverging"])
    names, count = list(draws), len(draws)
    figure, letters = style.new_figure(style.WIDTH), "medium" if count < CROWDED else "x-small"
    grid = figure.subplots(count, count, squeeze=False)
    ends = {name: _ends(values) for name, values in draws.items()}
    logarithmic = {name: style.spans_decades(np.array(ends[name])) for name in names}
    powers = {name: 0 if logarithmic[name] else _power(ends[name]) for name in names}
    width = style.LONGEST if count < CROWDED else NARROW
    labels = {name: _label(name, result, powers[name], width) for name in names}
    estimates = {} if result is None else result.estimates
    for row, column in np.ndindex(count, count):
        ax, x, y = grid[row, column], names[column], names[row]
        if row < column:
            ax.remove()
            continue
        if row == column:
            space = np.geomspace if logarithmic[x] else np.linspace
            ax.hist(draws[x], space(*ends[x], BINS), color=style.SKY, label="draws")
            ax.set_yticks([])
            _mark_interval(ax, estimates.get(x))
        else:
            step = max(1, len(draws[x]) // SHOWN)
            ax.plot(draws[x][::step], draws[y][::step], ".", color=style.SKY, ms=2, alpha=0.5)
            if np.any(diverging):
                wild = draws[x][diverging], draws[y][diverging]
                ax.plot(*wild, ".", color=style.VERMILION, ms=3, label="diverged")
            fitted = [estimates[name].value for name in (x, y) if name in estimates]
            if len(fitted) == 2 and None not in fitted:
                ax.plot(*fitted, "+", color=style.BLACK, markersize=9, label="fit")
            _limit(ax, "y", ends[y], logarithmic[y], powers[y])
        _limit(ax, "x", ends[x], logarithmic[x], powers[x])
        turned = 0 if count < CROWDED else 90
        ax.tick_params(labelbottom=row == count - 1, labelleft=column == 0 < row, labelsize=letters)
        ax.tick_params("x", which="both", labelrotation=turned)
        ax.set_xlabel(labels[x] if row == count - 1 else "", fontsize=letters)
        ax.set_ylabel(labels[y] if column == 0 < row else "", fontsize=letters)
    figure.align_labels()
    style.legend_below(figure, list(figure.axes), 4)
    return figure


def _mark_interval(ax: Axes, estimate: Any) -> None:
    """The fit's value, and the ends of its interval."""
    if estimate is None or estimate.value is None:
        return
    ax.axvline(estimate.value, color=style.BLACK, linewidth=1, label="fit")
    for end in (estimate.low, estimate.high):
        if end is not None and np.isfinite(end):
            ax.axvline(end, label="the fit's interval", color=style.GREY, ls="-.", lw=1)


def _power(ends: tuple[float, float]) -> int:
    """The power of ten that stands in an axis' label; 0 for numbers that are written as they are."""
    power = int(np.floor(np.log10(max(*np.abs(ends), 1e-300))))
    return power if abs(power) > SHORT else 0


def _limit(ax: Axes, which: str, ends: tuple[float, float], logarithmic: bool, power: int) -> None:
    axis = getattr(ax, f"{which}axis")
    if logarithmic:
        getattr(ax, f"set_{which}scale")("log")
        axis.set_minor_formatter(NullFormatter())  # else they take the room of the panels
    else:
        axis.set_major_locator(MaxNLocator(3 if which == "y" else 2))
        if power:
            axis.set_major_formatter(lambda value, _: f"{value / 10.0**power:.4g}")
    getattr(ax, f"set_{which}lim")(*ends)


def _label(name: str, result: Any, power: int, width: int) -> str:
    """The symbol with its power of ten and unit, the data set below it in lines of `width` letters."""
    base, _, owner = name.removesuffix("]").partition("[")
    symbol = NOISES.get(base) or symbols.math(base, symbols.model_of(name, result))
    if power:
        symbol, _, unit = symbol.partition(" [")
        symbol += rf" [$10^{{{power}}}$ {unit}" if unit else rf" [$10^{{{power}}}$]"
    return "\n".join([symbol, *map(style.plain, textwrap.wrap(style.shortened(owner), width))])


def _ends(values: np.ndarray) -> tuple[float, float]:
    low, high = (float(end) for end in np.quantile(values, [TAIL, 1 - TAIL]))
    return (low, high) if high > low else (low - 0.5, high + 0.5)


def unloading_line_figure(line: Any, contact: Any = None, name: str = "") -> Figure:
    """χ̃ of each material with its interval, Eq. (18) with its band, dashed where it is extrapolated.

    Args:
        line: `FitResult.unloading_line`.
        contact: of a further material, whose place is marked.
        name: of the further material.
    """
    figure = style.new_figure(4.6)
    ax = figure.add_subplot()
    ends, reach = list(line.range), float(quantile(line.confidence, np.inf))
    shown = [(m.yield_ratio, m.chi, reach * (m.chi_error or 0.0)) for m in line.materials]
    top = max(chi + error for _, chi, error in shown)
    if contact is not None:
        new, chi = float(np.asarray(contact.yield_ratio)), line.unloading_factor(contact)
        ends, top = [*ends, new], max(top, chi.value)
        up = np.abs(np.array(_interval(chi)) - chi.value)[:, None]
        label = style.plain(name or "the further material") + " (predicted)"
        ax.errorbar(new, chi.value, up, fmt="D", color=style.VERMILION, capsize=3, label=label)
    ylim = -0.05 * top, 1.3 * top
    _plot_line(ax, line, np.linspace(min(ends) / BEYOND, max(ends) * BEYOND, 200), ylim)
    label = f"fitted, {100 * line.confidence:g} % intervals"
    for (ratio, chi, error), material in zip(shown, line.materials, strict=True):
        ax.errorbar(ratio, chi, error, fmt="o", color=style.BLUE, capsize=3, label=label)
        is_last = ratio > 0.7 * max(ends)
        where: Any = {"ha": "right" if is_last else "left", "va": "bottom" if is_last else "center"}
        offset = (-8, 8) if is_last else (8, 0)
        text = style.plain(style.shortened(material.name))
        ax.annotate(text, (ratio, chi), offset, textcoords="offset points", zorder=3, **where)
    across, up = "effective modulus over yield strength, $E/Y$", r"unloading factor $\tilde\chi$"
    ax.set(xlabel=across, ylabel=up, ylim=ylim)
    style.legend_below(figure, [ax], first=("Eq. (18)", "extrapolated"))
    return figure


def _plot_line(ax: Axes, line: Any, ratio: np.ndarray, ylim: tuple[float, float]) -> None:
    columns = np.full((3, len(ratio)), np.nan)
    for k, x in enumerate(ratio):
        try:
            estimate = line.at(x)
        except DataError:  # no positive χ̃
            continue
        columns[:, k] = estimate.value, *_interval(estimate)
    value, low, high = columns
    within = (ratio >= line.range[0]) & (ratio <= line.range[1])
    for shown, dashes, label in ((within, "-", "Eq. (18)"), (~within, "--", "extrapolated")):
        ax.plot(ratio, np.where(shown, value, np.nan), dashes, color=style.BLACK, lw=1, label=label)
    if np.any(high > low):
        label = f"{100 * line.confidence:g} % band of a further material"
        if np.nanmax(high) > ylim[1]:
            label += "\n(wider than the picture)"
        style.band(ax, ratio, low, high, style.GREY, label=label)


def _interval(estimate: Any) -> tuple[float, float]:
    """Low and high end; the value for an end that is not known."""
    ends = estimate.low, estimate.high
    return tuple(estimate.value if end is None else end for end in ends)  # type: ignore[return-value]
