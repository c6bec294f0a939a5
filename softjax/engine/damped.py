"""A collision by a rate-dependent law: the equation of motion x'' = -(5/4) p(x, x').

Integrated in the phase plane of the law's elastic power law (`phase`): up to the peak, and on to
where the overlap vanishes, or to where the force does.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from softjax.engine import phase
from softjax.engine.outcome import Collision, flagged
from softjax.engine.phase import PARTING, PEAK, TOUCH, Plane, States
from softjax.fields import Flags, Numbers
from softjax.laws.reduced import ReducedRateDependent
from softjax.numerics.roots import largest, reach
from softjax.status import Status

# How far ε_p² of an elastic collision may be off, in tolerances; of forces that are far from the
# power law of the phase plane most, 85 at the default. Of fixed steps the tolerance is a guess.
GAIN = 100.0
UNKNOWN = 1e-4
FORCE_NODES = 33  # of the polynomial through the force on loading


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

        def ratio(X, U):
            """The force over the elastic one."""
            x, u = X * self.length, U * self.y
            return 1 + self.law.dissipative(x, u) / self.law.elastic(x)

        return phase.to_zero_force(self.plane, ratio, peak, route, save)


def _scene(law: ReducedRateDependent, y: Numbers) -> _Scene:
    k = law.work_exponent
    m = round(2 * k)
    length, turns = y ** (2 / k), y == y
    is_power = type(law).elastic is ReducedRateDependent.elastic and m == 2 * k
    if not is_power:
        still, pace = jax.tree.map(jax.lax.stop_gradient, (law, y))
        found = reach(still.elastic, 0.4 * pace * pace, pace ** (2 / k))
        # damping may hold what the elastic force alone would not
        length, turns = jnp.where(found.turns, found.rough, length), found.turns
    unit = 1.25 * (length / y) / y

    def excess(X, U):
        x, u = X * length, U * y
        if is_power:
            return unit * law.dissipative(x, u)
        return unit * law.force(x, u) - phase.circle_force(m, X)

    return _Scene(law, y, length, turns, Plane(excess, m))


def rate_dependent(law, y, route: Any, *, clock=False, force=False) -> Collision:
    """One collision at y > 0."""
    scene = _scene(law, y)
    peak, reached = phase.over_angle(scene.plane, phase.at_touch(y, clock), PEAK, route)
    end, ended = scene.ends(peak, route)
    found = _assembled(scene, peak, end, reached & ended, route)
    if clock:
        ends = reached & ended & jnp.isfinite(end.clock)
        time = jnp.where(ends, end.clock * (scene.length / y), 0.0)
        found = found._replace(duration=time)
    if force:
        pull = jnp.where(found.answered, _largest_force(scene, route), 0.0)
        found = found._replace(force=pull)
    return found


def _assembled(scene: _Scene, peak: States, end: States, arrived, route) -> Collision:
    far, _ = phase.position(scene.plane.m, peak)
    left, speed = phase.position(scene.plane.m, end)
    solved = arrived & jnp.isfinite(speed)
    stays = solved & (scene.law.ends_at == "zero-force")
    gains = speed * speed > 1 + GAIN * route.error(UNKNOWN, speed.dtype)
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


def history(law, y, route: Any, fractions: tuple[np.ndarray, np.ndarray]):
    """The collision, and time, overlap, velocity and force at fixed fractions of both branches.

    Args:
        fractions: two increasing arrays in [0, 1], of the angle of loading and of unloading; the
            peak is sampled once, as the end of loading.
    """
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
