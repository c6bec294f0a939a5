"""The two bodies of a `[[material]]`: two spheres, equal or not, or a sphere and a wall."""

from collections.abc import Callable
from typing import Any

import softjax as sj
from calibration.toml_table import TomlTable

Check = tuple[Callable[[float], bool], str]


def positive(unit: str) -> Check:
    """A check for a positive number, and what to say where it fails."""
    return (lambda x: x > 0), f"a positive number [{unit}]"


PROPERTIES: dict[str, Check] = {
    "youngs_modulus": positive("Pa"),
    "poisson_ratio": ((lambda nu: -1 < nu <= 0.5), "a number in (-1, 0.5]"),
    "density": positive("kg/m³"),
    "yield_strength": positive("Pa"),
}
RADII = ("radius", "radius_1", "radius_2")
BODIES = (*PROPERTIES, *RADII, "wall", "second", "area")


def read_contact(table: TomlTable, area: str | None) -> sj.Contact | None:
    """The two bodies, or None where the file says nothing of them.

    Args:
        table: a `[[material]]`.
        area: what its contact takes where it gives no area itself.

    Raises:
        InputError: with file and line.
    """
    if not any(key in table for key in BODIES):
        return None
    first = _material(table)
    radii = {key: table.number(key, *positive("m")) for key in RADII}
    given = {key: radius for key, radius in radii.items() if radius is not None}
    wall, second = table.table("wall"), table.table("second")
    area = table.choice("area", ("zhou", "hertz")) or area or "zhou"
    if wall is not None and second is not None:
        raise table.refusal("second", "both a wall and a second body", "only one is possible")
    if wall is not None:
        if set(given) != {"radius"}:
            raise table.refusal(
                None, "a wall without radius alone", "needed is radius, of the sphere"
            )
        return _build(
            table, sj.Contact.with_wall, first, _material(wall, True), given["radius"], area
        )
    if set(given) not in ({"radius"}, {"radius_1", "radius_2"}):
        problem = f"radii given are {', '.join(given) or 'none'}"
        raise table.refusal(
            next(iter(given), None), problem, "needed is radius, or radius_1 and radius_2"
        )
    radius_1, radius_2 = (given.get(key, given.get("radius")) for key in RADII[1:])
    other = first if second is None else _material(second, True)
    return _build(table, sj.Contact.between_spheres, first, other, radius_1, radius_2, area)


def _material(table: TomlTable, alone: bool = False) -> sj.Material:
    """The four properties of a body; `alone` where its table may hold nothing else."""
    if alone:
        table.allow(PROPERTIES)
    values = {key: table.number(key, *check) for key, check in PROPERTIES.items()}
    given = {key: value for key, value in values.items() if value is not None}
    for key in PROPERTIES:
        if key not in given:
            accepted = "a body has youngs_modulus, poisson_ratio, density and yield_strength"
            raise table.refusal(None, f"{key} is missing", accepted)
    return sj.Material(**given)


def _build(table: TomlTable, build: Callable[..., sj.Contact], *arguments: Any) -> sj.Contact:
    try:
        return build(*arguments)
    except (
        ValueError,
        ArithmeticError,
    ) as error:  # numbers that each make sense, but no contact together
        raise table.refusal(
            None, f"no contact of these bodies ({error})", "other sizes are needed"
        ) from None
