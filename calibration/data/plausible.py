"""Signs of mistakes in accepted measurements: units, columns, unlabelled groups."""

from collections.abc import Iterator

import numpy as np

from calibration.data.checks import Column
from calibration.data.measurements import RestitutionData
from calibration.data.names import SI_UNITS
from calibration.data.points import FALLEN, FALLS
from calibration.data.ranges import Implausible, of_bodies

FASTEST = 5000.0  # m/s
LOWEST_RESTITUTION = 0.02  # all of them below this: a percentage taken of a fraction
SURE = 4.0  # standard errors by which a median lies above 1
FEWEST = 8  # points in which an order may show
SHORTEST = 3  # points of a run
FAR_FROM_HERTZ = 30.0  # times what an elastic impact of the bodies shows
EXAMPLES = {"contact_time": "us", "peak_force": "N", "peak_overlap": "um", "dent_diameter": "mm"}


def plausibility(data: RestitutionData) -> tuple[Implausible, ...]:
    """Likely mistakes in data, each with a question; empty if there are none."""
    with np.errstate(all="ignore"):
        found: list[Implausible | None] = [
            *of_bodies(data.bodies, data.contact),
            _yield_beyond_limit(data),
            _too_fast(data),
            _too_deep(data),
            _no_wall(data),
            _divided(data),
            _above_one(data),
            _runs(data),
            *_far_from_hertz(data),
        ]
    return tuple(dict.fromkeys(doubt for doubt in found if doubt is not None))


def _yield_beyond_limit(data: RestitutionData) -> Implausible | None:
    if data.contact is None:
        return None
    critical = np.asarray(data.contact.critical_velocity, float)
    limit = np.asarray(data.limit_velocity, float)
    if not np.any(critical > limit):
        return None
    cause = f"first yield at {np.max(critical):.3g} m/s is beyond v_lim = {np.min(limit):.3g} m/s"
    advice = (
        "Are the yield strength and Young's modulus in the same unit? "
        "What does not yield has other laws: `--law viscoelastic` for rubber."
    )
    return Implausible("yield-beyond-limit", cause, advice)


def _too_fast(data: RestitutionData) -> Implausible | None:
    fastest = float(np.max(data.velocity))
    if fastest <= FASTEST:
        return None
    cause = f"the largest velocity is {fastest:.3g} m/s"
    return Implausible(
        "velocity", cause, "Which unit has it? The header says it: `velocity [mm/s]`"
    )


def _too_deep(data: RestitutionData) -> Implausible | None:
    """Free falls from higher than anybody drops a ball."""
    cause = next((note for note in data.remarks if note.startswith(FALLS)), None)
    if cause is None:
        return None
    advice = "Which unit is it? The header says it: `drop_height [mm]`, `interval [ms]`"
    return Implausible("height", cause, advice)


def _no_wall(data: RestitutionData) -> Implausible | None:
    """Balls that fell on a ball: on what else than a wall balls mostly fall."""
    spheres = [body for body in data.bodies if body.radius is not None]
    if FALLEN not in data.remarks or len(spheres) < 2:
        return None
    cause = "the dropped balls met a sphere like them, as no wall is given"
    return Implausible(
        "no-wall", cause, "If it was a wall, `[material.wall]` gives its properties."
    )


def _divided(data: RestitutionData) -> Implausible | None:
    largest = float(np.nanmax(data.restitution, initial=-1.0))
    if largest < 0 or largest >= LOWEST_RESTITUTION:
        return None
    cause = f"all restitutions are below {LOWEST_RESTITUTION}, {largest:.3g} at most"
    return Implausible("percent", cause, "Are they fractions whose unit says percent?")


