"""Restitution and other observables over impact velocity: data, fitted curves, residuals."""

from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import softjax as sj
from calibration.errors import DataError
from calibration.fitting.curves import distinct_impacts, of_each_impact, of_impact, yield_velocity
from calibration.fitting.laws import eq_17
from calibration.observables import OBSERVABLES, RESTITUTION
from calibration.options import LAWS
from calibration.plots import style
from calibration.plots.lines import Line
from calibration.rounding import number

MARKERS = "s^vDoP"  # of residuals
FINE = 240  # points of a curve
FEW = 30  # points that are drawn as such
EQ_17 = "Eq. (17)"
FIRST = ("data", "Zhou, fitted", EQ_17)  # in the legend
WIDEST = 0.5  # room for a band above and below its curve, in heights of the curve
LEAST_SPAN = 0.05  # of ε: a curve's height is at least this for that purpose
INVISIBLE = 1e-6  # width of a band that is not drawn: data without scatter
# where a law has no rebound to show; its other flags qualify a value, these say there is none
NO_VALUE = int(
    sj.Status.NO_REBOUND
    | sj.Status.NO_TURNING_POINT
    | sj.Status.ABOVE_LIMIT_VELOCITY
    | sj.Status.INVALID_INPUT
)
FLAGGED = ~(int(sj.Status.ELASTIC) | int(sj.Status.PLAIN))
ROOM = 0.5  # room above and below the data in the close-up of laws, relative to their height
WIDTHS = (3.4, 0.3, 1.2)  # of the first law drawn, how much less of each further one, the least


def curves_figure(
    result: Any,
    lines: Mapping[str, Sequence[Line]] | None = None,
    ratio: bool = False,
    from_rest: bool = False,
    title: str | None = None,
) -> Figure:
    """ε of every data set with Eq. (17), the fit and its bands, and residuals below.

    Args:
        result: a `FitResult`.
        lines: further curves for data sets, by name.
        ratio: over y = v/v_cr instead of v [m/s]; needs a contact.
        from_rest: curves from v = 0 on, over a linear axis, not from the first point on.
        title: above all panels.
    """
    if ratio and any(fit.contact is None for fit in result.materials):
        raise DataError("ratio", ratio, "False where there is no contact")
    height = 4.0 if len(result.materials) <= style.COLUMNS else 3.3
    figure, grid = style.panels(len(result.materials), height, "data sets", (2.6, 1), 0.75)
    for fit, (upper, lower) in zip(result.materials, grid, strict=False):
        more = (lines or {}).get(fit.name, ())
        _plot_observable(result, fit, None, upper, lower, more, ratio, from_rest)
        if not upper.get_subplotspec().is_first_col():
            upper.set_ylabel("")
            lower.set_ylabel("")
    style.legend_below(figure, list(grid.flat), first=FIRST)
    if title:
        style.set_title(figure, ". ".join(filter(None, (title, figure.get_suptitle()))))
    return figure


def observables_figure(result: Any) -> Figure | None:
    """The same of each observable other than ε, with relative residuals; None if none was measured."""
    measured = [(fit, observed) for fit in result.materials for observed in fit.data.observed]
    if not measured:
        return None
    figure, grid = style.panels(len(measured), 4.0, "observables", (2.6, 1), 0.75)
    for (fit, observed), (upper, lower) in zip(measured, grid, strict=False):
        _plot_observable(result, fit, observed, upper, lower)
    style.legend_below(figure, list(grid.flat), first=FIRST)
    return figure


