"""Pictures of fits. matplotlib is imported here and nowhere above; no pyplot, no global state."""

from calibration.plots.curves import curves_figure, plot_curve, plot_residuals
from calibration.plots.lines import Line, lines_of
from calibration.plots.observables import observables_figure
from calibration.plots.parameters import (
    correlation_figure,
    plot_correlations,
    plot_profile,
    profiles_figure,
)
from calibration.plots.posterior import posterior_figure
from calibration.plots.style import save
from calibration.plots.unloading_line import unloading_line_figure

__all__ = [
    "Line",
    "correlation_figure",
    "curves_figure",
    "lines_of",
    "observables_figure",
    "plot_correlations",
    "plot_curve",
    "plot_profile",
    "plot_residuals",
    "posterior_figure",
    "profiles_figure",
    "save",
    "unloading_line_figure",
]
