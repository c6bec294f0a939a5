"""ε(v) of a law or a fit: velocities in, rows of a curve or a look-up table for particle codes out.

Between two rows of a table a code interpolates linearly. So the table has two rows at first yield, where ε
jumps, and its header says how far that leaves it from the law.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from jaxtyping import Float, Int

import softjax as sj
from calibration.data.air import Fall
from calibration.data.checks import require
from calibration.data.columns import read_header
from calibration.data.sheet import LARGEST, Sheet
from calibration.data.text_file import read_bytes
from calibration.data.units import in_si, unit_of
from calibration.errors import DataError, InputError, printable
from calibration.fitting.curves import yield_velocity
from calibration.fitting.warnings import is_outside

MOST = 10**6  # rows of one curve
BLOCK = 1 << 16  # rows of a band that are computed at once: one may be made of thousands of draws
FROM_PYTHON = (
    f"at most {MOST} rows; more from Python by `softjax.restitution(law, velocity).coefficient`"
)
COLUMNS = {  # of a table, after velocity and restitution
    "plastic_coefficient": "plastic_restitution",
    "duration": "duration[s]",
    "peak_overlap": "largest_overlap[m]",
    "peak_force": "peak_force[N]",
}
ASIDE = 1e-12  # of the velocity of a jump, from there to the rows next to it
FEWEST, PLACES = 9, 65  # from one row to the next, both included, where the law is compared
COMPARED = 10**6  # of these in all

Route = sj.AbstractRoute | None
Velocities = Float[np.ndarray, " n"]


@dataclass(frozen=True)
class Source:
    """A law, and where it came from: Table 1, a file, a fit, or Eq. (18) through a fit's materials.

    `span` and `measured` are ranges of velocity [m/s]: of a curve by default, and of the data;
    `properties` are those of `bodies` by name ("spheres", "unlike spheres", "wall"), None where only
    the contact is known; `gravity` is g where the file states it [m/s²].
    """

    name: str
    law: sj.ContactLaw
    span: tuple[float, float]
    properties: dict[str, float] | None = None
    bodies: str = "spheres"
    result: Any = None
    draws: Any = None
    line: Any = None
    remark: str = ""
    fall: Fall | None = None
    gravity: float | None = None
    measured: tuple[float, float] | None = None
    warnings: Sequence[str] = ()  # of the fit that it comes from

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

    def select(self, which: Any) -> "Rows":
        """The rows of an index, a mask or a slice."""
        return Rows._make(None if column is None else column[which] for column in self)

    def as_csv(self) -> str:
        """Numbers with the digits that a reader needs for the same float64; flags joined by |.

        Where a fit does not determine ε cells are empty, and the status is NOT_DETERMINED.
        """
        columns = {"velocity [m/s]": self.velocity, "restitution": self.coefficient}
        if self.low is not None and self.high is not None:
            columns |= {"restitution_low": self.low, "restitution_high": self.high}
        codes, index = np.unique(self.status, return_inverse=True)
        words = np.array([status_names(int(code)) for code in codes])[index]
        words = np.where(np.isfinite(self.coefficient), words, "NOT_DETERMINED")
        table = pd.DataFrame(columns | {"status": words})
        return table.to_csv(index=False, lineterminator="\n")


def status_names(status: int) -> str:
    """`ELASTIC`, `NO_RESIDUAL_OVERLAP|ENERGY_GAIN`, or `PLAIN`."""
    return "|".join(flag.name for flag in sj.Status(status) if flag.name) or "PLAIN"


def curve_of(source: Source, velocity: Velocities, route: Route = None) -> Rows:
    """ε at velocities [m/s]: by the law's first route, unless stated; of a fit with its band."""
    hit = sj.restitution(source.law, velocity, route)
    status = np.asarray(hit.status)
    if source.line is not None:
        contact = source.law.contact  # type: ignore[attr-defined]
        band = source.line.band(contact, velocity)
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
    sheet = Sheet(name, read_bytes(path, LARGEST, or_pipe=True), "velocity")
    if len(sheet.rows) > MOST:
        raise InputError(name, None, f"{len(sheet.rows)} velocities", FROM_PYTHON)
    try:
        headers = {header.name or header.other: header for header in map(read_header, sheet)}
        if "velocity" not in headers:
            accepted = "one with velocity, or left out above one number a line"
            raise DataError("header", ", ".join(sheet), accepted)
        unit = unit_of(headers["velocity"].unit or "m/s", "m/s")
        velocity = sheet[headers["velocity"].text]
        require("velocity", velocity, lambda v: v >= 0, "a finite speed of 0 m/s or more")
        return in_si(velocity, unit)
    except DataError as error:
        raise sheet.origin.error(error) from None


def with_knots(source: Source, velocity: Velocities) -> Velocities:
    """Ascending velocities with two more at first yield."""
    at = yield_velocity(source.law)
    if at is not None and velocity[0] < at < velocity[-1]:
        velocity = np.union1d(velocity, [at * (1 - ASIDE), at * (1 + ASIDE)])
    return velocity


def table_text(source: Source, rows: Rows, route: Route = None) -> str:
    """v [m/s] ascending, ε, and of laws with a force `COLUMNS`; separated by blanks, comments after #.

    Rows whose ε a fit does not determine are left out, and the header says so.
    """
    rows = rows.select(np.isfinite(rows.coefficient))
    if np.any(np.diff(rows.velocity) <= 0):
        problem = "the velocities do not ascend"
        raise InputError(None, None, problem, "--table takes each velocity once, ascending")
    columns, names = [rows.velocity, rows.coefficient], ["velocity[m/s]", "restitution"]
    if not isinstance(source.law, sj.HardSphereLaw):
        hit = sj.restitution(source.law, rows.velocity, route)
        columns += [np.asarray(getattr(hit, name)) for name in COLUMNS]
        names += COLUMNS.values()
    head = [*_head(source, rows.velocity), _error(source, rows, route), " ".join(names)]
    table = pd.DataFrame(np.stack(columns, axis=1)).to_csv(None, sep=" ", header=False, index=False)
    return "".join(f"# {line}\n" for line in head) + table


def _error(source: Source, rows: Rows, route: Route) -> str:
    """State the largest difference between the curve and the interpolation of neighbouring rows, except at a jump."""
    wide = np.flatnonzero(np.diff(rows.velocity) > 1e3 * ASIDE * rows.velocity[1:])
    places = min(max(FEWEST, COMPARED // max(len(wide), 1)), PLACES)
    share = np.linspace(0, 1, places)[:, None]
    inner, linear = (
        (1 - share) * ends[wide] + share * ends[wide + 1]
        for ends in (rows.velocity, rows.coefficient)
    )
    exact = curve_of(source, np.ravel(inner), route).coefficient.reshape(inner.shape)
    error = np.nanmax(np.abs(exact - linear), initial=0.0)
    about = f"differs from the curve by about {error:.1e} at most"
    return (
        f"linear interpolation between rows {about}; how well the curve is known is another matter"
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
