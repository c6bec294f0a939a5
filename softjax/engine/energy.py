"""The energy balance: a rate-independent collision without time integration.

The impact energy is the work of loading up to the largest overlap x_m; what the unloading force
gives back down to the residual overlap x* is the rebound energy (all reduced, see `laws.reduced`):

    W_L(x_m) = (2/5) y²,    p_U(x*; x_m) = 0 or x* = 0,    ε_p² = W_U(x*, x_m)/((2/5) y²)

A law's closed forms are used where it has them (`ReducedClosedForm`); else works are quadratures
between the law's kinks, and roots are found by halving and by Newton's method. The contact's
duration is ∫ dx/|x'| over both branches, of the forces alone.
"""

import math

import jax
import jax.numpy as jnp
from jax import lax

from softjax.engine import outcome
from softjax.engine.outcome import (
    Collision,
    Peak,
    Rebound,
    UnloadingEnd,
    loading_kinks,
    unloading_kinks,
)
from softjax.fields import Numbers
from softjax.laws.reduced import ReducedClosedForm, ReducedRateIndependent
from softjax.mapping import over_impacts
from softjax.numerics.gauss import integrate
from softjax.numerics.powers import quotient, safe_sqrt
from softjax.numerics.quadrature import (
    Integral,
    falling_time,
    integral,
    smooth_falling_time,
)
from softjax.numerics.roots import Reach, implicit_root

MOST_STEPS = 60  # of Newton's method; a handful, but for halving next to a force that vanishes
ELASTIC_NODES = 32


def elastic_duration(exponent: float, y: Numbers) -> Numbers:
    """Duration [L/V] of a collision that stays within one power law: 2.943… x_m/y for Hertz's."""
    half = math.sqrt(math.pi) * math.gamma(1 + 1 / exponent) / math.gamma(0.5 + 1 / exponent)
    return 2 * half * y ** (2 / exponent - 1)


def in_closed_form(
    law: ReducedClosedForm, y, speed_ratio, *, clock=False, force=False
) -> Collision:
    """Collisions beyond the elastic stage of a law that knows them, arrays of impacts."""
    largest = law.largest_velocity()
    turns = y < largest
    # collisions without an answer compute another one, whose gradient is not used
    some = jnp.where(jnp.isfinite(largest), 0.5 * (1 + largest), 2.0)
    velocity = jnp.where(turns, y, lax.stop_gradient(some))
    overlap = law.peak(velocity)
    peak = Peak(overlap, velocity, law.end(), turns)
    residual, recovered, work = law.release(overlap)
    end = outcome.as_stated(law, overlap, UnloadingEnd(residual, recovered, residual > 0))
    back = Rebound(_share(work, velocity))
    if clock:
        back = back._replace(time=_closed_duration(law, peak, end))
    collision = outcome.assemble(law, peak, end, back, _gain(law, y), force)
    return outcome.undo_rescaling(law, collision, speed_ratio)


def by_quadrature(
    law: ReducedRateIndependent, y, speed_ratio, *, clock=False, force=False
) -> Collision:
    """A collision beyond the elastic stage by any law's forces, one impact."""
    peak = _loading(law, y)
    x_m = peak.overlap
    end = outcome.unloading_end(law, x_m, outcome.searched)

    def unloading(r, rest):
        return law.unloading_at(outcome.inside(end.residual, rest), r, x_m)

    work = integral(unloading, end.recovered, x_m - unloading_kinks(law, x_m))
    part = 2.5 / (y * y)
    back = Rebound(part * work.value, error=part * work.error)
    if clock:
        back = back._replace(time=_duration(law, x_m, end.residual, end.recovered))
    collision = outcome.assemble(law, peak, end, back, _gain(law, y), force)
    return outcome.undo_rescaling(law, collision, speed_ratio)


def _gain(law: ReducedRateIndependent, y: Numbers) -> float:
    """How far ε_p² of an elastic collision may exceed one."""
    return law.rounding * float(jnp.finfo(y.dtype).eps)


@jax.custom_jvp
def _share(work, y: Numbers) -> Numbers:
    """work/((2/5) y²), of which neither value nor derivative meets y², which leaves float32's range."""
    return 2.5 * (work * (1 / y)) / y


@_share.defjvp
def _share_jvp(values, tangents):
    (work, y), (gained, faster) = values, tangents
    share = _share(work, y)
    # where work itself is beyond a number's range there is no answer, and no slope either
    slope = 2 * jnp.where(jnp.isfinite(share), share, 0.0)
    return share, quotient(2.5 * quotient(gained, y) - slope * faster, y)


def _closed_duration(law: ReducedClosedForm, peak: Peak, end: UnloadingEnd) -> Numbers:
    """The time [L/V] from touch to the end of the contact."""
    if len(law.breakpoints()):
        batch = (law, peak.overlap, end.residual, end.recovered)
        return over_impacts(_duration, batch, forward=False)
    top = jnp.sqrt(peak.overlap)
    drop = _beyond_limit(law, peak) / (top + law.elastic_limit**0.5)

    def place(eta):
        root = top - drop * eta**2
        return root, 1.25 * law.loading(root * root)

    rise = _elastic_stage(law, peak.velocity) + smooth_falling_time(place, drop)
    return rise + _smooth_fall(law, peak.overlap, end)


