"""Impacts stepped as particle codes step them: what a time step costs in ε, and how many are needed.

LAMMPS' and LIGGGHTS' velocity Verlet and YADE's leapfrog are one scheme for a contact: forces at
whole steps, velocities half a step before them,

    v_{n+1/2} = v_{n-1/2} - Δt P(δ_n, v_{n-1/2})/M,    δ_{n+1} = δ_n + Δt v_{n+1/2}

so that damped laws are of first order only. How far into a step an impact begins is chance; the
largest error over several beginnings counts.
"""

from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from calibration.particle_codes.target import Impacts, end_of, unloading_force

PHASES = 8  # beginnings of each impact, as parts of a step between the last free one and touch
GOLDEN = (5**0.5 - 1) / 2  # spreads them: impacts on a linear spring differ in nothing else
TRIED = (32, 64, 128, 256)  # steps in the shortest contact, for the order
FEWEST, MOST = 10, 20_000
LONGEST = 3  # times the longest contact that is stepped at most
BETWEEN = 1.1  # other velocities and beginnings may be worse by this factor; seen: 1.03
MORE = 1.1  # errors go up and down with the beginning; the order is an average
SLOWER = 100.0  # below the range, where what is held there is looked at
NO_OVERLAP = 1e-30  # in place of 0 [m]: forces of laws are of positive overlaps


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
    arrays = map(jnp.asarray, (impacts.velocity, impacts.factor, 0.0, step))
    return np.asarray(_stepped(law, *arrays, steps, _phases(len(impacts.velocity))))


def hold_error(law: Any, impacts: Impacts, fraction: float, step: float) -> float:
    """The largest error of ε held below the range with this fraction of critical damping."""
    slowest, expected = impacts.velocity[0], impacts.coefficient[0]
    velocity = np.geomspace(slowest / SLOWER, slowest, len(impacts.velocity))
    longest = float(np.max(impacts.duration)) * SLOWER**0.2  # of Hertz's contacts
    steps = int(np.ceil(LONGEST * longest / step)) + 2
    arrays = map(jnp.asarray, (velocity, impacts.factor, fraction, step))
    found = _stepped(law, *arrays, steps, _phases(len(velocity)))
    return BETWEEN * float(np.max(np.abs(np.asarray(found) - expected)))


def _phases(count: int) -> Float[Array, "phases n"]:
    return (jnp.arange(PHASES)[:, None] + jnp.arange(count) * GOLDEN % 1) / PHASES


def steps_of(law: Any, impacts: Impacts, count: int, order: float | None = None) -> Steps:
    """What a number of steps in the shortest contact costs."""
    error = BETWEEN * np.max(np.abs(rebounds(law, impacts, count) - impacts.coefficient))
    step = float(np.min(impacts.duration)) / count
    return Steps(count, step, float(error), order_of(law, impacts) if order is None else order)


def order_of(law: Any, impacts: Impacts) -> float | None:
    """The slope of ln error over ln step."""
    errors = [
        float(np.max(np.abs(rebounds(law, impacts, count) - impacts.coefficient)))
        for count in TRIED
    ]
    if min(errors) < 1e-12:
        return None
    return float(-np.polyfit(np.log(TRIED), np.log(errors), 1)[0])


def steps_within(law: Any, impacts: Impacts, tolerance: float, fewest: int = FEWEST) -> Steps:
    """The fewest steps, from `fewest` on, whose error stays within; `MOST` where none does."""
    order = order_of(law, impacts)
    last = steps_of(law, impacts, TRIED[-1], order)
    if order is None:
        return last
    count = max(TRIED[-1] * (last.error / tolerance) ** (1 / order), fewest)
    while count <= MOST:
        found = steps_of(law, impacts, int(np.ceil(count)), order)
        if found.error <= tolerance:
            return found
        count *= MORE
    return steps_of(law, impacts, MOST, order)


@jax.jit
def _stepped(
    law: Any,
    velocity: Float[Array, " n"],
    factor: Float[Array, " n"],
    hold: Array,
    step: Array,
    steps: int,
    phases: Float[Array, "p n"],
) -> Float[Array, "p n"]:
    """ε of impacts at `velocity` [m/s] after `steps` steps of one length [s].

    Args:
        factor: of the unloading force, one an impact.
        hold: above 0, ε is held: by the loading force with this fraction of critical damping inside the peak.
        phases: the parts of a step between the last free one and touch.
    """
    start = -phases * velocity * step
    state = (start, velocity + 0 * start, 0 * start)
    body = partial(_advance, law, factor, hold, step)
    _, last, _ = lax.fori_loop(0, steps, lambda _, state: body(state), state)
    return -last / velocity


def _advance(law, factor, hold, step, state):
    overlap, velocity, peak = state
    overlap = overlap + step * velocity
    touching = overlap > 0
    peak = jnp.where(touching, jnp.maximum(peak, overlap), 0.0)
    inside = jnp.maximum(overlap, NO_OVERLAP), velocity, jnp.maximum(peak, NO_OVERLAP)
    force = jnp.where(touching, _force(law, factor, hold, *inside), 0.0)
    return overlap, velocity - step * force / law.contact.mass, peak


def _force(law, factor, hold, overlap, velocity, peak):
    if not hasattr(law, "loading_force"):
        force = law.force(overlap, velocity)
        return force if end_of(law) == "zero-overlap" else jnp.maximum(force, 0.0)
    unloading = factor * jnp.maximum(unloading_force(law, overlap, peak), 0.0)
    loading, slope = jax.jvp(law.loading_force, (overlap,), (jnp.ones_like(overlap),))
    damping = hold * jnp.sqrt(2 * law.contact.mass * (loading / overlap + slope))
    inside = jnp.where(hold > 0, jnp.maximum(loading + damping * velocity, 0.0), unloading)
    return jnp.where(overlap >= peak, loading, inside)
