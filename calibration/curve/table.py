"""Look-up tables for particle codes: ε and what happens in a collision, over ascending velocities.

Between two rows a code interpolates linearly. So the table has two rows at first yield, where ε jumps,
and two where ε comes to 0, and its header says how far that leaves it from the law.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

import softjax as sj
from calibration.curve.source import WIDEST, Source
from calibration.curve.stream import Route, Rows, evaluator, in_one_size
from calibration.curve.writers import Writer, lines, parts
from calibration.errors import InputError, printable
from calibration.fitting.curves import yield_velocity

COLUMNS = ("plastic_restitution", "duration[s]", "largest_overlap[m]", "peak_force[N]")
ASIDE = 1e-12  # of the velocity of a jump or of the end of ε, from there to the rows next to it
# where between two rows the law is compared; then about the largest difference, ever closer
INSIDE = np.linspace(0, 1, 9)[1:-1, None]
CLOSER = np.linspace(-1, 1, 9)[:, None]
INTERVALS, TIMES = 64, 10  # that are compared more closely, and how often by a quarter
LOADING = np.linspace(0, 1, 65)[1:]  # of the largest overlap: where the force may be largest
ROWS = 4096  # that are computed at once, each with its history or some of its forces
SAMPLES = 201  # of a history, where the force depends on the velocity
NOT_BEYOND = "all rows lie between the fit's data"
ERROR = "# interpolated linearly, restitution errs by {:.1e} at most\n"  # of one length


class Impacts(NamedTuple):
    """Columns beside ε, each (n,): ε_p [-], duration [s], largest overlap [m], peak force [N]."""

    plastic_coefficient: Float[np.ndarray, " n"]
    duration: Float[np.ndarray, " n"]
    peak_overlap: Float[np.ndarray, " n"]
    peak_force: Float[np.ndarray, " n"]


def with_knots(
    source: Source, blocks: Iterable[np.ndarray], span: tuple[float, float], route: Route = None
) -> Iterator[np.ndarray]:
    """Ascending blocks with two velocities more at first yield, and two at each end of ε."""
    at = yield_velocity(source.law)
    knots = [] if at is None else [at * (1 - ASIDE), at * (1 + ASIDE)]
    left = np.array([v for v in knots if span[0] < v < span[1]])
    exact, last = in_one_size(evaluator(source, route)), np.zeros(0)
    for block in blocks:
        here = left[left <= block[-1]]
        left = left[len(here) :]
        block = np.union1d(block, here)
        ends = _ends(exact, np.concatenate([last, block]))
        last = block[-1:]
        yield np.union1d(block, ends)


def _ends(exact: Callable[[np.ndarray], Rows], velocity: np.ndarray) -> np.ndarray:
    """Two velocities about each place between neighbours where ε comes to 0, or leaves it."""
    rebounds = np.nan_to_num(exact(velocity).coefficient, nan=-1.0)
    jumps = np.flatnonzero((np.diff(np.sign(rebounds)) != 0) & (np.minimum(*_pairs(rebounds)) == 0))
    low, high = velocity[jumps], velocity[jumps + 1]
    sides = rebounds[jumps] > 0
    for _ in range(100):
        if np.all(high - low <= ASIDE * high):
            break
        middle = 0.5 * (low + high)
        same = (exact(middle).coefficient > 0) == sides
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    return np.concatenate([low, high])


def _pairs(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return values[:-1], values[1:]


class TableWriter(Writer):
    """v [m/s] ascending, ε, and of laws with a force `COLUMNS`; blanks between, comments behind #.

    Rows of which a fit knows nothing are left out, and the header says so.
    """

    def __init__(self, path: Path, source: Source, route: Route = None):
        super().__init__(path)
        self._exact, self._closer = (in_one_size(evaluator(source, route)) for _ in range(2))
        has_force = not isinstance(source.law, sj.HardSphereLaw)
        self._impacts = in_one_size(lambda v: impacts(source.law, v, route)) if has_force else None
        self._last: tuple[float, float] | None = None
        self._error = 0.0
        self._source, self._first = source, float("nan")
        self._file.write("".join(_head(source)).encode())
        self._place = self._file.tell()
        names = ["velocity[m/s]", "restitution", *COLUMNS[: len(COLUMNS) * has_force]]
        self._file.write(self._later() + f"# {' '.join(names)}\n".encode())

    def write(self, rows: Rows) -> None:
        rows = rows.some(np.isfinite(rows.coefficient))
        if not len(rows.velocity):
            return
        knots = np.array([rows.velocity, rows.coefficient])
        if self._last is None:
            self._first = float(rows.velocity[0])
        else:
            knots = np.concatenate([np.array([self._last]).T, knots], axis=1)
        if np.any(np.diff(knots[0]) <= 0):
            problem = "the velocities do not ascend"
            raise InputError(None, None, problem, "--table takes each velocity once, ascending")
        self._last = (float(knots[0, -1]), float(knots[1, -1]))
        self._error = max(self._error, self._between(*knots))
        for part in parts(len(rows.velocity), ROWS):
            velocity, coefficient = rows.velocity[part], rows.coefficient[part]
            more = () if self._impacts is None else self._impacts(velocity)
            self._file.write(lines([velocity, coefficient, *more], b" "))

    def close(self) -> None:
        self._file.seek(self._place)
        self._file.write(self._later())
        super().close()

    def _later(self) -> bytes:
        """What only the last row tells, of one length."""
        error = ERROR.format(_rounded_up(1.01 * self._error)).encode()
        if self._source.result is None:
            return error
        last = self._first if self._last is None else self._last[0]
        told = self._source.extrapolation((self._first, last))
        room = len(self._source.extrapolation_text(WIDEST).encode())
        return b"# " + (told or NOT_BEYOND).encode().ljust(room) + b"\n" + error

    def _between(self, velocity: np.ndarray, coefficient: np.ndarray) -> float:
        """How far interpolation between neighbours is from the curve; rows at a jump left out.

        Where the law bends or jumps between two rows the largest difference lies anywhere: it is
        enclosed where the comparison finds the largest ones.
        """
        wide = np.flatnonzero(np.diff(velocity) > 1e3 * ASIDE * velocity[1:])
        if not len(wide):
            return 0.0

        def apart(exact, share, rows):
            inner, told = (
                (1 - share) * ends[rows] + share * ends[rows + 1]
                for ends in (velocity, coefficient)
            )
            found = exact(np.ravel(inner)).coefficient.reshape(inner.shape) - told
            return np.nan_to_num(np.abs(found))

        found = apart(self._exact, INSIDE, wide)
        rows = np.argsort(np.max(found, axis=0))[-INTERVALS:]
        centre, reach = INSIDE[np.argmax(found[:, rows], axis=0), 0], 1 / 8
        largest = float(np.max(found))
        for _ in range(TIMES):
            share = np.clip(centre + reach * CLOSER, 0, 1)
            found = apart(self._closer, share, wide[rows])
            centre = np.take_along_axis(share, np.argmax(found, axis=0)[None], axis=0)[0]
            largest, reach = max(largest, float(np.max(found))), reach / 4
        return largest


def _rounded_up(value: float) -> float:
    """To two digits."""
    if value <= 0:
        return 0.0
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return math.ceil(value / unit) * unit


def impacts(law: sj.ContactLaw, velocity: Float[np.ndarray, " n"], route: Route = None) -> Impacts:
    """What happens in collisions of a law with a force."""
    hit = sj.restitution(law, velocity, route=route)
    force = _largest_force(law, velocity, hit.peak_overlap, route)
    every = (hit.plastic_coefficient, hit.duration, hit.peak_overlap, force)
    return Impacts(*(np.asarray(one) for one in every))


def _largest_force(law: sj.ContactLaw, velocity, overlap, route: Route):
    if isinstance(law, sj.RateIndependentLaw):
        return jnp.max(law.loading_force(LOADING[:, None] * overlap), axis=0)
    history = sj.collide(law, velocity, SAMPLES, route if isinstance(route, sj.ODE) else None)
    return jnp.max(history.force, axis=-1)


def _head(source: Source) -> Iterator[str]:
    yield f"# restitution of {printable(source.name)}\n"
    at = yield_velocity(source.law)
    if at is not None:
        yield f"# first yield at {at:.6g} m/s, where restitution may jump\n"
    if source.result is not None:
        fit = source.result.material(source.name)
        for word, end in (("below", fit.known_from), ("above", fit.known_to)):
            if 0 < end < np.inf:
                yield f"# nothing is known {word} {end:.6g} m/s, where no points are: no rows\n"
