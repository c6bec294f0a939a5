"""Time steps: what they cost in ε, and how many a tolerance needs.

How far into a step an impact begins is chance; the largest error over several beginnings counts.
"""

from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from calibration.handover.impacts import Impacts
from calibration.handover.stepping import stepped

PHASES = 8  # beginnings of each impact, as parts of a step between the last free one and touch
GOLDEN = (5**0.5 - 1) / 2  # spreads them: impacts on a linear spring differ in nothing else
TRIED = (32, 64, 128, 256)  # steps in the shortest contact, for the order
FEWEST, MOST = 10, 20_000
LONGEST = 3  # times the longest contact that is stepped at most
BETWEEN = 1.1  # other velocities and beginnings may be worse by this factor; seen: 1.03
MORE = 1.1  # errors go up and down with the beginning; the order is an average


@dataclass(frozen=True)
class Steps:
    """A time step and what it costs.

    Attributes:
        count: steps in the shortest contact of the range.
        step: [s].
        error: the largest error of ε over the range, against the law without steps.
        order: measured, error ∝ step^order; None where there was no error to measure.
    """

    count: int
    step: float
    error: float
    order: float | None


NONE = Steps(0, 0.0, np.inf, None)  # where no time step was looked for


def rebounds(law: Any, impacts: Impacts, count: int) -> Float[np.ndarray, "phases n"]:
    """ε as a code gives it with `count` steps in the shortest contact, for several beginnings."""
    step = float(np.min(impacts.duration)) / count
    steps = int(np.ceil(LONGEST * np.max(impacts.duration) / step)) + 2
    arrays = (jnp.asarray(impacts.velocity), jnp.asarray(impacts.factor), jnp.asarray(step))
    return np.asarray(stepped(law, *arrays, steps, _phases(len(impacts.velocity))).coefficient)


def _phases(count: int) -> Float[Array, "phases n"]:
    return (jnp.arange(PHASES)[:, None] + jnp.arange(count) * GOLDEN % 1) / PHASES


def steps_of(law: Any, impacts: Impacts, count: int, order: float | None = None) -> Steps:
    """What a number of steps in the shortest contact costs."""
    error = BETWEEN * np.max(np.abs(rebounds(law, impacts, count) - impacts.coefficient))
    step = float(np.min(impacts.duration)) / count
    return Steps(count, step, float(error), order_of(law, impacts) if order is None else order)


def table_error(law: Any, table: Any, impacts: Impacts) -> float:
    """What interpolating a law's forces costs in ε at most, beside the same steps of the law."""
    exact, found = (rebounds(one, impacts, TRIED[-1]) for one in (law, table))
    return float(np.max(np.abs(found - exact)))


def order_of(law: Any, impacts: Impacts) -> float | None:
    """The slope of ln error over ln step."""
    errors = [
        float(np.max(np.abs(rebounds(law, impacts, count) - impacts.coefficient)))
        for count in TRIED
    ]
    if min(errors) < 1e-12:
        return None
    return float(-np.polyfit(np.log(TRIED), np.log(errors), 1)[0])


def steps_within(law: Any, impacts: Impacts, tolerance: float) -> Steps:
    """The fewest steps whose error stays within, by the order measured; `MOST` where none does."""
    order = order_of(law, impacts)
    last = steps_of(law, impacts, TRIED[-1], order)
    if order is None:
        return last
    count = max(TRIED[-1] * (last.error / tolerance) ** (1 / order), FEWEST)
    while count <= MOST:
        found = steps_of(law, impacts, int(np.ceil(count)), order)
        if found.error <= tolerance:
            return found
        count *= MORE
    return steps_of(law, impacts, MOST, order)
