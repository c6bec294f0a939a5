"""A law given by its forces in newtons, in the units of one impact.

With Hertz's largest overlap as L and the impact velocity itself as V every impact has y = 1, and
forces and overlaps of the order of one, whatever the size of the bodies and however slow they are.
"""

import math
from collections.abc import Iterable
from dataclasses import replace
from traceback import walk_tb
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import Literal

from softjax.checks import ArgumentError
from softjax.fields import Numbers, combine, numbers_of, partition, shared_leaves
from softjax.laws.reduced import (
    Reduced,
    ReducedRateDependent,
    ReducedRateIndependent,
    Scales,
    hertz_scales,
    hertz_scales_at,
)
from softjax.numerics.powers import quotient

# forces are kept above this power of the smallest number, so that a small part of one is still one
LEAST = 0.75


class KnownCollision(NamedTuple):
    """What a law knows of its collisions; arrays that broadcast against the velocity.

    Attributes:
        coefficient: ε_p of the contact's force, >= 0 [-].
        peak_overlap, residual_overlap: δ_max and δ* [m].
        duration: of the contact [s].
    """

    coefficient: Numbers
    peak_overlap: Numbers
    residual_overlap: Numbers
    duration: Numbers


ANSWERS = {
    "breakpoints": (tuple, "a tuple of numbers"),
    "closed_form": (KnownCollision, "a KnownCollision of numbers"),
}

# methods of a user's law, and of how many overlaps and velocities they are
ANSWERS_ON_LOADING = {"loading_force": 1, "elastic_overlap": 0, "breakpoints": 0}
ANSWERS_ON_UNLOADING = {"unloading_force": 2, "residual_overlap": 1}

NOT_TRACEABLE = (
    jax.errors.ConcretizationTypeError,  # math.exp(overlap), `if overlap > 0`
    jax.errors.TracerArrayConversionError,  # np.exp(overlap)
    jax.errors.NonConcreteBooleanIndexError,  # overlap[overlap > 0]
)
NOT_OF_MANY = (  # the same, of many impacts at once
    "scalar arrays can be converted",  # math.exp(velocity), range(velocity)
    "The truth value of an array",  # `if velocity > 0`
)


def answer(law, method: str, *values: Numbers):
    """The answer of a method of the user's law.

    Raises:
        ValueError: in one line where the method cannot be traced or returns no numbers, with the law,
            the method and what to write instead.
    """
    name = f"`{type(law).__name__}.{method}`"
    try:
        answer = getattr(law, method)(*values)
    except (TypeError, ValueError, IndexError) as error:
        known = isinstance(error, NOT_TRACEABLE) or any(
            words in str(error) for words in NOT_OF_MANY
        )
        if not known:
            raise
        codes = [frame.f_code for frame, _ in walk_tb(error.__traceback__)]
        # the innermost method of the law: a force may call another one
        methods = (
            code.co_name
            for code in reversed(codes)
            if getattr(getattr(type(law), code.co_name, None), "__code__", None) is code
        )
        raise ArgumentError(
            f"`{type(law).__name__}.{next(methods, method)}` must be written with jax.numpy, as JAX traces its values: "
            "jnp.exp in place of math.exp or np.exp, jnp.where in place of `if`"
        ) from error
    if method == "breakpoints" and isinstance(answer, Iterable) and getattr(answer, "ndim", True):
        answer = tuple(answer)
    if answer is None and method == "residual_overlap":
        return None
    kind, accepted = ANSWERS.get(method, (object, "a number"))
    numbers = (answer,) if kind is object else answer
    shape = np.broadcast_shapes(*map(np.shape, [*values, *numbers_of(law).values()]))
    if not (isinstance(answer, kind) and all(is_number(number, shape) for number in numbers)):
        raise ArgumentError(
            f"{name} must return {accepted} for each impact, but returns {described(answer)}"
        )
    return answer


