"""A rate-independent collision by its equation of motion x'' = -(5/4) p, integrated by diffrax.

Nothing of the energy balance is used here: the law gives its forces, and where they end. Loading is
integrated as what it differs from an elastic collision by, where the law begins as one (`encke`),
else in the phase plane (`phase`), stage by stage between its kinks; unloading as a fall (`falls`).
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from softjax.engine import encke, falls, outcome, phase
from softjax.engine.bridge import solve
from softjax.engine.falls import INSIDE, Fall
from softjax.engine.outcome import Collision, Peak, Rebound, Release, loading_kinks, unloading_kinks
from softjax.fields import Flags, Numbers
from softjax.laws.reduced import ReducedClosedForm, ReducedRateIndependent
from softjax.numerics.derivatives import along_active
from softjax.numerics.roots import implicit_root, parabolic_step, refine

RESIDUAL_STEPS = 16  # from the peak; the worst of 400 000 cases needed 13
ROUNDING = 8.0  # a step this many times the rounding error was the last
GAIN = 3.0  # tolerances that ε_p² of an elastic collision may be off
UNKNOWN = 1e-8  # the tolerance that fixed steps are taken to have: of fields that vary alike
ROUGH = 4e-3  # of a user's forces, of which a few steps make an error that nothing estimates


def rate_independent(law, y, route: Any, *, clock=False, force=False) -> Collision:
    """One collision beyond the elastic stage."""
    peak = _loading(law, y, route, clock)
    release = _release(law, peak.overlap)
    fall = _unloading(law, peak, release)
    reached, solved = falls.energies(fall, y, route)
    back = Rebound(reached[-1], solved)
    if clock:
        time, timed = falls.times(fall, y, route)
        back = back._replace(time=time, solved=solved & timed)
    return outcome.assemble(law, peak, release, back, _gain(law, route, y.dtype), force)


def history(law, y, route: Any, fractions: tuple[np.ndarray, np.ndarray]):
    """The collision, and time, overlap, velocity and force at fixed fractions of both branches.

    Args:
        fractions: two increasing arrays in [0, 1]: of the way from touch to the peak, which is
            sampled once, as the end of loading, and of the way back.
    """
    along, back = fractions
    if _begins_elastic(law):
        peak, loading = encke.history(law, y, along, route)
        peak = peak._replace(overlap=jnp.where(peak.turns & peak.solved, loading[1][-1], 1.5))
    else:  # the fall from the peak, the other way round
        peak = _loading(law, y, route)
        (time, x, _, speed), rose = falls.times(_rise(law, peak), y, route, 1 - along[::-1])
        peak = peak._replace(solved=peak.solved & (rose | ~peak.turns))
        loading = (time[-1] - time[::-1], x[::-1], -speed[::-1], jax.vmap(law.loading)(x[::-1]))
    release = _release(law, peak.overlap)
    fall = _unloading(law, peak, release)
    (time, x, recovered, speed), fell = falls.times(fall, y, route, back)
    unloading = (loading[0][-1] + time, x, speed, jax.vmap(fall.force)(x, recovered))
    samples = [jnp.concatenate(parts) for parts in zip(loading, unloading, strict=True)]
    rebound = Rebound(jnp.square(speed[-1] / y), fell)
    return outcome.assemble(law, peak, release, rebound, _gain(law, route, y.dtype)), samples


def _gain(law, route: Any, dtype) -> Numbers:
    return GAIN * route.error(UNKNOWN if isinstance(law, ReducedClosedForm) else ROUGH, dtype)


def _release(law: ReducedRateIndependent, peak: Numbers) -> Release:
    search = _followed if isinstance(law, ReducedClosedForm) else outcome.searched
    return outcome.release(law, peak, search)


def _followed(law: ReducedClosedForm, peak: Numbers) -> Release:
    """x* of a smooth unloading force, by third-order steps down from the peak."""
    leaves, structure = jax.tree.flatten(law)

    def force(r, peak, *leaves):
        law = jax.tree.unflatten(structure, leaves)
        return law.unloading(peak * r**2, peak)

    def search(peak, *leaves):
        one = jnp.ones_like(peak)

        def with_slope(r):
            return jax.jvp(lambda r: force(r, peak, *leaves), (r,), (one,))

        def step(r):
            (f, slope), (_, curvature) = jax.jvp(with_slope, (r,), (one,))
            return jnp.clip(r - parabolic_step(f, jnp.maximum(slope, 0.0), curvature), 1e-12, 1.0)

        settled = ROUNDING * float(jnp.finfo(peak.dtype).eps)
        return refine(step, one, one > 0, RESIDUAL_STEPS, settled)

    r = implicit_root(search, force)(peak, *leaves)
    return Release(peak * r**2, peak * (1 - r) * (1 + r), r == r)


def _begins_elastic(law) -> bool:
    return isinstance(law, ReducedClosedForm) and not len(law.breakpoints())


def _loading(law: ReducedRateIndependent, y: Numbers, route: Any, clock: bool = False) -> Peak:
    leaves, structure = jax.tree.flatten((law.on_loading(), y, route))
    loaded = encke.loading if _begins_elastic(law) else _staged

    def one(*leaves):
        return loaded(*jax.tree.unflatten(structure, leaves), clock)

    return one(*leaves) if route.by_reverse else along_active(one, *leaves)


def _staged(law: ReducedRateIndependent, y: Numbers, route: Any, clock: bool = False) -> Peak:
    """Loading by any force: stages that are passed over the overlap, the last one by its angle."""
    found = outcome.loading_reach(law, y)
    length, m = found.rough, round(2 * law.work_exponent)
    unit = 1.25 * (length / y) / y

    def pull(X):
        """The force over M V²/L, no farther than the law goes."""
        return unit * law.loading(jnp.minimum(X * length, found.end))

    smooth = isinstance(law, ReducedClosedForm)
    kinks = jnp.sort(loading_kinks(law, y)) / length
    X, U, passed = _passed(pull, kinks, y, route, smooth)
    above = X if smooth else X * (1 + INSIDE)

    def excess(X, _):
        return pull(jnp.maximum(X, above)) - phase.circle_force(m, X)

    plane = phase.Plane(excess, m, bounded=True, smooth=smooth)
    states = phase.at_touch(y, clock=False)
    if len(kinks):
        inside = X > 0
        on_the_way = phase.placed(m, jnp.where(inside, X, 1.0), U)
        states = jax.tree.map(lambda a, b: jnp.where(inside, a, b), on_the_way, states)
    end, solved = phase.over_angle(plane, states, phase.PEAK, route)
    overlap = length * phase.position(m, end)[0]
    ends = jnp.isfinite(found.end)
    arrived = solved & passed & jnp.isfinite(overlap)
    turns = jnp.where(ends & arrived, overlap < found.end, found.turns)
    solved = arrived | ~turns
    overlap = jnp.where(turns & solved, overlap, 0.5 * length)
    peak = Peak(overlap, y, jnp.where(ends, found.end, 0.0), turns, solved)
    if not clock:
        return peak
    time, timed = falls.times(_rise(law, peak), y, route)
    return peak._replace(time=time, solved=peak.solved & (timed | ~turns))


def _passed(pull, kinks, y, route: Any, smooth: bool) -> tuple[Numbers, Numbers, Flags]:
    """X and U at the last kink before the peak, and whether the solver got there."""
    zero, one = jnp.zeros_like(y), jnp.ones_like(y)
    if not len(kinks):
        return zero, one, one > 0

    def stage(state, end):
        start, energy, going, sure = state
        width = jnp.maximum(end - start, 0.0)

        def field(t, _):
            # half powers of the overlap above the last kink are smooth over the root of it
            x = start + width * (t * t if smooth else jnp.minimum(t * t, 1 - INSIDE))
            return (-2 * pull(x) * 2 * width * t,)

        (lost,), solved = solve(field, zero, one, (zero,), route, smooth=smooth)
        passes = going & (energy + lost > 0) & (jnp.isfinite(lost))
        state = jnp.where(passes, start + width, start), jnp.where(passes, energy + lost, energy)
        return (*state, passes, sure & (solved | ~going)), None

    begin = (zero, one, one > 0, one > 0)
    last = jnp.max(jnp.where(jnp.isfinite(kinks), kinks, 0.0))
    ends = jnp.where(jnp.isfinite(kinks), kinks, 2 * last + 1)
    (X, energy, _, sure), _ = jax.lax.scan(stage, begin, ends)
    return X, jnp.sqrt(energy), sure


def _rise(law, peak: Peak) -> Fall:
    """Loading with time turned around."""
    top, smooth = peak.overlap, isinstance(law, ReducedClosedForm)
    force = lambda x, _: law.loading(x)  # noqa: E731
    return Fall(force, top, jnp.zeros_like(top), top, loading_kinks(law, top), smooth=smooth)


def _unloading(law, peak: Peak, release: Release) -> Fall:
    top, closed = peak.overlap, isinstance(law, ReducedClosedForm)
    return Fall(
        force=lambda x, recovered: law.unloading_at(x, recovered, top),
        top=top,
        bottom=release.residual,
        span=release.recovered,
        kinks=unloading_kinks(law, top),
        about_zero=closed and law.powers_about == "zero-overlap",
        smooth=closed,
    )
