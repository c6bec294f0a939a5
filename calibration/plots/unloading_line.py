"""The unloading factor over E/Y: fitted materials, Eq. (18) with its band, and a further material."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from calibration.errors import DataError
from calibration.fitting.material import Estimate
from calibration.fitting.uncertainty import quantile
from calibration.plots import style

ROOM = 1.3  # how far the line goes beyond the materials, in parts


def unloading_line_figure(line: Any, contact: Any = None, name: str = "") -> Figure:
    """χ̃ of each material with its interval, the line and its band, where it is extrapolated dashed.

    Args:
        line: `FitResult.unloading_line`.
        contact: of a further material, whose place is marked.
        name: of the further material.
    """
    figure = style.new_figure(6.0, 4.6)
    ax = figure.add_subplot()
    low, high = line.range
    new = None if contact is None else float(np.asarray(contact.yield_ratio))
    ends = [low, high] if new is None else [min(low, new), max(high, new)]
    fine = np.linspace(ends[0] / ROOM, ends[1] * ROOM, 200)
    _draw_line(ax, line, fine, (low, high))
    reach = float(quantile(line.confidence, np.inf))
    for k, one in enumerate(line.materials):
        error = reach * (one.chi_error or 0.0)
        look: dict[str, Any] = {"fmt": "o", "color": style.BLUE, "capsize": 3}
        label = f"fitted, {100 * line.confidence:g} % intervals" if k == 0 else None
        ax.errorbar(one.yield_ratio, one.chi, error, label=label, **look)
        text = style.plain(style.shortened(one.name))
        is_last = one.yield_ratio > 0.7 * max(ends)
        where: dict[str, Any] = {"textcoords": "offset points", "zorder": 3}
        # the line rises: a name fits below it on its right, and above it on its left
        where |= {"ha": "right", "va": "bottom"} if is_last else {"ha": "left", "va": "top"}
        aside = (-8, 8) if is_last else (8, -8)
        ax.annotate(text, (one.yield_ratio, one.chi), aside, **where)
    if contact is not None:
        chi = line.unloading_factor(contact)
        ends_of = np.array([[chi.value - _end(chi.low, chi)], [_end(chi.high, chi) - chi.value]])
        label = style.plain(name or "the further material") + " (predicted)"
        look = {"fmt": "D", "color": style.VERMILION, "capsize": 3, "label": label}
        ax.errorbar(new, chi.value, ends_of, **look)
    top = max(one.chi + reach * (one.chi_error or 0.0) for one in line.materials)
    if contact is not None:
        top = max(top, chi.value)
    ax.set(
        xlabel="effective modulus over yield strength, $E/Y$",
        ylabel=r"unloading factor $\tilde\chi$",
        ylim=(-0.05 * top, 1.3 * top),
    )
    style.legend_below(figure, [ax], columns=2)
    return figure


def _draw_line(ax: Axes, line: Any, ratio: np.ndarray, inside: tuple[float, float]) -> None:
    found = [_at(line, x) for x in ratio]
    value = np.array([np.nan if e is None else e.value for e in found])
    low, high = (
        np.array([np.nan if e is None else _end(getattr(e, side), e) for e in found])
        for side in ("low", "high")
    )
    within = (ratio >= inside[0]) & (ratio <= inside[1])
    look: dict[str, Any] = {"color": style.BLACK, "linewidth": 1}
    ax.plot(ratio, np.where(within, value, np.nan), label="Eq. (18)", **look)
    ax.plot(ratio, np.where(within, np.nan, value), linestyle="--", label="extrapolated", **look)
    if np.any(high > low):
        label = f"{100 * line.confidence:g} % band of a further material"
        ax.fill_between(ratio, low, high, color=style.GREY, alpha=0.25, linewidth=0, label=label)


def _at(line: Any, ratio: float) -> Estimate | None:
    """χ̃ there; None where the line gives none that is positive."""
    try:
        return line.at(ratio)
    except DataError:
        return None


def _end(end: float | None, estimate: Estimate) -> float:
    assert estimate.value is not None
    return estimate.value if end is None else end
