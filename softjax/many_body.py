"""A contact law as a pure function of one instant of a contact, for codes that step it."""

from typing import Any

import jax
import jax.numpy as jnp

from softjax.checks import standard_promotion
from softjax.fields import Numbers
from softjax.numerics.gauss import gauss_legendre
from softjax.numerics.powers import safe_sqrt
from softjax.restitution import restitution

NODES, WEIGHTS = gauss_legendre(12)
NEWTON = 6  # steps to ξ, which is then 8e-7 off at ε = 0.1
LEAST = 1e-30  # in place of 0 [m]: forces of laws are of positive overlaps


@standard_promotion
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
    reached = work > 0  # no impact gets beyond the last turning point of an expansion
    speed = jnp.sqrt(2 * jnp.where(reached, work, 1.0) / law.contact.mass)
    speed = jnp.where(reached, speed, jnp.inf)  # which is invalid, and does not rebound
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


def unloading_force(law: Any, overlap: Any, peak: Any) -> Numbers:
    """The unloading force of a law [N]; up to first yield it is Hertz's, as on loading."""
    kink = elastic_limit(law)
    yielded = peak > kink
    safe = jnp.where(yielded, peak, 1.1 * jnp.maximum(kink, peak))  # the branch not taken: a number
    after = law.unloading_force(jnp.minimum(overlap, safe), safe)
    return jnp.where(yielded, after, law.loading_force(overlap))


def elastic_limit(law: Any) -> Any:
    """The overlap up to which unloading is Hertz's, as loading [m]."""
    energy = law.contact.mass * law.elastic_velocity() ** 2 / 2
    return (2.5 * energy / law.contact.stiffness) ** 0.4


def end_of(law: Any) -> str:
    """Where a contact with damping ends: "zero-overlap" or "zero-force"."""
    return getattr(law, "end", None) or law.reduced().ends_at


def damped_force(
    law: Any, spring: Any, overlap: Numbers, velocity: Numbers, fraction: Any
) -> Numbers:
    """A spring with a fraction ξ of critical damping, c = ξ √(2 M (P/δ + dP/dδ)); it does not pull [N]."""
    force, slope = jax.jvp(spring, (overlap,), (jnp.ones_like(overlap),))
    pushes = (force > 0) & (slope > 0)
    stiffness = jnp.where(pushes, force / overlap + slope, 1.0)
    damping = fraction * jnp.sqrt(2 * law.contact.mass * stiffness) * velocity
    return jnp.where(pushes, jnp.maximum(force + damping, 0.0), force)


@jax.jit
def held_fraction(restitution: Numbers) -> Numbers:
    """The fraction ξ of critical damping with which a contact at rest at its peak returns ε of its speed.

    A dashpot c = ξ √(2 M (P/δ + dP/dδ)) and a force P ∝ δⁿ are a linear oscillator that ends where the force
    vanishes: ln ε = -ξ arccos ξ/√(1 - ξ²), by Newton's method from below.
    """
    loss = -jnp.log(jnp.clip(restitution, 1e-3, 1.0))
    node = jnp.asarray(NODES).reshape((-1,) + (1,) * loss.ndim)
    weight = jnp.asarray(WEIGHTS).reshape(node.shape)
    fraction = 2 * loss / jnp.pi
    for _ in range(NEWTON):  # arccos ξ/√(1 - ξ²) is ∫ 2 dt/(t² + 2 ξ t + 1) from 0 to 1
        below = node**2 + 2 * fraction * node + 1
        angle = jnp.sum(2 * weight / below, axis=0)
        slope = angle - fraction * jnp.sum(4 * weight * node / below**2, axis=0)
        fraction = fraction + (loss - fraction * angle) / slope
    return fraction


def loading_work(law: Any, low: Any, high: Numbers) -> Numbers:
    """∫ P dδ on loading [J] between two √δ, in which forces of contacts are smooth: Gauss and Legendre's."""
    shape = (-1,) + (1,) * high.ndim
    root = low + (high - low) * jnp.asarray(NODES).reshape(shape)
    force = 2 * root * law.loading_force(jnp.maximum(root**2, LEAST))
    return (high - low) * jnp.sum(jnp.asarray(WEIGHTS).reshape(shape) * force, axis=0)
