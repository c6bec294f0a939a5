"""The files of an export: input lines of a particle code, or a C header, from `templates`.

Lengths and forces of the library's own laws are in proportion to the sizes of the bodies, which a header
takes at run time: one serves all sizes of a pair of materials.
"""

import math
import re
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

import softjax as sj
from calibration.errors import InputError
from calibration.particle_codes.c_table import FORMULAS
from calibration.particle_codes.codes import HEADER
from calibration.particle_codes.report import Export
from calibration.particle_codes.steps import held_below
from calibration.particle_codes.surrogates import softened
from calibration.particle_codes.target import number_of, with_contact
from softjax.fields import numbers_of
from softjax.laws.dashpots import damping_fraction
from softjax.many_body import end_of

PLUGIN = {"softjax_lammps.cpp": "lammps.cpp", "build.sh": "build.sh"}
LIBRARY = "softjaxplugin.so"  # that build.sh makes
# templates of input lines by code, and the name of the file; a header is PREFIX_law.h
INPUTS = {
    "lammps": ("in.script", "in.{}"),
    "liggghts": ("in.script", "in.{}"),
    "yade": ("yade.py.in", "{}_yade.py"),
}
LEAST = 0.05  # that LIGGGHTS takes
BEYOND = 2.0  # the overlap up to which k2 grows from k1, over the largest of the range


def files_of(export: Export) -> dict[str, str]:
    """The files of an export by name."""
    choice, options, target = export.choice, export.options, export.target
    plugin, name_of_law = choice.backend.name == HEADER, ""
    files = {}
    if plugin:
        files[f"{options.prefix}_law.h"] = header = _header(export)
        name_of_law = name_in(header)
    if export.to not in INPUTS:
        return files
    pairs = {" ".join(map(str, options.types or ("*", "*"))): choice.law}
    if choice.backend.of_mass and target.pairs:
        pairs = {
            "{} {}".format(*pair.types): with_contact(choice.law, pair.contact)
            for pair in target.pairs
        }
    law: dict[str, float] = {}
    if plugin:
        files |= {name: rendered(template) for name, template in PLUGIN.items()}
    else:
        softer = {types: softened(law, choice.softening_factor) for types, law in pairs.items()}
        pairs = {types: numbers_of_input(export, law) for types, law in softer.items()}
        law = numbers_of_input(export, softened(choice.law, choice.softening_factor))
    if (export.to, choice.key) == ("liggghts", "hertz-dashpot") and law["restitution"] <= LEAST:
        problem = f"LIGGGHTS takes no coefficientRestitution of {law['restitution']:.3g}"
        raise InputError(None, None, problem, f"above {LEAST}, or --export-law linear")
    template, name = INPUTS[export.to]
    values = {"plugin": plugin, "prefix": options.prefix, "pairs": pairs, "law": law, "pi": math.pi}
    values |= {"name_of_law": name_of_law}
    return {name.format(options.prefix): rendered(template, export=export, **values), **files}


def numbers_of_input(export: Export, law: Any) -> dict[str, float]:
    """Numbers of a law in input lines [SI], by the names of their templates."""
    poisson_ratio = export.target.poisson_ratio
    names = ("radius", "mass", "youngs_modulus")
    radius, mass, modulus = (number_of(getattr(law.contact, name)) for name in names)
    numbers = {
        "radius": radius,
        "mass": mass,
        "poisson_ratio": poisson_ratio,
        "youngs_modulus": 2 * (1 - poisson_ratio**2) * modulus,  # of two like bodies [Pa]
        "hertz": 4 / 3 * modulus,  # k/√R [Pa]
    }
    if isinstance(law, sj.ViscoelasticHertz):  # η0 of the dashpot η0 M √(R δ) δ' [1/(s m)]
        return numbers | {"damping": 2 * modulus * number_of(law.dissipation_time) / mass}
    if isinstance(law, sj.WaltonBraun):
        stiffness = number_of(law.loading_stiffness)
        end = BEYOND * float(np.max(export.choice.impacts.peak))  # of the growth of k2 [m]
        growth = 1 + number_of(law.growth) * end
        scale = 16 / 15 * math.sqrt(radius) * modulus
        return numbers | {
            "stiffness": stiffness,  # k1 [N/m]
            "most": growth,  # k_p/k1
            "depth": end * (growth - 1) / growth / (2 * radius),  # of plasticity, over the radii
            # V of k1 = 16/15 √R E [15 M V²/(16 √R E)]^{1/5} [m/s]
            "velocity": math.sqrt((stiffness / scale) ** 5 * scale / mass),
        }
    fraction = number_of(damping_fraction(law.restitution))  # of critical damping
    numbers |= {"restitution": number_of(law.restitution), "fraction": fraction}
    if isinstance(law, sj.LinearSpringDashpot):
        stiffness = number_of(law.stiffness)
        numbers |= {"stiffness": stiffness, "damping": 2 * fraction * math.sqrt(stiffness / mass)}
    return numbers


def _header(export: Export) -> str:
    """A law with a force as a C header: force, stiffness, one contact's memory."""
    law, prefix, table = export.law, export.options.prefix, export.choice.table
    if type(law) is sj.Hertz:  # the dashpot that takes nothing
        law = sj.HertzDashpot(law.contact, 1.0)
    text = rendered(
        "law.h",
        **(_values(law, export.options.losses) if table is None else table),
        export=export,
        held_below=held_below(export.target.range[0], export.choice.steps.count),
        name=FORMULAS.get(type(law), "table.h"),
        kind=type(law).__name__,
        end=None if isinstance(law, sj.RateIndependentLaw) else end_of(law),
    )
    text = text.replace("prefix softjax:", f"prefix {prefix}:")
    text = text.replace("softjax_", f"{prefix}_").replace("SOFTJAX_", f"{prefix.upper()}_")
    acting = text.partition("*/")[2] + rendered(PLUGIN["softjax_lammps.cpp"])
    return text.replace("@hash@", sha256(acting.encode()).hexdigest()[:8])


def name_in(header: str) -> str:
    """The name of a law, with the hash of its numbers and its source, that no other one answers to."""
    (name,) = re.findall('_LAW "([a-z0-9_]+)"', header)
    return name


def _values(law: Any, losses: bool) -> dict[str, Any]:
    """Fields of a law and of its contact by their names, and the other values of its template."""
    values: dict[str, Any] = {name: number_of(leaf) for name, leaf in numbers_of(law).items()}
    values["panels"] = 1
    if "restitution" in values:
        values["damping"] = number_of(damping_fraction(law.restitution))
    if isinstance(law, sj.Zhou | sj.Thornton):  # overlap and force of first yield over R and R²
        values["overlap"] = number_of(law.scales().overlap) / values["radius"]
        values["force"] = number_of(law.force_scale()) / values["radius"] ** 2
    if isinstance(law, sj.Zhou):
        compact = math.sqrt(values["mass"] / values["radius"] ** 3)
        values |= {
            "d": number_of(law.plasticity()),
            "x": values["chi"] * number_of(law.contact.yield_ratio),
            "velocity": number_of(law.contact.critical_velocity) * compact,
            "losses": int(losses),
            "form": law.form,
        }
    return values


def rendered(name: str, /, **values: Any) -> str:
    """A template with its values; numbers keep all their digits."""
    return _environment().get_template(name).render(values)


@cache
def _environment() -> Any:
    import jinja2

    return jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).with_name("templates")),
        finalize=lambda value: repr(value) if isinstance(value, float) else value,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
