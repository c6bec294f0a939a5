"""Measurements in a CSV file: a header of columns with units, then one row a point.

    # anything after a hash at the start of a line is a comment
    velocity [m/s],restitution,uncertainty
    0.12,0.95,0.004

Commas, semicolons or tabs separate cells, whichever the header uses; a decimal is a point. UTF-8,
with or without a byte-order mark. The columns are those of `calibration.table`.
"""

import csv
import math
import re
from pathlib import Path
from typing import Any

from calibration.data import RestitutionData
from calibration.errors import DataError, InputError, Origin
from calibration.table import parse_header
from calibration.text_file import read_text

NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")


def read_csv(path: str | Path, contact=None, **options: Any) -> RestitutionData:
    """One set of data from a CSV file; `options` are those of `RestitutionData.from_table`.

    Raises:
        InputError: with file and line, what is wrong and what is accepted.
    """
    table, origin = read_table(path)
    options.setdefault("name", Path(path).stem)
    return RestitutionData.from_table(table, contact, origin=origin, **options)


def read_table(path: str | Path) -> tuple[dict[str, list], Origin]:
    """The columns as written, by header, and the lines they stand on.

    A cell of an uncertainty may be empty, NaN then, in a table of intervals (see
    `calibration.table`); `launch` is text; every other cell is a finite number.

    Raises:
        InputError: with file and line.
    """
    rows = _rows(read_text(path))
    if not rows:
        raise InputError(path, 1, "nothing in the file", "a header of columns is needed")
    (header_line, header), body = rows[0], rows[1:]
    delimiter = next((mark for mark in ";\t" if mark in header), ",")
    headers, names = _headers(path, header_line, _cells(path, header_line, header, delimiter))
    if not body:
        accepted = "one row a point is needed below the header"
        raise InputError(path, header_line, "no rows of data", accepted)
    table: dict[str, list] = {header: [] for header in headers}
    for line, text in body:
        cells = _cells(path, line, text, delimiter)
        _check_count(path, line, cells, headers)
        for header, name, cell in zip(headers, names, cells, strict=True):
            table[header].append(_value(path, line, name, cell, "interval" in names))
    return table, Origin(str(path), header_line, tuple(line for line, _ in body))


def _rows(text: str) -> list[tuple[int, str]]:
    """Line number and text of all lines but blank ones and comments."""
    lines = enumerate(text.split("\n"), start=1)
    return [(n, line) for n, line in lines if line.strip(" \t,;") and line.lstrip()[0] != "#"]


def _cells(path, line: int, text: str, delimiter: str) -> list[str]:
    reader = csv.reader([text], delimiter=delimiter, skipinitialspace=True, strict=True)
    try:
        cells = [cell.strip() for cell in next(reader)]
    except csv.Error:
        raise InputError(path, line, "a quotation mark is not closed", "close it") from None
    return cells


def _headers(path, line: int, cells: list[str]) -> tuple[list[str], list[str]]:
    """The columns' headers, and their names without units."""
    while cells and not cells[-1]:  # spreadsheets leave empty cells at the end
        cells.pop()
    if all(NUMBER.fullmatch(cell) for cell in cells):
        accepted = "the first line names the columns, as in `velocity [m/s],restitution`"
        raise InputError(path, line, "no header, only numbers", accepted)
    try:
        names = [parse_header(cell)[0] for cell in cells]
    except DataError as error:
        raise Origin(str(path), line).error(error) from None
    twice = [name for i, name in enumerate(names) if name in names[:i]]
    if twice:
        raise InputError(path, line, f"column {twice[0]} is there twice", "each is needed once")
    return cells, names


def _check_count(path, line: int, cells: list[str], headers: list[str]) -> None:
    while len(cells) > len(headers) and not cells[-1]:
        cells.pop()
    if len(cells) != len(headers):
        accepted = f"{len(headers)} are needed, one for each column of the header"
        raise InputError(path, line, f"{len(cells)} cells", accepted)


def _value(path, line: int, name: str, cell: str, blank_uncertainty: bool) -> float | str:
    if name == "launch" and cell:
        return cell
    if not cell and blank_uncertainty and name.endswith("uncertainty"):
        return math.nan
    number = float(cell) if NUMBER.fullmatch(cell) else math.nan
    if math.isfinite(number):
        return number
    problem = f"{name} is {cell!r}" if cell else f"{name} is empty"
    accepted = "it must be a label" if name == "launch" else "it must be a finite number"
    comma = " with a decimal point" if re.fullmatch(r"[+-]?\d+,\d+", cell) else ""
    raise InputError(path, line, problem, accepted + comma)
