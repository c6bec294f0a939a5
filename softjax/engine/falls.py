"""The fall from the peak by one force, integrated by diffrax: x'' = -(5/4) p, x(0) = x_m, x'(0) = 0.

Unloading is one, and so is loading with time turned around. Nothing is integrated over time, because
the end is known in other variables (Hénon's trick), so that no event has to be searched for:

* the energy over the overlap, in a root of it that makes the force's own powers smooth;
* where time matters, over tan(φ/2) of x = x* + ρ cosφ, x' = -Ω ρ sinφ, with ρ and t as states.

Between two kinks of the force is a stage, solved by itself.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from softjax.engine.bridge import solve
from softjax.numerics.powers import safe_sqrt

INSIDE = 1e-13  # of a stage: how far from its ends a force is computed, which may jump there


class Fall(NamedTuple):
    """A force that drives the bodies apart.

    Attributes:
        force: of the overlap x and of x_m - x.
        top, bottom, span: x_m, x* and x_m - x*, each to its own precision.
        kinks: overlaps where the force has some, a vector.
        about_zero: whether the energy is integrated over the root of x instead of that of x - x*.
        smooth: the force has no kinks or flat parts inside of a stage; the step size is unbounded.
        reached: x'²/y² at the kinks, from the top, where it is known.
    """

    force: Callable[[Array, Array], Array]
    top: Array
    bottom: Array
    span: Array
    kinks: Array
    about_zero: bool = False
    smooth: bool = False
    reached: Array | None = None


def energies(fall: Fall, y: Array, route: Any) -> tuple[Array, Bool[Array, ""]]:
    """x'²/y² at the lower ends of all stages, the last of which is the whole fall; and the verdict."""
    per_velocity = 1 / y  # twice: the derivative of a quotient by y² overflows float32 at y = 1e13

    def stage(high, low):
        """From x_m - high to x_m - low."""
        place = _about_zero(fall, high, low) if fall.about_zero else _about_end(fall, high, low)

        def field(t, _):
            x, recovered, rate = place(t)
            return (2.5 * (rate * per_velocity) * (fall.force(x, recovered) * per_velocity),)

        zero, one = jnp.zeros_like(y), jnp.ones_like(y)
        (gained,), solved = solve(field, zero, one, (zero,), route, smooth=fall.smooth)
        return gained, solved

    return _summed(stage, _depths(fall), route.by_reverse)


def _summed(stage, depth: Array, by_reverse: bool):
    """What `stage` gains between each two of the depths, of which one program serves all.

    Stages without a width come first and last; that no impact of a batch has any costs nothing, but
    where it is to be differentiated in reverse.
    """
    count = len(depth) - 1
    if count == 1:
        gained, solved = stage(depth[0], depth[1])
        return gained[None], solved

    def unfinished(state):
        return state[0] < last

    def following(state):
        at, total, gained, solved = state
        more, arrived = stage(depth[at], depth[at + 1])
        total = total + more
        return at + 1, total, jnp.where(jnp.arange(count) >= at, total, gained), solved & arrived

    wide = jnp.diff(depth) > 0
    first, last = jnp.argmax(wide), count - jnp.argmax(wide[::-1])
    zero = jnp.zeros_like(depth[0])
    begin = first, zero, jnp.zeros_like(depth[1:]), zero == zero
    if by_reverse:
        begin = (0 * first, *begin[1:])
        _, _, gained, solved = jax.lax.fori_loop(0, count, lambda _, state: following(state), begin)
    else:
        _, _, gained, solved = jax.lax.while_loop(unfinished, following, begin)
    return gained, solved


def _depths(fall: Fall) -> Array:
    """x_m - x at the ends of all stages, from the top."""
    inside = jnp.sort(jnp.clip(fall.top - fall.kinks, 0.0, fall.span))
    return jnp.concatenate([jnp.zeros(1, inside.dtype), inside, fall.span[None]])


def _about_zero(fall: Fall, high, low):
    """x, x_m - x and its rate on a way that is even in √x."""
    start, end = safe_sqrt(fall.top - high), safe_sqrt(fall.top - low)
    width = (low - high) / (start + end)

    def place(t):
        root = start - width * t
        return root * root, high + width * t * (start + root), 2 * root * width

    return place


def _about_end(fall: Fall, high, low):
    """The same on a way that is even in the root of x - x*, x* the lower end of the stage."""
    width = low - high

    def place(t):
        t = t if fall.smooth else jnp.maximum(t, INSIDE)
        left = 1 - t
        x = fall.bottom + (fall.span - low) + width * left * left
        return x, high + width * t * (1 + left), 2 * width * left

    return place


