"""Validate and normalise a batch of impacts, and compute it: elastic ones here, the others by a route.

The way of one call, `sj.restitution(law, velocity, route)`:

    compiling.batched          pads or cuts the batch; compiles, for its shapes and static fields,
      collisions               this file: `prepare`, a collision of each impact, `results` with ε and the status
        route.collide          takes `law.reduced_at(velocity)`: forces and velocities without units
          in_closed_form       of arrays, where the law knows its peak, release and work; else one impact by
          over_impacts         one `vmap`, in rows, with the ODE's derivatives. One impact is `by_quadrature`, or
            rate_independent   loading by `encke` or stages in `phase`, unloading by `falls`
            rate_dependent     both in `phase`
              bridge.solve     steps by diffrax's methods
            outcome.assemble   makes a `Collision`, flags included, of `Peak`, `UnloadingEnd` and `Rebound`

`collide` gives histories the same way, by `history._history`; `duration` and `peak_force` are computed when used.
"""

import inspect
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from softjax.checks import ArgumentError
from softjax.engine.energy import elastic_duration
from softjax.engine.outcome import Collision, Requested, flagged, stated
from softjax.fields import Flags, Numbers, is_array, is_float, shared_leaves
from softjax.laws.base import ContactLaw, ForceLaw, HardSphereLaw, RateIndependentLaw
from softjax.laws.forces import answer, described, is_number
from softjax.numerics.powers import safe_power, safe_sqrt
from softjax.numerics.roots import compute_if_any
from softjax.status import Status


def check_law(law) -> None:
    if not isinstance(law, ContactLaw):
        raise ArgumentError(f"`law` must be a contact law such as Zhou(...), but is {law!r}")


def common_precision(law, velocity):
    """All numbers in the precision of the widest, at least float32.

    They are copies where they were NumPy's: JAX computes on while its caller may write there again.
    """
    leaves, structure = jax.tree.flatten((law, velocity))
    # a Python number, traced or not, has no precision of its own; alone they take JAX's
    typed = [x for x in leaves if is_float(x) and not getattr(x, "weak_type", False)]
    dtype = jnp.result_type(*typed, jnp.float32) if typed else jnp.result_type(float)

    def cast(leaf, is_shared: bool):
        if isinstance(leaf, jax.Array):
            # a whole number that is one of each impact's would overflow: with it all have a point
            is_integer = jnp.issubdtype(leaf.dtype, jnp.integer)
            keeps_its_kind = not is_float(leaf) and (is_shared or not is_integer)
            as_it_is = keeps_its_kind or (leaf.dtype == dtype and not leaf.weak_type)
            return leaf if as_it_is else jnp.asarray(leaf, dtype)
        # what is shared may hold other things than numbers with a point, which keep their kind
        is_number = is_float(leaf) or type(leaf) is float or not is_shared
        return np.array(leaf, dtype) if is_number else leaf

    return jax.tree.unflatten(structure, map(cast, leaves, shared_leaves((law, velocity))))


class Impact(eqx.Module):
    """One batch of impacts, with all invalid ones replaced by harmless.

    Attributes:
        law, velocity: as requested.
        acting: the velocity [m/s] at which the law beyond its elastic stage is computed, which is
            another one where that is not requested.
        valid, elastic: truth values.
    """

    law: ContactLaw
    velocity: Numbers
    acting: Numbers
    valid: Flags
    elastic: Flags


def prepare(law: ContactLaw, velocity: Numbers) -> Impact:
    """The impacts, each elastic or yielding as the law has it at its velocity."""
    law_valid = law.is_valid()
    law = _harmless(law, law_valid)
    valid = law_valid & jnp.isfinite(velocity) & (velocity >= 0)
    still = jax.tree.map(lambda x: jax.lax.stop_gradient(x) if is_array(x) else x, law)
    some = _some_velocity(still)
    velocity = jnp.where(valid, velocity, 0.25 * some)
    if not isinstance(law, RateIndependentLaw):
        elastic = velocity == 0  # at rest nothing is lost
        return Impact(law, velocity, jnp.where(elastic, some, velocity), valid, elastic)
    if law.never_yields:
        return Impact(law, velocity, velocity, valid, jnp.ones(velocity.shape, bool))
    # not y <= 1: a quotient may be compiled into a product that rounds otherwise
    limit = law.elastic_velocity()
    elastic = velocity <= limit
    return Impact(law, velocity, jnp.where(elastic, some, velocity), valid, elastic)


def _harmless(law: ContactLaw, valid: Flags) -> ContactLaw:
    """The law with invalid parameters replaced by 1, so that masked impacts stay finite."""
    leaves, structure = jax.tree.flatten(law)

    def mended(leaf, is_shared):
        if not is_float(leaf):
            return leaf
        # of what is shared only those numbers: it serves the valid impacts too
        return jnp.where(jnp.isfinite(leaf) if is_shared else valid, leaf, 1.0).astype(leaf.dtype)

    return jax.tree.unflatten(structure, map(mended, leaves, shared_leaves(law)))


def _some_velocity(law: ContactLaw):
    """A velocity [m/s] at which the law is beyond its elastic stage, if it has one beyond."""
    if not isinstance(law, ForceLaw):
        return 1.0
    scale = law.scales().velocity
    if not isinstance(law, RateIndependentLaw):
        return scale
    limit = jnp.asarray(law.elastic_velocity())
    return jnp.where((limit > 0) & jnp.isfinite(limit), 2 * limit, scale)


