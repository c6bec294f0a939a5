"""One collision from touch to parting: overlap, velocity and force over time."""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, Int

from softjax._numerics import safe_power
from softjax.impact import (
    Impact,
    check_law,
    checked,
    common_precision,
    lifted,
    prepare,
)
from softjax.laws.base import ContactLaw, HardSphereLaw, ReducedRateIndependent
from softjax.restitution import bridge, restitution_parts
from softjax.routes import ODE


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
    -ε_p v. What sound and heat take (Eq. 17) is in ε and in no force. A particle code that
    integrates this force therefore gets ε_p; to get ε, scale the relative velocity at the end of
    the contact by ε/ε_p (`restitution` gives both), or let it rebound with ε v and skip the
    contact.

    Raises:
        ValueError: where concrete arguments make no sense.
    """
    check_law(law)
    if isinstance(law, HardSphereLaw):
        name = type(law).__name__
        raise ValueError(f"`law` must be a law with a force, but {name} is one of hard spheres")
    route = ODE() if route is None else route
    if not isinstance(route, ODE):
        raise ValueError(f"`route` must be ODE(...), which alone has histories, but is {route!r}")
    if isinstance(samples, bool) or not isinstance(samples, int) or samples < 3:
        raise ValueError(f"`samples` must be a whole number >= 3, but is {samples!r}")
    velocity, regime = checked(law, velocity)
    return _collide(*common_precision(law, velocity), samples, route, regime)


@partial(jax.jit, static_argnames=("samples", "route", "regime"))
def _collide(law, velocity, samples, route, regime):
    impact = prepare(law, velocity, regime)
    time, overlap, speed, force = _reduced_history(impact, samples, route, regime)
    coefficient, plastic, _, _, status = restitution_parts(law, velocity, route, regime)
    scales = impact.law.scales()
    ends = (impact.valid & (impact.velocity > 0))[..., None]

    def in_si(part, scale):
        return jnp.where(ends, part * jnp.expand_dims(jnp.asarray(scale), -1), 0.0)

    return History(
        time=in_si(time, scales.time),
        overlap=in_si(overlap, scales.overlap),
        velocity=in_si(speed, scales.velocity),
        force=in_si(force, impact.law.force_scale()),
        coefficient=coefficient,
        plastic_coefficient=plastic,
        status=status,
    )


def _reduced_history(impact: Impact, samples: int, route: ODE, regime: str):
    moving = jnp.where(impact.y > 0, impact.y, 1.0)
    fractions = _fractions(samples, moving.dtype)
    reduced = impact.law.reduced()
    if not isinstance(reduced, ReducedRateIndependent):
        return _moving_history(reduced, moving, fractions, route)  # elastic at rest alone
    from softjax import collision  # diffrax is imported when the ODE is asked for

    elastic = collision.elastic_history(reduced, moving, fractions)
    if regime == "elastic":
        return elastic
    yielding = jnp.where(impact.elastic, 2.0, impact.y)
    plastic = _moving_history(reduced, yielding, fractions, route)
    stays_elastic = impact.elastic[..., None]
    return [jnp.where(stays_elastic, e, p) for e, p in zip(elastic, plastic, strict=True)]


def _moving_history(reduced, y, fractions, route: ODE):
    k = reduced.work_exponent
    y, below = lifted(reduced, y)
    parts = bridge(reduced).history(reduced, y, fractions, route)
    if below is None:
        return parts
    powers = (2 / k - 1, 2 / k, 1.0, 2 - 2 / k)  # of time, overlap, velocity, force
    below = below[..., None]
    return [part * safe_power(below, power) for part, power in zip(parts, powers, strict=True)]


def _fractions(samples: int, dtype) -> tuple[np.ndarray, np.ndarray]:
    """Where loading and unloading are sampled; the peak belongs to loading."""
    on_loading = (samples + 1) // 2
    along = np.linspace(0.0, 1.0, on_loading, dtype=dtype)
    return along, np.linspace(0.0, 1.0, samples - on_loading + 1, dtype=dtype)[1:]