def times(rise: Fall, fall: Fall, y: Array, route: Any, save=None):
    """The times of both branches, or their states at shares `save` of their angles; and the verdict.

    One loop over the stages of both, so that one program serves all.

    Args:
        save: two increasing arrays in [0, 1], or None.

    Returns:
        of each branch its time [L/V], or (time, overlap, x_m - x, x') at all samples; whether the
        solver got there.
    """
    branches = rise, fall
    forces = [1.25 * branch.force(branch.top, jnp.zeros_like(branch.top)) for branch in branches]
    frequency = jnp.stack([jnp.sqrt(p / b.span) for p, b in zip(forces, branches, strict=True)])
    halves, sure = zip(*map(partial(_halves, y, route), branches, frequency), strict=True)
    which: np.ndarray = np.repeat([0, 1], [len(ends) - 1 for ends in halves])
    places = jnp.stack([jnp.stack([branch.bottom, branch.span]) for branch in branches])
    stages = [jnp.concatenate([ends[k] for ends in halves]) for k in (slice(-1), slice(1, None))]
    stages += [which, np.diff(which, prepend=1) != 0, places[which], frequency[which]]
    if save is not None:
        at = [np.tan(0.25 * np.pi * share) for share in save]
        count = max(map(len, at))
        filled = np.stack([np.append(a, np.ones(count - len(a), a.dtype)) for a in at])
        stages.append(filled[which])

    def stage(state, chosen):
        start, end, branch, begins, (bottom, span), frequency, *at = chosen
        state = jax.tree.map(partial(jnp.where, begins), (1.0, 0.0), state)

        def force_at(x, recovered):
            """Of this branch; the other's force is computed at the peak, where it is a number."""
            rises = branch == 0
            upward = rise.force(*(jnp.where(rises, x, rise.top), jnp.where(rises, recovered, 0.0)))
            downward = fall.force(
                *(jnp.where(rises, fall.top, x), jnp.where(rises, 0.0, recovered))
            )
            return jnp.where(rises, upward, downward)

        field = _angle_field(force_at, bottom, span, frequency)

        def eased(t, state):
            """Over the root of what is left of the way, in which half powers of x - x* are smooth."""
            left = 1 - t
            rates = field(start + (end - start) * t * (1 + left), state)
            return tuple(2 * (end - start) * left * rate for rate in rates)

        zero, one = jnp.zeros_like(end), jnp.ones_like(end)
        portion = _share(start, end, *at) if at else None
        states, solved = solve(eased, zero, one, state, route, portion, smooth=fall.smooth)
        last = jax.tree.map(lambda s: s[-1], states) if at else states
        return last, (states, solved)

    begin = (jnp.ones_like(y), jnp.zeros_like(y))
    _, (states, solved) = jax.lax.scan(stage, begin, tuple(stages))
    solved, rising = jnp.all(solved) & sure[0] & sure[1], len(halves[0]) - 1
    if save is None:
        ends = states[1][np.array([rising - 1, -1])]
        return tuple(ends / frequency), solved
    samples = []
    for k, (branch, ends) in enumerate(zip(branches, halves, strict=True)):
        # of each stage the samples that are inside of it
        inside = jnp.clip(jnp.searchsorted(ends, at[k], side="right") - 1, 0, len(ends) - 2)
        stretch, phase = (s[k * rising + inside, np.arange(len(at[k]))] for s in states)
        sin, cos = _sine_cosine(at[k])
        radius = branch.span * stretch
        left = jnp.minimum(radius * cos, branch.span)
        x, speed = branch.bottom + left, -frequency[k] * radius * sin
        samples.append((phase / frequency[k], x, branch.span - left, speed))
    return tuple(samples), solved


def _halves(y: Array, route: Any, fall: Fall, frequency: Array):
    """tan(φ/2) at the ends of all stages, from 0 to 1, and the verdict on what they follow from."""
    ends, sure = jnp.arange(2, dtype=y.dtype), jnp.ones_like(y, dtype=bool)
    if not len(fall.kinks):
        return ends, sure
    # the angle at which the fall meets a kink follows from its speed there
    reached = fall.reached
    if reached is None:
        reached, sure = energies(fall, y, route)
        reached = reached[:-1]
    speed, left = y * safe_sqrt(reached) / frequency, fall.span - _depths(fall)[1:-1]
    inner = speed / (left + jnp.sqrt(speed * speed + left * left))
    return jnp.concatenate([ends[:1], inner, ends[1:]]), sure


def _sine_cosine(half):
    """Of φ, from tan(φ/2)."""
    below = 1 + half * half
    return 2 * half / below, (1 - half) * (1 + half) / below


def _share(start, end, at):
    """Shares of the root of a stage's way at given places, those outside of the stage at its ends."""
    width = jnp.where(end > start, end - start, 1.0)
    left = jnp.clip((end - at) / width, 0.0, 1.0)
    share = 1 - safe_sqrt(left)
    # to the very end, whatever rounding made of it: the next stage begins with the last sample
    return jnp.append(share, 1.0)


def _angle_field(force, bottom, span, frequency):
    """d/dh of ρ/(x_m - x*) and of Ω t, h = tan(φ/2)."""

    def field(half, state):
        stretch, _ = state
        sin, cos = _sine_cosine(half)
        radius = span * stretch
        left = jnp.clip(radius * cos, 0.0, span)
        acceleration = 1.25 * force(bottom + left, span - left)
        acceleration = acceleration / (frequency * frequency * radius)
        angle_rate = 2 / (1 + half * half) / (sin**2 + acceleration * cos)  # dφ/dh over dφ/d(Ω t)
        return stretch * sin * (acceleration - cos) * angle_rate, angle_rate

    return field
