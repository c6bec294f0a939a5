"""Further curves in the picture of a fit: the line of Eq. (18), and those of the paper."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import jax
import numpy as np

import softjax as sj
from calibration import paper
from calibration.fitting.curves import curve_and_slopes
from calibration.plots import style
from softjax.laws.thornton import thornton_restitution

# where a law has no rebound to show; its other flags qualify a value, these say there is none
NO_VALUE = int(
    sj.Status.NO_REBOUND
    | sj.Status.NO_TURNING_POINT
    | sj.Status.ABOVE_LIMIT_VELOCITY
    | sj.Status.INVALID_INPUT
)


class Line(NamedTuple):
    """One curve ε(v); `value` gives NaN where there is none."""

    label: str
    value: Callable[[np.ndarray], np.ndarray]
    color: str
    linestyle: Any = "-"
    residuals: bool = False  # whether data minus this curve are drawn below


def lines_of(result: Any, with_paper: bool = False) -> dict[str, list[Line]]:
    """Further curves for each material: Eq. (18)'s line, and of Table 1's the paper's other curves.

    A line through two materials goes through both their χ̃ and is not drawn.
    """
    shared, entries = result.unloading_line, {entry.name: entry for entry in paper.TABLE_1}
    lines: dict[str, list[Line]] = {}
    for fit in result.materials:
        is_printed = with_paper and fit.name in entries
        lines[fit.name] = _paper_lines(fit.contact, entries[fit.name]) if is_printed else []
        if shared is not None and len(shared.chi) > 2 and fit.name in shared.chi:
            lines[fit.name].append(_on_line(fit, shared.chi[fit.name].value))
    return lines


def law_values(law: sj.ContactLaw, velocity: np.ndarray) -> np.ndarray:
    """ε of a law, NaN where its status says that it has none."""
    curve = sj.restitution(law, velocity)
    none = np.asarray(curve.status) & NO_VALUE != 0
    return np.where(none, np.nan, np.asarray(curve.coefficient))


def _on_line(fit: Any, chi: float) -> Line:
    """The fitted law with χ̃ = c1 + c2 E/Y of Eq. (18)."""
    moved = replace(fit, values={**fit.values, "chi": chi})

    def value(velocity: np.ndarray) -> np.ndarray:
        # as the fit's own band: compiled already; 0 stands for no value
        coefficient = curve_and_slopes(moved, velocity)[0]
        return np.where((coefficient > 0) & moved.determined(velocity), coefficient, np.nan)

    label = r"Zhou, $\tilde\chi$ by Eq. (18) fitted to all"
    return Line(label, value, style.SKY, "-.", residuals=True)


def _paper_lines(contact: sj.Contact, entry: paper.TableEntry) -> list[Line]:
    """Curves of Fig. 2: the model as printed, and Thornton's formula."""
    printed = sj.Zhou(contact, entry.chi, entry.sigma, entry.psi, kappa="printed")
    as_printed = replace(contact, area="zhou")
    formula = jax.jit(thornton_restitution, static_argnames="area")
    thornton = lambda contact, area: lambda v: np.asarray(formula(contact, v, area=area))  # noqa: E731
    model = r"Zhou, printed $\kappa$ and Table 1's $\tilde\chi$"
    at_paper, at_hertz = (
        rf"Thornton, yield at {where}"
        for where in (r"the paper's $v_\mathrm{cr}$", "Hertz's $V_y$")
    )
    return [
        Line(model, lambda v: law_values(printed, v), style.VERMILION, (0, (6, 2))),
        Line(at_paper, thornton(as_printed, "contact"), style.GREEN, (0, (3, 1, 1, 1))),
        Line(at_hertz, thornton(contact, "hertz"), style.PURPLE, (0, (1, 1))),
    ]
