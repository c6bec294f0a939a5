"""LAMMPS: input lines for what it has, a plugin for the rest.

    linear, hertz-dashpot, viscoelastic    pair_style granular
    any other law                          pair_style softjax, a plugin around the C headers of a folder

"Restitution in, restitution out" fails by the end of the contact (`limit_damping` gives a larger one
than requested) and by the unit (damping over mass, 1/s and 1/(s m)). Releases since 27 June 2024, the first with
`coeff_restitution`; measured with that of 22 July 2025: see tests.
"""

from typing import Any

import softjax as sj
from calibration.particle_codes.choice import DAMPED, EXACT, HEADER, INPUT, Backend
from calibration.particle_codes.report import Export
from calibration.particle_codes.surrogates import softened
from calibration.particle_codes.target import number_of, with_contact
from calibration.particle_codes.templates import rendered

BACKENDS = {
    "linear": Backend(INPUT, fewest=DAMPED),
    "hertz-dashpot": Backend(INPUT, fewest=DAMPED),
    "viscoelastic": Backend(INPUT, of_mass=True, fewest=DAMPED, lines_of_pairs=True),
    "walton-braun": Backend(HEADER),
    EXACT: Backend(HEADER),
}
REFUSED: dict[str, tuple[str, str]] = {}
PREFIXED = True


def file_names(prefix: str) -> tuple[str, ...]:
    """Of all files that may be written."""
    return (f"in.{prefix}", f"{prefix}_law.h", "softjax_lammps.cpp", "build.sh")


def files(export: Export, header: str) -> dict[str, str]:
    """The files of an export by name."""
    prefix = export.options.prefix
    plugin = export.choice.backend.name == HEADER
    coefficients = prefix if plugin else coefficients_of(export.code_law)
    wall = f"softjax/wall {prefix}" if plugin else f"wall/gran granular {coefficients}"
    types = " ".join(map(str, export.options.types or ("*", "*")))
    pairs = {types: coefficients}
    if export.choice.backend.of_mass and export.target.pairs:
        law, factor = export.choice.law, export.choice.softening_factor
        pairs = {
            f"{i} {j}": coefficients_of(softened(with_contact(law, contact), factor))
            for i, j, contact in export.target.pairs
        }
    text = rendered(
        "in.lammps",
        export=export,
        plugin=plugin,
        pairs=pairs,
        wall=f"{wall} zplane 0.0 NULL",
        fix="softjax_wall" if prefix == "softjax" else f"softjax_wall_{prefix}",
    )
    if not plugin:
        return {f"in.{prefix}": text}
    sources = {"softjax_lammps.cpp": rendered("lammps.cpp"), "build.sh": rendered("build.sh")}
    return {f"in.{prefix}": text, f"{prefix}_law.h": header, **sources}


def coefficients_of(law: Any) -> str:
    """A damped law as the arguments of `pair_coeff * *` of pair style granular."""
    contact = law.contact
    hertz = 4 / 3 * number_of(contact.youngs_modulus)  # k/√R [Pa], of the normal model hertz
    clamp = " limit_damping" if law.end == "zero-force" else ""
    if isinstance(law, sj.ViscoelasticHertz):
        # P_d = eta0 M a delta', a = sqrt(R delta)
        eta = 2 * number_of(contact.youngs_modulus) * number_of(law.dissipation_time)
        model, damping = f"hertz {hertz!r} {eta / number_of(contact.mass)!r}", "viscoelastic"
    else:
        linear = isinstance(law, sj.LinearSpringDashpot)
        spring = f"hooke {number_of(law.stiffness)!r}" if linear else f"hertz {hertz!r}"
        model, damping = f"{spring} {number_of(law.restitution)!r}", "coeff_restitution"
    return f"{model} tangential linear_nohistory 0.0 0.0 damping {damping}{clamp}"
