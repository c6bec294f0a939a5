"""Where one impact's forces take it, found from the forces alone: roughly the peak, and zeros.

Overlaps are looked for over all that a number can be, so that nothing is missed because it lies far
from where it was expected. All here is for single numbers, under `vmap`, and not differentiated.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool

OCTAVES = 0.96  # of the numbers' own range
POINTS = 33  # on each level: the last one's are 5 % apart
LEVELS = 4
MARGIN = 2.0  # octaves beyond the peak that are always looked at
HALVINGS = 64  # to the last digit from an octave, as long as anything moves


class Reach(NamedTuple):
    """How far loading goes.

    Attributes:
        rough: the overlap, to some percent, where the loading work reaches the impact's energy, or
            where it is largest if it never does.
        end: where the loading force vanishes next; infinite where it does not within an octave.
        turns: whether the work reaches the energy, as far as the rough look tells.
        top: an overlap safely beyond the first, no farther than `end`.
    """

    rough: Array
    end: Array
    turns: Bool[Array, ""]
    top: Array


def reach(force: Callable[[Array], Array], energy: Array, guess: Array) -> Reach:
    """How far a body of this energy comes against a loading force of the overlap.

    The work is added up by trapezoids over the logarithm of the overlap, on ever finer grids around
    where it first reaches the energy. Where the force is no number, the law has ended.
    """
    dtype = guess.dtype
    info = jnp.finfo(dtype)
    low, high = (OCTAVES * np.log2(float(end)) for end in (info.tiny, info.max))
    shares = jnp.asarray(np.linspace(0, 1, POINTS), dtype)

    def look(_, before):
        low, high, below = before[0]
        octave = low + (high - low) * shares
        x = guess * jnp.exp2(octave)
        pull = jax.vmap(force)(x)
        undefined = jnp.isnan(pull)
        # where not even the smallest overlap can be told from none, there is no force yet
        known = jnp.cumsum(undefined & (jnp.cumsum(~undefined) > 0)) == 0
        # over the energy before anything is summed: products of tiny numbers are none
        power = math.log(2) * x * jnp.where(undefined, 0.0, pull / energy)
        step = 0.5 * (power[1:] + power[:-1]) * jnp.diff(octave)
        work = below + jnp.append(0.0, jnp.cumsum(jnp.where(known[1:], step, 0.0)))
        reached = known & (work >= 1)
        turns = jnp.any(reached)
        at = jnp.where(turns, jnp.argmax(reached), jnp.argmax(jnp.where(known, work, -jnp.inf)))
        start, stop = jnp.maximum(at - 2, 0), jnp.minimum(at + 1, POINTS - 1)
        upper = jnp.maximum(octave[stop], 0.5 * (octave[start] + octave[stop]) + MARGIN)
        return (octave[start], upper, jnp.maximum(work[start], 0.0)), (x, pull, turns, at)

    window = tuple(jnp.asarray(part, dtype) for part in (low, high, 0.0))
    blank = guess + 0 * shares
    nothing = (blank, blank, guess > guess, jnp.zeros((), jnp.argmax(blank).dtype))
    _, (x, pull, turns, at) = lax.fori_loop(0, LEVELS, look, (window, nothing))
    vanished = ~(pull > 0) & (jnp.arange(POINTS) > at)
    ends, first = jnp.any(vanished), jnp.argmax(vanished)
    last = jnp.maximum(first - 1, 0)
    end = last_true(lambda x: force(x) > 0, x[last], jnp.where(ends, x[first], x[last]))
    return Reach(x[at], jnp.where(ends, end, jnp.inf), turns, jnp.where(ends, end, x[-1]))


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
    # by halves of what is the smaller, so that each has all its digits
    before = jnp.where(first > 0, recovered[first - 1], 0.0)
    above = jnp.where(first > 0, x[first - 1], peak)
    is_near = first < len(near)
    by_recovered = last_true(
        lambda r: force(peak - r, r) > 0,
        before,
        jnp.where(found & is_near, recovered[first], before),
    )
    by_overlap = last_true(
        lambda x: force(x, peak - x) > 0, above, jnp.where(found & ~is_near, x[first], above)
    )
    x = jnp.where(is_near, peak - by_recovered, by_overlap)
    recovered = jnp.where(is_near, by_recovered, peak - by_overlap)
    return Zero(jnp.where(found, x, 0.0), jnp.where(found, recovered, peak), found)


def _shares(dtype) -> tuple[np.ndarray, np.ndarray]:
    """Of the peak: of what is recovered, up to a quarter, and of the overlap from there on."""
    digits = jnp.finfo(dtype).nmant
    near = np.exp2(np.arange(-digits - 8.0, -1.0))
    return near, np.append(np.arange(0.74, 0.0, -0.04), np.exp2(np.arange(-6.0, -digits, -1)))
