"""The coefficient of restitution over impact velocities, by either route."""

from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from softjax import energy
from softjax._large import in_chunks
from softjax._numerics import safe_power, safe_sqrt
from softjax.impact import (
    Impact,
    check_law,
    checked,
    common_precision,
    known_regime,
    lifted,
    prepare,
)
from softjax.laws.base import (
    ContactLaw,
    HardSphereLaw,
    Outcome,
    RateDependentLaw,
    RateIndependentLaw,
    ReducedRateDependent,
    ReducedRateIndependent,
)
from softjax.routes import ODE, EnergyBalance, Route, check_route
from softjax.status import Status


class Restitution(eqx.Module):
    """ε over impact velocities, with what happened in each collision.

    Attributes (arrays of the shape of `velocity`, broadcast against the law's fields):
        coefficient: ε [-].
        plastic_coefficient: ε_p [-], what the contact force alone gives back.
        peak_overlap, residual_overlap: δ_max and δ* [m]; None where they were not asked for.
        status: `Status` flags, one integer per velocity.
        law, velocity, route: what was asked for, arrays as they were given and not copied.
    """

    law: ContactLaw
    velocity: Float[Array, "..."]
    coefficient: Float[Array, "..."]
    plastic_coefficient: Float[Array, "..."]
    peak_overlap: Float[Array, "..."] | None
    residual_overlap: Float[Array, "..."] | None
    status: Int[Array, "..."]
    route: Route = eqx.field(static=True)

    @property
    def duration(self) -> Array:
        """Contact duration [s], computed when asked for.

        0 where there is no contact that ends: at v = 0, without a turning point, on invalid input.
        """
        regime = known_regime(self.law, self.velocity)
        law, velocity = common_precision(self.law, self.velocity)
        return in_chunks(_duration, law, velocity, self.route, regime)

    @property
    def ok(self) -> Array:
        """True where the status is plain or elastic and nothing else."""
        return (self.status == Status.PLAIN) | (self.status == Status.ELASTIC)


def restitution(
    law: ContactLaw,
    velocity: Float[ArrayLike, "..."],
    route: Route | None = None,
    *,
    overlaps: bool = True,
) -> Restitution:
    """Coefficient of restitution of head-on impacts at `velocity`.

    For Zhou's law below yield ε = ε_17(v) (Eq. 17), above it ε² = ε_p² + ε_17(v_cr)² - 1
    (Eq. 16), where ε_p² is the part of the impact energy that the contact force gives back.

    Args:
        law: a contact law, e.g. `Zhou`. Its fields, and those of its contact, are numbers or
            arrays that broadcast against `velocity`: another material, radius or unloading factor
            for each impact.
        velocity: relative impact velocity v >= 0 [m/s], a number or an array of any shape.
        route: `EnergyBalance()` (default; rate-independent laws, exact, by far the cheapest) or
            `ODE(...)` (any law with a force; the equation of motion integrated by diffrax; default
            where the force depends on the velocity).
        overlaps: False leaves the overlaps out, where ε of millions of impacts is all that counts:
            a tenth to a third of the time and almost half of the memory.

    Returns:
        A `Restitution`: `coefficient`, `plastic_coefficient`, `peak_overlap`,
        `residual_overlap` [m], `duration` [s], `status` and `ok`.

    Everything is differentiable, forward and reverse, in the law's fields and the velocity, and
    works under `jax.jit` and `jax.vmap`. Second derivatives: by the energy balance, forward and
    reverse; by the ODE, forward over either.

    Precision is that of the arguments (float64 only after `softjax.enable_x64()`).

    Example:
        >>> import softjax as sj
        >>> sj.enable_x64()
        >>> steel = sj.STAINLESS_STEEL
        >>> pair = sj.Contact.between_spheres(steel, steel, 0.0127, 0.0127)
        >>> law = sj.Zhou(pair, chi=1.7944, sigma=3.0432, psi=0.54)
        >>> print(sj.restitution(law, [0.1, 1.0]).coefficient)
        [0.93654476 0.8738557 ]

    Raises:
        ValueError: where concrete arguments make no sense, or the law cannot take the route. Under
            `jit` nothing is raised; the status says `INVALID_INPUT`.
    """
    check_law(law)
    route = _default_route(law) if route is None else check_route(route)
    _check_law_takes(law, route)
    velocity, regime = checked(law, velocity)
    same_law, same_velocity = common_precision(law, velocity)
    parts = in_chunks(restitution_parts, same_law, same_velocity, route, regime, overlaps)
    return Restitution(law, same_velocity, *parts, route)


