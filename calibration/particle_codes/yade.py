"""YADE: materials and functors for what it has, the C header for the rest.

    linear          ViscElMat, whose kn and cn of two bodies act in series
    hertz-dashpot   MindlinPhys with `betan`
    walton-braun    LudingMat, where k2 grows from k1

All of its contacts end where the force vanishes: `en` of MindlinPhys means that, `en` of ViscElMat
does not. Measured with 2023.02a; see tests.
"""

import math
from typing import Any

import softjax as sj
from calibration.particle_codes.choice import DAMPED, INPUT, Backend
from calibration.particle_codes.report import Export
from calibration.particle_codes.surrogates import growth_of
from calibration.particle_codes.target import number_of
from calibration.particle_codes.templates import rendered
from softjax.laws.linear_dashpot import damping_fraction

BACKENDS = {
    "linear": Backend(INPUT, of_mass=True, fewest=DAMPED),
    "hertz-dashpot": Backend(INPUT, fewest=DAMPED),
    # LudingMat steps by another scheme: 0.030 off at 10 steps, 0.0019 at 40; and ε is 1.00 at a wall
    "walton-braun": Backend(INPUT, from_loading=True, fewest=40, scheme_error=3.2, at_walls=False),
}
PREFIXED = False
REFUSED = {
    "zhou": ("YADE has no law like Zhou's", "--export-law auto, or --to lammps"),
    "viscoelastic": ("YADE has no viscoelastic spheres", "--export-law auto, or --to lammps"),
}


def file_names(prefix: str) -> tuple[str, ...]:
    """Of all files that may be written."""
    return (f"{prefix}_yade.py",)


def files(export: Export, header: str) -> dict[str, str]:
    """The files of an export by name."""
    values = functors_of(export.code_law, export.poisson_ratio, export.peak)
    return {"softjax_yade.py": rendered("yade.py.in", export=export, **values, **_example(export))}


def _example(export: Export) -> dict[str, Any]:
    """A ball that hits a wall, or a like ball: of the mass that damping is written for."""
    target, wall = export.target, bool(export.target.on_wall)
    like = 1 if wall else 2  # radius and mass over the effective ones
    radius = like * number_of(target.contact.radius)
    density = like * number_of(target.contact.mass) / (4 / 3 * math.pi * radius**3)
    height = radius * (0.1 + like)
    speed = math.sqrt(target.range[0] * target.range[1])
    return {"wall": wall, "radius": radius, "density": density, "height": height, "speed": speed}


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
