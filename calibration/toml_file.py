"""Material files: what is measured, of which bodies, and how it is to be fitted.

    [fit]                        # settings of the fit; may be left out
    objective = "two-step"

    [parameters]                 # Eq. (18)'s line through all materials; may be left out
    c1 = { value = 0.0 }
    c2 = { value = 0.005 }

    [[material]]                 # two equal spheres
    name = "my alloy"
    youngs_modulus = 1.93e11     # Pa
    poisson_ratio = 0.35
    density = 8030               # kg/m³
    yield_strength = 3.10e8      # Pa
    radius = 0.0127              # m; or radius_1 and radius_2
    data = "my_alloy.csv"        # beside this file
    # limit_velocity [m/s], area, uncertainty, velocity_uncertainty [m/s], gravity [m/s²],
    # average_repeats = true (or "pooled")

    [material.second]            # the other sphere, where its properties differ; or
    [material.wall]              # a flat wall, with its properties

    [material.parameters]        # fixed by a number, told more of by a table
    psi = 0.5
    chi = { value = 0.1, bounds = [0.01, 10.0], transform = "log" }
    yield_strength = { prior = [3.1e8, 1e7], shared = "steel" }

Without elastic properties a set can be fitted by Eq. (17), where `limit_velocity` is given, or by
a constant restitution.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from calibration.data import RestitutionData
from calibration.errors import InputError
from calibration.material_file import MaterialEntry, read_material
from calibration.parameters_file import read_shared_parameters
from calibration.parameters_spec import ParameterSpec
from calibration.settings import read_settings
from calibration.toml_table import TomlTable, read_toml_table


@dataclass(frozen=True)
class MaterialFile:
    """All that a material file says.

    Attributes:
        datasets: the measurements, a set a material.
        parameters: what the file says of the parameters, by name; one mapping a data set.
        shared_parameters: c1 and c2 of Eq. (18)'s line, where the file has them.
        settings: what its `[fit]` table gives.
        materials: the entries themselves; those of `read_problem` all have data.
    """

    datasets: list[RestitutionData]
    parameters: list[Mapping[str, ParameterSpec]]
    shared_parameters: Mapping[str, ParameterSpec]
    settings: Mapping[str, Any]
    materials: list[MaterialEntry]
    file: TomlTable = field(repr=False, compare=False)

    def refusal(self, setting: str | None, problem: str, accepted: str) -> InputError:
        """The error to raise for a setting that cannot be used, with the line it stands on."""
        fit = self.file.table("fit")
        return (fit or self.file).refusal(setting, problem, accepted)


def read_toml(path: str | Path) -> list[RestitutionData]:
    """The data sets of a material file, one a `[[material]]`.

    Raises:
        InputError: a ValueError with file and line, what is wrong and what is accepted.
    """
    return read_problem(path).datasets


def read_problem(path: str | Path, needs_data: bool = True) -> MaterialFile:
    """A material file's data sets, parameters and settings.

    Args:
        path: the file; data files are sought beside it.
        needs_data: whether every material must name its measurements. Without, `datasets` and
            `parameters` hold those of the materials that do, `materials` all.

    Raises:
        InputError: a ValueError with file and line, what is wrong and what is accepted.
    """
    file = read_toml_table(path)
    file.allow(("material", "fit", "parameters"))
    settings = read_settings(file.table("fit"))
    tables = file.tables("material")
    if not tables:
        raise InputError(file.file, 1, "no material", "one [[material]] or more is needed")
    materials = [read_material(table, settings.get("area"), needs_data) for table in tables]
    _check_names(materials, tables)
    shared = read_shared_parameters(file.table("parameters"), tables)
    measured = [entry for entry in materials if entry.data is not None]
    return MaterialFile(
        [entry.data for entry in measured if entry.data is not None],
        [entry.parameters for entry in measured],
        shared,
        settings,
        materials,
        file,
    )


def _check_names(materials: list[MaterialEntry], tables: list[TomlTable]) -> None:
    """Results are keyed by the name, so each is there once."""
    seen: set[str] = set()
    for entry, table in zip(materials, tables, strict=True):
        if entry.name in seen:
            problem = f"a second material is named {entry.name!r}"
            raise table.refusal("name", problem, "each material has a name of its own")
        seen.add(entry.name)
