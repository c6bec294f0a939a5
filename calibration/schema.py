"""Base of the models of input: strict fields, and messages about faults."""

import math
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from typing import Annotated, Any, TypeVar, cast

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, WithJsonSchema

from calibration.errors import DataError, did_you_mean

NOUNS = {
    "integer": "a whole number",
    "number": "a number",
    "boolean": "true or false",
    "string": "a text",
    "array": "a list",
    "object": "a table",
}
MOST = 9  # words that a refusal lists
Model = TypeVar("Model", bound="Strict")
# a number, or NaN, which JSON writes as null
Real = Annotated[
    float,
    Field(allow_inf_nan=True),
    BeforeValidator(lambda value: math.nan if value is None else value),
    WithJsonSchema({"anyOf": [{"type": "number"}, {"type": "null"}]}),
]


class Strict(BaseModel):
    """A frozen model that knows all its fields and converts nothing."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, strict=True, allow_inf_nan=False, arbitrary_types_allowed=True
    )

    @classmethod
    def of(cls: type[Model], **values: Any) -> Model:
        """The model of these values; raises DataError, or TypeError for an unknown name."""
        for name in values:
            if name not in cls.model_fields:
                near = did_you_mean(name, cls.model_fields)
                raise TypeError(f"unknown option {name!r}{near}")
        try:
            return cls(**values)
        except ValidationError as error:
            raise next(faults(error, cls)) from None


class Refused(ValueError):
    """A fault that the validator of a table found: the place below it, what is wrong, what is accepted."""

    def __init__(self, place: tuple[str | int, ...], problem: str, accepted: str):
        super().__init__(problem)
        self.place, self.problem, self.accepted = place, problem, accepted


def faults(error: ValidationError, model: type[BaseModel]) -> Iterator[DataError]:
    """Each fault that pydantic found, with the place as its argument."""
    for fault in error.errors():
        cause = fault.get("ctx", {}).get("error")
        yield cause if isinstance(cause, DataError) else fault_of(fault, model)


def fault_of(fault: Mapping[str, Any], model: type[BaseModel]) -> DataError:
    """One of pydantic's errors as a `DataError`."""
    place, schema = _walk(model, fault["loc"])
    value, known = fault["input"], words(schema)
    if fault["type"] == "missing":
        value, known = "missing", "there"
    elif fault["type"] == "extra_forbidden":
        known = "left out: it is not known"
        known += did_you_mean(str(fault["loc"][-1]), known_below(model, fault["loc"][:-1]))
        return DataError(place, "there", known)
    elif fault["type"] == "value_error":
        known = fault["msg"].removeprefix("Value error, ")
    if isinstance(fault["input"], str):
        known += did_you_mean(value, known.split('"'))
        value = f'"{value}"'
    return DataError(place, value, known)


def known_below(model: type[BaseModel], place: tuple[Any, ...]) -> list[str]:
    """The keys that a table may have."""
    return list(_walk(model, place)[1].get("properties", {}))


def accepted(model: type[BaseModel], place: tuple[Any, ...]) -> str:
    """Describe what a field accepts."""
    return words(_walk(model, place)[1])


def _walk(model: type[BaseModel], place: Iterable[Any]) -> tuple[str, Mapping[str, Any]]:
    """A place as `fits[0].rms`, without pydantic's names of alternatives, and its schema."""
    root = schema_of(model)
    name, schema = "", cast(Mapping[str, Any], root)
    for part in place:
        below = (_inner(_resolved(branch, root), part) for branch in _parts(schema))
        inner = next(filter(None, below), None)
        if inner is None and part not in _resolved(schema, root).get("properties", {part: 0}):
            name = f"{name}.{part}"  # an unknown key
        if inner is not None:
            name += f"[{part}]" if isinstance(part, int) else f".{part}"
            schema = inner
    return name.lstrip("."), _resolved(schema, root)


def _inner(schema: Mapping[str, Any], part: Any) -> Mapping[str, Any] | None:
    """The schema of an entry, None where there is none."""
    if isinstance(part, int):
        items = schema.get("prefixItems", [])
        return items[part] if part < len(items) else schema.get("items")
    more = schema.get("additionalProperties")
    return schema.get("properties", {}).get(part) or (more if isinstance(more, dict) else None)


@cache
def schema_of(model: type[BaseModel]) -> dict[str, Any]:
    """The JSON Schema of a model."""
    return model.model_json_schema()


def choices(model: type[BaseModel], name: str) -> tuple[Any, ...]:
    """The words that a field may be, without null; empty for other fields."""
    return tuple(w for p in _parts(schema_of(model)["properties"][name]) for w in _enum(p))


def words(schema: Mapping[str, Any]) -> str:
    """Describe what a JSON Schema accepts, without null, which means a missing value."""
    if "accepted" in schema:
        return schema["accepted"]
    return " or ".join(dict.fromkeys(_words(part) for part in _parts(schema)))


def _parts(schema: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    parts = schema.get("anyOf", [schema])
    return [part for part in parts if part.get("type") != "null"]


def _words(schema: Mapping[str, Any]) -> str:
    if _enum(schema):
        allowed = [str(x).lower() if isinstance(x, bool) else f'"{x}"' for x in _enum(schema)]
        more = f" or {len(allowed) - MOST} more" if len(allowed) > MOST else ""
        return " or ".join(allowed[:MOST]) + more
    noun = NOUNS.get(schema.get("type", ""), "a value")
    lowest, highest = schema.get("minimum"), schema.get("maximum")
    above, below = schema.get("exclusiveMinimum"), schema.get("exclusiveMaximum")
    if above is not None and below is not None:
        return f"{noun} between {above:g} and {below:g}"
    if lowest is not None and highest is not None:
        return f"{noun} in [{lowest:g}, {highest:g}]"
    if above == 0:
        return noun.replace("a ", "a positive ", 1)
    return noun if lowest is None else f"{noun} of {lowest:g} or more"


def _enum(schema: Mapping[str, Any]) -> list[Any]:
    values = schema.get("enum", [schema["const"]] if "const" in schema else [])
    return [value for value in values if value is not None]


def _resolved(schema: Mapping[str, Any], root: Mapping[str, Any]) -> Mapping[str, Any]:
    parts = _parts(schema)
    if len(parts) == 1 and "$ref" in parts[0]:
        return root["$defs"][parts[0]["$ref"].rpartition("/")[2]]
    return schema
