"""Profiles of the cost: how much worse the best fit gets when one parameter is fixed elsewhere."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from calibration import symbols
from calibration.plots import style

TOP = 1.6  # of the picture, in thresholds


def plot_profile(profile, estimate=None, ax: Axes | None = None, model: Any = None) -> Axes:
    """Δχ² over one parameter, the interval's threshold, and where the profile crosses it.

    Args:
        profile: a `Profile` of a fit.
        estimate: the parameter's `Estimate`; its standard error's parabola is drawn beside.
        ax: where to draw; a new figure's where None.
        model: of the law that it is a parameter of, which knows its symbol.
    """
    ax = style.axes_or_new(ax)
    values, rise = _points(profile)
    logarithmic = style.spans_decades(values)
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
    """What the picture has room for, and one point beyond either end where that is near."""
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
