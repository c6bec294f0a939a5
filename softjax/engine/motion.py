"""A collision by its equation of motion x'' = -(5/4) p, integrated by diffrax.

Nothing of the energy balance is used here: the law gives its forces, and where they end. Of a
rate-independent law loading is integrated as what it differs from an elastic collision by, where the
law begins as one (`encke`), else in the phase plane (`phase`), stage by stage between its kinks;
unloading as a fall (`falls`). Of a rate-dependent law all is integrated in the phase plane of its
elastic power law: up to the peak, and on to where the overlap vanishes, or to where the force does.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from softjax.engine import encke, falls, outcome, phase
from softjax.engine.bridge import solve
from softjax.engine.falls import INSIDE, Fall
from softjax.engine.outcome import (
    Collision,
    Peak,
    Rebound,
    UnloadingEnd,
    flagged,
    loading_kinks,
    unloading_kinks,
)
from softjax.engine.phase import PARTING, PEAK, TOUCH, Plane, States
from softjax.fields import Flags, Numbers
from softjax.laws.reduced import ReducedClosedForm, ReducedRateDependent, ReducedRateIndependent
from softjax.numerics.derivatives import along_active
from softjax.numerics.roots import implicit_root, largest, parabolic_step, reach, refine
from softjax.status import Status

RESIDUAL_STEPS = 16  # from the peak; the worst of 400 000 cases needed 13
ROUNDING = 8.0  # a step this many times the rounding error was the last
GAIN = 3.0  # tolerances that ε_p² of an elastic collision may be off
UNKNOWN = 1e-8  # the tolerance that fixed steps are taken to have: of fields that vary alike
ROUGH = 4e-3  # of a user's forces, of which a few steps make an error that nothing estimates
# How far ε_p² of an elastic collision may be off, in tolerances; of forces that are far from the
# power law of the phase plane most, 85 at the default. Of fixed steps the tolerance is a guess.
DAMPED_GAIN = 100.0
DAMPED_UNKNOWN = 1e-4
FORCE_NODES = 33  # of the polynomial through the force on loading


def rate_independent(law, y, below, route: Any, *, clock=False, force=False) -> Collision:
    """One collision beyond the elastic stage."""
    peak = _loading(law, y, route)
    unloaded, fall = _unloading(law, peak.overlap)
    reached, solved = falls.energies(fall, y, route)
    back = Rebound(reached[-1], solved)
    if clock:
        both, arrived = falls.times(_rise(law, peak.overlap, y), fall, y, route)
        back = back._replace(solved=solved & arrived, time=sum(both))
    collision = outcome.assemble(law, peak, unloaded, back, _gain(law, route, y.dtype), force)
    return outcome.unlifted(law, collision, below)


def history(law, y, route: Any, fractions: tuple[np.ndarray, np.ndarray]):
    """The collision, and time, overlap, velocity and force at fixed fractions of both branches.

    Args:
        fractions: two increasing arrays in [0, 1]: of the way from touch to the peak, which is
            sampled once, as the end of loading, and of the way back.
    """
    along, back = fractions
    peak = _loading(law, y, route)
    unloaded, fall = _unloading(law, peak.overlap)
    # loading is a fall from the peak, the other way round
    rise = _rise(law, peak.overlap, y)
    (up, down), solved = falls.times(rise, fall, y, route, (1 - along[::-1], back))
    time, x, _, speed = (part[::-1] for part in up)
    loading = (time[0] - time, x, -speed, jax.vmap(law.loading)(x))
    time, x, recovered, speed = down
    unloading = (loading[0][-1] + time, x, speed, jax.vmap(fall.force)(x, recovered))
    samples = [jnp.concatenate(parts) for parts in zip(loading, unloading, strict=True)]
    rebound = Rebound(jnp.square(speed[-1] / y), solved)
    return outcome.assemble(law, peak, unloaded, rebound, _gain(law, route, y.dtype)), samples


def _gain(law, route: Any, dtype) -> Numbers:
    return GAIN * route.error(UNKNOWN if isinstance(law, ReducedClosedForm) else ROUGH, dtype)


def _followed(law: ReducedClosedForm, peak: Numbers) -> UnloadingEnd:
    """x* of a smooth unloading force, by third-order steps down from the peak."""

    def force(r, peak, law):
        return law.unloading(peak * r**2, peak)

    def search(peak, law):
        one = jnp.ones_like(peak)

        def with_slope(r):
            return jax.jvp(lambda r: force(r, peak, law), (r,), (one,))

        def step(r):
            (f, slope), (_, curvature) = jax.jvp(with_slope, (r,), (one,))
            return jnp.clip(r - parabolic_step(f, jnp.maximum(slope, 0.0), curvature), 1e-12, 1.0)

        settled = ROUNDING * float(jnp.finfo(peak.dtype).eps)
        return refine(step, one, one > 0, RESIDUAL_STEPS, settled)

    r = implicit_root(search, force)(peak, law)
    return UnloadingEnd(peak * r**2, peak * (1 - r) * (1 + r), r == r)


def _begins_elastic(law: ReducedRateIndependent) -> bool:
    return isinstance(law, ReducedClosedForm) and not len(law.breakpoints())


def _loading(law: ReducedRateIndependent, y: Numbers, route: Any) -> Peak:
    loaded = encke.loading if _begins_elastic(law) else _staged
    impact = law.on_loading(), y, route
    return loaded(*impact) if route.by_reverse else along_active(loaded, *impact)


def _staged(law: ReducedRateIndependent, y: Numbers, route: Any) -> Peak:
    """Loading by any force: stages that are passed over the overlap, the last one by its angle."""
    reach = outcome.loading_reach(law, y)
    length, m = reach.rough, round(2 * law.work_exponent)
    unit = 1.25 * (length / y) / y

    def pull(X):
        """The force over M V²/L, no farther than the law goes."""
        return unit * law.loading(jnp.minimum(X * length, reach.end))

    smooth = isinstance(law, ReducedClosedForm)
    kinks = jnp.sort(loading_kinks(law, y)) / length
    X, U, passed = _passed(pull, kinks, y, route, smooth)
    above = X if smooth else X * (1 + INSIDE)

    def excess(X, _):
        return pull(jnp.maximum(X, above)) - phase.circle_force(m, X)

    plane = Plane(excess, m, bounded=True, smooth=smooth)
    states = phase.at_touch(y, clock=False)
    if len(kinks):
        inside = X > 0
        on_the_way = phase.placed(m, jnp.where(inside, X, 1.0), U)
        states = jax.tree.map(lambda a, b: jnp.where(inside, a, b), on_the_way, states)
    end, solved = phase.over_angle(plane, states, PEAK, route)
    overlap = length * phase.position(m, end)[0]
    ends = jnp.isfinite(reach.end)
    arrived = solved & passed & jnp.isfinite(overlap)
    turns = jnp.where(ends & arrived, overlap < reach.end, reach.turns)
    solved = arrived | ~turns
    overlap = jnp.where(turns & solved, overlap, 0.5 * length)
    return Peak(overlap, y, reach.end, turns, solved, jnp.zeros_like(y))


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


def _rise(law, top: Numbers, y: Numbers) -> Fall:
    """Loading with time turned around."""
    force = lambda x, _: law.loading(x)  # noqa: E731
    smooth, kinks, reached = isinstance(law, ReducedClosedForm), loading_kinks(law, top), None
    if _begins_elastic(law):  # up to its one kink the work is that of the power law
        least = kinks ** (0.5 * law.work_exponent)
        reached = (1 - least / y) * (1 + least / y)
    bottom = jnp.zeros_like(top)
    return Fall(force, top, bottom, top, kinks, smooth=smooth, reached=reached)


def _unloading(law, top: Numbers) -> tuple[UnloadingEnd, Fall]:
    """Where unloading from the peak ends, and the fall from there."""
    closed = isinstance(law, ReducedClosedForm)
    end = outcome.unloading_end(law, top, _followed if closed else outcome.searched)
    fall = Fall(
        force=lambda x, recovered: law.unloading_at(x, recovered, top),
        top=top,
        bottom=end.residual,
        span=end.recovered,
        kinks=unloading_kinks(law, top),
        about_zero=closed and law.powers_about == "zero-overlap",
        smooth=closed,
    )
    return end, fall


# rate-dependent laws


class _Scene(NamedTuple):
    """One impact over the elastic collision's largest overlap L and its own velocity."""

    law: ReducedRateDependent
    y: Numbers
    length: Numbers
    turns: Flags
    plane: Plane

    def ends(self, peak: States, route: Any, save=None):
        """The end of the contact, or samples on the way there."""
        if self.law.ends_at == "zero-overlap":
            save = None if save is None else phase.samples(PEAK, PARTING, save)
            return phase.over_angle(self.plane, peak, PARTING, route, save)

        if save is None and route.by_reverse:
            return _again_over_angle(self.law, self.y, peak, route)
        return phase.to_zero_force(self.plane, self.ratio, peak, route, save)

    def ratio(self, X, U):
        """The force over the elastic one."""
        x, u = X * self.length, U * self.y
        return 1 + self.law.dissipative(x, u) / self.law.elastic(x)


