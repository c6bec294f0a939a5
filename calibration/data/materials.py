"""Material files: what is measured, of which bodies, and how it is to be fitted.

    [fit]                        # settings of the fit: `calibration.FitOptions`, and `area`
    [parameters]                 # of all materials together; may be left out
    [[material]]                 # its bodies, the name of its data file, and remarks on these
    [material.second]            # the other sphere, where its properties differ; or
    [material.wall]              # a flat wall, with its properties
    [material.parameters]        # a number fixes; a table gives start, bounds, prior, sharing

A number is in SI, a text has its unit. The reference has an example with all keys.
Without elastic properties a set can be fitted by Eq. (17), where `limit_velocity` is given, or by
a constant restitution; the ball's `diameter` and `mass` (or `density`) then determine its drag.
`MaterialTables.model_json_schema()` is the JSON Schema of these files.
"""

import os
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import (
    BeforeValidator,
    Field,
    PlainValidator,
    WithJsonSchema,
    create_model,
    model_validator,
)

import softjax as sj
from calibration.data.air import checked_air
from calibration.data.bodies import Body
from calibration.data.columns import UNCERTAINTIES
from calibration.data.inputs import (
    EXACT,
    INSTRUMENTS,
    OF_ENTRY,
    SIZES,
    Input,
    divided,
    standard_uncertainty,
)
from calibration.data.measurements import LONGEST_NAME, RestitutionData
from calibration.data.plausible import RANGES, of_bodies
from calibration.data.points import STANDARD_GRAVITY
from calibration.data.sheet import read_csv
from calibration.data.stated import Parameters, measure
from calibration.data.toml import FAULTS, Place, TomlFile, combined, read_toml_file
from calibration.errors import DataError, InputError, Origin, is_finite_number, listed, printable
from calibration.options import FitOptions
from calibration.parameters import Parameter
from calibration.schema import Refused, Strict

RADII = ("radius", "radius_1", "radius_2")
DIAMETERS = tuple(name.replace("radius", "diameter") for name in RADII)
PROPERTIES = ("youngs_modulus", "poisson_ratio", "density", "yield_strength")
NAMED = {"stainless steel": sj.STAINLESS_STEEL, "chrome steel": sj.CHROME_STEEL, "nylon": sj.NYLON}
NAMED_SOURCE = "Table 1 of Zhou (2013)"
BODIES = {"material", *PROPERTIES, *RADII, *DIAMETERS, "wall", "second", "area", "mass"}
OF_TRACKS = ("frame_rate", "scale", "down", "exposure", "object", "bounce_contact_time")
OF_DATA = ("gravity", "dent", "limit_velocity", "sheet", "repeats", *OF_TRACKS, *INSTRUMENTS)
PLAUSIBLE = dict.fromkeys((*RADII, *DIAMETERS), RANGES["radius"]) | RANGES
NEEDED_RADII = "needed is radius, or radius_1 and radius_2, or the diameters instead"


def _name_of_material(value: Any) -> str:
    name = value.lower().replace("-", " ").replace("_", " ") if isinstance(value, str) else value
    if not isinstance(name, str) or name not in NAMED:
        known = listed(f'"{name}"' for name in NAMED)
        raise ValueError(f"{known} ({NAMED_SOURCE}); of any other give {listed(PROPERTIES)}")
    return name


def _air(value: Any) -> Any:
    checked_air(value)
    return value


AirOption = Annotated[bool | float | str | None, BeforeValidator(_air)]
OWNERS = ("", "wall", "second")  # of inputs
DEFAULTS = EXACT | {"gravity": STANDARD_GRAVITY}


def _number_or_text(text: str) -> float | str:
    """A number without a unit as a number, which is in SI."""
    try:
        return float(text)
    except ValueError:
        return text


Pressure = Annotated[float | None, measure("Pa")]
Length = Annotated[float | None, measure("m")]
Factor = Annotated[float | None, measure("1")]
Text = Annotated[str, Field(min_length=1, pattern=r"\S")]


def _uncertainty_fields(names: Mapping[str, str]) -> dict[str, Any]:
    """A field for the standard uncertainty of each input."""
    return {
        f"{name}_uncertainty": (Annotated[float | str | None, measure(si, of_rows=True)], None)
        for name, si in names.items()
    }


