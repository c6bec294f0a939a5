"""A collision by a rate-dependent law: the equation of motion x'' = -(5/4) p(x, x').

Integrated in the phase plane of the law's elastic power law (`phase`): up to the peak, and on to
where the overlap vanishes, or to where the force does.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from softjax import phase
from softjax._impacts import over_impacts
from softjax._search import reach
from softjax.laws.reduced import Reduced, ReducedRateDependent
from softjax.outcome import shrunk
from softjax.phase import PARTING, PEAK, TOUCH, Plane, States
from softjax.routes import Stepping

# How far ε_p² of an elastic collision may be off, in tolerances; of forces that are far from the
# power law of the phase plane most, 85 at the default. Of fixed steps the tolerance is a guess.
GAIN = 100.0
UNKNOWN = 1e-4


class Rebound(NamedTuple):
    """A damped collision in reduced variables; arrays over impacts."""

    peak: Array
    residual: Array
    plastic_squared: Array
    turns: Bool[Array, "..."]
    solved: Bool[Array, "..."]
    gains: Bool[Array, "..."]


def collide(impacts: Reduced, route: Stepping) -> Rebound:
    """Overlaps and the part of the impact energy given back, one ODE for each velocity y > 0."""
    return _each(_collide, impacts, route)


def duration(impacts: Reduced, route: Stepping) -> tuple[Array, Bool[Array, "..."]]:
    """Contact duration [L/V] and whether the contact ends."""
    return _each(_duration, impacts, route)


def history(
    impacts: Reduced, fractions: tuple[np.ndarray, np.ndarray], route: Stepping
) -> tuple[tuple[Array, ...], Rebound]:
    """Time, overlap, velocity and force at fixed fractions of loading and of unloading; what rebounds.

    Args:
        fractions: two increasing arrays in [0, 1], of the angle of loading and of unloading; the
            peak is sampled once, as the end of loading.
    """
    return _each(partial(_history, fractions=fractions), impacts, route)


def _each(what, impacts: Reduced, route: Stepping):
    batch = impacts.law, impacts.y, impacts.below, route
    return over_impacts(what, batch, forward=True)


class _Scene(NamedTuple):
    """One impact over the elastic collision's largest overlap L and its own velocity."""

    law: ReducedRateDependent
    y: Array
    length: Array
    turns: Bool[Array, ""]
    plane: Plane

    def ratio(self, X, U):
        """The force over the elastic one."""
        x, u = X * self.length, U * self.y
        return 1 + self.law.dissipative(x, u) / self.law.elastic(x)

    def position(self, states: States):
        return phase.position(self.plane.m, states)

    def ends(self, peak: States, route: Stepping, save=None):
        """The end of the contact, or samples on the way there."""
        if self.law.ends_at == "zero-overlap":
            return phase.over_angle(self.plane, peak, PARTING, route, save)
        return phase.to_zero_force(self.plane, self.ratio, peak, route, save)


def _scene(law: ReducedRateDependent, y: Array) -> _Scene:
    k = law.work_exponent
    m = round(2 * k)
    length, turns = y ** (2 / k), jnp.ones_like(y, dtype=bool)
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


def _collide(law, y, below, route: Stepping) -> Rebound:
    scene = _scene(law, y)
    touch = phase.at_touch(y, clock=False)
    peak, reached = phase.over_angle(scene.plane, touch, PEAK, route)
    end, ended = scene.ends(peak, route)
    return _rebound(scene, peak, end, reached & ended, below, route)


def _rebound(scene: _Scene, peak: States, end: States, arrived, below, route) -> Rebound:
    far, (left, speed) = scene.position(peak)[0], scene.position(end)
    solved = arrived & jnp.isfinite(speed)
    length = scene.length * shrunk(scene.law, scene.length * far, below)
    stays = solved & (scene.law.ends_at == "zero-force")
    return Rebound(
        peak=jnp.where(solved, far * length, 0.0),
        residual=jnp.where(stays, left * length, 0.0),
        plastic_squared=jnp.where(solved, speed * speed, 0.0),
        turns=solved | scene.turns,
        solved=solved,
        gains=speed * speed > 1 + GAIN * route.error(UNKNOWN, speed.dtype),
    )


def _duration(law, y, below, route: Stepping):
    scene = _scene(law, y)
    peak, reached = phase.over_angle(scene.plane, phase.at_touch(y, clock=True), PEAK, route)
    end, ended = scene.ends(peak, route)
    ends = reached & ended & jnp.isfinite(end.clock)
    return jnp.where(ends, end.clock * _pace(scene, peak, below), 0.0), ends


def _history(law, y, below, route: Stepping, fractions):
    along, back = fractions
    scene = _scene(law, y)
    touch = phase.at_touch(y, clock=True)
    there = phase.samples(TOUCH, PEAK, along)
    loading, reached = phase.over_angle(scene.plane, touch, PEAK, route, there)
    peak = jax.tree.map(lambda state: state[-1], loading)
    to_end = law.ends_at == "zero-overlap"
    unloading, ended = scene.ends(
        peak, route, phase.samples(PEAK, PARTING, back) if to_end else back
    )
    states = jax.tree.map(lambda *parts: jnp.concatenate(parts), loading, unloading)
    X, U = scene.position(states)
    # the edges stand for touch and, where it ends there, zero overlap
    X = jnp.where(jnp.abs(states.way) >= PARTING, 0.0, X)
    x, u = X * scene.length, U * y
    force = jax.vmap(law.force)(x, u)
    clock = jnp.where(states.way <= TOUCH, 0.0, states.clock)
    far = shrunk(law, jnp.max(x), below)
    slow = 1.0 if below is None else below
    time = clock * _pace(scene, peak, below)
    samples = (time, x * far, u * slow, force * slow * slow / far)
    end = jax.tree.map(lambda state: state[-1], unloading)
    return samples, _rebound(scene, peak, end, reached & ended, below, route)


def _pace(scene: _Scene, peak: States, below):
    """Time [L/V] over that of the scene."""
    x = scene.length * scene.position(peak)[0]
    slower = 1.0 if below is None else shrunk(scene.law, x, below) / below
    return scene.length / scene.y * slower
