"""What a collision comes to: its parts, how a rate-independent one is put together, and where it ends.

A route computes `Peak`, `UnloadingEnd` and `Rebound`; `assemble` makes a `Collision` of them with the hooks
of the law: where loading ends, what remains, whether the unloading force vanishes, its range. Reduced,

    W_L(x_m) = (2/5) y²,    p_U(x*; x_m) = 0,    ε_p² = W_U/((2/5) y²).

A spring p = (4/5) x that unloads along (4/5) (x_m - 4 (x_m - x)) has x_m = y, x* = 3/4 y and ε_p = 1/2:

>>> import jax.numpy as jnp
>>> import softjax as sj
>>> from softjax.engine import outcome
>>> class Spring(sj.ReducedRateIndependent):
...     work_exponent, elastic_limit = 2.0, 0.0
...     def loading(self, x):
...         return 0.8 * x
...     def unloading(self, x, peak):
...         return 0.8 * (peak - 4 * (peak - x))
>>> end = outcome.unloading_end(Spring(), jnp.asarray(2.0), outcome.searched)
>>> peak = outcome.Peak(jnp.asarray(2.0), jnp.asarray(2.0), jnp.inf, jnp.asarray(True))
>>> hit = outcome.assemble(Spring(), peak, end, outcome.Rebound(jnp.asarray(0.25)), gain=0.0)
>>> print(f"{hit.energy} {hit.residual:.3f} {hit.flags}")
0.25 1.500 0
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from softjax.fields import Flags, Numbers
from softjax.laws.reduced import ReducedClosedForm, ReducedRateIndependent
from softjax.numerics.powers import safe_power
from softjax.numerics.roots import Reach, largest, last_zero, mark_for_checkpoint, reach
from softjax.status import Status

# of the peak force: what is left of a force that vanishes there, but for a jump; measured 2e-4 of
# the power 1/4 of the distance, 4e-8 of 1/2, 1e-15 of 1
JUMP = 1e-3
# a force that falls by less than this share of its mean slope has none at its zero; no effect from
# 1e-5 to 0.1 on forces of the powers 1 to 4 of the distance
STRAIGHT = 1e-3
SETTLED = {"float64": 1e-10, "float32": 1e-5}  # of the impact's energy


class Units(NamedTuple):
    """What the parts of a collision, or of its history, are multiplied by."""

    time: Numbers
    overlap: Numbers
    velocity: Numbers
    force: Numbers


class Requested(NamedTuple):
    """What is to be known of a collision besides ε, ε_p and the status."""

    overlaps: bool = False
    duration: bool = False
    force: bool = False


class Collision(NamedTuple):
    """One collision, or arrays of them, whichever route computed it; reduced, or in SI.

    Attributes:
        energy: ε_p², the part of the impact energy that the force gives back.
        peak: the largest overlap.
        residual: the overlap at which the unloading force vanishes; 0 where it does not.
        flags: those of `Status` that a route can know, as integers.
        duration: of the contact, where requested; 0 without an end.
        force: the largest one, where requested.
    """

    energy: Numbers
    peak: Numbers
    residual: Numbers
    flags: Any
    duration: Numbers | None = None
    force: Numbers | None = None

    @property
    def turns(self) -> Flags:
        """Whether the bodies come to rest, and the solver got there: there is a largest overlap and force."""
        return Status.has_peak(self.flags)

    @property
    def answered(self) -> Flags:
        """Whether the bodies come to rest and part again, and the solver got there."""
        return Status.has_end(self.flags)

    def scaled(self, units: Units) -> "Collision":
        """The collision with overlaps, time and force times these units; ε_p² stays."""
        return self._replace(
            peak=self.peak * units.overlap,
            residual=self.residual * units.overlap,
            duration=None if self.duration is None else self.duration * units.time,
            force=None if self.force is None else self.force * units.force,
        )


def flagged(conditions: dict[Status, Flags]):
    """The flags whose conditions hold, as integers."""
    flags = 0
    for flag, holds in conditions.items():
        flags = flags | jnp.where(holds, jnp.int32(int(flag)), 0)
    return flags


def stated(energy: Numbers, peak, residual, duration=None, force=None) -> Collision:
    """Collisions of a law that gives their numbers itself, of the shape of `energy`."""

    def shaped(x):
        return None if x is None else jnp.broadcast_to(x, energy.shape).astype(energy.dtype)

    conditions = {
        Status.ENERGY_GAIN: jnp.isfinite(energy) & (energy > 1 + SETTLED[str(energy.dtype)]),
        Status.SOLVER_FAILED: ~jnp.isfinite(energy),
    }
    return Collision(
        energy, shaped(peak), shaped(residual), flagged(conditions), shaped(duration), shaped(force)
    )


def slow_units(law, collision: Collision, speed_ratio: Numbers) -> Units:
    """Units of slow impacts over those of the faster ones that are computed for them, by the power law near rest.

    Args:
        speed_ratio: y over that of the faster impact.
    """
    answered = collision.answered
    far = safe_power(speed_ratio, 2 / law.exponent_at(jnp.where(answered, collision.peak, 1.0)))
    overlap = jnp.where(answered, far, 1.0)
    return Units(
        far / jnp.where(speed_ratio > 0, speed_ratio, 1.0),
        overlap,
        speed_ratio,
        speed_ratio**2 / overlap,
    )


def undo_rescaling(law, collision: Collision, speed_ratio: Numbers | None) -> Collision:
    """The collision of the impact itself, from that of the faster one."""
    return (
        collision
        if speed_ratio is None
        else collision.scaled(slow_units(law, collision, speed_ratio))
    )


class Peak(NamedTuple):
    """The end of loading.

    Attributes:
        overlap: x_m; where there is no answer that of another collision, so that all that follows
            from it is a number.
        velocity: y of the collision that this is the peak of.
        end: where the loading force vanishes, infinite where it never does.
        turns, solved: whether the bodies come to rest at all, and whether the solver got there.
        error: of the impact's energy, relative to it.
    """

    overlap: Numbers
    velocity: Numbers
    end: Numbers
    turns: Flags
    solved: Flags | bool = True
    error: Numbers | float = 0.0


class UnloadingEnd(NamedTuple):
    """The end of unloading.

    Attributes:
        residual: x*; 0 where the force stays positive down to zero overlap.
        recovered: x_m - x*.
        positive: whether x* is.
        clean: whether its derivative is known: not where the force jumps to zero.
    """

    residual: Numbers
    recovered: Numbers
    positive: Flags
    clean: Flags | bool = True


class Rebound(NamedTuple):
    """What is given back: ε_p², whether it is solved for, its error; the time from touch to the end."""

    energy: Numbers
    solved: Flags | bool = True
    error: Numbers | float = 0.0
    time: Numbers | None = None


def assemble(
    law: ReducedRateIndependent,
    peak: Peak,
    unloaded: UnloadingEnd,
    back: Rebound,
    gain: Numbers | float,
    force: bool = False,
) -> Collision:
    """A collision beyond the elastic stage, from what a route computed and the law's hooks.

    Where there is no turning point the overlaps are where the loading force vanishes, or zero, and
    ε_p is zero, without a gradient; where the solver gave up everything is zero.

    Args:
        gain: how far ε_p² may exceed one by rounding, or by the tolerance.
        force: whether the largest force is requested.
    """
    solved = peak.solved & ((back.solved & jnp.isfinite(back.energy)) | ~peak.turns)
    answered = peak.turns & solved
    end = jax.lax.stop_gradient(jnp.where(solved & jnp.isfinite(peak.end), peak.end, 0.0))
    exact = (peak.error + back.error <= SETTLED[str(peak.velocity.dtype)]) & unloaded.clean
    overlap = jnp.where(answered, peak.overlap, end)
    conditions = {
        Status.NO_RESIDUAL_OVERLAP: answered & ~unloaded.positive,
        Status.ENERGY_GAIN: answered & (back.energy > 1 + gain + back.error),
        Status.BEYOND_EXPANSION: solved & law.beyond_expansion(overlap),
        Status.NO_TURNING_POINT: ~peak.turns,
        Status.SOLVER_FAILED: ~solved,
        Status.INEXACT: answered & ~exact,
    }

    def where_answered(x):
        return jnp.where(answered, x, 0.0)

    return Collision(
        energy=where_answered(back.energy),
        peak=overlap,
        residual=jnp.where(answered, unloaded.residual, end),
        flags=flagged(conditions),
        duration=None if back.time is None else where_answered(back.time),
        force=where_answered(largest(law.loading, peak.overlap)) if force else None,
    )


def damped(
    energy,
    peak,
    residual,
    solved: Flags,
    turns: Flags,
    gain: Numbers,
    endless: Flags | bool = False,
) -> Collision:
    """A collision of a rate-dependent law, from where its branches end; zero where the solver gave up.

    Args:
        energy: ε_p².
        turns: whether the bodies come to rest at all.
        gain: how far ε_p² may exceed one by the tolerance.
        endless: whether the overlap creeps to zero, at which the contact ends, and never gets there.
    """
    endless = solved & endless
    energy = jnp.where(endless, 0.0, energy)
    conditions = {
        Status.NO_END: endless,
        Status.ENERGY_GAIN: solved & (energy > 1 + gain),
        Status.NO_TURNING_POINT: ~(solved | turns),
        Status.SOLVER_FAILED: ~solved,
    }
    energy, peak, residual = (jnp.where(solved, x, 0.0) for x in (energy, peak, residual))
    return Collision(energy, peak, residual, flagged(conditions))


def loading_reach(law: ReducedRateIndependent, y: Numbers) -> Reach:
    """How far loading of one impact comes, roughly."""
    law, y = jax.tree.map(jax.lax.stop_gradient, (law, y))
    end = jnp.asarray(law.end(), y.dtype)

    def force(x):
        return jnp.where(x <= end, law.loading(x), jnp.nan)

    return jax.tree.map(
        mark_for_checkpoint, reach(force, 0.4 * y * y, y ** (2 / law.work_exponent))
    )


def loading_kinks(law: ReducedRateIndependent, like: Numbers) -> Numbers:
    """Where the loading force has kinks, as a vector."""
    limit = law.elastic_limit
    known = isinstance(limit, float | int)
    points = [] if known and (limit == 0 or math.isinf(limit)) else [limit]
    return _vector([*points, *law.breakpoints()], like)


def unloading_kinks(law: ReducedRateIndependent, like: Numbers) -> Numbers:
    """Where the unloading force has kinks, as a vector."""
    if isinstance(law, ReducedClosedForm):
        return _vector(law.breakpoints(), like)
    return loading_kinks(law, like)


def _vector(points, like: Numbers) -> Numbers:
    if not len(points):
        return jnp.zeros(0, like.dtype)
    stacked = jnp.stack([jnp.asarray(point, like.dtype) for point in points])
    return jnp.where(jnp.isnan(stacked), 0.0, stacked)  # none there


def unloading_end(law: ReducedRateIndependent, peak: Numbers, search: Callable) -> UnloadingEnd:
    """The residual overlap as the law knows it, else by `search`: the zero of its unloading force."""
    residual = law.residual(peak)
    if residual is None:
        return as_stated(law, peak, search(law, peak))
    recovered = law.recovered(peak)
    recovered = peak - residual if recovered is None else recovered
    return as_stated(law, peak, UnloadingEnd(residual, recovered, residual > 0))


def as_stated(law: ReducedRateIndependent, peak: Numbers, end: UnloadingEnd) -> UnloadingEnd:
    """The same where the law itself states whether the unloading force vanishes."""
    stated = law.releases(peak)
    positive = end.positive if stated is None else jnp.broadcast_to(stated, peak.shape)
    return UnloadingEnd(
        residual=jnp.where(positive, end.residual, 0.0),
        recovered=jnp.where(positive, end.recovered, peak),
        positive=positive,
        clean=end.clean | ~positive,
    )


def searched(law: ReducedRateIndependent, peak: Numbers) -> UnloadingEnd:
    """The last zero of the unloading force of one impact, whatever its power there."""

    @jax.custom_jvp
    def root(law, peak):
        return last_zero(lambda x, recovered: law.unloading_at(x, recovered, peak), peak)

    @root.defjvp
    def rule(params, tangents):
        x, recovered = map(mark_for_checkpoint, root(*params))
        # where there is none, somewhere else: what is not used must be a number all the same
        exists = x > 0
        half = 0.5 * params[1]
        place = jnp.where(exists, x, half), jnp.where(exists, recovered, half)
        change = jnp.where(exists, _motion(place, params, tangents), 0.0)
        return (x, recovered), (change, tangents[1] - change)

    x, recovered = root(law, peak)
    left = law.unloading_at(x, recovered, peak)
    jumps = left > JUMP * law.unloading_at(peak, jnp.zeros_like(peak), peak)
    return UnloadingEnd(x, recovered, x > 0, ~jumps)


def inside(residual, rest):
    """x* + rest, by more than rounding above x*, below which a force may be no number."""
    return residual + jnp.maximum(rest, 16 * float(jnp.finfo(rest.dtype).eps) * residual)


def _motion(place, params, tangents):
    """The derivative of the zero: of its equation, or where that is flat there, the limit of it."""
    x, recovered = place
    law, peak = params

    def equation(x):
        """-(dF/dp · dp)/(dF/dx) at x, and dF/dx."""
        at = lambda x, law, peak: law.unloading_at(x, peak - x, peak)  # noqa: E731
        _, slope = jax.jvp(lambda x: at(x, *params), (x,), (jnp.ones_like(x),))
        _, change = jax.jvp(lambda *p: at(x, *p), params, tangents)
        flat = slope == 0
        return jnp.where(flat, 0.0, -change / jnp.where(flat, 1.0, slope)), slope

    direct, slope = equation(inside(x, jnp.zeros_like(x)))
    mean = law.unloading_at(peak, jnp.zeros_like(peak), peak) / recovered
    step = float(jnp.finfo(x.dtype).eps) ** (1 / 3) * recovered
    nearby = [equation(x + k * step)[0] for k in (1, 2, 3)]
    limit = 3 * nearby[0] - 3 * nearby[1] + nearby[2]  # of the parabola through them
    return jnp.where(slope > STRAIGHT * mean, direct, limit)
