"""Eq. (17): the losses that are not plastic."""

import math

import jax
import jax.numpy as jnp
from jaxtyping import Array

from softjax._numerics import quotient

# what laws that contain Eq. (17) declare of its coefficients
SIGMA = ("σ", "-", "coefficient", "[0, inf)")
PSI = ("ψ", "-", "exponent", "(0, inf)")

NOTHING_LEFT = 1e5  # e^-NOTHING_LEFT is zero in any precision


def sound_and_heat_exponent(velocity, limit_velocity, sigma, psi) -> Array:
    """-ln ε_17 = σ [v/(v_lim - v)]^ψ, Eq. (17) [-].

    Infinite at and above the limit velocity, and just below it where nothing would be left; there
    it is given as infinity without a gradient. 0 at v = 0, where its derivative is infinite for
    ψ < 1 and is given as 0.
    """
    acts = (velocity > 0) & (velocity < limit_velocity)
    moving = jnp.where(acts, velocity, 0.5 * limit_velocity)
    gap = limit_velocity - moving
    steep = psi * _log_ratio(moving, jnp.maximum(gap, jnp.finfo(jnp.result_type(gap)).tiny))
    # a power that overflows has no derivative, and nothing rebounds long before
    most = 0.25 * math.log(jnp.finfo(steep.dtype).max)
    exponent = sigma * jnp.exp(jnp.minimum(steep, most))
    lost = (sigma > 0) & ((steep >= most) | (exponent > NOTHING_LEFT))
    stopped = (velocity >= limit_velocity) | (acts & lost)
    without = jnp.where(stopped, jnp.inf, jnp.zeros_like(exponent))
    return jnp.where(acts & ~lost, exponent, without)


@jax.custom_jvp
def _log_ratio(velocity, gap) -> Array:
    """ln(v/(v_lim - v)), whose derivative takes no square of a tiny velocity."""
    ratio = jnp.asarray(velocity) / gap
    # a velocity of 1e-300 is no zero, but its ratio may round to one
    return jnp.log(jnp.maximum(ratio, jnp.finfo(ratio.dtype).tiny))


@_log_ratio.defjvp
def _log_ratio_jvp(values, tangents):
    change = quotient(tangents[0], values[0]) - quotient(tangents[1], values[1])
    return _log_ratio(*values), change