class SignedRestitution(NamedTuple):
    """ε² with its sign, for searches; arrays of the broadcast shape.

    Attributes:
        squared: rebound energy over impact energy [-]; below 0 where the losses exceed the impact
            energy (`NO_REBOUND`), and differentiable there; 0 where there is no answer.
        status: `Status` flags, one integer per velocity.
    """

    squared: Float[Array, "..."]
    status: Int[Array, "..."]


def signed_restitution(
    law: ContactLaw,
    velocity: Float[ArrayLike, "..."],
    route: Route | None = None,
    *,
    elastic: Bool[ArrayLike, "..."] | None = None,
) -> SignedRestitution:
    """ε² of head-on impacts, signed where nothing rebounds, so that a search finds its way back.

    Args:
        law, velocity, route: as for `restitution`.
        elastic: the branch on which each impact is held, True the elastic one, whatever its
            velocity; impacts held on the yielding branch below yield are taken at yield. None: as
            the law has it. For laws whose ε jumps at yield (`jumps_at_yield`), while a search moves
            what yield depends on. Laws without an elastic stage take no notice.

    Raises:
        ValueError: as `restitution`.
    """
    check_law(law)
    route = _default_route(law) if route is None else check_route(route)
    _check_law_takes(law, route)
    velocity, regime = checked(law, velocity)
    regime = regime if elastic is None else "mixed"
    return _signed(*common_precision(law, velocity), route, regime, elastic)


@partial(jax.jit, static_argnames=("route", "regime"))
def _signed(law, velocity, route, regime, elastic):
    impact, outcome, squared, status = _solved(law, velocity, route, regime, elastic)
    answered = impact.valid & outcome.turns
    return SignedRestitution(jnp.where(answered, squared, 0.0), status)


def _default_route(law: ContactLaw) -> Route:
    return ODE() if isinstance(law, RateDependentLaw) else EnergyBalance()


def _check_law_takes(law: ContactLaw, route: Route) -> None:
    if isinstance(route, ODE) and isinstance(law, HardSphereLaw):
        raise ValueError(
            f"`route` must be EnergyBalance() for {type(law).__name__}, which has no force to "
            f"integrate, but is {route!r}"
        )
    if isinstance(route, EnergyBalance) and isinstance(law, RateDependentLaw):
        raise ValueError(
            f"`route` must be ODE(...) for {type(law).__name__}, whose force depends on the "
            "velocity, but is EnergyBalance()"
        )


def _outcome(impact: Impact, route: Route, regime: str) -> Outcome:
    if isinstance(impact.law, HardSphereLaw):
        return _rebound_of_hard_spheres(impact)
    reduced = impact.law.reduced()
    elastic = _elastic_outcome(reduced, impact.y)
    if regime == "elastic":
        return elastic
    yielding = jnp.where(impact.elastic, 2.0, impact.y)
    plastic = _collide(reduced, yielding, route)
    if regime == "yielding":
        return plastic
    return jax.tree.map(lambda e, p: jnp.where(impact.elastic, e, p), elastic, plastic)


def _rebound_of_hard_spheres(impact: Impact) -> Outcome:
    squared = impact.law.restitution_squared(impact.velocity)
    squared = jnp.where(impact.elastic, 1.0, squared)  # at rest
    zero = jnp.zeros_like(squared)
    return Outcome(zero, zero, squared, jnp.ones_like(squared, dtype=bool))


def _collide(reduced, y, route: Route) -> Outcome:
    y, below = lifted(reduced, y)
    ode = isinstance(route, ODE)
    outcome = bridge(reduced).collide(reduced, y, route) if ode else energy.collide(reduced, y)
    if below is None:
        return outcome
    shrunk = safe_power(below, 2 / reduced.work_exponent)
    return outcome._replace(peak=outcome.peak * shrunk, residual=outcome.residual * shrunk)


def bridge(reduced):
    """The module that integrates the law; diffrax is imported when the ODE is asked for."""
    from softjax import collision, rate_dependent

    return rate_dependent if isinstance(reduced, ReducedRateDependent) else collision


