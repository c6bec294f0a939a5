"""Springs with a dashpot that is set to an ε: a linear one, and Hertz's.

Collisions of dashpots in closed form are functions of Λ = -ln ε of the zero-overlap end alone. A linear
spring's motion is e^{-ξωt} sin(wωt)/w with ξ = Λ/√(π² + Λ²) and w = π/√(π² + Λ²). Over the phase
φ = wωt its overlap is largest at acos ξ = atan(π/Λ); it vanishes at π, the force at twice the former.
"""

import math
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from softjax.contact import Contact
from softjax.fields import Number, Numbers, choice_field, number_field
from softjax.laws._series import series
from softjax.laws.base import RateDependentLaw
from softjax.laws.forces import KnownCollision
from softjax.laws.reduced import (
    ENDS,
    End,
    Reduced,
    ReducedRateDependent,
    Scales,
    hertz_motion,
    hertz_scales_at,
)
from softjax.numerics.powers import quotient, safe_power

# what a dashpot law is set to: no finite damping gives ε = 0
SET_RESTITUTION = ("ε", "-", "coefficient of restitution", "(0, 1]")
RELEASED = 0.799  # acos ξ up to which the zero-force end has a series of its own


class LinearSpringDashpot(RateDependentLaw, final=True):
    """A linear spring and a linear dashpot, set to a given ε: ε is an input.

        P = K δ + 2 ξ √(K M) δ',    ξ = -ln ε/√(π² + ln²ε),    ω0 = √(K/M)

    Where the contact ends, which no textbook agrees on:

        "zero-overlap"  δ = 0: the ε that goes in comes out and T = π/(ω0 √(1 - ξ²)) grows without
                        bound as ε → 0; just before, the force pulls.
        "zero-force"    P = 0, no attraction: with w = √(1 - ξ²) the contact takes
                        T = atan2(2ξw, 2ξ² - 1)/(ω0 w), which tends to 2/ω0 as ε → 0, and gives
                        exp[-(ξ/w) atan2(2ξw, 2ξ² - 1)], more than the ε that goes in.

    Symbols: P force [N]; δ overlap [m], δ' its rate [m/s]; K = `stiffness` [N/m];
    M = `contact.mass` [kg]; ξ fraction of critical damping [-]; ε = `restitution` [-];
    T duration [s].

    Not to be confused with `HertzDashpot`, the same ε with Hertz's spring, whose duration falls
    with the impact velocity; here ε and T are the same at all velocities.

    Attributes:
        contact: the two bodies; only their mass enters (the radius is the unit of length).
        stiffness: K > 0 [N/m].
        restitution: ε in (0, 1] [-] of the "zero-overlap" end; for the other end a measure of
            damping.
        end: "zero-overlap" (default) or "zero-force".

    Source: Cundall and Strack, Géotechnique 29, 47 (1979); Schwager and Pöschel, Granular Matter
    9, 465 (2007).
    Range: an effective law for granular simulations; K is no property of the material.
    """

    contact: Contact
    stiffness: Number = number_field("K", "N/m", "stiffness", within="(0, inf)")
    restitution: Number = number_field(*SET_RESTITUTION)
    end: End = choice_field(*ENDS)

    def scales(self) -> Scales:
        """R, and R ω0."""
        radius = jnp.asarray(self.contact.radius)
        frequency = jnp.sqrt(self.stiffness) / jnp.sqrt(self.contact.mass)
        return Scales(radius, radius * frequency)

    def reduced(self) -> "ReducedLinearDashpot":
        return ReducedLinearDashpot(damping_fraction(self.restitution), self.end)

    def reduced_at(self, velocity: Numbers) -> Reduced:
        """In units of each impact: v/ω0 and v."""
        radius, unit = self.scales()
        scales = Scales(radius * (velocity / unit), jnp.asarray(velocity))
        return Reduced(self.reduced(), scales, jnp.ones_like(scales.overlap))

    def closed_form(self, velocity: Numbers) -> KnownCollision:
        collision = damped(self.restitution, self.end)
        radian = quotient(*self.scales())  # 1/ω0 [s]
        return KnownCollision(
            coefficient=collision.restitution,
            peak_overlap=velocity * radian * collision.peak,
            residual_overlap=velocity * radian * collision.residual,
            duration=radian * collision.end * root(collision.loss) / math.pi,
        )


