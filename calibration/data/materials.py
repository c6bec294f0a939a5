"""Material files as data sets: what is measured, of which bodies, and how it is to be fitted.

The tables of such a file are those of `calibration.data.material_tables`. Without elastic properties a set can be
fitted by Eq. (17), where `limit_velocity` is given, or by a constant restitution; the ball's `diameter` and `mass`
(or `density`) then determine its drag.
"""

import os
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import softjax as sj
from calibration.data.bodies import Body
from calibration.data.columns import UNCERTAINTIES
from calibration.data.inputs import (
    INSTRUMENTS,
    OF_ENTRY,
    SIZES,
    Input,
    standard_uncertainty,
)
from calibration.data.material_tables import (
    DIAMETERS,
    NAMED_SOURCE,
    OWNERS,
    PROPERTIES,
    RADII,
    MaterialTables,
)
from calibration.data.measurements import RestitutionData
from calibration.data.plausible import RANGES, of_bodies
from calibration.data.sheet import read_csv
from calibration.data.toml import FAULTS, Place, TomlFile, combined, read_toml_file
from calibration.errors import DataError, InputError, Origin, is_finite_number, listed, printable
from calibration.parameters import Parameter

OF_TRACKS = ("frame_rate", "scale", "down", "exposure", "object", "bounce_contact_time")
OF_DATA = ("gravity", "dent", "limit_velocity", "sheet", "repeats", *OF_TRACKS, *INSTRUMENTS)
PLAUSIBLE = dict.fromkeys((*RADII, *DIAMETERS), RANGES["radius"]) | RANGES


