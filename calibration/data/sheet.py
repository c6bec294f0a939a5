"""Measurements in a table: a header of columns with units, then one row a point.

    # anything after a hash at the start of a line is a comment
    velocity [m/s],restitution,uncertainty
    0.12,0.95,0.004

Commas, semicolons or tabs separate cells, whichever the header uses (or `sep=;` in a line above
it). A decimal is a point; where semicolons or tabs separate cells it may be a comma in the whole
file. Units are in the header or in a separate row below it. Thousands are not separated.
UTF-8, UTF-16 with its mark, or Windows-1252, of at most 64 MiB; or the first sheet of an Excel file.
The possible columns are in `calibration.data.columns`.
"""

import csv
import io
import math
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from calibration.data.columns import LABELS, layout_of, read_header
from calibration.data.measurements import RestitutionData
from calibration.data.text_file import MIB, decoded, read_bytes
from calibration.errors import DataError, InputError, Origin

LARGEST = 64 * MIB
SPREADSHEETS = (b"PK\x03\x04", b"\xd0\xcf\x11\xe0")  # .xlsx and .ods, .xls
MISSING = {"na", "n/a", "#n/a", "nan", "null", "none", "nil", "missing"}  # no units
WINDOWS = "read as Windows-1252, as it is not UTF-8: check letters such as µ and ±"
NUMBER = (
    "it must be a finite number with the decimal mark {!r} (a comma only where ; or tabs separate "
    "cells), without its unit (in the header: `restitution [%]`) and without marks of thousands"
)
COMMAS = "commas in numbers are read as decimal points"


class Row(NamedTuple):
    """The cells of a row, and the line that it begins on."""

    line: int
    cells: list[str]


def read_csv(path: str | Path, contact=None, **options: Any) -> RestitutionData:
    """One set of data from a CSV, TSV or Excel file.

    Args:
        path: the file.
        contact: the two bodies, or None.
        options: those of `RestitutionData.from_table`.

    Raises:
        InputError: with file and line, what is wrong and what is accepted.
    """
    table, remarks, origin = Sheet(path).table()
    options.setdefault("name", Path(path).stem or "data")
    options["remarks"] = (*options.get("remarks", ()), *remarks)
    return RestitutionData.from_table(table, contact, origin=origin, **options)


