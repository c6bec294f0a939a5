"""The two bodies of a `[[material]]`: two spheres, equal or not, or a sphere and a wall."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import softjax as sj
from calibration.data.paper import CURVES
from calibration.data.ranges import AS_IT_IS, RANGES
from calibration.data.toml_table import TomlTable
from calibration.errors import listed

Check = tuple[str, Callable[[float], bool], str]  # dimension, what holds, what is accepted


def positive(dimension: str, unit: str) -> Check:
    """A check for a positive quantity, and what to say where it fails."""
    return dimension, (lambda x: x > 0), f"a positive number [{unit}]"


PROPERTIES: dict[str, Check] = {
    "youngs_modulus": positive("pressure", "Pa"),
    "poisson_ratio": ("ratio", (lambda nu: -1 < nu <= 0.5), "a number in (-1, 0.5]"),
    "density": positive("density", "kg/m³"),
    "yield_strength": positive("pressure", "Pa"),
}
RADII = ("radius", "radius_1", "radius_2")
DIAMETERS = tuple(name.replace("radius", "diameter") for name in RADII)
BODIES = ("material", *PROPERTIES, *RADII, *DIAMETERS, "wall", "second", "area")
NAMED = {curve.name: curve.material for curve in CURVES}
NAMED_SOURCE = "Table 1 of Zhou (2013)"


class Body(NamedTuple):
    """One of the two; a wall has no radius."""

    name: str  # "sphere", "second sphere", "wall"
    material: sj.Material
    radius: float | None


@dataclass(frozen=True)
class Bodies:
    """Both bodies, their contact, and what to tell of where their properties come from."""

    contact: sj.Contact
    bodies: tuple[Body, ...]
    remarks: tuple[str, ...]


def read_bodies(table: TomlTable, area: str | None, plausibility: bool) -> Bodies | None:
    """The two bodies, or None where the file says nothing of them.

    Args:
        table: a `[[material]]`.
        area: what its contact takes where it gives no area itself.
        plausibility: whether properties far outside what is plausible are refused.

    Raises:
        InputError: with file and line.
    """
    if not any(key in table for key in BODIES):
        return None
    first = _material(table)
    radii = _radii(table)
    wall, second = table.table("wall"), table.table("second")
    area = table.choice("area", ("zhou", "hertz")) or area or "zhou"
    if wall is not None and second is not None:
        raise table.refusal("second", "both a wall and a second body", "only one is possible")
    told = wall or second
    other = first if told is None else _material(told, True)
    if wall is not None:
        if len(radii) != 1:
            accepted = "needed is radius or diameter, of the sphere"
            raise table.refusal(None, "a wall without radius alone", accepted)
        contact = _build(table, sj.Contact.with_wall, first, other, *radii, area)
        bodies = (Body("sphere", first, radii[0]), Body("wall", other, None))
    else:
        one, two = radii[0], radii[-1]
        contact = _build(table, sj.Contact.between_spheres, first, other, one, two, area)
        bodies = (Body("sphere", first, one), Body("second sphere", other, two))
    if plausibility:
        for part in (table, told or table):
            _check_far(part)
    named = {part.text("material") or "" for part in (table, wall, second) if part is not None}
    remarks = tuple(f"properties of {name} from {NAMED_SOURCE}" for name in sorted(named - {""}))
    return Bodies(contact, bodies, remarks)


def _radii(table: TomlTable) -> list[float]:
    """That of both spheres, or those of each [m]."""
    check = positive("length", "m")
    told = {key: table.quantity(key, *check) for key in (*RADII, *DIAMETERS) if key in table}
    for names, part in ((RADII, 1.0), (DIAMETERS, 0.5)):
        if set(told) in ({names[0]}, {*names[1:]}):
            return [part * (told[name] or 0.0) for name in names if name in told]
    accepted = "needed is radius, or radius_1 and radius_2, or the diameters in their place"
    key = next(iter(told), None)
    raise table.refusal(key, f"radii given are {listed(told) or 'none'}", accepted)


def _material(table: TomlTable, alone: bool = False) -> sj.Material:
    """The properties of a body; `alone` where its table may hold nothing else."""
    if alone:
        table.allow(("material", *PROPERTIES))
    values = {key: table.quantity(key, *check) for key, check in PROPERTIES.items() if key in table}
    if "material" in table:
        return _named(table, next(iter(values), None))
    for key in PROPERTIES:
        if key not in values:
            accepted = "a body has youngs_modulus, poisson_ratio, density and yield_strength"
            if key == "yield_strength":
                accepted += "; for laws without yield any number serves, 10 MPa say"
            raise table.refusal(None, f"{key} is missing", accepted)
    return sj.Material(**values)


def _check_far(table: TomlTable) -> None:
    """Refuse what is more than 100 times outside its plausible range, at its line."""
    sizes = dict.fromkeys((*RADII, *DIAMETERS), positive("length", "m"))
    for key, check in (PROPERTIES | sizes).items():
        one = RANGES.get("radius" if key in sizes else key)
        value = table.quantity(key, *check)
        if one is not None and value is not None and one.is_far(value):
            problem = f"{key} is {value:.3g} {one.unit}, more than 100 times outside {one.accepted}"
            raise table.refusal(key, problem, f"is its unit right? {AS_IT_IS}")


def _named(table: TomlTable, beside: str | None) -> sj.Material:
    """A material whose properties have a source."""
    name = (table.text("material") or "").lower().replace("-", " ").replace("_", " ")
    if name not in NAMED:
        known = listed(f'"{one}"' for one in NAMED)
        accepted = f"{known} ({NAMED_SOURCE}); of any other give {listed(PROPERTIES)}"
        raise table.wrong("material", accepted)
    if beside is not None:
        accepted = "give either a known material, or its properties"
        raise table.refusal(beside, f"{beside} beside material", accepted)
    return NAMED[name]


def _build(table: TomlTable, build: Callable[..., sj.Contact], *arguments: Any) -> sj.Contact:
    try:
        return build(*arguments)
    except (
        sj.ArgumentError,
        ArithmeticError,
    ) as error:  # each makes sense, but no contact together
        problem = f"no contact of these bodies ({error})"
        raise table.refusal(None, problem, "other sizes are needed") from None