class MaterialEntry:
    """One `[[material]]` as it is read.

    Attributes:
        name, table: of it.
        contact, bodies: None and () without elastic properties.
        data: None where it names no file.
        stated: its parameters, those of `[parameters]` among them.
        origin: where it begins.

    Raises:
        InputError: with file and line.
    """

    def __init__(self, file: TomlFile[MaterialTables], i: int, name: str, needs_data: bool):
        self.file, self.place, self.name = file, ("material", i), name
        self.table = table = file.content.material[i]
        self.origin = Origin(file.path, file.line(self.place))
        self.stated: dict[str, Parameter] = {}
        for place, parameters in (((), file.content.parameters), (self.place, table.parameters)):
            for key, parameter in parameters.items():
                exact = (*place, "parameters", key)
                parted = (
                    *place,
                    "parameters",
                    *key.split("."),
                )  # contact.radius without quotation marks
                line = file.line(exact if exact in file.lines else parted)
                origin = Origin(file.path, line)
                self.stated[key] = parameter.model_copy(update={"origin": origin})
        self._check_far()
        if needs_data and table.data is None:
            raise self._refusal((), "data is missing", "needed is the name of a CSV file")
        self.contact: sj.Contact | None = None
        self.bodies: tuple[Body, ...] = ()
        if table.has_bodies and not table.in_rows:
            contact, self.bodies = self._pair(table.radii[0])
            limit = table.limit_velocity or float(np.asarray(contact.limit_velocity))
            self.contact = replace(contact, limit_velocity=limit)
        try:
            self.data = None if table.data is None else self._data()
            if table.in_rows and self.data is not None:
                self.contact, self.bodies = self.data.contact, self.data.bodies
        except InputError as error:
            raise next(self._suspects(error), error) from None

    @property
    def implausible(self) -> list[str]:
        """A line for each property of a body outside its plausible range."""
        warnings = of_bodies(self.bodies, self.contact)
        return [f"warning: plausibility ({self.name}): {w.cause}. {w.advice}" for w in warnings]

    def _suspects(self, error: InputError) -> Iterator[InputError]:
        """A refusal of data with the cause first: a property of a body outside its plausible range."""
        names = {plausible.code: name for name, plausible in RANGES.items()}
        other = "wall" if self.table.wall else "second"
        for place, body in zip(((), (other,)), self.bodies, strict=False):
            for warning in of_bodies([body], None):
                line = self.file.line((*self.place, *place, names[warning.code]))
                which = f" (so that in {error.file}:{error.line} {error.problem})"
                accepted = warning.advice[:1].lower() + warning.advice[1:]
                yield InputError(self.file.path, line, warning.cause, accepted + which)

    def _refusal(self, place: Place, problem: str, accepted: str) -> InputError:
        return self.file.refusal((*self.place, *place), problem, accepted)

    def _check_far(self) -> None:
        """Refuse what is more than 100 times outside its plausible range, at its line."""
        places: dict[Place, Any] = {(): self.table, ("wall",): self.table.wall}
        for place, body in (places | {("second",): self.table.second}).items():
            for name, plausible in PLAUSIBLE.items() if self.table.plausibility else ():
                value = getattr(body, name, None)
                if value is not None and plausible.is_far(value):
                    raise self._refusal((*place, name), *plausible.refusal(name, value))
        for name, parameter in self.stated.items() if self.table.plausibility else ():
            known = PLAUSIBLE.get(name.removeprefix("contact."))
            for value in (parameter.value, *(parameter.prior or ())[:1]):
                if known and parameter.origin and is_finite_number(value) and known.is_far(value):
                    line = parameter.origin.line
                    raise InputError(self.file.path, line, *known.refusal(name, value))

    def _pair(self, radius: Any) -> tuple[sj.Contact, tuple[Body, Body]]:
        """The contact and both bodies, where the first has this radius, or one in each row."""
        table = self.table
        area = table.area or self.file.content.fit.area or "zhou"
        first, other, second = table.solid, (table.other or table).solid, [radius, *table.radii][-1]
        try:
            if table.wall is not None:
                contact = sj.Contact.with_wall(first, other, radius, area)
                return contact, (Body("sphere", first, radius), Body("wall", other, None))
            contact = sj.Contact.between_spheres(first, other, radius, second, area)
        except (sj.ArgumentError, ArithmeticError) as error:  # each makes sense, but not together
            problem = f"no contact of these bodies ({error})"
            raise self._refusal((), problem, "other sizes are needed") from None
        return contact, (Body("sphere", first, radius), Body("second sphere", other, second))

    def _data(self) -> RestitutionData:
        """The measurements, from a file next to the material file."""
        table = self.table
        # a name in UTF-8 also where the locale is ASCII
        path = Path(self.file.path).parent / os.fsdecode(table.data.encode())
        if not os.path.exists(path):
            problem = f"data file {printable(repr(str(path)))[:300]} is not there"
            raise self._refusal(
                ("data",), problem, "needed is the name of a CSV file next to this one"
            )
        named = {body.material for body in (table, table.wall, table.second) if body is not None}
        options: dict[str, Any] = {n: getattr(table, n) for n in (*UNCERTAINTIES, *OF_DATA)}
        options |= {"name": self.name, "bodies": self.bodies}
        options["air"] = self.file.content.fit.air if table.air is None else table.air
        options["remarks"] = [
            f"properties of {n} from {NAMED_SOURCE}" for n in sorted(named - {None})
        ]
        if table.is_ball:
            options |= {
                "diameter": 2 * table.radii[0] if table.radii else None,
                "mass": table.mass,
                "density": table.density,
            }
        try:
            if table.in_rows:
                options["bodies"] = lambda radius: self._pair(radius)[1]
                density = table.solid.density
                data = read_csv(
                    path, lambda radius: self._pair(radius)[0], **options, density=density
                )
            else:
                data = read_csv(path, self.contact, **options, one_size=self.contact is not None)
            data = data.averaged() if table.average_repeats else data
            return replace(data, source=OfEntry(self.file, self.place[1], self.name))
        except DataError as error:  # of what is stated here, not in the table
            key = error.argument if error.argument in options else "average_repeats"
            raise error.at(self.file.path, self.file.line((*self.place, key))) from None


