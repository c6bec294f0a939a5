"""Restitution over impact velocity: data, what was fitted to them, and what is left over."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

import softjax as sj
from calibration.data import RestitutionData
from calibration.errors import DataError
from calibration.fitting.assembly import label_of_law
from calibration.fitting.curves import (
    as_empirical,
    curve_and_slopes,
    of_each_impact,
    yield_velocity,
)
from calibration.plots import style
from calibration.plots.lines import Line

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
    scale = _scale(fit, ratio)
    logarithmic = style.spans_decades(fit.data.velocity) and not from_rest
    velocity = fit.data.velocity if of_each_impact(fit) else _fine(fit, logarithmic, from_rest)
    _fitted(ax, result, fit, velocity, scale)
    for line in lines:
        _beside(ax, line, velocity, scale)
    plot_data(ax, fit.data, scale)
    _flagged(ax, fit, scale)
    critical = yield_velocity(fit.law)
    yields = None if critical is None else critical / float(scale)
    style.mark_velocity(ax, yields, fit.data.velocity / scale, "first yield")
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
    data, x = fit.data, fit.data.velocity / _scale(fit, ratio)
    ax.axhline(0.0, color=style.GREY, linewidth=0.8)
    for line in lines:
        if line.residuals:
            left = data.restitution - line.value(data.velocity)
            ax.plot(
                *_by_velocity(x, left), color=line.color, linestyle=line.linestyle, linewidth=1.2
            )
    left = data.restitution - result.band(data.velocity, fit.name).coefficient
    ax.errorbar(x, left, yerr=data.uncertainty, **_marks(style.BLUE, "s"))
    ax.set(xlabel=velocity_label(ratio), ylabel="data − fit")
    ax.ticklabel_format(axis="y", scilimits=(-3, 3))
    return ax


def velocity_label(ratio: bool) -> str:
    return r"$y = v/v_\mathrm{cr}$" if ratio else "impact velocity $v$ [m/s]"


def _beside(ax: Axes, line: Line, velocity, scale) -> None:
    """One further curve; a cross where it ends before the data do."""
    x, value = _by_velocity(velocity / scale, line.value(velocity))
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
    ratio, band = velocity / scale, result.band(velocity, fit.name)
    if fit.empirical is not None and fit.model.key != "eq-17":
        empirical = curve_and_slopes(as_empirical(fit), velocity)[0]
        look: dict[str, Any] = {"color": style.ORANGE, "linestyle": "--", "zorder": 4}
        ax.plot(*_by_velocity(ratio, empirical), label=EQ_17, **look)
    label = ZHOU if fit.model.key == "zhou" else f"{label_of_law(fit.model)}, fitted"
    ax.plot(*_by_velocity(ratio, band.coefficient), color=style.BLUE, label=label, linewidth=1.8)
    if not np.nanmax(band.high - band.low, initial=0.0) > INVISIBLE:
        return
    share = f"{100 * result.confidence:g} %"
    wide = result.band(velocity, fit.name, kind="prediction")
    for one, alpha, what in ((wide, 0.1, "one more measurement"), (band, 0.3, "of the mean")):
        x, low, high = _by_velocity(ratio, one.low, one.high)
        label = f"{share}, {what}"
        ax.fill_between(x, low, high, color=style.BLUE, linewidth=0, alpha=alpha, label=label)


def _by_velocity(velocity: np.ndarray, *columns: np.ndarray) -> list[np.ndarray]:
    """Ascending, and what belongs to them."""
    order = np.argsort(velocity, kind="stable")
    return [column[order] for column in (velocity, *columns)]


def plot_data(ax: Axes, data: RestitutionData, scale: np.ndarray | float = 1.0) -> None:
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


def _scale(fit, ratio: bool) -> np.ndarray:
    """v_cr [m/s] of the fitted law, or of each impact; 1 m/s where no ratio is asked for."""
    if ratio and fit.contact is None:
        raise DataError("ratio", ratio, "False where there is no contact")
    return np.asarray(fit.contact.critical_velocity if ratio else 1.0)


def _fine(fit, logarithmic: bool, from_rest: bool) -> np.ndarray:
    """Velocities of a curve, closer together where it is steep."""
    low, high = float(np.min(fit.data.velocity)), float(np.max(fit.data.velocity))
    if logarithmic:
        return np.geomspace(low, high, FINE)
    low = 0.0 if from_rest else low
    return low + (high - low) * np.linspace(0.0, 1.0, FINE) ** 2
