"""Restitution and other observables over impact velocity: data, fitted curves, residuals."""

from collections.abc import Mapping, Sequence
from functools import partial
from itertools import cycle
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, NullFormatter

import softjax as sj
from calibration.data import RestitutionData
from calibration.errors import DataError
from calibration.fitting.curves import distinct_impacts, of_impact, yield_velocity
from calibration.fitting.laws import eq_17
from calibration.fitting.request import blocks_of
from calibration.observables import OBSERVABLES, RESTITUTION
from calibration.options import LAWS
from calibration.plots import style
from calibration.plots.lines import Line, lines_of
from calibration.rounding import number

MARKERS = "s^vDoP"  # of residuals
FINE = 240  # points of a curve
OUTLIER = "not explained by the noise"
ROOM_OF_ARROWS = 0.2  # at the edges, in heights of the rest
FEW = 30  # points that are drawn as such
EQ_17 = "Eq. (17)"
FIRST = ("data", "Zhou, fitted", EQ_17)  # in the legend
WIDEST = 0.5  # room for a band above and below its curve, in heights of the curve
LEAST_SPAN = 0.05  # of ε: a curve's height is at least this for that purpose
INVISIBLE = 1e-6  # width of a band that is not drawn: data without scatter
ROOM = 0.5  # room above and below the data in the close-up of laws, relative to their height
WIDTHS = (3.4, 0.3, 1.2)  # of the first law drawn, how much less of each further one, the least


def plot(
    result: Any,
    ax: Axes | Sequence[Axes] | None = None,
    figsize: tuple[float, float] | None = None,
    log: bool = False,
    laws: Mapping[str, sj.ContactLaw] | None = None,
    points: RestitutionData | bool | None = None,
) -> Any:
    """Data, fitted curves with their bands, and residuals below: `FitResult.plot`."""
    own = None
    if ax is not None:
        own = np.ravel(np.asarray(ax, dtype=object)).tolist()
        if len(result.materials) > 1 or len(own) > 2 or figsize is not None:
            accepted = "one for ε, or two with the residuals; of one data set, without figsize"
            raise DataError("ax", f"{len(own)} axes", accepted)
    shades = cycle((style.GREEN, style.PURPLE, style.SKY, style.BLACK))
    more = [
        Line(label, partial(_of_law, law), color, "--")
        for (label, law), color in zip((laws or {}).items(), shades, strict=False)
    ]
    shown = [(fit, None, [*lines_of(result)[fit.name], *more]) for fit in result.materials]
    if own is None:
        height = 4.0 if len(result.materials) <= style.COLUMNS else 3.3
        _, grid = _figure(result, shown, height, "data sets", log=log, size=figsize, points=points)
        return grid[0] if len(grid) == 1 else grid
    pair = [*own, style.new_figure(1.0).add_subplot()][:2]  # an axis that is not shown
    logarithmic = log or style.spans_decades(result.materials[0].data.velocity)
    _plot_observable(result, *shown[0][:2], pair, shown[0][2], False, False, logarithmic, points)
    if len(own) == 1:
        pair[0].tick_params(labelbottom=True)
        pair[0].set_xlabel(style.VELOCITY)
    pair[0].legend(frameon=False, fontsize="small")
    return ax


def _of_law(law: sj.ContactLaw, velocity: np.ndarray) -> np.ndarray:
    """ε of a law; NaN where nothing rebounds."""
    hit = sj.restitution(law, velocity)
    return np.where(sj.Status.has_rebound(np.asarray(hit.status)), hit.coefficient, np.nan)


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
    shown = [(fit, None, (lines or {}).get(fit.name, ())) for fit in result.materials]
    figure, _ = _figure(result, shown, height, "data sets", ratio, from_rest)
    for ax in figure.axes:
        if not ax.get_subplotspec().is_first_col():  # type: ignore[union-attr]
            ax.set_ylabel("")
    if title:
        style.set_title(figure, ". ".join(filter(None, (title, figure.get_suptitle()))))
    return figure


def observables_figure(result: Any) -> Figure | None:
    """Draw each observable other than ε, with relative residuals; None if none was measured."""
    shown = [(fit, observed, ()) for fit in result.materials for observed in fit.data.observed]
    return _figure(result, shown, 4.0, "observables")[0] if shown else None


