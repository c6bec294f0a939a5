"""Kinds of measurement: how the readings of an impact become its velocity and restitution.

A reading x₁ before the impact and x₂ after it give the speeds a(x₁) of arrival and b(x₂) of departure,

    v = a(x₁),    ε = b(x₂)/v,    ∂ε/∂x₁ = -ε a'/v,    ∂ε/∂x₂ = b'/v,    ∂v/∂x₁ = a'

(GUM, 5.1.3). In vacuum

    two velocities        a = x₁,          b = x₂
    heights               a = √(2 g x₁),   b = √(2 g x₂)
    intervals or times    a = g x₁/2,      b = g x₂/2       of flights that last x

and in air those of `calibration.data.air`. Bounces follow each other, so that a reading enters the impact
before it and that after it. Example: drops from 0.5 m that rebound to 0.32 m arrive with
√(2 · 9.80665 · 0.5) = 3.13 m/s and have ε = √0.64 = 0.8.

A further kind is an object in `KINDS`, of a class below or one of its own.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from jaxtyping import Float

from calibration.data.checks import Column
from calibration.errors import DataError, listed

TOUCHED = 3  # readings that one point has at most: the times of three bounces
Slopes = Float[np.ndarray, "n 3"]
OF_VELOCITIES = ("impact_velocity", "rebound_velocity")
OF_HEIGHTS = ("drop_height", "rebound_height")
FRAMES = 3  # intervals that are equal by chance no more
EVEN = 1e-3  # of an interval, by which frames of a camera differ
SEPARATES = "(a launch column separates launches)"


def three(*columns: Column) -> Slopes:
    """Columns of n as (n, 3), zeros where there are fewer."""
    none = np.zeros(len(columns[0]))
    return np.stack([*columns, *[none] * (TOUCHED - len(columns))], axis=1)


class Impacts(NamedTuple):
    """n impacts from readings before and after, and their derivatives.

    Attributes:
        velocity, restitution: v [m/s] and ε, (n,).
        by_first, by_second: ∂ε/∂x₁ and ∂ε/∂x₂ [1/unit of x].
        faster: ∂v/∂x₁ [m/s/unit of x].
        by_drag: (n, 2), ∂ε/∂c and ∂v/∂c [m/s] with drag coefficients of (1 + c) C_d; None in vacuum.
    """

    velocity: Column
    restitution: Column
    by_first: Column
    by_second: Column
    faster: Column
    by_drag: Float[np.ndarray, "n 2"] | None


class Limits(NamedTuple):
    """Accepted readings before and after an impact, and by which factor the second may be larger."""

    names: tuple[str, str]
    first: str
    second: str
    largest: float  # beyond it the two are exchanged, or not in one unit


@dataclass(frozen=True)
class Kind:
    """v and ε as they are, where errors are those of each; base of the other kinds.

    Attributes:
        name: of the readings, in messages and files; "" where ε and v themselves are stated.
        needs: the columns that make an impact.
        formula: ε and v in words, for the reference.
        uncertainties: columns of the standard uncertainties of readings; the last is of all of them.
    """

    name: str = ""
    needs: tuple[str, ...] = ("velocity", "restitution")
    formula: str = "as they are"
    uncertainties: tuple[str, ...] = ()

    is_sequence: ClassVar = False  # rows are bounces that follow each other
    is_numbered: ClassVar = False  # a column counts the bounces
    is_flight: ClassVar = False  # velocities are those of free flights, in air
    has_velocity: ClassVar = False  # v is itself a reading
    has_signs: ClassVar = False  # readings before and after are of opposite directions
    is_precise: ClassVar = False  # bodies differ by more than the readings do: scatter is estimated
    is_timed: ClassVar = False  # readings have the contact in them
    limits: ClassVar[Limits]  # of a reading before and one after
    fallen: ClassVar = ""  # what velocities of flights follow from
    power: ClassVar = 1.0  # of the first reading that the speed goes with, in vacuum
    # of bounces that follow each other:
    span: ClassVar = 0  # rows from the first to the last that a bounce needs
    has_no_zero: ClassVar = False  # an uncertainty in percent means nothing
    accepted: ClassVar = ""  # what a reading must be
    follows: ClassVar = ""  # what a reading after another must be
    reading: ClassVar = ("times", "s")  # what is read, and its SI unit
    too_short: ClassVar = ""  # a launch that gives no restitution

    @property
    def named(self) -> str:
        """The columns, as a refusal names them."""
        return " with ".join(self.needs) + " (with launch)" * self.is_sequence

    @property
    def has_restitution(self) -> bool:
        """Whether ε is measured."""
        return self.is_sequence or len(self.needs) > 1

    @property
    def has_readings(self) -> bool:
        """Whether ε and v follow from readings, whose errors they share."""
        return bool(self.name)

    def impacts(
        self, first: Column, second: Column, floor: Column, gravity: float, air: Any
    ) -> Impacts:
        """Impacts from readings in SI; `floor`: x₂ where the slope in it is taken."""
        raise DataError("kind of measurement", self.name or "none", "one with readings")

    def in_vacuum(self, reading: Column, gravity: float) -> Column:
        """Speed at the beginning and at the end of a flight [m/s]; the reading itself where it is one."""
        return reading

    def flights(self, readings: Column) -> Column:
        """Readings of the flights between bounces that follow each other."""
        return readings

    def refused(self, readings: Column, follows: np.ndarray) -> tuple[int, str] | None:
        """The first row of a sequence that no flight can be, and what is accepted; None if all are right.

        `follows`: whether each row is of the same launch as the one above it.
        """
        bad = np.flatnonzero(~(np.isfinite(readings) & (readings > 0)))
        return (int(bad[0]), self.accepted) if bad.size else None

    def difference(self, sizes: Column) -> Column:
        """Standard error of the difference of a flight's reading and that of the next, (m,), of (n,) readings."""
        return np.hypot(sizes[:-1], sizes[1:])

    def shared(self, impacts: Impacts) -> tuple[Slopes, Slopes]:
        """∂ε and ∂v, (n, 3), by the readings of each point, in the order of its rows."""
        return three(impacts.by_first, impacts.by_second), three(impacts.faster)

    def gravity(self, velocity: Column, to_velocity: Slopes) -> float | None:
        """g [m/s²] that velocities followed from; None where they did not."""
        return None

    def readings(self, velocity: Column, restitution: Column, gravity: Any) -> dict[str, Any]:
        """Readings of planned impacts in vacuum, as columns of a table; none where v and ε are stated."""
        return {}

    def planned(
        self, sizes: Column, index: Any, like: Any, was: Mapping[str, Any], now: Mapping[str, Any]
    ) -> dict[str, Any]:
        """Uncertainties of planned readings `now`, like those of the readings `was`.

        Args:
            sizes, index: standard uncertainties of readings, (m,), and which of them each point has, (n, 3).
            like: function from sizes, readings and planned readings to planned sizes.
        """
        return {
            f"{name}_uncertainty": like(sizes[index[:, k]], was[name], now[name])
            for k, name in enumerate(now)
        }


