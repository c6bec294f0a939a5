"""ε(v) drawn: the curve, a fit's band and data, and where the law begins to yield."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from calibration.plots import style
from calibration.plots.curves import plot_data, velocity_label
from calibration.plots.lines import NO_VALUE

FEW = 30  # rows that are drawn as points


def plot_restitution(
    rows: Any,
    label: str,
    ax: Axes | None = None,
    yields_at: float | None = None,
    result: Any = None,
) -> Axes:
    """ε over v; gaps where the law has no rebound; where a fit knows nothing is grey.

    Args:
        rows: a curve, `calibration.curves.Rows` by ascending velocity.
        label: what it is a curve of.
        ax: where to draw; a new figure's where None.
        yields_at: a velocity [m/s], marked where it lies inside.
        result: `MaterialFit` and confidence of the fit that it is of, with its data; None for none.
    """
    ax = style.axes_or_new(ax, 6.0, 4.0)
    none = rows.status.astype(int) & int(NO_VALUE) != 0
    if result is not None:
        fit, confidence = result
        band: dict[str, Any] = {"color": style.BLUE, "alpha": 0.25, "linewidth": 0}
        share = f"{100 * confidence:g} %, of the mean"
        ax.fill_between(rows.velocity, rows.low, rows.high, label=share, **band)
        plot_data(ax, fit.data)
        _mark_unknown(ax, rows)
    shown = np.where(none, np.nan, rows.coefficient)
    mark = "o" if len(rows.velocity) < FEW else ""
    look: dict[str, Any] = {"color": style.BLUE, "marker": mark, "markersize": 4}
    ax.plot(rows.velocity, shown, label=style.plain(label), **look)
    style.mark_velocity(ax, yields_at, rows.velocity, "first yield")
    ax.set(xlabel=velocity_label(False), ylabel=r"restitution $\varepsilon$")
    if style.spans_decades(rows.velocity):
        style.logarithmic_x(ax)
    ax.legend(frameon=False)
    return ax


def _mark_unknown(ax: Axes, rows: Any) -> None:
    """Grey from an end of the curve to where the fit begins to know it."""
    known = np.flatnonzero(np.isfinite(rows.coefficient))
    v = rows.velocity
    look: dict[str, Any] = {"color": style.GREY, "alpha": 0.15, "linewidth": 0}
    for ends in ((v[0], v[known[0]]), (v[known[-1]], v[-1])):
        if ends[0] < ends[1]:
            ax.axvspan(*ends, label="not known", **look)
