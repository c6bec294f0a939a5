"""Impact velocities, block by block: a grid that is never held whole, or a column of a file."""

import io
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from itertools import chain, islice
from pathlib import Path
from typing import ClassVar, TextIO

import numpy as np
from jaxtyping import Float

from calibration.data.csv_file import CsvReader, delimiter_of
from calibration.data.names import read_header
from calibration.data.units import in_si, unit_of
from calibration.errors import DataError, InputError, Origin, shown

BLOCK = 1 << 16  # rows; larger blocks are not faster, and 2^20 of them take 10 times the memory
SPACINGS = ("lin", "log")
LONGEST = 65536  # characters of a line: a device may have no end of them

Block = Float[np.ndarray, " n"]


@dataclass(frozen=True)
class Grid:
    """`points` velocities from `first` to `last` [m/s], evenly spaced, or evenly in the logarithm.

    Raises:
        ValueError: naming what is wrong and what is accepted.
    """

    first: float
    last: float
    points: int
    spacing: str = "lin"

    def __post_init__(self):
        if self.points < 1:
            raise DataError("--points", self.points, "a whole number of 1 or more")
        if self.spacing not in SPACINGS:
            raise DataError("--spacing", self.spacing, " or ".join(SPACINGS))
        if not 0 <= self.first < np.inf:
            raise DataError("--from", self.first, "a velocity of 0 m/s or more")
        if not self.first <= self.last < np.inf:
            raise DataError("--to", self.last, f"a velocity of {self.first:g} m/s (--from) or more")
        if self.spacing == "log" and self.first == 0:
            raise DataError("--from", self.first, "a velocity above 0 m/s with --spacing log")

    def blocks(self, size: int = BLOCK) -> Iterator[Block]:
        """The velocities in ascending order."""
        for start in range(0, self.points, size):
            yield self._at(np.arange(start, min(start + size, self.points)))

    def _at(self, index: np.ndarray) -> Block:
        part = index / max(self.points - 1, 1)
        if self.spacing == "log":
            # not by last / first, which overflows between numbers far apart
            values = self.first ** (1 - part) * self.last**part
        else:
            values = self.first + part * (self.last - self.first)
        # both ends exactly as asked for
        return np.where(index == 0, self.first, np.where(part == 1, self.last, values))


@dataclass(frozen=True)
class Column:
    """The velocities of a CSV file, or of standard input ("-"), read as they are needed.

    One number a line, or a table whose header names a column `velocity` and its unit, as in a file
    of measurements (`velocity [cm/s]`, `v (km/h)`); cells are separated, and numbers written, as there
    (`calibration.data.csv_file`). Blank lines and lines that begin with # are passed over.

    Raises:
        InputError: while reading, with file and line.
    """

    path: str
    points: ClassVar[None] = None  # unknown before all is read

    @property
    def name(self) -> str:
        return "standard input" if self.path == "-" else self.path

    def blocks(self, size: int = BLOCK) -> Iterator[Block]:
        with self._open() as file:
            lines = _numbered(file, self.name)
            first = next(lines, None)
            if first is None:
                raise InputError(self.name, None, "no velocities", "one number a line is needed")
            reader = CsvReader(self.name)
            reader.delimiter = delimiter_of(first[1])
            headers = reader.headers(*first)
            column, unit = self._header(*first, headers)
            below = lines if column is not None else chain([first], lines)
            block = list(islice(below, size))
            if not block:
                accepted = "one number a line is needed below the header"
                raise InputError(self.name, first[0], "no velocities", accepted)
            while block:
                yield in_si(self._velocities(reader, block, column or 0, len(headers)), unit)
                block = list(islice(below, size))

    @contextmanager
    def _open(self) -> Iterator[TextIO]:
        if self.path == "-":
            text = io.TextIOWrapper(sys.stdin.buffer, encoding="utf-8-sig")
            try:
                yield text
            finally:
                text.detach()  # standard input is not ours to close
        else:
            with self._opened() as file:
                yield file

    def _opened(self) -> TextIO:
        try:
            return Path(self.path).open(encoding="utf-8-sig")
        except FileNotFoundError:
            accepted = "a file that exists, or - for standard input"
            raise InputError(self.path, None, "no such file", accepted) from None
        except OSError as error:
            problem = f"cannot be read ({error.strerror})"
            raise InputError(self.path, None, problem, "a readable file is needed") from None

    def _header(self, line: int, text: str, headers: list[str]) -> tuple[int | None, Fraction]:
        """Position of the velocity and its unit; None where the line is already a number."""
        if len(headers) == 1 and _is_number(headers[0]):
            return None, Fraction(1)
        for position, cell in enumerate(headers):
            try:
                header = read_header(cell)
                if header.name == "velocity":
                    return position, unit_of(header.unit or "m/s", "speed")
            except DataError as error:
                raise Origin(self.name, line).error(error) from None
        problem = f"no column named velocity in {shown(text)!r}"
        raise InputError(self.name, line, problem, "one number a line, or a header with velocity")

    def _velocities(
        self, reader: CsvReader, block: list[tuple[int, str]], column: int, width: int
    ) -> Block:
        lines = [line for line, _ in block]
        cells = [reader.row(line, text, width)[column] for line, text in block]
        values = reader.values("velocity", cells, lines)
        wrong = np.flatnonzero(~(values >= 0))
        if wrong.size:
            line, text = block[wrong[0]]
            problem = f"{shown(text)!r} holds no velocity"
            raise InputError(self.name, line, problem, "a finite number of 0 m/s or more")
        return values


def _numbered(file: TextIO, name: str) -> Iterator[tuple[int, str]]:
    """Line number and text of all lines but blank ones and comments."""
    line = 0
    try:
        for line, text in enumerate(iter(partial(file.readline, LONGEST + 1), ""), start=1):
            if len(text) > LONGEST:
                problem = f"more than {LONGEST} characters in a line"
                raise InputError(name, line, problem, "one number a line is needed")
            stripped = text.strip()
            if stripped and stripped[0] != "#":
                yield line, text.rstrip("\n")  # an empty cell may begin or end it
    except UnicodeDecodeError:
        raise InputError(name, line + 1, "is not UTF-8 text", "save it as UTF-8") from None
    except OSError as error:
        problem = f"cannot be read ({error.strerror})"
        raise InputError(name, line + 1, problem, "a readable file is needed") from None


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