def _figure(
    result: Any,
    shown: list[Any],
    height: float,
    what: str,
    ratio=False,
    from_rest=False,
    log: bool = False,
    size: tuple[float, float] | None = None,
    points: RestitutionData | bool | None = None,
) -> tuple[Figure, Any]:
    figure, grid = style.panels(len(shown), height, what, (2.6, 1), 0.75, size)
    measured = [f.data.velocity[slice(None) if o is None else o.rows] for f, o, _ in shown]
    wide = log or (not from_rest and any(map(style.spans_decades, measured)))
    logarithmic = wide and min(map(np.min, measured)) > 0  # one kind of axis for all
    for (fit, observed, lines), axes in zip(shown, grid, strict=False):
        _plot_observable(result, fit, observed, axes, lines, ratio, from_rest, logarithmic, points)
    style.legend_below(figure, list(grid.flat), first=FIRST)
    return figure, grid


def _plot_observable(
    result: Any,
    fit: Any,
    observed: Any,
    axes: Sequence[Axes],
    lines: Sequence[Line],
    ratio: bool,
    from_rest: bool,
    logarithmic: bool,
    points: RestitutionData | bool | None = None,
) -> None:
    """Data, curves and residuals of one observable; ε for None."""
    (upper, lower), data, sizes = axes, fit.data, distinct_impacts(fit)
    name, rows = RESTITUTION, np.arange(len(data.velocity))
    value, error, across = data.restitution, data.uncertainty, data.velocity_uncertainty
    if observed is not None:
        name, rows, across = observed.name, observed.rows, None
        value, error = observed.value, observed.uncertainty
    scale = float(fit.contact.critical_velocity) if ratio else 1.0
    x = data.velocity[rows] / scale
    fine = data.velocity if sizes else _fine(data.velocity, logarithmic, from_rest)
    subsets: Sequence[tuple[Any, str | None]] = [(slice(None), None)]
    if 1 < len(sizes) <= len(MARKERS) and not ratio:
        subsets = _plot_sizes(upper, result, fit, sizes, name, rows, logarithmic)
    else:
        _plot_fit(upper, result, fit, name, fine, scale)
        if 0 < len(data.groups) <= len(MARKERS):
            several = "one marker for each group" if len(result.materials) > 1 else None
            names = {group: several or f"group {style.plain(group)}" for group in data.groups}
            subsets = [(data.group[rows] == group, text) for group, text in names.items()]
    for line in lines:
        _plot_line(upper, line, *_sorted(fine / scale, line.value(fine)))
    if lines:  # the picture is of the data: curves that are far from them leave it
        seen = np.concatenate([value, result.band(fine, fit.name, observable=name).coefficient])
        low, high = np.nanmin(seen), np.nanmax(seen)
        upper.set_ylim(low - 0.08 * (high - low), high + 0.08 * (high - low))
    if points is not False:
        style.points(
            upper, x, value, error, None if across is None else across / scale, label="data"
        )
    if isinstance(points, RestitutionData):
        errors = points.uncertainty, points.velocity_uncertainty
        look = {"color": style.VERMILION, "marker": "s", "label": style.plain(points.name)}
        style.points(upper, points.velocity / scale, points.restitution, *errors, **look)
    status = np.zeros(len(data), int)
    status[next(blocks_of(data))[2]] = fit.status
    flagged = ~sj.Status.is_ok(status[rows])
    if np.any(flagged):
        label = "flagged by the law: see the warnings"
        upper.plot(x[flagged], value[flagged], "x", color=style.VERMILION, label=label)
    critical = yield_velocity(fit.law)
    style.mark_velocity(upper, critical and critical / scale, x, label="first yield")

    lower.axhline(0.0, color=style.GREY, linewidth=0.8)
    for line in (line for line in lines if line.residuals):
        left = _sorted(x, value - line.value(data.velocity))
        lower.plot(*left, color=line.color, ls=line.linestyle, lw=1.2)
    fitted = result.band(data.velocity, fit.name, observable=name).coefficient[rows]
    left, part = value - fitted, error
    if observed is not None:
        left, part = 100 * (value / fitted - 1), None if error is None else 100 * error / value
    for (which, text), color, marker in zip(subsets, style.SHADES, MARKERS, strict=False):
        up = None if part is None else part[which]
        style.points(lower, x[which], left[which], up, None, color, marker, text)
    lower.ticklabel_format(axis="y", scilimits=(-3, 3))
    lower.margins(y=0.12)  # of whole markers
    far = np.isin(
        rows + 1, [o.row for o in fit.outliers if o.observable == name and o.robust is not False]
    )
    others = np.append(value[~far], fitted)
    ends = np.array([np.nanmin(others), np.nanmax(others)])
    room = WIDEST * max(np.ptp(ends), LEAST_SPAN * ends[1])
    beyond = far & ((value < ends[0] - room) | (value > ends[1] + room))
    beyond &= observed is None or not style.spans_decades(value)
    _mark_outliers(upper, x, value, far & ~beyond, beyond, fitted)
    _mark_outliers(lower, x, left, far & ~beyond, beyond, 0.0)
    for ax in (upper, lower) if logarithmic else ():
        style.logarithmic_x(ax)
    lower.set_xlim(upper.get_xlim())
    upper.tick_params(labelbottom=False)
    upper.set_title(style.plain(fit.name) + " (NOT CONVERGED)" * (not fit.converged))
    upper.set_ylabel(style.EPSILON)
    lower.set_xlabel(r"$y = v/v_\mathrm{cr}$" if ratio else style.VELOCITY)
    lower.set_ylabel("data − fit" if observed is None else "data/fit − 1 [%]")
    if observed is not None:
        upper.set_ylabel(name.replace("_", " "))
        if style.spans_decades(value):
            upper.set_yscale("log")
            upper.yaxis.set_minor_formatter(NullFormatter())
        upper.yaxis.set_major_formatter(EngFormatter(OBSERVABLES[name].unit))