class Velocities(Kind):
    """The velocities before and after."""

    has_velocity = has_signs = True
    limits = Limits(OF_VELOCITIES, "a positive speed in m/s", "a speed of 0 m/s or more", 1.25)

    def impacts(self, first, second, floor, gravity, air) -> Impacts:
        epsilon, one = second / first, np.ones(len(first))
        return Impacts(first, epsilon, -epsilon / first, 1 / first, one, None)

    def readings(self, velocity, restitution, gravity) -> dict[str, Any]:
        return dict(zip(self.needs, (velocity, restitution * velocity), strict=True))


class InFlight(Kind):
    """A reading of the flight before the impact, and of that after it."""

    is_flight = True
    arrival: ClassVar = ""  # the functions of `calibration.data.air.Air`
    departure: ClassVar = ""

    def in_vacuum(self, reading: Column, gravity: float) -> Column:
        """Speed at the beginning and at the end of a flight [m/s]."""
        raise NotImplementedError

    def impacts(self, first, second, floor, gravity, air) -> Impacts:
        power, velocity = self.power, self.in_vacuum(first, gravity)
        if air is None:
            epsilon = (second / first) ** power
            above = np.where(floor > 0, floor, np.inf)
            by_second = power / first * (above / first) ** (power - 1)
            by_first = -power * epsilon / first
            return Impacts(velocity, epsilon, by_first, by_second, power * velocity / first, None)
        velocity = getattr(air, self.arrival)(first)
        epsilon = getattr(air, self.departure)(second) / velocity
        faster, slower = air.slope(self.arrival, first), air.by_drag(self.arrival, first)
        by_first, by_second = (
            -epsilon * faster / velocity,
            air.slope(self.departure, floor) / velocity,
        )
        of_second = air.by_drag(self.departure, second) - epsilon * slower
        by_drag = np.stack([of_second / velocity, slower], axis=1)
        return Impacts(velocity, epsilon, by_first, by_second, faster, by_drag)


