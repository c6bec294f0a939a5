"""Measurements in a CSV file: a header of columns with units, then one row a point.

    # anything after a hash at the start of a line is a comment
    velocity [m/s],restitution,uncertainty
    0.12,0.95,0.004

Commas, semicolons or tabs separate cells, whichever the header uses (or `sep=;` in a line above
it). A decimal is a point; where semicolons or tabs separate cells it may be a comma in the whole
file. Units stand in the header or in a row of their own below it. Thousands are not separated.
UTF-8, or UTF-16 with its mark, of at most 64 MiB, 1.5 million rows, 1000 columns and 65536
characters a line. What columns there may be tells `calibration.data.columns`.
"""

import csv
import math
import re
from collections.abc import Iterator
from itertools import chain, islice
from pathlib import Path
from typing import Any

import numpy as np

from calibration.data.columns import ACCEPTED_SETS, Layout, layout_of
from calibration.data.measurements import RestitutionData
from calibration.data.names import LABELS, read_header
from calibration.data.text_file import MIB, text_lines
from calibration.data.units import NUMBER, in_si
from calibration.errors import DataError, InputError, Origin

LARGEST = 64 * MIB
ROWS, COLUMNS, CHARACTERS = 1_500_000, 1000, 65536
BLOCK = 1 << 14  # rows that are held as text at a time
MISSING = {"na", "n/a", "#n/a", "nan", "null", "none", "nil", "missing"}  # no units
PLAIN = {",": re.compile(r"[-+.0-9eE \t]*"), ";": re.compile(r"[-+.,0-9eE \t]*")}
PLAIN["\t"] = PLAIN[";"]

Lines = Iterator[tuple[int, str]]


def read_csv(
    path: str | Path, contact=None, *, quoted: bool = True, **options: Any
) -> RestitutionData:
    """One set of data from a CSV file; `options` are those of `RestitutionData.from_table`.

    Args:
        path: the file.
        contact: the two bodies, or None.
        quoted: whether a refusal may repeat a header that is none of measurements.

    Raises:
        InputError: with file and line, what is wrong and what is accepted.
    """
    reader = CsvReader(path, quoted)
    table, remarks, origin = reader.table()
    options.setdefault("name", Path(path).stem or "data")
    options["remarks"] = (*options.get("remarks", ()), *remarks)
    return RestitutionData.from_table(table, contact, origin=origin, **options)