def is_number(value, shape: tuple[int, ...]) -> bool:
    """Whether this is a real number, or an array of these that broadcasts to the shape."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return True
    kinds = (jnp.floating, jnp.integer)
    if not (hasattr(value, "dtype") and any(jnp.issubdtype(value.dtype, k) for k in kinds)):
        return False
    own_shape = np.shape(value)
    return len(own_shape) <= len(shape) and all(
        n in (1, m) for n, m in zip(own_shape[::-1], shape[::-1], strict=False)
    )


def described(value) -> str:
    """What was returned in place of numbers, in a few words."""
    if isinstance(value, tuple):
        return f"({', '.join(map(described, value))})"
    if hasattr(value, "dtype"):
        return f"an array of shape {np.shape(value)} and type {value.dtype}"
    return "None" if value is None else f"a {type(value).__name__}"


class Forces(eqx.Module):
    """A law whose numbers may be traced, apart from what is no number."""

    arrays: Any
    static: Any = eqx.field(static=True)

    @property
    def whole(self):
        return combine(self.arrays, self.static)

    def answer(self, method: str, *values: Numbers):
        return answer(self.whole, method, *values)


class ForcesOfImpact(ReducedRateIndependent):
    """The forces of a rate-independent law over L and (5/4) M V²/L."""

    law: "Forces"
    length: Numbers
    force: Numbers

    def loading(self, x: Numbers) -> Numbers:
        return quotient(self.law.answer("loading_force", x * self.length), self.force)

    def unloading(self, x: Numbers, peak: Numbers) -> Numbers:
        force = self.law.answer("unloading_force", x * self.length, peak * self.length)
        return quotient(force, self.force)

    @property
    def elastic_limit(self) -> Numbers | float:  # type: ignore[override]
        overlap = self.law.answer("elastic_overlap")
        never_or_always = type(overlap) in (float, int) and overlap in (0, math.inf)
        # what is known beforehand is no kink, and so no stage of its own
        return float(overlap) if never_or_always else jnp.asarray(overlap) / self.length

    def breakpoints(self) -> tuple:
        overlaps = self.law.answer("breakpoints")
        return tuple(jnp.asarray(overlap) / self.length for overlap in overlaps)

    def on_loading(self) -> "ForcesOfImpact":
        return replace(self, law=_differentiable(self.law.whole, ANSWERS_ON_LOADING))

    def exponent_at(self, peak: Numbers) -> Numbers:
        return jax.lax.stop_gradient(_exponent(self.loading, peak))

    def residual(self, peak: Numbers) -> Numbers | None:
        overlap = self.law.answer("residual_overlap", peak * self.length)
        return None if overlap is None else jnp.asarray(overlap) / self.length


class ForceOfImpact(ReducedRateDependent):
    """The force of a rate-dependent law over L, V and (5/4) M V²/L."""

    law: "Forces"
    length: Numbers
    velocity: Numbers
    unit: Numbers

    @property
    def ends_at(self) -> str:  # type: ignore[override]
        return self.law.whole.end

    def force(self, x: Numbers, velocity: Numbers) -> Numbers:
        force = self.law.answer("force", x * self.length, velocity * self.velocity)
        return quotient(force, self.unit)

    def elastic(self, x: Numbers) -> Numbers:
        return self.force(x, jnp.zeros_like(x))

    def dissipative(self, x: Numbers, velocity: Numbers) -> Numbers:
        return self.force(x, velocity) - self.elastic(x)

    def exponent_at(self, peak: Numbers) -> Numbers:
        return jax.lax.stop_gradient(_exponent(self.elastic, peak))


def _exponent(force, x: Numbers) -> Numbers:
    """k of a work ∝ x^k, from the slope of the force there."""
    value, slope = jax.jvp(force, (x,), (jnp.ones_like(x),))
    return 1 + jnp.clip(x * slope / value, 0.0, 10.0)


def reduced_by_forces(law, velocity: Numbers) -> Reduced:
    """Impacts of a law in SI.

    The scales are units and no more: nothing depends on the overlap's, which is not differentiated,
    while the velocity's carries what the impact's own velocity moves.
    """
    # below the slowest forces of Hertz's order leave the range of numbers: P_max ∝ v^{6/5}
    hertz = hertz_scales(law.contact)
    force = law.contact.stiffness * hertz.overlap * jnp.sqrt(hertz.overlap)
    least = float(jnp.finfo(velocity.dtype).tiny) ** LEAST
    slowest = jax.lax.stop_gradient(hertz.velocity * (least / force) ** (5 / 6))
    faster = jnp.maximum(velocity, slowest)
    overlap, _ = hertz_scales_at(law.contact, faster)
    scales = Scales(jax.lax.stop_gradient(overlap), faster)
    unit = law.force_scale(scales)
    reduced: ForcesOfImpact | ForceOfImpact
    if hasattr(law, "loading_force"):
        reduced = ForcesOfImpact(
            _differentiable(law, ANSWERS_ON_LOADING | ANSWERS_ON_UNLOADING), scales.overlap, unit
        )
    else:
        acting = _differentiable(law, {"force": 2})
        reduced = ForceOfImpact(acting, scales.overlap, faster, unit)
    return Reduced(reduced, scales, jnp.ones_like(unit), jnp.minimum(velocity / slowest, 1.0))


def _differentiable(law, methods: dict[str, int]) -> Forces:
    """The law without the derivatives of those of its numbers that these methods ignore.

    A mass or a yield strength of which a force says nothing would cost a tangent all the way.
    """
    arrays, static = partition(law)
    leaves, structure = jax.tree.flatten(arrays)
    kinds = [
        jax.ShapeDtypeStruct(jnp.shape(leaf) if shared else (), jnp.result_type(leaf))
        for leaf, shared in zip(leaves, shared_leaves(arrays), strict=True)
    ]
    single = combine(jax.tree.unflatten(structure, kinds), static)
    overlap = jax.ShapeDtypeStruct((), jnp.result_type(law.contact.radius))
    acting: np.ndarray = np.zeros(len(leaves), bool)
    for method, count in methods.items():
        program = eqx.filter_make_jaxpr(answer)(single, method, *[overlap] * count)[0].jaxpr
        used = {v for v in program.outvars if not isinstance(v, Literal)}
        for equation in reversed(program.eqns):
            if not used.isdisjoint(equation.outvars):
                used.update(v for v in equation.invars if not isinstance(v, Literal))
        acting |= [variable in used for variable in program.invars[: len(leaves)]]
    kept = [
        leaf if acts else jax.lax.stop_gradient(leaf)
        for leaf, acts in zip(leaves, acting, strict=True)
    ]
    return Forces(jax.tree.unflatten(structure, kept), static)
