"""How parameters are written: in text, and in pictures; their units."""

from typing import Any, NamedTuple

from calibration.errors import printable
from calibration.fitting.law_model import CONTACT_LEAVES, OF_CONTACT


class Symbol(NamedTuple):
    text: str
    math: str  # for matplotlib
    unit: str = ""


MATH = {
    "χ̃": r"$\tilde\chi$",
    "μ": r"$\mu$",
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
DERIVED = {"critical_velocity": ("v_cr", "m/s"), "eps_up": ("ε_up", ""), "yield_ratio": ("E/Y", "")}
DERIVED |= {"chi": ("χ̃", ""), "sigma": ("σ", ""), "psi": ("ψ", "")}


def symbol(name: str, model: Any = None) -> Symbol:
    """How a parameter of a law is written: as the law's field of that name declares."""
    leaf = name.removeprefix(OF_CONTACT)
    declared = None if model is None else model.parameters.get(name)
    if declared is None and leaf in CONTACT_LEAVES:
        declared = CONTACT_LEAVES[leaf]
    if declared is not None and declared.symbol:
        letter, unit = declared.symbol, declared.unit
    else:
        letter, unit = DERIVED.get(name, (name, ""))
    return Symbol(letter, in_math(letter), "" if unit == "-" else unit)


def in_math(written: str) -> str:
    """A symbol for matplotlib; what stands behind it ("E wall", "χ̃[nylon]") is kept."""
    letter = written.partition(" ")[0].partition("[")[0]
    plain = f"${letter}$" if len(letter) == 1 and letter.isascii() else letter.replace("_", " ")
    return MATH.get(letter, plain) + written.removeprefix(letter)


def text(name: str, model: Any = None) -> str:
    """`χ̃` for chi, with the unit where there is one: `A [s]`."""
    one = symbol(name, model)
    return one.text + (f" [{one.unit}]" if one.unit else "")


def math(label: str, model: Any = None, unit: bool = True) -> str:
    """The same for matplotlib; of `chi[nylon]` the data set's name behind a comma."""
    name, _, owner = label.partition("[")
    one = symbol(name, model)
    # between dollars are formulas
    shown = printable(owner.removesuffix("]")).replace("$", r"\$")
    name = f"{one.math}, {shown}" if owner else one.math
    return name + (f" [{one.unit}]" if unit and one.unit else "")
