"""TOML files as pydantic models: every fault has its file and line.

`tomllib` does not say on which line a key stands: it reads what each line alone would begin, once
texts of several lines are out of the way.
"""

import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any, Generic, TypeVar

from pydantic import ValidationError

from calibration.data.text_file import MIB, read_text
from calibration.errors import DataError, InputError, did_you_mean, listed, shown
from calibration.schema import Refused, Strict, fault_of, known_below

LARGEST = 2 * MIB
MOST = 16  # keys that a refusal names
FAULTS = 20  # that are listed at most
Place = tuple[str | int, ...]
Model = TypeVar("Model", bound=Strict)
LONG_TEXT = re.compile(r'"""(?:\\.|[^\\])*?"""' r"|'''.*?'''", re.DOTALL)


@dataclass(frozen=True)
class TomlFile(Generic[Model]):
    """A file that was read, and the line of each key: ("material", 1, "radius")."""

    path: str
    content: Model
    lines: Mapping[Place, int]

    def line(self, place: Place) -> int | None:
        return line_of(self.lines, place)

    def refusal(self, place: Place, problem: str, accepted: str) -> InputError:
        return InputError(self.path, self.line(place), problem, accepted)


def read_toml_file(path: str | Path, model: type[Model]) -> TomlFile[Model]:
    """A file of at most 2 MiB as a model; raises InputError with all that the model refuses."""
    text = read_text(path, LARGEST).replace("\r\n", "\n").replace("\r", "\n")
    try:
        values = tomllib.loads(text)
    except RecursionError:
        raise InputError(path, None, "nested too deeply", "a plainer file is needed") from None
    except ValueError as error:  # the parser's own, or Python's for a number of 5000 digits
        raise _syntax_error(path, text, str(error)) from None
    try:
        return TomlFile(str(path), model.model_validate(values), lines_of(text))
    except ValidationError as error:
        lines = lines_of(text)
        faults = (_faults(path, lines, fault, model) for fault in error.errors()[: FAULTS + 1])
        raise combined(chain.from_iterable(faults)) from None


def line_of(lines: Mapping[Place, int], place: Place) -> int | None:
    """The line of a key, or of the nearest table above it."""
    while place and place not in lines:
        place = place[:-1]
    return lines.get(place)


def combined(faults: Iterable[InputError]) -> InputError:
    """Several refusals as one, by file and line."""
    first, *others = sorted(faults, key=lambda fault: (fault.file or "", fault.line or 0))
    first.others = tuple(others)
    return first


def _faults(
    path: str | Path, lines: Mapping[Place, int], reported: Any, model: type[Strict]
) -> Iterator[InputError]:
    """List the faults that pydantic found at one place, each with its line."""
    place, cause = reported["loc"], reported.get("ctx", {}).get("error")
    if not isinstance(cause, Refused):
        yield _fault(path, lines, reported, model)
        return
    for refused in (cause, *cause.others):
        line = line_of(lines, (*place, *refused.place)) or 1
        yield InputError(path, line, refused.problem, refused.accepted)


def _fault(
    path: str | Path, lines: Mapping[Place, int], reported: Any, model: type[Strict]
) -> InputError:
    place, cause = reported["loc"], reported.get("ctx", {}).get("error")
    if reported["type"] == "extra_forbidden":
        known = known_below(model, place[:-1])
        more = f" and {len(known) - MOST} more" if len(known) > MOST else ""
        near = did_you_mean(str(place[-1]), known).strip(" ()")
        near = "it belongs under [fit]" if place[-1] in known_below(model, ("fit",)) else near
        accepted = near or f"known here are {listed(known[:MOST])}{more}"
        return InputError(
            path, line_of(lines, place), f"unknown key {shown(repr(place[-1]))}", accepted
        )
    if isinstance(cause, DataError):
        return cause.at(path, line_of(lines, (*place, cause.argument)) or 1)
    fault = fault_of(reported, model)
    fault.argument = str(place[-1])
    if isinstance(reported["input"], bool):
        fault.value = fault.value.lower()
    return fault.at(path, line_of(lines, place) or 1)


def _syntax_error(path: str | Path, text: str, message: str) -> InputError:
    """The parser has its line in its words only (until Python 3.14)."""
    match = re.fullmatch(r"(.*) \(at (?:line (\d+), column \d+|end of document)\)", message)
    problem, line = (match[1], match[2]) if match else (message, None)
    at_end = text.rstrip("\n").count("\n") + 1
    accepted = "a TOML file is needed, one `key = value` in each line, text in quotation marks"
    if line and re.search(r"=\s*[+-]?\d+,\d", text.split("\n")[int(line) - 1]):
        accepted = "a decimal has a point, 0.33, no comma"
    fault = f"no valid TOML: {shown(problem)}"
    return InputError(path, int(line) if line else at_end, fault, accepted)


def lines_of(text: str) -> dict[Place, int]:
    """Line, from 1, of every table and key of a valid TOML text, by its place."""
    lines: dict[Place, int] = {}
    last: dict[Place, int] = {}  # position of the latest entry of each array of tables
    table: Place = ()
    one_line_each = LONG_TEXT.sub(lambda match: "\n" * match[0].count("\n"), text)
    for line, statement in enumerate(one_line_each.split("\n"), start=1):
        is_header = statement.lstrip().startswith("[")
        try:
            inner: Any = tomllib.loads(
                statement if is_header else statement.partition("=")[0] + "= 0"
            )
        except tomllib.TOMLDecodeError:  # within a list
            continue
        place = () if is_header else table
        while isinstance(inner, dict) and inner:
            ((name, inner),) = inner.items()
            place = (*place, name)
            if isinstance(
                inner, list
            ):  # `[[material]]` opens the next entry, `[material.wall]` its table
                last[place] = last.get(place, -1) + 1
            if place in last:
                place = (*place, last[place])
            lines.setdefault(place, line)
        table = place if is_header else table
    return lines