class BodyTable(Strict):
    """A body: its four properties, or the name of a material of Table 1.

    A number may be stated with its standard uncertainty, "115 ± 5 GPa", or have it as
    `youngs_modulus_uncertainty`.
    """

    material: Annotated[
        str | None,
        PlainValidator(_name_of_material),
        WithJsonSchema({"type": "string", "examples": list(NAMED)}),
    ] = None
    youngs_modulus: Pressure = None
    poisson_ratio: Annotated[
        float | None, Field(gt=-1, le=0.5, json_schema_extra={"accepted": "a number in (-1, 0.5]"})
    ] = None
    density: Annotated[float | None, measure("kg/m^3")] = None
    yield_strength: Pressure = None

    @model_validator(mode="before")
    @classmethod
    def _parted(cls, values: Any) -> Any:
        """ "115 ± 5 GPa" as a value and its standard uncertainty."""
        if not isinstance(values, dict):
            return values
        numbers = dict(values)
        for name, stated in values.items():
            both = divided(stated) if name in OF_ENTRY and isinstance(stated, str) else None
            if both is None:
                continue
            size = f"{name}_uncertainty"
            if size in values:
                accepted = f"the uncertainty of {name} is stated once"
                raise Refused((size,), f"{size} in addition to {stated!r}", accepted)
            numbers[name], numbers[size] = map(_number_or_text, both)
        return numbers

    @model_validator(mode="after")
    def _checked(self) -> "BodyTable":
        self.check()
        for name in self.uncertain:
            if self.value_of(name) is None:
                size = f"{name}_uncertainty"
                raise Refused((size,), f"{size} without {name}", f"{name} is needed with it")
        return self

    @property
    def uncertain(self) -> list[str]:
        """Inputs whose standard uncertainty is stated here."""
        return [name for name in OF_ENTRY if getattr(self, f"{name}_uncertainty", None) is not None]

    def value_of(self, name: str) -> float | None:
        """An input in SI; None where it is not stated."""
        known = getattr(self, name, None)
        if name in PROPERTIES and known is None and self.material is not None:
            return float(getattr(self.solid, name))
        if known is None and name in type(self).model_fields:
            return DEFAULTS.get(name)
        return known

    def moved(self, name: str, change: float) -> "BodyTable":
        """Move one input to another value."""
        value = self.value_of(name)
        assert value is not None
        own: dict[str, Any] = {}
        if name in PROPERTIES and self.material is not None:
            own = {"material": None} | {each: self.value_of(each) for each in PROPERTIES}
        return self.model_copy(update=own | {name: value + change})

    def check(self) -> None:
        """Refuse a body of which something is missing."""
        properties = [name for name in PROPERTIES if getattr(self, name) is not None]
        if self.material is not None and properties:
            accepted = "give either a known material, or its properties"
            raise Refused((properties[0],), f"{properties[0]} with material", accepted)
        missing = next((name for name in PROPERTIES if name not in properties), None)
        if self.material is None and missing is not None:
            accepted = "a body has youngs_modulus, poisson_ratio, density and yield_strength"
            if missing == "yield_strength":
                accepted += "; only v_cr needs it with laws without yield: enter 10 MPa, say"
            raise Refused((), f"{missing} is missing", accepted)

    @property
    def solid(self) -> sj.Material:
        if self.material is not None:
            return NAMED[self.material]
        return sj.Material(**{name: getattr(self, name) for name in PROPERTIES})


class _OtherBody(BodyTable):
    """The wall or the second sphere.

    With `correlated` its properties have the errors of the first body's (true: they are of one
    steel), or of those of the `[[material]]` of that name, which `material = "name"` stands for.
    """

    correlated: bool | str = False


OtherBodyTable: Any = create_model(
    "OtherBodyTable",
    __base__=_OtherBody,
    **_uncertainty_fields({name: OF_ENTRY[name] for name in PROPERTIES}),
)


class _Material(BodyTable):
    """One `[[material]]`, but the uncertainties for all rows."""

    name: Annotated[Text, Field(max_length=LONGEST_NAME)] | None = None
    data: Text | None = None
    sheet: Text | None = None
    repeats: bool | None = None
    radius: Length = None
    radius_1: Length = None
    radius_2: Length = None
    diameter: Length = None
    diameter_1: Length = None
    diameter_2: Length = None
    wall: OtherBodyTable | None = None
    second: OtherBodyTable | None = None
    area: Literal["zhou", "hertz"] | None = None
    limit_velocity: Annotated[float | None, measure("m/s")] = None
    gravity: Annotated[float | None, measure("m/s^2")] = None
    air: AirOption = None
    mass: Annotated[float | None, measure("kg")] = None
    height_offset: Annotated[float | None, measure("m", "a length", signed=True)] = None
    height_scale: Factor = None
    velocity_scale: Factor = None
    time_scale: Factor = None
    dent: Literal["largest", "residual"] = "largest"
    frame_rate: Annotated[
        float | None,
        Field(gt=0, json_schema_extra={"accepted": "a positive number of frames a second"}),
    ] = None
    scale: Length = None
    down: bool | None = None
    exposure: Annotated[float | None, measure("s", "a time of 0 or more", True)] = None
    object: Text | None = None
    bounce_contact_time: Annotated[float | None, measure("s", "a time of 0 or more", True)] = None
    average_repeats: Literal[True, False, "pooled"] = False
    plausibility: bool = True
    parameters: Parameters = Field(default_factory=dict)

    def check(self) -> None:
        """Refuse bodies, or sizes, that do not go together."""
        if not self.has_bodies:
            return
        if self.mass is not None:
            accepted = "left out where the bodies' properties are given, from which it follows"
            raise Refused(("mass",), "mass in addition to the bodies", accepted)
        super().check()
        sizes, second = [*self.sizes], self.second is not None
        if self.wall is not None and second:
            accepted = "give either [material.wall] or [material.second]"
            raise Refused(("second",), "both a wall and a second body", accepted)
        of_second = [{"radius_2"}, {"diameter_2"}] * second
        of_two = [{*RADII[1:]}, {*DIAMETERS[1:]}] * (self.wall is None)
        in_rows = [set()] * (self.data is not None)
        if {*sizes} not in ({RADII[0]}, {DIAMETERS[0]}, *of_two, *of_second, *in_rows):
            needed = (
                NEEDED_RADII
                if self.wall is None
                else "needed next to a wall is radius or diameter, of the sphere"
            )
            raise Refused((*sizes[:1],), f"radii given are {listed(sizes) or 'none'}", needed)

    @property
    def has_bodies(self) -> bool:
        return bool(BODIES & self.model_fields_set) and not self.is_ball

    @property
    def is_ball(self) -> bool:
        """Whether only the size and mass of a ball are stated, or its mass alone."""
        stated = BODIES & self.model_fields_set
        pairs = [{a, b} for a in ("radius", "diameter") for b in ("mass", "density")]
        return stated in [*pairs, {"mass"}]

    @property
    def radii(self) -> list[float]:
        """Stated radii [m]: one for both spheres, or one for each."""
        return [value if name in RADII else value / 2 for name, value in self.sizes.items()]

    @property
    def sizes(self) -> dict[str, float]:
        """Radii and diameters as they are stated."""
        return {n: x for n in (*RADII, *DIAMETERS) if (x := getattr(self, n)) is not None}

    @property
    def in_rows(self) -> bool:
        """Whether the size of the sphere is left to the rows of the data; a second one stays."""
        is_second = self.second is not None and [*self.sizes] in (["radius_2"], ["diameter_2"])
        return self.has_bodies and self.data is not None and (not self.sizes or is_second)

    @property
    def other(self) -> BodyTable | None:
        return self.wall or self.second


