"""Tracks z(t) of bouncing balls, by camera or motion detector, as impacts.

1. The noise of a frame is that of third differences, and flights without a known pull are found
   (`calibration.data.flights`).
2. Their common acceleration a, weighted by how far each moves, is compared with g' before all else: lengths are off by
   a/g', or times by √(g'/a). Frames that fall more slowly are held, at rest or rolling, and are left out.
3. Flights are found again with the pull known, so that those of five frames count, and fitted in z and v, with drag,
   and with one pull for all where they determine it to 2 % (of pixels always, which g'/a makes metres).
4. An impact is where a flight down and the next one up cross (`calibration.data.crossings`), on the floor of the
   others. Frames of the contact, and half an exposure about it, are left out.

Where the pull is fitted, ε depends on neither scale nor frame rate: both ratios, of lengths and of times, cancel.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from calibration.data.air import Air
from calibration.data.contact_time import ContactTime
from calibration.data.crossings import (
    FEWEST_FOR_CONTACT,
    Contact,
    Crossing,
    Errors,
    Impacts,
    contact_of,
    crossing_of,
    moves_of,
    root_of,
    with_contact,
)
from calibration.data.flights import (
    FEWEST,
    FEWEST_FRAMES,
    Column,
    Flight,
    Rows,
    Track,
    common_pull,
    fitted,
    flights_in,
    free_acceleration,
    joined,
    noise_of,
)
from calibration.errors import DataError, listed

MOVES = 20.0  # times the noise: pieces that move less are no flights
CERTAIN = 0.05  # relative standard error of an acceleration that is compared with g
CERTAIN_OF_PIXELS = 0.15  # where nothing else gives the scale
FITTED = 0.02  # of the common pull, from which on it is fitted
OFF = 0.02  # relative difference from g that is refused, where it is
SURE = 3.0  # standard errors or more
GROSSLY_OFF = 0.1  # the same of single flights, without drag, and with frames of contacts
GROSSLY_SURE = 4.0
SLOWER = 0.7  # of g: what falls with less, surely, does not fly
ALIKE = 0.3  # correlation of neighbouring residuals: smoothed, or distorted
NEAR_FLOOR = 0.05  # of the range of heights: crossings further from the others are on another floor
LONG_GAP = 8  # frames between two flights, and
GAP_SHARE = 0.25  # of the shorter one, are too many for an impact to be seen
FEWEST_SHARE = 0.25  # of the frames between two impacts that are to be on the flight
REPEATED = 0.8  # of every second step that are 0, where the others are not: frames are shown twice
ROUNDS = 3  # of contacts, and the frames within
DRAG_STEP = 0.01  # of the drag coefficient, in differences
NO_DRAG = (
    "not corrected for air: the ball's diameter, and its mass or density, are not given; ε is too low, a metre of "
    "height by 0.004 for steel or a golf ball, 0.02 for a tennis ball, 0.05 for table tennis (air = false says that "
    "no correction is needed)"
)


class Setting(NamedTuple):
    """Known settings of a track.

    Attributes:
        gravity: g [m/s²].
        air: the ball in its air; None: no correction.
        exposure: of a frame [s].
        contact: what is known of the contact's duration; None: nothing.
        down: whether heights are downwards; None: as the flights show.
        in_pixels: whether g gives the scale.
    """

    gravity: float
    air: Air | None = None
    exposure: float = 0.0
    contact: ContactTime | None = None
    down: bool | None = None
    in_pixels: bool = False

    @property
    def pull(self) -> float:
        """g' [m/s²]: less than g by buoyancy, and by the air that moves along."""
        return self.gravity if self.air is None else self.air.flight(1.0)[0]


