"""Pictures of fits. matplotlib is imported here and nowhere above; no pyplot, no global state."""

from calibration.plots.budget import budget_figure
from calibration.plots.curves import (
    comparison_figure,
    curves_figure,
    observables_figure,
    plot,
    restitution_figure,
)
from calibration.plots.lines import Line, lines_of
from calibration.plots.parameters import (
    correlation_figure,
    posterior_figure,
    profiles_figure,
    unloading_line_figure,
)
from calibration.plots.style import draw, save
from calibration.plots.tracks import track_figure

__all__ = [
    "Line",
    "budget_figure",
    "comparison_figure",
    "correlation_figure",
    "curves_figure",
    "draw",
    "lines_of",
    "observables_figure",
    "plot",
    "posterior_figure",
    "profiles_figure",
    "restitution_figure",
    "save",
    "track_figure",
    "unloading_line_figure",
]
