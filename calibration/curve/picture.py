"""ε(v) drawn: the curve, a fit's band and data, and where the law has something to say."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from matplotlib.axes import Axes

import softjax as sj
from calibration.curve.stream import Rows
from calibration.plots import style

NO_VALUE = int(sj.Status.NO_REBOUND | sj.Status.NO_TURNING_POINT | sj.Status.INVALID_INPUT)


class Thinned:
    """At most `most` rows of any number, evenly taken from those seen so far."""

    def __init__(self, most: int = 4096):
        self._most, self._stride, self._seen = most, 1, 0
        self._kept: list[np.ndarray] = []

    def add(self, rows: Rows) -> None:
        count = len(rows.velocity)
        first = -self._seen % self._stride
        columns = [np.asarray(c, float)[first :: self._stride] for c in rows if c is not None]
        self._kept.append(np.stack(columns))
        self._seen += count
        while sum(block.shape[1] for block in self._kept) > self._most:
            self._kept = [np.concatenate(self._kept, axis=1)[:, ::2]]
            self._stride *= 2

    def rows(self) -> Rows:
        """What was kept, by ascending velocity."""
        columns = np.concatenate(self._kept, axis=1)
        return Rows(*columns[:, np.argsort(columns[0], kind="stable")])


def plot_restitution(
    rows: Rows,
    label: str,
    ax: Axes | None = None,
    critical_velocity: float | None = None,
    data: Any = None,
) -> Axes:
    """ε over v; gaps where the law has no rebound.

    Args:
        rows: a curve, by ascending velocity.
        label: what it is a curve of.
        ax: where to draw; a new figure's where None.
        critical_velocity: v_cr [m/s], marked where it lies inside.
        data: measurements to show beside it.
    """
    ax = style.axes_or_new(ax, 6.0, 4.0)
    none = rows.status.astype(int) & NO_VALUE != 0
    shown = np.where(none, np.nan, rows.coefficient)
    if rows.low is not None:
        band = {"color": style.BLUE, "alpha": 0.25, "linewidth": 0}
        ax.fill_between(rows.velocity, rows.low, rows.high, label="confidence band", **band)
    mark = "o" if len(rows.velocity) < 30 else ""
    ax.plot(rows.velocity, shown, marker=mark, markersize=4, color=style.BLUE, label=label)
    if data is not None:
        points = {"linestyle": "", "marker": "o", "markersize": 4, "color": style.BLACK}
        ax.errorbar(data.velocity, data.restitution, data.uncertainty, label="data", **points)
    if critical_velocity is not None and _inside(critical_velocity, rows.velocity):
        ax.axvline(
            critical_velocity, color=style.GREY, linestyle=":", label=r"yield, $v_\mathrm{cr}$"
        )
    ax.set(xlabel="impact velocity $v$ [m/s]", ylabel=r"restitution $\varepsilon$")
    if style.spans_decades(rows.velocity):
        style.logarithmic_x(ax)
    ax.legend(frameon=False)
    return ax


def _inside(value: float, values: Iterable[float]) -> bool:
    return bool(np.min(values) < value < np.max(values))
