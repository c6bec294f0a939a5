"""What the models of input have in common: strict fields, and faults in the words of the house."""

from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError, model_validator

from calibration.errors import DataError, did_you_mean

NOUNS = {
    "integer": "a whole number",
    "number": "a number",
    "boolean": "true or false",
    "string": "a text",
    "array": "a list",
    "object": "a table",
}
Model = TypeVar("Model", bound="Strict")


class Strict(BaseModel):
    """A frozen model that knows all its fields: nothing is converted but numbers of NumPy and JAX."""

    model_config = ConfigDict(
        extra="forbid",
        frozen=True,
        strict=True,
        allow_inf_nan=False,
        arbitrary_types_allowed=True,
    )

    @model_validator(mode="before")
    @classmethod
    def _plain(cls, given: Any) -> Any:
        """Scalars of NumPy and JAX as Python's."""
        if not isinstance(given, dict):
            return given
        return {name: _as_python(value) for name, value in given.items()}

    @classmethod
    def of(cls: type[Model], **given: Any) -> Model:
        """The model of these values.

        Raises:
            DataError: a ValueError for the first that is not accepted.
            TypeError: for a name that there is not.
        """
        for name in given:
            if name not in cls.model_fields:
                near = did_you_mean(name, cls.model_fields)
                raise TypeError(f"unknown option {name!r}{near}")
        try:
            return cls(**given)
        except ValidationError as error:
            raise next(faults(error, cls)) from None


def faults(error: ValidationError, model: type[BaseModel]) -> Iterator[DataError]:
    """Each fault that pydantic found, with the place as its argument."""
    for one in error.errors():
        cause = one.get("ctx", {}).get("error")
        if isinstance(cause, DataError):
            yield cause
        else:
            place = ".".join(str(part) for part in one["loc"])
            given, known = one["input"], accepted(model, one["loc"])
            near = did_you_mean(given, known.split('"')) if isinstance(given, str) else ""
            yield DataError(place, f'"{given}"' if isinstance(given, str) else given, known + near)


def accepted(model: type[BaseModel], place: tuple[Any, ...]) -> str:
    """What a field of a model accepts, in words."""
    root = schema_of(model)
    found: Mapping[str, Any] = root
    for part in place:
        found = _resolved(found, root)
        if isinstance(part, int):
            found = found.get("items", {})
        else:
            found = found.get("properties", {}).get(part) or found.get("additionalProperties", {})
    return words(_resolved(found, root))


@cache
def schema_of(model: type[BaseModel]) -> dict[str, Any]:
    """The JSON Schema of a model."""
    return model.model_json_schema()


def choices(model: type[BaseModel], name: str) -> tuple[Any, ...]:
    """The words that a field may be, without null; empty for other fields."""
    return tuple(
        one for part in _parts(schema_of(model)["properties"][name]) for one in _enum(part)
    )


def words(schema: Mapping[str, Any]) -> str:
    """What a JSON Schema accepts, in words; null is how Python leaves something out."""
    if "accepted" in schema:
        return schema["accepted"]
    return " or ".join(dict.fromkeys(_words(part) for part in _parts(schema)))


def _parts(schema: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    parts = schema.get("anyOf", [schema])
    return [part for part in parts if part.get("type") != "null"]


def _words(schema: Mapping[str, Any]) -> str:
    if _enum(schema):
        return " or ".join(f'"{one}"' for one in _enum(schema))
    noun = NOUNS.get(schema.get("type", ""), "a value")
    least, most = schema.get("minimum"), schema.get("maximum")
    above, below = schema.get("exclusiveMinimum"), schema.get("exclusiveMaximum")
    if above is not None and below is not None:
        return f"{noun} between {above:g} and {below:g}"
    if least is not None and most is not None:
        return f"{noun} in [{least:g}, {most:g}]"
    if above == 0:
        return noun.replace("a ", "a positive ", 1)
    return noun if least is None else f"{noun} of {least:g} or more"


def _enum(schema: Mapping[str, Any]) -> list[Any]:
    every = schema.get("enum", [schema["const"]] if "const" in schema else [])
    return [one for one in every if one is not None]


def _resolved(schema: Mapping[str, Any], root: Mapping[str, Any]) -> Mapping[str, Any]:
    parts = _parts(schema)
    if len(parts) == 1 and "$ref" in parts[0]:
        return root["$defs"][parts[0]["$ref"].rpartition("/")[2]]
    return schema


def _as_python(value: Any) -> Any:
    is_scalar = hasattr(value, "dtype") and getattr(value, "ndim", None) == 0
    return value.item() if is_scalar else value
