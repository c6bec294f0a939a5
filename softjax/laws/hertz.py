"""Hertz's elastic contact of two spheres, and the scales of every law built upon it.

H. Hertz, Über die Berührung fester elastischer Körper, J. reine angew. Math. 92, 156 (1882).
"""

import math

import jax.numpy as jnp
from jaxtyping import Array

from softjax.contact import Contact
from softjax.laws.base import RateIndependentLaw, ReducedClosedForm, Scales


class Hertz(RateIndependentLaw):
    """Two elastic spheres: what is stored on loading comes back, ε = 1.

        P = k δ^{3/2},  k = 4/3 E √R,    δ_max = (5 M v²/(4k))^{2/5},    T = 2.943… δ_max/v

    Symbols: P force [N]; δ overlap [m]; k, E, R, M: `contact.stiffness` [N/m^1.5],
    `.youngs_modulus` [Pa], `.radius` [m], `.mass` [kg]; v impact velocity [m/s]; T duration [s].

    Not to be confused with `HertzDashpot` and `ViscoelasticHertz`, which add a damping force to
    this elastic one.

    Attributes:
        contact: the two bodies; their yield strength and limit velocity do not enter.

    Source: Hertz, J. reine angew. Math. 92, 156 (1882).
    Range: smooth bodies, overlaps far below R, velocities far below the speed of sound in them
    and below that of first yield.

    Raises:
        ValueError: naming the field, its value and what is accepted.
    """

    contact: Contact

    def scales(self) -> Scales:
        return hertz_scales(self.contact)

    def reduced(self) -> "ReducedHertz":
        return ReducedHertz()


def hertz_scales(contact: Contact) -> Scales:
    """L = R and V = √(4k/5M) R^{5/4}: units in which Hertz's law is x'' = -(5/4) x^{3/2}.

    First yield is no part of these laws, so that their units cannot be those of yield.
    """
    radius = jnp.asarray(contact.radius)
    # a quotient of roots: the derivative of one by M leaves float32's range at M = 1e-20 kg
    root = radius * jnp.sqrt(radius) / jnp.sqrt(contact.mass)
    return Scales(radius, jnp.sqrt(16 / 15 * contact.youngs_modulus) * root)


class ReducedHertz(ReducedClosedForm):
    """p = x^{3/2} on loading and on unloading: it never leaves the elastic stage."""

    elastic_limit = math.inf

    def loading(self, x: Array) -> Array:
        return x * jnp.sqrt(x)

    def unloading(self, x: Array, peak: Array) -> Array:
        return x * jnp.sqrt(x)

    def loading_work(self, x: Array) -> Array:
        return 0.4 * x * x * jnp.sqrt(x)

    def largest_velocity(self) -> Array:
        return jnp.asarray(jnp.inf)

    def peak(self, y: Array) -> Array:
        return y**0.8

    def release(self, peak: Array) -> tuple[Array, Array, Array]:
        return jnp.zeros_like(peak), peak, self.loading_work(peak)

    def unloading_work(self, peak: Array, recovered: Array) -> Array:
        return self.loading_work(peak) - self.loading_work(peak - recovered)