_ROWS: dict[str, Any] = {
    name: (Annotated[float | None, measure(si, "a number of 0 or more", True, True)], None)
    for name, si in UNCERTAINTIES.items()
}
_ROWS["uncertainty"] = Annotated[float | None, measure("1", of_rows=True)], None
_ROWS |= _uncertainty_fields(OF_ENTRY)
MaterialTable: Any = create_model("MaterialTable", __base__=_Material, **_ROWS)


class FileOptions(FitOptions):
    """The `[fit]` table: the settings of a fit, contact area and air of all its materials."""

    area: Literal["zhou", "hertz"] | None = None
    air: AirOption = None


def _with_named_bodies(entry: dict[str, Any], known: Mapping[str, Any]) -> dict[str, Any]:
    """An entry whose other body has the properties of the entry that it names."""
    changed = {}
    for owner in OWNERS[1:]:
        body: dict[str, Any] = entry[owner] if isinstance(entry.get(owner), dict) else {}
        name = body.get("material")
        if isinstance(name, str) and name in known and name not in NAMED:
            names = ("material", *PROPERTIES, *(f"{each}_uncertainty" for each in PROPERTIES))
            same = {each: known[name][each] for each in names if each in known[name]}
            changed[owner] = {n: x for n, x in body.items() if n != "material"} | same
            changed[owner]["correlated"] = name
    return entry | changed


class MaterialTables(Strict):
    """A material file."""

    material: Annotated[
        list[MaterialTable],
        Field(json_schema_extra={"accepted": "an array of tables: write [[material]] for each"}),
    ] = Field(default_factory=list)
    fit: FileOptions = FileOptions()
    parameters: Parameters = Field(default_factory=dict)

    @model_validator(mode="before")
    @classmethod
    def _of_one_material(cls, values: Any) -> Any:
        """Walls and second bodies of the material of another entry, with its properties."""
        entries = values.get("material") if isinstance(values, dict) else None
        if not (isinstance(entries, list) and all(isinstance(entry, dict) for entry in entries)):
            return values
        known = {entry["name"]: entry for entry in entries if isinstance(entry.get("name"), str)}
        return values | {"material": [_with_named_bodies(entry, known) for entry in entries]}

    @model_validator(mode="after")
    def _together(self) -> "MaterialTables":
        if not self.material:
            raise Refused((), "no material", "one [[material]] or more is needed")
        names: set[str] = set()
        for i, name in enumerate(self.names):  # results are keyed by the name
            if name in names:
                problem = f"a second material is named {name!r}"
                accepted = "each material needs a different name"
                raise Refused(("material", i, "name"), problem, accepted)
            names.add(name)
        for i, table in enumerate(self.material):
            if {"c1", "c2"} & {*self.parameters} and "chi" in table.parameters:
                accepted = "only one is possible, as chi = c1 + c2 E/Y"
                place = ("material", i, "parameters", "chi")
                raise Refused(place, "chi with c1 and c2", accepted)
        return self

    @property
    def names(self) -> list[str]:
        """The name of each material, else that of its data file."""
        return [
            printable(table.name or Path(table.data or "").stem or f"material {i}")
            for i, table in enumerate(self.material, start=1)
        ]


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
