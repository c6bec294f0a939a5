"""Pictures of the paper: Fig. 2 of Zhou (2013) again, and its case against the linear spring.

Fig. 2 has three panels over y = v/v_cr: the model with the constants that follow from its forces and χ̃
fitted to the curve, the model as printed (κ = 120 (Y/E)² and Table 1's χ̃, drawn as far as it has a
solution), Thornton's formula with yield at the paper's v_cr and at Hertz's V_y, and Eq. (17).

The paper argues that T → ∞ as ε → 0. That belongs to a contact that ends at δ = 0; one that ends
where the force vanishes lasts 2/ω0 there. Neither has Hertz's force or duration. With the angle a of
the damping, ξ = cos a and √(1 - ξ²) = sin a, the motion is δ ∝ e^{-ω0 t cos a} sin(ω0 t sin a), and the
two ends are at ω0 T sin a = π and = 2a.

Source: T. Schwager and T. Pöschel, Granular Matter 9, 465 (2007).
"""

import math
from typing import Any

import numpy as np
from jaxtyping import ArrayLike, Float
from matplotlib.figure import Figure

import softjax as sj
from calibration.plots import style
from calibration.plots.curves import curves_figure
from calibration.plots.lines import lines_of

TITLE = "Fig. 2 of Zhou (2013) again; data: Eq. (17) with Table 1's σ, ψ, a published fit"
STIFFNESS = 1e6  # N/m; scaled out
INTEGRATED = np.array([0.01, 0.02, 0.05, 0.1, 0.2, 0.4, 0.6, 0.8, 0.95])
LOOKS = {
    "zero-overlap": (style.VERMILION, "-", "o", r"contact ends at $\delta = 0$"),
    "zero-force": (style.BLUE, "--", "s", "contact ends at zero force"),
}


def fit_materials(progress: Any = None):
    """χ̃ of the three materials by `two-step`: σ and ψ of Eq. (17), then χ̃ of the model."""
    from calibration.fitting.result import fit
    from calibration.paper import paper_materials

    options: dict[str, Any] = {"objective": "two-step", "route": sj.EnergyBalance()}
    options |= {"unloading_line": None, "profiles": False}
    return fit(paper_materials(), progress=progress, **options)


def figure_2(result: Any) -> Figure:
    """Draw Fig. 2 from a fit of the three materials."""
    lines = lines_of(result, with_paper=True)
    return curves_figure(result, lines, ratio=True, from_rest=True, title=TITLE)


def linear_figure() -> Figure:
    """The linear spring: T ω0/π over the ε that goes in, and its force over the overlap."""
    figure = style.new_figure(7.2)
    left, right = figure.subplots(2)
    steel = sj.STAINLESS_STEEL
    pair = sj.Contact.between_spheres(steel, steel, 0.0127, 0.0127)
    fine = np.geomspace(1e-3, 1.0, 400)
    for end, (color, linestyle, marker, label) in LOOKS.items():
        left.plot(fine, duration(fine, end) / np.pi, linestyle, color=color, label=label)
        law = sj.LinearSpringDashpot(pair, STIFFNESS, INTEGRATED, end)
        time = sj.restitution(law, np.ones_like(INTEGRATED), sj.ODE(rtol=1e-10)).duration
        points = np.asarray(time) * np.sqrt(STIFFNESS / float(pair.mass)) / np.pi
        style_of_points: dict[str, Any] = {
            "color": color,
            "markerfacecolor": "white",
            "markersize": 5,
        }
        left.plot(INTEGRATED, points, marker, label="the same, integrated", **style_of_points)
    left.axhline(2 / np.pi, color=style.GREY, linestyle=":", label=r"$2/\omega_0$")
    across, up = r"input restitution $\varepsilon$", r"contact duration $T \omega_0/\pi$"
    left.set(xlabel=across, ylabel=up, title="Linear spring with dashpot", ylim=(0.5, 2.6))
    style.logarithmic_x(left, room=2.0)

    deepest = float(np.asarray(sj.restitution(sj.Hertz(pair), 1.0).peak_overlap))
    overlap = np.linspace(0.0, deepest, 200)
    hertz = np.asarray(sj.Hertz(pair).loading_force(overlap))
    # ½ K δ² = (2/5) k δ^{5/2}: another K for every impact velocity
    spring = 0.8 * float(pair.stiffness) * deepest**0.5 * overlap
    words = r"Hertz, $k\delta^{3/2}$", "linear spring of the same work"
    right.plot(overlap / deepest, hertz / hertz[-1], color=style.BLACK, label=words[0])
    right.plot(overlap / deepest, spring / hertz[-1], "--", color=style.VERMILION, label=words[1])
    across, up = r"overlap $\delta/\delta_\mathrm{max}$", r"force $P/(k\delta_\mathrm{max}^{3/2})$"
    right.set(xlabel=across, ylabel=up, title="Without a dashpot")
    for ax in (left, right):
        ax.legend(frameon=False)
    return figure


def duration(restitution: Float[ArrayLike, "..."], end: str) -> np.ndarray:
    """ω0 T [-] of the law that ε in (0, 1] goes into, in closed form; `end` as the law's."""
    angle = np.arctan2(math.pi, -np.log(restitution))
    return (np.pi if end == "zero-overlap" else 2 * angle) / np.sin(angle)