class ReducedLinearDashpot(ReducedRateDependent):
    """x'' = -x - 2ξ x'."""

    work_exponent = 2.0

    damping: Numbers
    ends_at: End = eqx.field(static=True)

    def dissipative(self, x: Numbers, velocity: Numbers) -> Numbers:
        return 1.6 * self.damping * velocity


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
    """

    contact: Contact
    restitution: Number = number_field(*SET_RESTITUTION)
    end: End = choice_field(*ENDS)

    def reduced(self) -> "ReducedHertzDashpot":
        return ReducedHertzDashpot(damping_fraction(self.restitution), self.end)

    def reduced_at(self, velocity: Numbers) -> Reduced:
        scales = hertz_scales_at(self.contact, velocity)
        return Reduced(self.reduced(), scales, jnp.ones_like(scales.overlap))

    def closed_form(self, velocity: Numbers) -> KnownCollision:
        motion = hertz_motion(self.contact, velocity)
        collision = damped(self.restitution, self.end)
        return KnownCollision(
            coefficient=collision.restitution,
            peak_overlap=motion.overlap * collision.peak**0.8,
            residual_overlap=motion.overlap * safe_power(collision.residual, 0.8),
            duration=motion.time * _duration(collision, self.end),
        )


class ReducedHertzDashpot(ReducedRateDependent):
    """x'' = -(5/4) (x^{3/2} + 2ξ x^{1/4} x')."""

    damping: Numbers
    ends_at: End = eqx.field(static=True)

    def dissipative(self, x: Numbers, velocity: Numbers) -> Numbers:
        return 2 * self.damping * safe_power(x, 0.25) * velocity


def damping_fraction(restitution) -> Numbers:
    """ξ = -ln ε/√(π² + ln²ε), the fraction of critical damping that gives ε [-]."""
    loss = -jnp.log(restitution)
    return loss / jnp.sqrt(math.pi**2 + loss**2)


class Damped(NamedTuple):
    """A collision over v and ω: overlaps over v/ω, phases over wω."""

    loss: Array
    restitution: Array
    peak: Array
    residual: Array
    to_peak: Array
    end: Array


def damped(restitution: Array, end: str) -> Damped:
    """The linear spring's collision, set to ε of the zero-overlap end."""
    loss = _loss(restitution)
    to_peak = jnp.arctan2(math.pi, loss)
    lost = loss / math.pi  # ξ/w
    peak = jnp.exp(-lost * to_peak)
    if end == "zero-overlap":
        whole = jnp.full_like(to_peak, math.pi)
        return Damped(loss, restitution, peak, jnp.zeros_like(peak), to_peak, whole)
    to_zero_force = peak * peak
    residual = 2 * loss * to_zero_force / root(loss)
    return Damped(loss, to_zero_force, peak, residual, to_peak, 2 * to_peak)


@jax.custom_jvp
def _loss(restitution: Array) -> Array:
    """Λ = -ln ε; where squares of its derivative would leave the range of numbers it has none."""
    return -jnp.log(restitution)


@_loss.defjvp
def _loss_jvp(values, tangents):
    (restitution,), (change,) = values, tangents
    moves = restitution > float(jnp.finfo(restitution.dtype).tiny) ** 0.45
    slope = -1 / jnp.where(moves, restitution, 1.0)
    return _loss(restitution), slope * jnp.where(moves, change, 0.0)


def root(loss: Array) -> Array:
    """√(π² + Λ²), π/w."""
    return jnp.sqrt(math.pi**2 + loss * loss)


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
