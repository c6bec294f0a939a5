"""Restitution over impact velocity: data, fitted curves and residuals."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import softjax as sj
from calibration.data import RestitutionData
from calibration.errors import DataError
from calibration.fitting.curves import (
    as_empirical,
    curve_and_slopes,
    distinct_impacts,
    of_impact,
    yield_velocity,
)
from calibration.observables import RESTITUTION
from calibration.plots import style
from calibration.plots.lines import NO_VALUE, Line
from calibration.rounding import number

SHADES = (style.BLUE, style.VERMILION, style.GREEN, style.PURPLE, style.ORANGE, style.SKY)
DASHES = ("-", "--", "-.", ":", (0, (5, 1)), (0, (1, 1)))  # of these: curves may coincide
FINE = 240  # points of a curve
FEW = 30  # points that are drawn as such
EQ_17 = "Eq. (17)"
FITTED = "{}, fitted"
ORDER = ("data", FITTED.format("Zhou"), EQ_17)  # in a legend
WIDEST = 0.5  # room for a band above and below its curve, in heights of the curve
LEAST_SPAN = 0.05  # of ε: a curve's height is at least this for that purpose
INVISIBLE = 1e-6  # width of a band that is not drawn: data without scatter
FLAGGED = ~(int(sj.Status.ELASTIC) | int(sj.Status.PLAIN))
EPSILON = r"restitution $\varepsilon$"


def curves_figure(
    result: Any,
    lines: Mapping[str, Sequence[Line]] | None = None,
    ratio: bool = False,
    from_rest: bool = False,
    title: str | None = None,
) -> Figure:
    """Every data set with its fit, and the residuals below each.

    Args:
        result: a `FitResult`.
        lines: further curves for data sets, by name.
        ratio, from_rest: as `plot_curve` takes them.
        title: above all panels.
    """
    count = len(result.materials)
    figure, grid = style.panels(count, (4.2, 4.4), "data sets", (2.6, 1), 0.75)
    for fit, (upper, lower) in zip(result.materials, grid, strict=False):
        more = (lines or {}).get(fit.name, ())
        plot_curve(result, fit.name, upper, more, ratio, from_rest)
        plot_residuals(result, fit.name, lower, more, ratio)
        if upper.get_xscale() == "log":
            style.logarithmic_x(lower)
        lower.set_xlim(upper.get_xlim())
        upper.tick_params(labelbottom=False)
        mark = "" if fit.converged else " (NOT CONVERGED)"
        upper.set(xlabel="", title=f"{style.plain(fit.name)}{mark}")
        if not upper.get_subplotspec().is_first_col():
            upper.set_ylabel("")
            lower.set_ylabel("")
    columns = upper.get_subplotspec().get_gridspec().ncols
    style.legend_below(figure, list(grid[:, 0]), 4 if columns > 2 else 2, ORDER)
    if title:
        figure.suptitle(". ".join(filter(None, (title, figure.get_suptitle()))), fontsize="medium")
    return figure


def plot_curve(
    result: Any,
    name: str | None = None,
    ax: Axes | None = None,
    lines: Sequence[Line] = (),
    ratio: bool = False,
    from_rest: bool = False,
) -> Axes:
    """Data with error bars, Eq. (17), the fit with its bands, and `lines`.

    Args:
        result: a `FitResult`.
        name: which data set; the only one where there is one.
        ax: where to draw; a new figure's where None.
        lines: further curves.
        ratio: over y = v/v_cr instead of v [m/s]; needs a contact.
        from_rest: curves from v = 0 on, over a linear axis, not from the first point on.
    """
    ax = style.axes_or_new(ax)
    fit = result.material(name)
    data, scale = fit.data, _scale(fit, ratio)
    logarithmic = style.spans_decades(data.velocity) and not from_rest
    sizes = distinct_impacts(fit)
    velocity = data.velocity if sizes else _fine(data, logarithmic, from_rest)
    if 1 < len(sizes) <= len(SHADES) and not ratio:
        for impact, color in zip(sizes, SHADES, strict=False):
            plot_size(ax, result, fit, impact, color, RESTITUTION, logarithmic)
        share = f"{100 * result.confidence:g} %, of the mean"
        ax.fill_between([], [], [], color=style.GREY, alpha=0.25, linewidth=0, label=share)
    else:
        _plot_fit(ax, result, fit, velocity, scale)
    for line in lines:
        x, value = _sorted(velocity / scale, line.value(velocity))
        look: dict[str, Any] = {"color": line.color, "linestyle": line.linestyle, "linewidth": 1.4}
        ax.plot(x, value, label=line.label, zorder=1.5, **look)
        last = np.flatnonzero(np.isfinite(value))[-1:]
        if last.size and last[0] < len(x) - 1:
            look = {"color": line.color, "marker": "X", "markersize": 8, "linestyle": "none"}
            ax.plot(x[last], value[last], label="no solution beyond", **look)
    plot_data(ax, data, scale)
    flagged = np.flatnonzero(np.asarray(fit.status, int) & FLAGGED)
    if len(flagged):
        label = "flagged by the law: see the warnings"
        look = {"linestyle": "none", "marker": "x", "color": style.VERMILION}
        ax.plot((data.velocity / scale)[flagged], data.restitution[flagged], label=label, **look)
    critical = yield_velocity(fit.law)
    yields = None if critical is None else critical / float(scale)
    style.mark_velocity(ax, yields, data.velocity / scale, "first yield")
    if logarithmic:
        style.logarithmic_x(ax)
    ax.set(xlabel=velocity_label(ratio), ylabel=EPSILON)
    return ax


def plot_residuals(
    result: Any,
    name: str | None = None,
    ax: Axes | None = None,
    lines: Sequence[Line] = (),
    ratio: bool = False,
) -> Axes:
    """Measured less fitted ε at each point; arguments as `plot_curve`'s. Its x axis is linear."""
    ax = style.axes_or_new(ax, height=2.0)
    fit = result.material(name)
    data, x = fit.data, fit.data.velocity / _scale(fit, ratio)
    ax.axhline(0.0, color=style.GREY, linewidth=0.8)
    for line in lines:
        if line.residuals:
            left = _sorted(x, data.restitution - line.value(data.velocity))
            ax.plot(*left, color=line.color, linestyle=line.linestyle, linewidth=1.2)
    left = data.restitution - result.band(data.velocity, fit.name).coefficient
    sizes = [] if ratio else distinct_impacts(fit)
    for color, rows in by_size(fit, np.arange(len(x)), sizes):
        error = None if data.uncertainty is None else data.uncertainty[rows]
        ax.errorbar(x[rows], left[rows], yerr=error, **_marks(color, "s"))
    ax.set(xlabel=velocity_label(ratio), ylabel="data − fit")
    ax.ticklabel_format(axis="y", scilimits=(-3, 3))
    return ax