def _mark_outliers(ax: Axes, x, value, inside, beyond, curve: Any) -> None:
    """Outliers inside the picture have a ring; those that would flatten the others are arrows at its edge."""
    look: dict[str, Any] = {"color": style.VERMILION, "linestyle": "none"}
    if np.any(inside):
        ax.plot(x[inside], value[inside], "o", ms=8, mfc="none", label=OUTLIER, **look)
    if np.any(beyond):
        others = np.append(value[~beyond], curve)
        low, high = np.nanmin(others), np.nanmax(others)
        room = ROOM_OF_ARROWS * (high - low)
        ax.set_ylim(low - room, high + room)
        for which, edge, marker in (
            (beyond & (value < low), low - room / 2, "v"),
            (beyond & (value > high), high + room / 2, "^"),
        ):
            if np.any(which):
                label = f"{OUTLIER}, beyond the picture"
                ax.plot(x[which], edge + 0 * x[which], marker, label=label, **look)


def _plot_fit(ax: Axes, result: Any, fit: Any, name: str, velocity: np.ndarray, scale) -> None:
    """Eq. (17), the fitted law, and its bands where they can be seen."""
    band = result.band(velocity, fit.name, observable=name)
    if name == RESTITUTION and fit.empirical is not None and fit.model.key != "eq-17":
        x, empirical = _sorted(velocity / scale, eq_17(velocity, **fit.empirical))
        ax.plot(x, empirical, "--", color=style.ORANGE, zorder=4, label=EQ_17)
    x, value = _sorted(velocity / scale, band.coefficient)
    ax.plot(x, value, color=style.BLUE, linewidth=1.8, label=f"{fit.model.label}, fitted")
    scale = np.abs(band.coefficient) if OBSERVABLES[name].is_relative else 1.0
    reach = (band.high - band.low) / scale
    if np.nanmax(reach, initial=0.0) > INVISIBLE:
        wide = [("prediction", 0.1, "one more measurement")] * (name in fit.measured)
        for kind, alpha, what in (*wide, ("mean", 0.3, "of the mean")):
            limits = result.band(velocity, fit.name, kind=kind, observable=name)
            x, low, high = _sorted(velocity / scale, limits.low, limits.high)
            label = f"{100 * result.confidence:g} %, {what}"
            style.band(ax, x, low, high, alpha=alpha, label=label)


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
    of: str = "of the mean",
) -> Figure:
    """ε over v; gaps where the law has no rebound; grey where a fit does not determine it.

    `rows` is an ascending curve, `confidence` that of its band, if any, and `of` what that is of;
    `yields_at` [m/s] is marked.
    """
    ax, v = style.new_figure(4.2).add_subplot(), rows.velocity
    if confidence is not None:
        if np.any(np.isfinite(rows.low)):
            low, high = np.nanmin(rows.coefficient), np.nanmax(rows.coefficient)
            below, above = np.nanmin(rows.low), np.nanmax(rows.high)
            room, share = WIDEST * max(high - low, LEAST_SPAN), f"{100 * confidence:g} %, {of}"
            if below < low - room or high + room < above:  # the curve could not be read
                ax.set_ylim(max(below, low - room), min(above, high + room))
                share += f"\n(wider than the picture: {number(below, 3)} to {number(above, 3)})"
            style.band(ax, v, rows.low, rows.high, label=share)
        known = v[np.isfinite(rows.coefficient)]
        for ends in ((v[0], known[0]), (known[-1], v[-1])):
            if ends[0] < ends[1]:
                ax.axvspan(*ends, label="not determined", color=style.GREY, alpha=0.15, lw=0)
    if data is not None:
        errors = data.uncertainty, data.velocity_uncertainty
        style.points(ax, data.velocity, data.restitution, *errors, label="data")
    value = np.where(sj.Status.has_rebound(rows.status.astype(int)), rows.coefficient, np.nan)
    marker = "o" if len(v) < FEW else ""
    ax.plot(v, value, label=style.plain(label), color=style.BLUE, marker=marker, ms=4)
    style.mark_velocity(ax, yields_at, v, label="first yield")
    ax.set(xlabel=style.VELOCITY, ylabel=style.EPSILON)
    if style.spans_decades(v):
        style.logarithmic_x(ax)
    ax.legend(frameon=False)
    return ax.figure  # type: ignore[return-value]


