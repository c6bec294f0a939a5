"""Parameters: profile likelihoods, correlations, posterior draws, and χ̃ over E/Y."""

import textwrap
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, NullFormatter

from calibration import symbols
from calibration.errors import DataError
from calibration.fitting.degrees_of_freedom import quantile
from calibration.plots import style

TOP = 1.6  # of a profile's picture, in thresholds
MOST_CORRELATED = 24  # parameters of correlation.png
MOST_WRITTEN = 10  # and up to which it has numbers
NEARLY_ONE = 0.995  # a correlation that two digits would call 1
# as tables say; "timing" is of what has the unit
NOISES = {"noise": "scatter", "group": "between groups"}
READINGS = {"s": "error of times [s]", "m": "error of heights [m]"}
MOST_PAIRED = 8  # parameters of posterior.png: with more nothing can be read
CROWDED = 5  # of them, from which on letters are small, numbers turned and names wrapped
NARROW = 11  # letters of a line of a name then
SHOWN = 2000  # draws of a panel
BINS = 40
TAIL = 0.002  # of the draws, on either side, beyond the axis
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
        of = symbols.symbol(name, symbols.model_of(label, result))
        ax.set_xlabel(symbols.in_math(of.label))
    style.legend_below(figure, list(grid.flat))
    return figure


def _plot_profile(ax: Axes, profile: Any, estimate: Any) -> None:
    """Between the points that fit into the picture: others may be decades away."""
    values, rise = (np.asarray(x, float) for x in (profile.values, profile.delta_chi_squared))
    finite = np.isfinite(values) & np.isfinite(rise)
    values, first = np.unique(values[finite], return_index=True)
    rise, top = rise[finite][first], TOP * profile.threshold
    inside = values[rise <= top] if np.sum(rise <= top) > 1 else values
    at_bound = estimate is not None and estimate.at_bound
    is_log = style.spans_decades(inside) and not at_bound  # a bound of 0 is decades away
    fine = (np.geomspace if is_log else np.linspace)(inside[0], inside[-1], 200)
    fine = np.union1d(fine, values)
    scale = np.log if is_log else np.array
    # ±√Δχ² is nearly a straight line
    root = np.where(values < values[np.argmin(rise)], -1, 1) * np.sqrt(np.maximum(rise, 0))
    ax.plot(fine, np.interp(scale(fine), scale(values), root) ** 2, color=style.BLUE)
    ax.plot(values, rise, "o", color=style.BLUE, ms=3)
    ax.plot([], [], "-o", color=style.BLUE, ms=3, label="profile")
    # of the likelihood, which uncertain inputs do not enter
    error = estimate and (estimate.statistical_error or estimate.standard_error)
    if estimate is not None and error:
        parabola = ((fine - estimate.value) / error) ** 2
        ax.plot(fine, parabola, ":", color=style.ORANGE, label="from the standard error")
    text = "threshold of the interval"
    ax.axhline(profile.threshold, label=text, color=style.VERMILION, ls="--", lw=1)
    for end, place, side in ((profile.low, 0.02, "left"), (profile.high, 0.98, "right")):
        if end is None:
            where: dict[str, Any] = {"ha": side, "va": "top", "transform": ax.transAxes}
            ax.text(place, 0.96, "open end", color=style.GREY, **where)
        elif np.isfinite(end):
            ax.axvline(end, color=style.GREY, linestyle="-.", linewidth=1, label="interval")
    ax.set(xlim=(inside[0], inside[-1]), ylim=(0, top), ylabel=r"$\Delta\chi^2$")
    if is_log:
        style.logarithmic_x(ax, room=0.0)
    else:
        ax.xaxis.set_major_locator(MaxNLocator(5))


def correlation_figure(result: Any) -> Figure | None:
    """The matrix of correlations of the fitted parameters; None if no two of them are correlated.

    Left out are parameters without a correlation, such as those at a bound, and the numbers of a network.
    """
    numbers = {label for fit in result.materials for n, label in fit.labels.items() if "[" in n}
    every = np.array(result.covariance_names)
    linked = np.sum(np.abs(np.nan_to_num(result.correlations)) > 0, axis=1) > 1
    kept = np.flatnonzero(linked & ~np.isin(every, list(numbers)))
    count = len(kept)
    if not count:
        return None
    kept = kept[:MOST_CORRELATED]
    matrix = result.correlations[np.ix_(kept, kept)]
    size = min(style.WIDTH, 2.6 + 0.5 * len(kept))
    figure = style.new_figure(size, size)
    ax = figure.add_subplot()
    image = ax.imshow(matrix, "RdBu", vmin=-1, vmax=1, alpha=0.6)
    for (row, column), value in np.ndenumerate(matrix):
        if len(kept) <= MOST_WRITTEN and np.abs(value) > 0:  # neither NaN nor independent
            digits = 2 if abs(value) < NEARLY_ONE or row == column else 4
            text = f"{np.round(value, digits) + 0.0:.{digits}f}".replace("-", "−")
            ax.text(column, row, text, ha="center", va="center", fontsize=7.5)
    names = [_name(label, result, style.LONGEST) for label in every[kept]]
    ax.set_xticks(range(len(kept)), names, rotation=90 * any("\n" in name for name in names))
    ax.set_yticks(range(len(kept)), names)
    some = f": the first {len(kept)} of {count}, all are in fit.json" * (count > len(kept))
    ax.set_title(f"correlations{some}", fontsize="medium")
    figure.colorbar(image, ax=ax, shrink=0.7, ticks=[-1, 0, 1])
    return figure


