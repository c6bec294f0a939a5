"""A batch of impacts through its law, whatever kind it is, in SI units."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from softjax import assembly, energy
from softjax._numerics import safe_power, where_needed
from softjax.impact import Impact
from softjax.laws.base import HardSphereLaw, RateDependentLaw, RateIndependentLaw
from softjax.laws.forces import asked
from softjax.outcome import SETTLED, Outcome
from softjax.routes import ClosedForm, EnergyBalance, Stepping

Taken = EnergyBalance | ClosedForm | Stepping


def collisions(impact: Impact, route: Taken) -> Outcome:
    """Elastic impacts by Hertz's or the law's own power law, the others by the route; in metres."""
    law = impact.law
    if isinstance(law, HardSphereLaw):
        squared = asked(law, "restitution_squared", impact.velocity)
        return _plain(0.0, 0.0, jnp.where(impact.elastic, 1.0, squared))
    if _never_yields(law):
        return _elastic(impact)
    return _merged(impact, _beyond_elastic(impact, route))


def durations(impact: Impact, route: Taken) -> tuple[Array, Bool[Array, "..."]]:
    """Contact durations [s], and whether there is a contact that ends."""
    law, moving = impact.law, jnp.where(impact.velocity > 0, impact.velocity, 1.0)
    if isinstance(law, HardSphereLaw):
        return jnp.zeros_like(moving), jnp.ones_like(impact.elastic)
    if isinstance(route, ClosedForm):
        duration = asked(law, "closed_form", impact.acting).duration
        return jnp.broadcast_to(duration, moving.shape), jnp.ones_like(impact.elastic)
    if isinstance(law, RateDependentLaw):
        reduced = law.impacts(impact.acting)
        time, ends = _rate_dependent().duration(reduced, route)
        return time * reduced.scales.time, ends
    scales, exponent = law.elastic_scales()
    elastic = scales.time * energy.elastic_duration(exponent, moving / scales.velocity)
    if _never_yields(law):
        return elastic, jnp.ones_like(impact.elastic)
    reduced = law.impacts(impact.acting)
    time, ends = assembly.duration(reduced, route)
    time = time * reduced.scales.time
    return jnp.where(impact.elastic, elastic, time), impact.elastic | ends


def histories(impact: Impact, fractions, route: Stepping):
    """Time, overlap, velocity and force in SI at shares of the way, and the collisions they are of."""
    from softjax import collision, encke  # diffrax is imported when the ODE is asked for

    law = impact.law
    if isinstance(law, RateDependentLaw):
        reduced = law.impacts(impact.acting)
        parts, rebound = _rate_dependent().history(reduced, fractions, route)
        found = _merged(impact, _damped(rebound, reduced.scales.overlap))
        return _in_si(law, reduced.scales, parts), found
    scales, exponent = law.elastic_scales()
    moving = jnp.where(impact.velocity > 0, impact.velocity, scales.velocity)
    elastic = encke.elastic_history(exponent, moving / scales.velocity, fractions)
    elastic = _in_si(law, scales, elastic)
    if _never_yields(law):
        return elastic, _elastic(impact)
    reduced = law.impacts(impact.acting)
    parts, outcome = collision.history(reduced, fractions, route)
    stays_elastic = impact.elastic[..., None]
    both = zip(elastic, _in_si(law, reduced.scales, parts), strict=True)
    found = _merged(impact, _in_metres(outcome, reduced.scales.overlap))
    return [jnp.where(stays_elastic, e, p) for e, p in both], found


def _in_si(law, scales, parts):
    units = scales.time, scales.overlap, scales.velocity, law.force_scale(scales)
    return [part * jnp.expand_dims(unit, -1) for part, unit in zip(parts, units, strict=True)]


def _never_yields(law) -> bool:
    return isinstance(law, RateIndependentLaw) and law.never_yields


def _merged(impact: Impact, by_route: Outcome) -> Outcome:
    elastic = _elastic(impact)
    return jax.tree.map(lambda e, p: jnp.where(impact.elastic, e, p), elastic, by_route)


def _elastic(impact: Impact) -> Outcome:
    return _plain(_elastic_peak(impact), 0.0, jnp.ones_like(impact.velocity))


def _damped(rebound, length: Array) -> Outcome:
    found = _plain(rebound.peak * length, rebound.residual * length, rebound.plastic_squared)
    return found._replace(turns=rebound.turns, solved=rebound.solved, gains=rebound.gains)


def _in_metres(outcome: Outcome, length: Array) -> Outcome:
    return outcome._replace(peak=outcome.peak * length, residual=outcome.residual * length)


def _plain(peak, residual, squared) -> Outcome:
    peak, residual = (
        jnp.broadcast_to(x, squared.shape).astype(squared.dtype) for x in (peak, residual)
    )
    yes = jnp.ones_like(squared, dtype=bool)
    gains = squared > 1 + SETTLED.get(str(squared.dtype), 1e-5)
    return Outcome(peak, residual, squared, yes, jnp.isfinite(squared), yes, yes, ~yes, gains)


def _elastic_peak(impact: Impact) -> Array | float:
    if not isinstance(impact.law, RateIndependentLaw):
        return 0.0  # elastic at rest alone
    scales, exponent = impact.law.elastic_scales()
    y = impact.velocity / scales.velocity
    return scales.overlap * where_needed(lambda y: safe_power(y, 2 / exponent), impact.elastic, y)


def _beyond_elastic(impact: Impact, route: Taken) -> Outcome:
    if isinstance(route, ClosedForm):
        known = asked(impact.law, "closed_form", impact.acting)
        squared = jnp.broadcast_to(jnp.square(known.coefficient), impact.velocity.shape)
        return _plain(known.peak_overlap, known.residual_overlap, squared)
    reduced = impact.law.impacts(impact.acting)
    length = reduced.scales.overlap
    if isinstance(impact.law, RateDependentLaw):
        return _damped(_rate_dependent().collide(reduced, route), length)
    return _in_metres(assembly.collide(reduced, route), length)


def _rate_dependent():
    from softjax import rate_dependent  # diffrax is imported when the ODE is asked for

    return rate_dependent
