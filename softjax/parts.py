"""What a rate-independent collision is put together from, whichever route computes it."""

import math
from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool

from softjax._search import Reach, reach
from softjax.laws.reduced import ReducedClosedForm, ReducedRateIndependent
from softjax.release import Release


class Peak(NamedTuple):
    """The end of loading.

    Attributes:
        overlap: x_m; where there is no answer that of another collision, so that all that follows
            from it is a number.
        velocity: y of the collision that this is the peak of.
        end: where the loading force vanishes, 0 where it never does.
        turns: whether the bodies come to rest at all.
        solved: whether the solver got there.
        error: of the impact's energy, relative to it.
        time: since touch; None where it was not asked for.
    """

    overlap: Array
    velocity: Array
    end: Array
    turns: Bool[Array, "..."]
    solved: Bool[Array, "..."]
    error: Array
    time: Array | None = None


class Rebound(NamedTuple):
    """The end of unloading: the part ε_p² of the energy that is given back, or the time it took."""

    value: Array
    solved: Bool[Array, "..."]
    error: Array


class Pieces(NamedTuple):
    """How one route computes the parts of a collision.

    Attributes:
        loading: the peak of (law, y), and the time to it where `clock` is true.
        release: the residual overlap of (law, peak overlap).
        energy: ε_p² of (law, peak, release), as a `Rebound`.
        time: from the peak to the end of the contact, likewise.
        gain: how far ε_p² may exceed one by rounding, or by the tolerance.
    """

    loading: Callable[..., Peak]
    release: Callable[[ReducedRateIndependent, Array], Release]
    energy: Callable[[ReducedRateIndependent, Peak, Release], Rebound]
    time: Callable[[ReducedRateIndependent, Peak, Release], Rebound]
    gain: Array | float


def loading_reach(law: ReducedRateIndependent, y: Array) -> Reach:
    """How far loading of one impact comes, roughly."""
    end = jnp.asarray(law.end(), y.dtype)

    def force(x):
        return jnp.where(x <= end, law.loading(x), jnp.nan)

    return reach(force, 0.4 * y * y, y ** (2 / law.work_exponent))


def loading_kinks(law: ReducedRateIndependent, like: Array) -> Array:
    """Where the loading force has kinks, as a vector."""
    limit = law.elastic_limit
    known = isinstance(limit, float | int)
    points = [] if known and (limit == 0 or math.isinf(limit)) else [limit]
    return _vector([*points, *law.breakpoints()], like)


def unloading_kinks(law: ReducedRateIndependent, like: Array) -> Array:
    """Where the unloading force has kinks, as a vector."""
    if isinstance(law, ReducedClosedForm):
        return _vector(law.breakpoints(), like)
    return loading_kinks(law, like)


def _vector(points, like: Array) -> Array:
    if not len(points):
        return jnp.zeros(0, like.dtype)
    stacked = jnp.stack([jnp.asarray(point, like.dtype) for point in points])
    return jnp.where(jnp.isnan(stacked), 0.0, stacked)  # none there
