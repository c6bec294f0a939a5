"""Material files: what is measured, of which bodies, and how it is to be fitted.

    [fit]                        # settings of the fit; may be left out
    objective = "two-step"

    [parameters]                 # of all materials together; may be left out
    c1 = { value = 0.0 }

    [[material]]                 # two equal spheres
    name = "my alloy"
    youngs_modulus = "193 GPa"   # a number in SI, or text with its unit
    poisson_ratio = 0.35
    density = 8030               # kg/m³
    yield_strength = 3.10e8      # Pa
    radius = 0.0127              # m; or radius_1 and radius_2; or diameter, diameter_1, diameter_2
    data = "my_alloy.csv"        # beside this file
    # material = "nylon"         # of Table 1, in place of the four properties
    # limit_velocity [m/s], area, gravity [m/s²]; uncertainties for all rows, as columns are called:
    # uncertainty, velocity_uncertainty = "2 %", drop_height_uncertainty = "0.5 mm", ...
    # average_repeats = true (or "pooled"), or "separate"
    # plausibility = false       # properties are right, though 100 times outside what is plausible

    [material.second]            # the other sphere, where its properties differ; or
    [material.wall]              # a flat wall, with its properties

    [material.parameters]        # fixed by a number, told more of by a table
    psi = 0.5
    chi = { value = 0.1, bounds = [0.01, 10.0], transform = "log" }

Without elastic properties a set can be fitted by Eq. (17), where `limit_velocity` is given, or by
a constant restitution. `[fit]`, `[parameters]` and `[material.parameters]` are handed over as they
stand: who fits reads them.
"""

from dataclasses import dataclass
from pathlib import Path

from calibration.data.material_file import MaterialEntry, read_material
from calibration.data.measurements import RestitutionData
from calibration.data.toml_table import TomlTable, read_toml_table
from calibration.errors import InputError


@dataclass(frozen=True)
class MaterialFile:
    """What a material file says.

    Attributes:
        materials: its entries.
        file: the file itself, as a table: `[fit]` and `[parameters]` as they stand.
    """

    materials: list[MaterialEntry]
    file: TomlTable

    @property
    def datasets(self) -> list[RestitutionData]:
        """The measurements of those that have any."""
        return [entry.data for entry in self.materials if entry.data is not None]

    @property
    def implausible(self) -> list[str]:
        """A line for each property of a body outside its plausible range."""
        return [line for entry in self.materials for line in entry.implausible]


def read_toml(path: str | Path, *, plausibility: bool = True) -> list[RestitutionData]:
    """The data sets of a material file, one a `[[material]]`.

    Args:
        path: the file; data files are sought beside it.
        plausibility: whether properties more than 100 times outside what is plausible are refused,
            but of materials with `plausibility = false`.

    Raises:
        InputError: a ValueError with file and line, what is wrong and what is accepted.
    """
    return read_materials(path, plausibility=plausibility).datasets


def read_materials(
    path: str | Path, needs_data: bool = True, plausibility: bool = True
) -> MaterialFile:
    """A material file, its settings and parameters as they stand.

    Args:
        path: the file; data files are sought beside it.
        needs_data: whether every material must name its measurements.
        plausibility: as of `read_toml`.

    Raises:
        InputError: a ValueError with file and line, what is wrong and what is accepted.
    """
    file = read_toml_table(path)
    file.allow(("material", "fit", "parameters"))
    fit = file.table("fit")
    area = None if fit is None else fit.choice("area", ("zhou", "hertz"))
    tables = file.tables("material")
    if not tables:
        raise InputError(file.file, 1, "no material", "one [[material]] or more is needed")
    materials = [read_material(table, area, needs_data, plausibility) for table in tables]
    seen: set[str] = set()
    for entry in materials:  # results are keyed by the name
        if entry.name in seen:
            problem = f"a second material is named {entry.name!r}"
            raise entry.table.refusal("name", problem, "each material has a name of its own")
        seen.add(entry.name)
    return MaterialFile(materials, file)
