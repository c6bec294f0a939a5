"""Profiles of the cost: how much worse the best fit gets when one parameter is held elsewhere."""

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
    values, rise = _seen(*_finite(profile), TOP * profile.threshold)
    logarithmic = style.spans_decades(values)
    ax.plot(*_smooth(values, rise, logarithmic), color=style.BLUE)
    ax.plot(values, rise, color=style.BLUE, marker="o", linestyle="none", markersize=3)
    ax.plot([], [], color=style.BLUE, marker="o", markersize=3, label="profile")
    if logarithmic:
        style.logarithmic_x(ax, room=0.0)
    else:
        ax.xaxis.set_major_locator(MaxNLocator(5))
    _parabola(ax, values, estimate)
    look: dict[str, Any] = {"color": style.VERMILION, "linestyle": "--", "linewidth": 1}
    ax.axhline(profile.threshold, label="threshold of the interval", **look)
    _ends(ax, profile)
    name, _, owner = profile.parameter.partition("[")
    ax.set_title(style.plain(owner.removesuffix("]")), fontsize="medium")
    ax.set(
        xlabel=symbols.math(name, model),
        ylabel=r"$\Delta\chi^2$",
        ylim=(0, TOP * profile.threshold),
    )
    return ax


def _smooth(values: np.ndarray, rise: np.ndarray, logarithmic: bool):
    """A curve through the points: ±√Δχ² is nearly a straight line, and is what is interpolated."""
    if len(values) < 3:
        return values, rise
    from scipy.interpolate import PchipInterpolator

    scale = np.log if logarithmic else np.array
    side = np.where(np.arange(len(values)) < np.argmin(rise), -1.0, 1.0)
    root = PchipInterpolator(scale(values), side * np.sqrt(np.maximum(rise, 0.0)))
    space = np.geomspace if logarithmic else np.linspace
    fine = np.union1d(values, space(values[0], values[-1], 200))
    return fine, root(scale(fine)) ** 2


def _finite(profile) -> tuple[np.ndarray, np.ndarray]:
    values = np.asarray(profile.values, float)
    rise = np.asarray(profile.delta_chi_squared, float)
    seen = np.isfinite(values) & np.isfinite(rise)
    values, first = np.unique(values[seen], return_index=True)
    return values, rise[seen][first]


def _seen(values: np.ndarray, rise: np.ndarray, top: float) -> tuple[np.ndarray, np.ndarray]:
    """What the picture has room for, and one point beyond either end where that is near."""
    inside = np.flatnonzero(rise <= top)
    if len(inside) < 2:
        return values, rise
    width = np.ptp(values[inside])
    near = np.abs(values - np.median(values[inside])) <= 1.5 * width
    kept = (np.arange(len(values)) >= inside[0] - 1) & (np.arange(len(values)) <= inside[-1] + 1)
    kept &= near | (rise <= top)
    return values[kept], rise[kept]


def _parabola(ax: Axes, values: np.ndarray, estimate) -> None:
    if estimate is None or not estimate.standard_error:
        return
    logarithmic = ax.get_xscale() == "log"
    space = np.geomspace if logarithmic else np.linspace
    fine = space(values[0], values[-1], 200)
    rise = ((fine - estimate.value) / estimate.standard_error) ** 2
    ax.plot(fine, rise, color=style.ORANGE, linestyle=":", label="from the standard error")


def _ends(ax: Axes, profile) -> None:
    for end in (profile.low, profile.high):
        if end is not None and np.isfinite(end):
            ax.axvline(end, color=style.GREY, linestyle="-.", linewidth=1, label="interval")
    for end, place, side in ((profile.low, 0.02, "left"), (profile.high, 0.98, "right")):
        if end is None:
            look: dict[str, Any] = {"ha": side, "va": "top", "color": style.GREY}
            ax.text(place, 0.96, "open end", transform=ax.transAxes, **look)
