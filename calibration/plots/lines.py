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

LEAST = 1e-3  # of ε: less is none


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
        lines[fit.name] = _paper_lines(fit, entries[fit.name]) if is_printed else []
        if shared is not None and len(shared.chi) > 2 and fit.name in shared.chi:
            moved = replace(fit, values={**fit.values, "chi": shared.chi[fit.name]})
            label = r"Zhou, $\tilde\chi$ by Eq. (18) fitted to all"
            lines[fit.name].append(_line_of(moved, label, style.SKY, "-.", True))
    return lines


def _line_of(fit: Any, label: str, color: str, linestyle: Any, residuals: bool = False) -> Line:
    """A law of other numbers than the fit's, by the program of the fit's own band: compiled already."""

    def value(velocity: np.ndarray) -> np.ndarray:
        coefficient = curve_and_slopes(fit, velocity)[0]
        return np.where((coefficient > LEAST) & fit.determined(velocity), coefficient, np.nan)

    return Line(label, value, color, linestyle, residuals)


def _paper_lines(fit: Any, entry: paper.TableEntry) -> list[Line]:
    """Curves of Fig. 2: the model as printed, and Thornton's formula."""
    contact = fit.contact
    critical = {area: replace(contact, area=area).critical_velocity for area in ("zhou", "hertz")}
    formula = jax.jit(thornton_restitution)
    thornton = lambda yields: lambda v: np.asarray(formula(contact, v, yields))  # noqa: E731
    ratio = (critical["zhou"] / critical["hertz"]) ** 0.4
    name = "Thornton, yield at {}".format
    dashes: Any = (0, (3, 1, 1, 1))
    lines = [
        Line(name(r"the paper's $v_\mathrm{cr}$"), thornton(ratio), style.GREEN, dashes),
        Line(name("Hertz's $V_y$"), thornton(1.0), style.PURPLE, (0, (1, 1))),
    ]
    if not isinstance(fit.law, sj.Zhou):
        return lines
    # κ as printed is that of bodies as much softer, of equal v_cr and χ̃ E/Y
    printed = replace(fit.law, kappa="printed").plasticity()
    factor = float(np.sqrt(printed / fit.law.plasticity()))
    softer = replace(contact, youngs_modulus=contact.youngs_modulus / factor)
    mass = contact.mass * (softer.critical_velocity / contact.critical_velocity) ** 2
    values = {"chi": entry.chi * factor, "sigma": entry.sigma, "psi": entry.psi}
    data = replace(fit.data, contact=replace(softer, mass=mass))
    moved = replace(fit, data=data, values=fit.values | values)
    label = r"Zhou, printed $\kappa$ and Table 1's $\tilde\chi$"
    return [_line_of(moved, label, style.VERMILION, (0, (6, 2))), *lines]
