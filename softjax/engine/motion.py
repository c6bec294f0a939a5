"""A collision by its equation of motion x'' = -(5/4) p, integrated by diffrax.

Nothing of the energy balance is used here: the law gives its forces, and where they end. Of a
rate-independent law loading is integrated as what it differs from an elastic collision by, where the
law begins as one (`encke`), else in the phase plane (`phase`), stage by stage between its kinks;
unloading as a fall (`falls`). Of a rate-dependent law all is integrated in the phase plane of its
elastic power law: up to the peak, and on to where the overlap vanishes, or to where the force does.

The scales of `softjax.laws.reduced` make x'' = -(5/4) p of M δ'' = -P. A linear spring with a dashpot of the
fraction ξ of critical damping rebounds at ε = exp(-π ξ/√(1 - ξ²)), the half for ξ = 0.21545:

>>> import jax.numpy as jnp
>>> import softjax as sj
>>> sj.enable_x64()
>>> from softjax.engine.motion import rate_dependent
>>> from softjax.laws.dashpots import ReducedLinearDashpot
>>> law = ReducedLinearDashpot(jnp.asarray(0.2154537), "zero-overlap")
>>> hit = rate_dependent(law, jnp.asarray(1.0), None, sj.ODE(), clock=True)
>>> print(f"{hit.energy**0.5:.5f} {hit.duration:.5f}")  # π/√(1 - ξ²)
0.50000 3.21715
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
    loading_kinks,
    unloading_kinks,
)
from softjax.engine.phase import PARTING, PEAK, TOUCH, Plane, States
from softjax.fields import Flags, Numbers
from softjax.laws.reduced import ReducedClosedForm, ReducedRateDependent, ReducedRateIndependent
from softjax.numerics.derivatives import differentiate_active_inputs
from softjax.numerics.roots import (
    chebyshev_shares,
    implicit_root,
    largest_of_samples,
    parabolic_step,
    reach,
    refine,
)

RESIDUAL_STEPS = 16  # from the peak; the worst of 400 000 cases needed 13
# a step this many times the rounding error was the last; from 0.5 to 1e10 x* of 5000 impacts is the
# same to 9e-16
ROUNDING = 8.0
# tolerances that ε_p² of an elastic collision may be off; 0.6 at most of 720 by forces of a
# user's, at seven tolerances
GAIN = 3.0
# the tolerance that fixed steps are taken to have: of fields that vary alike; of Zhou's law just
# above yield four steps of dopri5 err by 1e-12
UNKNOWN = 1e-8
# of a user's forces, of which a few steps make an error that nothing estimates: of the 720 two
# steps of dopri5 gain up to 0.010, four of bosh3 0.14
ROUGH = 4e-3
# How far ε_p² of an elastic collision may be off, in tolerances; of forces that are far from the
# power law of the phase plane most, 85 at the default. Of fixed steps the tolerance is a guess.
DAMPED_GAIN = 100.0
# of the elastic force: rounding of a force that damping cancels but for a small rest; of 60 laws of
# Hunt and Crossley 10 fail with 1e-12, none from 1e-9 to 0.01
PUSHES = 1e-6
# a check of the energy by the forces' works, and the share it may be off; of the built-in forces
# they differ by up to 8e-6, by 1.3e-4 with 64 nodes
WORK_NODES, DISAGREES = 256, 3e-3
DAMPED_UNKNOWN = 1e-4  # of the 720 three steps of dopri5 gain up to 0.010, 16 of bosh3 0.004


def rate_independent(law, y, speed_ratio, route: Any, *, clock=False, force=False) -> Collision:
    """One collision beyond the elastic stage."""
    peak = _loading(law, y, route)
    unloaded, fall = _unloading(law, peak.overlap)
    reached, solved = falls.energies(fall, y, route)
    back = Rebound(reached[-1], solved)
    if clock:
        both, arrived = falls.times(_rise(law, peak.overlap, y), fall, y, route)
        back = back._replace(solved=solved & arrived, time=sum(both))
    if not isinstance(law, ReducedClosedForm):
        off = _work_off(law, peak, unloaded, y, back.energy)
        peak = peak._replace(
            error=jnp.where(off > DISAGREES + 10 * _gain(law, route, y.dtype), off, 0.0)
        )
    collision = outcome.assemble(law, peak, unloaded, back, _gain(law, route, y.dtype), force)
    return outcome.undo_rescaling(law, collision, speed_ratio)


def _work_off(law, peak: Peak, unloaded: UnloadingEnd, y: Numbers, energy: Numbers) -> Numbers:
    """What the works of both forces differ from the energies by that were integrated, over the impact's.

    Steps may cross what a force does between their stages. Works are sums at fixed places over the angle φ of
    x = x_m sin²φ, in which forces of contacts are smooth; none is differentiated.
    """
    law, peak, unloaded, energy = jax.lax.stop_gradient((law, peak, unloaded, energy))
    width = 0.5 * np.pi / WORK_NODES
    angles = width * (np.arange(WORK_NODES) + 0.5)
    share = jnp.asarray(np.sin(angles) ** 2, y.dtype)
    weight = jnp.asarray(2 * np.sin(angles) * np.cos(angles) * width, y.dtype)
    loaded = peak.overlap * jnp.sum(weight * jax.vmap(law.loading)(peak.overlap * share))
    rest = unloaded.recovered * share
    back = jax.vmap(
        lambda rest: law.unloading_at(
            outcome.inside(unloaded.residual, rest), unloaded.recovered - rest, peak.overlap
        )
    )(rest)
    returned = unloaded.recovered * jnp.sum(weight * back)
    part = 2.5 * (1 / y) * (1 / y)
    return jnp.maximum(jnp.abs(part * loaded - 1), jnp.abs(part * returned - energy))


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


def residual_by_newton(law: ReducedClosedForm, peak: Numbers) -> UnloadingEnd:
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
    return loaded(*impact) if route.by_reverse else differentiate_active_inputs(loaded, *impact)


def _staged(law: ReducedRateIndependent, y: Numbers, route: Any) -> Peak:
    """Loading by any force: stages that are passed over the overlap, the last one by its angle."""
    reach = outcome.loading_reach(law, y)
    length, m = reach.rough, round(2 * law.work_exponent)
    unit = 1.25 * (length / y) / y

    def force(X):
        """The force over M V²/L, no farther than the law goes."""
        return unit * law.loading(jnp.minimum(X * length, reach.end))

    smooth = isinstance(law, ReducedClosedForm)
    kinks = jnp.sort(loading_kinks(law, y)) / length
    X, U, passed = _passed(force, kinks, y, route)
    above = X if smooth else X * (1 + INSIDE)

    def excess(X, _):
        return force(jnp.maximum(X, above)) - phase.circle_force(m, X)

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


def _passed(force, kinks, y, route: Any) -> tuple[Numbers, Numbers, Flags]:
    """X and U at the last kink before the peak, and whether the solver got there."""
    zero, one = jnp.zeros_like(y), jnp.ones_like(y)
    if not len(kinks):
        return zero, one, one > 0

    def stage(state, end):
        start, energy, going, sure = state
        width = jnp.maximum(end - start, 0.0)

        def field(t, _):
            # half powers of the overlap above the last kink are smooth over the root of it
            x = start + width * jnp.minimum(t * t, 1 - INSIDE)
            return (-2 * force(x) * 2 * width * t,)

        (lost,), solved = solve(field, zero, one, (zero,), route)
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
    end = outcome.unloading_end(law, top, residual_by_newton if closed else outcome.searched)
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
        shares = None if save is None else phase.samples(PEAK, PARTING, save)
        if self.law.ends_at == "zero-overlap":
            return phase.over_angle(self.plane, peak, PARTING, route, shares)

        if save is None and route.by_reverse:
            return _again_over_angle(self.law, self.y, peak, route)
        end, arrived = phase.to_zero_force(self.plane, self.ratio, peak, route, save)
        # a force that pushes all the way vanishes with the overlap, and may come so near to 0 before (Hunt and
        # Crossley's 1 + d δ' is e^{-d v}) that nothing falls any more
        parting, parted = phase.over_angle(self.plane, peak, PARTING, route, shares, idle=arrived)
        g = self.ratio(*phase.position(self.plane.m, parting))
        pushes = ~arrived & parted & jnp.all(g >= -PUSHES)
        end = jax.tree.map(lambda a, b: jnp.where(pushes, a, b), parting, end)
        return end, arrived | pushes

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
        along, slope = phase.ratio_and_rates(scene.plane, scene.ratio, way, there.radius)
        later = -moved.way * (1 - way) / jnp.where(slope < 0, slope, -1.0)
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
        fixed, speed = jax.tree.map(jax.lax.stop_gradient, (law, y))
        elastic = reach(fixed.elastic, 0.4 * speed * speed, speed ** (2 / k))
        # damping may hold what the elastic force alone would not
        length, turns = jnp.where(elastic.turns, elastic.rough, length), elastic.turns
    unit = 1.25 * (length / y) / y

    def excess(X, U):
        x, u = X * length, U * y
        if is_power:
            return unit * law.dissipative(x, u)
        return unit * law.force(x, u) - phase.circle_force(m, X)

    return _Scene(law, y, length, turns, Plane(excess, m))


def rate_dependent(law, y, speed_ratio, route: Any, *, clock=False, force=False) -> Collision:
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
        largest = jnp.where(collision.turns, _largest_force(scene, route), 0.0)
        collision = collision._replace(force=largest)
    return outcome.undo_rescaling(law, collision, speed_ratio)


def _assembled(scene: _Scene, peak: States, end: States, arrived, route) -> Collision:
    far, _ = phase.position(scene.plane.m, peak)
    left, speed = phase.position(scene.plane.m, end)
    solved = arrived & jnp.isfinite(speed)
    zero_force = scene.law.ends_at == "zero-force"
    stays = solved & zero_force & (end.way < PARTING)
    rests = not zero_force and jnp.abs(speed) <= float(jnp.finfo(speed.dtype).eps)
    return outcome.damped(
        energy=speed * speed,
        peak=far * scene.length,
        residual=jnp.where(stays, left * scene.length, 0.0),
        solved=solved,
        turns=scene.turns,
        endless=rests,
        gain=DAMPED_GAIN * route.error(DAMPED_UNKNOWN, speed.dtype),
    )


def _largest_force(scene: _Scene, route: Any) -> Numbers:
    """That of loading, where the bodies approach."""
    touch = phase.at_touch(scene.y, clock=False)
    shares = chebyshev_shares(scene.y.dtype)
    states, _ = phase.over_angle(scene.plane, touch, PEAK, route, shares)
    X, U = phase.position(scene.plane.m, states)
    return largest_of_samples(jax.vmap(scene.law.force)(X * scene.length, U * scene.y))


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
