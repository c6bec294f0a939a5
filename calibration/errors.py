"""Refusals of input: what is wrong, what is accepted, and where it stands."""

import difflib
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

INSTALL = 'pip install -e ".[{}]" in its folder'  # an extra of this project


class InputError(ValueError):
    """A file, or a whole set of data, that cannot be used.

    Attributes:
        file: the file's path as the user gave it; None for data that came from no file.
        line: the line of the file, from 1; None where no line is to blame.
        problem, accepted: what is wrong and what is accepted.
        others: further faults of the same input.

    `str(error)` is the line `file:line: problem; accepted`, and one for each of the others.
    """

    def __init__(self, file: str | Path | None, line: int | None, problem: str, accepted: str):
        self.file = None if file is None else str(file)
        self.line = line
        self.problem = problem
        self.accepted = accepted
        self.others: tuple[InputError, ...] = ()

    def __str__(self) -> str:
        return "\n".join([self._line(), *map(str, self.others)])

    def _line(self) -> str:
        place = "".join(f"{part}:" for part in (self.file, self.line) if part is not None)
        return printable(" ".join(f"{place} {self.problem}; {self.accepted}".split()))


class DataError(ValueError):
    """An argument that makes no sense.

    Attributes:
        argument: its name.
        value: what it is, as text.
        accepted: what it must be.
        index: which point or row, from 0; None where the whole argument is to blame.
    """

    def __init__(self, argument: str, value: Any, accepted: str, index: int | None = None):
        self.argument = argument
        self.value = shown(value)
        self.accepted = accepted
        self.index = index

    def __str__(self) -> str:
        place = "" if self.index is None else f"[{self.index}]"
        # "must be left out, but is given" says the same twice
        value = "" if self.value == "given" else f", but is {self.value}"
        return f"`{self.argument}{place}` must be {self.accepted}{value}"

    def at(self, file: str | Path | None, line: int | None) -> InputError:
        """This refusal with file and line."""
        problem = f"{self.argument} is {self.value}"
        return InputError(file, line, problem, f"it must be {self.accepted}")


class NotWritten(OSError):
    """Results that could not be written: no space, no permission, no such name.

    `str(error)` is one line with the path and the system's words.
    """

    def __init__(self, path: str | Path, reason: OSError | str):
        self.path = path
        if isinstance(reason, OSError):
            super().__init__(reason.errno, reason.strerror)
        words = getattr(reason, "reason", None) or getattr(reason, "strerror", None)
        self.reason: str = words or str(reason)

    def __str__(self) -> str:
        reason = printable(" ".join(self.reason.split()))
        return f"{printable(repr(str(self.path)))} could not be written to ({reason})"


@dataclass(frozen=True)
class Origin:
    """Source of data: the file, the line of its header and the line of each row."""

    file: str
    line: int | None = None
    lines: tuple[int, ...] = ()

    def select(self, rows: Iterable[int]) -> "Origin":
        """The origin of some of the rows, in this order."""
        return Origin(self.file, self.line, tuple(self.lines[row] for row in rows))

    def line_of(self, index: int | None) -> int | None:
        """The line of one row, or of the header."""
        return self.line if index is None else self.lines[index]

    def error(self, error: DataError) -> InputError:
        """A refusal with the file and line of its row."""
        return error.at(self.file, self.line_of(error.index))


def shown(value: Any) -> str:
    """A value as one short line."""
    if not isinstance(value, str):
        value = f"{value:.10g}" if isinstance(value, float) else repr(value)
    text = printable(" ".join(value[:1000].split()))
    return text if len(text) <= 80 else text[:77] + "..."


def printable(text: str) -> str:
    """Text from a file, with codes for characters that would move the cursor or break the line.

    Control and format characters (escape sequences, changes of direction, line breaks) and halves
    of characters (bytes of a path that are not UTF-8) become such as `\\x1b`.
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def is_finite_number(value: Any) -> bool:
    """Whether a value is a finite real number (no truth value, no whole number beyond floats)."""
    is_real = isinstance(value, int | float) and not isinstance(value, bool)
    return is_real and abs(value) <= sys.float_info.max


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """` (did you mean 'x'?)`, or nothing where no known name is near."""
    words = {word.lstrip("-"): word for word in known}  # hyphens of options make none alike
    near = difflib.get_close_matches(name[:100].lower().lstrip("-"), words, n=1)
    return f" (did you mean {words[near[0]]!r}?)" if near else ""


def listed(names: Iterable[str]) -> str:
    return ", ".join(names)
