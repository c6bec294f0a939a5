"""Eq. (17): the losses that are not plastic."""

import jax.numpy as jnp
from jaxtyping import Array

# what laws that contain Eq. (17) declare of its coefficients
SIGMA = ("σ", "-", "coefficient", "[0, inf)")
PSI = ("ψ", "-", "exponent", "(0, inf)")


def sound_and_heat_exponent(velocity, limit_velocity, sigma, psi) -> Array:
    """-ln ε_17 = σ [v/(v_lim - v)]^ψ, Eq. (17) [-].

    Infinite at and above the limit velocity, where it is given as infinity without a gradient;
    0 at v = 0, where its derivative is infinite for ψ < 1 and is given as 0.
    """
    acts = (velocity > 0) & (velocity < limit_velocity)
    moving = jnp.where(acts, velocity, 0.5 * limit_velocity)
    # not a quotient, whose derivative overflows float32 where both velocities are tiny
    ratio = moving * (1 / (limit_velocity - moving))
    # a velocity of 1e-300 is no zero, but its ratio may round to one
    ratio = jnp.maximum(ratio, jnp.finfo(ratio.dtype).tiny)
    exponent = sigma * ratio**psi
    without = jnp.where(velocity > 0, jnp.inf, jnp.zeros_like(exponent))
    return jnp.where(acts, exponent, without)
