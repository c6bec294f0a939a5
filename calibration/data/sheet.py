"""Measurements in a table: a header of columns with units, then one row a point.

    # anything after a hash at the start of a line is a comment
    velocity [m/s],restitution,uncertainty
    0.12,0.95,0.004

Commas, semicolons, tabs or white space separate cells, whichever the header uses (or `sep=;` in a line
above it). A decimal is a point; where no commas separate cells it may be a comma in the whole
file. Units are in the header or in a separate row below it. Thousands are not separated. The header may be a comment
(gnuplot, `np.savetxt`); a cell of `NaN`, `NA`, `n/a` or `-` is empty.
UTF-8, UTF-16 with its mark, or Windows-1252, of at most 64 MiB; or a sheet of an Excel file.
The possible columns are in `calibration.data.columns`; how wide tables become rows is in
`calibration.data.reshaped`.
"""

import csv
import io
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from calibration.data.columns import LABELS, read_header
from calibration.data.layout import layout_of
from calibration.data.measurements import RestitutionData
from calibration.data.reshaped import Row, reshaped
from calibration.data.text_file import MIB, decoded, read_bytes
from calibration.data.track_table import tracks_in
from calibration.data.unused import as_cells
from calibration.data.words import is_statistic
from calibration.errors import DataError, InputError, Origin, listed, printable

LARGEST = 64 * MIB
OLD_WORKBOOK, WORKBOOK = b"\xd0\xcf\x11\xe0", b"PK\x03\x04"  # .xls; .xlsx and .ods
PICTURES = {
    b"\x89PNG": "a PNG picture",
    b"\xff\xd8\xff": "a JPEG picture",
    b"GIF8": "a GIF picture",
    b"%PDF": "a PDF",
    b"BM": "a bitmap picture",
    b"II*\x00": "a TIFF picture",
    b"\x1f\x8b": "a compressed file",
    b"\x00\x00\x00": "a film",
}
MISSING = {
    *[
        "na",
        "n/a",
        "#n/a",
        "#na",
        "nan",
        "null",
        "none",
        "nil",
        "missing",
        "-",
        "--",
        "---",
        "–",
        "—",
        "−",
    ]
}  # no units but "-"
WINDOWS = "read as Windows-1252, as it is not UTF-8: check letters such as µ and ±"
NUMBER = (
    "a finite number with the decimal mark {!r} (a comma only where ; or tabs separate "
    "cells), without its unit (in the header: `restitution [%]`) and without marks of thousands"
)
NUMERIC = re.compile(r"[+−-]?[.,]?\d|[+-]?(inf|nan)", re.I)  # how a number begins, finite or not
DECIMAL = re.compile(r"[+−-]?\d*[.,]\d+(?:[eE][+-]?\d+)?")
COMMENT = re.compile(r"\s*(?:#|%(?![,;\t]))")  # % in a row of units is none
COMMAS = "commas in numbers are read as decimal points"
AS_CSV = "save the sheet as CSV: in the spreadsheet, Save as, CSV UTF-8"
MOST_SHEETS, MOST_COLUMNS = 8, 6  # that a refusal names


def read_csv(
    path: str | Path,
    contact=None,
    *,
    sheet: str | None = None,
    repeats: bool | None = None,
    **options: Any,
) -> RestitutionData:
    """One set of data from a CSV, TSV or Excel file.

    Args:
        path: the file.
        contact: the two bodies, or None.
        sheet: of a workbook; where left out the one whose columns are known.
        repeats: whether columns h1, h2, h3 repeat one drop (True), or are bounces one after the other (False).
        options: those of `RestitutionData.from_table`.

    Raises:
        InputError: with file and line, what is wrong and what is accepted.
        DataError: for an option.
    """
    table = Sheet(path, read_bytes(path, LARGEST), sheet=sheet, repeats=repeats)
    options.setdefault("name", Path(path).stem or "data")
    return _data(table, contact, options)


def read_frame(
    frame: Any, contact=None, *, repeats: bool | None = None, **options: Any
) -> RestitutionData:
    """One set of data from a DataFrame, whose column names and cells are read as those of a file.

    Args:
        frame: of pandas, or another with `columns`; its index is not used.
        contact, repeats, options: as of `read_csv`.

    Raises:
        InputError: with the row, from 1, what is wrong and what is accepted.
        DataError: for an option.
    """
    if not hasattr(frame, "columns"):
        raise DataError("frame", frame, "a DataFrame; `read_csv` reads a file")
    return _data(Sheet("DataFrame", rows=_rows_of(frame), repeats=repeats), contact, options)


