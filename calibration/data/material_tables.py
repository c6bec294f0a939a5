"""The tables of material files: bodies, measured sets, settings of the fit; how they are checked.

    [fit]                        # settings of the fit: `calibration.FitOptions`, and `area`
    [parameters]                 # of all materials together; may be left out
    [[material]]                 # its bodies, the name of its data file, and remarks on these
    [material.second]            # the other sphere, where its properties differ; or
    [material.wall]              # a flat wall, with its properties
    [material.parameters]        # a number fixes; a table gives start, bounds, prior, sharing

A number is in SI, a text has its unit. The reference has an example with all keys.
`MaterialTables.model_json_schema()` is the JSON Schema of these files.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

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
from calibration.data.columns import UNCERTAINTIES
from calibration.data.inputs import (
    EXACT,
    OF_ENTRY,
    divided,
)
from calibration.data.measurements import LONGEST_NAME
from calibration.data.rows import STANDARD_GRAVITY
from calibration.data.stated import Parameters, measure
from calibration.errors import listed, printable
from calibration.options import FitOptions
from calibration.schema import Refused, Strict

RADII = ("radius", "radius_1", "radius_2")
DIAMETERS = tuple(name.replace("radius", "diameter") for name in RADII)
PROPERTIES = ("youngs_modulus", "poisson_ratio", "density", "yield_strength")
NAMED = {"stainless steel": sj.STAINLESS_STEEL, "chrome steel": sj.CHROME_STEEL, "nylon": sj.NYLON}
NAMED_SOURCE = "Table 1 of Zhou (2013)"
BODIES = {"material", *PROPERTIES, *RADII, *DIAMETERS, "wall", "second", "area", "mass"}
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
