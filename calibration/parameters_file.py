"""Parameters as a material file tells them: a number fixes one, a table frees it."""

from typing import Any

from calibration.data.toml_table import TomlTable
from calibration.errors import DataError, Origin
from calibration.parameters_spec import (
    ALL,
    ELASTIC,
    OF_A_MATERIAL,
    SHARED_ONLY,
    ParameterSpec,
)

KEYS = ("free", "value", "bounds", "prior", "transform", "shared")


def read_parameters(table: TomlTable | None, has_contact: bool) -> dict[str, ParameterSpec]:
    """What a `[material.parameters]` says, by name.

    Raises:
        InputError: with file and line.
    """
    if table is None:
        return {}
    table.allow(OF_A_MATERIAL)
    for name in table.values:
        if name in ELASTIC and not has_contact:
            problem = f"{name} without elastic properties"
            raise table.refusal(name, problem, "give youngs_modulus and the rest, or leave it out")
    return {name: _read_spec(table, name) for name in table.values}


def read_shared_parameters(
    table: TomlTable | None, materials: list[TomlTable]
) -> dict[str, ParameterSpec]:
    """c1 and c2 of the file's `[parameters]`: χ̃ then lies on their line in every material.

    Raises:
        InputError: with file and line.
    """
    if table is None:
        return {}
    table.allow(SHARED_ONLY)
    for material in materials:
        own = material.table("parameters")
        if own is not None and "chi" in own and table.values:
            problem = "chi beside c1 and c2"
            raise own.refusal("chi", problem, "only one is possible, as chi = c1 + c2 E/Y")
    return {name: _read_spec(table, name) for name in table.values}


def _read_spec(table: TomlTable, name: str) -> ParameterSpec:
    fields, below = _fields(table, name)
    try:
        return ParameterSpec(name, **fields, origin=Origin(table.file, table.line(name)))
    except DataError as error:
        is_number = not below.values and error.argument == "value"
        label = name if is_number else f"{error.argument} of {name}"
        told = DataError(label, error.value, error.accepted)
        raise below.placed(told, error.argument) from None


def _fields(table: TomlTable, name: str) -> tuple[dict[str, Any], TomlTable]:
    """The fields of a `ParameterSpec`, and the table that they stand in (empty for a number)."""
    given = table.values[name]
    if not isinstance(given, dict):
        number = table.number(name, lambda _: True, "a number, or a table such as { value = 1.0 }")
        return {"free": False, "value": number}, table.below(name, {})
    below = table.below(name, given)
    below.allow(KEYS)
    fields = dict(given)
    if isinstance(given.get("shared"), bool):
        fields["shared"] = ALL if given["shared"] else None
    return fields, below
