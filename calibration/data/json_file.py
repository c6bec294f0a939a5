"""JSON files: written in one way; from anybody of bounded size, and of a layout that is checked first.

A layout is made of functions `kind(value, place)` that raise a `DataError` naming the place, as in
`fits[0].data.velocity`.
"""

import json
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from calibration.data.text_file import MIB, read_text
from calibration.errors import DataError, InputError, is_finite_number, listed, shown

LARGEST = 24 * MIB  # which take less than a GiB of memory as Python's objects

Kind = Callable[[Any, str], None]


def plain(value: Any) -> Any:
    """JSON's own types; what is not finite becomes None, a record its fields or what it tells itself."""
    if hasattr(value, "to_dict"):
        return plain(value.to_dict())
    if is_dataclass(value):
        return plain(vars(value))
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.bool_ | bool):
        return bool(value)
    if isinstance(value, int | np.integer):
        return int(value)
    if value is None or isinstance(value, str):
        return value
    if np.ndim(value):
        return plain(np.asarray(value).tolist())
    number = float(value)
    return number if math.isfinite(number) else None


def dumps(value: Any, indent: int = 1) -> str:
    """The text of a file."""
    return json.dumps(plain(value), indent=indent, ensure_ascii=False, allow_nan=False) + "\n"


def read_json(path: str | Path) -> Any:
    """What a JSON file holds.

    Raises:
        InputError: where it cannot be read, is too large, too deep, or no JSON.
    """
    text = read_text(path, LARGEST)
    try:
        return json.loads(text, parse_constant=_no_number)
    except json.JSONDecodeError as error:
        raise InputError(path, error.lineno, f"no valid JSON: {error.msg}", ACCEPTED) from None
    except RecursionError:
        raise InputError(path, None, "nested too deeply", ACCEPTED) from None
    except ValueError as error:  # a whole number of 5000 digits, NaN
        raise InputError(path, None, f"no valid JSON: {shown(str(error))}", ACCEPTED) from None


ACCEPTED = "a JSON file is needed"


def _no_number(word: str) -> NoReturn:
    raise ValueError(f"{word} is no number")


def number(
    holds: Callable[[float], bool] = lambda _: True, accepted: str = "a finite number"
) -> Kind:
    def check(value: Any, place: str) -> None:
        if not is_finite_number(value) or not holds(value):
            raise DataError(place, value, accepted)

    return check


def whole(least: int = 0) -> Kind:
    def check(value: Any, place: str) -> None:
        if not isinstance(value, int) or isinstance(value, bool) or not least <= value < 2**53:
            raise DataError(place, value, f"a whole number of {least} or more")

    return check


def text(value: Any, place: str) -> None:
    if not isinstance(value, str):
        raise DataError(place, value, "a text")


def flag(value: Any, place: str) -> None:
    if not isinstance(value, bool):
        raise DataError(place, value, "true or false")


def choice(*words: Any) -> Kind:
    def check(value: Any, place: str) -> None:
        if not isinstance(value, str) or value not in words:
            raise DataError(place, value, f"one of {listed(words)}")

    return check


def null(value: Any, place: str) -> None:
    if value is not None:
        raise DataError(place, value, "null")


def either(*kinds: Kind) -> Kind:
    """Any of them; what the first says is told where none fits."""

    def check(value: Any, place: str) -> None:
        for kind in kinds[1:]:
            try:
                return kind(value, place)
            except DataError:
                pass
        kinds[0](value, place)

    return check


def or_null(kind: Kind) -> Kind:
    return either(kind, null)


def each(kind: Kind) -> Kind:
    """A list of them."""

    def check(value: Any, place: str) -> None:
        if not isinstance(value, list):
            raise DataError(place, value, "a list")
        for i, item in enumerate(value):
            kind(item, f"{place}[{i}]")

    return check


def every(kind: Kind) -> Kind:
    """Names and, for each, one of them."""

    def check(value: Any, place: str) -> None:
        for key, item in _object(value, place).items():
            kind(item, _below(place, key))

    return check


def table(kinds: Mapping[str, Kind], optional: Iterable[str] = (), and_more: bool = False) -> Kind:
    """These names, each with its kind; no others unless there may be more, which nobody reads."""

    def check(value: Any, place: str) -> None:
        entries = _object(value, place)
        for key in entries:
            if key not in kinds and not and_more:
                raise DataError(_below(place, key), "there", "left out: it is not known")
        for key, kind in kinds.items():
            if key in entries:
                kind(entries[key], _below(place, key))
            elif key not in optional:
                raise DataError(_below(place, key), "missing", "there")

    return check


def _object(value: Any, place: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise DataError(place or "the file", value, "a table of names, { }")
    return value


def _below(place: str, key: str) -> str:
    return f"{place}.{shown(key)}" if place else shown(key)
