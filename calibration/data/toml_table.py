"""Tables of a TOML file that know where they stand, so that a refusal names file and line."""

import re
import tomllib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from calibration.data.text_file import MIB, read_text
from calibration.data.toml_lines import DEEPEST, lines_of, too_deep
from calibration.data.units import Relative, quantity
from calibration.errors import DataError, InputError, did_you_mean, is_finite_number, listed, shown

LARGEST = 2 * MIB
MOST = 16  # keys that a refusal names


@dataclass(frozen=True)
class TomlTable:
    """One table of a file.

    Attributes:
        file: the file's path as given.
        lines: line of every key of the file, by its path.
        path: where in the file this table is.
        values: what it holds.
    """

    file: str
    lines: Mapping[tuple[str | int, ...], int]
    path: tuple[str | int, ...]
    values: Mapping[str, Any]

    def __contains__(self, key: str) -> bool:
        return key in self.values

    def line(self, key: str | None = None) -> int | None:
        """The line of a key; of the table itself without one, or where the key is missing."""
        path = self.path if key is None else (*self.path, key)
        while path and path not in self.lines:
            path = path[:-1]
        return self.lines.get(path)

    def refusal(self, key: str | None, problem: str, accepted: str) -> InputError:
        return InputError(self.file, self.line(key), problem, accepted)

    def wrong(self, key: str, accepted: str) -> InputError:
        """The value of `key` is not what is accepted."""
        value = self.values[key]
        told = _as_toml(value) if isinstance(value, str | bool) else value
        return self.placed(DataError(key, told, accepted), key)

    def placed(self, error: DataError, key: str | None = None) -> InputError:
        """A refusal of an argument, told at the line of `key`."""
        return error.at(self.file, self.line(key))

    def allow(self, known: Iterable[str]) -> None:
        """Refuse keys that are not known."""
        known = tuple(known)
        for key in self.values:
            if key not in known:
                near = did_you_mean(key, known).strip(" ()")
                more = f" and {len(known) - MOST} more" if len(known) > MOST else ""
                accepted = near or f"known here are {listed(known[:MOST])}{more}"
                raise self.refusal(key, f"unknown key {shown(repr(key))}", accepted)

    def number(self, key: str, holds: Callable[[float], bool], accepted: str) -> float | None:
        """A finite number for which `holds`, or None where the key is missing."""
        if key not in self.values:
            return None
        value = self.values[key]
        if not is_finite_number(value) or not holds(value):
            raise self.wrong(key, accepted)
        return float(value)

    def quantity(
        self, key: str, dimension: str, holds: Callable[[float], bool], accepted: str
    ) -> float | None:
        """The same of a number in SI, or of text with its unit: "69 GPa".

        Of an uncertainty a percentage is a `Relative`; no other quantity is one.
        """
        value = self.values.get(key)
        if not isinstance(value, str):
            return self.number(key, holds, accepted)
        try:
            number = quantity(value, dimension)
        except DataError as error:
            known = accepted if error.argument == "quantity" else f"{accepted}, {error.accepted}"
            raise self.wrong(key, known) from None
        is_part = isinstance(number, Relative) and not key.endswith("uncertainty")
        if is_part or not is_finite_number(number) or not holds(number):
            raise self.wrong(key, accepted)
        return number

    def text(self, key: str) -> str | None:
        if key not in self.values:
            return None
        value = self.values[key]
        if not (isinstance(value, str) and value.strip()):
            raise self.wrong(key, "a text that is not empty")
        return value

    def choice(self, key: str, choices: Iterable[Any]) -> Any:
        """One of `choices`, or None where the key is missing."""
        choices = tuple(choices)
        # 1 == True in Python, but not in a file
        if key in self.values and not any(_alike(self.values[key], one) for one in choices):
            near = did_you_mean(shown(self.values[key]), [str(one) for one in choices])
            raise self.wrong(key, " or ".join(map(_as_toml, choices)) + near)
        return self.values.get(key)

    def table(self, key: str) -> "TomlTable | None":
        """The table below `key`, or None where there is none."""
        if key not in self.values:
            return None
        if not isinstance(self.values[key], dict):
            raise self.wrong(key, f"a table: {self._header(key)} and its keys below")
        return self.below(key, self.values[key])

    def below(self, key: str, values: Mapping[str, Any]) -> "TomlTable":
        return TomlTable(self.file, self.lines, (*self.path, key), values)

    def tables(self, key: str) -> list["TomlTable"]:
        """The tables of an array of tables."""
        entries = self.values.get(key, [])
        if not isinstance(entries, list) or not all(isinstance(one, dict) for one in entries):
            problem, accepted = f"{key} is not an array of tables", f"write [[{key}]] for each"
            raise self.refusal(key, problem, accepted)
        return [
            TomlTable(self.file, self.lines, (*self.path, key, i), one)
            for i, one in enumerate(entries)
        ]

    def _header(self, key: str) -> str:
        names = [part for part in (*self.path, key) if isinstance(part, str)]
        return f"[{'.'.join(names)}]"


def read_toml_table(path: str | Path) -> TomlTable:
    """The whole file, of at most 2 MiB, as a table.

    Raises:
        InputError: where it cannot be read or is no TOML, with the line where the parser stopped.
    """
    text = read_text(path, LARGEST)
    deep = too_deep(text)
    if deep is not None:
        accepted = f"{DEEPEST} brackets in each other, or parts of a key, are accepted"
        raise InputError(path, deep, "nested too deeply", accepted)
    try:
        values = tomllib.loads(text)
    except ValueError as error:  # the parser's own, or Python's for a number of 5000 digits
        raise _syntax_error(path, text, str(error)) from None
    return TomlTable(str(path), lines_of(text), (), values)


def _syntax_error(path: str | Path, text: str, message: str) -> InputError:
    """The parser has its line in its words only (until Python 3.14)."""
    match = re.fullmatch(r"(.*) \(at (?:line (\d+), column \d+|end of document)\)", message)
    problem, line = (match[1], match[2]) if match else (message, None)
    at_end = text.rstrip("\n").count("\n") + 1
    accepted = "a TOML file is needed, `key = value` a line, text in quotation marks"
    told = f"no valid TOML: {shown(problem)}"
    return InputError(path, int(line) if line else at_end, told, accepted)


def _alike(one: Any, other: Any) -> bool:
    return type(one) is type(other) and one == other


def _as_toml(value: Any) -> str:
    return f'"{value}"' if isinstance(value, str) else str(value).lower()