def _again_over_angle(law: ReducedRateDependent, y: Numbers, peak: States, route: Any):
    """The end at zero force, differentiated as that of a way over the angle, whose field has no derivative of the force.

    Gradients by many weights take a third of the time.
    """

    @jax.custom_jvp
    def found(law, y, peak):
        scene = _scene(law, y)
        end, solved = phase.to_zero_force(scene.plane, scene.ratio, peak, route)
        return end._replace(way=jnp.where(solved, end.way, jnp.nan))

    @found.defjvp
    def rule(impact, changes):
        end = found(*impact)
        way = jnp.where(jnp.isfinite(end.way), jnp.minimum(end.way, PARTING), 0.5)

        def over_angle(law, y, peak):
            scene = _scene(law, y)
            there, _ = phase.over_angle(scene.plane, peak, way, route)
            return there._replace(way=scene.ratio(*phase.position(scene.plane.m, there)))

        there, moved = jax.jvp(over_angle, impact, changes)
        scene = _scene(*impact[:2])
        along, falls = phase.falling(scene.plane, scene.ratio, way, there.radius)
        later = -moved.way * (1 - way) / jnp.where(falls < 0, falls, -1.0)
        with_clock = None if end.clock is None else moved.clock + along[1] * later
        return end, States(later, moved.radius + along[0] * later, with_clock)

    end = found(law, y, peak)
    arrives = jnp.isfinite(end.way)
    return jax.tree.map(lambda x: jnp.where(arrives, x, 0.5), end), arrives


