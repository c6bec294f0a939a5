"""Sensitivities, designs and Sobol indices drawn."""

from itertools import cycle

import numpy as np
from matplotlib.axes import Axes

import softjax as sj
from calibration.plots import style
from calibration.sensitivities.design import Design
from calibration.sensitivities.inputs import SYMBOLS, split
from calibration.sensitivities.local import Sensitivities
from calibration.sensitivities.sobol import SobolIndices

COLORS = (
    style.BLUE,
    style.ORANGE,
    style.GREEN,
    style.VERMILION,
    style.SKY,
    style.PURPLE,
    style.BLACK,
    style.GREY,
)
STYLES = ("-", "--", "-.", (0, (1, 1)), (0, (5, 1, 1, 1, 1, 1)))
MATHS = {
    "poisson_ratio": r"\nu",
    "density": r"\rho",
    "limit_velocity": r"v_\mathrm{lim}",
    "chi": r"\tilde\chi",
    "sigma": r"\sigma",
    "psi": r"\psi",
    "eps_up": r"\varepsilon_\mathrm{up}",
}
NOTHING = 1e-12  # a sensitivity smaller than this is none
WITHOUT_EFFECT = r"$\theta\,\partial\varepsilon/\partial\theta$"


def math(name: str) -> str:
    """A quantity's letter for matplotlib."""
    stem, body = split(name)
    letter = MATHS.get(stem, SYMBOLS.get(stem, stem.replace("_", r"\ ")))
    return f"${letter}$ {body}".strip()