@dataclass(frozen=True, eq=False)
class BounceTrack:
    """m impacts of one track.

    Attributes:
        track: its frames, heights upwards in the unit of the file.
        flights, crossings: as fitted.
        velocity, restitution: v [m/s] and ε.
        root: (2m, 2m), a factor of the covariance of (ε, v).
        by_drag: (m, 2), ∂ε/∂c and ∂v/∂c [m/s] of a drag coefficient of (1 + c) C_d; None without air.
        noise: standard deviation of a frame, in the unit of the file.
        degrees: degrees of freedom behind it.
        gravity, gravity_error: of all flights [m/s²], of metres; NaN where they do not tell, or give the scale.
        metre: metres in a unit of the file.
        contact_time: t_c [s] of each impact.
        without: from when to when [s] frames are not used, and why.
        remarks: sentences for the reader.
        smoothed: why the errors are too small, or "".
        name: of the run and the object.
        seen: which of the given frames those of `track` are.
    """

    track: Track
    flights: tuple[Flight, ...]
    crossings: tuple[Crossing, ...]
    velocity: Column
    restitution: Column
    root: Float[np.ndarray, "k k"]
    by_drag: Float[np.ndarray, "m 2"] | None
    noise: float
    degrees: int
    gravity: float
    gravity_error: float
    metre: float
    contact_time: Column
    without: tuple[tuple[float, float, str], ...]
    remarks: tuple[str, ...]
    smoothed: str = ""
    name: str = "track"
    seen: Rows = None  # type: ignore[assignment]  # filled in

    def __len__(self) -> int:
        return len(self.crossings)

    @property
    def frames(self) -> Rows:
        """The given frame next to each impact."""
        times = [crossing.time for crossing in self.crossings]
        return self.seen[np.searchsorted(self.track.time, times)]

    @property
    def uncertainty(self) -> Column:
        """Standard uncertainty of each ε."""
        return np.linalg.norm(self.root[: len(self)], axis=1)

    @property
    def velocity_uncertainty(self) -> Column:
        """Standard uncertainty of each v [m/s]."""
        return np.linalg.norm(self.root[len(self) :], axis=1)


def read_track(time: Any, height: Any, setting: Setting) -> BounceTrack:
    """The impacts of a track; frames without a height (NaN) are none.

    Args:
        time: of each frame [s].
        height: in metres, or pixels.

    Raises:
        DataError: with the row to blame, or of the whole track.
    """
    track, seen = _checked(np.asarray(time, float), np.asarray(height, float), bool(setting.down))
    reading = _Reading(track, noise_of(track), setting)
    reading.find()
    reading.settle()
    return replace(reading.impacts(), seen=seen)


def _checked(time: Column, height: Column, down: bool) -> tuple[Track, Rows]:
    """The frames that show the ball, and which they are."""
    seen = np.flatnonzero(np.isfinite(time) & np.isfinite(height))
    if len(seen) < FEWEST_FRAMES:
        accepted = f"of {FEWEST_FRAMES} frames or more, on two flights: an impact needs one before and one after"
        raise DataError("track", f"of {len(seen)} frames", accepted)
    time, height = time[seen], height[seen] * (-1 if down else 1)
    for row in np.flatnonzero(np.diff(time) <= 0)[:1] + 1:
        accepted = "later than that of the frame above"
        raise DataError("time", float(time[row]), accepted, int(seen[row]))
    shown_again = sorted(float(np.mean(np.diff(height)[k::2] == 0)) for k in (0, 1))
    if shown_again[1] > REPEATED and shown_again[0] < 1 - REPEATED:
        accepted = "exported at the camera's own rate"
        raise DataError("track", "one in which every second frame repeats the last", accepted)
    if np.ptp(height) == 0:
        raise DataError("track", "of one height", "of a ball that moves")
    return Track(time, height), seen