def _data(table: "Sheet", contact: Any, options: dict[str, Any]) -> RestitutionData:
    options["remarks"] = (*options.get("remarks", ()), *table.remarks)
    return RestitutionData.from_table(table, contact, origin=table.origin, **options)


def _rows_of(frame: Any) -> Iterator[Row]:
    """A frame's header, in line 0, and its rows from 1."""
    names = [*frame.columns]
    yield 0, [" ".join(map(str, n)) if isinstance(n, tuple) else str(n) for n in names]
    columns = [
        as_cells(frame.iloc[:, k] if hasattr(frame, "iloc") else frame[name])
        for k, name in enumerate(names)
    ]
    for line, cells in enumerate(zip(*columns, strict=True), start=1):
        yield line, [*cells]


class Sheet(Mapping[str, Any]):
    """A file as a table: its columns by their headings, with their units.

    Attributes:
        origin: the lines of its rows.
        remarks: how it was read.
        titles: what stands above the header, of tracks the objects.
    """

    def __init__(
        self,
        path: str | Path,
        raw: bytes = b"",
        one_column: str | None = None,
        rows: Iterable[Row] | None = None,
        sheet: str | None = None,
        repeats: bool | None = None,
    ):
        """Read the rows, of bytes or as they are; `one_column` is the heading of one column of numbers
        without a header."""
        self.path, self.delimiter = path, "\t"
        self.remarks: list[str] = []
        if rows is None:
            rows = self._of_bytes(raw, sheet)
        stripped = ((line, [*map(str.strip, cells)]) for line, cells in rows)
        filled = [row for row in stripped if any(row[1])]
        if not filled:
            raise InputError(path, 1, "nothing in the file", "a header of columns is needed")
        line, header = filled.pop(0)
        self.titles: tuple[str, ...] = ()
        if filled and not tracks_in(header) and tracks_in(filled[0][1]):
            self.titles = tuple(header)
            line, header = filled.pop(0)
        while not header[-1]:  # as spreadsheets end
            header = header[:-1]
        if all(map(_is_number, header)):
            if one_column is None or len(header) > 1:
                accepted = "the first line names the columns, as in `velocity [m/s],restitution`"
                raise InputError(path, line, "no header, only numbers", accepted)
            filled, header = [(line, header), *filled], [one_column]
        self.rows = [(k, self._full(k, cells, header, line)) for k, cells in filled]
        header = self._without_headers(header)
        numbers = [k for k, text in enumerate(header) if _name(text) not in (None, *LABELS)]
        tracks = tracks_in(header, self.titles)
        numbers += [k for track in tracks for k in track.places if k not in numbers]
        self.headers = self._with_units(header, numbers) if self.rows else header
        self._without_statistics()
        if not self.rows:
            accepted = "one row a point is needed below the header"
            raise InputError(path, line, "no rows of data", accepted)
        self.origin = Origin(str(path), line, tuple(line for line, _ in self.rows))
        try:
            if not tracks:
                self.headers, self.rows, remarks = reshaped(self.headers, self.rows, repeats)
                self.remarks += remarks
        except DataError as error:
            raise self.origin.error(error) from None
        self.origin = Origin(str(path), line, tuple(line for line, _ in self.rows))
        self.mark = self._decimal_mark()

    def __getitem__(self, header: str) -> Any:
        """Labels and columns that are not known as text; numbers, NaN if empty."""
        name = _name(header)
        if name in (None, *LABELS):
            return self.text_of(header)
        return self.numbers_of(header, str(name))

    def text_of(self, header: str) -> list[str]:
        """Cells as text, "" where one is empty."""
        at = self.headers.index(header)
        return [cells[at] for _, cells in self.rows]

    def numbers_of(self, header: str, name: str) -> np.ndarray:
        """Cells as numbers, NaN where one is empty; raises DataError with the row of what is neither."""
        return self.numbers_at(self.headers.index(header), name)

    def numbers_at(self, at: int, name: str) -> np.ndarray:
        """Numbers of a column by its place, as the headings of tracks may be there twice."""
        cells = [cells[at] for _, cells in self.rows]
        values = np.array(list(map(self._number, cells)))
        for k in np.flatnonzero(~np.isfinite(values)):
            if cells[k]:
                raise DataError(name, repr(cells[k][:80]), NUMBER.format(self.mark), int(k))
        return values

    def __iter__(self) -> Iterator[str]:
        return iter(self.headers)

    def __len__(self) -> int:
        return len(self.headers)

    def _of_bytes(self, raw: bytes, sheet: str | None) -> Iterable[Row]:
        if raw.startswith(OLD_WORKBOOK):
            accepted = f"in the spreadsheet save it as .xlsx, or {AS_CSV}"
            raise InputError(self.path, None, "is a spreadsheet of the old kind, .xls", accepted)
        if raw.startswith(WORKBOOK):
            return self._of_workbook(raw, sheet)
        if sheet is not None:
            raise DataError("sheet", f'"{sheet}"', "left out: the file is no workbook")
        for mark, what in PICTURES.items():
            if raw.startswith(mark) and b"\n" not in raw[: len(mark)] and b"\0" in raw[:1000]:
                accepted = "a table is needed: save or digitise the numbers as CSV"
                raise InputError(self.path, None, f"is {what}, no table", accepted)
        return self._of_text(raw)

    def _of_text(self, raw: bytes) -> Iterator[Row]:
        text, encoding = decoded(self.path, raw, "cp1252")
        self.remarks += [WINDOWS] * (encoding == "cp1252")
        written = [*io.StringIO(text, newline=None)]
        lines = ["\n" if COMMENT.match(line) else line for line in written]
        first = next((k for k, line in enumerate(lines) if line.strip(" \t,;\r\n")), 0)
        header = lines[first] if lines else ""
        if separator := re.fullmatch(r"sep=([,;\t])\s*", header):
            lines[first], self.delimiter = "\n", separator[1]
        else:
            commented = self._commented_header(written, lines, first)
            header = header if commented is None else commented[1]
            if commented is None and not re.search(r"[\t;,]", header):  # a title, it may be
                after = (line for line in lines[first + 1 :] if line.strip())
                header = next((line for line in after if re.search(r"[\t;]", line)), header)
            self.delimiter = next((mark for mark in "\t;," if mark in header), ",")
            data = lines[first + (commented is None) :]
            width = next((len(line.split()) for line in data if line.strip()), 0)
            spaced = _spaced(header, width, self.delimiter)
            below = next((line for line in data if line.strip()), "")
            if spaced and not any(mark in below for mark in "\t;") and _are_numbers(below.split()):
                self.delimiter = " "
                at = first if commented is None else commented[0]
                yield at + 1, spaced
                skip = first + (commented is None)
                yield from ((k + 1, line.split()) for k, line in enumerate(lines) if k >= skip)
                return
            if commented is not None:
                lines[commented[0]] = commented[1]
        spaces = self.delimiter != "\t"
        reader = csv.reader(lines, delimiter=self.delimiter, skipinitialspace=spaces, strict=True)
        end = 0
        try:
            for cells in reader:
                yield end + 1, cells
                end = reader.line_num
        except csv.Error as error:
            problem = f"a quotation mark is not closed, or stands in a cell ({error})"
            raise InputError(self.path, end + 1, problem, "close it") from None

    def _commented_header(
        self, written: Sequence[str], lines: Sequence[str], first: int
    ) -> tuple[int, str] | None:
        """The place and text of a comment that names the columns, above rows of numbers; None without."""
        data = lines[first] if first < len(lines) else ""
        marks = [mark for mark in "\t;," if mark in data]
        rows = [data.split(mark) for mark in marks] + [data.split()]
        widths = {len(row) for row in rows if _are_numbers([cell.strip() for cell in row])}
        for k in range(first - 1, -1, -1):
            if not COMMENT.match(written[k]):
                continue
            bare = re.sub(r"^\s*(?:#+|%+)(?![,;\t])\s*", "", written[k])
            for mark in (*"\t;,", None):
                cells = (
                    [cell.strip() for cell in bare.split(mark)]
                    if mark
                    else _spaced(bare, max(widths, default=0), "")
                )
                if len(cells) in widths and any(_name(cell) for cell in cells):
                    return k, bare if bare.endswith("\n") else f"{bare}\n"
        return None

    def _of_workbook(self, raw: bytes, sheet: str | None) -> Iterator[Row]:
        """The sheet that is named, or whose columns are known, by pandas."""
        try:
            import pandas

            frames = pandas.read_excel(io.BytesIO(raw), sheet_name=None, header=None, dtype=object)
        except ImportError:
            problem = 'is a spreadsheet, which needs `pip install -e ".[excel]"` (openpyxl)'
            raise InputError(self.path, None, problem, f"or {AS_CSV}") from None
        except Exception as error:  # each reader of spreadsheets raises others
            problem = f"is a spreadsheet or an archive that cannot be read ({error})"
            raise InputError(self.path, None, problem, AS_CSV) from None
        sheets = {str(name): _filled(frame) for name, frame in frames.items()}
        yield from sheets[self._chosen({n: rows for n, rows in sheets.items() if rows}, sheet)]

    def _chosen(self, sheets: Mapping[str, Sequence[Row]], sheet: str | None) -> str:
        """The name of the sheet to be read."""
        if not sheets:
            raise InputError(self.path, 1, "nothing in the file", "a header of columns is needed")
        columns = {
            name: [cell for cell in rows[0][1] if cell.strip()] for name, rows in sheets.items()
        }
        shown = "; ".join(
            f"{printable(name)!r} ({listed(map(printable, cells[:MOST_COLUMNS]))})"
            for name, cells in [*columns.items()][:MOST_SHEETS]
        )
        if sheet is not None:
            if sheet not in sheets:
                raise InputError(
                    self.path, None, f"no sheet {printable(sheet)!r}", f"its sheets: {shown}"
                )
            return sheet
        known = [name for name, rows in sheets.items() if _is_known(rows)]
        if len(sheets) == 1 or len(known) == 1:
            chosen = known[0] if known else next(iter(sheets))
            if len(sheets) > 1:
                self.remarks.append(
                    f"sheet {printable(chosen)!r} of {len(sheets)} is read, the only one with known columns"
                )
            return chosen
        problem = f"{len(sheets)} sheets, the columns of {len(known) or 'none'} are known"
        example = printable((known or [*sheets])[0])
        accepted = (
            f'name one, as in `sheet = "{example}"` in [[material]] (sheet= in Python): {shown}'
        )
        raise InputError(self.path, None, problem, accepted)

    def _full(self, line: int, cells: list[str], header: list[str], above: int) -> list[str]:
        """A row of as many cells as there are columns in the header, in line `above`."""
        width = len(header)
        if self.delimiter == " " and len(cells) > width:
            cells = (
                [*cells[: width - 1], " ".join(cells[width - 1 :])]
                if not _is_number(cells[width])
                else cells
            )
        if len(cells) < width or any(cells[width:]):
            problem = f"cells: {len(cells)}; columns of the header in line {above}: {width}"
            accepted = "as many are needed; a title above the header begins with #"
            raise InputError(self.path, line, problem, accepted)
        return cells[:width]

    def _without_headers(self, header: list[str]) -> list[str]:
        """The header, with a column of the part where it is repeated further below, as in files that were joined."""
        plain = [text.strip("\ufeff ").casefold() for text in header]
        again = [
            k
            for k, (_, cells) in enumerate(self.rows)
            if [c.strip("\ufeff# ").casefold() for c in cells] == plain
        ]
        if not again:
            return header
        lines = listed(str(self.rows[k][0]) for k in again[:MOST_SHEETS])
        self.remarks.append(f"the header is repeated in line(s) {lines}: another part begins there")
        part = np.cumsum(np.isin(np.arange(len(self.rows)), again)) + (0 if again[0] == 0 else 1)
        rows = zip(self.rows, part, strict=True)
        self.rows = [
            (line, [*cells, str(k)]) for i, ((line, cells), k) in enumerate(rows) if i not in again
        ]
        return [*header, "part"]

    def _with_units(self, header: list[str], numbers: list[int]) -> list[str]:
        """The header with the units of the row below it, a row of units if no cell begins with a digit.

        Cells that say that nothing was measured become empty.
        """
        _, units = self.rows[0]
        stated = [units[k] for k in numbers if units[k]]
        if (
            {cell.casefold() for cell in stated} - MISSING
            and not any(map(NUMERIC.match, stated))
            and not any(map(is_statistic, units))
        ):
            self.rows = self.rows[1:]
            stated = [cell.strip("[]() ") if k in numbers else "" for k, cell in enumerate(units)]
            pairs = zip(header, stated, strict=True)
            header = [h if not u or u == read_header(h).unit else f"{h} [{u}]" for h, u in pairs]
        longest = max(map(len, MISSING))
        self.rows = [
            (line, ["" if len(c) <= longest and c.casefold() in MISSING else c for c in cells])
            for line, cells in self.rows
        ]
        self.rows = [row for row in self.rows if any(row[1])]
        return header

    def _without_statistics(self) -> None:
        """Leave out rows that say that they are a mean, a sum or the like of others."""
        left = {}
        for k, (_, cells) in enumerate(self.rows):
            for cell in cells:
                if cell and not (cell[0].isdigit() or cell[0] in "+-.") and is_statistic(cell):
                    left[k] = cell
        if left:
            rows = listed(
                f"line {self.rows[k][0]} ({printable(cell[:20])!r})"
                for k, cell in [*left.items()][:MOST_SHEETS]
            )
            self.remarks.append(f"{len(left)} row(s) that are no measurement are left out: {rows}")
            self.rows = [row for k, row in enumerate(self.rows) if k not in left]

    def _decimal_mark(self) -> str:
        known = [k for k, text in enumerate(self.headers) if _name(text) not in (None, *LABELS)]
        others = [k for k in range(len(self.headers)) if k not in known]
        cells = (cells[k] for places in (known, others) for _, cells in self.rows for k in places)
        first = next((cell for cell in cells if DECIMAL.fullmatch(cell)), "")
        if self.delimiter == "," or "," not in first:
            return "."
        self.remarks.append(COMMAS)
        return ","

    def _number(self, cell: str) -> float:
        """NaN where a cell has no number."""
        if self.mark == ",":
            cell = "" if "." in cell else cell.replace(",", ".")
        try:
            return float(cell.replace("−", "-")) if cell and "_" not in cell else math.nan
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
        float(cell.replace(",", ".").replace("−", "-"))
        return True
    return False


