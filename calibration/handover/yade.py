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
from calibration.handover.softer import growth_of
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


def files(draft: Draft) -> dict[str, str]:
    """The files of an export by name."""
    values: dict[str, Any] = {"comment": commented(draft.notes), "step": draft.choice.step}
    if draft.choice.carrier.name == HEADER:
        return {
            "softjax_yade.py": filled("yade_header.py.in", values),
            "softjax_law.h": draft.header,
            "softjax_shared.c": template("shared.c.in"),
        }
    values |= functors_of(draft.law, draft.poisson_ratio, draft.peak)
    return {"softjax_yade.py": filled("yade.py.in", values)}


def functors_of(law: Any, poisson_ratio: float, peak: float) -> dict[str, str]:
    """A law as Python source: material, its functor and the law's."""
    if isinstance(law, sj.LinearSpringDashpot):
        stiffness, mass = number_of(law.stiffness), number_of(law.contact.mass)
        damping = 2 * number_of(damping_fraction(law.restitution)) * math.sqrt(stiffness * mass)
        material = f"ViscElMat(kn={2 * stiffness!r}, cn={2 * damping!r}, ks=0.0, cs=0.0, "
        return _functors(material, "ViscElMat", "", "ViscElPhys", "ViscElPhys_Basic")
    if isinstance(law, sj.WaltonBraun):
        loading, (most, depth) = number_of(law.loading_stiffness), growth_of(law, peak)
        numbers = f"k1={loading!r}, kp={most * loading!r}, PhiF={depth!r}"
        material = f"LudingMat({numbers}, kc=0.0, ks=0.0, G0=0.0, "
        return _functors(material, "LudingMat", "", "LudingPhys", "LudingPhys_Basic")
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