def _elastic_outcome(reduced, y) -> Outcome:
    return Outcome(
        peak=safe_power(y, 2 / reduced.work_exponent),
        residual=jnp.zeros_like(y),
        plastic_squared=jnp.ones_like(y),
        turns=jnp.ones_like(y, dtype=bool),
    )


@partial(jax.jit, static_argnames=("route", "regime", "overlaps"))
def restitution_parts(law, velocity, route, regime, overlaps=True):
    impact, outcome, squared, status = _solved(law, velocity, route, regime)
    answered = impact.valid & outcome.turns
    length = impact.law.scales().overlap

    def where_answered(x):
        return jnp.where(answered, x, 0.0)

    def in_metres(x):
        # without a turning point the overlap is where the law ends: a number, but no answer
        moving = jnp.where(outcome.turns, x * length, jax.lax.stop_gradient(x * length))
        return jnp.where(impact.valid, moving, 0.0)

    return (
        where_answered(safe_sqrt(squared)),
        where_answered(safe_sqrt(outcome.plastic_squared)),
        in_metres(outcome.peak) if overlaps else None,
        in_metres(outcome.residual) if overlaps else None,
        status,
    )


def _solved(law, velocity, route, regime, branch=None):
    """The impacts, their collisions, ε² of them and the status."""
    impact = prepare(law, velocity, regime, branch)
    outcome = _outcome(impact, route, regime)
    squared, at_limit = impact.law.total_restitution(
        outcome.plastic_squared, impact.velocity, impact.elastic
    )
    return impact, outcome, squared, _status(impact, outcome, squared, at_limit)


def _status(impact: Impact, outcome: Outcome, squared, at_limit) -> Array:
    yields = ~impact.elastic
    answered = yields & outcome.turns
    conditions = {
        Status.ELASTIC: impact.elastic,
        Status.NO_REBOUND: answered & (squared < 0),
        Status.NO_TURNING_POINT: yields & ~outcome.turns,
        Status.ABOVE_LIMIT_VELOCITY: at_limit,
        Status.ZERO_VELOCITY: impact.velocity == 0,
    }
    if isinstance(impact.law, RateIndependentLaw):
        reduced = impact.law.reduced()
        conditions |= {
            Status.NO_RESIDUAL_OVERLAP: answered & ~reduced.releases(outcome.peak),
            Status.BEYOND_EXPANSION: yields & reduced.beyond_expansion(outcome.peak),
            # a dashpot gives no energy back; above 1 it can only be by rounding
            Status.ENERGY_GAIN: answered & (outcome.plastic_squared > 1),
        }
    flags = jnp.zeros(impact.y.shape, jnp.int32)
    for flag, holds in conditions.items():
        flags = flags | jnp.where(holds, jnp.int32(int(flag)), 0)
    return jnp.where(impact.valid, flags, jnp.int32(int(Status.INVALID_INPUT)))


@partial(jax.jit, static_argnames=("route", "regime"))
def _duration(law, velocity, route, regime):
    impact = prepare(law, velocity, regime)
    tau, ends = _reduced_duration(impact, route, regime)
    ends = ends & impact.valid & (impact.velocity > 0)
    return jnp.where(ends, tau * impact.law.scales().time, 0.0)


def _reduced_duration(impact: Impact, route: Route, regime: str):
    if isinstance(impact.law, HardSphereLaw):
        return jnp.zeros_like(impact.y), jnp.ones_like(impact.elastic)
    reduced = impact.law.reduced()
    moving = jnp.where(impact.y > 0, impact.y, 1.0)
    if not isinstance(reduced, ReducedRateIndependent):
        return _plastic_duration(reduced, moving, route)  # elastic at rest alone
    elastic = energy.elastic_duration(reduced, moving)
    if regime == "elastic":
        return elastic, jnp.ones_like(impact.elastic)
    yielding = jnp.where(impact.elastic, 2.0, impact.y)
    plastic, turns = _plastic_duration(reduced, yielding, route)
    return jnp.where(impact.elastic, elastic, plastic), impact.elastic | turns


def _plastic_duration(reduced, y, route: Route):
    y, below = lifted(reduced, y)
    if isinstance(route, ODE):
        time, turns = bridge(reduced).duration(reduced, y, route)
    else:
        outcome = energy.collide(reduced, y)
        time, turns = energy.duration(reduced, y, outcome), outcome.turns
    if below is None:
        return time, turns
    return time * safe_power(below, 2 / reduced.work_exponent - 1), turns