def _are_numbers(cells: Sequence[str]) -> bool:
    """Whether a row begins with numbers, or cells without one."""
    return (
        bool(cells)
        and any(map(_is_number, cells))
        and all(_is_number(cell) or cell.casefold() in MISSING or not cell for cell in cells[:2])
    )


def _spaced(header: str, width: int, delimiter: str) -> list[str]:
    """Headings between white space, as many as there are cells; empty where there are not."""
    if width < 2 or (delimiter and delimiter in header and delimiter != ","):
        return []
    if delimiter == "," and "," in header:
        cells = [cell.strip().strip('"') for cell in header.strip().split(",")]
        return cells if len(cells) == width else []
    words = re.findall(r'"[^"]*"|[^\s"]+', header)
    wide = re.split(r"\s{2,}", header.strip())
    joined: list[str] = []
    for word in words:
        if joined and re.match(r"[\[(].*", word):
            joined[-1] += f" {word}"
        else:
            joined.append(word)
    for cells in (words, wide, joined):
        if len(cells) == width:
            return [cell.strip('"') for cell in cells]
    return []


def _filled(frame: Any) -> list[Row]:
    """Rows of a sheet that are not empty and no comments."""
    rows = enumerate(frame.where(frame.notna(), "").to_numpy().tolist(), start=1)
    texts = ((line, [str(cell) for cell in cells]) for line, cells in rows)
    return [
        (line, cells)
        for line, cells in texts
        if any(cells) and not cells[0].lstrip().startswith("# ")
    ]


def _is_known(rows: Sequence[Row]) -> bool:
    """Whether the columns of a sheet make a set."""
    width = max(len(cells) for _, cells in rows)
    header, *below = [
        (line, [cells[k].strip() if k < len(cells) else "" for k in range(width)])
        for line, cells in rows
    ]
    with suppress(DataError):
        headers, _, _ = reshaped(header[1], below[:50], None)
        if not tracks_in([text for text in headers if text]):
            layout_of([text for text in headers if text])
        return bool(below)
    return False
