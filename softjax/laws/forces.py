"""A law given by its forces in newtons, in the units of one impact.

With Hertz's largest overlap as L and the impact velocity itself as V every impact has y = 1, and
forces and overlaps of the order of one, whatever the size of the bodies and however slow they are.
"""

import math
from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array

from softjax._dependence import moving
from softjax._numerics import quotient
from softjax.contact import Contact
from softjax.fields import held, released, whole_leaves
from softjax.laws.reduced import Reduced, ReducedRateDependent, ReducedRateIndependent
from softjax.laws.units import Scales, hertz_scales, hertz_scales_at

# forces are kept above this power of the smallest number, so that a small part of one is still one
LEAST = 0.75


NOT_TRACEABLE = (
    jax.errors.ConcretizationTypeError,  # math.exp(overlap), `if overlap > 0`
    jax.errors.TracerArrayConversionError,  # np.exp(overlap)
)
NOT_OF_MANY = "Only scalar arrays can be converted"  # math.exp(velocity), of many impacts at once


def asked(law, method: str, *values: Array) -> Array:
    """What a method of one's own law says; in one line where it cannot be traced.

    Raises:
        ValueError: naming the law and the method, and what to write instead.
    """
    try:
        return getattr(released(law), method)(*values)
    except TypeError as error:
        if not (isinstance(error, NOT_TRACEABLE) or NOT_OF_MANY in str(error)):
            raise
        raise ValueError(
            f"`{type(law).__name__}.{method}` must be written with jax.numpy, as JAX traces "
            "its values: jnp.exp in place of math.exp or np.exp, jnp.where in place of `if`"
        ) from error


class ForcesOfImpact(ReducedRateIndependent):
    """The forces of a rate-independent law over L and (5/4) M V²/L."""

    law: "RateIndependentLaw"  # type: ignore[name-defined]
    length: Array
    force: Array

    def loading(self, x: Array) -> Array:
        return quotient(asked(self.law, "loading_force", x * self.length), self.force)

    def unloading(self, x: Array, peak: Array) -> Array:
        force = asked(self.law, "unloading_force", x * self.length, peak * self.length)
        return quotient(force, self.force)

    @property
    def elastic_limit(self) -> Array | float:  # type: ignore[override]
        overlap = asked(self.law, "elastic_overlap")
        never_or_always = type(overlap) in (float, int) and overlap in (0, math.inf)
        # what is known beforehand is no kink, and so no stage of its own
        return float(overlap) if never_or_always else jnp.asarray(overlap) / self.length

    def breakpoints(self) -> tuple:
        overlaps = asked(self.law, "breakpoints")
        return tuple(jnp.asarray(overlap) / self.length for overlap in overlaps)

    def exponent_at(self, peak: Array) -> Array:
        return jax.lax.stop_gradient(_exponent(self.loading, peak))

    def residual(self, peak: Array) -> Array | None:
        overlap = asked(self.law, "residual_overlap", peak * self.length)
        return None if overlap is None else jnp.asarray(overlap) / self.length


class ForceOfImpact(ReducedRateDependent):
    """The force of a rate-dependent law over L, V and (5/4) M V²/L."""

    law: "RateDependentLaw"  # type: ignore[name-defined]
    length: Array
    velocity: Array
    unit: Array

    @property
    def ends_at(self) -> str:  # type: ignore[override]
        return self.law.end

    def force(self, x: Array, velocity: Array) -> Array:
        force = asked(self.law, "force", x * self.length, velocity * self.velocity)
        return quotient(force, self.unit)

    def elastic(self, x: Array) -> Array:
        return self.force(x, jnp.zeros_like(x))

    def dissipative(self, x: Array, velocity: Array) -> Array:
        return self.force(x, velocity) - self.elastic(x)

    def exponent_at(self, peak: Array) -> Array:
        return jax.lax.stop_gradient(_exponent(self.elastic, peak))


def _exponent(force, x: Array) -> Array:
    """k of a work ∝ x^k, from the slope of the force there."""
    pull, slope = jax.jvp(force, (x,), (jnp.ones_like(x),))
    return 1 + jnp.clip(x * slope / pull, 0.0, 10.0)


def reduced_by_forces(law, velocity: Array) -> Reduced:
    """Impacts of a law in SI.

    The scales are units and no more: nothing depends on the overlap's, which is not differentiated,
    while the velocity's carries what the impact's own velocity moves.
    """
    law = held(law)  # of what is no number the programs beneath could make nothing
    slowest = _slowest(law.contact, velocity)
    lifted = jnp.maximum(velocity, slowest)
    overlap, _ = hertz_scales_at(law.contact, lifted)
    scales = Scales(jax.lax.stop_gradient(overlap), lifted)
    unit = law.force_scale(scales)
    if hasattr(law, "loading_force"):
        forces = _still_where_silent(law, _all_that_is_asked)
        reduced = ForcesOfImpact(forces, scales.overlap, unit)
    else:
        force = _still_where_silent(law, lambda law, x: asked(law, "force", x, x))
        reduced = ForceOfImpact(force, scales.overlap, lifted, unit)
    return Reduced(reduced, scales, jnp.ones_like(unit), jnp.minimum(velocity / slowest, 1.0))


def _still_where_silent(law, told: Callable):
    """The law, its numbers that move nothing of what it is asked not differentiated.

    A mass or a yield strength of which a force says nothing would cost a tangent all the way.
    """
    leaves, structure = jax.tree.flatten(law)
    kinds = [
        jax.ShapeDtypeStruct(jnp.shape(leaf) if whole else (), jnp.result_type(leaf))
        for leaf, whole in zip(leaves, whole_leaves(law), strict=True)
    ]
    overlap = jax.ShapeDtypeStruct((), jnp.result_type(law.contact.radius))
    moves = moving(lambda x, *one: told(jax.tree.unflatten(structure, one), x), overlap, *kinds)
    kept = [
        leaf if moved else jax.lax.stop_gradient(leaf)
        for leaf, moved in zip(leaves, moves[1:], strict=True)
    ]
    return jax.tree.unflatten(structure, kept)


def _all_that_is_asked(law, x: Array) -> list:
    ends = asked(law, "elastic_overlap"), asked(law, "residual_overlap", x)
    forces = asked(law, "loading_force", x), asked(law, "unloading_force", x, x)
    return [*forces, *asked(law, "breakpoints"), *(end for end in ends if end is not None)]


def _slowest(contact: Contact, velocity: Array) -> Array:
    """The velocity [m/s] below which forces of Hertz's order leave the range of numbers."""
    scales = hertz_scales(contact)
    force = contact.stiffness * scales.overlap * jnp.sqrt(scales.overlap)
    least = float(jnp.finfo(velocity.dtype).tiny) ** LEAST
    # P_max ∝ v^{6/5}
    return jax.lax.stop_gradient(scales.velocity * (least / force) ** (5 / 6))
