"""Base of the models of input: strict fields, and messages about faults."""

import math
import re
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from typing import Annotated, Any, TypeVar, cast, get_args

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, WithJsonSchema
from pydantic.fields import FieldInfo

from calibration.errors import DataError, did_you_mean

NOUNS = {"model_type": "a table", "dict_type": "a table", "string_type": "a text"}
NOUNS |= {"list_type": "a list", "bool_type": "true or false", "int_type": "a whole number"}
NOUNS["int_from_float"] = "a whole number"
MOST = 200  # characters of what is accepted
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
        for name, value in values.items():
            if name not in cls.model_fields:
                near = did_you_mean(name, cls.model_fields)
                raise TypeError(f"unknown option {name!r}{near}")
            if getattr(value, "ndim", None) == 0:  # a scalar of NumPy or JAX
                values[name] = value.item()
        try:
            return cls(**values)
        except ValidationError as error:
            raise next(faults(error, cls)) from None


class Refused(ValueError):
    """A fault that the validator of a table found: the place below it, what is wrong, what is accepted."""

    def __init__(self, place: tuple[str | int, ...], problem: str, accepted: str):
        super().__init__(problem)
        self.place, self.problem, self.accepted = place, problem, accepted
        self.others: tuple[Refused, ...] = ()  # further faults of the same table


def faults(error: ValidationError, model: type[BaseModel]) -> Iterator[DataError]:
    """Each fault that pydantic found, with the place as its argument."""
    for fault in error.errors():
        cause = fault.get("ctx", {}).get("error")
        yield cause if isinstance(cause, DataError) else fault_of(fault, model)


def fault_of(fault: Mapping[str, Any], model: type[BaseModel]) -> DataError:
    """One of pydantic's errors as a `DataError`, its place as `fits[0].rms`."""
    place = "".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in fault["loc"])
    value, (field, _) = fault["input"], _walk(model, fault["loc"])
    value = "a table" if isinstance(value, dict) else value
    known: Any = re.sub("^(Value error, |Input should be |String should have )", "", fault["msg"])
    known = NOUNS.get(fault["type"], known)
    if fault["type"] == "literal_error":  # as TOML has words and truth values
        known = known.replace("'", '"').replace("True, False", "true, false")
    if fault["type"] == "missing":
        value, known = "missing", "there"
    elif fault["type"] == "extra_forbidden":
        names = known_below(model, fault["loc"][:-1])
        near = did_you_mean(str(fault["loc"][-1]), names)
        value, known = "unknown", f"left out: known are {', '.join(names)}"[:MOST] + near
    elif fault["type"] != "value_error" and field is not None:
        known = (field.json_schema_extra or {}).get("accepted", known)  # type: ignore[union-attr]
    if isinstance(fault["input"], str) and value != "unknown":
        known += " without quotation marks" * (fault["type"] in ("float_type", "int_type"))
        words = [word for word in known.split('"')[1::2] if not re.search(r"\d", word)]
        known = known[:MOST] + "…" * (len(known) > MOST) + did_you_mean(value, words)
        value = f'"{value}"'
    return DataError(place.lstrip("."), value, known)


def known_below(model: type[BaseModel], place: tuple[Any, ...]) -> list[str]:
    """The keys that a table may have."""
    below = _walk(model, place)[1]
    return [] if below is None else list(below.model_fields)


def choices(model: type[BaseModel], name: str) -> tuple[Any, ...]:
    """The words that a field may be, without null; empty for other fields."""
    schema = _schema_of(model)["properties"][name]
    parts = schema.get("anyOf", [schema])
    words = [word for p in parts for word in p.get("enum", [p["const"]] if "const" in p else [])]
    return tuple(word for word in words if word is not None)


@cache
def _schema_of(model: type[BaseModel]) -> dict[str, Any]:
    return model.model_json_schema()


def _walk(
    model: type[BaseModel], place: Iterable[Any]
) -> tuple[FieldInfo | None, type[BaseModel] | None]:
    """The innermost field of a place, and the model that is its value or an entry of it."""
    field, below = None, cast(type[BaseModel] | None, model)
    for part in place:
        if below is not None and part in below.model_fields:
            field = below.model_fields[part]
            below = next(_models(field.annotation), None)
    return field, below


def _models(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for inner in get_args(annotation):
        yield from _models(inner)
