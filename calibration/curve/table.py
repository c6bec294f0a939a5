"""Look-up tables for particle codes: ε and what happens in a collision, over ascending velocities.

Between two rows a code interpolates linearly. So the table has two rows where ε jumps, at first
yield, and tells in its header how far that leaves it from the law.
"""

from collections.abc import Iterable, Iterator
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
ASIDE = 1e-12  # of the velocity at first yield, from there to the rows beside it
INSIDE = np.array([0.25, 0.5, 0.75])  # where between two rows the law is looked at
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


def with_yield(
    source: Source, blocks: Iterable[np.ndarray], span: tuple[float, float]
) -> Iterator[np.ndarray]:
    """Ascending blocks with two velocities more, just below and just above first yield."""
    at = yield_velocity(source.law)
    knots = [] if at is None else [at * (1 - ASIDE), at * (1 + ASIDE)]
    left = np.array([v for v in knots if span[0] < v < span[1]])
    for block in blocks:
        here = left[left <= block[-1]]
        left = left[len(here) :]
        yield np.union1d(block, here)


class TableWriter(Writer):
    """v [m/s] ascending, ε, and of laws with a force `COLUMNS`; blanks between, comments behind #.

    Rows of which a fit knows nothing are left out, and the header says so.
    """

    def __init__(self, path: Path, source: Source, route: Route = None):
        super().__init__(path)
        self._exact = in_one_size(evaluator(source, route))
        has_force = not isinstance(source.law, sj.HardSphereLaw)
        self._impacts = in_one_size(lambda v: impacts(source.law, v, route)) if has_force else None
        self._last: tuple[float, float] | None = None
        self._error = 0.0
        self._source, self._first = source, float("nan")
        self._file.write("".join(_head(source)).encode())
        self._place = self._file.tell()
        names = ["velocity[m/s]", "restitution", *COLUMNS[: len(COLUMNS) * has_force]]
        self._file.write(self._later() + f"# {' '.join(names)}\n".encode())

    def write(self, rows: Rows, text: bytes | None = None) -> None:
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
        error = ERROR.format(1.05 * self._error).encode()  # rounded up
        if self._source.result is None:
            return error
        last = self._first if self._last is None else self._last[0]
        told = self._source.extrapolation((self._first, last))
        room = len(self._source.extrapolation_text(WIDEST).encode())
        return b"# " + (told or NOT_BEYOND).encode().ljust(room) + b"\n" + error

    def _between(self, velocity: np.ndarray, coefficient: np.ndarray) -> float:
        """How far interpolation between neighbours is from the curve, the step at yield left out."""
        wide = np.flatnonzero(np.diff(velocity) > 1e3 * ASIDE * velocity[1:])
        if not len(wide):
            return 0.0
        share = INSIDE[:, None]
        inner, told = (
            np.ravel((1 - share) * ends[wide] + share * ends[wide + 1])
            for ends in (velocity, coefficient)
        )
        apart = self._exact(inner).coefficient - told
        return float(np.nanmax(np.abs(apart), initial=0.0))


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
