"""Time, error and memory of one way."""

import math
import statistics
import time
from dataclasses import dataclass
from pathlib import Path

import jax
import numpy as np

from calibration.speed.scene import Scene
from calibration.speed.ways import Way

REPEATS = 9
SHORTEST = 0.2  # [s] until which repeats go on
LONGEST = 0.5  # [s] after which no further repeat is started
SLIGHTLY = 1.1  # a rival may err by so much more
NEARLY = 3.0  # errors within this factor count as the one that was asked for


@dataclass(frozen=True)
class Row:
    """One line of the table. Times are medians after a warm-up; `None` is what was not measured."""

    family: str
    setting: str
    precision: str
    batch: int
    microseconds: float  # a collision
    largest_error: float  # of ε_p against the exact answer
    compile_seconds: float  # the first call beyond a later one
    memory_mib: float | None  # peak above what was there before the call, where the system tells
    gradient_microseconds: float | None = None  # value and gradient, a collision
    gradient_error: float | None = None  # largest, of θ ∂ε_p/∂θ


def measure(way: Way, scene: Scene) -> Row:
    velocity = np.resize(scene.velocity, way.batch).astype(way.precision)
    first, compiling = _timed(way.value, velocity)
    before = _resident_mib()
    way_seconds = _median_seconds(way.value, velocity)
    grown = None if before is None else max(status_mib("VmHWM") - before, 0.0)
    row = {
        "family": way.family,
        "setting": way.setting,
        "precision": way.precision,
        "batch": way.batch,
        "microseconds": 1e6 * way_seconds / way.batch,
        "largest_error": _largest_error(first, scene),
        "compile_seconds": max(compiling - way_seconds, 0.0),
        "memory_mib": grown,
    }
    if way.gradient is not None:
        row |= _measure_gradient(way, scene, velocity)
    return Row(**row)


def _measure_gradient(way: Way, scene: Scene, velocity: np.ndarray) -> dict:
    (_, slopes), _ = _timed(way.gradient, velocity)
    seconds = _median_seconds(way.gradient, velocity)
    times_used = np.bincount(np.arange(way.batch) % scene.velocity.size)
    exact = scene.slopes[:, : times_used.size] @ times_used
    # of sums over the batch: divided by it, this is the mean error of one collision
    error = np.max(np.abs(np.asarray(slopes, float) - exact)) / way.batch
    return {"gradient_microseconds": 1e6 * seconds / way.batch, "gradient_error": float(error)}


def _largest_error(value, scene: Scene) -> float:
    value = np.asarray(value, float)
    exact = np.resize(scene.exact, value.size)
    return float(np.max(np.abs(value - exact)))


def _timed(function, velocity):
    start = time.perf_counter()
    result = jax.block_until_ready(function(velocity))
    return result, time.perf_counter() - start


def _median_seconds(function, velocity) -> float:
    seconds: list[float] = []
    while sum(seconds) < (LONGEST if len(seconds) < REPEATS else SHORTEST):
        seconds.append(_timed(function, velocity)[1])
    return statistics.median(seconds)


def _resident_mib() -> float | None:
    """What is in memory, from where on its peak counts; None where the system does not tell."""
    try:
        Path("/proc/self/clear_refs").write_text("5")
        return status_mib("VmRSS")
    except (OSError, KeyError):
        return None


def status_mib(key: str) -> float:
    """What Linux tells of this process's memory."""
    lines = Path("/proc/self/status").read_text().splitlines()
    fields = dict(line.split(":", 1) for line in lines if ":" in line)
    return int(fields[key].split()[0]) / 1024


def at_error(rows: list[Row], family: str, error: float) -> float | None:
    """Microseconds a collision of the cheapest setting of `family` that errs by `error` at most."""
    good = [r.microseconds for r in rows if r.family == family and r.largest_error <= error]
    return min(good) if good else None


def along_power_law(rows: list[Row], family: str, error: float) -> float | None:
    """The same for a rival, interpolated between its settings: none loses by where they lie.

    None where it was not measured near that error: much tighter settings would be unfair.
    """
    points = sorted((r.largest_error, r.microseconds) for r in rows if r.family == family)
    above = [p for p in points if p[0] > SLIGHTLY * error]
    below = [p for p in points if p[0] <= SLIGHTLY * error]
    if not below:
        return None
    if not above:
        return min(t for _, t in below) if below[-1][0] > error / NEARLY else None
    (e1, t1), (e2, t2) = below[-1], above[0]
    weight = math.log(error / e1) / math.log(e2 / e1)
    return min(t1, t1 ** (1 - weight) * t2**weight)
