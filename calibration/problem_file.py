"""A material file with what it says of the fit: its parameters and its settings."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from pydantic import ValidationError

from calibration.data.toml_file import MaterialFile, read_materials
from calibration.data.toml_table import TomlTable
from calibration.errors import DataError, Origin
from calibration.options import FitOptions
from calibration.parameters import Parameter
from calibration.schema import faults

KEYS = ("free", "value", "bounds", "prior", "transform", "shared")


class FileOptions(FitOptions):
    """The `[fit]` table: the settings of a fit, and the contact area of all its materials."""

    area: Literal["zhou", "hertz"] | None = None


@dataclass(frozen=True)
class ProblemFile(MaterialFile):
    """All that a material file says.

    Attributes:
        settings: what its `[fit]` table gives.
        said: what it says of each material's parameters, by name; one mapping an entry. What
            stands in `[parameters]` is said of all of them.
    """

    settings: Mapping[str, Any]
    said: list[dict[str, Parameter]]

    @property
    def parameters(self) -> list[dict[str, Parameter]]:
        """What is said of the parameters of each of `datasets`."""
        pairs = zip(self.materials, self.said, strict=True)
        return [own for entry, own in pairs if entry.data is not None]

    def line(self, setting: str) -> int | None:
        """The line that a setting stands on."""
        return (self.file.table("fit") or self.file).line(setting)


def read_problem(
    path: str | Path, needs_data: bool = True, *, plausibility: bool = True
) -> ProblemFile:
    """A material file's data sets, parameters and settings.

    Args:
        path: the file; data files are sought beside it.
        needs_data: whether every material must name its measurements.
        plausibility: as of `read_toml`.

    Raises:
        InputError: a ValueError with file and line, what is wrong and what is accepted.
    """
    source = read_materials(path, needs_data, plausibility)
    shared = _read(source.file.table("parameters"))
    said = [shared | _read(entry.parameters) for entry in source.materials]
    _check_line(source, shared)
    settings = read_settings(source.file.table("fit"))
    return ProblemFile(source.materials, source.file, settings, said)


def read_settings(table: TomlTable | None) -> dict[str, Any]:
    """The settings that a file gives in its `[fit]`, each checked; none of the others.

    Raises:
        InputError: with file and line.
    """
    if table is None:
        return {}
    table.allow(FileOptions.model_fields)
    try:
        options = FileOptions(**table.values)
    except ValidationError as error:
        fault = next(faults(error, FileOptions))
        raise table.placed(fault, fault.argument) from None
    return {name: getattr(options, name) for name in table.values}


def _read(table: TomlTable | None) -> dict[str, Parameter]:
    """What a `[parameters]` or `[material.parameters]` says, by name: a number fixes."""
    return {} if table is None else {name: _parameter(table, name) for name in table.values}


def _parameter(table: TomlTable, name: str) -> Parameter:
    fields, below = _fields(table, name)
    try:
        parameter = Parameter(fields.pop("value", None), **fields)
    except DataError as error:
        told = DataError(f"{error.argument} of {name}", error.value, error.accepted)
        raise below.placed(told, error.argument) from None
    return replace(parameter, origin=Origin(table.file, table.line(name)))


def _fields(table: TomlTable, name: str) -> tuple[dict[str, Any], TomlTable]:
    """The fields of a `Parameter`, and the table that they stand in (empty for a number)."""
    given = table.values[name]
    if not isinstance(given, dict):
        number = table.number(name, lambda _: True, "a number, or a table such as { value = 1.0 }")
        return {"free": False, "value": number}, table.below(name, {})
    below = table.below(name, given)
    below.allow(KEYS)
    return dict(given), below


def _check_line(source: MaterialFile, shared: Mapping[str, Parameter]) -> None:
    """χ̃ of a material beside c1 and c2 of all: only one is possible."""
    if not {"c1", "c2"} & set(shared):
        return
    for entry in source.materials:
        own = entry.parameters
        if own is not None and "chi" in own:
            raise own.refusal(
                "chi", "chi beside c1 and c2", "only one is possible, as chi = c1 + c2 E/Y"
            )
