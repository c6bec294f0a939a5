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
        name, values = FORMULAS[type(law)]
        source, error = filled(name, values(law, losses)), 0.0
    if isinstance(law, sj.RateIndependentLaw):
        return filled("rate_independent.h.in", {"body": source}), error
    end = end_of(law)
    ends = {"body": source, "released": RELEASED[end], "ends": ENDS[end]}
    return filled("rate_dependent.h.in", ends), error


def is_tabulated(law: Any) -> bool:
    """Whether a law goes by a table: one derived from a formula's may have other forces."""
    return type(law) not in FORMULAS and type(law) is not sj.Hertz


def _scales(law: Any, losses: bool) -> dict[str, Any]:
    """Overlap and force of first yield over R and R²."""
    radius = number_of(law.contact.radius)
    overlap = number_of(law.scales().overlap) / radius
    return {"overlap": overlap, "force": number_of(law.force_scale()) / radius**2}


def _zhou(law: sj.Zhou, losses: bool) -> dict[str, Any]:
    contact = law.contact
    radius, mass = number_of(contact.radius), number_of(contact.mass)
    form = "first_order" if law.form == "first-order" else "full"
    return _scales(law, losses) | {
        "d": number_of(law.plasticity()),
        "x": number_of(law.chi) * number_of(contact.yield_ratio),
        "velocity": number_of(contact.critical_velocity) * np.sqrt(mass / radius**3).item(),
        "limit": number_of(contact.limit_velocity),
        "sigma": number_of(law.sigma),
        "psi": number_of(law.psi),
        "losses": int(losses),
        "form": template(f"zhou_{form}.h.in"),
        "work": template(f"zhou_{form}_work.h.in"),
    }


def _walton_braun(law: sj.WaltonBraun, losses: bool) -> dict[str, Any]:
    return {
        "loading": number_of(law.loading_stiffness),
        "unloading": number_of(law.unloading_stiffness),
        "growth": number_of(law.growth),
    }


def _linear(law: sj.LinearSpringDashpot, losses: bool) -> dict[str, Any]:
    damping = number_of(damping_fraction(law.restitution))
    return {"stiffness": number_of(law.stiffness), "damping": damping}


def _hertz_dashpot(law: sj.HertzDashpot, losses: bool) -> dict[str, Any]:
    damping = number_of(damping_fraction(law.restitution))
    return {"modulus": number_of(law.contact.youngs_modulus), "damping": damping}


def _viscoelastic(law: sj.ViscoelasticHertz, losses: bool) -> dict[str, Any]:
    modulus = number_of(law.contact.youngs_modulus)
    return {"modulus": modulus, "time": number_of(law.dissipation_time)}


FORMULAS = {
    sj.Zhou: ("zhou.h.in", _zhou),
    sj.Thornton: ("thornton.h.in", _scales),
    sj.WaltonBraun: ("walton_braun.h.in", _walton_braun),
    sj.LinearSpringDashpot: ("linear.h.in", _linear),
    sj.HertzDashpot: ("hertz_dashpot.h.in", _hertz_dashpot),
    sj.ViscoelasticHertz: ("viscoelastic.h.in", _viscoelastic),
}
