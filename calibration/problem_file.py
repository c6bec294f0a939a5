"""A material file with what it says of the fit: its parameters and its settings."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from calibration.data.material_file import MaterialEntry
from calibration.data.measurements import RestitutionData
from calibration.data.toml_file import MaterialFile, read_materials
from calibration.errors import InputError
from calibration.parameters_file import read_parameters, read_shared_parameters
from calibration.parameters_spec import ParameterSpec
from calibration.settings import read_settings


@dataclass(frozen=True)
class ProblemFile:
    """All that a material file says.

    Attributes:
        source: the file as it was read.
        settings: what its `[fit]` table gives.
        specs: what it says of each material's parameters, by name; one mapping an entry.
        shared_parameters: c1 and c2 of Eq. (18)'s line, where the file has them.
    """

    source: MaterialFile
    settings: Mapping[str, Any]
    specs: list[Mapping[str, ParameterSpec]]
    shared_parameters: Mapping[str, ParameterSpec]

    @property
    def materials(self) -> list[MaterialEntry]:
        return self.source.materials

    @property
    def datasets(self) -> list[RestitutionData]:
        """The measurements, a set a material that has any."""
        return self.source.datasets

    @property
    def parameters(self) -> list[Mapping[str, ParameterSpec]]:
        """What is said of the parameters of each of `datasets`."""
        pairs = zip(self.materials, self.specs, strict=True)
        return [own for entry, own in pairs if entry.data is not None]

    def refusal(self, setting: str | None, problem: str, accepted: str) -> InputError:
        """The error to raise for a setting that cannot be used, with the line it stands on."""
        return (self.source.fit or self.source.file).refusal(setting, problem, accepted)


def read_problem(path: str | Path, needs_data: bool = True) -> ProblemFile:
    """A material file's data sets, parameters and settings.

    Args:
        path: the file; data files are sought beside it.
        needs_data: whether every material must name its measurements.

    Raises:
        InputError: a ValueError with file and line, what is wrong and what is accepted.
    """
    source = read_materials(path, needs_data)
    tables = [entry.table for entry in source.materials]
    return ProblemFile(
        source,
        read_settings(source.fit),
        [
            read_parameters(entry.parameters, entry.contact is not None)
            for entry in source.materials
        ],
        read_shared_parameters(source.parameters, tables),
    )
