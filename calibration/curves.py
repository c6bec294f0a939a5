"""ε(v) of a law or a fit: velocities in, rows of a curve out."""

import sys
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

import softjax as sj
from calibration.data.air import Fall
from calibration.data.names import read_header
from calibration.data.sheet import Sheet, is_number
from calibration.data.units import in_si, unit_of
from calibration.errors import DataError, InputError, Origin, printable, shown

MOST = 10**6  # rows of one curve
BLOCK = 1 << 16  # rows of a band that are computed at once: one may be made of thousands of draws
LARGEST = 64 << 20  # bytes of a file of velocities
NOT_DETERMINED = "NOT_DETERMINED"
FROM_PYTHON = (
    f"at most {MOST} rows; more from Python by `softjax.restitution(law, velocity).coefficient`"
)

Route = sj.EnergyBalance | sj.ClosedForm | sj.ODE | None
Velocities = Float[np.ndarray, " n"]


@dataclass(frozen=True)
class Source:
    """A law with what is known of where it came from.

    Attributes:
        name: of the material.
        law: the contact law.
        span: (lowest, highest) velocity [m/s] of a curve unless stated otherwise.
        properties: those of the bodies by name; None where only the contact is known.
        bodies: "spheres", "unlike spheres" or "wall": how `properties` are to be read.
        result: the fit; None without one.
        draws: of the fit's posterior; None without.
        prediction: by the line through a fit's materials; None without.
        remark: a line on where its numbers come from.
        fall: how the heights of its data became velocities; None without heights.
    """

    name: str
    law: sj.ContactLaw
    span: tuple[float, float]
    properties: dict[str, float] | None = None
    bodies: str = "spheres"
    result: Any = None
    draws: Any = None
    prediction: "Prediction | None" = None
    remark: str = ""
    fall: Fall | None = None

    def extrapolation(self, velocity: Velocities) -> str | None:
        """A line where velocities go beyond the data of a fit; else None."""
        ends = float(np.min(velocity)), float(np.max(velocity))
        if self.result is None or self.result.extrapolation(ends, self.name) is None:
            return None
        data = self.result.material(self.name).data.velocity
        curve, measured = (f"{np.min(v):.4g} to {np.max(v):.4g} m/s" for v in (velocity, data))
        name = printable(self.name)
        return f"extrapolation: the curve goes from {curve}, the data of {name} from {measured}"


class Prediction(NamedTuple):
    """Eq. (18)'s line, and what is stated of the further material: ε_up, or σ and ψ."""

    line: Any
    losses: dict[str, float | None]

    def band(self, contact: Any, velocity: Velocities) -> Any:
        """The curve of the further material with its band."""
        return self.line.band(contact, velocity, **self.losses)


class Rows(NamedTuple):
    """A curve: v [m/s], ε, status, and the confidence limits of a fit's ε.

    ε and its limits are NaN where a fit does not determine them.
    """

    velocity: Velocities
    coefficient: Velocities
    status: Int[np.ndarray, " n"]
    low: Velocities | None = None
    high: Velocities | None = None

    @property
    def known(self) -> np.ndarray:
        """Rows that have an ε."""
        return np.isfinite(self.coefficient)

    def some(self, which: Any) -> "Rows":
        """The rows of an index, a mask or a slice."""
        return Rows._make(None if column is None else column[which] for column in self)

    def as_csv(self) -> str:
        """`velocity [m/s],restitution,status`, and the limits of a band before the status.

        Numbers have the digits that a reader needs for the same float64. The status is the names of
        its flags joined by |, or PLAIN; where a fit does not determine ε cells are empty, and the
        status is NOT_DETERMINED.
        """
        names = ["velocity [m/s]", "restitution", "restitution_low", "restitution_high"]
        columns = [self.velocity, self.coefficient, self.low, self.high]
        pairs = [(n, c) for n, c in zip(names, columns, strict=True) if c is not None]
        codes, index = np.unique(np.where(self.known, self.status, -1), return_inverse=True)
        words = [NOT_DETERMINED if code < 0 else status_names(int(code)) for code in codes]
        header = ",".join([*(name for name, _ in pairs), "status"])
        lines = text_rows([column for _, column in pairs], ",", [words[k] for k in index])
        return f"{header}\n{lines}"

    def as_array(self) -> np.ndarray:
        """A structured array with fields velocity, restitution, status (and low, high)."""
        stored = [self.velocity, self.coefficient, self.status.astype("<i4"), self.low, self.high]
        names = ["velocity", "restitution", "status", "low", "high"]
        columns = [column for column in stored if column is not None]
        kinds = [(name, column.dtype) for name, column in zip(names, columns, strict=False)]
        return np.rec.fromarrays(columns, dtype=kinds)


def text_rows(columns: list[np.ndarray], mark: str, last: list[str] | None = None) -> str:
    """Columns of numbers side by side as text, in front of one of words; NaN is left empty."""
    cells = [["" if x != x else repr(x) for x in column.tolist()] for column in columns]
    cells += [] if last is None else [last]
    return "".join(f"{mark.join(row)}\n" for row in zip(*cells, strict=True))


