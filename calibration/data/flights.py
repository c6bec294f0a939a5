"""Free flights in a track z(t): the motion, where in a film it is found, and its fit.

A ball that flies has z'' = -a - k v|v|, with the pull a = g' and k = g'/v_t² of `calibration.data.air`. From
z₀ and v₀ at s = 0, about the top of the flight at s_t, with c = √(a/k), w = √(a k) and x = w (s - s_t),

    rising    v = -c tan x,     z = z_t + ln(cos x)/k,       tan(w s_t) = v₀/c
    falling   v = -c tanh x,    z = z_t - ln(cosh x)/k,      tanh(w s_t) = v₀/c

and beyond the terminal speed coth and sinh. The derivatives follow from the equation itself: with v' = -a - k v|v|
and v'₀ at s = 0,

    ∂v/∂v₀ = v'/v'₀,      ∂z/∂v₀ = (v - v₀)/v'₀,
    ∂v/∂a = (v + s v' - v₀ ∂v/∂v₀)/2a,      ∂z/∂a = (s v - v₀ ∂z/∂v₀)/2a

Dropped from rest at 1 m with a = 9.81 m/s² and k = 0.006/m, after 0.4 s: v = -3.91173 m/s, z = 0.216429 m (in
vacuum -3.92400 and 0.215200).

Noise of a frame comes from third differences, which a flight does not have: (Δ³z)² is 20 σ² on the average, as
1 + 9 + 9 + 1 = 20.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from calibration.errors import DataError

FEWEST = 5  # frames of a flight where its pull is known
FEWEST_FREE = 7  # where it is not
FEWEST_FRAMES = 9  # of a track
FAR = 4.0  # standard errors of a prediction: a frame further off is no part of a flight
QUIET = 2.5  # times the noise: scatter about the motion of frames with which a flight may begin
COSTS = 25.0  # σ² that joining two pieces of one flight may add to Σ r²
EVEN = 0.2  # of the usual step: frames whose steps differ by less are evenly spaced
LEAST_NOISE = 1e-4  # of the range of heights: drag and lenses move exact frames by as much
GAP = 1.6  # times its length at even steps: a window with a longer gap is none to begin with
ROUNDS = 6  # of Gauss and Newton at most
SETTLED = 1e-9  # of a speed: a smaller step is none
Column = Float[np.ndarray, " n"]
Rows = Int[np.ndarray, " rows"]


class Track(NamedTuple):
    """Frames: times [s], increasing, and heights, upwards."""

    time: Column
    height: Column

    @property
    def step(self) -> float:
        """The usual time from frame to frame [s]."""
        return float(np.median(np.diff(self.time)))


@dataclass(frozen=True, eq=False)
class Flight:
    """A fitted flight.

    Attributes:
        rows: its frames.
        middle: the time [s] from which s counts.
        place, speed: z₀ and v₀ there.
        pull, drag: a and k.
        covariance: (2, 2), of z₀ and v₀ over σ².
        along: (2,), ∂z₀/∂a and ∂v₀/∂a of the fit.
        residuals: measured less fitted heights.
        by_pull: dz/da of the fitted heights, z₀ and v₀ moving along.
    """

    rows: Rows
    middle: float
    place: float
    speed: float
    pull: float
    drag: float
    covariance: Float[np.ndarray, "2 2"]
    along: Float[np.ndarray, "2"]
    residuals: Column
    by_pull: Column

    def state(self, time: Any) -> tuple[Any, Any]:
        """Height and velocity."""
        height, speed = motion(self.speed, self.pull, self.drag, np.asarray(time) - self.middle)
        return self.place + height, speed

    def fall(self, speed: float) -> float:
        """The acceleration -a - k v|v| at a velocity."""
        return -self.pull - self.drag * speed * abs(speed)

    def slopes(self, time: float) -> Float[np.ndarray, "2 3"]:
        """Derivatives of height and velocity in z₀, v₀ and the pull, where the fit moves with the pull."""
        s = np.array([time - self.middle])
        by = _linear(self.speed, self.pull, self.drag, s).slopes[..., 0]
        by[:, 2] += by[:, :2] @ self.along
        return by

    @property
    def square(self) -> float:
        """Σ r²."""
        return float(self.residuals @ self.residuals)


def motion(speed: float, pull: float, drag: float, s: Any) -> tuple[Any, Any]:
    """z - z₀ and v at times s after v₀ = `speed`; see above. Upwards, down, and beyond the terminal speed of 40.4 m/s:

    >>> for speed in (6.0, -40.0, -80.0):
    ...     z, v = motion(speed, 9.8, 0.006, 1.1)
    ...     print(f"{z:.7f} {v:.7f}")
    0.6325409 -4.8007344
    -44.1022231 -40.1708599
    -75.1865684 -59.7242115
    """
    s = np.asarray(s, float)
    if drag <= 0 or pull <= 0:
        return speed * s - 0.5 * pull * s * s, speed - pull * s
    terminal, rate = math.sqrt(pull / drag), math.sqrt(pull * drag)
    if speed <= -terminal:  # thrown down: slower and slower
        start = math.atanh(min(-terminal / speed, 1 - 1e-15))
        x = np.maximum(rate * s + start, 1e-9)
        return -(np.log(np.sinh(x)) - np.log(np.sinh(start))) / drag, -terminal / np.tanh(x)
    phase = math.atan(speed / terminal) if speed >= 0 else math.atanh(speed / terminal)
    x = rate * s - phase
    up, down = np.minimum(np.maximum(-x, 0.0), 1.5), np.maximum(x, 0.0)  # one of them is 0
    # ln cos and ln cosh, exact where they are small
    height = np.log1p(-(np.sin(up) ** 2)) - np.log1p(np.sinh(down) ** 2)
    first = math.cos(phase) ** 2 if speed >= 0 else math.cosh(phase) ** -2
    velocity = terminal * (np.tan(up) - np.tanh(down))
    return 0.5 * (height - math.log(first)) / drag, velocity


class _Linear(NamedTuple):
    """Heights and velocities at times s, and their derivatives in z₀, v₀ and a: (2, 3, n)."""

    height: Column
    slopes: Float[np.ndarray, "2 3 n"]


def _linear(speed: float, pull: float, drag: float, s: Column) -> _Linear:
    z, v = motion(speed, pull, drag, s)
    one, none = np.ones_like(s), np.zeros_like(s)
    if drag <= 0:
        return _Linear(z, np.array([[one, s, -0.5 * s * s], [none, one, -s]]))
    first, now = -pull - drag * speed * abs(speed), -pull - drag * v * np.abs(v)
    z_by_v, v_by_v = (v - speed) / first, now / first
    z_by_a = (s * v - speed * z_by_v) / (2 * pull)
    v_by_a = (v + s * now - speed * v_by_v) / (2 * pull)
    return _Linear(z, np.array([[one, z_by_v, z_by_a], [none, v_by_v, v_by_a]]))


def fitted(track: Track, rows: Rows, pull: float, drag: float = 0.0) -> Flight:
    """Least squares of z₀ and v₀ with a known pull, by Gauss and Newton from the flight in vacuum."""
    middle = float(np.mean(track.time[rows]))
    s, z = track.time[rows] - middle, track.height[rows]
    square = float(s @ s)  # Σ s is 0
    place = float(np.mean(z)) + 0.5 * pull * square / len(s)
    speed = float(s @ (z + 0.5 * pull * s * s)) / square
    for _ in range(ROUNDS if drag > 0 else 1):
        linear = _linear(speed, pull, drag, s)
        design = linear.slopes[0, :2].T
        covariance = np.linalg.inv(design.T @ design)
        residuals = z - place - linear.height
        step = covariance @ (design.T @ residuals)
        place, speed = place + float(step[0]), speed + float(step[1])
        residuals = residuals - design @ step
        if abs(step[1]) < SETTLED * abs(speed):
            break
    along = -covariance @ (design.T @ linear.slopes[0, 2])
    by_pull = linear.slopes[0, 2] + design @ along
    return Flight(rows, middle, place, speed, pull, drag, covariance, along, residuals, by_pull)


def common_pull(track: Track, flights: list[Flight]) -> tuple[float, float]:
    """The correction of the pull that all flights ask for together, and its standard error over σ.

    Least squares where each flight keeps a z₀ and v₀ of its own: Σ q r/Σ q², with q = dz/da of its fit.
    """
    square = sum(float(flight.by_pull @ flight.by_pull) for flight in flights)
    product = sum(float(flight.by_pull @ flight.residuals) for flight in flights)
    return product / square, square**-0.5


def free_acceleration(track: Track, rows: Rows, noise: float) -> tuple[float, float, float]:
    """Acceleration downwards of some frames, its standard error, and how far they move."""
    s = track.time[rows] - np.mean(track.time[rows])
    design = np.stack([np.ones_like(s), s, -0.5 * s * s], axis=1)
    inverse = np.linalg.inv(design.T @ design)
    estimate = inverse @ (design.T @ track.height[rows])
    return (
        float(estimate[2]),
        noise * float(np.sqrt(inverse[2, 2])),
        float(np.ptp(design @ estimate)),
    )


def noise_of(track: Track) -> float:
    """Standard deviation of a frame, from third differences of evenly spaced frames.

    The median of their sizes over 0.6745, or, where rounding to pixels makes most of them equal, the root
    mean square of the smaller seven tenths over 0.6, what normal errors have there: the larger of the two.
    """
    steps = np.diff(track.time)
    even = np.abs(steps - track.step) < EVEN * track.step
    third = np.diff(track.height, 3)[even[:-2] & even[1:-1] & even[2:]]
    if len(third) < FEWEST_FRAMES - 3:
        value = f"of {len(track.time)} frames, {len(third)} fours of these at even steps"
        raise DataError("track", value, f"of {FEWEST_FRAMES} evenly spaced frames or more")
    sizes = np.sort(np.abs(third - np.median(third)))[: max(6, int(0.7 * len(third)))]
    by_median = float(np.median(np.abs(third))) / 0.6745
    by_square = float(np.sqrt(np.mean(sizes**2))) / 0.6
    return max(max(by_median, by_square) / np.sqrt(20), LEAST_NOISE * float(np.ptp(track.height)))


def flights_in(
    track: Track,
    noise: float,
    usable: Bool[np.ndarray, " n"],
    pull: float | None = None,
    drag: float = 0.0,
) -> list[Rows]:
    """Frames of each free flight, in the order of time.

    Flights grow from the quietest windows of a few frames, half their length at a time, while frames
    are where the flight so far predicts them; a single outlier between good frames is left out.

    Args:
        usable: which frames may be part of one.
        pull, drag: a and k of all; None: each has an acceleration of its own.
    """
    fewest = FEWEST_FREE if pull is None else FEWEST
    taken, found = ~usable, []
    windows, scatter = _windows(track, fewest, pull)
    for i in np.argsort(scatter, kind="stable"):
        if scatter[i] > QUIET * noise:
            break
        if not np.any(taken[windows[i]]):
            rows = _grown(track, windows[i], noise, taken, pull, drag)
            taken[rows[0] : rows[-1] + 1] = True
            found.append(rows)
    found.sort(key=lambda rows: rows[0])
    return joined(track, found, noise, pull, drag)


def joined(
    track: Track, pieces: list[Rows], noise: float, pull: float | None, drag: float = 0.0
) -> list[Rows]:
    """Pieces of one flight, about a gap or an outlier, as one."""
    whole: list[Rows] = []
    square = 0.0  # Σ r² of the last of these
    for rows in pieces:
        apart = _square(track, rows, pull, drag)
        if whole:
            both = np.concatenate([whole[-1], rows])
            together = _square(track, both, pull, drag)
            if together - square - apart < COSTS * noise**2:
                whole[-1], square = both, together
                continue
        whole.append(rows)
        square = apart
    return whole


def _square(track: Track, rows: Rows, pull: float | None, drag: float) -> float:
    """Σ r² of a flight through some frames."""
    if pull is not None:
        return fitted(track, rows, pull, drag).square
    s = track.time[rows] - np.mean(track.time[rows])
    design = np.stack([np.ones_like(s), s, s * s], axis=1)
    return float(np.sum((track.height[rows] - design @ _solved(design, track.height[rows])) ** 2))


def _solved(design: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Least squares by the normal equations, of one window or many."""
    turned = np.swapaxes(design, -1, -2)
    return np.linalg.solve(turned @ design, (turned @ values[..., None]))[..., 0]


