"""The coefficient of restitution over impact velocities, by either route."""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, Int

from softjax import energy
from softjax._checks import as_real, check, check_broadcast, is_traced
from softjax._numerics import safe_power, safe_sqrt
from softjax.laws.base import ContactLaw, Outcome, RateDependentLaw, RateIndependentLaw
from softjax.routes import ODE, EnergyBalance, Route, check_route
from softjax.status import Status


class Restitution(eqx.Module):
    """ε over impact velocities, with what happened in each collision.

    Attributes (arrays of the shape of `velocity`, broadcast against the law's fields):
        coefficient: ε [-].
        plastic_coefficient: ε_p [-], what the contact force alone gives back.
        peak_overlap, residual_overlap: δ_max and δ* [m].
        status: `Status` flags, one integer per velocity.
        law, velocity, route: what was asked for.
    """

    law: ContactLaw
    velocity: Float[Array, "..."]
    coefficient: Float[Array, "..."]
    plastic_coefficient: Float[Array, "..."]
    peak_overlap: Float[Array, "..."]
    residual_overlap: Float[Array, "..."]
    status: Int[Array, "..."]
    route: Route = eqx.field(static=True)

    @property
    def duration(self) -> Array:
        """Contact duration [s], computed when asked for.

        0 where there is no contact that ends: at v = 0, without a turning point, on invalid input.
        """
        regime = _known_regime(self.law, self.velocity)
        law, velocity = _common_precision(self.law, self.velocity)
        return _duration(law, velocity, self.route, regime)

    @property
    def ok(self) -> Array:
        """True where the status is plain or elastic and nothing else."""
        return (self.status == Status.PLAIN) | (self.status == Status.ELASTIC)


