"""ε(v) of a law or a fit: velocities in, rows of a curve or a look-up table for particle codes out.

Between two rows of a table a code interpolates linearly. So the table has two rows at first yield, where ε
jumps, and two where ε comes to 0, and its header says how far that leaves it from the law.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

import softjax as sj
from calibration.data.air import Fall
from calibration.data.columns import read_header
from calibration.data.sheet import Sheet, is_number
from calibration.data.text_file import MIB, read_bytes
from calibration.data.units import in_si, unit_of
from calibration.errors import DataError, InputError, Origin, printable, shown
from calibration.fitting.curves import yield_velocity
from calibration.fitting.warnings import is_outside

MOST = 10**6  # rows of one curve
BLOCK = 1 << 16  # rows of a band that are computed at once: one may be made of thousands of draws
LARGEST = 64 * MIB  # of a file of velocities
FROM_PYTHON = (
    f"at most {MOST} rows; more from Python by `softjax.restitution(law, velocity).coefficient`"
)
COLUMNS = {  # of a table, after velocity and restitution
    "plastic_coefficient": "plastic_restitution",
    "duration": "duration[s]",
    "peak_overlap": "largest_overlap[m]",
    "peak_force": "peak_force[N]",
}
ASIDE = 1e-12  # of the velocity of a jump or of the end of ε, from there to the rows next to it
# where between two rows the law is compared; then about the largest difference, ever closer
INSIDE = np.linspace(0, 1, 9)[1:-1, None]
CLOSER = np.linspace(-1, 1, 9)[:, None]
INTERVALS, TIMES = 64, 10  # that are compared more closely, and how often by a quarter

Route = sj.EnergyBalance | sj.ClosedForm | sj.ODE | None
Velocities = Float[np.ndarray, " n"]
Exact = Callable[[Velocities], Velocities]


@dataclass(frozen=True)
class Source:
    """A law, and where it came from: Table 1, a file, a fit, or Eq. (18) through a fit's materials.

    `span` and `measured` are ranges of velocity [m/s]: of a curve by default, and of the data;
    `properties` are those of `bodies` by name ("spheres", "unlike spheres", "wall"), None where only
    the contact is known; `losses` are ε_up, or σ and ψ, of a material predicted by the line.
    """

    name: str
    law: sj.ContactLaw
    span: tuple[float, float]
    properties: dict[str, float] | None = None
    bodies: str = "spheres"
    result: Any = None
    draws: Any = None
    line: Any = None
    losses: Mapping[str, float | None] = field(default_factory=dict)
    remark: str = ""
    fall: Fall | None = None
    measured: tuple[float, float] | None = None

    def extrapolation(self, velocity: Velocities) -> str | None:
        """A line where velocities go beyond the data of a fit; else None."""
        if self.measured is None or not np.any(is_outside(velocity, *self.measured)):
            return None
        curve, measured = (
            f"{np.min(v):.4g} to {np.max(v):.4g} m/s" for v in (velocity, self.measured)
        )
        owner = printable(self.name) if self.line is None else "the fitted materials"
        return f"extrapolation: the curve goes from {curve}, the data of {owner} from {measured}"


class Rows(NamedTuple):
    """A curve: v [m/s], ε, status, and limits of a fit's ε; NaN where a fit does not determine them."""

    velocity: Velocities
    coefficient: Velocities
    status: Int[np.ndarray, " n"]
    low: Velocities | None = None
    high: Velocities | None = None

    def some(self, which: Any) -> "Rows":
        """The rows of an index, a mask or a slice."""
        return Rows._make(None if column is None else column[which] for column in self)

    def as_csv(self) -> str:
        """Numbers with the digits that a reader needs for the same float64; flags joined by |.

        Where a fit does not determine ε cells are empty, and the status is NOT_DETERMINED.
        """
        columns = {"velocity [m/s]": self.velocity, "restitution": self.coefficient}
        if self.low is not None and self.high is not None:
            columns |= {"restitution_low": self.low, "restitution_high": self.high}
        known = np.isfinite(self.coefficient)
        codes, index = np.unique(np.where(known, self.status, -1), return_inverse=True)
        words = ["NOT_DETERMINED" if code < 0 else status_names(int(code)) for code in codes]
        lines = text_rows([*columns.values()], ",", [words[k] for k in index])
        return f"{','.join([*columns, 'status'])}\n{lines}"

    def as_array(self) -> np.ndarray:
        """A structured array with fields velocity, restitution, status (and low, high)."""
        names = ("velocity", "restitution", "status", "low", "high")
        columns = [column for column in self if column is not None]
        columns[2] = self.status.astype("<i4")
        kinds = [(name, column.dtype) for name, column in zip(names, columns, strict=False)]
        return np.rec.fromarrays(columns, dtype=kinds)


def text_rows(columns: list[np.ndarray], mark: str, last: list[str] | None = None) -> str:
    """Columns of numbers as text, and one of words after them; NaN is left empty."""
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
    if source.line is not None:
        contact = source.law.contact  # type: ignore[attr-defined]
        band = source.line.band(contact, velocity, **source.losses)
        return Rows(velocity, band.coefficient, status, band.low, band.high)
    if source.result is None:
        return Rows(velocity, np.asarray(hit.coefficient), status)
    blocks = np.split(velocity, range(BLOCK, len(velocity), BLOCK))
    bands = [source.result.band(block, source.name, draws=source.draws) for block in blocks]
    columns = ("coefficient", "low", "high")
    value, low, high = (np.concatenate([getattr(b, n) for b in bands]) for n in columns)
    return Rows(velocity, value, status, low, high)


