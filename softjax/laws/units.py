"""The units of a reduced collision, and those of Hertz's contact."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array

from softjax._numerics import quotient
from softjax.contact import Contact


class Scales(NamedTuple):
    """The units of a reduced collision."""

    overlap: Array  # L [m]
    velocity: Array  # V [m/s]

    @property
    def time(self) -> Array:
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


def hertz_scales_at(contact: Contact, velocity) -> Scales:
    """V = v and L the largest overlap of Hertz's collision at v > 0: every impact in units of its own.

    Where a law knows no scale, neither the slowest impact nor the fastest leaves a number's range.
    """
    whole = hertz_scales(contact)
    return Scales(whole.overlap * (velocity / whole.velocity) ** 0.8, jnp.asarray(velocity))