class _Reading:
    """One track on the way to its impacts."""

    def __init__(self, track: Track, noise: float, setting: Setting):
        self.track, self.noise, self.setting = track, noise, setting
        self.pull = setting.pull  # in the unit of the file
        self.fits_pull = setting.in_pixels
        self.is_checked = True
        self.without: list[tuple[float, float, str]] = []
        self.remarks: list[str] = []
        self.rows: list[Rows] = []

    # ------------------------------------------------------------------ flights

    def find(self) -> None:
        """Frames of the flights, and the pull that they agree on."""
        pieces = flights_in(self.track, self.noise, np.ones(len(self.track.time), bool))
        falls = [free_acceleration(self.track, rows, self.noise) for rows in pieces]
        self._compare(falls)
        if self.pull < 0:
            falls = [(-pull, error, way) for pull, error, way in falls]
            self.pull, self.track = -self.pull, self.track._replace(height=-self.track.height)
            self.remarks.append("heights are read downwards, as the flights fall that way")
        usable = np.ones(len(self.track.time), bool)
        for rows, (pull, error, _) in zip(pieces, falls, strict=True):
            is_slower = self.pull - pull > 5 * error + 0.15 * self.pull
            if is_slower and pull < SLOWER * self.pull and error < 0.25 * self.pull:
                usable[rows] = False
                self._leave_out(rows, "held, at rest or rolling")
        drag = self._drag(self._typical())
        found = flights_in(self.track, self.noise, usable, self.pull, drag)
        for rows in found:
            flight = fitted(self.track, rows, self.pull, drag)
            if np.ptp(flight.state(self.track.time[rows])[0]) > MOVES * self.noise:
                self.rows.append(rows)
            else:
                self._leave_out(rows, f"moves less than {MOVES:g} times the noise")
        if len(self.rows) < 2:
            raise self._no_flights()

    def _compare(self, falls: Sequence[tuple[float, float, float]]) -> None:
        """Take the flights' own acceleration, or refuse it; g where too few frames tell."""
        setting, expected = self.setting, self.setting.pull
        moving = [fall for fall in falls if fall[2] > MOVES * self.noise]
        limit = CERTAIN_OF_PIXELS if setting.in_pixels else CERTAIN
        sure = [fall for fall in moving if fall[1] < limit * abs(fall[0])]
        # contacts, and single fast impacts, have accelerations of their own
        too_few = sum(way for *_, way in sure) <= 0.5 * sum(way for *_, way in moving)
        if too_few or (setting.in_pixels and len(sure) < 2):
            if setting.in_pixels:
                accepted = "one with flights long enough for g to give the scale, or with `scale`"
                raise DataError("track in pixels", "of too short flights", accepted)
            self.is_checked = False
            self.remarks.append(
                "scale and frame rate are not checked: the flights are too short for g to show"
            )
            return
        pull, errors, way = np.array(sorted(sure)).T
        common = float(pull[np.searchsorted(np.cumsum(way), 0.5 * np.sum(way))])
        error = float(np.median(errors))
        if common < 0 and setting.down is not None:
            value, way = ("true", "upwards") if setting.down else ("false", "downwards")
            raise DataError(
                "down", value, f"{'false' if setting.down else 'true'}: heights are {way}"
            )
        off = abs(abs(common) - expected)
        if not setting.in_pixels and off > max(GROSSLY_OFF * expected, GROSSLY_SURE * error):
            raise self._wrong_scale(abs(common))
        is_g = off < SURE * error and not setting.in_pixels
        self.pull = float(np.copysign(expected if is_g else common, common))

    def _wrong_scale(self, pull: float, error: float = 0.0) -> DataError:
        """The refusal of flights that fall with another acceleration."""
        ratio, rate = pull / self.setting.pull, 1 / self.track.step
        slow = ratio**-0.5
        value = f"{pull:.4g}" + (f" ± {error:.2g}" * (error > 0)) + " m/s²"
        accepted = (
            f"g = {self.setting.gravity:.4g} m/s²: either lengths are too {_factor(ratio)} (`scale` states the "
            f"metres in a unit), or times are too {_factor(slow)} (frame_rate = {rate * slow:.4g}, not {rate:.4g})"
        )
        if self.setting.air is None and ratio < 1:
            accepted += (
                "; or drag slows the ball, which its diameter, and mass or density, correct for"
            )
        return DataError("acceleration of the flights", value, accepted)

    def _no_flights(self) -> DataError:
        count = "one flight" if self.rows else "no flight"
        value = f"of {count} ({FEWEST} frames or more that move {MOVES:g} times their noise)"
        accepted = "of two or more: an impact needs one before and one after"
        return DataError("track", f"{value}{self._left_out()}", accepted)

    def _leave_out(self, rows: Rows, why: str) -> None:
        first, last = self.track.time[rows[[0, -1]]]
        self.without.append((float(first), float(last), why))

    def _left_out(self) -> str:
        """The times that are not used, in brackets."""
        return f"; not used: {listed(_spans(self.without))}" if self.without else ""

    # ------------------------------------------------------------------ fits

    @property
    def metre(self) -> float:
        """Metres in a unit of the file."""
        return self.setting.pull / self.pull if self.setting.in_pixels else 1.0

    def _typical(self) -> float:
        """The speed [m/s] of a fall over the range of heights."""
        return float(np.sqrt(2 * self.pull * np.ptp(self.track.height))) * self.metre

    def _drag(self, fastest: float, factor: float = 1.0) -> float:
        """k, in the unit of the file, of a flight by its largest speed [m/s]."""
        air = self.setting.air
        if air is None or factor == 0:
            return 0.0
        return replace(air, drag=factor * air.drag).flight(fastest)[1] * self.metre

    def _flights(self, factor: float = 1.0) -> list[Flight]:
        """Fits of all flights, each with the drag of its speed, with the pull of all where it is fitted."""
        drags = []
        for rows in self.rows:
            speeds = fitted(self.track, rows, self.pull).state(self.track.time[rows[[0, -1]]])[1]
            drags.append(self._drag(float(np.max(np.abs(speeds))) * self.metre, factor))
        for _ in range(2 if self.fits_pull else 0):
            self.pull += common_pull(self.track, self._fitted(drags))[0]
        return self._fitted(drags)

    def _fitted(self, drags: Sequence[float]) -> list[Flight]:
        of_rows = zip(self.rows, drags, strict=True)
        return [fitted(self.track, rows, self.pull, drag) for rows, drag in of_rows]

    def _degrees(self, flights: Sequence[Flight]) -> int:
        return max(sum(len(flight.rows) - 2 for flight in flights) - self.fits_pull, 1)

    def _errors(self, flights: Sequence[Flight]) -> Errors:
        square = sum(flight.square for flight in flights) / self._degrees(flights)
        # exact tracks are exact to rounding
        deviation = max(square**0.5, 1e-3 * self.noise)
        of_pull = deviation * common_pull(self.track, list(flights))[1] if self.fits_pull else 0.0
        return Errors(deviation, of_pull, self.metre, self.setting.in_pixels)

    def settle(self) -> None:
        """Flights without the frames of contacts, and whether the pull is fitted."""
        flights = self._flights()
        of_pull = self._errors(flights).deviation * common_pull(self.track, flights)[1]
        self.fits_pull |= self.is_checked and of_pull < FITTED * self.pull
        for _ in range(ROUNDS):
            flights = self._flights()
            errors = self._errors(flights)
            crossings, _ = self._crossings(flights)
            moves = [moves_of(crossing, flights, errors) for crossing in crossings]
            contact = contact_of(crossings, moves, self.metre, self.setting.contact)
            before = sum(map(len, self.rows))
            self.rows = [
                self._free(k, rows, crossings, contact) for k, rows in enumerate(self.rows)
            ]
            drag = self._drag(self._typical())
            self.rows = joined(self.track, self.rows, errors.deviation, self.pull, drag)
            if len(self.rows) == len(flights) and sum(map(len, self.rows)) == before:
                break
        if len(self.rows) < 2:
            raise self._no_flights()

    def _free(
        self, index: int, rows: Rows, crossings: Sequence[Crossing], contact: Contact
    ) -> Rows:
        """The frames of a flight that no contact reaches."""
        time = self.track.time[rows]
        free = np.ones(len(rows), bool)
        half = 0.5 * self.setting.exposure
        if self.setting.contact is None and not np.any(contact.weights):
            half += 0.5 * self.track.step  # of an unknown contact
        for crossing in crossings:
            ratio = -crossing.after / crossing.before
            duration = float(contact.at(np.array(-crossing.before * self.metre)))
            if crossing.flight == index:
                free &= time < crossing.time - duration * ratio / (1 + ratio) - half
            elif crossing.flight == index - 1:
                free &= time > crossing.time + duration / (1 + ratio) + half
        return rows[free] if np.sum(free) >= FEWEST else rows

    # ------------------------------------------------------------------ impacts

    def _crossings(self, flights: Sequence[Flight]) -> tuple[list[Crossing], list[str]]:
        """Impacts between consecutive flights, and sentences on those that are none."""
        time, crossings, notes = self.track.time, [], []
        for k, (first, second) in enumerate(pairwise(flights)):
            begin, end = time[first.rows[-1]], time[second.rows[0]]
            shorter = min(np.ptp(time[flight.rows]) for flight in (first, second))
            crossing = crossing_of(k, first, second, 0.5 * (begin + end))
            near = 3 * self.track.step + self.setting.exposure
            if end - begin > max(LONG_GAP * self.track.step, GAP_SHARE * shorter):
                notes.append(f"no flight is seen from t = {begin:.4g} to {end:.4g} s")
            elif crossing is None or not begin - near < crossing.time < end + near:
                notes.append(f"the flights about t = {begin:.4g} s do not meet")
            elif not crossing.before < 0 < crossing.after:
                notes.append(
                    f"t = {crossing.time:.4g} s: velocity {crossing.before:+.3g} to {crossing.after:+.3g}, "
                    "no rebound from a floor"
                )
            else:
                crossings.append(crossing)
        on_floor = self._on_floor(crossings)
        for crossing in crossings:
            if crossing not in on_floor:
                notes.append(f"t = {crossing.time:.4g} s: not on the floor of the other impacts")
        return self._seen(on_floor, flights, notes), notes

    def _on_floor(self, crossings: Sequence[Crossing]) -> list[Crossing]:
        """Select crossings at the height of the others."""
        if len(crossings) < FEWEST_FOR_CONTACT:
            return list(crossings)
        heights = np.array([crossing.height for crossing in crossings])
        off = np.abs(heights - np.median(heights)) > NEAR_FLOOR * np.ptp(self.track.height)
        return [crossing for crossing, is_off in zip(crossings, off, strict=True) if not is_off]

    def _seen(self, crossings: Sequence[Crossing], flights: Sequence[Flight], notes: list[str]):
        """Select impacts whose flights have most of the frames until the impacts before and after."""
        at = {crossing.flight: crossing.time for crossing in crossings}
        seen = []
        for crossing in crossings:
            shares = [1.0]
            for k in (crossing.flight, crossing.flight + 1):
                if k - 1 in at and k in at:
                    count = np.searchsorted(self.track.time, [at[k - 1], at[k]])
                    shares.append(len(flights[k].rows) / max(int(np.diff(count)[0]), 1))
            if min(shares) < FEWEST_SHARE:
                notes.append(
                    f"t = {crossing.time:.4g} s: few frames of a flight next to it are used"
                )
            else:
                seen.append(crossing)
        return seen

    def impacts(self) -> BounceTrack:
        """The impacts of the settled flights."""
        flights = self._flights()
        errors = self._errors(flights)
        gravity = self._gravity(flights, errors)
        crossings, notes = self._crossings(flights)
        if not crossings:
            down = "; `down` where heights increase downwards" * (self.setting.down is None)
            value = f"without an impact ({listed(notes)}){self._left_out()}"
            raise DataError(
                "track", value, f"of flights down to a floor and up again from it{down}"
            )
        impacts, contact = with_contact(crossings, flights, errors, self.setting.contact)
        duration = contact.at(impacts.velocity)
        remarks = [
            *self.remarks,
            *self._of_scale(gravity),
            *self._of_contact(impacts, contact, duration),
            *self._of_air(crossings, impacts),
            *self._of_frames(notes),
        ]
        return BounceTrack(
            self.track,
            tuple(flights),
            tuple(crossings),
            impacts.velocity,
            impacts.restitution,
            root_of(impacts),
            self._by_drag(crossings, impacts),
            errors.deviation,
            self._degrees(flights),
            *gravity,
            self.metre,
            duration,
            tuple(self.without),
            tuple(remarks),
            _smoothed(flights, self._degrees(flights)),
        )

    def _by_drag(self, crossings: Sequence[Crossing], impacts: Impacts):
        """∂ε/∂c and ∂v/∂c, by the same frames with another drag."""
        if self.setting.air is None:
            return None
        more = self._with_drag(crossings, 1 + DRAG_STEP)
        change = more.restitution - impacts.restitution, more.velocity - impacts.velocity
        return np.stack(change, axis=1) / DRAG_STEP

    def _of_air(self, crossings: Sequence[Crossing], impacts: Impacts) -> tuple[str, ...]:
        """The largest correction for air."""
        air = self.setting.air
        if air is None:
            return ()
        vacuum = self._with_drag(crossings, 0.0)
        before = vacuum.velocity, vacuum.restitution
        return air.remarks(impacts.velocity, impacts.restitution, before)

    def _with_drag(self, crossings: Sequence[Crossing], factor: float) -> Impacts:
        """Read the same frames with another drag coefficient."""
        pull = self.pull
        flights = self._flights(factor)
        again = [
            crossing_of(c.flight, flights[c.flight], flights[c.flight + 1], c.time)
            for c in crossings
        ]
        errors = self._errors(flights)
        moved = [crossing for crossing in again if crossing is not None]
        self.pull = pull
        return with_contact(moved, flights, errors, self.setting.contact)[0]

    def _gravity(self, flights: list[Flight], errors: Errors) -> tuple[float, float]:
        """g of the flights, and its standard error; refused where it is another one."""
        if self.setting.in_pixels:
            return np.nan, np.nan
        correction, per_noise = common_pull(self.track, flights)
        pull, error = (
            self.pull + (0.0 if self.fits_pull else correction),
            errors.deviation * per_noise,
        )
        expected = self.setting.pull
        if error < 0.2 * expected and abs(pull - expected) > max(SURE * error, OFF * expected):
            raise self._wrong_scale(pull, error)
        if error > 0.2 * expected:
            return np.nan, np.nan
        of_g = self.setting.gravity / expected
        return of_g * pull, of_g * error

    # ------------------------------------------------------------------ remarks

    def _of_scale(self, gravity: tuple[float, float]) -> list[str]:
        if self.setting.in_pixels:
            return [
                f"1 pixel is {1000 * self.metre:.4g} mm, by g = {self.setting.gravity:.6g} m/s²"
            ]
        if not self.is_checked:
            return []
        value, error = gravity
        found = f"g of the flights is {value:.4g} ± {error:.2g} m/s²"
        if not self.fits_pull:
            return [f"{found}, that of {self.setting.gravity:.6g} is used"]
        off = value / self.setting.gravity - 1
        is_off = abs(off) > SURE * error / value
        more = f": lengths may be off by {100 * off:+.2g} %, ε is not, v is by as much" * is_off
        return [f"{found} ({self.setting.gravity:.6g} expected){more}"]

    def _of_contact(self, impacts: Impacts, contact: Contact, duration: Column) -> list[str]:
        known, first = self.setting.contact, 1000 * duration[0]
        per_ms = 1e-3 * self.setting.gravity * (1 - impacts.restitution) / impacts.velocity
        size = f"each millisecond lowers ε by {float(np.max(per_ms)):.2g} at most"
        at = f"at {impacts.velocity[0]:.3g} m/s"
        if known is None and not np.any(contact.weights):
            return [
                f"the contact's duration is neither stated (bounce_contact_time) nor shown by "
                f"{FEWEST_FOR_CONTACT} impacts or more, and taken as 0: {size}"
            ]
        if not np.any(contact.weights):
            return [f"contact of {first:.3g} ms {at}, {known.source}: {size}"]  # type: ignore[union-attr]
        error = 1000 * contact.total * float(contact.at(impacts.velocity[:1])[0] / contact.factor)
        how = "by how far below the floor flights cross"
        how += f", and {known.source}" * (known is not None) if known else ""
        return [f"contact of {first:.3g} ± {error:.2g} ms {at}, {how}: {size}"]

    def _of_frames(self, notes: Sequence[str]) -> list[str]:
        spans = _spans(self.without)
        remarks = [f"frames not used: {listed(spans)}"] if spans else []
        return [*remarks, *(f"impact not used: {note}" for note in notes)]


