"""Where rows go: CSV and NumPy's .npy, as they come."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

import softjax as sj
from calibration.curve.digits import text_of
from calibration.curve.stream import Rows

TEXT_BLOCK = 1 << 14  # rows formatted at once: what fits the processor's cache
NOT_KNOWN = "NOT_KNOWN"


class Writer(ABC):
    """Writes rows to one file; `close` completes it."""

    def __init__(self, path: Path):
        self._file = path.open("wb")

    @abstractmethod
    def write(self, rows: Rows) -> None:
        """Add one block."""

    def close(self) -> None:
        self._file.close()


class CsvWriter(Writer):
    """`velocity [m/s],restitution,status`, and the limits of a band before the status.

    Numbers have 17 digits, which a reader turns into the same float64. The status is the names
    of its flags joined by |, or PLAIN. Where a fit knows nothing cells are empty, and the status is
    NOT_KNOWN.
    """

    def __init__(self, path: Path):
        super().__init__(path)
        self._begun = False

    def write(self, rows: Rows) -> None:
        if not self._begun:
            limits = "" if rows.low is None else "restitution_low,restitution_high,"
            self._file.write(f"velocity [m/s],restitution,{limits}status\n".encode())
            self._begun = True
        self._file.write(csv_text(rows))


class NpyWriter(Writer):
    """A structured array with fields velocity, restitution, status (and low, high), NaN where a
    fit knows nothing.

    The header is written again at the end, when the number of rows is known; NumPy leaves room
    in it for the length to grow.
    """

    def __init__(self, path: Path):
        super().__init__(path)
        self._rows = 0
        self._type: np.dtype | None = None

    def write(self, rows: Rows) -> None:
        names = ["velocity", "restitution", "status"]
        columns = [rows.velocity, rows.coefficient, rows.status]
        if rows.low is not None and rows.high is not None:
            names, columns = [*names, "low", "high"], [*columns, rows.low, rows.high]
        if self._type is None:
            self._type = np.dtype([(n, "<i4" if n == "status" else "<f8") for n in names])
            self._header()
        block = np.empty(len(rows.velocity), self._type)
        for name, column in zip(names, columns, strict=True):
            block[name] = column
        self._file.write(block.tobytes())
        self._rows += len(block)

    def close(self) -> None:
        if self._type is not None:
            self._file.seek(0)
            self._header()
        super().close()

    def _header(self) -> None:
        kind = {
            "descr": np.lib.format.dtype_to_descr(np.dtype(self._type)),
            "fortran_order": False,
            "shape": (self._rows,),
        }
        np.lib.format.write_array_header_1_0(self._file, kind)


def csv_text(rows: Rows) -> bytes:
    """The lines of a CSV file, without its header."""
    return b"".join(_csv_lines(rows.some(part)) for part in parts(len(rows.velocity)))


def _csv_lines(rows: Rows) -> bytes:
    columns = [rows.velocity, rows.coefficient, rows.low, rows.high]
    shown = [column for column in columns if column is not None]
    return lines(shown, b",", _status_text(rows))


def status_names(status: int) -> str:
    """`ELASTIC`, `NO_RESIDUAL_OVERLAP|ENERGY_GAIN`, or `PLAIN`."""
    if not status:
        return "PLAIN"
    return "|".join(flag.name for flag in sj.Status(status) if flag.name)


def _status_text(rows: Rows) -> UInt8[np.ndarray, "n width"]:
    """The names as rows of bytes, zeros behind them."""
    known = np.isfinite(rows.coefficient)
    codes, index = np.unique(np.where(known, rows.status, -1), return_inverse=True)
    names = [NOT_KNOWN if code < 0 else status_names(int(code)) for code in codes]
    words = np.array([name.encode() for name in names])
    return words.view(np.uint8).reshape(len(words), -1)[index]


def parts(count: int, size: int = TEXT_BLOCK) -> Iterator[slice]:
    """Rows that are taken at once."""
    return (slice(start, start + size) for start in range(0, count, size))


def lines(
    columns: Sequence[np.ndarray], mark: bytes, last: UInt8[np.ndarray, "n width"] | None = None
) -> bytes:
    """Columns of numbers side by side as text, a column of bytes behind them; NaN is left empty."""
    text = [np.where(np.isnan(c)[:, None], 0, text_of(c)).astype(np.uint8) for c in columns]
    text += [] if last is None else [last]
    ends = [*[mark] * (len(text) - 1), b"\n"]
    pieces = [
        piece
        for column, end in zip(text, ends, strict=True)
        for piece in (column, np.full((len(column), 1), ord(end), np.uint8))
    ]
    line = np.concatenate(pieces, axis=1)
    return line[line != 0].tobytes()
