"""Impacts stepped as particle codes step them.

LAMMPS' and LIGGGHTS' velocity Verlet and YADE's leapfrog are one scheme for a contact: forces at
whole steps, velocities half a step before them,

    v_{n+1/2} = v_{n-1/2} - Δt P(δ_n, v_{n-1/2})/M,    δ_{n+1} = δ_n + Δt v_{n+1/2}

so that damped laws are of first order only.
"""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from calibration.handover.forces import end_of, unloading_force

NO_OVERLAP = 1e-30  # in place of none [m]: laws are asked for forces at positive overlaps alone


class Stepped(NamedTuple):
    """Impacts that were stepped; arrays of the shape of velocities and phases together."""

    coefficient: Array
    peak: Array  # largest overlap [m]
    duration: Array  # steps with a force times their length [s]


@jax.jit
def stepped(
    law: Any,
    velocity: Float[Array, " n"],
    factor: Float[Array, " n"],
    step: Array,
    steps: int,
    phases: Float[Array, "p _"],
) -> Stepped:
    """Impacts on a law with a force.

    Args:
        velocity: [m/s].
        factor: of the unloading force, one an impact.
        step, steps: their length [s], one or one an impact, and how many are taken.
        phases: the parts of a step between the last free one and touch, shape (p, n) or (p, 1).
    """
    start = -phases * velocity * step
    state = (start, velocity + 0 * start, 0 * start, 0 * start, 0 * start)
    body = partial(_advance, law, factor, step)
    _, last, _, largest, time = lax.fori_loop(0, steps, lambda _, state: body(state), state)
    return Stepped(-last / velocity, largest, time)


def _advance(law, factor, step, state):
    overlap, velocity, peak, largest, time = state
    overlap = overlap + step * velocity
    touching = overlap > 0
    peak = jnp.where(touching, jnp.maximum(peak, overlap), 0.0)
    force = _force(
        law, factor, jnp.maximum(overlap, NO_OVERLAP), velocity, jnp.maximum(peak, NO_OVERLAP)
    )
    force = jnp.where(touching, force, 0.0)
    time = time + jnp.where(force != 0, step, 0.0)
    return (
        overlap,
        velocity - step * force / law.contact.mass,
        peak,
        jnp.maximum(largest, peak),
        time,
    )


def _force(law, factor, overlap, velocity, peak):
    if not hasattr(law, "loading_force"):
        force = law.force(overlap, velocity)
        return force if end_of(law) == "zero-overlap" else jnp.maximum(force, 0.0)
    unloading = factor * jnp.maximum(unloading_force(law, overlap, peak), 0.0)
    return jnp.where(overlap >= peak, law.loading_force(overlap), unloading)
