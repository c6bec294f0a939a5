"""Powers and quotients that stay numbers, with their derivatives, wherever their arguments may be."""

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array


def safe_power(base: Array, exponent) -> Array:
    """base**exponent for base >= 0, with value and derivatives 0 at base = 0."""
    positive = base > 0
    return jnp.where(positive, jnp.where(positive, base, 1.0) ** exponent, 0.0)


def rough_power(base: Array, exponent: float) -> Array:
    """base**exponent to six digits, for starting values: a third of the cost of the full power.

    A cube root, the other way to it, is a library call for each element, which keeps the whole
    surrounding loop from being vectorised.
    """
    tiny, huge = 1e-37, 1e37
    short = jnp.clip(base, tiny, huge).astype(jnp.float32)
    return jnp.exp2(jnp.float32(exponent) * jnp.log2(short)).astype(base.dtype)


def guessed_power(base: Array, exponent: float) -> Array:
    """base**exponent of base >= 0 in float32, 6 % off at most: its bits are nearly a logarithm.

    The same number however it is compiled: no sum of floats, which could be fused with a product.
    """
    one = 127 * 2**23 - 486_411  # the bits of one, less what makes the largest error least
    bits = lax.bitcast_convert_type(base.astype(jnp.float32), jnp.int32) - one
    bits = (exponent * bits.astype(jnp.float32)).astype(jnp.int32) + one
    return lax.bitcast_convert_type(bits, jnp.float32)


def near_one_root(x: Array, degree: int) -> Array:
    """The `degree`-th root of x by one step of Halley's method from six digits: 13 of them right.

    A third of the cost of a full power; value and derivative converge together. 0 for x <= 0.
    """
    positive = x > 0
    safe = jnp.where(positive, x, 1.0)
    start = lax.stop_gradient(rough_power(safe, 1 / degree))
    power = start**degree
    up, down = degree + 1, degree - 1
    root = start * (down * power + up * safe) / (up * power + down * safe)
    return jnp.where(positive, root, 0.0)


def safe_sqrt(x: Array) -> Array:
    """√x with value and derivatives 0 where x <= 0."""
    positive = x > 0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, x, 1.0)), 0.0)


def power_3_2(x: Array) -> Array:
    """x^{3/2}, the power of Hertz's law, of any array or number; 0 for x <= 0, with derivatives 0.

    By a product and a root: a fraction of the time of `x**1.5`, and never NaN, which the derivative of
    `x * jnp.sqrt(x)` is at zero overlap.
    """
    positive = jnp.maximum(x, 0.0)
    return positive * safe_sqrt(positive)


@jax.custom_jvp
def quotient(a, b) -> Array:
    """a/b, whose derivative takes no b^-2, which leaves float32's range at a mass of 1e-20 kg."""
    return jnp.asarray(a) / b


@quotient.defjvp
def _quotient_jvp(values, tangents):
    (a, b), (change_a, change_b) = values, tangents
    result = quotient(a, b)
    return result, quotient(change_a - result * change_b, b)