class OfHeights(InFlight):
    """The height that a ball falls from, and that it rises to."""

    arrival, departure, power = "fall", "rise", 0.5
    fallen = "drop heights"

    def in_vacuum(self, reading, gravity) -> Column:
        return np.sqrt(2 * gravity * reading)

    def gravity(self, velocity, to_velocity) -> float:
        return float(np.median(velocity * to_velocity[:, 0]))  # v ∂v/∂h = g


class Heights(OfHeights):
    """A drop height and the height of the rebound."""

    limits = Limits(OF_HEIGHTS, "a positive height in m", "a height of 0 m or more", 1.25**2)

    def readings(self, velocity, restitution, gravity) -> dict[str, Any]:
        drop = velocity**2 / (2 * gravity)
        return dict(zip(self.needs, (drop, restitution**2 * drop), strict=False))


class OfBounces(InFlight):
    """Readings of bounces that follow each other: those of one launch are adjacent rows."""

    is_sequence = True
    span = 1

    def planned(self, sizes, index, like, was, now) -> dict[str, Any]:
        rows = len(now[self.needs[0]])
        return {self.uncertainties[-1]: np.full(rows, np.median(sizes))}


class Peaks(OfHeights, OfBounces):
    """The heights from which a ball falls and to which it rises, one after the other."""

    is_numbered = True
    reading = ("heights", "m")
    named = "bounce with height (with launch)"
    accepted = "a positive height in m: no gap within a launch"
    follows = f"lower than the one above {SEPARATES}"
    too_short = "a single height"

    def readings(self, velocity, restitution, gravity) -> dict[str, Any]:
        drop = velocity**2 / (2 * gravity)
        table = launches(self.needs[0], drop, restitution**2 * drop)
        return table | {"bounce": np.tile([0, 1], len(drop))}


class OfTimes(OfBounces):
    """Times of flights."""

    is_timed = True
    arrival, departure = "landing", "take_off"
    fallen = "times of flight"

    def in_vacuum(self, reading, gravity) -> Column:
        return gravity * reading / 2

    def gravity(self, velocity, to_velocity) -> float:
        return 2 * float(np.median(np.max(to_velocity, axis=1)))  # ∂v/∂t = g/2


class Intervals(OfTimes):
    """Times from each bounce to the next."""

    accepted = "a positive time in s: no gap within a launch"
    follows = f"shorter than the one above {SEPARATES}"
    too_short = "a single interval"

    def readings(self, velocity, restitution, gravity) -> dict[str, Any]:
        first = 2 * velocity / gravity
        return launches(self.needs[0], first, restitution * first)


