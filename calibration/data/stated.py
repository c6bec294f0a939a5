"""Quantities and parameters as a material file states them: numbers in SI, or text with units."""

from typing import Annotated, Any

from pydantic import Field, PlainValidator, WithJsonSchema

from calibration.data.units import NAMED, parted, quantity, unit_of
from calibration.errors import DataError, is_finite_number, shown
from calibration.parameters import Parameter
from calibration.schema import Refused

# of parameters that may have their unit in the file
OF_PARAMETERS = {"youngs_modulus": "Pa", "yield_strength": "Pa", "radius": "m", "mass": "kg"}
OF_PARAMETERS |= {"limit_velocity": "m/s", "dissipation_time": "s"}
OF_PARAMETERS |= dict.fromkeys(("stiffness", "loading_stiffness", "unloading_stiffness"), "N/m")


def measure(
    si: str,
    accepted: str = "a positive number",
    from_zero: bool = False,
    of_rows: bool = False,
    signed: bool = False,
) -> Any:
    """A quantity in a file: a number in SI, or text with its unit ("69 GPa").

    `of_rows`: of all rows of a table, in the unit of these: a percentage is accepted, text stays text.
    `signed`: any finite number is accepted.
    """
    unit = f"{accepted} [{si}]".replace("^3", "³").replace("^2", "²")

    def checked(stated: Any) -> float | str:
        value = stated
        if isinstance(stated, str):
            try:
                number, written = parted(stated, si)
                value = number if of_rows and written == "%" else quantity(stated, si)
            except DataError as error:
                more = error.accepted
                if error.argument == "quantity":
                    example = "%" if si == "1" else NAMED[si].split()[0]
                    more = f'outside quotation marks, or with a decimal point and its unit, "1.5 {example}"'
                raise ValueError(f"{unit}, {more}") from None
        inside = is_finite_number(value) and (signed or (value >= 0 if from_zero else value > 0))
        if not inside:
            raise ValueError(unit)
        return stated if of_rows and isinstance(stated, str) else float(value)

    ends = Field() if signed else Field(ge=0) if from_zero else Field(gt=0)
    text = Field(description=f"in {si}, or text with its unit")
    return PlainValidator(
        checked, json_schema_input_type=Annotated[Annotated[float, ends] | str, text]
    )


def _parameters(tables: Any) -> dict[str, Parameter]:
    """`[parameters]` or `[material.parameters]`, by name: a number fixes."""
    if not isinstance(tables, dict):
        raise ValueError("a table: [parameters] and its keys below")
    parameters, refused = {}, []
    of_pair = tables.get("contact")
    if isinstance(of_pair, dict):  # contact.radius = … without quotation marks
        tables = {name: table for name, table in tables.items() if name != "contact"}
        tables |= {f"contact.{name}": table for name, table in of_pair.items()}
    for name, table in tables.items():
        try:
            parameters[name] = _parameter(name, table)
        except Refused as error:
            refused.append(error)
    if refused:
        first, *others = refused
        first.others = tuple(others)
        raise first
    return parameters


def _parameter(name: str, table: Any) -> Parameter:
    entry = table if isinstance(table, dict) else {"free": False, "value": table}
    try:
        fields = {key: _in_si(name, value, key) for key, value in entry.items()}
        return Parameter(**fields)
    except DataError as error:
        if entry is table:
            problem = f"{error.argument} of {name} is {error.value}"
            raise Refused((name, error.argument), problem, f"it must be {error.accepted}") from None
        value = f'"{table}"' if isinstance(table, str) else shown(table)
        accepted = "it must be a number, or a table such as { free = true }"
        raise Refused((name,), f"{name} is {value}", accepted) from None


def _in_si(name: str, value: Any, key: str) -> Any:
    """A value, its bounds or its prior, with texts as numbers."""
    si = OF_PARAMETERS.get(name.removeprefix("contact."))
    if isinstance(value, list):
        numbers = [_in_si(name, entry, key) for entry in value]
        _check_units(value, key, si)
        return numbers
    if not isinstance(value, str) or key in ("transform", "shared", "free", "unit"):
        return value
    if si is None:
        raise DataError(key, f'"{value}"', "a number in SI")
    try:
        return quantity(value, si)
    except DataError as error:
        raise DataError(key, f'"{value}"', error.accepted) from None


def _check_units(entries: list[Any], key: str, si: str | None) -> None:
    """Refuse a number without a unit next to one in another unit than SI; 0 has none."""
    bare = next((entry for entry in entries if is_finite_number(entry) and entry), None)
    for text in filter(lambda entry: isinstance(entry, str), entries):
        unit = "" if si is None else parted(text, si)[1]
        if si is not None and bare is not None and unit_of(unit, si) != 1:
            accepted = f'"{bare:g} {si}" or "{bare:g} {unit}"'
            raise DataError(key, f'{bare:g}, without a unit next to "{text}"', accepted)


Parameters = Annotated[
    dict[str, Any],
    PlainValidator(_parameters),
    WithJsonSchema({"type": "object", "additionalProperties": {"type": ["number", "object"]}}),
]