def restitution(
    law: ContactLaw, velocity: Float[ArrayLike, "..."], route: Route | None = None
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
            `ODE(...)` (any law; the equation of motion integrated by diffrax).

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
        [0.8951942  0.78862421]

    Raises:
        ValueError: where concrete arguments make no sense, or the law cannot take the route. Under
            `jit` nothing is raised; the status says `INVALID_INPUT`.
    """
    check_law(law)
    route = EnergyBalance() if route is None else check_route(route)
    _check_law_takes(law, route)
    velocity = check_velocity(law, velocity)
    regime = _known_regime(law, velocity)
    same_law, same_velocity = _common_precision(law, velocity)
    parts = _restitution(same_law, same_velocity, route, regime)
    return Restitution(law, same_velocity, *parts, route)


def check_law(law) -> None:
    if not isinstance(law, ContactLaw):
        raise ValueError(f"`law` must be a contact law such as Zhou(...), but is {law!r}")


def check_velocity(law: ContactLaw, velocity):
    """The velocity as an array or traced value that broadcasts against the law's fields."""
    velocity = as_real(velocity)
    check("velocity", velocity, lambda v: v >= 0, "a finite impact velocity in m/s, zero or more")
    names = _field_names(law)
    check_broadcast({"velocity": velocity} | names)
    return velocity


def _field_names(law: ContactLaw) -> dict[str, object]:
    paths, _ = jax.tree_util.tree_flatten_with_path(law)
    return {str(path[-1]).lstrip("."): leaf for path, leaf in paths}


def _check_law_takes(law: ContactLaw, route: Route) -> None:
    if isinstance(route, EnergyBalance) and not isinstance(law, RateIndependentLaw):
        raise ValueError(
            f"`route` must be ODE(...) for {type(law).__name__}, whose force depends on the "
            "velocity, but is EnergyBalance()"
        )


def _common_precision(law, velocity):
    """All leaves in the precision of the widest, at least float32."""
    leaves, structure = jax.tree.flatten((law, velocity))
    dtype = jnp.result_type(*leaves, jnp.float32)
    if not any(hasattr(leaf, "dtype") for leaf in leaves):
        dtype = jnp.result_type(float)  # Python numbers alone: JAX's own precision
    cast = [_as_dtype(leaf, dtype) for leaf in leaves]
    return jax.tree.unflatten(structure, cast)


def _as_dtype(leaf, dtype):
    if isinstance(leaf, jax.Array):
        return leaf if leaf.dtype == dtype and not leaf.weak_type else jnp.asarray(leaf, dtype)
    return np.asarray(leaf, dtype)


def _known_regime(law: ContactLaw, velocity) -> str:
    """Whether all impacts are known beforehand to stay elastic, or to yield."""
    if not isinstance(law, RateIndependentLaw) or np.size(velocity) == 0:
        return "mixed"
    if any(is_traced(leaf) for leaf in jax.tree.leaves((law, velocity))):
        return "mixed"
    ratio = np.asarray(velocity) / np.asarray(law.scales().velocity)
    limit = _elastic_velocity(law.reduced())
    # a margin of float32's rounding: compiled code decides what is on the edge
    if np.max(ratio) < limit * (1 - 1e-5):
        return "elastic"
    return "yielding" if np.min(ratio) > limit * (1 + 1e-5) else "mixed"


def _elastic_velocity(reduced) -> float:
    return reduced.elastic_limit ** (reduced.work_exponent / 2)


class _Impact(eqx.Module):
    """One batch of impacts in reduced variables, with all invalid ones replaced by harmless."""

    law: ContactLaw
    velocity: Array
    y: Array
    valid: Array
    elastic: Array


def _prepare(law: ContactLaw, velocity: Array, regime: str) -> _Impact:
    law_valid = law.is_valid()
    law = jax.tree.map(lambda leaf: jnp.where(law_valid, leaf, 1.0).astype(leaf.dtype), law)
    scale = law.scales().velocity
    valid = law_valid & jnp.isfinite(velocity) & (velocity >= 0)
    velocity = jnp.where(valid, velocity, 0.5 * scale)
    y = velocity / scale
    if not isinstance(law, RateIndependentLaw):
        elastic = jnp.zeros(y.shape, bool)
    elif regime == "mixed":
        elastic = y <= _elastic_velocity(law.reduced())
    else:
        elastic = jnp.full(y.shape, regime == "elastic")
    return _Impact(law, velocity, y, valid, elastic)


def _outcome(impact: _Impact, route: Route, regime: str) -> Outcome:
    if not isinstance(impact.law, RateIndependentLaw):
        from softjax import collision

        moving = jnp.where(impact.y > 0, impact.y, 1.0)
        return collision.collide_rate_dependent(impact.law.reduced(), moving, route)
    reduced = impact.law.reduced()
    elastic = _elastic_outcome(reduced, impact.y)
    if regime == "elastic":
        return elastic
    yielding = jnp.where(impact.elastic, 2.0, impact.y)
    plastic = _collide(route)(reduced, yielding)
    if regime == "yielding":
        return plastic
    return jax.tree.map(lambda e, p: jnp.where(impact.elastic, e, p), elastic, plastic)


def _collide(route: Route):
    if isinstance(route, ODE):
        from softjax import collision  # diffrax is imported when the ODE is asked for

        return partial(collision.collide, route=route)
    return energy.collide


def _elastic_outcome(reduced, y) -> Outcome:
    return Outcome(
        peak=safe_power(y, 2 / reduced.work_exponent),
        residual=jnp.zeros_like(y),
        plastic_squared=jnp.ones_like(y),
        turns=jnp.ones_like(y, dtype=bool),
    )


@partial(jax.jit, static_argnames=("route", "regime"))
def _restitution(law, velocity, route, regime):
    impact = _prepare(law, velocity, regime)
    outcome = _outcome(impact, route, regime)
    squared, at_limit = impact.law.total_restitution(
        outcome.plastic_squared, impact.velocity, impact.elastic
    )
    answered = impact.valid & outcome.turns
    status = _status(impact, outcome, squared, at_limit)
    length = impact.law.scales().overlap

    def where_answered(x):
        return jnp.where(answered, x, 0.0)

    return (
        where_answered(safe_sqrt(squared)),
        where_answered(safe_sqrt(outcome.plastic_squared)),
        jnp.where(impact.valid, outcome.peak * length, 0.0),
        jnp.where(impact.valid, outcome.residual * length, 0.0),
        status,
    )


def _status(impact: _Impact, outcome: Outcome, squared, at_limit) -> Array:
    yields = ~impact.elastic
    answered = yields & outcome.turns
    conditions = {
        Status.ELASTIC: impact.elastic,
        Status.ENERGY_GAIN: answered & (outcome.plastic_squared > 1),
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
        }
    flags = jnp.zeros(impact.y.shape, jnp.int32)
    for flag, holds in conditions.items():
        flags = flags | jnp.where(holds, jnp.int32(int(flag)), 0)
    return jnp.where(impact.valid, flags, jnp.int32(int(Status.INVALID_INPUT)))


@partial(jax.jit, static_argnames=("route", "regime"))
def _duration(law, velocity, route, regime):
    impact = _prepare(law, velocity, regime)
    tau, ends = _reduced_duration(impact, route, regime)
    ends = ends & impact.valid & (impact.velocity > 0)
    return jnp.where(ends, tau * impact.law.scales().time, 0.0)


def _reduced_duration(impact: _Impact, route: Route, regime: str):
    moving = jnp.where(impact.y > 0, impact.y, 1.0)
    if not isinstance(impact.law, RateIndependentLaw):
        from softjax import collision

        return collision.rate_dependent_duration(impact.law.reduced(), moving, route)
    reduced = impact.law.reduced()
    elastic = energy.elastic_duration(reduced, moving)
    if regime == "elastic":
        return elastic, jnp.ones_like(impact.elastic)
    yielding = jnp.where(impact.elastic, 2.0, impact.y)
    if isinstance(route, ODE):
        from softjax import collision

        plastic, turns = collision.duration(reduced, yielding, route)
    else:
        outcome = energy.collide(reduced, yielding)
        plastic, turns = energy.duration(reduced, yielding, outcome), outcome.turns
    return jnp.where(impact.elastic, elastic, plastic), impact.elastic | turns
