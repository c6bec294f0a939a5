"""Restitution over impact velocity: data, what was fitted to them, and what is left over."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

import softjax as sj
from calibration.data import RestitutionData
from calibration.fitting.assembly import label_of_law
from calibration.fitting.curves import as_empirical, curve_and_slopes, yield_velocity
from calibration.plots import style
from calibration.plots.lines import Line, band_of

FINE = 240  # points of a curve
EQ_17 = "Eq. (17)"
ZHOU = "this model, fitted"
ORDER = ("data", "this model, fitted", EQ_17)  # in a legend
INVISIBLE = 1e-6  # width of a band that nobody sees: data without scatter
FLAGGED = ~(int(sj.Status.ELASTIC) | int(sj.Status.PLAIN))


def plot_curve(
    result: Any,
    name: str | None = None,
    ax: Axes | None = None,
    lines: Sequence[Line] = (),
    ratio: bool = False,
    from_rest: bool = False,
) -> Axes:
    """Data with error bars, Eq. (17), the fit with its band, and `lines` beside them.

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
    scale = _velocity_scale(fit, ratio)
    logarithmic = style.spans_decades(fit.data.velocity) and not from_rest
    velocity = _fine(fit, logarithmic, from_rest)
    _fitted(ax, result, fit, velocity, scale)
    for line in lines:
        _beside(ax, line, velocity, scale)
    plot_data(ax, fit.data, scale)
    _flagged(ax, fit, scale)
    _mark_yield(ax, fit, scale)
    if logarithmic:
        style.logarithmic_x(ax)
    ax.set(xlabel=velocity_label(ratio), ylabel=r"restitution $\varepsilon$")
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
    data, scale = fit.data, _velocity_scale(fit, ratio)
    x = data.velocity / scale
    ax.axhline(0.0, color=style.GREY, linewidth=0.8)
    for line in lines:
        if line.residuals:
            left = data.restitution - line.value(data.velocity)
            ax.plot(x, left, color=line.color, linestyle=line.linestyle, linewidth=1.2)
    left = data.restitution - band_of(result, fit.name, data.velocity).coefficient
    ax.errorbar(x, left, yerr=data.uncertainty, **_marks(style.BLUE, "s"))
    ax.set(xlabel=velocity_label(ratio), ylabel="data − fit")
    ax.ticklabel_format(axis="y", scilimits=(-3, 3))
    return ax


def velocity_label(ratio: bool) -> str:
    return r"$y = v/v_\mathrm{cr}$" if ratio else "impact velocity $v$ [m/s]"


def _beside(ax: Axes, line: Line, velocity, scale) -> None:
    """One further curve; a cross where it ends before the data do."""
    value, x = line.value(velocity), velocity / scale
    look: dict[str, Any] = {"color": line.color, "linestyle": line.linestyle, "linewidth": 1.4}
    ax.plot(x, value, label=line.label, zorder=1.5, **look)
    last = np.flatnonzero(np.isfinite(value))[-1:]
    if last.size and last[0] < len(x) - 1:
        ax.plot(
            x[last],
            value[last],
            color=line.color,
            marker="X",
            markersize=8,
            linestyle="none",
            label="no solution beyond",
        )


def _fitted(ax: Axes, result, fit, velocity, scale) -> None:
    band = band_of(result, fit.name, velocity)
    x = velocity / scale
    if fit.empirical is not None and fit.model.key != "eq-17":
        empirical = curve_and_slopes(as_empirical(fit), velocity)[0]
        ax.plot(x, empirical, color=style.ORANGE, linestyle="--", label=EQ_17, zorder=4)
    label = ZHOU if fit.model.key == "zhou" else f"{label_of_law(fit.model)}, fitted"
    ax.plot(x, band.coefficient, color=style.BLUE, label=label, linewidth=1.8)
    if not np.nanmax(band.high - band.low, initial=0.0) > INVISIBLE:
        return
    share = f"{100 * result.confidence:g} %"
    wide = result.band(velocity, fit.name, kind="prediction")
    look: dict[str, Any] = {"color": style.BLUE, "linewidth": 0}
    ax.fill_between(
        x, wide.low, wide.high, alpha=0.1, label=f"{share}, one more measurement", **look
    )
    ax.fill_between(x, band.low, band.high, alpha=0.3, label=f"{share}, of the mean", **look)


def plot_data(ax: Axes, data: RestitutionData, scale: float = 1.0) -> None:
    """Measured ε with its error bars over v/scale."""
    ax.errorbar(
        data.velocity / scale,
        data.restitution,
        yerr=data.uncertainty,
        xerr=None if data.velocity_uncertainty is None else data.velocity_uncertainty / scale,
        label="data",
        **_marks(style.BLACK, "o"),
    )


def _flagged(ax: Axes, fit, scale) -> None:
    """Crosses over the points at which the law's status is not plain."""
    x = fit.data.velocity / scale
    status = np.asarray(fit.status, int)  # empty for a curve that no law is behind
    flagged = np.flatnonzero(status & FLAGGED)
    if len(flagged):
        ax.plot(
            x[flagged],
            fit.data.restitution[flagged],
            linestyle="none",
            marker="x",
            color=style.VERMILION,
            label="data where the law's status is not plain",
        )


def _marks(color: str, marker: str) -> dict[str, Any]:
    return {
        "fmt": marker,
        "color": color,
        "markerfacecolor": "white",
        "markersize": 3.5,
        "markeredgewidth": 0.8,
        "elinewidth": 0.8,
        "zorder": 3,
    }


def _mark_yield(ax: Axes, fit, scale) -> None:
    """A line where the law's impacts begin to yield, if that is inside the data."""
    critical = yield_velocity(fit.law)
    low, high = np.min(fit.data.velocity), np.max(fit.data.velocity)
    if critical is not None and low < critical < high:
        ax.axvline(
            critical / scale,
            color=style.GREY,
            linestyle=":",
            linewidth=1,
            label="first yield",
        )


def _critical_velocity(fit) -> float | None:
    """v_cr [m/s] of the fitted law; None without elastic properties or with one for each impact."""
    contact = fit.contact
    if contact is None:
        return None
    critical = np.asarray(contact.critical_velocity)
    return float(critical) if critical.ndim == 0 else None


def _velocity_scale(fit, ratio: bool) -> float:
    return _critical_velocity(fit) or 1.0 if ratio else 1.0


def _fine(fit, logarithmic: bool, from_rest: bool) -> np.ndarray:
    """Velocities of a curve, closer together where it is steep."""
    low, high = float(np.min(fit.data.velocity)), float(np.max(fit.data.velocity))
    if logarithmic:
        return np.geomspace(low, high, FINE)
    low = 0.0 if from_rest else low
    return low + (high - low) * np.linspace(0.0, 1.0, FINE) ** 2
