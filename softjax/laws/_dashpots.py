"""Collisions of dashpots in closed form: functions of Λ = -ln ε of the zero-overlap end alone.

A linear spring's motion is e^{-ξωt} sin(wωt)/w with ξ = Λ/√(π² + Λ²) and w = π/√(π² + Λ²). Over the
phase φ = wωt its overlap is largest at acos ξ = atan(π/Λ); it vanishes at π, the force at twice the
former. Hertz's spring moves so in x^{5/4}, over a time τ of dτ = x^{1/4} dt.
"""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array

from softjax.laws._series import series
from softjax.numerics.powers import safe_power

RELEASED = 0.799  # acos ξ up to which the zero-force end has a series of its own


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
    found = peak * peak
    residual = 2 * loss * found / root(loss)
    return Damped(loss, found, peak, residual, to_peak, 2 * to_peak)


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


def hertz_duration(of: Damped, end: str) -> Array:
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