def grid(first: float, last: float, points: int, spacing: str | None) -> Velocities:
    """`points` velocities [m/s], evenly spaced, or evenly in the logarithm."""
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
    """The velocities [m/s] of a CSV file, or of standard input ("-"); raises InputError.

    One number a line, or a table whose header names a column `velocity` and its unit.
    """
    name = "standard input" if path == "-" else path
    sheet = Sheet(name, read_bytes(path, LARGEST, or_pipe=True))
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
    velocity = sheet.numbers("velocity", [row.cells[place].strip() for row in rows], rows)
    for k in np.flatnonzero(~(velocity >= 0))[:1]:
        problem = f"{shown(sheet.delimiter.join(rows[k].cells))!r} holds no velocity"
        raise InputError(name, rows[k].line, problem, "a finite number of 0 m/s or more")
    return in_si(velocity, unit)


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


def with_knots(source: Source, velocity: Velocities, route: Route = None) -> Velocities:
    """Ascending velocities with two more at first yield, and two at each end of ε."""
    at = yield_velocity(source.law)
    if at is not None and velocity[0] < at < velocity[-1]:
        velocity = np.union1d(velocity, [at * (1 - ASIDE), at * (1 + ASIDE)])
    return np.union1d(velocity, _ends(_restitution(source, route), velocity))


def table_text(source: Source, rows: Rows, route: Route = None) -> str:
    """v [m/s] ascending, ε, and of laws with a force `COLUMNS`; separated by blanks, comments after #.

    Rows whose ε a fit does not determine are left out, and the header says so.
    """
    rows = rows.some(np.isfinite(rows.coefficient))
    if np.any(np.diff(rows.velocity) <= 0):
        problem = "the velocities do not ascend"
        raise InputError(None, None, problem, "--table takes each velocity once, ascending")
    columns, names = [rows.velocity, rows.coefficient], ["velocity[m/s]", "restitution"]
    if not isinstance(source.law, sj.HardSphereLaw):
        hit = sj.restitution(source.law, rows.velocity, route)
        columns += [np.asarray(getattr(hit, name)) for name in COLUMNS]
        names += COLUMNS.values()
    error = _error(_restitution(source, route), rows.velocity, rows.coefficient)
    head = [*_head(source, rows.velocity), _promise(error), " ".join(names)]
    return "".join(f"# {line}\n" for line in head) + text_rows(columns, " ")


def _restitution(source: Source, route: Route) -> Exact:
    return lambda velocity: curve_of(source, velocity, route).coefficient


def _ends(exact: Exact, velocity: Velocities) -> Velocities:
    """Two velocities about each place between neighbours where ε comes to 0, or leaves it."""
    rebounds = np.nan_to_num(exact(velocity), nan=-1.0)
    changes = np.diff(np.sign(rebounds)) != 0
    jumps = np.flatnonzero(changes & (np.minimum(rebounds[:-1], rebounds[1:]) == 0))
    low, high = velocity[jumps], velocity[jumps + 1]
    sides = rebounds[jumps] > 0
    while np.any(high - low > ASIDE * high):
        middle = 0.5 * (low + high)
        same = (exact(middle) > 0) == sides
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    return np.concatenate([low, high])


def _error(exact: Exact, velocity: Velocities, coefficient: Velocities) -> float:
    """Largest difference between the curve and the interpolation of neighbouring rows, except at a jump.

    It is enclosed where the comparison finds the largest ones: a law may bend anywhere between two rows.
    """
    wide = np.flatnonzero(np.diff(velocity) > 1e3 * ASIDE * velocity[1:])
    if not len(wide):
        return 0.0

    def apart(share, rows):
        inner, linear = (
            (1 - share) * ends[rows] + share * ends[rows + 1] for ends in (velocity, coefficient)
        )
        return np.nan_to_num(np.abs(exact(np.ravel(inner)).reshape(inner.shape) - linear))

    differences = apart(INSIDE, wide)
    rows = np.argsort(np.max(differences, axis=0))[-INTERVALS:]
    centre, reach = INSIDE[np.argmax(differences[:, rows], axis=0), 0], 1 / 8
    largest = float(np.max(differences))
    for _ in range(TIMES):
        share = np.clip(centre + reach * CLOSER, 0, 1)
        differences = apart(share, wide[rows])
        centre = np.take_along_axis(share, np.argmax(differences, axis=0)[None], axis=0)[0]
        largest, reach = max(largest, float(np.max(differences))), reach / 4
    return largest


def _promise(error: float) -> str:
    """A bound of the error in words: 1.01 times it, rounded up to two digits."""
    spared = 1.01 * error
    unit = 10.0 ** (math.floor(math.log10(spared)) - 1) if spared > 0 else 1.0
    return (
        f"interpolated linearly, restitution errs by {math.ceil(spared / unit) * unit:.1e} at most"
    )


def _head(source: Source, velocity: Velocities) -> Iterator[str]:
    yield f"restitution of {printable(source.name)}"
    at = yield_velocity(source.law)
    if at is not None:
        yield f"first yield at {at:.6g} m/s, where restitution may jump"
    if source.result is not None:
        fit = source.result.material(source.name)
        for word, end in (("below", fit.known_from), ("above", fit.known_to)):
            if 0 < end < np.inf:
                yield f"the data do not determine restitution {word} {end:.6g} m/s: no rows"
    if source.measured is not None and len(velocity):
        yield (
            source.extrapolation(velocity) or "all rows lie within the velocities of the fit's data"
        )
