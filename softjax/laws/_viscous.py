"""The collision of viscoelastic spheres in closed form: a function of w² alone.

In units of the impact velocity v, of (M v²/k)^{2/5} and of their quotient the motion is

    x'' = -x^{3/2} - w² √x x',  x(0) = 0,  x'(0) = 1,    until x^{3/2} + w² √x x' = 0.

Up to w = 1 what a collision has is a polynomial in w², up to w⁴, and w⁵ times a series in w. Beyond,
logarithms are series in ln w², and from w² = 3e10 on what damping alone does: the bodies come to rest
at (3/(2w²))^{2/3}, creep back at x' = -x/w², and are free after a time that grows as a logarithm.
"""

import math
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array

from softjax.laws._series import series, taylor
from softjax.numerics.powers import safe_sqrt
from softjax.numerics.roots import where_needed

MEDIUM, STRONG = 5.0, 24.0  # ln w² up to which the series go
FREE = 10 / 3 / 1.5 ** (1 / 3)  # d(duration · w^{4/3})/d ln w² where damping is all


class Viscous(NamedTuple):
    """A collision in the units above."""

    restitution: Array
    peak: Array
    residual: Array
    duration: Array


class Damping(NamedTuple):
    """w² where it is weak, 0 elsewhere, and its logarithm where it is strong, 0 elsewhere."""

    weak: Array
    log: Array
    is_strong: Array


def damping(*factors: Array) -> Damping:
    """w² as a product of factors, which may leave the range of numbers where it is strong."""
    still = [jax.lax.stop_gradient(factor) for factor in factors]
    is_strong = math.prod(still[1:], start=still[0]) > 1
    first, *others = factors
    weak = math.prod(others, start=jnp.where(is_strong, 0.0, first))
    # each by itself: of what is the same for all impacts there is one logarithm for all; factors
    # whose squares underflow make no strong damping
    log = sum(jnp.log(jnp.where(f > _least(f) ** 0.49, f, 1.0)) for f in map(jnp.asarray, factors))
    return Damping(weak, jnp.where(is_strong, log, 0.0), is_strong)


def _least(x: Array) -> float:
    return float(jnp.finfo(x.dtype).tiny)


def collision(of: Damping) -> Viscous:
    w_squared, log = of.weak, of.log
    # where its series is not used its derivatives might leave the range of numbers
    tells = w_squared > float(jnp.finfo(w_squared.dtype).eps) ** 2
    w = safe_sqrt(jnp.where(tells, w_squared, 0.0))
    restitution = _logarithm("restitution", log, -5 / 3)
    pick = lambda strong, weak: jnp.where(of.is_strong, strong, weak)  # noqa: E731
    found = pick(jnp.exp(restitution), _weak("restitution", w_squared, w))
    return Viscous(
        restitution=found,
        peak=pick(jnp.exp(_logarithm("peak", log, -2 / 3)), series("weak peak", w_squared)),
        # where the force vanishes, x = -w² x'
        residual=pick(jnp.exp(restitution + log), w_squared * found),
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
    return where_needed(partial(_beyond, part, slope), log > 0, log)


def _beyond(part: str, slope: float, log: Array) -> Array:
    medium, far = log <= MEDIUM, log > STRONG
    first = series(f"medium {part}", jnp.where(medium, log, MEDIUM))
    second = series(f"strong {part}", jnp.where(medium | far, STRONG, log))
    last = second + slope * jnp.where(far, log - STRONG, 0.0)
    return jnp.where(medium, first, last)
