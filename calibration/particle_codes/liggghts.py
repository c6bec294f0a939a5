"""LIGGGHTS: input lines for what it has.

    linear          model hooke/stiffness
    hertz-dashpot   model hertz
    walton-braun    model hooke/hysteresis, where k2 grows from k1

`limitForce on` ends a contact where its force vanishes and gives a larger ε than requested. A modulus
above 1 GPa needs `hard_particles yes`. Measured with 3.8.0; see tests.
"""

import math
from typing import Any

import softjax as sj
from calibration.errors import InputError
from calibration.particle_codes.choice import DAMPED, INPUT, Backend
from calibration.particle_codes.report import Export
from calibration.particle_codes.surrogates import growth_of
from calibration.particle_codes.target import number_of
from calibration.particle_codes.templates import rendered
from softjax.laws.linear_dashpot import damping_fraction

BACKENDS = {
    "linear": Backend(INPUT, of_mass=True, fewest=DAMPED),
    "hertz-dashpot": Backend(INPUT, fewest=DAMPED),
    "walton-braun": Backend(INPUT, from_loading=True),
}
PREFIXED = False
REFUSED = {
    "thornton": (
        "Thornton (1997) cannot be written as thornton_ning, which unloads with the old radius: "
        "0.701 for 0.735, 0.259 for 0.282",
        "--export-law auto, or --to c",
    ),
    "zhou": (
        "LIGGGHTS has no law like Zhou's, and loads no plugin",
        "--export-law auto, or --to lammps",
    ),
    "viscoelastic": ("LIGGGHTS has no viscoelastic spheres", "--export-law auto, or --to lammps"),
}
LEAST_RESTITUTION = 0.05  # that the code takes

Properties = dict[str, tuple[str, float]]


def file_names(prefix: str) -> tuple[str, ...]:
    """Of all files that may be written."""
    return (f"in.{prefix}",)


def files(export: Export, header: str) -> dict[str, str]:
    """The files of an export by name."""
    model, properties = model_of(export.code_law, export.poisson_ratio, export.peak)
    name, _, settings = model.partition(" ")  # a wall's settings stand behind its place
    wall = f"wall/gran model {name} primitive type 1 zplane 0.0 {settings}".rstrip()
    values = {"export": export, "model": model, "properties": properties, "wall": wall}
    return {"in.softjax": rendered("in.liggghts", **values)}


def model_of(law: Any, poisson_ratio: float, peak: float) -> tuple[str, Properties]:
    """A law as a model of `pair_style gran` and the properties of one type of atoms."""
    modulus = 2 * (1 - poisson_ratio**2) * number_of(law.contact.youngs_modulus)
    elastic = {
        "youngsModulus": ("peratomtype", modulus),
        "poissonsRatio": ("peratomtype", poisson_ratio),
        "coefficientFriction": _pair(0.0),
    }
    if isinstance(law, sj.LinearSpringDashpot):
        return "hooke/stiffness limitForce on", elastic | _spring(law)
    if isinstance(law, sj.WaltonBraun):
        return "hooke/hysteresis", elastic | _hysteresis(law, peak)
    restitution = number_of(law.restitution)
    if restitution <= LEAST_RESTITUTION:
        problem = f"LIGGGHTS takes no coefficientRestitution of {restitution:.3g}"
        raise InputError(None, None, problem, f"above {LEAST_RESTITUTION}, or --export-law linear")
    return "hertz limitForce on", elastic | {"coefficientRestitution": _pair(restitution)}


def _pair(value: float) -> tuple[str, float]:
    return "peratomtypepair 1", value


def _spring(law: sj.LinearSpringDashpot) -> Properties:
    stiffness = number_of(law.stiffness)
    frequency = math.sqrt(stiffness / number_of(law.contact.mass))
    damping = 2 * number_of(damping_fraction(law.restitution)) * frequency
    return {
        "kn": _pair(stiffness),
        "kt": _pair(0.0),
        "gamman": _pair(damping),
        "gammat": _pair(0.0),
    }


def _hysteresis(law: sj.WaltonBraun, peak: float) -> Properties:
    """k1 by the characteristic velocity, and how k2 grows from it."""
    most, depth = growth_of(law, peak)
    stiffness = number_of(law.loading_stiffness)
    return {
        "coefficientRestitution": _pair(1.0),
        "characteristicVelocity": ("scalar", _characteristic_velocity(law.contact, stiffness)),
        "coefficientMaxElasticStiffness": _pair(most),
        "coefficientAdhesionStiffness": _pair(0.0),
        "coefficientPlasticityDepth": _pair(depth),
    }


def _characteristic_velocity(contact: sj.Contact, stiffness: float) -> float:
    """V of k = 16/15 √R E [15 M V²/(16 √R E)]^{1/5}."""
    scale = 16 / 15 * math.sqrt(number_of(contact.radius)) * number_of(contact.youngs_modulus)
    return math.sqrt((stiffness / scale) ** 5 * scale / number_of(contact.mass))
