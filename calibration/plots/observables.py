"""Observables other than ε: data, fitted curves with their bands, and residuals."""

from typing import Any

from matplotlib.figure import Figure

from calibration.fitting.curves import distinct_impacts
from calibration.observables import OBSERVABLES
from calibration.plots import style
from calibration.plots.curves import SHADES, by_size, plot_size, velocity_label


def observables_figure(result: Any) -> Figure | None:
    """Each observable of each data set over v, a curve for each size, and relative residuals below.

    None if only ε was measured.
    """
    every = [(fit, one) for fit in result.materials for one in fit.data.observed]
    if not every:
        return None
    figure, grid = style.panels(len(every), (4.2, 4.4), "observables", (2.6, 1), 0.3)
    for (fit, one), (upper, lower) in zip(every, grid, strict=False):
        velocity = fit.data.velocity[one.rows]
        logarithmic = style.spans_decades(velocity)
        sizes = distinct_impacts(fit) or [0]
        for impact, color in zip(sizes, SHADES, strict=False):
            plot_size(upper, result, fit, impact, color, one.name, logarithmic)
        look: dict[str, Any] = {"fmt": "o", "color": style.BLACK, "markerfacecolor": "white"}
        look |= {"markersize": 3.5, "elinewidth": 0.8, "label": "data"}
        upper.errorbar(velocity, one.value, one.uncertainty, **look)
        band = result.band(fit.data.velocity, fit.name, observable=one.name)
        off = 100 * (one.value / band.coefficient[one.rows] - 1)
        parts = None if one.uncertainty is None else 100 * one.uncertainty / one.value
        lower.axhline(0.0, color=style.GREY, linewidth=0.8)
        for color, rows in by_size(fit, one.rows, sizes):
            size = None if parts is None else parts[rows]
            lower.errorbar(velocity[rows], off[rows], size, **(look | {"fmt": "s", "color": color}))
        for ax in (upper, lower):
            if logarithmic:
                style.logarithmic_x(ax)
        what = OBSERVABLES[one.name]
        upper.tick_params(labelbottom=False)
        name = one.name.replace("_", " ")
        unit = style.in_prefixed_unit(upper, what.unit, one.value)
        upper.set(title=style.plain(fit.name), ylabel=f"{name} [{unit}]")
        lower.set(xlabel=velocity_label(), ylabel="data/fit − 1 [%]", xlim=upper.get_xlim())
        upper.legend(frameon=False, fontsize="small")
    return figure