def _plot_observable(
    result: Any,
    fit: Any,
    observed: Any,
    upper: Axes,
    lower: Axes,
    lines: Sequence[Line] = (),
    ratio: bool = False,
    from_rest: bool = False,
) -> None:
    """Data, curves and residuals of one observable; ε for None."""
    data, sizes = fit.data, distinct_impacts(fit)
    name, rows = RESTITUTION, np.arange(len(data.velocity))
    value, error, across = data.restitution, data.uncertainty, data.velocity_uncertainty
    if observed is not None:
        name, rows, across = observed.name, observed.rows, None
        value, error = observed.value, observed.uncertainty
    scale = np.asarray(fit.contact.critical_velocity if ratio else 1.0)
    x = (data.velocity / scale)[rows]
    logarithmic = style.spans_decades(data.velocity[rows]) and not from_rest
    fine = data.velocity if sizes else _fine(data.velocity, logarithmic, from_rest)
    subsets: Sequence[tuple[Any, str | None]] = [(slice(None), None)]
    if 1 < len(sizes) <= len(MARKERS) and not ratio:
        subsets = _plot_sizes(upper, result, fit, sizes, name, rows, logarithmic)
    else:
        _plot_fit(upper, result, fit, name, fine, scale)
        if len(data.groups) <= len(MARKERS):
            several = "one marker for each group" if len(result.materials) > 1 else None
            subsets = [
                (data.group[rows] == group, several or f"group {style.plain(group)}")
                for group in data.groups
            ] or subsets
    for line in lines:
        _plot_line(upper, line, *_sorted(fine / scale, line.value(fine)))
    style.points(upper, x, value, error, None if across is None else across / scale, label="data")
    flagged = np.asarray(fit.status, int)[rows] & FLAGGED != 0
    if np.any(flagged):
        label = "flagged by the law: see the warnings"
        upper.plot(x[flagged], value[flagged], "x", color=style.VERMILION, label=label)
    critical = yield_velocity(fit.law)
    critical = None if critical is None else critical / float(scale)
    style.mark_velocity(upper, critical, x, label="first yield")

    lower.axhline(0.0, color=style.GREY, linewidth=0.8)
    for line in lines:
        if line.residuals:
            left = _sorted(x, value - line.value(data.velocity))
            lower.plot(*left, color=line.color, ls=line.linestyle, lw=1.2)
    fitted = result.band(data.velocity, fit.name, observable=name).coefficient[rows]
    left = value - fitted if observed is None else 100 * (value / fitted - 1)
    part = error if observed is None or error is None else 100 * error / value
    for (which, text), color, marker in zip(subsets, style.SHADES, MARKERS, strict=False):
        up = None if part is None else part[which]
        style.points(lower, x[which], left[which], up, None, color, marker, text)
    lower.ticklabel_format(axis="y", scilimits=(-3, 3))
    lower.margins(y=0.12)  # of whole markers
    for ax in (upper, lower) if logarithmic else ():
        style.logarithmic_x(ax)
    lower.set_xlim(upper.get_xlim())
    upper.tick_params(labelbottom=False)
    upper.set_title(style.plain(fit.name) + " (NOT CONVERGED)" * (not fit.converged))
    lower.set_xlabel(r"$y = v/v_\mathrm{cr}$" if ratio else style.VELOCITY)
    upper.set_ylabel(style.EPSILON)
    lower.set_ylabel("data − fit" if observed is None else "data/fit − 1 [%]")
    if observed is not None:
        unit = style.in_prefixed_unit(upper, OBSERVABLES[name].unit, value)
        upper.set_ylabel(f"{name.replace('_', ' ')} [{unit}]")


def _plot_fit(ax: Axes, result: Any, fit: Any, name: str, velocity: np.ndarray, scale) -> None:
    """Eq. (17), the fitted law, and its bands where they can be seen."""
    band = result.band(velocity, fit.name, observable=name)
    if name == RESTITUTION and fit.empirical is not None and fit.model.key != "eq-17":
        x, empirical = _sorted(velocity / scale, eq_17(velocity, **fit.empirical))
        ax.plot(x, empirical, "--", color=style.ORANGE, zorder=4, label=EQ_17)
    x, value = _sorted(velocity / scale, band.coefficient)
    ax.plot(x, value, color=style.BLUE, linewidth=1.8, label=f"{fit.model.label}, fitted")
    reach = (band.high - band.low) / (1.0 if name == RESTITUTION else np.abs(band.coefficient))
    if not np.nanmax(reach, initial=0.0) > INVISIBLE:
        return
    share = f"{100 * result.confidence:g} %"
    wide = result.band(velocity, fit.name, kind="prediction", observable=name)
    for limits, alpha, what in ((wide, 0.1, "one more measurement"), (band, 0.3, "of the mean")):
        x, low, high = _sorted(velocity / scale, limits.low, limits.high)
        style.band(ax, x, low, high, alpha=alpha, label=f"{share}, {what}")