def _windows(track: Track, fewest: int, pull: float | None):
    """All runs of `fewest` frames, and the scatter of each about its motion; infinite with a gap."""
    at = np.arange(len(track.time) - fewest + 1)[:, None] + np.arange(fewest)
    time, values = track.time[at], track.height[at]
    s = time - np.mean(time, axis=1, keepdims=True)
    columns = [np.ones_like(s), s]
    if pull is None:
        columns.append(s * s)
    else:
        values = values + 0.5 * pull * s * s
    design = np.stack(columns, axis=-1)
    off = values - (design @ _solved(design, values)[..., None])[..., 0]
    scatter = np.sqrt(np.sum(off**2, axis=1) / (fewest - len(columns)))
    scatter[time[:, -1] - time[:, 0] > GAP * (fewest - 1) * track.step] = np.inf
    return at, scatter


def _grown(
    track: Track,
    rows: Rows,
    noise: float,
    taken: Bool[np.ndarray, " n"],
    pull: float | None,
    drag: float,
) -> Rows:
    """A flight from some of its frames, as far as it goes."""
    open_ends = [True, True]
    while any(open_ends):
        for forwards in (False, True):
            while open_ends[forwards]:
                ahead = np.fromiter(_ahead(rows, taken, forwards), int)
                good = _belongs(track, rows, ahead, noise, pull, drag)
                bad = np.flatnonzero(~good)
                # an outlier has two good frames behind it
                last = next((j for j in bad if np.sum(good[j + 1 : j + 3]) < 2), len(ahead))
                new = ahead[:last][good[:last]]
                open_ends[forwards] = len(new) > 0
                # with so many more frames the other end is predicted more closely
                open_ends[not forwards] |= len(new) > len(rows) // 4
                rows = np.sort(np.concatenate([rows, new]))
    return rows


