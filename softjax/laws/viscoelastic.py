"""Viscoelastic spheres: Hertz's contact of a material with viscosity.

G. Kuwabara and K. Kono, Restitution coefficient in a collision between two spheres, Jpn. J. Appl.
Phys. 26, 1230 (1987); N. V. Brilliantov, F. Spahn, J.-M. Hertzsch and T. Pöschel, Model for
collisions in granular gases, Phys. Rev. E 53, 5382 (1996).
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from softjax.contact import Contact
from softjax.fields import Number, Numbers, number_field
from softjax.laws import _viscous
from softjax.laws.base import KnownCollision, RateDependentLaw
from softjax.laws.reduced import End, Reduced, ReducedRateDependent
from softjax.laws.units import Scales, hertz_motion, hertz_scales_at
from softjax.numerics.powers import quotient, safe_sqrt


class ViscoelasticHertz(RateDependentLaw, final=True):
    """Hertz's force of a material with viscosity: ε falls slowly with velocity from 1.

        P = k (δ^{3/2} + 3/2 A √δ δ')        until P = 0: viscous bodies do not attract

    The one number that matters is w² = β v^{1/5}, β = 3/2 A (k/M)^{2/5}; for slow impacts
    ε = 1 - 1.15345 w² + …

    Symbols: P force [N]; δ overlap [m], δ' its rate [m/s]; k, M: `contact.stiffness` [N/m^1.5]
    (ρ in the sources), `.mass` [kg]; A = `dissipation_time` [s]; v impact velocity [m/s].

    Not to be confused with `HertzDashpot`, whose damping ∝ δ^{1/4} is chosen so that ε is the same
    at all velocities; here the loss follows from the material.

    Attributes:
        contact: the two bodies; their yield strength and limit velocity do not enter.
        dissipation_time: A >= 0 [s], the ratio of the material's viscosities to its moduli.

    Source: Kuwabara and Kono, Jpn. J. Appl. Phys. 26, 1230 (1987); Brilliantov, Spahn, Hertzsch
    and Pöschel, Phys. Rev. E 53, 5382 (1996).
    Range: nothing yields, A far shorter than the contact's duration (w² well below 1), velocities
    far below the speed of sound in the bodies.

    Raises:
        ValueError: naming the field, its value and what is accepted.
    """

    contact: Contact
    dissipation_time: Number = number_field("A", "s", "time", within="[0, inf)")

    end: ClassVar[End] = "zero-force"

    def reduced(self) -> "ReducedViscoelastic":
        return _over(self, self.scales())

    def reduced_at(self, velocity: Numbers) -> Reduced:
        scales = hertz_scales_at(self.contact, velocity)
        return Reduced(_over(self, scales), scales, jnp.ones_like(scales.overlap))

    def closed_form(self, velocity: Numbers) -> KnownCollision:
        motion = hertz_motion(self.contact, velocity)
        # (k/M)^{2/5} v^{1/5} is (5/4)^{2/5} over the time of Hertz's collision
        rate = quotient(motion.whole.velocity, motion.whole.overlap)
        found = _viscous.collision(
            _viscous.damping(1.5 * UNIT * self.dissipation_time, motion.pace, rate)
        )
        return KnownCollision(
            coefficient=found.restitution,
            peak_overlap=motion.overlap / UNIT * found.peak,
            residual_overlap=motion.overlap / UNIT * found.residual,
            duration=motion.time / UNIT * found.duration,
        )


UNIT = 1.25**0.4  # Hertz's largest overlap over (M v²/k)^{2/5}


def _over(law: ViscoelasticHertz, scales: Scales) -> "ReducedViscoelastic":
    return ReducedViscoelastic(quotient(law.dissipation_time, scales.time))


class ReducedViscoelastic(ReducedRateDependent):
    """x'' = -(5/4) (x^{3/2} + 3/2 A √x x'), A in units of time."""

    ends_at: End = eqx.field(static=True, init=False, default="zero-force")

    dissipation: Numbers

    def dissipative(self, x: Numbers, velocity: Numbers) -> Numbers:
        return 1.5 * self.dissipation * safe_sqrt(x) * velocity
