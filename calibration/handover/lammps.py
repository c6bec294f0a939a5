"""LAMMPS: input lines for what it has, a plugin for the rest.

    linear, hertz-dashpot, viscoelastic    pair_style granular
    any other law                          pair_style softjax, a plugin around the C header

"Restitution in, restitution out" fails by the end of the contact (`limit_damping` gives more than
is asked), by the version (Tsuji's damping lacks a √2) and by the unit (damping over mass, 1/s and
1/(s m)). Measured with the release of 22 July 2025; see tests.
"""

import math
from typing import Any

import numpy as np
from scipy.optimize import brentq

import softjax as sj
from calibration.errors import DataError, InputError
from calibration.handover.choice import HEADER, INPUT, ITSELF, Carrier
from calibration.handover.exported import Draft
from calibration.handover.templates import commented, filled, template, walled
from calibration.handover.wanted import number_of
from softjax.laws.linear_dashpot import damping_fraction

OLDEST = 20220623  # the oldest version looked at: it has limit_damping
LATEST = 20250722  # taken where none is told
COEFF_RESTITUTION = 20240627  # the first release that has it
TSUJI_MENDED = 20260730  # the √2 is in the source since the day before
CARRIERS = {
    "linear": Carrier(INPUT, of_mass_before=COEFF_RESTITUTION),  # by a damping over mass till then
    "hertz-dashpot": Carrier(INPUT),
    "viscoelastic": Carrier(INPUT, of_mass=True),
    "walton-braun": Carrier(HEADER),
    ITSELF: Carrier(HEADER),
}
REFUSED: dict[str, tuple[str, str]] = {}
FILES = ("in.softjax", "softjax_law.h", "softjax_lammps.cpp", "softjax_memory.h", "build.sh")
# α of Tsuji's damping over ε, by the polynomial that LAMMPS takes
TSUJI = (1.2728, -4.2783, 11.087, -22.348, 27.467, -18.022, 4.8218)
FRICTIONLESS = "tangential linear_nohistory 0.0 0.0"


def files(draft: Draft) -> dict[str, str]:
    """The files of an export by name."""
    choice, version = draft.choice, _checked(draft.version)
    values = {"comment": commented(draft.notes), "step": choice.step}
    if choice.carrier.name == HEADER:
        values |= {
            "needs": "plugin load ./softjaxplugin.so  # made by: sh build.sh",
            "style": "softjax",
            "coefficients": "",
        }
        values |= walled("softjax/wall zplane 0.0 NULL", draft.wanted.on_wall)
        written = {"softjax_law.h": draft.header, "build.sh": template("build.sh.in")}
        written |= {"softjax_lammps.cpp": template("lammps.cpp.in")}
        written |= {"softjax_memory.h": template("lammps_memory.h.in")}
        return written | {"in.softjax": filled("in.lammps.in", values)}
    coefficients = coefficients_of(draft.law, version)
    values |= {
        "needs": "comm_modify vel yes",
        "style": "granular",
        "coefficients": f" {coefficients}",
    }
    values |= walled(f"wall/gran granular {coefficients} zplane 0.0 NULL", draft.wanted.on_wall)
    return {"in.softjax": filled("in.lammps.in", values)}


def _checked(version: int | None) -> int:
    if version is None:
        return LATEST
    if not OLDEST <= version <= 99991231:
        raise DataError("version", version, f"the date of a LAMMPS release, {OLDEST} or later")
    return version


def coefficients_of(law: Any, version: int = LATEST) -> str:
    """A damped law as the arguments of `pair_coeff * *` of pair style granular."""
    contact = law.contact
    clamp = " limit_damping" if law.end == "zero-force" else ""
    if isinstance(law, sj.ViscoelasticHertz):
        # P_d = eta0 M a delta', a = sqrt(R delta)
        eta = 2 * number_of(contact.youngs_modulus) * number_of(law.dissipation_time)
        model, damping = (
            f"hertz {_hertz(contact)!r} {eta / number_of(contact.mass)!r}",
            "viscoelastic",
        )
    else:
        linear = isinstance(law, sj.LinearSpringDashpot)
        spring = f"hooke {number_of(law.stiffness)!r}" if linear else f"hertz {_hertz(contact)!r}"
        value, damping = _damping(law, version)
        model = f"{spring} {value!r}"
    return f"{model} {FRICTIONLESS} damping {damping}{clamp}"


def _hertz(contact: sj.Contact) -> float:
    """k/√R [Pa], of the normal model hertz."""
    return 4 / 3 * number_of(contact.youngs_modulus)


def _damping(law: Any, version: int) -> tuple[float, str]:
    """The coefficient of a dashpot whose ε is one at all velocities, and its damping model."""
    if version >= COEFF_RESTITUTION:
        return number_of(law.restitution), "coeff_restitution"
    fraction = number_of(damping_fraction(law.restitution))
    if isinstance(law, sj.LinearSpringDashpot):
        frequency = math.sqrt(number_of(law.stiffness) / number_of(law.contact.mass))
        return 2 * fraction * frequency, "mass_velocity"
    root = math.sqrt(2) if version >= TSUJI_MENDED else 1.0
    return _into_tsuji(math.sqrt(5) * fraction / root), "tsuji"


def _into_tsuji(alpha: float) -> float:
    """The ε to ask for, so that the polynomial gives α."""
    if alpha > TSUJI[0]:
        problem = f"LAMMPS' Tsuji damping ends at α = {TSUJI[0]}, but {alpha:.4g} is needed"
        raise InputError(None, None, problem, f"a LAMMPS of {COEFF_RESTITUTION} or later has more")
    return brentq(lambda e: _polynomial(e) - alpha, 0.0, 1.0) if alpha > _polynomial(1.0) else 1.0


def _polynomial(restitution: float) -> float:
    return float(np.polynomial.polynomial.polyval(restitution, TSUJI))