def _scene(law: ReducedRateDependent, y: Numbers) -> _Scene:
    k = law.work_exponent
    m = round(2 * k)
    length, turns = y ** (2 / k), y == y
    is_power = type(law).elastic is ReducedRateDependent.elastic and m == 2 * k
    if not is_power:
        still, pace = jax.tree.map(jax.lax.stop_gradient, (law, y))
        alone = reach(still.elastic, 0.4 * pace * pace, pace ** (2 / k))
        # damping may hold what the elastic force alone would not
        length, turns = jnp.where(alone.turns, alone.rough, length), alone.turns
    unit = 1.25 * (length / y) / y

    def excess(X, U):
        x, u = X * length, U * y
        if is_power:
            return unit * law.dissipative(x, u)
        return unit * law.force(x, u) - phase.circle_force(m, X)

    return _Scene(law, y, length, turns, Plane(excess, m))


def rate_dependent(law, y, below, route: Any, *, clock=False, force=False) -> Collision:
    """One collision at y > 0."""
    scene = _scene(law, y)
    peak, reached = phase.over_angle(scene.plane, phase.at_touch(y, clock), PEAK, route)
    end, ended = scene.ends(peak, route)
    collision = _assembled(scene, peak, end, reached & ended, route)
    if clock:
        ends = reached & ended & jnp.isfinite(end.clock)
        time = jnp.where(ends, end.clock * (scene.length / y), 0.0)
        collision = collision._replace(duration=time)
    if force:
        pull = jnp.where(collision.answered, _largest_force(scene, route), 0.0)
        collision = collision._replace(force=pull)
    return outcome.unlifted(law, collision, below)