@dataclass(frozen=True)
class OfEntry:
    """The inputs of a `[[material]]`, and its data with some of them moved."""

    file: TomlFile[MaterialTables]
    place: int
    name: str

    @property
    def table(self) -> Any:
        return self.file.content.material[self.place]

    @property
    def stated(self) -> tuple[Input, ...]:
        found = []
        for owner in OWNERS:
            body = self._body(owner)
            for name in () if body is None else body.uncertain:
                value, size = body.value_of(name), getattr(body, f"{name}_uncertainty")
                size = standard_uncertainty(name, size, value)
                found.append(Input(f"{owner}.{name}".lstrip("."), value, size))
        return tuple(found)

    @property
    def exact(self) -> tuple[str, ...]:
        if not self.table.has_bodies:
            return ()
        return tuple(n for n in self._known() if n.rpartition(".")[2] in (*PROPERTIES, *SIZES))

    def value(self, name: str) -> float:
        owner, _, key = name.rpartition(".")
        body = self._body(owner) if owner in OWNERS else None
        value = None if body is None or key not in OF_ENTRY else body.value_of(key)
        if value is None:
            accepted = f"an input of the [[material]] {self.name}, as {listed(self._known())}"
            raise DataError("inputs", repr(name), accepted)
        return float(value)

    def identity(self, name: str) -> Any:
        owner, _, key = name.rpartition(".")
        body = self._body(owner)
        if owner and body.correlated:
            return self.name if body.correlated is True else body.correlated, key
        if owner or key in (*INSTRUMENTS, "gravity"):  # one plate, one ruler for several materials
            return name, self.value(name), getattr(body, f"{key}_uncertainty")
        return self.name, key

    def moved(self, data: RestitutionData, moves: Mapping[str, float]) -> RestitutionData:
        table = self.table
        for name, change in moves.items():
            owner, _, key = name.rpartition(".")
            body = (getattr(table, owner) if owner else table).moved(key, change)
            table = table.model_copy(update={owner: body}) if owner else body
        tables = [*self.file.content.material]
        tables[self.place] = table
        content = self.file.content.model_copy(update={"material": tables})
        again = MaterialEntry(replace(self.file, content=content), self.place, self.name, True).data
        assert again is not None
        if not moves and again != data:
            accepted = "those of data as they were read; give a contact.… of data that were changed"
            raise DataError("inputs", f"of {self.name}", accepted)
        return replace(again, source=data.source)

    def _body(self, owner: str) -> Any:
        return getattr(self.table, owner) if owner else self.table

    def _known(self) -> list[str]:
        names = []
        for owner in OWNERS:
            body = self._body(owner)
            known = () if body is None else (n for n in OF_ENTRY if body.value_of(n) is not None)
            names += [f"{owner}.{name}".lstrip(".") for name in known]
        return names


@dataclass(frozen=True)
class ProblemFile:
    """A material file: its entries, the settings of its `[fit]` table, and the line of each key."""

    materials: list[MaterialEntry]
    settings: Mapping[str, Any]
    file: TomlFile[MaterialTables]

    @property
    def datasets(self) -> list[RestitutionData]:
        """Measurements of the materials that have any."""
        return [entry.data for entry in self.materials if entry.data is not None]

    @property
    def parameters(self) -> list[dict[str, Parameter]]:
        """Stated parameters of each of `datasets`."""
        return [entry.stated for entry in self.materials if entry.data is not None]

    @property
    def implausible(self) -> list[str]:
        """A line for each property of a body outside its plausible range."""
        return [line for entry in self.materials for line in entry.implausible]

    def line(self, setting: str) -> int | None:
        """The line that a setting stands on."""
        return self.file.line(("fit", setting))


def read_toml(path: str | Path) -> list[RestitutionData]:
    """The data sets of a material file, one a `[[material]]`.

    What the file states for a fit, `[fit]` and parameters, is left out with a warning:
    `calibration.fit("my.toml")` uses it.

    Args:
        path: the file; data files are searched for next to it.

    Raises:
        InputError: a ValueError with file and line, what is wrong and what is accepted.
    """
    file = read_problem(path)
    names = [name for name in file.settings if name != "area"]
    names += sorted({name for parameters in file.parameters for name in parameters})
    if names:
        text = f"{path} states {listed(names)} for a fit, which read_toml leaves out"
        warnings.warn(f'{text}; calibration.fit("{path}") uses it', stacklevel=2)
    return file.datasets


def read_problem(path: str | Path, needs_data: bool = True) -> ProblemFile:
    """A material file's data sets, parameters and settings; arguments and errors as of `read_toml`.

    Args:
        needs_data: whether every material must name its measurements.
    """
    file = read_toml_file(path, MaterialTables)
    entries: list[MaterialEntry] = []
    faults: list[InputError] = []
    for i, name in enumerate(file.content.names):
        try:
            entries.append(MaterialEntry(file, i, name, needs_data))
        except InputError as error:
            if str(error) not in map(str, faults):  # of what is stated for all
                faults.append(error)
        if len(faults) > FAULTS:
            break
    if faults:
        raise combined(faults)
    fit = file.content.fit
    stated = fit.model_fields_set - {"air"}  # the data have it
    return ProblemFile(entries, {name: getattr(fit, name) for name in stated}, file)