def _name(label: str, result: Any, width: int, unit: str | None = None) -> str:
    """The symbol of a parameter with its unit, if one is given; below it the data set in lines of `width` letters."""
    base, _, owner = label.removesuffix("]").partition("[")
    of = symbols.symbol(base, symbols.model_of(label, result))
    noise = READINGS.get(unit or "") if base == "timing" else NOISES.get(base)
    symbol = noise or symbols.in_math(of.text if unit is None else of.label)
    lines = textwrap.wrap(style.shortened(owner), width)
    return "\n".join([symbol, *map(style.plain, lines)])


def posterior_figure(posterior: Any, result: Any = None) -> Figure:
    """Histograms of the first eight parameters on the diagonal, draws of each pair below it.

    Args:
        posterior: draws as ArviZ data; those that diverged are marked.
        result: the `FitResult` whose values and intervals are drawn in.
    """
    from calibration.fitting.posterior.draws import dataset_of

    variables = {str(name): of for name, of in dataset_of(posterior, "posterior").data_vars.items()}
    draws = {name: np.ravel(of) for name, of in [*variables.items()][:MOST_PAIRED]}
    diverging = np.ravel(dataset_of(posterior, "sample_stats")["diverging"])
    ends = {name: np.quantile(values, [TAIL, 1 - TAIL]) for name, values in draws.items()}
    names, count, is_crowded = list(draws), len(draws), len(draws) >= CROWDED
    letters, width = ("x-small", NARROW) if is_crowded else ("medium", style.LONGEST)
    labels = {
        name: _name(name, result, width, variables[name].attrs.get("unit", "")) for name in names
    }
    figure = style.new_figure(style.WIDTH)
    grid = figure.subplots(count, count, squeeze=False, sharex="col")
    estimates = {} if result is None else result.estimates
    for row, column in zip(*np.triu_indices(count, 1), strict=True):
        grid[row, column].remove()
    for row, column in zip(*np.tril_indices(count), strict=True):
        ax, x, y = grid[row, column], names[column], names[row]
        shown = [("x", x, 2)]
        if row == column:
            space: Any = np.geomspace if style.spans_decades(ends[x]) else np.linspace
            ax.hist(draws[x], space(*ends[x], BINS), color=style.SKY, label="draws")
            ax.set_yticks([])
            _mark_interval(ax, estimates.get(x))
        else:
            shown.append(("y", y, 3))
            step = max(1, len(draws[x]) // SHOWN)
            ax.plot(draws[x][::step], draws[y][::step], ".", color=style.SKY, ms=2, alpha=0.5)
            if np.any(diverging):
                wild = draws[x][diverging], draws[y][diverging]
                ax.plot(*wild, ".", color=style.VERMILION, ms=3, label="diverged")
            fitted = [estimates[name].value for name in (x, y) if name in estimates]
            if len(fitted) == 2 and None not in fitted:
                ax.plot(*fitted, "+", color=style.BLACK, markersize=9, label="fit")
        for which, name, ticks in shown:
            is_log = style.spans_decades(ends[name])
            ax.set(**{f"{which}scale": "log" if is_log else "linear", f"{which}lim": ends[name]})
            axis = getattr(ax, f"{which}axis")
            axis.set_minor_formatter(NullFormatter())  # else they take the room of the panels
            if not is_log:
                axis.set_major_locator(MaxNLocator(ticks))
                axis.set_major_formatter("{x:.4g}")
        ax.tick_params(labelleft=column == 0 < row, labelsize=letters)
        ax.tick_params("x", which="both", labelrotation=90 * is_crowded)
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
    label, top = f"fitted, {100 * line.confidence:g} % intervals", 0.0
    for material in line.materials:
        place, error = (material.yield_ratio, material.chi), reach * (material.chi_error or 0.0)
        ax.errorbar(*place, error, fmt="o", color=style.BLUE, capsize=3, label=label)
        text, top = style.plain(style.shortened(material.name)), max(top, material.chi + error)
        # beyond its interval, on the side that is away from the line
        side = 1 if material.chi >= line.c1.value + line.c2.value * material.yield_ratio else -1
        end, va = max(material.chi + side * error, 0.0), "bottom" if side > 0 else "top"
        offset: Any = {"textcoords": "offset points", "ha": "center", "va": va, "zorder": 3}
        ax.annotate(text, (material.yield_ratio, end), (0, 6 * side), **offset)
    if contact is not None:
        new, chi = float(np.asarray(contact.yield_ratio)), line.unloading_factor(contact)
        ends, top = [*ends, new], max(top, chi.value)
        up = np.abs(np.array(_interval(chi)) - chi.value)[:, None]
        label = style.plain(name or "the further material") + " (predicted)"
        ax.errorbar(new, chi.value, up, fmt="D", color=style.VERMILION, capsize=3, label=label)
    _plot_line(ax, line, np.linspace(min(ends) / BEYOND, max(ends) * BEYOND, 200), 1.3 * top)
    across, up = "effective modulus over yield strength, $E/Y$", r"unloading factor $\tilde\chi$"
    ax.set(xlabel=across, ylabel=up, ylim=(-0.1 * top, 1.3 * top))
    style.legend_below(figure, [ax], first=("Eq. (18)", "extrapolated"))
    return figure


def _plot_line(ax: Axes, line: Any, ratio: np.ndarray, top: float) -> None:
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
        label = f"{100 * line.confidence:g} %, of a further material"
        label += "\n(wider than the picture)" * bool(np.nanmax(high) > top)
        style.band(ax, ratio, low, high, style.GREY, label=label)


def _interval(estimate: Any) -> tuple[float, float]:
    """Low and high end; the value for an end that is not known."""
    ends = estimate.low, estimate.high
    return tuple(estimate.value if end is None else end for end in ends)  # type: ignore[return-value]