class Times(OfTimes):
    """Times of the bounces themselves, whose differences are the intervals."""

    span = 2
    has_no_zero = True
    accepted = "a time in s: no gap within a launch"
    follows = f"sooner {SEPARATES}"
    too_short = "fewer than three bounces"

    def flights(self, readings: Column) -> Column:
        return np.diff(readings)

    def difference(self, sizes: Column) -> Column:
        return np.sqrt(sizes[:-2] ** 2 + 4 * sizes[1:-1] ** 2 + sizes[2:] ** 2)

    def refused(self, readings, follows) -> tuple[int, str] | None:
        bad = np.flatnonzero(~np.isfinite(readings))
        if bad.size:
            return int(bad[0]), self.accepted
        if are_frames(readings):
            accepted = "those of bounces: these are equally spaced, as frames of a track are"
            return 1, f"{accepted}; a track has a column height, position, y or z too"
        back = 1 + np.flatnonzero((np.diff(readings) <= 0) & follows[1:])
        return (int(back[0]), f"later than the one above it {SEPARATES}") if back.size else None

    def shared(self, impacts) -> tuple[Slopes, Slopes]:
        _, _, by_first, by_second, faster, _ = impacts
        return three(-by_first, by_first - by_second, by_second), three(-faster, faster)

    def readings(self, velocity, restitution, gravity) -> dict[str, Any]:
        first = 2 * velocity / gravity
        return launches(self.needs[0], 0 * first, first, first * (1 + restitution))


def are_frames(times: Column) -> bool:
    """Whether times are equally spaced but for rounding to their decimals; bounces come ever sooner."""
    steps = np.diff(times)
    if len(steps) < FRAMES or np.min(steps) <= 0:
        return False
    scaled = times[:, None] * 10.0 ** np.arange(8)
    is_whole = np.all(
        np.abs(scaled - np.round(scaled)) < 1e-6 * np.maximum(1, np.abs(scaled)), axis=0
    )
    digit = 10.0 ** -float(np.argmax(is_whole)) if np.any(is_whole) else 0.0
    count = np.arange(len(times))
    off = times - np.polyval(np.polyfit(count, times, 1), count)
    even = np.ptp(steps) <= max(1.01 * digit, EVEN * np.median(steps))
    return bool(even and np.max(np.abs(off)) <= max(0.55 * digit, EVEN * np.median(steps)))


class Tracks(Kind):
    """Heights of a ball in the frames of a film, of which `calibration.data.tracks` makes impacts."""

    is_flight = True
    is_precise = True
    fallen = "flights of a track"


def launches(name: str, *rows: Column) -> dict[str, Any]:
    """A table with a launch of its own for each point, whose readings are `rows`."""
    launch = np.repeat([str(k) for k in range(len(rows[0]))], len(rows))
    return {"launch": launch, name: np.transpose(rows).ravel()}


def _uncertainties(*names: str) -> tuple[str, ...]:
    return tuple(f"{name}_uncertainty" for name in names)


STATED = Kind()
VELOCITIES = Velocities(
    "velocities", OF_VELOCITIES, "v_out/v_in, v_in", _uncertainties(*OF_VELOCITIES, "velocity")
)
HEIGHTS = Heights("heights", OF_HEIGHTS, "√(h₂/h₁), √(2gh₁)", _uncertainties(*OF_HEIGHTS, "height"))
INTERVALS = Intervals(
    "intervals", ("interval",), "tₙ₊₁/tₙ, gtₙ/2", _uncertainties("interval", "timing")
)
TIMES = Times(
    "times", ("time",), "from the intervals between them", _uncertainties("time", "timing")
)
PEAKS = Peaks("peak heights", ("height",), "√(hₙ₊₁/hₙ), √(2ghₙ)", _uncertainties("height"))
TRACKS = Tracks("tracks", ("time", "height"), "where the flights of a track cross")
# of points that were averaged; no columns
REPEATS = Kind("repeats", (), "means of repeats")
# sets of columns: where several are complete the first of these is used
SETS = (VELOCITIES, HEIGHTS, STATED, INTERVALS)
# accepted where something else than ε was measured
WITHOUT_RESTITUTION = (
    Kind("", ("velocity",), "ε not measured, v"),
    Heights(
        "heights",
        OF_HEIGHTS[:1],
        "ε not measured, √(2gh₁)",
        _uncertainties("drop_height", "height"),
    ),
)
KINDS = {
    kind.name: kind
    for kind in (STATED, VELOCITIES, HEIGHTS, INTERVALS, TIMES, PEAKS, TRACKS, REPEATS)
}


def kind_named(name: str) -> Kind:
    """The kind of readings by its name; raises DataError for an unknown one."""
    if name not in KINDS:
        raise DataError("kind", repr(name), f"one of {listed(repr(known) for known in KINDS)}")
    return KINDS[name]