def plot_sensitivities(
    found: Sensitivities, ax: Axes | None = None, critical_velocity: float | None = None
) -> Axes:
    """θ ∂ε/∂θ of every input over velocity; inputs that move nothing are named in the legend.

    With a critical velocity the curves end there and begin anew: at yield they jump.
    """
    ax = style.axes_or_new(ax, 7.0, 4.2)
    marks = cycle(zip(COLORS, cycle(STYLES), strict=False))
    velocity, slopes = _parted(found.velocity, found.absolute, critical_velocity)
    silent = []
    for i, name in enumerate(found.names):
        if np.max(np.abs(found.absolute[:, i])) < NOTHING:
            silent.append(math(name))
            continue
        color, line = next(marks)
        ax.plot(velocity, slopes[:, i], color=color, linestyle=line, label=math(name))
    if silent:
        ax.plot([], [], linestyle="", label=f"none: {', '.join(silent)}")
    _mark_yield(ax, critical_velocity, found.velocity)
    _velocity_axis(ax, found.velocity)
    ax.axhline(0, color=style.GREY, linewidth=0.6)
    ax.set_ylabel(WITHOUT_EFFECT)
    ax.legend(frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return ax


def plot_tornado(found: Sensitivities, velocity: float, ax: Axes | None = None) -> Axes:
    """The inputs at one velocity, the strongest on top: change of ε for one percent of each."""
    ax = style.axes_or_new(ax, 4.0, 3.5)
    ranked = found.ranked(velocity)[::-1]
    percents = np.array([value for _, value in ranked]) / 100
    colors = [style.BLUE if value >= 0 else style.VERMILION for value in percents]
    ax.barh(range(len(ranked)), percents, color=colors, height=0.7)
    ax.set_yticks(range(len(ranked)), [math(name) for name, _ in ranked])
    ax.axvline(0, color=style.BLACK, linewidth=0.8)
    nearest = found.velocity[np.argmin(np.abs(found.velocity - velocity))]
    ax.set(xlabel=r"change of $\varepsilon$ for +1 %", title=f"$v$ = {nearest:.3g} m/s")
    ax.ticklabel_format(axis="x", scilimits=(-2, 3))
    return ax


def plot_design(design: Design, law: sj.Zhou, ax: Axes | None = None) -> Axes:
    """What each shot would tell of the parameters, and where the shots are."""
    from calibration.sensitivities import estimating

    ax = style.axes_or_new(ax, 6.5, 4.0)
    low, high = design.bounds
    velocity = np.geomspace(low, high, 400)
    slopes = np.asarray(estimating.slopes(law, velocity).model)
    for i, name in enumerate(estimating.THREE):
        line = {"color": COLORS[i], "linestyle": STYLES[i]}
        label = rf"{WITHOUT_EFFECT}, $\theta$ = {math(name)}"
        ax.plot(velocity, slopes[:, i], label=label, **line)
    _shots(ax, design, slopes)
    _velocity_axis(ax, velocity)
    gain = f"standard error of {math(design.target)} is {100 / design.gain:.0f} %"
    title = f"{design.criterion}-optimal, {design.objective}:\n{gain} of that with equal spacing"
    ax.set_title(title, fontsize="medium")
    ax.set_ylabel(WITHOUT_EFFECT)
    ax.legend(
        frameon=False, fontsize="small", loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2
    )
    return ax


def plot_sobol(found: SobolIndices, output: int = 0, ax: Axes | None = None) -> Axes:
    """First-order and total indices with bootstrap limits, and the bound from derivatives."""
    ax = style.axes_or_new(ax, 5.0, 3.5)
    place = np.arange(len(found.names))
    tables = (
        ("first order", style.BLUE, found.first, found.first_low, found.first_high, -0.2),
        ("total", style.ORANGE, found.total, found.total_low, found.total_high, 0.2),
    )
    for label, color, value, low, high, aside in tables:
        middle = value[output]
        reach = np.maximum([middle - low[output], high[output] - middle], 0)
        bar = {"color": color, "width": 0.36, "label": label, "capsize": 2, "ecolor": style.BLACK}
        ax.bar(place + aside, middle, yerr=reach, **bar)
    bound = np.where(found.bound[output] <= 1, found.bound[output], np.nan)  # more says nothing
    ax.plot(place + 0.2, bound, "v", color=style.BLACK, label="bound of total")
    ax.set_xticks(place, [math(name) for name in found.names])
    ax.set_ylabel(r"share of the variance of $\varepsilon$")
    highest = np.nanmax([1.0, *found.total_high[output], *found.first_high[output]])
    ax.set_ylim(0, 1.2 * highest)  # the legend has the rest for itself
    if found.velocity is not None:
        ax.set_title(f"$v$ = {found.velocity[output]:.3g} m/s")
    ax.legend(frameon=False, loc="upper center", ncols=3, fontsize="small", columnspacing=1.0)
    return ax


def _parted(velocity: np.ndarray, slopes: np.ndarray, at: float | None):
    """Rows over velocity with one of no value between those on either side of a velocity."""
    place = 0 if at is None else int(np.searchsorted(velocity, at))
    if not 0 < place < len(velocity):
        return velocity, slopes
    return np.insert(velocity, place, at), np.insert(slopes, place, np.nan, axis=0)


def _shots(ax: Axes, design: Design, slopes: np.ndarray) -> None:
    """Shots as marks below the curves, with their number; equally spaced ones beside them."""
    bottom, top = float(np.min(slopes)), float(np.max(slopes))
    height = top - bottom
    ax.set_ylim(bottom - 0.3 * height, top + 0.08 * height)
    at = bottom - 0.12 * height
    velocity, count = zip(*design.support, strict=True)
    ax.plot(velocity, [at] * len(velocity), "^", color=style.BLACK, markersize=9, label="shots")
    for v, n in design.support:
        ax.annotate(f"{n}", (v, at), (0, -15), textcoords="offset points", ha="center")
    even = np.linspace(*design.bounds, sum(count))
    level = [bottom - 0.26 * height] * len(even)
    ax.plot(even, level, "|", color=style.GREY, markersize=7, label="equally spaced")


def _mark_yield(ax: Axes, critical_velocity: float | None, velocity: np.ndarray) -> None:
    inside = critical_velocity is not None and velocity.min() < critical_velocity < velocity.max()
    if inside:
        label = r"yield, $v_\mathrm{cr}$"
        ax.axvline(critical_velocity, color=style.GREY, linestyle=":", label=label)


def _velocity_axis(ax: Axes, velocity: np.ndarray) -> None:
    if style.spans_decades(velocity):
        style.logarithmic_x(ax)
    ax.set_xlabel("impact velocity $v$ [m/s]")
