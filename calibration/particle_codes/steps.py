"""Impacts stepped as particle codes step them: what a time step costs in ε, and how many are needed.

LAMMPS' and LIGGGHTS' velocity Verlet and YADE's leapfrog are one scheme for a contact: forces at
whole steps, velocities half a step before them,

    v_{n+1/2} = v_{n-1/2} - Δt P(δ_n, v_{n-1/2})/M,    δ_{n+1} = δ_n + Δt v_{n+1/2}

so that damped laws are of first order only. How far into a step an impact begins is chance; the
largest error over several beginnings counts.
"""

from dataclasses import dataclass, replace
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
MOST = 20_000
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


def rebounds(
    law: Any, impacts: Impacts, step: float, hold: float = 0.0, longest: float | None = None
) -> Float[np.ndarray, "phases n"]:
    """ε as a code gives it with time steps [s], for several beginnings of each impact.

    Args:
        hold: above 0, ε is held: by the loading force with this fraction of critical damping inside the peak.
        longest: the longest contact [s], where it is not among the impacts.
    """
    steps = int(np.ceil(LONGEST * (longest or np.max(impacts.duration)) / step)) + 2
    count = len(impacts.velocity)
    phases = (np.arange(PHASES)[:, None] + np.arange(count) * GOLDEN % 1) / PHASES
    arrays = map(jnp.asarray, (impacts.velocity, impacts.factor, hold, step, phases))
    return np.asarray(_stepped(law, *arrays, steps))


def hold_error(law: Any, impacts: Impacts, hold: float, step: float) -> float:
    """The largest error of ε held below the range with this fraction of critical damping."""
    slowest, expected = impacts.velocity[0], impacts.coefficient[0]
    velocity = np.geomspace(slowest / SLOWER, slowest, len(impacts.velocity))
    longest = float(np.max(impacts.duration)) * SLOWER**0.2  # of Hertz's contacts
    found = rebounds(law, replace(impacts, velocity=velocity), step, hold, longest)
    return BETWEEN * float(np.max(np.abs(found - expected)))


def steps_of(law: Any, impacts: Impacts, count: int, order: float | None = None) -> Steps:
    """What a number of steps in the shortest contact costs."""
    step = float(np.min(impacts.duration)) / count
    error = BETWEEN * np.max(np.abs(rebounds(law, impacts, step) - impacts.coefficient))
    return Steps(count, step, float(error), order)


def steps_within(
    law: Any, impacts: Impacts, tolerance: float, fewest: int, requested: int | None = None
) -> Steps:
    """The fewest steps, from `fewest` on, whose error stays within, `MOST` where none does; or those requested."""
    errors = [steps_of(law, impacts, count).error for count in TRIED]
    order = float(-np.polyfit(np.log(TRIED), np.log(errors), 1)[0]) if min(errors) > 1e-12 else None
    if order is None or requested is not None:
        return steps_of(law, impacts, requested or TRIED[-1], order)
    count = max(TRIED[-1] * (errors[-1] / tolerance) ** (1 / order), fewest)
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
    phases: Float[Array, "p n"],
    steps: int,
) -> Float[Array, "p n"]:
    """ε of impacts after `steps` steps; `factor` multiplies the unloading force of each."""

    def advanced(_, state):
        overlap, velocity, peak = state
        overlap = overlap + step * velocity
        peak = jnp.where(overlap > 0, jnp.maximum(peak, overlap), 0.0)
        inside = jnp.maximum(overlap, NO_OVERLAP), velocity, jnp.maximum(peak, NO_OVERLAP)
        force = jnp.where(overlap > 0, _force(law, factor, hold, *inside), 0.0)
        return overlap, velocity - step * force / law.contact.mass, peak

    start = -phases * velocity * step
    state = (start, velocity + 0 * start, 0 * start)
    return -lax.fori_loop(0, steps, advanced, state)[1] / velocity


def _force(law, factor, hold, overlap, velocity, peak):
    if not hasattr(law, "loading_force"):
        force = law.force(overlap, velocity)
        return force if end_of(law) == "zero-overlap" else jnp.maximum(force, 0.0)
    unloading = factor * jnp.maximum(unloading_force(law, overlap, peak), 0.0)
    loading, slope = jax.jvp(law.loading_force, (overlap,), (jnp.ones_like(overlap),))
    damping = hold * jnp.sqrt(2 * law.contact.mass * (loading / overlap + slope))
    inside = jnp.where(hold > 0, jnp.maximum(loading + damping * velocity, 0.0), unloading)
    return jnp.where(overlap >= peak, loading, inside)
