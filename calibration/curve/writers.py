"""Where rows go: CSV, NumPy's .npy, and look-up tables for particle codes, as they come."""

from abc import ABC, abstractmethod
from pathlib import Path

import numpy as np

import softjax as sj
from calibration.curve.digits import text_of
from calibration.curve.stream import Rows
from calibration.errors import InputError

TEXT_BLOCK = 1 << 14  # rows formatted at once: what fits the processor's cache


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
    of its flags joined by |, or PLAIN.
    """

    def __init__(self, path: Path):
        super().__init__(path)
        self._begun = False

    def write(self, rows: Rows) -> None:
        columns = [rows.velocity, rows.coefficient]
        header = "velocity [m/s],restitution,"
        if rows.low is not None:
            columns += [rows.low, rows.high]
            header += "restitution_low,restitution_high,"
        if not self._begun:
            self._file.write(f"{header}status\n".encode())
            self._begun = True
        for part in _parts(len(rows.velocity)):
            text = [text_of(column[part]) for column in columns]
            text.append(_status_text(rows.status[part]))
            self._file.write(_lines(text, b","))


class TableWriter(Writer):
    """Two columns, v [m/s] ascending and ε, blanks between, comments behind #.

    What codes that look a restitution up by its impact velocity take in.
    """

    def __init__(self, path: Path, name: str):
        super().__init__(path)
        self._last: float = -np.inf
        self._file.write(f"# restitution of {name}\n# velocity[m/s] restitution\n".encode())

    def write(self, rows: Rows) -> None:
        if rows.velocity[0] <= self._last or np.any(np.diff(rows.velocity) <= 0):
            problem = "the velocities do not ascend"
            raise InputError(None, None, problem, "--table takes each velocity once, ascending")
        self._last = float(rows.velocity[-1])
        for part in _parts(len(rows.velocity)):
            columns = (rows.velocity, rows.coefficient)
            self._file.write(_lines([text_of(column[part]) for column in columns], b" "))


class NpyWriter(Writer):
    """A structured array with fields velocity, restitution, status (and low, high).

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
        if rows.low is not None:
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
            "descr": np.lib.format.dtype_to_descr(self._type),
            "fortran_order": False,
            "shape": (self._rows,),
        }
        np.lib.format.write_array_header_1_0(self._file, kind)


def status_names(status: int) -> str:
    """`ELASTIC`, `NO_RESIDUAL_OVERLAP|ENERGY_GAIN`, or `PLAIN`."""
    if not status:
        return "PLAIN"
    return "|".join(flag.name for flag in sj.Status(status) if flag.name)


def _status_text(status: np.ndarray) -> np.ndarray:
    """The names as rows of bytes, zeros behind them."""
    codes, index = np.unique(status, return_inverse=True)
    words = np.array([status_names(int(code)).encode() for code in codes])
    return words.view(np.uint8).reshape(len(words), -1)[index]


def _parts(count: int):
    return (slice(start, start + TEXT_BLOCK) for start in range(0, count, TEXT_BLOCK))


def _lines(columns: list[np.ndarray], mark: bytes) -> bytes:
    """Columns of text side by side, without the zeros that fill them up."""
    count = len(columns[0])
    pieces = []
    for i, column in enumerate(columns):
        end = b"\n" if i == len(columns) - 1 else mark
        pieces += [column, np.full((count, 1), ord(end), np.uint8)]
    line = np.concatenate(pieces, axis=1)
    return line[line != 0].tobytes()