class CsvReader:
    """One file on its way in."""

    def __init__(self, path: str | Path, quoted: bool = True):
        self.path, self.quoted = path, quoted
        self.delimiter = ","
        self.mark = ""  # of decimals, once there was one
        self.numbers: list[int] = []  # of the lines that hold a row

    def table(self) -> tuple[dict[str, Any], tuple[str, ...], Origin]:
        """The columns that are used, in SI; what to tell of them; the lines they stand on."""
        body = self._lines()
        line, headers, body = self._header(body)
        units, body = self._units(headers, body)
        try:
            layout = layout_of(headers, units)
        except DataError as error:
            raise self._unknown(line, error) from None
        columns = self._columns(layout, len(headers), body)
        if not self.numbers:
            accepted = "one row a point is needed below the header"
            raise InputError(self.path, line, "no rows of data", accepted)
        with np.errstate(over="ignore"):
            for name in columns.keys() - {*LABELS, *layout.relative}:
                columns[name] = in_si(columns[name], layout.units[name])
        table = {f"{n} [%]" if n in layout.relative else n: one for n, one in columns.items()}
        remarks = (*layout.remarks, *filter(None, [layout.assumed]))
        if self.mark == ",":
            remarks = (*remarks, "commas in numbers are taken for decimal points")
        return table, remarks, Origin(str(self.path), line, tuple(self.numbers))

    def _lines(self) -> Lines:
        """Line number and text of all lines but blank ones and comments."""
        for number, line in enumerate(text_lines(self.path, LARGEST), start=1):
            if len(line) > CHARACTERS:
                accepted = f"{CHARACTERS} are accepted"
                raise InputError(self.path, number, f"{len(line)} characters in a line", accepted)
            text = line.strip()
            if text.strip(" \t,;") and text[0] != "#":
                yield number, line

    def _header(self, body: Lines) -> tuple[int, list[str], Lines]:
        line, text = next(body, (1, ""))
        told = re.fullmatch(r"sep=([,;\t])\s*", text)
        if told:
            self.delimiter = told[1]
            line, text = next(body, (line, ""))
        else:
            self.delimiter = delimiter_of(text)
        if not text:
            accepted = "a header of columns is needed"
            raise InputError(self.path, line, "nothing in the file", accepted)
        headers = self.headers(line, text)
        if len(headers) > COLUMNS:
            accepted = f"{COLUMNS} are accepted"
            raise InputError(self.path, line, f"{len(headers)} columns", accepted)
        if all(map(_is_number, headers)):
            accepted = "the first line names the columns, as in `velocity [m/s],restitution`"
            raise InputError(self.path, line, "no header, only numbers", accepted)
        return line, headers, body

    def headers(self, line: int, text: str) -> list[str]:
        """The cells of a header; spreadsheets leave empty ones at its end."""
        headers = [cell.strip() for cell in self._cells(line, text)]
        while headers and not headers[-1]:
            headers.pop()
        return headers

    def _units(self, headers: list[str], body: Lines) -> tuple[list[str] | None, Lines]:
        """The row of units below the header, if there is one, and the rows below it.

        It holds no number; one of missing values alone is a row of data.
        """
        first = next(body, None)
        if first is None:
            return None, body
        cells = self.row(*first, len(headers))
        try:
            names = [read_header(header).name for header in headers]
        except DataError:  # which is told with the others
            return None, chain([first], body)
        measured = [
            cell.strip()
            for cell, name in zip(cells, names, strict=True)
            if name not in (None, *LABELS) and cell.strip()
        ]
        words = {cell.casefold() for cell in measured}
        if words - MISSING and not any(map(_is_number, measured)):
            return cells, body
        return None, chain([first], body)

    def _unknown(self, line: int, error: DataError) -> InputError:
        if self.quoted:
            return Origin(str(self.path), line).error(error)
        problem = "no header of measurements (it is not shown, as the file lies elsewhere)"
        return InputError(self.path, line, problem, f"needed is {ACCEPTED_SETS}")

    def _columns(self, layout: Layout, width: int, body: Lines) -> dict[str, Any]:
        """The cells of the columns that are used: text of labels, else numbers, NaN if empty."""
        parts: dict[str, list] = {name: [] for name in layout.position}
        while block := list(islice(body, BLOCK)):
            lines = [line for line, _ in block]
            self.numbers += lines
            if len(self.numbers) > ROWS:
                raise InputError(self.path, lines[-1], f"more than {ROWS} rows", "use fewer")
            rows = [self.row(line, text, width) for line, text in block]
            for name, at in layout.position.items():
                cells = [row[at] for row in rows]
                if name in LABELS:
                    parts[name] += cells
                else:
                    parts[name].append(self.values(name, cells, lines))
        return {
            name: part if name in LABELS else np.concatenate([*part, np.zeros(0)])
            for name, part in parts.items()
        }

    def row(self, line: int, text: str, width: int) -> list[str]:
        """The cells of a row, as many as there are columns."""
        cells = self._cells(line, text)
        while len(cells) > width and not cells[-1].strip():
            cells.pop()
        if len(cells) != width:
            accepted = f"{width} are needed, one for each column of the header"
            raise InputError(self.path, line, f"{len(cells)} cells", accepted)
        return cells

    def _cells(self, line: int, text: str) -> list[str]:
        if '"' not in text:
            return text.split(self.delimiter)
        reader = csv.reader([text], delimiter=self.delimiter, skipinitialspace=True, strict=True)
        try:
            return next(reader)
        except csv.Error:
            problem = "a quotation mark is not closed, or stands in a cell"
            raise InputError(self.path, line, problem, "close it") from None

    def values(self, name: str, cells: list[str], lines: list[int]) -> np.ndarray:
        """Cells as numbers, NaN if empty: all at once where they are plain, else one by one."""
        joined = "".join(cells)
        marks = {self.mark, *(mark for mark in ".," if mark in joined)} - {""}
        if len(marks) <= 1 and PLAIN[self.delimiter].fullmatch(joined):
            plain = [cell.replace(",", ".") for cell in cells] if "," in marks else cells
            try:
                found = np.array([float(cell or "nan") for cell in plain])
            except ValueError:
                pass
            else:
                if not np.any(np.isinf(found)):
                    self.mark = "".join(marks)
                    return found
        return np.array([self._number(name, *one) for one in zip(cells, lines, strict=True)])

    def _number(self, name: str, cell: str, line: int) -> float:
        cell = cell.strip()
        if not cell:
            return math.nan
        mark = next((mark for mark in ".," if mark in cell), "")
        text = cell.replace(",", ".") if self.delimiter != "," else cell
        if re.fullmatch(NUMBER, text) and len({mark, self.mark, ""}) <= 2:
            number = float(text)
            if math.isfinite(number):
                self.mark = mark or self.mark
                return number
        accepted = f"it must be a finite number{self._hint(cell)}"
        raise InputError(self.path, line, f"{name} is {cell[:80]!r}", accepted)

    def _hint(self, cell: str) -> str:
        if re.fullmatch(r"[+-]?\d+,\d+", cell) and self.delimiter == ",":
            return " with a decimal point (a comma only where ; or tabs separate cells)"
        if re.fullmatch(r"[+-]?\d+[.,]\d+", cell):
            return ", decimals with a comma or with a point in the whole file"
        if re.fullmatch(r"[+-]?\d{1,3}([.,' \xa0\u202f]\d{3})+([.,]\d+)?", cell):
            return ", thousands not separated"
        if cell.endswith("%"):
            return " without its unit, which stands in the header: `restitution [%]`"
        return ""


def delimiter_of(text: str) -> str:
    """What separates the cells of a header."""
    return next((mark for mark in "\t;" if mark in text), ",")


def _is_number(cell: str) -> bool:
    """Whether it is meant as one, finite or not."""
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return True
