"""Where one impact's forces take it, found from the forces alone: roughly the peak, and zeros.

Overlaps are looked for over all that a number can be, so that nothing is missed because it lies far
from where it was expected. All here is for single numbers, under `vmap`, and not differentiated.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool

OCTAVES = 0.96  # of the numbers' own range
NEAR, SPACING = 3.0, 0.5  # octaves about the guess in which the first look is a close one
POINTS = 33  # on each later level: the last one's are 5 % apart
LEVELS = 4
MARGIN = 2.0  # octaves beyond the peak that are always looked at
HALVINGS = 64  # to the last digit from an octave, as long as anything moves
SHRINKS = 0.8  # Newton steps that shrink less are lost; towards a zero of power p: 1 - 1/p


class Reach(NamedTuple):
    """How far loading goes.

    Attributes:
        rough: the overlap, to some percent, where the loading work reaches the impact's energy, or
            where it is largest if it never does.
        end: where the loading force vanishes next; infinite where it does not within an octave.
        turns: whether the work reaches the energy, as far as the rough look shows.
        top: an overlap safely beyond the first, no farther than `end`.
    """

    rough: Array
    end: Array
    turns: Bool[Array, ""]
    top: Array


class _Look(NamedTuple):
    """What one grid of overlaps shows, and where to look next.

    Attributes:
        window: octaves from the guess between which to look next, and the work up to the first.
        rough, turns, top: see `Reach`.
        inside, outside: about the end of the force; the same where none is seen.
        ends: whether the force vanishes on this grid, not far beyond the peak.
        settled: whether a finer grid would show no more.
    """

    window: tuple[Array, Array, Array]
    rough: Array
    turns: Bool[Array, ""]
    top: Array
    inside: Array
    outside: Array
    ends: Bool[Array, ""]
    settled: Bool[Array, ""]


def reach(force: Callable[[Array], Array], energy: Array, guess: Array) -> Reach:
    """How far a body of this energy comes against a loading force of the overlap.

    The work is added up by trapezoids: first over all that a number can be, closely about the guess;
    then on ever finer grids around where the work first reaches the energy, unless that is seen
    already. Where the force is no number, the law has ended.
    """
    shares = jnp.asarray(np.linspace(0, 1, POINTS), guess.dtype)

    def look(octave, below):
        return _look(force, energy, guess * jnp.exp2(octave), octave, below)

    def unfinished(state):
        found, count = state
        return (count < LEVELS) & ~found.settled

    def finer(state):
        found, count = state
        low, high, below = found.window
        return look(low + (high - low) * shares, below), count + 1

    octaves = _first_octaves(guess.dtype)
    first = _look(force, energy, guess * np.exp2(octaves), jnp.asarray(octaves), 0 * guess)
    found, _ = lax.while_loop(unfinished, finer, (first, 0))
    end = last_true(lambda x: force(x) > 0, found.inside, found.outside)
    ends = found.ends
    top = jnp.where(ends, end, found.top)
    return Reach(found.rough, jnp.where(ends, end, jnp.inf), found.turns, top)


def _first_octaves(dtype):
    """Of all numbers over the guess: evenly about it, then ever farther apart."""
    info = jnp.finfo(dtype)
    near = np.arange(-NEAR, NEAR + SPACING, SPACING)
    far = NEAR * 4.0 ** np.arange(1, 7)
    low, high = (OCTAVES * np.log2(float(end)) for end in (info.tiny, info.max))
    below, above = -far[::-1], far
    return np.r_[low, below[below > low], near, above[above < high], high].astype(dtype)


def _look(force, energy, x, octave, below) -> _Look:
    """The work at overlaps whose octaves from the guess increase, `below` at the first."""
    info = jnp.finfo(x.dtype)
    x = jnp.minimum(x, float(info.max))
    pull = jax.vmap(force)(x)
    index, undefined = np.arange(len(octave)), jnp.isnan(pull)
    # where not even the smallest overlap can be distinguished from 0, there is no force yet
    lost = undefined & (index > jnp.argmax(~undefined))
    known = index < jnp.where(jnp.any(lost), jnp.argmax(lost), len(octave))
    # over the energy before anything is multiplied: products of tiny numbers are none
    most = float(info.max) / len(octave)
    share = jnp.clip(jnp.where(undefined, 0.0, pull / energy), -most, most)
    step = jnp.clip(jnp.diff(x) * (0.5 * (share[1:] + share[:-1])), -most, most)
    step = jnp.where(known[1:], step, 0.0)
    # as a product, which takes a tenth of the time of `cumsum`
    sums = np.triu(np.ones((len(index) - 1, len(index)), x.dtype), 1)
    work = below + jnp.matmul(step, sums, precision=lax.Precision.HIGHEST)
    reached = known & (work >= 1)
    turns = jnp.any(reached)
    at = jnp.where(turns, jnp.argmax(reached), jnp.argmax(jnp.where(known, work, -jnp.inf)))
    start, before = jnp.maximum(at - 2, 0), jnp.maximum(at - 1, 0)
    stop = jnp.minimum(at + 1, len(octave) - 1)
    beyond = 0.5 * (octave[start] + octave[stop]) + MARGIN
    window = octave[start], jnp.maximum(octave[stop], beyond), jnp.maximum(work[start], 0.0)
    last = jnp.minimum(octave[at] + MARGIN, octave[-1])
    vanished = ~(pull > 0) & (index >= at) & (octave <= last)
    ends, gone = jnp.any(vanished), jnp.argmax(vanished)
    kept = x[jnp.maximum(gone - 1, 0)]
    part = (1 - work[before]) / jnp.where(turns & (at > 0), work[at] - work[before], jnp.inf)
    close = octave[stop] - octave[start] <= 3.5 * SPACING
    return _Look(
        window=window,
        rough=x[at] - jnp.where(turns & (at > 0), (1 - part) * (x[at] - x[before]), 0.0),
        turns=turns,
        top=jnp.minimum(x[at] * 2.0**MARGIN, x[-1]),
        inside=kept,
        outside=jnp.where(ends, x[gone], kept),
        ends=ends,
        settled=turns & close & ~ends & (at > 0),
    )


def last_true(holds: Callable[[Array], Array], inside: Array, outside: Array) -> Array:
    """The last number at which `holds`, which it does at `inside` and not at `outside`."""

    def unfinished(state):
        inside, outside, count = state
        middle = 0.5 * (inside + outside)
        return (count < HALVINGS) & (middle != inside) & (middle != outside)

    def halve(state):
        inside, outside, count = state
        middle = 0.5 * (inside + outside)
        good = holds(middle)
        return jnp.where(good, middle, inside), jnp.where(good, outside, middle), count + 1

    return lax.while_loop(unfinished, halve, (inside, outside, 0))[0]


class _Crossing(NamedTuple):
    """A search for where a force vanishes: where it looked last, between what, and how it went."""

    at: Array
    inside: Array
    outside: Array
    step: Array  # the last one, 0 where it was no Newton step
    change: Array
    arrived: Bool[Array, ""]
    count: Array


def crossing(force: Callable[[Array], Array], inside: Array, outside: Array) -> Array:
    """Where a force, positive at `inside` and not at `outside`, vanishes; to rounding.

    By Newton's steps as long as they shrink, lengthened where they shrink evenly, as
    they do towards a zero of another power than one (Aitken); else by halving. Where the force
    jumps, the last number at which it is positive.
    """
    rounding = 2 * float(jnp.finfo(inside.dtype).eps)

    def unfinished(state):
        least = rounding * jnp.abs(state.at)
        wide = jnp.abs(state.outside - state.inside) > least
        return (state.count < HALVINGS) & wide & ~state.arrived

    def look(state):
        x = state.at
        pull, slope = jax.jvp(force, (x,), (jnp.ones_like(x),))
        good = pull > 0
        inside, outside = jnp.where(good, x, state.inside), jnp.where(good, state.outside, x)
        step = -pull / slope
        share = step / state.step
        evenly = (share > 0.05) & (share < 0.9)
        to = x + step / jnp.where(evenly, 1 - share, 1.0)
        to = jnp.where((to - inside) * (to - outside) <= 0, to, x + step)
        least = rounding * jnp.abs(x)
        between = (to - inside) * (to - outside) <= 0
        arrived = between & ((jnp.abs(to - x) <= least) | (jnp.abs(to - outside) <= least))
        newton = between & (jnp.abs(step) <= SHRINKS * state.change)
        new = jnp.where(newton | arrived, to, 0.5 * (inside + outside))
        change = jnp.where(newton, jnp.abs(step), jnp.abs(outside - inside))
        step = jnp.where(newton & ~evenly, step, 0.0)
        return _Crossing(new, inside, outside, step, change, arrived, state.count + 1)

    middle, width = 0.5 * (inside + outside), jnp.abs(outside - inside)
    begin = _Crossing(middle, inside, outside, 0 * middle, width, width < 0, 0)
    found = lax.while_loop(unfinished, look, begin)
    # beyond its zero a force may be no number, as (x - x*)^{3/2} is: there the last that is one
    back = found.at + jnp.sign(found.inside - found.at) * 2 * rounding * jnp.abs(found.at)
    back = jnp.where(jnp.isnan(force(back)), found.inside, back)
    last = jnp.where(jnp.isnan(force(found.at)), back, found.at)
    return jnp.where(found.arrived, last, found.inside)


class Zero(NamedTuple):
    """The last zero of a force below the peak, or none.

    Attributes:
        x: where it is; 0 where there is none.
        recovered: from there to the peak, each to its own precision.
        found: whether there is one.
    """

    x: Array
    recovered: Array
    found: Bool[Array, ""]


def last_zero(force: Callable[[Array, Array], Array], peak: Array) -> Zero:
    """The first overlap below the peak at which the force is no longer positive.

    Looked for at shares of the peak that come close to it, and to zero, by octaves; what a force
    does between two of them and back again is not seen.

    Args:
        force: of the overlap x and of x_m - x.
    """
    near, far = (peak * jnp.asarray(part, peak.dtype) for part in _shares(peak.dtype))
    recovered, x = jnp.concatenate([near, peak - far]), jnp.concatenate([peak - near, far])
    gone = ~(jax.vmap(force)(x, recovered) > 0)
    found, first = jnp.any(gone), jnp.argmax(gone)
    before = jnp.maximum(first - 1, 0)
    # by halves of what is the smaller, so that each has all its digits
    is_near = first < len(near)
    above = jnp.where(first > 0, jnp.where(is_near, recovered[before], x[before]), 0.0)
    below = jnp.where(is_near, recovered[first], x[first])

    def pull(part):
        rest = peak - part
        return force(jnp.where(is_near, rest, part), jnp.where(is_near, part, rest))

    part = crossing(pull, above, jnp.where(found, below, above))
    x, recovered = jnp.where(is_near, peak - part, part), jnp.where(is_near, part, peak - part)
    return Zero(jnp.where(found, x, 0.0), jnp.where(found, recovered, peak), found)


def _shares(dtype) -> tuple[np.ndarray, np.ndarray]:
    """Of the peak: of what is recovered, up to a quarter, and of the overlap from there on."""
    digits = jnp.finfo(dtype).nmant
    near: np.ndarray = np.append(
        np.exp2(np.arange(-digits - 8.0, -8.0, 2)), np.exp2(np.arange(-8.0, -1.0))
    )
    far: np.ndarray = np.append(
        np.exp2(np.arange(-6.0, -10.0, -1)), np.exp2(np.arange(-10.0, -digits, -2))
    )
    return near, np.append(np.arange(0.74, 0.0, -0.04), far)


SAMPLES, SHORTENINGS = 33, 44  # of the way; golden sections from two of their gaps to rounding


def largest(force: Callable[[Array], Array], end: Array) -> Array:
    """The largest force on the way from 0 to `end`, of arrays of ways element by element.

    Inside of the way it is where the force is stationary, so its place need not be differentiated.
    """
    shares = np.linspace(0, 1, SAMPLES) ** 2
    column = (-1,) + (1,) * jnp.ndim(end)
    still = lax.stop_gradient(end)
    seen = jax.vmap(force)(jnp.asarray(shares, end.dtype).reshape(column) * still)
    seen = jnp.where(jnp.isnan(seen), -jnp.inf, seen)
    at = jnp.argmax(seen, axis=0)
    shares = jnp.asarray(shares, end.dtype)
    low = still * shares[jnp.maximum(at - 1, 0)]
    high = still * shares[jnp.minimum(at + 1, SAMPLES - 1)]
    golden = 0.5 * (5**0.5 - 1)

    def shorten(_, ends):
        low, high = ends
        left, right = high - golden * (high - low), low + golden * (high - low)
        rises = force(left) < force(right)
        return jnp.where(rises, left, low), jnp.where(rises, high, right)

    low, high = lax.fori_loop(0, SHORTENINGS, shorten, (low, high))
    inside = lax.stop_gradient(force(0.5 * (low + high)) > force(still))
    return force(jnp.where(inside, lax.stop_gradient(0.5 * (low + high)), end))