def _plot_sizes(
    ax: Axes, result: Any, fit: Any, sizes: Sequence[int], name: str, rows: Any, logarithmic: bool
) -> list[tuple[Any, str | None]]:
    """A curve with its band for each size; which of the rows are of that size."""
    for impact, color, dashes in zip(sizes, style.SHADES, style.DASHES, strict=False):
        of_size = of_impact(fit, impact)
        fine = _fine(of_size.data.velocity, logarithmic, False)
        band = result.band(fine, fit.name, observable=name, impact=impact)
        label = None
        if of_size.data.contact is not None:
            label = f"R = {number(1e3 * float(of_size.data.contact.radius), 3)} mm"
        ax.plot(fine, band.coefficient, label=label, color=color, ls=dashes, lw=1.5)
        style.band(ax, fine, band.low, band.high, color)
        style.mark_velocity(ax, yield_velocity(of_size.law), fine, color=color)
    style.band(ax, [], [], [], style.GREY, label=f"{100 * result.confidence:g} %, of the mean")
    radius = np.asarray(1.0 if fit.data.contact is None else fit.data.contact.radius)
    if not radius.ndim:
        return [(slice(None), None)]
    nearest = np.argmin(np.abs(np.log(radius[rows, None] / radius[sizes])), axis=1)
    return [(nearest == k, None) for k in range(len(sizes))]


def _plot_line(ax: Axes, line: Line, x: np.ndarray, value: np.ndarray) -> None:
    """A further curve, with a cross where it ends."""
    ax.plot(x, value, label=line.label, color=line.color, ls=line.linestyle, lw=1.4, zorder=1.5)
    last = np.flatnonzero(np.isfinite(value))[-1:]
    if last.size and last[0] < len(x) - 1:
        ax.plot(x[last], value[last], "X", color=line.color, ms=8, label="no solution beyond")


def _sorted(x: np.ndarray, *columns: np.ndarray) -> list[np.ndarray]:
    order = np.argsort(x, kind="stable")
    return [column[order] for column in (x, *columns)]


def _fine(velocity: np.ndarray, logarithmic: bool, from_rest: bool) -> np.ndarray:
    """Velocities of a curve, closer together where it is steep."""
    low, high = float(np.min(velocity)), float(np.max(velocity))
    if logarithmic:
        return np.geomspace(low, high, FINE)
    low = 0.0 if from_rest else low
    return low + (high - low) * np.linspace(0.0, 1.0, FINE) ** 2


def restitution_figure(
    rows: Any,
    label: str,
    yields_at: float | None = None,
    data: Any = None,
    confidence: float | None = None,
) -> Figure:
    """ε over v; gaps where the law has no rebound; grey where a fit does not determine it.

    `rows` is an ascending curve, `confidence` that of its band, if any; `yields_at` [m/s] is marked.
    """
    figure = style.new_figure(4.2)
    ax, v = figure.add_subplot(), rows.velocity
    limits = None
    if confidence is not None:
        limits = _limits(rows)
        share = f"{100 * confidence:g} %, of the mean"
        if limits is not None:
            lowest, highest = (
                number(float(x), 3) for x in (np.nanmin(rows.low), np.nanmax(rows.high))
            )
            share += f"\n(wider than the picture: {lowest} to {highest})"
        style.band(ax, v, rows.low, rows.high, label=share)
        known = v[np.isfinite(rows.coefficient)]
        for ends in ((v[0], known[0]), (known[-1], v[-1])):
            if ends[0] < ends[1]:
                ax.axvspan(*ends, label="not determined", color=style.GREY, alpha=0.15, lw=0)
    if data is not None:
        errors = data.uncertainty, data.velocity_uncertainty
        style.points(ax, data.velocity, data.restitution, *errors, label="data")
    value = np.where(rows.status.astype(int) & NO_VALUE != 0, np.nan, rows.coefficient)
    marker = "o" if len(v) < FEW else ""
    ax.plot(v, value, label=style.plain(label), color=style.BLUE, marker=marker, ms=4)
    style.mark_velocity(ax, yields_at, v, label="first yield")
    ax.set(xlabel=style.VELOCITY, ylabel=style.EPSILON)
    if style.spans_decades(v):
        style.logarithmic_x(ax)
    if limits is not None:
        ax.set_ylim(*limits)
    ax.legend(frameon=False)
    return figure


