"""Impacts stepped as particle codes step them: what a time step costs in ε, and how many are needed.

LAMMPS' and LIGGGHTS' velocity Verlet and YADE's leapfrog are one scheme for a contact: forces at
whole steps, velocities half a step before them,

    v_{n+1/2} = v_{n-1/2} - Δt P(δ_n, v_{n-1/2})/M,    δ_{n+1} = δ_n + Δt v_{n+1/2}

so that damped laws are of first order only. How far into a step an impact begins is chance; the
largest error over several beginnings counts, of all pairs of bodies with one step.

Weight: bodies that touch are pulled together by M g, as a ball is by the floor below it. It matters by g T/v.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

import softjax as sj
from calibration.particle_codes.target import Curve, Impacts
from softjax.many_body import LEAST, damped_force, unloading_force

PHASES = 16  # beginnings of each impact, as parts of a step between the last free one and touch
GOLDEN = (5**0.5 - 1) / 2  # spreads them: impacts on a linear spring differ in nothing else
TRIED = (32, 64, 128, 256)  # steps in the shortest contact, for the order
MOST = 20_000
LONGEST = 3  # times the longest contact that is stepped at most
BETWEEN = 1.2  # other velocities and beginnings may be worse by this factor; seen: 1.12
MORE = 1.1  # errors go up and down with the beginning; the order is an average
SLOWER = 100.0  # the factor below the range at which a constant ε is checked
# over N²: how much slower than the range an impact is that is held. Its largest overlap is seen at whole steps only,
# short of it by 1.2/N² at most, which is 1.5/N² of the velocity of Hertz's contacts, and moves by the step as much.
MARGIN = 4.0


class Contact(NamedTuple):
    """A law of a pair of bodies, its impacts, and the ε that was requested of them."""

    law: Any
    impacts: Impacts
    requested: Curve

    @property
    def error(self) -> float:
        """The largest difference of ε, without steps."""
        return float(np.max(np.abs(self.impacts.coefficient - self.requested)))


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


def rebounds(
    law: Any, impacts: Impacts, step: float, hold: float = 0.0, gravity: float = 0.0
) -> np.ndarray:
    """ε as a code gives it with time steps [s], shape (p, n): for several beginnings of each impact.

    Where `hold` is above 0, by the loading force with this fraction of critical damping inside the peak.
    """
    steps = int(np.ceil(LONGEST * np.max(impacts.duration) / step)) + 2
    count = len(impacts.velocity)
    phases = (np.arange(PHASES)[:, None] + np.arange(count) * GOLDEN % 1) / PHASES
    arrays = map(jnp.asarray, (impacts.velocity, impacts.factor, hold, gravity, step, phases))
    return np.asarray(_stepped(law, *arrays, steps))


def shortest(contacts: Sequence[Contact]) -> float:
    """The shortest contact of all [s]."""
    return min(float(np.min(contact.impacts.duration)) for contact in contacts)


def weight_error(contacts: Sequence[Contact], gravity: float) -> float:
    """Part that weight adds to the largest error of ε, by steps that are fine."""
    if gravity == 0:
        return 0.0
    step = shortest(contacts) / TRIED[-1]
    errors = []
    for law, impacts, requested in contacts:
        heavy = rebounds(law, impacts, step, gravity=gravity)
        change = BETWEEN * (heavy - rebounds(law, impacts, step))
        errors.append(float(np.max(np.abs(impacts.coefficient + change - requested))))
    return max(max(errors) - max(contact.error for contact in contacts), 0.0)


def held_below(slowest: float, count: int) -> float:
    """Impacts slower than this [m/s] are held where the range begins at `slowest`, by so many steps."""
    return slowest * (1 - min(MARGIN / count**2, 0.5))


def hold_error(contacts: Sequence[Contact], hold: float, steps: Steps) -> float:
    """The largest error of ε held below the range with this fraction of critical damping.

    Next to the end of the range impacts are not held, and have their own ε.
    """
    errors = []
    for law, impacts, _ in contacts:
        slowest, expected = impacts.velocity[0], impacts.coefficient[0]
        velocity = np.geomspace(slowest / SLOWER, slowest, len(impacts.velocity))
        duration = impacts.duration * SLOWER**0.2  # of Hertz's contacts, at most
        slow = replace(impacts, velocity=velocity, duration=duration)
        held = rebounds(law, slow, steps.step, hold) - expected
        own = rebounds(law, impacts, steps.step)[:, 0] - expected
        end = held_below(float(slowest), steps.count)
        ahead = abs(float(np.interp(end, *_slope(impacts))) - expected)
        errors += [float(np.max(np.abs(held))), float(np.max(np.abs(own))) + ahead]
    return BETWEEN * max(errors)


def _slope(impacts: Impacts) -> tuple[np.ndarray, np.ndarray]:
    """ε on the line through its first two velocities, to below them."""
    (v, w), (e, f) = impacts.velocity[:2], impacts.coefficient[:2]
    return np.array([v - (w - v), w]), np.array([e - (f - e), f])


def steps_within(
    contacts: Sequence[Contact],
    tolerance: float,
    fewest: int,
    requested: int | None,
    scheme: float,
) -> Steps:
    """The fewest steps, from `fewest` on, whose error stays within, `MOST` where none does; or those requested.

    They are counted in the shortest contact. The error of N steps is `scheme`/N² at least.
    """

    def steps_of(count: int, order: float | None = None) -> Steps:
        step = shortest(contacts) / count
        errors = [rebounds(law, of, step) - of.coefficient for law, of, _ in contacts]
        error = BETWEEN * float(np.max(np.abs(errors)))
        return Steps(count, step, max(error, scheme / count**2), order)

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
def _stepped(law, velocity, factor, hold, gravity, step, phases, steps):
    """ε of impacts, shape (p, n) as `phases`, after so many steps; `factor` multiplies the unloading force."""

    def advanced(_, state):
        overlap, velocity, peak = state
        parted = (overlap <= 0) & (velocity < 0)
        new = overlap + step * velocity
        top = jnp.maximum(peak, new)
        inside = jnp.maximum(new, LEAST), velocity, jnp.maximum(top, LEAST)
        force = _force(law, factor, hold, *inside)
        pull = jnp.where(new > 0, gravity - force / law.contact.mass, 0.0)
        after = new, velocity + step * pull, top
        return tuple(jnp.where(parted, a, b) for a, b in zip(state, after, strict=True))

    start = -phases * velocity * step
    state = (start, velocity + 0 * start, 0 * start)
    overlap, rate, _ = lax.fori_loop(0, steps, advanced, state)
    # what has not left yet climbs out of its dent against its weight, or stays in it
    left = rate**2 - 2 * gravity * jnp.maximum(overlap, 0.0)
    out = jnp.sqrt(jnp.maximum(left, 0.0))
    return jnp.where((gravity > 0) & (overlap > 0), jnp.where(rate < 0, out, 0.0), -rate) / velocity


def _force(law, factor, hold, overlap, velocity, peak):
    if not hasattr(law, "loading_force"):
        return sj.contact_force(law, overlap, velocity, 0.0)[0]
    unloading = factor * jnp.maximum(unloading_force(law, overlap, peak), 0.0)
    damped = damped_force(law, law.loading_force, overlap, velocity, hold)
    inside = jnp.where(hold > 0, damped, unloading)
    return jnp.where(overlap >= peak, law.loading_force(overlap), inside)