def _ahead(rows: Rows, taken: Bool[np.ndarray, " n"], forwards: bool) -> Iterator[int]:
    """Free frames next to a flight, half as many as it has."""
    row, step = (int(rows[-1]), 1) if forwards else (int(rows[0]), -1)
    for _ in range(max(3, len(rows) // 2)):
        row += step
        if not 0 <= row < len(taken) or taken[row]:
            return
        yield row


def _belongs(
    track: Track, rows: Rows, ahead: Rows, noise: float, pull: float | None, drag: float
) -> Bool[np.ndarray, " ahead"]:
    """Whether frames are where a flight predicts them, within `FAR` standard errors."""
    if not len(ahead):
        return np.zeros(0, bool)
    middle = np.mean(track.time[rows])
    s, at = track.time[rows] - middle, track.time[ahead] - middle
    powers = (0, 1, 2) if pull is None else (0, 1)
    design, further = (np.stack([x**p for p in powers], axis=1) for x in (s, at))
    inverse = np.linalg.inv(design.T @ design)
    if pull is None:
        predicted = further @ (inverse @ (design.T @ track.height[rows]))
    else:
        predicted = fitted(track, rows, pull, drag).state(track.time[ahead])[0]
    error = noise * np.sqrt(1 + np.einsum("ij,jk,ik->i", further, inverse, further))
    return np.abs(track.height[ahead] - predicted) < FAR * error
