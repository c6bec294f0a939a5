"""One `[[material]]` of a file: its bodies, and how its measurements are to be read."""

import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import softjax as sj
from calibration.data.bodies import BODIES, Body, Check, positive, read_bodies
from calibration.data.csv_file import read_csv
from calibration.data.measurements import RestitutionData
from calibration.data.names import UNCERTAINTIES
from calibration.data.ranges import of_bodies
from calibration.data.toml_table import TomlTable
from calibration.errors import DataError, InputError, printable

SIZES: dict[str, Check] = {
    name: (dimension, (lambda u: u >= 0), "a number of 0 or more, in SI or text with its unit")
    for name, dimension in UNCERTAINTIES.items()
}
MEASURED: dict[str, Check] = {
    **SIZES,
    "uncertainty": positive("ratio", "-"),
    "gravity": positive("acceleration", "m/s²"),
}
LIMIT = positive("speed", "m/s")
REPEATS = {True: True, "pooled": True, "separate": False}
KEYS = (
    "name",
    "data",
    *BODIES,
    "limit_velocity",
    *MEASURED,
    "average_repeats",
    "plausibility",
    "parameters",
)


@dataclass(frozen=True)
class MaterialEntry:
    """What one `[[material]]` says.

    Attributes:
        name: its name, else that of its data file.
        contact: the two bodies, with the file's limit velocity; None without elastic properties.
        bodies: the bodies themselves.
        data: its measurements; None where it names no file.
        table: the entry as it stands, with its `parameters`, which are read elsewhere.
    """

    name: str
    contact: sj.Contact | None
    bodies: tuple[Body, ...]
    data: RestitutionData | None
    table: TomlTable

    @property
    def parameters(self) -> TomlTable | None:
        """Its `[material.parameters]`, as they stand."""
        return self.table.table("parameters")

    @property
    def implausible(self) -> list[str]:
        """A line for each property of a body outside its plausible range."""
        found = of_bodies(self.bodies, self.contact)
        return [f"warning: plausibility ({self.name}): {one.cause}. {one.remedy}" for one in found]


def read_material(
    table: TomlTable, area: str | None, needs_data: bool, plausibility: bool
) -> MaterialEntry:
    """Read one `[[material]]`; `area` is the file's for all that give none themselves.

    Where `plausibility` is False, here or in the file, no property is refused for its size.

    Raises:
        InputError: with file and line.
    """
    table.allow(KEYS)
    plausibility = plausibility and table.choice("plausibility", (True, False)) is not False
    told = read_bodies(table, area, plausibility)
    contact = None if told is None else told.contact
    limit = table.quantity("limit_velocity", *LIMIT)
    if contact is not None:
        limit = float(np.asarray(contact.limit_velocity)) if limit is None else limit
        contact = replace(contact, limit_velocity=limit)
    position = table.path[-1] + 1 if isinstance(table.path[-1], int) else 1
    name = table.text("name") or Path(table.text("data") or "").stem or f"material {position}"
    name = printable(name)
    if needs_data and "data" not in table:
        raise table.refusal(None, "data is missing", "needed is the name of a CSV file")
    options: dict[str, Any] = {"name": name, "limit_velocity": limit}
    options["plausibility"] = plausibility
    options |= {key: table.quantity(key, *check) for key, check in MEASURED.items()}
    if told is not None:
        options |= {"bodies": told.bodies, "remarks": told.remarks}
    return MaterialEntry(
        name,
        contact,
        () if told is None else told.bodies,
        _data(table, contact, options) if "data" in table else None,
        table,
    )


def _data(table: TomlTable, contact: sj.Contact | None, options: dict) -> RestitutionData:
    path, found, inside = _data_file(table)
    repeats = table.choice("average_repeats", (True, False, "pooled", "separate"))
    options["remarks"] = (*options.get("remarks", ()), *found)
    if contact is None or "limit_velocity" in table:
        data = read_csv(path, contact, quoted=inside, **options)
    else:  # the limit follows from what the file says of the bodies
        limit = options.pop("limit_velocity")
        data = read_csv(path, None, quoted=inside, **options)
        data = _of_bodies(table, data, contact, limit)
    if not repeats:
        return data
    try:
        return data.averaged(pooled=REPEATS[repeats])
    except DataError as error:
        raise table.placed(error, "average_repeats") from None


def _of_bodies(table: TomlTable, data: RestitutionData, contact: sj.Contact, limit: float):
    """The measurements of these bodies, all of them below √(3 Y/ρ).

    Where a few are not they are to blame, where most are not the yield strength.
    """
    beyond = data.velocity >= limit
    if 2 * np.sum(beyond) > len(data):
        place = data.refusal("", "", int(np.argmax(beyond)))
        fastest = f"{place.file}:{place.line} has {data.velocity[np.argmax(beyond)]:.4g} m/s"
        problem = f"yield_strength makes the limit velocity √(3 Y/ρ) {limit:.4g} m/s, but {fastest}"
        accepted = 'is it in Pa, or text with its unit as "310 MPa"? Or tell limit_velocity'
        raise _weaker(table, data.bodies).refusal("yield_strength", problem, accepted)
    try:
        return replace(data, contact=contact, limit_velocity=limit)
    except InputError as error:
        accepted = f"{error.accepted}, √(3 Y/ρ) of the bodies"
        raise InputError(error.file, error.line, error.problem, accepted) from None


def _weaker(table: TomlTable, bodies: tuple[Body, ...]) -> TomlTable:
    """Where the body stands that yields."""
    one, two = (float(np.asarray(body.material.yield_strength)) for body in bodies)
    other = table.table("wall") or table.table("second")
    return other if other is not None and two < one else table


def _data_file(table: TomlTable) -> tuple[Path, tuple[str, ...], bool]:
    """Where the data file is, what to tell of that, and whether it lies below the file's folder.

    A material file that is reached by a link means what lies beside itself, not beside the link;
    where that is not there, what lies beside the link serves.
    """
    # TOML is UTF-8, whatever this system takes the names of its files for
    name = os.fsdecode((table.text("data") or "").encode())
    here = Path(table.file).parent
    try:
        homes = list(dict.fromkeys([Path(table.file).resolve().parent, here.resolve()]))
        places = [here / name] if len(homes) == 1 else [homes[0] / name, here / name]
        path = next((one for one in places if one.exists()), None)
        inside = path is not None and any(map(path.resolve().is_relative_to, homes))
    except (OSError, ValueError, RuntimeError) as error:  # a name too long, a NUL, a ring of links
        told = getattr(error, "strerror", None) or "no name of a file"
        problem = f"data file {name[:80]!r} cannot be looked for ({told})"
        raise table.refusal("data", problem, "needed is the name of a CSV file") from None
    if path is None:
        told = " or ".join(repr(str(one)) for one in places)
        accepted = "needed is the name of a CSV file beside this one"
        raise table.refusal("data", f"data file {told} is not there", accepted)
    if len(places) == 1:
        return path, (), inside
    beside = "the file that the link points to" if path == places[0] else "the link"
    return path, (f"data file {str(path)!r} was found beside {beside}",), inside
