"""How parameters are written: in text, and in pictures; their units."""

from typing import NamedTuple


class Symbol(NamedTuple):
    text: str
    math: str  # for matplotlib
    unit: str = ""


SYMBOLS = {
    "chi": Symbol("χ̃", r"$\tilde\chi$"),
    "sigma": Symbol("σ", r"$\sigma$"),
    "psi": Symbol("ψ", r"$\psi$"),
    "eps_up": Symbol("ε_up", r"$\varepsilon_\mathrm{up}$"),
    "c1": Symbol("c1", "$c_1$"),
    "c2": Symbol("c2", "$c_2$"),
    "yield_strength": Symbol("Y", "$Y$", "Pa"),
    "youngs_modulus": Symbol("E", "$E$", "Pa"),
    "yield_ratio": Symbol("E/Y", "$E/Y$"),
    "limit_velocity": Symbol("v_lim", r"$v_\mathrm{lim}$", "m/s"),
    "critical_velocity": Symbol("v_cr", r"$v_\mathrm{cr}$", "m/s"),
    "restitution": Symbol("ε", r"$\varepsilon$"),
}


def text(label: str) -> str:
    """`χ̃` for chi, `χ̃[nylon]` for chi[nylon], with the unit where there is one."""
    symbol, owner = _split(label)
    return symbol.text + owner + (f" [{symbol.unit}]" if symbol.unit else "")


def math(label: str, unit: bool = True) -> str:
    """The same for matplotlib, the data set's name behind a comma."""
    symbol, owner = _split(label)
    name = f"{symbol.math}, {owner[1:-1]}" if owner else symbol.math
    return name + (f" [{symbol.unit}]" if unit and symbol.unit else "")


def _split(label: str) -> tuple[Symbol, str]:
    name, bracket, owner = label.partition("[")
    return SYMBOLS.get(name, Symbol(name, name.replace("_", " "))), bracket + owner
