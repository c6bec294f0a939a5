"""Viscoelastic spheres: Hertz's contact of a material with viscosity.

The collision in closed form is a function of w² alone. In units of the impact velocity v, of (M v²/k)^{2/5} and of their quotient the motion is

    x'' = -x^{3/2} - w² √x x',  x(0) = 0,  x'(0) = 1,    until x^{3/2} + w² √x x' = 0.

Up to w = 1 what a collision has is a polynomial in w², up to w⁴, and w⁵ times a series in w. Beyond,
logarithms are series in ln w², and from w² = 3e10 on what damping alone does: the bodies come to rest
at (3/(2w²))^{2/3}, creep back at x' = -x/w², and are free after a time that grows as a logarithm.
"""

import math
from functools import partial
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from softjax.checks import as_real, check
from softjax.contact import Contact
from softjax.fields import Number, Numbers, number_field
from softjax.laws._series import series, taylor
from softjax.laws.base import RateDependentLaw
from softjax.laws.forces import KnownCollision
from softjax.laws.reduced import (
    End,
    Reduced,
    ReducedRateDependent,
    Scales,
    hertz_motion,
    hertz_scales,
    hertz_scales_at,
)
from softjax.numerics.powers import quotient, safe_sqrt
from softjax.numerics.roots import compute_if_any, implicit_root

