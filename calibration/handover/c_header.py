"""A contact law as a C header: force, stiffness, one contact's memory.

Lengths and forces of the library's own laws are in proportion to the sizes of the bodies, which
the header takes at run time: one serves all sizes of a pair of materials. How a law of one's own
goes with them is not known, so that its table (`c_table`) is of one pair of sizes.
"""

from typing import Any, NamedTuple

import numpy as np

import softjax as sj
from calibration.handover.c_table import force_error, source_of, table_of
from calibration.handover.forces import end_of
from calibration.handover.templates import filled, template
from calibration.handover.wanted import number_of
from softjax.fields import numbers_of
from softjax.laws.linear_dashpot import damping_fraction

PREFIX = "softjax"
RELEASED = {"zero-force": "!(force > 0)", "zero-overlap": "0"}
ENDS = {
    "zero-force": "never pulls: the contact ends where it vanishes",
    "zero-overlap": "pulls before the overlap vanishes, as the law has it",
}


class Header(NamedTuple):
    """C source, and what interpolating forces costs of the largest force; 0 for formulas."""

    source: str
    interpolation_error: float


def header_of(
    law: Any,
    title: str,
    notes: tuple[str, ...] = (),
    *,
    stretch: float = 1.0,
    losses: bool = True,
    prefix: str = PREFIX,
    fastest: float = 1.0,
) -> Header:
    """The header of a law with a force.

    Args:
        title, notes: the first lines of its comment.
        stretch: overlaps grow by this factor and forces fall by it, at the same energies.
        losses: whether what is in ε and in no force, Eq. (17), is taken off the unloading force.
        prefix: of all names, so that several headers fit into one program.
        fastest: the impact velocity [m/s] up to which a table of forces reaches.
    """
    body, error = _body(law, losses, fastest)
    lines = "\n".join(f" * {line}".rstrip() for line in notes)
    text = filled(
        "law.h.in", {"title": title, "notes": lines, "law": body, "stretch": float(stretch)}
    )
    text = text.replace("softjax_", f"{prefix}_").replace("SOFTJAX_", f"{prefix.upper()}_")
    return Header(text, error)


def _body(law: Any, losses: bool, fastest: float) -> tuple[str, float]:
    if type(law) is sj.Hertz:  # the dashpot that takes nothing
        law = sj.HertzDashpot(law.contact, 1.0)
    if is_tabulated(law):
        table = table_of(law, fastest, losses)
        source, error = source_of(table), force_error(law, table)
    else:
        source, error = filled(FORMULAS[type(law)], _values(law, losses)), 0.0
    if isinstance(law, sj.RateIndependentLaw):
        return filled("rate_independent.h.in", {"body": source}), error
    end = end_of(law)
    ends = {"body": source, "released": RELEASED[end], "ends": ENDS[end]}
    return filled("rate_dependent.h.in", ends), error


def is_tabulated(law: Any) -> bool:
    """Whether a law goes by a table: one derived from a formula's may have other forces."""
    return type(law) not in FORMULAS and type(law) is not sj.Hertz


def _values(law: Any, losses: bool) -> dict[str, Any]:
    """Fields of a law and of its contact by their names, and what else its template asks for."""
    values: dict[str, Any] = {name: number_of(leaf) for name, leaf in numbers_of(law).items()}
    if "restitution" in values:
        values["damping"] = number_of(damping_fraction(law.restitution))
    if isinstance(law, sj.Zhou | sj.Thornton):  # overlap and force of first yield over R and R²
        values["overlap"] = number_of(law.scales().overlap) / values["radius"]
        values["force"] = number_of(law.force_scale()) / values["radius"] ** 2
    if isinstance(law, sj.Zhou):
        contact, form = law.contact, "first_order" if law.form == "first-order" else "full"
        compact = np.sqrt(values["mass"] / values["radius"] ** 3).item()
        values |= {
            "d": number_of(law.plasticity()),
            "x": values["chi"] * number_of(contact.yield_ratio),
            "velocity": number_of(contact.critical_velocity) * compact,
            "losses": int(losses),
            "form": template(f"zhou_{form}.h.in"),
            "work": template(f"zhou_{form}_work.h.in"),
        }
    return values


FORMULAS = {
    sj.Zhou: "zhou.h.in",
    sj.Thornton: "thornton.h.in",
    sj.WaltonBraun: "walton_braun.h.in",
    sj.LinearSpringDashpot: "linear.h.in",
    sj.HertzDashpot: "hertz_dashpot.h.in",
    sj.ViscoelasticHertz: "viscoelastic.h.in",
}