def _above_one(data: RestitutionData) -> Implausible | None:
    """A median above 1 by more than its standard error explains: not noise, but a mistake in all rows."""
    seen = np.isfinite(data.restitution)
    n, excess = int(np.sum(seen)), float(np.median(data.restitution[seen])) - 1
    if n < FEWEST or excess <= 0:
        return None
    order = np.flatnonzero(seen)[np.argsort(data.velocity[seen], kind="stable")]
    error = np.sqrt(np.pi / 2 / n) * scatter_of(data.velocity[order], data.restitution[order])
    if data.uncertainty is not None:
        error = max(error, np.sqrt(np.pi / 2 / n) * float(np.median(data.uncertainty[seen])))
    if excess <= SURE * error:
        return None
    cause = f"half of the restitutions are above {1 + excess:.4g}, which noise would not do"
    advice = "Are impact and rebound exchanged, or is a scale off?"
    return Implausible("above-one", cause, advice)


def _far_from_hertz(data: RestitutionData) -> Iterator[Implausible]:
    """Compare observables with an elastic impact of the bodies.

    δ_max = (5 M v²/4k)^(2/5), F = k δ^(3/2), t = 2.9432 δ/v, a² = A δ (Johnson, Contact Mechanics, 1985).
    """
    if data.contact is None:
        return
    one = data.contact
    stiffness, mass = np.asarray(one.stiffness), np.asarray(one.mass)
    overlap = (1.25 * mass * data.velocity**2 / stiffness) ** 0.4
    elastic = {
        "contact_time": 2.9432 * overlap / data.velocity,
        "peak_force": stiffness * overlap**1.5,
        "peak_overlap": overlap,
        "dent_diameter": 2 * np.sqrt(one.area_factor * np.asarray(one.radius) * overlap),
    }
    for name, expected in elastic.items():
        values = getattr(data, name)
        if values is None or not np.any(np.isfinite(values)):
            continue
        ratio = float(np.nanmedian(values / expected))
        if not 1 / FAR_FROM_HERTZ < ratio < FAR_FROM_HERTZ:
            value, unit = float(np.nanmedian(values)), SI_UNITS[name]
            cause = (
                f"{name} is {value:.3g} {unit} at the median, {ratio:.2g} times an elastic impact's"
            )
            advice = f"Which unit has it? The header says it: `{name} [{EXAMPLES[name]}]`"
            yield Implausible(name.replace("_", "-"), cause, advice)


def _runs(data: RestitutionData) -> Implausible | None:
    """Velocities that go all through their range several times over, and no `group`."""
    sized = data.contact is not None and any(map(np.ndim, data.contact.leaves().values()))
    if sized or data.group is not None or data.errors.shares or len(data) < FEWEST:
        return None
    for sign, word in ((1, "ascend"), (-1, "descend")):
        velocity = sign * data.velocity
        starts = np.concatenate([[0], np.flatnonzero(np.diff(velocity) < 0) + 1, [len(data)]])
        if (
            len(starts) > 2
            and np.min(np.diff(starts)) >= SHORTEST
            and np.all(_spans(velocity, starts))
        ):
            cause = f"velocities {word} {len(starts) - 1} times over, as if of so many specimens or launches"
            return Implausible("groups", cause, "Add a column `group` if rows belong together.")
    return None


def _spans(velocity, starts) -> np.ndarray:
    """Whether each run rises within itself: repeats at one velocity are no run."""
    return velocity[starts[1:] - 1] > velocity[starts[:-1]]


def scatter_of(velocity: Column, restitution: Column) -> float:
    """Robust standard deviation of ε about a smooth curve, of points in the order of velocity.

    1.4826 times the median of |ε_i - line through its two neighbours|, each scaled to the
    variance of one point (Gasser, Sroka and Jennen-Steinmetz, Biometrika 73, 625, 1986).
    """
    gap = velocity[2:] - velocity[:-2]
    left = np.where(gap > 0, (velocity[2:] - velocity[1:-1]) / np.where(gap > 0, gap, 1.0), 0.5)
    line = left * restitution[:-2] + (1 - left) * restitution[2:]
    scale = np.sqrt(1 + left**2 + (1 - left) ** 2)
    return 1.4826 * float(np.median(np.abs(restitution[1:-1] - line) / scale))