def collisions(parameters, velocity, output: Callable, requested: Requested):
    """`output(impact, collision, requested)`: elastic impacts by a power law, others by the route; in SI.

    Args:
        parameters: law and route.
        requested: what is computed besides ε, ε_p and the status.
    """
    law, route = parameters
    impact = prepare(law, velocity)
    law = impact.law
    if isinstance(law, RateIndependentLaw) and law.never_yields:
        collision = elastic_collisions(impact, requested.duration, requested.force)
    elif isinstance(law, HardSphereLaw):
        squared = answer(law, "restitution_squared", impact.velocity)
        zero = 0.0 if requested.duration else None, 0.0 if requested.force else None
        collision = with_elastic(impact, stated(squared, 0.0, 0.0, *zero))
    else:
        check_requests(route)
        clock, force = requested.duration, requested.force
        moving = route.collide(law, impact.acting, clock=clock, force=force)
        collision = with_elastic(impact, checked(moving, route, impact.acting, requested))
    return output(impact, collision, requested)


def check_requests(route) -> None:
    """A ValueError where the user's route does not take what is requested."""
    parameters = inspect.signature(route.collide).parameters
    takes_all = any(one.kind is one.VAR_KEYWORD for one in parameters.values())
    if not takes_all and not {"clock", "force"} <= {*parameters}:
        accepted = "(self, law, velocity, *, clock=False, force=False)"
        raise ArgumentError(f"`{type(route).__name__}.collide` must take {accepted}")


def checked(collision, route, velocity: Numbers, requested: Requested) -> Collision:
    """What a route returned; SOLVER_FAILED where it found no number.

    Raises:
        ValueError: in one line where the user's route returns something else than numbers.
    """

    def must_return(accepted, value):
        name = f"`{type(route).__name__}.collide`"
        return ArgumentError(f"{name} must return {accepted}, but returns {described(value)}")

    if not isinstance(collision, Collision):
        raise must_return("an sj.Collision", collision)
    also = ["duration"] * requested.duration + ["force"] * requested.force
    for part in ("energy", "peak", "residual", *also):
        value = getattr(collision, part)
        if not is_number(value, velocity.shape):
            raise must_return(f"a number for each impact as `{part}`", value)
    if not jnp.issubdtype(jnp.result_type(collision.flags), jnp.integer):
        raise must_return("whole numbers as `flags`", collision.flags)
    lost = flagged({Status.SOLVER_FAILED: ~jnp.isfinite(collision.energy)})
    return collision._replace(flags=collision.flags | lost)


def with_elastic(impact: Impact, collision: Collision) -> Collision:
    """Collisions by a route, elastic impacts among them as they are known."""
    elastic = elastic_collisions(
        impact, collision.duration is not None, collision.force is not None
    )
    return jax.tree.map(lambda e, p: jnp.where(impact.elastic, e, p), elastic, collision)


def elastic_collisions(impact: Impact, clock: bool, force: bool) -> Collision:
    """Impacts that give back all they took, where some are; at rest if the law has damping."""
    law, one = impact.law, jnp.ones_like(impact.velocity)
    if not isinstance(law, RateIndependentLaw):
        return stated(one, 0.0, 0.0, 0.0 if clock else None, 0.0 if force else None)
    scales, exponent = law.elastic_scales()
    y = impact.velocity / scales.velocity
    moving = jnp.where(impact.velocity > 0, y, 1.0)

    def power(of: float):
        return compute_if_any(lambda y: safe_power(y, of), impact.elastic, y)

    return stated(
        one,
        scales.overlap * power(2 / exponent),
        0.0,
        scales.time * elastic_duration(exponent, moving) if clock else None,
        law.force_scale(scales) * 0.4 * exponent * power(2 - 2 / exponent) if force else None,
    )


def restitution_and_status(impact: Impact, collision: Collision):
    """ε² and the status."""
    v, elastic = impact.velocity, impact.elastic
    squared, at_limit = impact.law.total_restitution(collision.energy, v, elastic)
    yields = ~impact.elastic
    conditions = {
        Status.ELASTIC: impact.elastic,
        Status.NO_REBOUND: yields & collision.answered & (squared < 0),
        Status.ABOVE_LIMIT_VELOCITY: at_limit,
        Status.ZERO_VELOCITY: impact.velocity == 0,
    }
    flags = flagged(conditions) | jnp.where(yields, collision.flags, 0)
    return squared, jnp.where(impact.valid, flags, jnp.int32(int(Status.INVALID_INPUT)))


def results(impact: Impact, collision: Collision, requested: Requested):
    """ε, ε_p, largest and residual overlap [m] and the status."""
    squared, status = restitution_and_status(impact, collision)
    turns = (collision.flags & int(Status.NO_TURNING_POINT)) == 0
    answered = impact.valid & collision.answered

    def in_metres(x):
        # without a turning point the overlap is where the law ends: a number, but no answer
        return jnp.where(impact.valid, jnp.where(turns, x, jax.lax.stop_gradient(x)), 0.0)

    return (
        jnp.where(answered, safe_sqrt(squared), 0.0),
        jnp.where(answered, safe_sqrt(collision.energy), 0.0),
        in_metres(collision.peak) if requested.overlaps else None,
        in_metres(collision.residual) if requested.overlaps else None,
        status,
    )
