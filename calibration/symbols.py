"""Symbols and units of parameters, for text and pictures."""

import re
from collections.abc import Iterable
from typing import Any, NamedTuple

from calibration.fitting.laws import CONTACT_LEAVES, LAWS, OF_CONTACT
from softjax.fields import NO_UNIT


class Symbol(NamedTuple):
    """A letter and the unit of what it stands for."""

    text: str
    unit: str = ""

    @property
    def label(self) -> str:
        """`A [s]`: with the unit where there is one."""
        return self.text + (f" [{self.unit}]" if self.unit else "")


MATH = {
    "χ̃": r"$\tilde\chi$",
    "ν": r"$\nu$",
    "ρ": r"$\rho$",
    "σ": r"$\sigma$",
    "ψ": r"$\psi$",
    "ε": r"$\varepsilon$",
    "ε_up": r"$\varepsilon_\mathrm{up}$",
    "v_lim": r"$v_\mathrm{lim}$",
    "v_cr": r"$v_\mathrm{cr}$",
    "p_y/Y": r"$p_y/Y$",
    "k1": "$k_1$",
    "k20": "$k_{20}$",
    "c1": "$c_1$",
    "c2": "$c_2$",
}
WORDS = {  # what a parameter is, where the law's field says less
    "chi": "unloading factor, how steeply the plastic part of the force unloads (Eq. 11)",
    "sigma": "size of the acoustic and thermal losses (Eq. 17)",
    "psi": "exponent of these losses, how fast they grow with the velocity (Eq. 17)",
    "eps_up": "restitution at first yield, Eq. (17) at v_cr: all that σ and ψ do above it",
    "critical_velocity": "velocity of first yield, from the bodies",
    "yield_ratio": "effective modulus over yield strength",
    "c1": "χ̃ at E/Y = 0 (Eq. 18)",
    "c2": "slope of χ̃ over E/Y (Eq. 18)",
    "limit_velocity": "velocity at which nothing rebounds, √(3 Y/ρ) if not given",
    "air_drag": "what the drag coefficient of flights in air is off by, in parts (0 ± 0.1 before)",
    "yield_factor": "pressure at yield over yield strength",
    "loading_stiffness": "stiffness of loading",
    "unloading_stiffness": "stiffness of unloading after the slowest impacts",
    "growth": "growth of the unloading stiffness with the largest force",
    "dissipation_time": "relaxation time of the viscous part of the force",
    "youngs_modulus": "effective modulus of the pair",
    "radius": "effective radius of the pair",
    "mass": "effective mass of the pair",
    "yield_strength": "yield strength",
}
DERIVED = {"critical_velocity": ("v_cr", "m/s"), "eps_up": ("ε_up", ""), "yield_ratio": ("E/Y", "")}
DERIVED |= {"chi": ("χ̃", ""), "sigma": ("σ", ""), "psi": ("ψ", "")}
LETTERS = {"chi squared": "χ²"} | {n: DERIVED[n][0] for n in ("chi", "sigma", "psi", "eps_up")}


def symbol(name: str, model: Any = None) -> Symbol:
    """Symbol and unit of a law's parameter, as its field declares."""
    leaf = name.removeprefix(OF_CONTACT)
    declared = None if model is None else model.parameters.get(name)
    if declared is None and leaf in CONTACT_LEAVES:
        declared = CONTACT_LEAVES[leaf]
    letter, unit = DERIVED.get(name, (name, ""))
    if declared is not None and declared.symbol:
        letter, unit = declared.symbol, declared.unit
    return Symbol(letter, "" if unit in NO_UNIT else unit)


def in_math(written: str) -> str:
    """A symbol for matplotlib, with the text after it ("E wall", "χ̃[nylon]")."""
    letter = written.partition(" ")[0].partition("[")[0]
    plain = f"${letter}$" if len(letter) == 1 and letter.isascii() else letter.replace("_", " ")
    return MATH.get(letter, plain) + written.removeprefix(letter)


def model_of(label: str, result: Any) -> Any:
    """The law that a label of a fit, such as "chi[nylon]", is a parameter of; None without a fit."""
    owner = label.removesuffix("]").partition("[")[2]
    fits = [] if result is None else [f for f in result.materials if owner in ("", f.name)]
    return (fits or result.materials)[0].model if result is not None else None


def of_label(label: str, result: Any) -> str:
    """A label of a fit, such as "chi[nylon]", as tables write it: χ̃[nylon]."""
    name, bracket, owner = label.partition("[")
    return symbol(name, model_of(label, result)).text + bracket + owner


def written(text: str, models: Iterable[Any] = ()) -> str:
    """A sentence with symbols for names of parameters: χ̃ for chi, χ² for chi squared.

    Other names are replaced where an underscore sets them apart from words.
    """
    letters = LETTERS | {n: symbol(n, m).text for m in models for n in m.parameters if "_" in n}
    names = "|".join(map(re.escape, letters))
    return re.sub(rf"(?<![\w`-])({names})(?![\w`-])", lambda name: letters[name[0]], text)


def words(name: str, model: Any = None) -> str:
    """Meaning of a parameter; empty if its law does not give one."""
    leaf = name.removeprefix(OF_CONTACT)
    declared = None if model is None else model.parameters.get(name)
    what = "" if declared is None or declared.what == "number" else declared.what
    built_in = model is None or model.key in LAWS or leaf in CONTACT_LEAVES
    return WORDS.get(leaf, what) if built_in else what


WHOSE = {"wall": "the wall's ", "second": "the second sphere's ", "contact": "the pair's "}
INPUTS = {"youngs_modulus": "Young's modulus", "poisson_ratio": "Poisson's ratio"}
INPUTS |= {"height_offset": "zero of heights", "height_scale": "scale of heights"}
INPUTS |= {"velocity_scale": "scale of velocities", "time_scale": "scale of times"}


def input_words(name: str) -> str:
    """An input of a measurement in words: "the wall's yield strength"."""
    owner, _, key = name.rpartition(".")
    return WHOSE.get(owner, "the ") + INPUTS.get(key, key.replace("_", " "))
