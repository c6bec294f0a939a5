"""A contact law as a pure function, for many-body codes written in JAX."""

from typing import Any

import jax.numpy as jnp

from softjax.fields import Numbers
from softjax.laws.stepped import (
    LEAST,
    damped_force,
    elastic_limit,
    end_of,
    held_fraction,
    loading_work,
    unloading_force,
)
from softjax.numerics.powers import safe_sqrt
from softjax.restitution import restitution


def contact_force(
    law: Any, overlap: Any, velocity: Any, memory: Any, *, hold: Any = None
) -> tuple[Numbers, Numbers]:
    """The force of a contact law at one instant, and what the contact remembers.

    A rate-independent law loads up to the largest overlap δ_m so far and unloads below it, where its force
    is multiplied by (ε/ε_p)²: the losses of Eq. (17), which are in ε and in no force, are taken there, so that
    an impact that is stepped rebounds at ε, not at ε_p. ε is that of the impact whose energy reaches δ_m,
    M v²/2 = ∫ P dδ; 1 at most. Contacts do not pull, but for laws that say so.

    Works under `jit`, `vmap` and `grad`; arguments broadcast.

    Args:
        law: a contact law with a force; its fields and its contact's may be arrays, one a pair of bodies.
        overlap: δ [m]; no contact where it is not positive.
        velocity: its rate of change [m/s], positive on approach.
        memory: the largest overlap so far [m], 0 for a new contact.
        hold: impacts slower than this [m/s] rebound at its ε: along the loading curve, with a dashpot
            c = ξ √(2 M (P/δ + dP/dδ)) inside the largest overlap, so that ln ε = -ξ arccos ξ/√(1 - ξ²). Faster contacts
            feel it where they load again, so that a bed settles. Of rate-independent laws alone.

    Returns:
        The repulsive force [N], and the memory for the next call: 0 where the bodies are apart.
    """
    overlap, velocity, memory = jnp.broadcast_arrays(overlap, velocity, memory)
    touching = overlap > 0
    inside = jnp.where(touching, overlap, LEAST)
    if not hasattr(law, "loading_force"):
        force = law.force(inside, velocity)
        force = jnp.maximum(force, 0.0) if end_of(law) == "zero-force" else force
        return jnp.where(touching, force, 0.0), jnp.where(touching, overlap, 0.0)
    loading = overlap >= memory
    unloading = touching & ~loading
    # where nothing unloads any peak serves, if slopes there are finite
    peak = jnp.where(unloading, memory, jnp.maximum(inside, 1e-3 * law.contact.radius))
    kink = elastic_limit(law)
    # the impact that reaches this largest overlap: its velocity, and (ε/ε_p)²
    middle = safe_sqrt(jnp.minimum(kink, peak))
    work = loading_work(law, 0.0, middle) + loading_work(law, middle, jnp.sqrt(peak))
    speed = jnp.sqrt(2 * work / law.contact.mass)
    hit = restitution(law, speed)
    rebounds = hit.plastic_coefficient > 0
    plastic = jnp.where(rebounds, hit.plastic_coefficient, 1.0)
    factor = jnp.where(rebounds, (jnp.minimum(hit.coefficient, 1.0) / plastic) ** 2, 0.0)

    def unloads(overlap):
        return jnp.maximum(unloading_force(law, overlap, peak), 0.0) * factor

    back = unloads(inside)
    if hold is not None:
        slow, fraction = speed < hold, held_fraction(restitution(law, hold).coefficient)
        damped = damped_force(law, law.loading_force, inside, velocity, fraction)
        again = damped_force(law, unloads, inside, jnp.maximum(velocity, 0.0), fraction)
        back = jnp.where(slow, damped, again)
    force = jnp.where(loading, law.loading_force(inside), back)
    kept = jnp.where(touching, jnp.maximum(overlap, memory), 0.0)
    return jnp.where(touching, force, 0.0), kept