def _factor(ratio: float) -> str:
    """How much too large something is."""
    return f"{'large' if ratio > 1 else 'small'} by a factor of {max(ratio, 1 / ratio):.4g}"


def _spans(without: Sequence[tuple[float, float, str]]) -> list[str]:
    """Times that are not used, those of one reason together."""
    reasons: dict[str, list[str]] = {}
    for begin, end, why in without:
        reasons.setdefault(why, []).append(f"{begin:.4g} to {end:.4g} s")
    return [
        f"t = {listed(times[:5])}{' …' * (len(times) > 5)} ({why})"
        for why, times in reasons.items()
    ]


def _smoothed(flights: Sequence[Flight], degrees: int) -> str:
    """Correlation of the residuals of neighbouring frames."""
    products = sum(float(f.residuals[1:] @ f.residuals[:-1]) for f in flights)
    correlation = products / max(sum(flight.square for flight in flights), 1e-300)
    if correlation <= max(ALIKE, 4 / np.sqrt(degrees)):
        return ""
    factor = np.sqrt((1 + correlation) / (1 - correlation))
    return (
        f"residuals of neighbouring frames are alike (correlation {correlation:.2f}): the track is smoothed, "
        f"interpolated or distorted, and its errors are too small, by about {factor:.2g}"
    )