def _assembled(scene: _Scene, peak: States, end: States, arrived, route) -> Collision:
    far, _ = phase.position(scene.plane.m, peak)
    left, speed = phase.position(scene.plane.m, end)
    solved = arrived & jnp.isfinite(speed)
    stays = solved & (scene.law.ends_at == "zero-force")
    gains = speed * speed > 1 + DAMPED_GAIN * route.error(DAMPED_UNKNOWN, speed.dtype)
    conditions = {
        Status.ENERGY_GAIN: solved & gains,
        Status.NO_TURNING_POINT: ~(solved | scene.turns),
        Status.SOLVER_FAILED: ~solved,
    }
    return Collision(
        energy=jnp.where(solved, speed * speed, 0.0),
        peak=jnp.where(solved, far * scene.length, 0.0),
        residual=jnp.where(stays, left * scene.length, 0.0),
        flags=flagged(conditions),
    )


def _largest_force(scene: _Scene, route: Any) -> Numbers:
    """That of loading, where the bodies approach: of the polynomial through Chebyshev's points."""
    dtype = scene.y.dtype
    nodes = np.sin(np.linspace(0, 0.5 * np.pi, FORCE_NODES)) ** 2
    weights = (-1.0) ** np.arange(FORCE_NODES)
    weights[[0, -1]] *= 0.5
    nodes, weights = nodes.astype(dtype), weights.astype(dtype)
    touch = phase.at_touch(scene.y, clock=False)
    states, _ = phase.over_angle(scene.plane, touch, PEAK, route, nodes)
    X, U = phase.position(scene.plane.m, states)
    force = jax.vmap(scene.law.force)(X * scene.length, U * scene.y)

    def between(share):
        away = share - nodes
        at = jnp.argmin(jnp.abs(away))
        parts = weights / jnp.where(away == 0, 1.0, away)
        return jnp.where(away[at] == 0, force[at], jnp.sum(parts * force) / jnp.sum(parts))

    return largest(between, jnp.ones_like(scene.y))


def damped_history(law, y, route: Any, fractions: tuple[np.ndarray, np.ndarray]):
    """The same as `history`, at fractions of the angle."""
    along, back = fractions
    scene = _scene(law, y)
    there = phase.samples(TOUCH, PEAK, along)
    loading, reached = phase.over_angle(
        scene.plane, phase.at_touch(y, clock=True), PEAK, route, there
    )
    peak = jax.tree.map(lambda state: state[-1], loading)
    unloading, ended = scene.ends(peak, route, back)
    end = jax.tree.map(lambda state: state[-1], unloading)
    states = jax.tree.map(lambda *parts: jnp.concatenate(parts), loading, unloading)
    X, U = phase.position(scene.plane.m, states)
    # the edges stand for touch and, where it ends there, zero overlap
    X = jnp.where(jnp.abs(states.way) >= PARTING, 0.0, X)
    x, u = X * scene.length, U * y
    clock = jnp.where(states.way <= TOUCH, 0.0, states.clock)
    samples = clock * (scene.length / y), x, u, jax.vmap(law.force)(x, u)
    return _assembled(scene, peak, end, reached & ended, route), samples