def status_names(status: int) -> str:
    """`ELASTIC`, `NO_RESIDUAL_OVERLAP|ENERGY_GAIN`, or `PLAIN`."""
    return "|".join(flag.name for flag in sj.Status(status) if flag.name) or "PLAIN"


def curve_of(source: Source, velocity: Velocities, route: Route = None) -> Rows:
    """ε at velocities [m/s]: by the law's first route, unless stated; of a fit with its band."""
    hit = sj.restitution(source.law, velocity, route)
    status = np.asarray(hit.status)
    if source.prediction is not None:
        found = source.prediction.band(source.law.contact, velocity)
        return Rows(velocity, found.coefficient, status, found.low, found.high)
    if source.result is None:
        return Rows(velocity, np.asarray(hit.coefficient), status)
    blocks = np.split(velocity, range(BLOCK, len(velocity), BLOCK))
    bands = [source.result.band(block, source.name, draws=source.draws) for block in blocks]
    columns = ("coefficient", "low", "high")
    value, low, high = (np.concatenate([getattr(b, n) for b in bands]) for n in columns)
    return Rows(velocity, value, status, low, high)


def grid(first: float, last: float, points: int, spacing: str | None) -> Velocities:
    """`points` velocities from `first` to `last` [m/s], evenly spaced, or evenly in the logarithm.

    Raises:
        DataError: naming the option, its value and what is accepted.
    """
    if not 1 <= points <= MOST:
        raise DataError("--points", points, f"a whole number of 1 or more, {FROM_PYTHON}")
    if not 0 <= first < np.inf:
        raise DataError("--from", first, "a velocity of 0 m/s or more")
    if not first <= last < np.inf:
        raise DataError("--to", last, f"a velocity of {first:g} m/s (--from) or more")
    if spacing == "log" and first == 0:
        raise DataError("--from", first, "a velocity above 0 m/s with --spacing log")
    logarithmic = spacing == "log" or (spacing is None and first > 0)
    return (np.geomspace if logarithmic else np.linspace)(first, last, points)


def read_velocities(path: str) -> Velocities:
    """The velocities [m/s] of a CSV file, or of standard input ("-").

    One number a line, or a table whose header names a column `velocity` and its unit, as in a file
    of measurements (`velocity [cm/s]`, `v (km/h)`). Commas, semicolons or tabs separate cells; where
    they are not commas a decimal may be one. Blank lines and lines that begin with # are ignored.

    Raises:
        InputError: with file and line, what is wrong and what is accepted.
    """
    name = "standard input" if path == "-" else path
    sheet = Sheet(name, _bytes(path, name))
    if not sheet.rows:
        raise InputError(name, None, "no velocities", "one number a line is needed")
    first = sheet.rows[0]
    head = [cell.strip() for cell in first.cells]
    while not head[-1]:
        head.pop()
    place, unit, rows = 0, unit_of("m/s", "m/s"), sheet.rows
    if len(head) > 1 or not is_number(head[0]):
        place, unit = _velocity_column(head, Origin(name, first.line))
        rows = rows[1:]
    if not rows:
        accepted = "one number a line is needed below the header"
        raise InputError(name, first.line, "no velocities", accepted)
    if len(rows) > MOST:
        raise InputError(name, None, f"{len(rows)} velocities", FROM_PYTHON)
    rows = [sheet.full(row, len(head)) for row in rows]
    sheet.find_mark(rows, [place])
    found = sheet.numbers("velocity", [row.cells[place].strip() for row in rows], rows)
    for k in np.flatnonzero(~(found >= 0))[:1]:
        problem = f"{shown(sheet.delimiter.join(rows[k].cells))!r} holds no velocity"
        raise InputError(name, rows[k].line, problem, "a finite number of 0 m/s or more")
    return in_si(found, unit)


def _bytes(path: str, name: str) -> bytes:
    """The full text of a file, which may be a pipe."""
    try:
        with nullcontext(sys.stdin.buffer) if path == "-" else Path(path).open("rb") as file:
            raw = file.read(LARGEST + 1)
    except FileNotFoundError:
        accepted = "a file that exists, or - for standard input"
        raise InputError(name, None, "no such file", accepted) from None
    except OSError as error:
        problem = f"cannot be read ({error.strerror})"
        raise InputError(name, None, problem, "a readable file is needed") from None
    if len(raw) > LARGEST:
        raise InputError(name, None, f"more than {LARGEST >> 20} MiB", FROM_PYTHON)
    return raw


def _velocity_column(head: list[str], origin: Origin) -> tuple[int, Any]:
    """Position of the velocity and its unit."""
    for position, cell in enumerate(head):
        try:
            header = read_header(cell)
            if header.name == "velocity":
                return position, unit_of(header.unit or "m/s", "m/s")
        except DataError as error:
            raise origin.error(error) from None
    problem = f"no column named velocity in {shown(', '.join(head))!r}"
    accepted = "one number a line, or a header with velocity"
    raise InputError(origin.file, origin.line, problem, accepted)
