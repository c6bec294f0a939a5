"""One collision from touch to parting: overlap, velocity and force over time."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, Int

from softjax.checks import ArgumentError, standard_promotion
from softjax.compiling import batched
from softjax.engine.energy import elastic_duration
from softjax.engine.impact import (
    Impact,
    check_law,
    common_precision,
    elastic_collisions,
    prepare,
    results,
    with_elastic,
)
from softjax.engine.outcome import Requested, Units, slow_units
from softjax.fields import Numbers, checked
from softjax.laws.base import ContactLaw, HardSphereLaw, RateIndependentLaw
from softjax.laws.reduced import Reduced
from softjax.mapping import over_impacts
from softjax.numerics.gauss import gauss_legendre
from softjax.routes import ODE, is_count, si_units

CLOCK_NODES = 32


class History(eqx.Module):
    """Histories of collisions; leading axes as `velocity` was given, the last one over samples.

    Attributes:
        time [s], overlap [m], velocity [m/s] (positive on loading), force [N].
        duration: contact duration [s], the last time.
        coefficient, plastic_coefficient: ε and ε_p [-]; `velocity` ends at -ε_p v.
        status: `Status` flags, one integer per collision.
    """

    time: Float[Array, "... samples"]
    overlap: Float[Array, "... samples"]
    velocity: Float[Array, "... samples"]
    force: Float[Array, "... samples"]
    coefficient: Float[Array, "..."]
    plastic_coefficient: Float[Array, "..."]
    status: Int[Array, "..."]

    @property
    def duration(self) -> Float[Array, "..."]:
        return self.time[..., -1]


@standard_promotion
def collide(
    law: ContactLaw,
    velocity: Float[ArrayLike, "..."],
    samples: int = 201,
    route: ODE | None = None,
) -> History:
    """The history of head-on impacts at `velocity`, by the equation of motion M δ'' = -P (Eq. 3).

    Args:
        law: a contact law, e.g. `Zhou`.
        velocity: relative impact velocity v >= 0 [m/s], a number or an array of any shape.
        samples: points in time, 3 or more; an odd number makes the middle one the largest overlap.
        route: `ODE(...)`; the energy balance has no histories.

    Returns:
        A `History`. Samples are spaced evenly in phase, not in time: half of them over loading and
        half over unloading, however short that is. All zero where a collision has no end (v = 0,
        no turning point, invalid input): the status says so.

    The force–overlap loop encloses the plastic loss ½ M v² (1 - ε_p²), and `velocity` ends at
    -ε_p v. Acoustic and thermal losses (Eq. 17) enter ε, not the force. A particle code that
    integrates this force therefore gets ε_p; to get ε, scale the relative velocity at the end of
    the contact by ε/ε_p (`restitution` gives both), or let it rebound with ε v and skip the
    contact.

    Raises:
        ValueError: where concrete arguments make no sense.
    """
    check_law(law)
    if isinstance(law, HardSphereLaw):
        name = type(law).__name__
        raise ArgumentError(f"`law` must be a law with a force, but {name} is one of hard spheres")
    route = ODE() if route is None else route
    if not isinstance(route, ODE):
        raise ArgumentError(
            f"`route` must be ODE(...), which alone has histories, but is {route!r}"
        )
    if not is_count(samples) or samples < 3:
        raise ArgumentError(f"`samples` must be a whole number >= 3, but is {samples!r}")
    law, velocity = common_precision(law, checked(law, velocity))
    return batched(_history, (law, route.as_argument()), velocity, int(samples), cut=False)


def _history(parameters, velocity, samples):
    law, route = parameters
    impact = prepare(law, velocity)
    # the peak belongs to loading
    on_loading, dtype = (samples + 1) // 2, impact.velocity.dtype
    along = np.linspace(0.0, 1.0, on_loading, dtype=dtype)
    back = np.linspace(0.0, 1.0, samples - on_loading + 1, dtype=dtype)[1:]
    parts, collision = _samples(impact, (along, back), route)
    coefficient, plastic, _, _, status = results(impact, collision, Requested())
    shown = impact.valid & (impact.velocity > 0) & collision.answered
    time, overlap, speed, force = (jnp.where(shown[..., None], part, 0.0) for part in parts)
    return History(time, overlap, speed, force, coefficient, plastic, status)


def _samples(impact: Impact, fractions, route: ODE):
    """Time, overlap, velocity and force in SI at shares of the way, and the collisions they are of."""
    from softjax.engine import motion  # diffrax is imported when it is used

    law = impact.law
    independent = isinstance(law, RateIndependentLaw)
    if independent:
        scales, exponent = law.elastic_scales()
        moving = jnp.where(impact.velocity > 0, impact.velocity, scales.velocity)
        samples = _elastic(exponent, moving / scales.velocity, fractions)
        elastic = _in(si_units(law, Reduced(None, scales, moving)), samples)
        if law.never_yields:
            return elastic, elastic_collisions(impact, clock=False, force=False)
    history = motion.history if independent else motion.damped_history

    def single(law, y, speed_ratio, route):
        collision, samples = history(law, y, route, fractions)
        if speed_ratio is None:
            return collision, samples
        units = slow_units(law, collision, speed_ratio)
        return collision.scaled(units), _in(units, samples)

    impacts = law.reduced_at(impact.acting)
    batch = impacts.law, impacts.y, impacts.speed_ratio, route
    collision, samples = over_impacts(single, batch, forward=True)
    units = si_units(law, impacts)
    collision, parts = collision.scaled(units), _in(units, samples)
    if independent:
        stays_elastic = impact.elastic[..., None]
        parts = [jnp.where(stays_elastic, e, p) for e, p in zip(elastic, parts, strict=True)]
    return parts, with_elastic(impact, collision)


def _elastic(exponent: float, y: Numbers, fractions: tuple[np.ndarray, np.ndarray]):
    """Samples of collisions that stay elastic, over 1 - η on loading, √x being 1 - η² of its peak."""
    m, (along, back) = round(2 * exponent), fractions
    share = np.concatenate([along, 1 - back])
    node, weight = gauss_legendre(CLOCK_NODES)
    width: np.ndarray = share.astype(np.float64)
    between = 1 - np.square(1 - np.outer(width, 1 - node))
    clock = (width * (4 * between / _speed_over_share(between, m) @ weight)).astype(share.dtype)
    reach, y = y[..., None] ** (2 / m), y[..., None]
    s_hat = 1 - np.square(1 - share)
    s, speed = reach * s_hat, y * ((1 - share) * _speed_over_share(s_hat, m))
    time, returns = reach**2 / y * clock, np.arange(len(share)) >= len(along)
    time = jnp.where(returns, elastic_duration(exponent, y) - time, time)
    return time, s**2, jnp.where(returns, -speed, speed), 0.2 * m * s ** (m - 2)


def _speed_over_share(s_hat: np.ndarray, m: int) -> np.ndarray:
    """x'/(η y) = √[(1 - ŝ^m)/(1 - ŝ)], a geometric sum."""
    return np.sqrt(sum(s_hat**j for j in range(m)))


def _in(units: Units, samples) -> list:
    return [part * jnp.expand_dims(unit, -1) for part, unit in zip(samples, units, strict=True)]
