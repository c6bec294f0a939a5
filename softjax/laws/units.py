"""The units of a reduced collision, and those of Hertz's contact."""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from softjax.contact import Contact
from softjax.fields import Numbers
from softjax.numerics.powers import quotient, safe_power


class Scales(NamedTuple):
    """The units of a reduced collision."""

    overlap: Numbers  # L [m]
    velocity: Numbers  # V [m/s]

    @property
    def time(self) -> Numbers:
        """L/V [s]."""
        return quotient(self.overlap, self.velocity)


def hertz_scales(contact: Contact) -> Scales:
    """L = R and V = √(4k/5M) R^{5/4}: units in which Hertz's law is x'' = -(5/4) x^{3/2}.

    First yield is no part of these laws, so that their units cannot be those of yield.
    """
    radius = jnp.asarray(contact.radius)
    # a quotient of roots: the derivative of one by M leaves float32's range at M = 1e-20 kg
    root = radius * jnp.sqrt(radius) / jnp.sqrt(contact.mass)
    return Scales(radius, jnp.sqrt(16 / 15 * contact.youngs_modulus) * root)


class HertzMotion(NamedTuple):
    """Hertz's collisions, for whatever v is a number.

    Attributes:
        overlap: the largest one, L [m].
        pace: (v/V)^{1/5}; the time L/v is R/V over it.
        whole: R and V.
    """

    overlap: Numbers
    pace: Numbers
    whole: Scales

    @property
    def time(self) -> Numbers:
        """L/v [s]."""
        return quotient(self.whole.time, jnp.where(self.pace > 0, self.pace, 1.0))


def hertz_motion(contact: Contact, velocity: Numbers) -> HertzMotion:
    """Of impacts at v [m/s], by one power."""
    whole = hertz_scales(contact)
    pace = _fifth_root(velocity) / _fifth_root(whole.velocity)
    return HertzMotion(whole.overlap * pace**4, pace, whole)


@jax.custom_jvp
def _fifth_root(x: Numbers) -> Numbers:
    """x^{1/5} of x >= 0; where its derivatives would leave the range of numbers they are 0."""
    return safe_power(x, 0.2)


@_fifth_root.defjvp
def _fifth_root_jvp(values, tangents):
    (x,), (change,) = values, tangents
    root = _fifth_root(x)
    # second derivatives of times meet x^{-2.2}
    moves = x > float(jnp.finfo(x.dtype).tiny) ** 0.4
    slope = quotient(0.2 * jnp.where(moves, root, 1.0), jnp.where(moves, x, 1.0))
    return root, slope * jnp.where(moves, change, 0.0)


def hertz_scales_at(contact: Contact, velocity) -> Scales:
    """V = v and L the largest overlap of Hertz's collision at v > 0: every impact in units of its own.

    Where a law knows no scale, neither the slowest impact nor the fastest leaves a number's range.
    """
    whole = hertz_scales(contact)
    return Scales(whole.overlap * (velocity / whole.velocity) ** 0.8, jnp.asarray(velocity))
