"""Eq. (17) of Zhou (2013) by itself: an explicit ε(v), without a force."""

import math

import jax
import jax.numpy as jnp
from jaxtyping import ArrayLike, Float

from softjax.fields import Flags, Number, Numbers, number_field
from softjax.laws.base import HardSphereLaw
from softjax.numerics.powers import quotient

# what laws that contain Eq. (17) declare of its coefficients
SIGMA = ("σ", "-", "coefficient", "[0, inf)")
PSI = ("ψ", "-", "exponent", "(0, inf)")

NOTHING_LEFT = 1e5  # e^-NOTHING_LEFT is zero in any precision


class EmpiricalRestitution(HardSphereLaw, final=True):
    """ε = exp{-σ [v/(v_lim - v)]^ψ}: a curve through measurements, no law of a force.

    From 1 at rest to 0 at the limit velocity; no overlap, no duration, no history, no contact.

    Symbols: v impact velocity, v_lim = `limit_velocity` [m/s]; σ = `sigma`, ψ = `psi` [-].

    Not to be confused with `Zhou`, which takes from this curve only the acoustic and thermal losses, below
    yield and at it.

    Attributes:
        limit_velocity: v_lim > 0 [m/s], where the curve ends; about √(3Y/ρ).
        sigma, psi: σ >= 0, ψ > 0 [-].

    Source: Zhou, Theor. Appl. Mech. Lett. 3, 021003 (2013), Eq. (17).
    Range: v < v_lim; beyond, ε is 0 and the status says so.
    """

    limit_velocity: Number = number_field("v_lim", "m/s", "velocity", within="(0, inf)")
    sigma: Number = number_field(*SIGMA)
    psi: Number = number_field(*PSI)

    def restitution_squared(self, velocity: Numbers) -> Numbers:
        limit = jnp.asarray(self.limit_velocity)
        return jnp.exp(-2 * loss_exponent(velocity, limit, self.sigma, self.psi))

    def total_restitution(self, plastic_squared, velocity, elastic) -> tuple[Numbers, Flags]:
        """ε², and whether v >= v_lim."""
        return plastic_squared, velocity >= jnp.asarray(self.limit_velocity)


def empirical_restitution(
    velocity: Float[ArrayLike, "..."], limit_velocity: Number, sigma: Number, psi: Number
) -> Numbers:
    """ε_17 = exp{-σ [v/(v_lim - v)]^ψ}, Eq. (17) of Zhou (2013).

    The explicit fit to measurements over all velocities; the model takes from it what acoustic and
    thermal losses cost, below yield and at v_cr (Eq. 16).

    Args:
        velocity: impact velocity v >= 0 [m/s], a number or an array of any shape.
        limit_velocity: v_lim > 0 [m/s].
        sigma, psi: fitted coefficients σ >= 0, ψ > 0 [-].

    Returns:
        The coefficient of restitution; 1 at v = 0, 0 at and above the limit velocity, in both
        cases with gradient 0. Under `jit`, where nothing can be raised, invalid arguments give 0;
        `restitution` of an `EmpiricalRestitution` has a status as well.

    Raises:
        ValueError: naming the argument, its value and what is accepted.
    """
    import softjax  # which is built on laws

    return softjax.restitution(
        EmpiricalRestitution(limit_velocity, sigma, psi), velocity
    ).coefficient


def loss_exponent(velocity, limit_velocity, sigma, psi) -> Numbers:
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
def _log_ratio(velocity, gap) -> Numbers:
    """ln(v/(v_lim - v)), whose derivative takes no square of a tiny velocity."""
    ratio = jnp.asarray(velocity) / gap
    # a velocity of 1e-300 is no zero, but its ratio may round to one
    return jnp.log(jnp.maximum(ratio, jnp.finfo(ratio.dtype).tiny))


@_log_ratio.defjvp
def _log_ratio_jvp(values, tangents):
    change = quotient(tangents[0], values[0]) - quotient(tangents[1], values[1])
    return _log_ratio(*values), change
