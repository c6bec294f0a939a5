"""Which bodies were measured, as a table: each by itself, or what is known of the two together."""

from typing import Any

import numpy as np

from calibration.report.rows import Table
from calibration.rounding import ABSENT, number

HEADER = [
    "material",
    "body",
    "radius [m]",
    "mass [kg]",
    "E [Pa]",
    "Poisson's ratio",
    "ρ [kg/m³]",
    "Y [Pa]",
]


def bodies_table(result: Any) -> Table:
    """A body a row; the effective numbers of the pair where the bodies are not known."""
    rows = []
    for fit in result.materials:
        own = _bodies(fit.data)
        rows += [[fit.name if k == 0 else "", *row] for k, row in enumerate(own)]
    return Table(HEADER, rows, right=tuple(range(2, len(HEADER))))


def _bodies(data: Any) -> list[list[str]]:
    if data.contact is None:
        return [["not told", *[ABSENT] * 6]]
    if not data.bodies:
        leaves = data.contact.leaves()
        names = ("radius", "mass", "youngs_modulus")
        numbers = [_text(leaves[name]) for name in names]
        return [["the pair, effective", *numbers, ABSENT, ABSENT, _text(leaves["yield_strength"])]]
    one, two = data.bodies
    if one[1:] == two[1:]:
        return [["two equal spheres", *_numbers(one)]]
    return [[body.name, *_numbers(body)] for body in data.bodies]


def _numbers(body: Any) -> list[str]:
    mass, material = None, body.material
    if body.radius is not None:
        mass = 4 / 3 * np.pi * np.asarray(material.density) * np.asarray(body.radius) ** 3
    leaves = material.leaves()
    names = ("youngs_modulus", "poisson_ratio", "density", "yield_strength")
    return [_text(value) for value in (body.radius, mass, *(leaves[name] for name in names))]


def _text(value: Any) -> str:
    """One number, or the range of those that differ from impact to impact."""
    if value is None:
        return ABSENT
    low, high = float(np.min(np.asarray(value))), float(np.max(np.asarray(value)))
    return number(low, 4) if low == high else f"{number(low, 4)} to {number(high, 4)}"
