"""Fig. 2 of Zhou (2013) again, from this library's own fits.

Three panels over y = v/v_cr: the model with the constants that follow from its forces and χ̃ fitted
to the curve, the model as printed (κ = 120 (Y/E)² and Table 1's χ̃, drawn as far as it has a
solution), Thornton's formula with yield at the paper's v_cr and at Hertz's V_y, and Eq. (17).
"""

from typing import Any

from matplotlib.figure import Figure

import softjax as sj
from calibration.plots.figures import curves_figure
from calibration.plots.lines import lines_of

TITLE = "Fig. 2 of Zhou (2013) again; data: Eq. (17) with Table 1's σ, ψ, a published fit"


def fit_materials(progress: Any = None):
    """χ̃ of the three materials by `two-step`: σ and ψ of Eq. (17), then χ̃ of the model."""
    from calibration.data.paper import paper_materials
    from calibration.fitting.door import fit

    return fit(
        paper_materials(),
        objective="two-step",
        route=sj.EnergyBalance(),
        unloading_line=None,
        profiles=False,
        progress=progress,
    )


def figure_2(result: Any) -> Figure:
    """The picture of a fit of the three materials."""
    lines = lines_of(result, with_paper=True)
    return curves_figure(result, lines, ratio=True, from_rest=True, title=TITLE)
