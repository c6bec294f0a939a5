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
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from calibration.data.columns import LABELS, read_header
from calibration.data.measurements import RestitutionData
from calibration.data.text_file import MIB, decoded, read_bytes
from calibration.errors import DataError, InputError, Origin

LARGEST = 64 * MIB
SPREADSHEETS = (b"PK\x03\x04", b"\xd0\xcf\x11\xe0")  # .xlsx and .ods, .xls
MISSING = {"na", "n/a", "#n/a", "nan", "null", "none", "nil", "missing"}  # no units
WINDOWS = "read as Windows-1252, as it is not UTF-8: check letters such as µ and ±"
NUMBER = (
    "a finite number with the decimal mark {!r} (a comma only where ; or tabs separate "
    "cells), without its unit (in the header: `restitution [%]`) and without marks of thousands"
)
NUMERIC = re.compile(r"[+−-]?[.,]?\d|[+-]?(inf|nan)", re.I)  # how a number begins, finite or not
COMMAS = "commas in numbers are read as decimal points"
Row = tuple[int, list[str]]  # the line that it begins on, its cells


def read_csv(path: str | Path, contact=None, **options: Any) -> RestitutionData:
    """One set of data from a CSV, TSV or Excel file.

    Args:
        path: the file.
        contact: the two bodies, or None.
        options: those of `RestitutionData.from_table`.

    Raises:
        InputError: with file and line, what is wrong and what is accepted.
        DataError: for an option.
    """
    sheet = Sheet(path, read_bytes(path, LARGEST))
    options.setdefault("name", Path(path).stem or "data")
    options["remarks"] = (*options.get("remarks", ()), *sheet.remarks)
    return RestitutionData.from_table(sheet, contact, origin=sheet.origin, **options)


class Sheet(Mapping[str, Any]):
    """A file as a table: its columns by their headings, with their units.

    Attributes:
        origin: the lines of its rows.
        remarks: how it was read.
    """

    def __init__(self, path: str | Path, raw: bytes, one_column: str | None = None):
        """Read the rows; `one_column` is the heading of one column of numbers without a header."""
        self.path, self.delimiter = path, "\t"
        self.remarks: list[str] = []
        read = self._of_excel(raw) if raw.startswith(SPREADSHEETS) else self._of_text(raw)
        stripped = ((line, [*map(str.strip, cells)]) for line, cells in read)
        rows = [row for row in stripped if any(row[1])]
        if not rows:
            raise InputError(path, 1, "nothing in the file", "a header of columns is needed")
        line, header = rows.pop(0)
        while not header[-1]:  # as spreadsheets end
            header = header[:-1]
        if all(map(_is_number, header)):
            if one_column is None or len(header) > 1:
                accepted = "the first line names the columns, as in `velocity [m/s],restitution`"
                raise InputError(path, line, "no header, only numbers", accepted)
            rows, header = [(line, header), *rows], [one_column]
        self.rows = [(k, self._full(k, cells, len(header), line)) for k, cells in rows]
        numbers = [k for k, text in enumerate(header) if _name(text) not in (None, *LABELS)]
        self.headers = self._with_units(header, numbers) if self.rows else header
        if not self.rows:
            accepted = "one row a point is needed below the header"
            raise InputError(path, line, "no rows of data", accepted)
        self.mark, self.origin = ".", Origin(str(path), line, tuple(line for line, _ in self.rows))
        cells = (cells[k] for _, cells in self.rows for k in numbers)
        first = next((cell for cell in cells if "," in cell or "." in cell), "")
        if self.delimiter != "," and "," in first and "." not in first:
            self.mark = ","
            self.remarks.append(COMMAS)

    def __getitem__(self, header: str) -> Any:
        """Labels as text; numbers, NaN if empty; raises DataError with the row of what is neither."""
        at, name = self.headers.index(header), _name(header)
        cells = [cells[at] for _, cells in self.rows]
        if name in LABELS:
            return cells
        values = np.array(list(map(self._number, cells)))
        for k in np.flatnonzero(~np.isfinite(values)):
            if cells[k]:
                raise DataError(
                    name or header, repr(cells[k][:80]), NUMBER.format(self.mark), int(k)
                )
        return values

    def __iter__(self) -> Iterator[str]:
        return iter(self.headers)

    def __len__(self) -> int:
        return len(self.headers)

    def _of_text(self, raw: bytes) -> Iterator[Row]:
        text, encoding = decoded(self.path, raw, "cp1252")
        self.remarks += [WINDOWS] * (encoding == "cp1252")
        raw_lines = io.StringIO(text, newline=None)
        lines = ["\n" if line.lstrip().startswith("#") else line for line in raw_lines]
        header = next((line for line in lines if line.strip(" \t,;\r\n")), "")
        self.delimiter = next((mark for mark in "\t;" if mark in header), ",")
        if separator := re.fullmatch(r"sep=([,;\t])\s*", header):
            lines[lines.index(header)], self.delimiter = "\n", separator[1]
        spaced = self.delimiter != "\t"
        reader = csv.reader(lines, delimiter=self.delimiter, skipinitialspace=spaced, strict=True)
        end = 0
        try:
            for cells in reader:
                yield end + 1, cells
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
                yield line, [str(cell) for cell in cells]

    def _full(self, line: int, cells: list[str], width: int, above: int) -> list[str]:
        """A row of as many cells as there are columns in the header, in line `above`."""
        if len(cells) < width or any(cells[width:]):
            problem = f"cells: {len(cells)}; columns of the header in line {above}: {width}"
            accepted = "as many are needed; a title above the header begins with #"
            raise InputError(self.path, line, problem, accepted)
        return cells[:width]

    def _with_units(self, header: list[str], numbers: list[int]) -> list[str]:
        """The header with the units of the row below it, a row of units if no cell begins with a digit."""
        _, units = self.rows[0]
        stated = [units[k] for k in numbers if units[k]]
        if not {cell.casefold() for cell in stated} - MISSING or any(map(NUMERIC.match, stated)):
            return header
        self.rows = self.rows[1:]
        stated = [cell.strip("[]() ") if k in numbers else "" for k, cell in enumerate(units)]
        pairs = zip(header, stated, strict=True)
        return [h if not u or u == read_header(h).unit else f"{h} [{u}]" for h, u in pairs]

    def _number(self, cell: str) -> float:
        """NaN where a cell has no number."""
        if self.mark == ",":
            cell = "" if "." in cell else cell.replace(",", ".")
        try:
            return float(cell) if cell and "_" not in cell else math.nan
        except ValueError:
            return math.nan


def _name(header: str) -> str | None:
    """The name of a column, None of one that is not known, or refused where the table is read."""
    with suppress(DataError):
        return read_header(header).name
    return None


def _is_number(cell: str) -> bool:
    """Whether it is meant as one, finite or not."""
    with suppress(ValueError):
        float(cell.replace(",", "."))
        return True
    return False
