"""Hertz's spring with the dashpot that makes ε the same at all velocities.

Y. Tsuji, T. Tanaka and T. Ishida, Lagrangian numerical simulation of plug flow of cohesionless
particles in a horizontal pipe, Powder Technol. 71, 239 (1992); the relation of damping and ε:
D. Antypov and J. A. Elliott, On an analytical solution for the damped Hertzian spring,
Europhys. Lett. 94, 50004 (2011).
"""

import math

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from softjax.checks import as_real, check
from softjax.contact import Contact
from softjax.fields import Number, Numbers, choice_field, number_field
from softjax.laws._series import series
from softjax.laws.base import RateDependentLaw
from softjax.laws.forces import KnownCollision
from softjax.laws.linear_dashpot import (
    SET_RESTITUTION,
    Damped,
    damped,
    damping_fraction,
    root,
)
from softjax.laws.reduced import (
    ENDS,
    End,
    Reduced,
    ReducedRateDependent,
    hertz_motion,
    hertz_scales_at,
)
from softjax.numerics.powers import safe_power

RELEASED = 0.799  # acos ξ up to which the zero-force end has a series of its own


class HertzDashpot(RateDependentLaw, final=True):
    """Hertz's force and a dashpot ∝ δ^{1/4}, set to a given ε: ε is an input.

        P = k δ^{3/2} + α √(M k) δ^{1/4} δ',    α = √5 (-ln ε)/√(π² + ln²ε)

    The substitution δ^{5/4} turns it into the linear dashpot with ξ = α/√5 over another time, so
    that ε depends on no velocity and is that of `LinearSpringDashpot` for either end:

        "zero-overlap"  δ = 0: the ε that goes in comes out; just before, the force pulls.
        "zero-force"    P = 0, no attraction: with w = √(1 - ξ²)
                        exp[-(ξ/w) atan2(2ξw, 2ξ² - 1)], more than the ε that goes in.

    Symbols: P force [N]; δ overlap [m], δ' its rate [m/s]; k, M: `contact.stiffness` [N/m^1.5],
    `.mass` [kg]; α, ξ [-]; ε = `restitution` [-].

    Not to be confused with `ViscoelasticHertz`, whose damping ∝ √δ follows from the material's
    viscosity and makes ε fall with velocity.

    Attributes:
        contact: the two bodies; their yield strength and limit velocity do not enter.
        restitution: ε in (0, 1] [-] of the "zero-overlap" end; for the other end a measure of
            damping.
        end: "zero-overlap" (default) or "zero-force".

    Source: Tsuji, Tanaka and Ishida, Powder Technol. 71, 239 (1992); α(ε): Antypov and Elliott,
    Europhys. Lett. 94, 50004 (2011).
    Range: an effective law for granular simulations; the dashpot is no property of the material.

    Raises:
        ValueError: naming the field, its value and what is accepted.
    """

    contact: Contact
    restitution: Number = number_field(*SET_RESTITUTION)
    end: End = choice_field(*ENDS)

    @classmethod
    def from_damping(
        cls, contact: Contact, alpha: Number, end: End = "zero-overlap"
    ) -> "HertzDashpot":
        """The law of a given dashpot coefficient α in [0, √5) [-], as other programs take it.

        Raises:
            ValueError: naming the argument, its value and what is accepted.
        """
        alpha = as_real(alpha)
        accepted = "a dashpot coefficient in [0, √5)"
        check("alpha", alpha, lambda a: (a >= 0) & (a < math.sqrt(5)), accepted)
        fraction = jnp.asarray(alpha) / math.sqrt(5)
        return cls(contact, jnp.exp(-math.pi * fraction / jnp.sqrt(1 - fraction**2)), end)

    def reduced(self) -> "ReducedHertzDashpot":
        return ReducedHertzDashpot(damping_fraction(self.restitution), self.end)

    def reduced_at(self, velocity: Numbers) -> Reduced:
        scales = hertz_scales_at(self.contact, velocity)
        return Reduced(self.reduced(), scales, jnp.ones_like(scales.overlap))

    def closed_form(self, velocity: Numbers) -> KnownCollision:
        motion = hertz_motion(self.contact, velocity)
        found = damped(self.restitution, self.end)
        return KnownCollision(
            coefficient=found.restitution,
            peak_overlap=motion.overlap * found.peak**0.8,
            residual_overlap=motion.overlap * safe_power(found.residual, 0.8),
            duration=motion.time * _duration(found, self.end),
        )


class ReducedHertzDashpot(ReducedRateDependent):
    """x'' = -(5/4) (x^{3/2} + 2ξ x^{1/4} x')."""

    damping: Numbers
    ends_at: End = eqx.field(static=True)

    def dissipative(self, x: Numbers, velocity: Numbers) -> Numbers:
        return 2 * self.damping * safe_power(x, 0.25) * velocity


def _duration(of: Damped, end: str) -> Array:
    """Of Hertz's spring over its own largest overlap without damping, and v.

    (4/5) w^{-4/5} ∫ e^{Λφ/(5π)} (sin φ)^{-1/5} dφ, up to either end.
    """
    a = of.loss / (5 * math.pi)
    slow = (root(of.loss) / math.pi) ** 0.8 * jnp.exp(of.loss / 5)
    whole = slow * series("falling", a / (a + 8)) * (2 + a) ** -0.8
    if end == "zero-overlap":
        return whole
    strong = of.to_peak < RELEASED
    left = jnp.where(strong, 0.0, 2 * jnp.arctan2(of.loss, math.pi))
    early = whole - safe_power(left, 0.8) * series("unreleased", left)
    return jnp.where(strong, series("released", jnp.where(strong, of.to_peak, 0.0)), early)
