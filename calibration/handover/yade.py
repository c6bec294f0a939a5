"""YADE: materials and functors for what it has, the C header for the rest.

    linear          ViscElMat, whose kn and cn of two bodies act in series
    hertz-dashpot   MindlinPhys with `betan`
    walton-braun    LudingMat, where k2 grows from k1
    the law itself  by the C header, from a PyRunner: tens of microseconds a contact and step

All of its contacts end where the force vanishes: `en` of MindlinPhys means that, `en` of ViscElMat
does not. Measured with 2023.02a; see tests.
"""

import math
from typing import Any

import softjax as sj
from calibration.handover.choice import HEADER, INPUT, ITSELF, Carrier
from calibration.handover.exported import Draft
from calibration.handover.softer import softened
from calibration.handover.templates import commented, filled, template
from calibration.handover.wanted import number_of
from softjax.laws.linear_dashpot import damping_fraction

CARRIERS = {
    "linear": Carrier(INPUT, of_mass=True),
    "hertz-dashpot": Carrier(INPUT),
    "walton-braun": Carrier(INPUT, from_loading=True),
    ITSELF: Carrier(HEADER),
}
REFUSED = {
    "viscoelastic": ("YADE has no viscoelastic spheres", "--law auto, or --to lammps"),
}
FILES = ("softjax_yade.py", "softjax_law.h", "softjax_shared.c")
POISSON_RATIO = 0.3  # where only the contact is known: the modulus goes with it
BEYOND = 2.0  # the overlap up to which k2 grows, over the largest wanted


def files(draft: Draft) -> dict[str, str]:
    """The files of an export by name."""
    choice, ratio = draft.choice, draft.wanted.poisson_ratio
    values: dict[str, Any] = {"comment": commented(draft.notes), "step": choice.step}
    if choice.carrier.name == HEADER:
        return {
            "softjax_yade.py": filled("yade_header.py.in", values),
            "softjax_law.h": draft.header,
            "softjax_shared.c": template("shared.c.in"),
        }
    law = softened(choice.law, choice.stretch)
    peak = float(choice.impacts.peak[-1]) * choice.stretch
    values |= functors_of(law, POISSON_RATIO if ratio is None else ratio, peak)
    return {"softjax_yade.py": filled("yade.py.in", values)}


def functors_of(law: Any, poisson_ratio: float, peak: float) -> dict[str, str]:
    """A law as Python source: material, its functor and the law's."""
    if isinstance(law, sj.LinearSpringDashpot):
        stiffness, mass = number_of(law.stiffness), number_of(law.contact.mass)
        damping = 2 * number_of(damping_fraction(law.restitution)) * math.sqrt(stiffness * mass)
        material = f"ViscElMat(kn={2 * stiffness!r}, cn={2 * damping!r}, ks=0.0, cs=0.0, "
        return _functors(material, "ViscElMat", "", "ViscElPhys", "ViscElPhys_Basic")
    if isinstance(law, sj.WaltonBraun):
        return _functors(_luding(law, peak), "LudingMat", "", "LudingPhys", "LudingPhys_Basic")
    modulus = 2 * (1 - poisson_ratio**2) * number_of(law.contact.youngs_modulus)
    betan = number_of(damping_fraction(law.restitution)) * math.sqrt(5 / 6)
    material = f"FrictMat(young={modulus!r}, poisson={poisson_ratio!r}, "
    options = ", ".join(
        f"{n}=MatchMaker(algo='val', val={v!r})" for n, v in (("betan", betan), ("betas", 0.0))
    )
    return _functors(material, "FrictMat", options, "MindlinPhys", "MindlinPhys_Mindlin")


def _functors(material: str, kind: str, options: str, physics: str, law: str) -> dict[str, str]:
    return {
        "material": f"{material}frictionAngle=0.0, density=density)",
        "physics": f"Ip2_{kind}_{kind}_{physics}({options})",
        "law": f"Law2_ScGeom_{law}()",
    }


def _luding(law: sj.WaltonBraun, peak: float) -> str:
    """k2 = k1 (1 + s δ) up to `BEYOND` times the peak."""
    loading = number_of(law.loading_stiffness)
    most = 1 + number_of(law.growth) * BEYOND * peak  # k_p/k1
    depth = BEYOND * peak * (most - 1) / most / (2 * number_of(law.contact.radius))
    numbers = f"k1={loading!r}, kp={most * loading!r}, PhiF={depth!r}"
    return f"LudingMat({numbers}, kc=0.0, ks=0.0, G0=0.0, "
