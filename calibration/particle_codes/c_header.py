"""A contact law as a C header: force, stiffness, one contact's memory.

Lengths and forces of the library's own laws are in proportion to the sizes of the bodies, which
the header takes at run time: one serves all sizes of a pair of materials. How a user's law
depends on them is not known, so that its table (`c_table`) is of one pair of sizes.
"""

from typing import Any

import numpy as np

import softjax as sj
from calibration.particle_codes.c_table import PANELS
from calibration.particle_codes.target import end_of, number_of
from calibration.particle_codes.templates import rendered
from softjax.fields import numbers_of
from softjax.laws.linear_dashpot import damping_fraction

FORMULAS = {
    sj.Zhou: "zhou.h",
    sj.Thornton: "thornton.h",
    sj.WaltonBraun: "walton_braun.h",
    sj.LinearSpringDashpot: "linear.h",
    sj.HertzDashpot: "hertz_dashpot.h",
    sj.ViscoelasticHertz: "viscoelastic.h",
}


def header_of(
    law: Any,
    notes: tuple[str, ...],
    velocity_range: tuple[float, float],
    step: float,
    table: dict[str, Any] | None = None,
    *,
    softening_factor: float = 1.0,
    losses: bool = True,
    prefix: str = "softjax",
    hold: float = 0.0,
) -> str:
    """The header of a law with a force.

    Args:
        notes: the first lines of its comment.
        velocity_range: the impact velocities [m/s] that it is for.
        step: the time step [s] that it was tested with.
        table: of a user's law, by `c_table`.
        softening_factor: overlaps grow by this factor and forces fall by it, at the same energies.
        losses: whether what is in ε and in no force, Eq. (17), is taken off the unloading force.
        prefix: of all names, so that several headers fit into one program.
        hold: the fraction of critical damping that holds ε below the range, 0 where nothing does.
    """
    if type(law) is sj.Hertz:  # the dashpot that takes nothing
        law = sj.HertzDashpot(law.contact, 1.0)
    name = FORMULAS.get(type(law), "table.h")
    values = _values(law, losses) if table is None else dict(table)
    independent = isinstance(law, sj.RateIndependentLaw)
    values |= {
        "name": name,
        "end": None if independent else end_of(law),
        "panels": 1 if table is None else PANELS,
    }
    values |= {"hold": hold, "hold_below": velocity_range[0] if hold else 0.0}
    values |= {
        "slowest": 0.0 if hold else velocity_range[0],
        "fastest": velocity_range[1],
        "step": step,
    }
    text = rendered("law.h", notes=notes, softening_factor=float(softening_factor), **values)
    return text.replace("softjax_", f"{prefix}_").replace("SOFTJAX_", f"{prefix.upper()}_")


def is_tabulated(law: Any) -> bool:
    """Whether a law goes by a table of its forces."""
    return type(law) not in FORMULAS and type(law) is not sj.Hertz


def _values(law: Any, losses: bool) -> dict[str, Any]:
    """Fields of a law and of its contact by their names, and the other values of its template."""
    values: dict[str, Any] = {name: number_of(leaf) for name, leaf in numbers_of(law).items()}
    if "restitution" in values:
        values["damping"] = number_of(damping_fraction(law.restitution))
    if isinstance(law, sj.Zhou | sj.Thornton):  # overlap and force of first yield over R and R²
        values["overlap"] = number_of(law.scales().overlap) / values["radius"]
        values["force"] = number_of(law.force_scale()) / values["radius"] ** 2
    if isinstance(law, sj.Zhou):
        compact = np.sqrt(values["mass"] / values["radius"] ** 3).item()
        values |= {
            "d": number_of(law.plasticity()),
            "x": values["chi"] * number_of(law.contact.yield_ratio),
            "velocity": number_of(law.contact.critical_velocity) * compact,
            "losses": int(losses),
            "form": law.form,
        }
    return values