def _beyond_limit(law: ReducedClosedForm, peak: Peak) -> Numbers:
    """x_m less the elastic limit; just above yield, where that cancels, from the energy left there."""
    limit, y = law.elastic_limit, peak.velocity
    at_limit = limit ** (law.work_exponent / 2)
    energy = 0.4 * jnp.maximum(y - at_limit, 0.0) * (y + at_limit)
    first = energy / jnp.where(limit > 0, law.loading(jnp.full_like(y, limit)), 1.0)
    middle = energy / law.loading(limit + 0.5 * first)
    near = first < float(jnp.finfo(y.dtype).eps) ** (1 / 3) * limit
    return jnp.where(near, middle, jnp.maximum(peak.overlap - limit, 0.0))


def _smooth_fall(law: ReducedClosedForm, peak: Numbers, end: UnloadingEnd) -> Numbers:
    about_zero = law.powers_about == "zero-overlap"
    top = jnp.sqrt(peak) if about_zero else jnp.sqrt(end.recovered)
    bottom = safe_sqrt(end.residual) if about_zero else jnp.zeros_like(top)
    drop = end.recovered / (top + bottom)

    def place(eta):
        root = top - drop * eta**2
        x = root * root + (0.0 if about_zero else end.residual)
        return root, 1.25 * law.unloading_at(x, drop * eta**2 * (top + root), peak)

    return smooth_falling_time(place, drop)


def _elastic_stage(law: ReducedClosedForm, y: Numbers) -> Numbers:
    """∫_0^{x_y} dx/√(y² - x^k) up to the elastic limit x_y, in √x and from its turning point."""
    k, limit = law.work_exponent, law.elastic_limit
    if limit == 0:
        return jnp.zeros_like(y)
    top = y ** (1 / k)
    # 1 - √x_y over top, without the cancellation just above yield
    start = safe_sqrt(-jnp.expm1(jnp.log1p(-jnp.maximum(y - limit ** (k / 2), 0.0) / y) / k))

    def slowness(eta):
        s = top * (1 - eta**2)
        # √(1 - (1 - η²)^{2k}) without the cancellation at small η
        return 4 * top * eta * s / (y * jnp.sqrt(-jnp.expm1(2 * k * jnp.log1p(-(eta**2)))))

    return integrate(slowness, start, jnp.ones_like(start), ELASTIC_NODES)


def _loading(law: ReducedRateIndependent, y: Numbers) -> Peak:
    energy = 0.4 * y * y
    reach = outcome.loading_reach(law, y)
    enough = work_to(law, reach.top).value >= energy
    turns = jnp.where(jnp.isfinite(reach.end), enough, reach.turns)

    def residual(x, law, energy, _):
        return work_to(law, x).value - energy

    def slope(x, law, *_):
        return jnp.maximum(law.loading(x), 0.0)

    # all are arguments: what is traced must not come in unnoticed
    overlap = implicit_root(_solve, residual, slope)(law, energy, reach._replace(turns=turns))
    # those without an answer take another one, which comes half as far
    overlap = jnp.where(turns, overlap, 0.5 * reach.rough)
    work = work_to(law, lax.stop_gradient(overlap))
    # where no overlap has this work: a hard core takes it within a rounding error of its end
    missed = jnp.abs(work.value - energy)
    return Peak(overlap, y, reach.end, turns, error=(work.error + missed) / energy)


def work_to(law: ReducedRateIndependent, x: Numbers) -> Integral:
    """W_L(x) of one impact."""
    return integral(lambda _, x: law.loading(x), x, x - loading_kinks(law, x))


def _solve(law, energy, reach: Reach):
    """x_m with W_L(x_m) = energy: Newton's method in logarithms, in which a power law is straight, within bounds."""
    settled = float(jnp.finfo(energy.dtype).eps) ** 0.75  # the step after it would be rounding

    def unfinished(state):
        _, _, _, change, count = state
        return (count < MOST_STEPS) & (change > settled)

    def step(state):
        x, low, high, _, count = state
        work, force = work_to(law, x).value, law.loading(x)
        low, high = jnp.where(work < energy, x, low), jnp.where(work < energy, high, x)
        to = x * jnp.exp(jnp.log(energy / work) * work / (x * force))
        new = jnp.where((to >= low) & (to <= high), to, 0.5 * (low + high))
        return new, low, high, jnp.abs(new - x) / new, count + 1

    # no step at all where there is nothing to be found
    change = jnp.where(reach.turns, jnp.ones_like(energy), 0.0)
    start = (jnp.minimum(reach.rough, reach.top), jnp.zeros_like(energy), reach.top, change, 0)
    return lax.while_loop(unfinished, step, start)[0]


def _duration(law: ReducedRateIndependent, peak: Numbers, residual: Numbers, recovered: Numbers):
    """The time [L/V] from touch to the peak, that of a fall from there by the loading force, and on to the end."""

    def unloading(r, rest):
        return 1.25 * law.unloading_at(outcome.inside(residual, rest), r, peak)

    rise = falling_time(lambda _, x: 1.25 * law.loading(x), peak, peak - loading_kinks(law, peak))
    return rise + falling_time(unloading, recovered, peak - unloading_kinks(law, peak))