def plot_restitution(
    rows: Any,
    label: str,
    ax: Axes | None = None,
    yields_at: float | None = None,
    fit: Any = None,
    confidence: float | None = None,
) -> Axes:
    """ε over v; gaps where the law has no rebound; grey where a fit does not determine it.

    Args:
        rows: a curve, `calibration.curves.Rows` by ascending velocity.
        label: what it is a curve of.
        ax: where to draw; a new figure's where None.
        yields_at: a velocity [m/s], marked where it lies inside.
        fit: `MaterialFit` that it is of, whose data are drawn; None for none.
        confidence: of the band that `rows` has; None for none.
    """
    ax = style.axes_or_new(ax, 6.0, 4.0)
    v = rows.velocity
    limits = None
    if confidence is not None:
        limits = _limits(rows)
        band: dict[str, Any] = {"color": style.BLUE, "alpha": 0.25, "linewidth": 0}
        share = f"{100 * confidence:g} %, of the mean"
        if limits is not None:
            least = number(float(np.nanmin(rows.low)), 3)
            most = number(float(np.nanmax(rows.high)), 3)
            share += f"\n(wider than the picture: {least} to {most})"
        ax.fill_between(v, rows.low, rows.high, label=share, **band)
        known = np.flatnonzero(np.isfinite(rows.coefficient))
        look: dict[str, Any] = {"color": style.GREY, "alpha": 0.15, "linewidth": 0}
        for ends in ((v[0], v[known[0]]), (v[known[-1]], v[-1])):
            if ends[0] < ends[1]:
                ax.axvspan(*ends, label="not determined", **look)
    if fit is not None:
        plot_data(ax, fit.data)
    none = rows.status.astype(int) & int(NO_VALUE) != 0
    look = {"color": style.BLUE, "marker": "o" if len(v) < FEW else "", "markersize": 4}
    ax.plot(v, np.where(none, np.nan, rows.coefficient), label=style.plain(label), **look)
    style.mark_velocity(ax, yields_at, v, "first yield")
    ax.set(xlabel=velocity_label(), ylabel=EPSILON)
    if style.spans_decades(v):
        style.logarithmic_x(ax)
    if limits is not None:
        ax.set_ylim(*limits)
    ax.legend(frameon=False)
    return ax


def _limits(rows: Any) -> tuple[float, float] | None:
    """Limits of the y axis if the band is so wide that the curve could not be read, else None."""
    low, high = np.nanmin(rows.coefficient), np.nanmax(rows.coefficient)
    room = WIDEST * max(high - low, LEAST_SPAN)
    below, above = np.nanmin(rows.low), np.nanmax(rows.high)
    if not (below < low - room or above > high + room):
        return None
    return max(below, low - room), min(above, high + room)


