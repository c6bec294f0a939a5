"""Pictures of sensitivities and designs."""

from collections.abc import Sequence
from itertools import cycle
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from calibration.plots import style
from calibration.symbols import in_math

NOTHING = 1e-12  # a smaller sensitivity is zero
VISIBLE = 2e-3  # a sensitivity smaller than this part of the largest looks like zero
EFFECT = r"$\theta\,\partial\varepsilon/\partial\theta$"


def plot_sensitivities(
    sensitivities: Any, ax: Axes | None = None, critical_velocity: float | None = None
) -> Axes:
    """Draw θ ∂ε/∂θ of every input over velocity.

    The legend names inputs without effect, and those whose effect is too small to see.

    Args:
        sensitivities: `Sensitivities`.
        critical_velocity: where the curves jump, at first yield.
    """
    ax = style.axes_or_new(ax, 4.2)
    letters = np.array([in_math(declared.symbol) for declared in sensitivities.declared.values()])
    size = np.max(np.abs(sensitivities.absolute), axis=0)
    smallest = max(VISIBLE * np.max(size, initial=0.0), NOTHING)
    velocity, slopes = sensitivities.velocity, sensitivities.absolute[:, size >= smallest]
    place = 0 if critical_velocity is None else int(np.searchsorted(velocity, critical_velocity))
    if 0 < place < len(velocity):
        velocity = np.insert(velocity, place, critical_velocity)
        slopes = np.insert(slopes, place, np.nan, axis=0)
    _plot_slopes(ax, velocity, slopes, letters[size >= smallest])
    small = (size >= NOTHING) & (size < smallest)
    for hidden, text in ((size < NOTHING, "no effect"), (small, f"below {smallest:.0e}")):
        if np.any(hidden):
            ax.plot([], [], linestyle="", label=f"{text}: {', '.join(letters[hidden])}")
    style.mark_velocity(
        ax, critical_velocity, sensitivities.velocity, label=r"yield, $v_\mathrm{cr}$"
    )
    ax.axhline(0, color=style.GREY, linewidth=0.6)
    ax.legend(frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return ax


def plot_tornado(sensitivities: Any, velocity: float, ax: Axes | None = None) -> Axes:
    """Draw the change of ε for +1 % of each input at one velocity, the largest on top.

    A number stands where a bar is too short to see.
    """
    ax = style.axes_or_new(ax, 3.5)
    ranked = sensitivities.ranked(velocity)[::-1]
    changes = np.array([value for _, value in ranked]) / 100
    names = [in_math(sensitivities.declared[name].symbol) for name, _ in ranked]
    colors = np.where(changes >= 0, style.BLUE, style.VERMILION)
    ax.barh(range(len(names)), changes, color=colors, height=0.7, tick_label=names)
    side = "right" if sum(ax.get_xlim()) < 0 else "left"  # where there is more room
    largest = np.max(np.abs(changes))
    for k in np.flatnonzero(np.abs(changes) < 5 * VISIBLE * largest).tolist():
        text = f" {changes[k]:.0e} " if abs(changes[k]) >= NOTHING else " 0 "
        ax.text(0, k, text, va="center", ha=side, color=style.GREY, fontsize="small")
    ax.axvline(0, color=style.BLACK, linewidth=0.8)
    nearest = sensitivities.velocity[np.argmin(np.abs(sensitivities.velocity - velocity))]
    ax.set(xlabel=r"change of $\varepsilon$ for +1 %", title=f"$v$ = {nearest:.3g} m/s")
    if largest > NOTHING:  # the power of ten in the label: an offset below the axis is overlooked
        power = int(np.floor(np.log10(largest)))
        ax.xaxis.set_major_formatter(lambda x, _: f"{x / 10.0**power:.6g}")
        ax.set_xlabel(rf"change of $\varepsilon$ for +1 % [$10^{{{power}}}$]")
    return ax


def tornado_figure(sensitivities: Any) -> Figure:
    """Draw `plot_tornado` at every velocity."""
    count = len(sensitivities.velocity)
    figure, grid = style.panels(count, 3.4, "velocities", legend=0.0)
    for v, ax in zip(sensitivities.velocity, grid[:, 0], strict=False):
        plot_tornado(sensitivities, v, ax)
    return figure


def plot_design(design: Any, ax: Axes | None = None) -> Axes:
    """Draw θ ∂ε/∂θ of every parameter, the planned shots with their number, and equally spaced ones."""
    ax = style.axes_or_new(ax, 4.8)
    letters = [in_math(symbol) for symbol in design.symbols]
    labels = [rf"{EFFECT}, $\theta$ = {letter}" for letter in letters]
    _plot_slopes(ax, design.grid, design.slopes, labels)
    bottom, top = float(np.min(design.slopes)), float(np.max(design.slopes))
    height = (top - bottom) or 1.0
    ax.set_ylim(bottom - 0.3 * height, top + 0.08 * height)
    velocity, at = [v for v, _ in design.support], bottom - 0.12 * height
    ax.plot(velocity, [at] * len(velocity), "^", color=style.BLACK, markersize=9, label="shots")
    for v, n in design.support:
        ax.annotate(f"{n}", (v, at), (0, -15), textcoords="offset points", ha="center")
    even = np.linspace(design.bounds[0], design.bounds[1], len(design.velocity))
    level = np.full(len(even), bottom - 0.26 * height)
    ax.plot(even, level, "|", color=style.GREY, markersize=7, label="equally spaced")
    symbol = design.target_symbol
    what = design.criterion_in_words.replace(symbol, in_math(symbol))
    title = f"{what}:\n{100 / design.gain:.0f} % of that with equally spaced shots"
    ax.set_title(title, fontsize="medium")
    place = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.16), "ncols": 2}
    ax.legend(frameon=False, fontsize="small", **place)
    return ax


def _plot_slopes(ax: Axes, velocity, slopes, labels: Sequence[str]) -> None:
    """Draw each column of `slopes` over velocity."""
    looks = zip(cycle(style.SHADES), cycle(style.DASHES), labels, slopes.T, strict=False)
    for color, dashes, label, values in looks:
        ax.plot(velocity, values, color=color, ls=dashes, label=label)
    if style.spans_decades(velocity):
        style.logarithmic_x(ax)
    ax.set(xlabel=style.VELOCITY, ylabel=f"sensitivity {EFFECT}")