UNIT = 1.25**0.4  # Hertz's largest overlap over (M v²/k)^{2/5}
MEDIUM, STRONG = 5.0, 24.0  # ln w² up to which the series go
FREE = 10 / 3 / 1.5 ** (1 / 3)  # d(duration · w^{4/3})/d ln w² where damping is all


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
    """

    contact: Contact
    dissipation_time: Number = number_field("A", "s", "time", within="[0, inf)")

    end: ClassVar[End] = "zero-force"

    @classmethod
    def from_restitution(
        cls, contact: Contact, restitution: Number, velocity: Number
    ) -> "ViscoelasticHertz":
        """The law whose impacts at `velocity` [m/s] rebound with `restitution`, as a particle code asks for it.

        A = w²/(3/2 (k/M)^{2/5} v^{1/5}), where w² is the root of the closed form ε(w²) = `restitution`.

        Args:
            contact: the two bodies.
            restitution: ε in (0, 1], a number or an array, one an impact.
            velocity: v > 0 [m/s], as `restitution`.

        Raises:
            ValueError: naming the argument, its value and what is accepted.
        """
        restitution, velocity = as_real(restitution), as_real(velocity, "m/s")
        check("restitution", restitution, lambda e: (e > 0) & (e <= 1), "a number in (0, 1]")
        check("velocity", velocity, lambda v: v > 0, "a positive velocity in m/s")
        whole = hertz_scales(contact)
        # (k/M)^{2/5} v^{1/5} is (5/4)^{2/5} (v/V)^{1/5} over R/V
        rate = (jnp.asarray(velocity) / whole.velocity) ** 0.2
        loss = _damping_of(jnp.asarray(restitution, rate.dtype))
        return cls(contact, loss / (1.5 * UNIT * rate) * whole.time)

    def reduced(self) -> "ReducedViscoelastic":
        return _over(self, self.scales())

    def reduced_at(self, velocity: Numbers) -> Reduced:
        scales = hertz_scales_at(self.contact, velocity)
        return Reduced(_over(self, scales), scales, jnp.ones_like(scales.overlap))

    def closed_form(self, velocity: Numbers) -> KnownCollision:
        motion = hertz_motion(self.contact, velocity)
        # (k/M)^{2/5} v^{1/5} is (5/4)^{2/5} over the time of Hertz's collision
        rate = quotient(motion.whole.velocity, motion.whole.overlap)
        collision = _collision(_damping(1.5 * UNIT * self.dissipation_time, motion.rate, rate))
        return KnownCollision(
            coefficient=collision.coefficient,
            peak_overlap=motion.overlap / UNIT * collision.peak_overlap,
            residual_overlap=motion.overlap / UNIT * collision.residual_overlap,
            duration=motion.time / UNIT * collision.duration,
        )


LOWEST, HIGHEST = -40.0, 460.0  # ln w²: 1 - ε of 1e-17, and ε of 1e-333
HALVINGS = 64


def _bisected(restitution: Array) -> Array:
    """ln w² of ε, which falls with it."""

    def halve(_, ends):
        low, high = ends
        middle = 0.5 * (low + high)
        is_above = _restitution(middle) > restitution
        return jnp.where(is_above, middle, low), jnp.where(is_above, high, middle)

    ends = jnp.full_like(restitution, LOWEST), jnp.full_like(restitution, HIGHEST)
    low, high = jax.lax.fori_loop(0, HALVINGS, halve, ends)
    return 0.5 * (low + high)


def _restitution(log: Array) -> Array:
    """ε of ln w²."""
    weak = jnp.exp(jnp.minimum(log, 0.0))
    return _collision(_damping(weak, jnp.exp(jnp.maximum(log, 0.0)))).coefficient


_log_damping = implicit_root(_bisected, lambda log, restitution: _restitution(log) - restitution)


def _damping_of(restitution: Array) -> Array:
    """w² of ε; 0 of ε = 1."""
    loses = restitution < 1
    w_squared = jnp.exp(_log_damping(jnp.where(loses, restitution, 0.5)))
    return jnp.where(loses, w_squared, 0.0)


def _over(law: ViscoelasticHertz, scales: Scales) -> "ReducedViscoelastic":
    return ReducedViscoelastic(quotient(law.dissipation_time, scales.time))


class ReducedViscoelastic(ReducedRateDependent):
    """x'' = -(5/4) (x^{3/2} + 3/2 A √x x'), A in units of time."""

    ends_at: End = eqx.field(static=True, init=False, default="zero-force")

    dissipation: Numbers

    def dissipative(self, x: Numbers, velocity: Numbers) -> Numbers:
        return 1.5 * self.dissipation * safe_sqrt(x) * velocity


class _Damping(NamedTuple):
    """w² where it is weak, 0 elsewhere, and its logarithm where it is strong, 0 elsewhere."""

    weak: Array
    log: Array
    is_strong: Array


def _damping(*factors: Array) -> _Damping:
    """w² as a product of factors, which may leave the range of numbers where it is strong."""
    still = [jax.lax.stop_gradient(factor) for factor in factors]
    is_strong = math.prod(still[1:], start=still[0]) > 1
    first, *others = factors
    weak = math.prod(others, start=jnp.where(is_strong, 0.0, first))
    # each by itself: of what is the same for all impacts there is one logarithm for all; factors
    # whose squares underflow make no strong damping
    factors = tuple(map(jnp.asarray, factors))
    least = [float(jnp.finfo(factor.dtype).tiny) ** 0.49 for factor in factors]
    log = sum(jnp.log(jnp.where(f > x, f, 1.0)) for f, x in zip(factors, least, strict=True))
    return _Damping(weak, jnp.where(is_strong, log, 0.0), is_strong)


def _collision(of: _Damping) -> KnownCollision:
    """In the units above."""
    w_squared, log = of.weak, of.log
    # where its series is not used its derivatives might leave the range of numbers
    tells = w_squared > float(jnp.finfo(w_squared.dtype).eps) ** 2
    w = safe_sqrt(jnp.where(tells, w_squared, 0.0))
    restitution = _logarithm("restitution", log, -5 / 3)
    pick = lambda strong, weak: jnp.where(of.is_strong, strong, weak)  # noqa: E731
    epsilon = pick(jnp.exp(restitution), _weak("restitution", w_squared, w))
    return KnownCollision(
        coefficient=epsilon,
        peak_overlap=pick(jnp.exp(_logarithm("peak", log, -2 / 3)), series("weak peak", w_squared)),
        # where the force vanishes, x = -w² x'
        residual_overlap=pick(jnp.exp(restitution + log), w_squared * epsilon),
        duration=pick(
            _logarithm("duration", log, FREE) * jnp.exp(-2 / 3 * log),
            _weak("duration", w_squared, w),
        ),
    )


def _weak(part: str, w_squared: Array, w: Array) -> Array:
    """Not of w alone: its derivative by w² is infinite at rest, where the polynomial's is none."""
    one, first, second = taylor(part)
    beyond = second + w * series(f"weak {part}", w)
    return one + w_squared * (first + w_squared * beyond)


def _logarithm(part: str, log: Array, slope: float) -> Array:
    """Of ln w² > 0; beyond the series a straight line. Computed only where some impact needs it."""
    return compute_if_any(partial(_beyond, part, slope), log > 0, log)


def _beyond(part: str, slope: float, log: Array) -> Array:
    medium, far = log <= MEDIUM, log > STRONG
    first = series(f"medium {part}", jnp.where(medium, log, MEDIUM))
    second = series(f"strong {part}", jnp.where(medium | far, STRONG, log))
    last = second + slope * jnp.where(far, log - STRONG, 0.0)
    return jnp.where(medium, first, last)