def plot_data(ax: Axes, data: RestitutionData, scale: np.ndarray | float = 1.0) -> None:
    """Measured ε with its error bars over v/scale."""
    across = None if data.velocity_uncertainty is None else data.velocity_uncertainty / scale
    errors: dict[str, Any] = {"yerr": data.uncertainty, "xerr": across}
    look = _marks(style.BLACK, "o")
    ax.errorbar(data.velocity / scale, data.restitution, label="data", **errors, **look)


def plot_size(
    ax: Axes, result: Any, fit: Any, impact: int, color: str, observable: str, logarithmic: bool
) -> None:
    """The fitted curve of an observable with the bodies of one impact, its band, and where it yields."""
    one = of_impact(fit, impact)
    fine = _fine(one.data, logarithmic, False)
    band = result.band(fine, fit.name, observable=observable, impact=impact)
    label = None
    if distinct_impacts(fit) and one.data.contact is not None:
        label = f"R = {number(1e3 * float(one.data.contact.radius), 3)} mm"
    dashes = DASHES[SHADES.index(color)]
    ax.plot(fine, band.coefficient, color=color, label=label, linewidth=1.5, linestyle=dashes)
    look: dict[str, Any] = {"color": color, "alpha": 0.25, "linewidth": 0}
    ax.fill_between(fine, band.low, band.high, **look)
    critical = yield_velocity(one.law)
    if critical is not None and fine[0] < critical < fine[-1]:
        ax.axvline(critical, color=color, linestyle=":", linewidth=1)


def by_size(
    fit: Any, impacts: np.ndarray, sizes: Sequence[int]
) -> Iterator[tuple[str, np.ndarray | slice]]:
    """The colour of each size's curve, and which of these impacts have that size.

    All of them in one colour where there is one size, or more than colours.
    """
    radius = np.asarray(1.0 if fit.data.contact is None else fit.data.contact.radius)
    if not radius.ndim or not 1 < len(sizes) <= len(SHADES):
        yield style.BLUE, slice(None)
        return
    nearest = np.argmin(np.abs(np.log(radius[impacts, None] / radius[sizes])), axis=1)
    for k, color in zip(range(len(sizes)), SHADES, strict=False):
        yield color, nearest == k


def velocity_label(ratio: bool = False) -> str:
    return r"$y = v/v_\mathrm{cr}$" if ratio else "impact velocity $v$ [m/s]"


def _plot_fit(ax: Axes, result, fit, velocity, scale) -> None:
    """Eq. (17), the fitted law, and its bands where they can be seen."""
    ratio, band = velocity / scale, result.band(velocity, fit.name)
    if fit.empirical is not None and fit.model.key != "eq-17":
        empirical = curve_and_slopes(as_empirical(fit), velocity)[0]
        look: dict[str, Any] = {"color": style.ORANGE, "linestyle": "--", "zorder": 4}
        ax.plot(*_sorted(ratio, empirical), label=EQ_17, **look)
    label = FITTED.format(fit.model.label)
    ax.plot(*_sorted(ratio, band.coefficient), color=style.BLUE, label=label, linewidth=1.8)
    if not np.nanmax(band.high - band.low, initial=0.0) > INVISIBLE:
        return
    share = f"{100 * result.confidence:g} %"
    wide = result.band(velocity, fit.name, kind="prediction")
    for one, alpha, what in ((wide, 0.1, "one more measurement"), (band, 0.3, "of the mean")):
        look = {"color": style.BLUE, "linewidth": 0, "alpha": alpha, "label": f"{share}, {what}"}
        x, low, high = _sorted(ratio, one.low, one.high)
        ax.fill_between(x, low, high, **look)


def _sorted(velocity: np.ndarray, *columns: np.ndarray) -> list[np.ndarray]:
    """Ascending velocities, and what belongs to them."""
    order = np.argsort(velocity, kind="stable")
    return [column[order] for column in (velocity, *columns)]


def _marks(color: str, marker: str) -> dict[str, Any]:
    look = {"fmt": marker, "color": color, "markerfacecolor": "white", "markersize": 3.5}
    return {**look, "markeredgewidth": 0.8, "elinewidth": 0.8, "zorder": 3}


def _scale(fit, ratio: bool) -> np.ndarray:
    """v_cr [m/s] of the fitted law, or of each impact; 1 m/s without a ratio."""
    if ratio and fit.contact is None:
        raise DataError("ratio", ratio, "False where there is no contact")
    return np.asarray(fit.contact.critical_velocity if ratio else 1.0)


def _fine(data: RestitutionData, logarithmic: bool, from_rest: bool) -> np.ndarray:
    """Velocities of a curve, closer together where it is steep."""
    low, high = float(np.min(data.velocity)), float(np.max(data.velocity))
    if logarithmic:
        return np.geomspace(low, high, FINE)
    low = 0.0 if from_rest else low
    return low + (high - low) * np.linspace(0.0, 1.0, FINE) ** 2
