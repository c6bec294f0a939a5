"""Look-up tables for particle codes: ε and what happens in a collision, over ascending velocities.

Between two rows a code interpolates linearly. So the table has two rows at first yield, where ε jumps,
and two where ε comes to 0, and its header says how far that leaves it from the law.
"""

import math
from collections.abc import Callable, Iterator

import numpy as np

import softjax as sj
from calibration.curves import Route, Rows, Source, Velocities, curve_of, text_rows
from calibration.errors import InputError, printable
from calibration.fitting.curves import yield_velocity

COLUMNS = {
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

Exact = Callable[[Velocities], Velocities]


def with_knots(source: Source, velocity: Velocities, route: Route = None) -> Velocities:
    """Ascending velocities with two more at first yield, and two at each end of ε."""
    at = yield_velocity(source.law)
    if at is not None and velocity[0] < at < velocity[-1]:
        velocity = np.union1d(velocity, [at * (1 - ASIDE), at * (1 + ASIDE)])
    return np.union1d(velocity, _ends(_restitution(source, route), velocity))


def table_text(source: Source, rows: Rows, route: Route = None) -> str:
    """v [m/s] ascending, ε, and of laws with a force `COLUMNS`; separated by blanks, comments after #.

    Rows whose ε a fit does not determine are left out, and the header says so.

    Raises:
        InputError: where the velocities do not ascend.
    """
    rows = rows.some(rows.known)
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

    Where the law bends or jumps between two rows the largest difference lies anywhere: it is
    enclosed where the comparison finds the largest ones.
    """
    wide = np.flatnonzero(np.diff(velocity) > 1e3 * ASIDE * velocity[1:])
    if not len(wide):
        return 0.0

    def apart(share, rows):
        inner, linear = (
            (1 - share) * ends[rows] + share * ends[rows + 1] for ends in (velocity, coefficient)
        )
        return np.nan_to_num(np.abs(exact(np.ravel(inner)).reshape(inner.shape) - linear))

    found = apart(INSIDE, wide)
    rows = np.argsort(np.max(found, axis=0))[-INTERVALS:]
    centre, reach = INSIDE[np.argmax(found[:, rows], axis=0), 0], 1 / 8
    largest = float(np.max(found))
    for _ in range(TIMES):
        share = np.clip(centre + reach * CLOSER, 0, 1)
        found = apart(share, wide[rows])
        centre = np.take_along_axis(share, np.argmax(found, axis=0)[None], axis=0)[0]
        largest, reach = max(largest, float(np.max(found))), reach / 4
    return largest


def _promise(error: float) -> str:
    """The error with a hundredth to spare, rounded up to two digits."""
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
        if len(velocity):
            yield source.extrapolation(velocity) or "all rows lie between the fit's data"
