"""One `[[material]]` of a file: its bodies, and how its measurements are to be read."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import softjax as sj
from calibration.bodies import BODIES, Check, positive, read_contact
from calibration.csv_file import read_csv
from calibration.data import RestitutionData
from calibration.errors import Origin
from calibration.parameters_file import read_parameters
from calibration.parameters_spec import ParameterSpec
from calibration.toml_table import TomlTable

MEASURED: dict[str, Check] = {
    "limit_velocity": positive("m/s"),
    "uncertainty": positive("-"),
    "velocity_uncertainty": ((lambda u: u >= 0), "a number of 0 or more [m/s]"),
    "gravity": positive("m/s²"),
}
KEYS = ("name", "data", *BODIES, *MEASURED, "average_repeats", "parameters")


@dataclass(frozen=True)
class MaterialEntry:
    """What one `[[material]]` says.

    Attributes:
        name: its name, else that of its data file.
        contact: the two bodies, with the file's limit velocity; None without elastic properties.
        limit_velocity: v_lim [m/s], the contact's or the file's; None where neither is there.
        parameters: what it says of the parameters, by name.
        data: its measurements; None where it names no file.
        origin: file and line of its header.
    """

    name: str
    contact: sj.Contact | None
    limit_velocity: float | None
    parameters: Mapping[str, ParameterSpec]
    data: RestitutionData | None
    origin: Origin


def read_material(table: TomlTable, area: str | None, needs_data: bool) -> MaterialEntry:
    """Read one `[[material]]`; `area` is the file's for all that give none themselves."""
    table.allow(KEYS)
    values = {key: table.number(key, *check) for key, check in MEASURED.items()}
    contact = read_contact(table, area)
    limit = values["limit_velocity"]
    if contact is not None:
        limit = float(np.asarray(contact.limit_velocity)) if limit is None else limit
        contact = replace(contact, limit_velocity=limit)
    position = table.path[-1] + 1 if isinstance(table.path[-1], int) else 1
    stem = Path(table.text("data") or f"material {position}").stem
    name = table.text("name") or stem
    if needs_data and "data" not in table:
        raise table.refusal(None, "data is missing", "needed is the name of a CSV file")
    return MaterialEntry(
        name,
        contact,
        limit,
        read_parameters(table.table("parameters"), contact is not None),
        _data(table, contact, name, values) if "data" in table else None,
        Origin(table.file, table.line()),
    )


def _data(
    table: TomlTable, contact: sj.Contact | None, name: str, values: Mapping[str, float | None]
) -> RestitutionData:
    path = Path(table.file).parent / (table.text("data") or "")
    if not path.is_file():
        problem = f"data file {str(path)!r} is not there"
        raise table.refusal("data", problem, "needed is the name of a CSV file beside this one")
    repeats = table.choice("average_repeats", (True, False, "pooled"))
    data = read_csv(path, contact, name=name, **values)
    return data.averaged(pooled=repeats == "pooled") if repeats else data
