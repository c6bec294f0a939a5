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

import softjax as sj
from calibration.particle_codes.target import Impacts
from softjax.many_body import LEAST, damped_force, unloading_force

PHASES = 16  # beginnings of each impact, as parts of a step between the last free one and touch
GOLDEN = (5**0.5 - 1) / 2  # spreads them: impacts on a linear spring differ in nothing else
TRIED = (32, 64, 128, 256)  # steps in the shortest contact, for the order
MOST = 20_000
LONGEST = 3  # times the longest contact that is stepped at most
BETWEEN = 1.2  # other velocities and beginnings may be worse by this factor; seen: 1.12
MORE = 1.1  # errors go up and down with the beginning; the order is an average
SLOWER = 100.0  # the factor below the range at which a constant ε is checked


@dataclass(frozen=True)
class Steps:
    """A time step [s], how many are in the shortest contact, and the largest error of ε over the range.

    `order`: error ∝ step^order as measured; None where there was no error to measure.
    """

    count: int
    step: float
    error: float
    order: float | None


NONE = Steps(0, 0.0, np.inf, None)  # where no time step was looked for


def rebounds(law: Any, impacts: Impacts, step: float, hold: float = 0.0) -> np.ndarray:
    """ε as a code gives it with time steps [s], shape (p, n): for several beginnings of each impact.

    Where `hold` is above 0, by the loading force with this fraction of critical damping inside the peak.
    """
    steps = int(np.ceil(LONGEST * np.max(impacts.duration) / step)) + 2
    count = len(impacts.velocity)
    phases = (np.arange(PHASES)[:, None] + np.arange(count) * GOLDEN % 1) / PHASES
    arrays = map(jnp.asarray, (impacts.velocity, impacts.factor, hold, step, phases))
    return np.asarray(_stepped(law, *arrays, steps))


def hold_error(law: Any, impacts: Impacts, hold: float, step: float) -> float:
    """The largest error of ε held below the range with this fraction of critical damping."""
    slowest, expected = impacts.velocity[0], impacts.coefficient[0]
    velocity = np.geomspace(slowest / SLOWER, slowest, len(impacts.velocity))
    duration = impacts.duration * SLOWER**0.2  # of Hertz's contacts, at most
    obtained = rebounds(law, replace(impacts, velocity=velocity, duration=duration), step, hold)
    return BETWEEN * float(np.max(np.abs(obtained - expected)))


def steps_within(
    law: Any, impacts: Impacts, tolerance: float, fewest: int, requested: int | None, scheme: float
) -> Steps:
    """The fewest steps, from `fewest` on, whose error stays within, `MOST` where none does; or those requested.

    The error of N steps is `scheme`/N² at least.
    """

    def steps_of(count: int, order: float | None = None) -> Steps:
        step = float(np.min(impacts.duration)) / count
        error = BETWEEN * np.max(np.abs(rebounds(law, impacts, step) - impacts.coefficient))
        return Steps(count, step, max(float(error), scheme / count**2), order)

    errors = [steps_of(count).error for count in TRIED]
    order = float(-np.polyfit(np.log(TRIED), np.log(errors), 1)[0]) if min(errors) > 1e-12 else None
    if order is None or requested is not None:
        return steps_of(requested or TRIED[-1], order)
    count = max(TRIED[-1] * (errors[-1] / tolerance) ** (1 / order), fewest)
    while count <= MOST:
        steps = steps_of(int(np.ceil(count)), order)
        if steps.error <= tolerance:
            return steps
        count *= MORE
    return steps_of(MOST, order)


@jax.jit
def _stepped(law, velocity, factor, hold, step, phases, steps):
    """ε of impacts, shape (p, n) as `phases`, after so many steps; `factor` multiplies the unloading force."""

    def advanced(_, state):
        overlap, velocity, peak = state
        overlap = overlap + step * velocity
        peak = jnp.maximum(peak, overlap)
        inside = jnp.maximum(overlap, LEAST), velocity, jnp.maximum(peak, LEAST)
        force = jnp.where(overlap > 0, _force(law, factor, hold, *inside), 0.0)
        return overlap, velocity - step * force / law.contact.mass, peak

    start = -phases * velocity * step
    state = (start, velocity + 0 * start, 0 * start)
    return -lax.fori_loop(0, steps, advanced, state)[1] / velocity


def _force(law, factor, hold, overlap, velocity, peak):
    if not hasattr(law, "loading_force"):
        return sj.contact_force(law, overlap, velocity, 0.0)[0]
    unloading = factor * jnp.maximum(unloading_force(law, overlap, peak), 0.0)
    damped = damped_force(law, law.loading_force, overlap, velocity, hold)
    inside = jnp.where(hold > 0, damped, unloading)
    return jnp.where(overlap >= peak, law.loading_force(overlap), inside)