class Sheet:
    """One file on its way in: its rows, but blank ones and comments, and remarks on them."""

    def __init__(self, path: str | Path, raw: bytes | None = None):
        self.path = path
        self.delimiter, self.mark = "\t", "."
        self.remarks: list[str] = []
        raw = read_bytes(path, LARGEST) if raw is None else raw
        rows = self._of_excel(raw) if raw.startswith(SPREADSHEETS) else self._of_text(raw)
        self.rows = [row for row in rows if any(map(str.strip, row.cells))]

    def table(self) -> tuple[dict[str, Any], tuple[str, ...], Origin]:
        """The columns that are used, by their names and units; remarks on them; their lines."""
        if not self.rows:
            raise InputError(self.path, 1, "nothing in the file", "a header of columns is needed")
        line, headers = self.rows[0].line, self.headers
        if all(map(is_number, headers)):
            accepted = "the first line names the columns, as in `velocity [m/s],restitution`"
            raise InputError(self.path, line, "no header, only numbers", accepted)
        units = self._units(headers)
        try:
            layout = layout_of(headers, units)
        except DataError as error:
            raise error.at(self.path, line) from None
        rows = [self.full(row, len(headers)) for row in self.rows[1 + (units is not None) :]]
        if not rows:
            accepted = "one row a point is needed below the header"
            raise InputError(self.path, line, "no rows of data", accepted)
        self.find_mark(rows, [at for name, at in layout.position.items() if name not in LABELS])
        table: dict[str, Any] = {}
        for name, at in layout.position.items():
            unit = layout.written[name]
            cells = [row.cells[at].strip() for row in rows]
            key = name if unit is None else f"{name} [{unit}]"
            table[key] = cells if name in LABELS else self.numbers(name, cells, rows)
        remarks = (*layout.remarks, *filter(None, [layout.assumed]), *self.remarks)
        return table, remarks, Origin(str(self.path), line, tuple(row.line for row in rows))

    @property
    def headers(self) -> list[str]:
        """The cells of the first row; spreadsheets leave empty ones at its end."""
        cells = [cell.strip() for cell in self.rows[0].cells]
        return cells[: 1 + max(k for k, cell in enumerate(cells) if cell)]

    def _of_text(self, raw: bytes) -> Iterator[Row]:
        text, encoding = decoded(self.path, raw, "cp1252")
        self.remarks += [WINDOWS] * (encoding == "cp1252")
        raw_lines = io.StringIO(text, newline=None)
        lines = ["\n" if line.lstrip().startswith("#") else line for line in raw_lines]
        first = next((k for k, line in enumerate(lines) if line.strip(" \t,;\r\n")), 0)
        header = lines[first] if lines else ""
        self.delimiter = next((mark for mark in "\t;" if mark in header), ",")
        if separator := re.fullmatch(r"sep=([,;\t])\s*", header):
            lines[first], self.delimiter = "\n", separator[1]
        spaced = self.delimiter != "\t"
        reader = csv.reader(lines, delimiter=self.delimiter, skipinitialspace=spaced, strict=True)
        end = 0
        try:
            for cells in reader:
                yield Row(end + 1, cells)
                end = reader.line_num
        except csv.Error as error:
            problem = f"a quotation mark is not closed, or stands in a cell ({error})"
            raise InputError(self.path, end + 1, problem, "close it") from None

    def _of_excel(self, raw: bytes) -> Iterator[Row]:
        """The first sheet, by pandas."""
        accepted = "save the sheet as CSV: in the spreadsheet, Save as, CSV UTF-8"
        try:
            import pandas

            frame = pandas.read_excel(io.BytesIO(raw), header=None, dtype=object)
        except ImportError:
            problem = "is a spreadsheet, which needs `pip install softjax-contact[excel]`"
            raise InputError(self.path, None, problem, f"or {accepted}") from None
        except Exception as error:  # each reader of spreadsheets raises others
            problem = f"is a spreadsheet or an archive that cannot be read ({error})"
            raise InputError(self.path, None, problem, accepted) from None
        for line, cells in enumerate(frame.where(frame.notna(), "").to_numpy().tolist(), start=1):
            if not str(cells[0]).lstrip().startswith("#"):
                yield Row(line, [str(cell) for cell in cells])

    def _units(self, headers: list[str]) -> list[str] | None:
        """The row of units below the header, if there is one: it holds no number.

        One of missing values alone is a row of data.
        """
        if len(self.rows) < 2:
            return None
        cells = self.full(self.rows[1], len(headers)).cells
        try:
            names = [read_header(header).name for header in headers]
        except DataError:  # which is reported with the others
            return None
        pairs = zip(cells, names, strict=True)
        units = [c.strip() for c, name in pairs if name not in (None, *LABELS) and c.strip()]
        is_one = {cell.casefold() for cell in units} - MISSING and not any(map(is_number, units))
        return cells if is_one else None

    def full(self, row: Row, width: int) -> Row:
        """A row of as many cells as there are columns."""
        cells = row.cells
        while len(cells) > width and not cells[-1].strip():
            cells = cells[:-1]
        if len(cells) != width:
            accepted = f"{width} are needed, one for each column of the header"
            raise InputError(self.path, row.line, f"{len(cells)} cells", accepted)
        return Row(row.line, cells)

    def find_mark(self, rows: list[Row], places: Iterable[int]) -> None:
        """The decimal mark: the first one in the file."""
        cells = (row.cells[at] for row in rows for at in places)
        first = next((cell for cell in cells if "," in cell or "." in cell), "")
        if self.delimiter != "," and "," in first and "." not in first:
            self.mark = ","
            self.remarks.append(COMMAS)

    def numbers(self, name: str, cells: list[str], rows: list[Row]) -> np.ndarray:
        """Cells as numbers, NaN if empty."""
        values = np.array(list(map(self._number, cells)))
        for k in np.flatnonzero(~np.isfinite(values)):
            if cells[k]:
                problem = f"{name} is {cells[k][:80]!r}"
                raise InputError(self.path, rows[k].line, problem, NUMBER.format(self.mark))
        return values

    def _number(self, cell: str) -> float:
        """NaN where a cell has no number."""
        if self.mark == ",":
            cell = "" if "." in cell else cell.replace(",", ".")
        try:
            return float(cell) if cell and "_" not in cell else math.nan
        except ValueError:
            return math.nan


def is_number(cell: str) -> bool:
    """Whether it is meant as one, finite or not."""
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return True