def comparison_figure(comparisons: Sequence[Any]) -> Figure:
    """Draw for each `Comparison` the curves of all laws, and below a close-up of the data.

    Laws with one curve in every comparison share a line.
    """
    equal = [{e.label: e.same_as for e in table.entries if e.same_as} for table in comparisons]
    same = {law: of for law, of in equal[0].items() if all(t.get(law) == of for t in equal)}
    entries = [entry for comparison in comparisons for entry in comparison.entries]
    entries.sort(key=lambda entry: (*LAWS, entry.key).index(entry.key))  # Zhou's law is solid
    labels, looks = dict.fromkeys(e.label for e in entries if e.label not in same), {}
    for label, color, dashes in zip(labels, cycle(style.SHADES), cycle(style.DASHES), strict=False):
        names = [label, *(law for law, of in same.items() if of == label)]
        text = "\n= ".join(map(style.plain, names))
        looks[label] = {"label": text, "color": color, "ls": dashes}
    figure, grid = style.panels(len(comparisons), 5.4, "data sets", (1, 1), 1.1)
    for axes, comparison in zip(grid, comparisons, strict=False):
        data, curves = comparison.data, {e.label: _curve(e) for e in comparison.entries}
        drawn = [label for label in curves if label in looks]
        drawn.sort(key=lambda label: looks[label]["ls"] != "-")  # dashes above solid lines
        for ax in axes:
            for k, label in enumerate(drawn):  # a curve on top of an equal one leaves its edges
                width = max(WIDTHS[0] - WIDTHS[1] * k, WIDTHS[2])
                ax.plot(*curves[label], lw=width, **looks[label])
            errors = data.uncertainty, data.velocity_uncertainty
            style.points(ax, data.velocity, data.restitution, *errors, label="data")
            if style.spans_decades(data.velocity):
                style.logarithmic_x(ax)
        upper, lower = axes
        shown = data.restitution
        if np.all(np.isnan(shown)):
            shown = np.concatenate([value for _, value in curves.values()])
        low, high = np.nanmin(shown), np.nanmax(shown)
        room = ROOM * max(high - low, 0.02)
        lower.set(ylim=(low - room, high + room), xlabel=style.VELOCITY)
        low, high = upper.get_ylim()
        upper.set(ylim=(min(0.0, low), 1.04 * high), title=style.plain(data.name))
        if upper.get_subplotspec().is_first_col():
            upper.set_ylabel(style.EPSILON)
            lower.set_ylabel(f"{style.EPSILON}, enlarged")
    ranked = [looks[label]["label"] for label in comparisons[0].ranking if label in looks]
    style.legend_below(figure, list(grid[:, 0]), first=["data", *ranked])
    return figure


def _curve(entry: Any) -> tuple[np.ndarray, np.ndarray]:
    """Velocities and ε, NaN where not determined or 0; at the impacts alone where bodies differ."""
    fit = entry.result.material()
    velocity = fit.data.velocity
    if not distinct_impacts(fit):
        spaced = np.geomspace if style.spans_decades(velocity) else np.linspace
        velocity = spaced(np.min(velocity), np.max(velocity), FINE)
    velocity, value = _sorted(velocity, entry.result.band(velocity).coefficient)
    return velocity, np.where(value > 0, value, np.nan)
