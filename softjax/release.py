"""Where unloading ends: the residual overlap of one impact, and how it moves."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from softjax._search import last_zero
from softjax.laws.reduced import ReducedRateIndependent

Search = Callable[[ReducedRateIndependent, Array], "Release"]

JUMP = 1e-3  # of the peak force: what is left of a force that vanishes there, but for a jump
STRAIGHT = 1e-3  # a force that falls by less than this share of its mean slope has none at its zero


class Release(NamedTuple):
    """The end of unloading.

    Attributes:
        residual: x*; 0 where the force stays positive down to zero overlap.
        recovered: x_m - x*.
        released: whether x* is positive.
        clean: whether its derivative is known: not where the force jumps to zero.
        work: what is given back from the peak to there, of a law that knows it.
    """

    residual: Array
    recovered: Array
    released: Bool[Array, "..."]
    clean: Bool[Array, "..."]
    work: Array | None = None


def release(law: ReducedRateIndependent, peak: Array, search: Search) -> Release:
    """The residual overlap as the law knows it, else by `search`: the zero of its unloading force."""
    residual = law.residual(peak)
    if residual is None:
        return as_told(law, peak, search(law, peak))
    recovered = law.recovered(peak)
    recovered = peak - residual if recovered is None else recovered
    found = Release(residual, recovered, residual > 0, jnp.ones_like(peak, dtype=bool))
    return as_told(law, peak, found)


def as_told(law: ReducedRateIndependent, peak: Array, found: Release) -> Release:
    """The same where the law itself says whether the unloading force vanishes."""
    says = law.releases(peak)
    released = found.released if says is None else jnp.broadcast_to(says, peak.shape)
    return found._replace(
        residual=jnp.where(released, found.residual, 0.0),
        recovered=jnp.where(released, found.recovered, peak),
        released=released,
        clean=found.clean | ~released,
    )


def searched(law: ReducedRateIndependent, peak: Array) -> Release:
    """The last zero of the unloading force of one impact, whatever its power there."""
    leaves, structure = jax.tree.flatten(law)

    def force(x, recovered, peak, *leaves):
        return jax.tree.unflatten(structure, leaves).unloading_at(x, recovered, peak)

    @jax.custom_jvp
    def root(peak, *leaves):
        zero = last_zero(lambda x, recovered: force(x, recovered, peak, *leaves), peak)
        return zero.x, zero.recovered

    @root.defjvp
    def rule(params, tangents):
        x, recovered = root(*params)
        # where there is none, somewhere else: what is not used must be a number all the same
        found = x > 0
        place = jnp.where(found, x, 0.5 * params[0]), jnp.where(found, recovered, 0.5 * params[0])
        change = jnp.where(found, _motion(force, place, params, tangents), 0.0)
        return (x, recovered), (change, tangents[0] - change)

    x, recovered = root(peak, *leaves)
    left = force(x, recovered, peak, *leaves)
    jumps = left > JUMP * force(peak, jnp.zeros_like(peak), peak, *leaves)
    return Release(x, recovered, x > 0, ~jumps)


def _motion(force, place, params, tangents):
    """The derivative of the zero: of its equation, or where that is flat there, the limit of it."""
    x, recovered = place
    peak, *leaves = params
    direct, slope = _equation(force, x, params, tangents)
    mean = force(peak, jnp.zeros_like(peak), peak, *leaves) / recovered
    step = float(jnp.finfo(x.dtype).eps) ** (1 / 3) * recovered
    beside = [_equation(force, x + k * step, params, tangents)[0] for k in (1, 2, 3)]
    limit = 3 * beside[0] - 3 * beside[1] + beside[2]  # of the parabola through them
    return jnp.where(slope > STRAIGHT * mean, direct, limit)


def _equation(force, x, params, tangents):
    """-(dF/dp · dp)/(dF/dx) at x, and dF/dx."""
    at = lambda x, peak, *leaves: force(x, peak - x, peak, *leaves)  # noqa: E731
    _, slope = jax.jvp(lambda x: at(x, *params), (x,), (jnp.ones_like(x),))
    _, change = jax.jvp(lambda *p: at(x, *p), params, tangents)
    flat = slope == 0
    return jnp.where(flat, 0.0, -change / jnp.where(flat, 1.0, slope)), slope