def _limits(rows: Any) -> tuple[float, float] | None:
    """Limits of the y axis if the band is so wide that the curve could not be read, else None."""
    low, high = np.nanmin(rows.coefficient), np.nanmax(rows.coefficient)
    room = WIDEST * max(high - low, LEAST_SPAN)
    below, above = np.nanmin(rows.low), np.nanmax(rows.high)
    if low - room <= below and above <= high + room:
        return None
    return max(below, low - room), min(above, high + room)


def comparison_figure(comparisons: Sequence[Any]) -> Figure:
    """Draw for each `Comparison` the curves of all laws, and below a close-up of the data."""
    same = _same_curves(comparisons)
    entries = [entry for comparison in comparisons for entry in comparison.entries]
    entries.sort(key=lambda entry: (*LAWS, entry.key).index(entry.key))  # Zhou's law is solid
    labels = dict.fromkeys(entry.label for entry in entries)
    pairs = zip(cycle(style.SHADES), cycle(style.DASHES), strict=False)
    looks = dict(zip(labels, pairs, strict=False))
    figure, grid = style.panels(len(comparisons), 5.4, "data sets", (1, 1), 1.1)
    for (upper, lower), comparison in zip(grid, comparisons, strict=False):
        data = comparison.data
        curves = [(e, *_curve(e)) for e in comparison.entries if e.label not in same]
        for ax in (upper, lower):
            _plot_laws(ax, curves, looks, same)
            errors = data.uncertainty, data.velocity_uncertainty
            style.points(ax, data.velocity, data.restitution, *errors, label="data")
            if style.spans_decades(data.velocity):
                style.logarithmic_x(ax)
        low, high = np.min(data.restitution), np.max(data.restitution)
        room = ROOM * max(high - low, 0.02)
        lower.set(ylim=(low - room, high + room), xlabel=style.VELOCITY)
        low, high = upper.get_ylim()
        upper.set(ylim=(min(0.0, low), 1.04 * high), title=style.plain(data.name))
        if upper.get_subplotspec().is_first_col():
            upper.set_ylabel(style.EPSILON)
            lower.set_ylabel(f"{style.EPSILON}, enlarged")
    order = ["data", *(_label(label, same) for label in comparisons[0].ranking)]
    style.legend_below(figure, list(grid[:, 0]), first=order)
    return figure


def _plot_laws(ax: Axes, curves: Sequence[Any], looks: Mapping[str, Any], same: Any) -> None:
    """Curves of laws, each thinner than those below it; solid ones below dashed ones, which may coincide."""
    for entry, *curve in sorted(curves, key=lambda drawn: looks[drawn[0].label][1] != "-"):
        width = max(WIDTHS[0] - WIDTHS[1] * len(ax.lines), WIDTHS[2])
        color, dashes = looks[entry.label]
        ax.plot(*curve, label=_label(entry.label, same), color=color, ls=dashes, lw=width)


def _same_curves(comparisons: Sequence[Any]) -> dict[str, str]:
    """Laws that have the curve of another law in every comparison, mapped to that law."""
    equal = [{e.label: e.same_as for e in table.entries if e.same_as} for table in comparisons]
    pairs = equal[0].items()
    return {law: other for law, other in pairs if all(table.get(law) == other for table in equal)}


def _label(label: str, same: Mapping[str, str]) -> str:
    """Name of a law, and below it the names of laws with the same curve."""
    below = [other for other, drawn in same.items() if drawn == label]
    return "\n= ".join(style.plain(name) for name in (label, *below))


def _curve(entry: Any) -> tuple[np.ndarray, np.ndarray]:
    """Velocities and ε, NaN where not determined or 0; at the impacts alone where bodies differ."""
    fit = entry.result.material()
    velocity = fit.data.velocity
    if not of_each_impact(fit):
        spaced = np.geomspace if style.spans_decades(velocity) else np.linspace
        velocity = spaced(np.min(velocity), np.max(velocity), FINE)
    velocity, value = _sorted(velocity, entry.result.band(velocity).coefficient)
    return velocity, np.where(value > 0, value, np.nan)
