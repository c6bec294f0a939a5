"""Roots and extrema: what is needed of them, how they are found, and one implicit derivative.

`implicit_root` differentiates whatever finds a root. There are three ways to find one:

    third_order_root   arrays, element by element, of a function with two derivatives and a good start
    refine             the same from any start, by the caller's own third-order steps
    crossing           one number between two others, of any function, to rounding

`reach`, `last_zero` and `largest` look at a force of one impact over all overlaps that a number can
be, so that nothing is missed because it lies far from where it was expected.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.ad_checkpoint import checkpoint_name
from jax.custom_batching import custom_vmap
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array, Bool

OCTAVES = 0.96  # of the numbers' own range
NEAR, SPACING = 3.0, 0.5  # octaves about the guess in which the first look is a close one
POINTS = 33  # on each later level: the last one's are 5 % apart
LEVELS = 4
MARGIN = 2.0  # octaves beyond the peak that are always looked at
HALVINGS = 64  # to the last digit from an octave, as long as anything moves
SHRINKS = 0.8  # Newton steps that shrink less are lost; towards a zero of power p: 1 - 1/p
SOLVED = "solved"  # what a reverse pass keeps: to solve again costs more than to fetch


def mark_for_checkpoint(x: Array) -> Array:
    """Mark a solved number: a reverse pass that computes again keeps it."""
    return x if x.dtype == jax.dtypes.float0 else checkpoint_name(x, SOLVED)


def implicit_root(solve: Callable, residual: Callable, slope: Callable | None = None) -> Callable:
    """A function `root(*params)` with `residual(root, *params) = 0`, differentiated implicitly.

    `solve(*params)` finds the root by any means and is never differentiated. The derivative is
    -(dF/dp)/(dF/dx) at the root, zero where F does not move with x; since the rule asks for the root
    again it is right to any order; one Newton step on a frozen root is right to first order only.
    Elementwise: parameters broadcast, each element of the result is a root of its own.

    Args:
        solve: of a root in [0, 1] it may return the pair (f, 1 - f), each to its own precision: where f
            nears 1 the difference would be lost to rounding.
        slope: dF/dx of (x, *params), where it is known.
    """
    root: Any = jax.custom_jvp(solve)

    @root.defjvp
    def rule(params, tangents):
        result = jax.tree.map(mark_for_checkpoint, root(*params))
        x = result[0] if isinstance(result, tuple) else result
        if slope is None:
            _, steep = jax.jvp(lambda x: residual(x, *params), (x,), (jnp.ones_like(x),))
        else:
            steep = slope(x, *params)
        _, moved = jax.jvp(lambda *p: residual(x, *p), params, tangents)
        flat = steep == 0
        change = jnp.where(flat, 0.0, -moved / jnp.where(flat, 1.0, steep))
        return result, (change, -change) if isinstance(result, tuple) else change

    return root


def third_order_root(
    expand: Callable,
    start: Callable,
    most: int,
    first_steps: int,
    finish: Callable = lambda x, change: x - change,
) -> Callable:
    """A function `solve(*params)` that finds a root above 0 by steps of third order, not differentiated.

    `expand(x, *params)` gives f, f' and f'' and `start(*params)` a value that is right to some
    percent. After `first_steps` one more leaves rounding error where it was small itself. Only if it was
    not for some element, those go on by `refine`, from the rough value again.

    Args:
        finish: of (x, change) what `solve` returns, where the root is x - change and 1 - x has no
            rounding error.
    """

    @elementwise
    def solve(*params):
        dtype = params[0].dtype
        rough = near = start(*params).astype(dtype)
        for _ in range(first_steps):
            near = near - nearest_zero(*expand(near, *params))
        near = jnp.where(jnp.isfinite(near), near, rough)
        change = _halley(*expand(near, *params), otherwise=jnp.inf)  # no step at all: not done
        done = jnp.abs(change) <= _small(near) * jnp.abs(near)

        def mended(near, change, done, rough, params):
            step = lambda x: jnp.maximum(x - parabolic_step(*expand(x, *params)), 0.0)  # noqa: E731
            begin = jnp.where(done, near, rough)
            # to the end: near a double root a step may be small and the root as near on either side
            x = refine(step, begin, ~done, most, settled=8 * float(jnp.finfo(dtype).eps))
            last = _halley(*expand(x, *params), otherwise=0.0)
            # what is done stays as it is to the last digit, whatever its neighbours need
            return finish(x, jnp.where(done, change, last))

        # a branch, since even a loop of no steps has what it needs prepared
        as_it_is = lambda near, change, *_: finish(near, change)  # noqa: E731
        return lax.cond(jnp.all(done), as_it_is, mended, near, change, done, rough, params)

    return solve


def elementwise(f: Callable, mapped: Callable | None = None) -> Callable:
    """f, of arrays element by element, which under `vmap` takes a further axis like the others.

    A branch or a loop that asks all elements would otherwise be computed whatever they answer.
    Then `mapped` is called, if given, in place of the same again, which has no reverse mode.
    """
    wrapped = custom_vmap(f)

    @wrapped.def_vmap
    def rule(axis_size, batched, *values):
        most = max(jnp.ndim(x) - b for x, b in zip(values, batched, strict=True))
        aligned = [
            x.reshape(axis_size, *(1,) * (most + 1 - x.ndim), *x.shape[1:]) if b else x
            for x, b in zip(values, batched, strict=True)
        ]
        results = (mapped or wrapped)(*aligned)
        return results, jax.tree.map(lambda _: True, results)

    return wrapped


def compute_if_any(f: Callable, needed: Array, *values: Array) -> Array:
    """f(*values), element by element, computed only if `needed` holds anywhere; else zeros.

    Differentiable to any order, and under `vmap` still computed only where some element needs it.
    """

    @jax.custom_jvp
    def chosen(needed, *values):
        return elementwise(branch)(needed, *values)

    def branch(needed, *values):
        kind = jax.eval_shape(f, *values)
        shape = jnp.broadcast_shapes(needed.shape, *map(jnp.shape, values))
        full = lambda *values: jnp.broadcast_to(f(*values), shape)  # noqa: E731

        def none(*values):
            # made of the same arrays: within `shard_map` both branches have to vary alike
            any_of = sum((x != x for x in values), start=needed)
            zero = jnp.zeros((), kind.dtype)
            return jnp.where(jnp.broadcast_to(any_of, shape), zero, zero)

        return lax.cond(jnp.any(needed), full, none, *values)

    def rule(primals, tangents):
        changes = []
        for k, tangent in enumerate(tangents[1:]):
            if not isinstance(tangent, SymbolicZero):
                slope = compute_if_any(_slope(f, k), *primals)
                changes.append(jnp.broadcast_to(tangent, slope.shape) * slope)
        return chosen(*primals), sum(changes[1:], start=changes[0])

    chosen.defjvp(rule, symbolic_zeros=True)
    return chosen(needed, *values)


def _slope(f: Callable, k: int) -> Callable:
    """The derivative of f, of arrays element by element, by its k-th argument."""

    def slope(*values):
        shape = jnp.broadcast_shapes(*map(jnp.shape, values))
        at = jnp.broadcast_to(values[k], shape)
        along = lambda x: f(*values[:k], x, *values[k + 1 :])  # noqa: E731
        return jax.jvp(along, (at,), (jnp.ones_like(at),))[1]

    return slope


def _halley(f, slope, curvature, otherwise) -> Array:
    """Halley's step, of third order without a square root, where f rises and is nearly straight.

    Elsewhere a small step may be at no root, or at the one on the falling side.
    """
    straight = jnp.abs(f * curvature) <= 4 * _small(f) * slope * slope
    usable = straight & (slope > 0)
    below = jnp.where(usable, 2 * slope * slope - f * curvature, 1.0)
    return jnp.where(usable, 2 * f * slope / below, otherwise)


def _small(x: Array) -> float:
    """The relative step by a method of third order that leaves nothing but rounding error."""
    return 0.5 * float(jnp.finfo(x.dtype).eps) ** (1 / 3)


def refine(
    step: Callable[[Array], Array],
    start: Array,
    moving: Array,
    most: int,
    settled: float | None = None,
) -> Array:
    """A root by `step` from x to a better x, of third order, until no element moves any more.

    An element stops when its own relative step was within `settled`, else so small that a
    third-order method has nothing left to do; it does not move while others still do, so that no
    impact depends on its neighbours. Nothing is differentiated here. Stored after each step: unrolled, XLA computes all earlier steps again
    for every later one (seven times the time, measured).
    """

    settled = _small(start) if settled is None else settled

    def unfinished(state):
        _, moving, count = state
        return jnp.any(moving) & (count < most)

    def advanced(state):
        x, moving, count = state
        new = step(x)
        still = moving & (jnp.abs(new - x) > settled * jnp.abs(new))
        return jnp.where(moving, new, x), still, count + 1

    return lax.while_loop(unfinished, advanced, (start, moving, 0))[0]


def nearest_zero(f: Array, slope: Array, curvature: Array) -> Array:
    """The step to the nearest zero of the parabola through f, f' > 0 and f'' (Euler's method).

    Where the parabola has none, twice Newton's step.
    """
    discriminant = jnp.maximum(slope * slope - 2 * f * curvature, 0.0)
    return 2 * f / (slope + jnp.sqrt(discriminant))


def parabolic_step(f: Array, slope: Array, curvature: Array) -> Array:
    """`nearest_zero` for any f' and f''.

    Third order, and still fast where f has nearly a double root, where Newton's method halves the
    error at best: 7 steps from the elastic overlap where Newton took over 20. Where the
    parabola has no zero, or lies on its falling side away from one, the step goes to the vertex.
    """
    discriminant = slope * slope - 2 * f * curvature
    # beyond the top of a concave parabola (slope < 0 < f) this is its zero on the rising side
    reach = slope + jnp.sqrt(jnp.maximum(discriminant, 0.0))
    none = (discriminant < 0) | (reach <= 0) | ((slope < 0) & (curvature > 0))
    bent = jnp.where(curvature != 0, curvature, 1.0)
    return jnp.where(none, slope, 2 * f) / jnp.where(none, bent, reach)


# one impact's forces: single numbers, under `vmap`, not differentiated


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
        bracket, count = state
        return (count < LEVELS) & ~bracket.settled

    def finer(state):
        bracket, count = state
        low, high, below = bracket.window
        return look(low + (high - low) * shares, below), count + 1

    octaves = _first_octaves(guess.dtype)
    first = _look(force, energy, guess * np.exp2(octaves), jnp.asarray(octaves), 0 * guess)
    bracket, _ = lax.while_loop(unfinished, finer, (first, 0))
    end = crossing(force, bracket.inside, bracket.outside)
    ends = bracket.ends
    top = jnp.where(ends, end, bracket.top)
    return Reach(bracket.rough, jnp.where(ends, end, jnp.inf), bracket.turns, top)


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
    forces = jax.vmap(force)(x)
    index, undefined = np.arange(len(octave)), jnp.isnan(forces)
    # where not even the smallest overlap can be distinguished from 0, there is no force yet
    lost = undefined & (index > jnp.argmax(~undefined))
    known = index < jnp.where(jnp.any(lost), jnp.argmax(lost), len(octave))
    # over the energy before anything is multiplied: products of tiny numbers are none
    most = float(info.max) / len(octave)
    share = jnp.clip(jnp.where(undefined, 0.0, forces / energy), -most, most)
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
    vanished = ~(forces > 0) & (index >= at) & (octave <= last)
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
        value, slope = jax.jvp(force, (x,), (jnp.ones_like(x),))
        good = value > 0
        inside, outside = jnp.where(good, x, state.inside), jnp.where(good, state.outside, x)
        step = -value / slope
        share = step / state.step
        evenly = (share > 0.05) & (share < 0.9)
        to = x + step / jnp.where(evenly, 1 - share, 1.0)
        to = jnp.where((to - inside) * (to - outside) <= 0, to, x + step)
        least = rounding * jnp.abs(x)
        between = (to - inside) * (to - outside) <= 0
        arrived = between & (jnp.abs(to - x) <= least)
        newton = between & (jnp.abs(step) <= SHRINKS * state.change)
        new = jnp.where(newton | arrived, to, 0.5 * (inside + outside))
        # the end may have been no zero, where beyond that a force is no number: the last place before it
        before = outside + 0.5 * jnp.sign(inside - outside) * least
        new = jnp.where(between & ~arrived & (jnp.abs(to - outside) <= least), before, new)
        change = jnp.where(newton, jnp.abs(step), jnp.abs(outside - inside))
        step = jnp.where(newton & ~evenly, step, 0.0)
        return _Crossing(new, inside, outside, step, change, arrived, state.count + 1)

    middle, width = 0.5 * (inside + outside), jnp.abs(outside - inside)
    begin = _Crossing(middle, inside, outside, 0 * middle, width, width < 0, 0)
    end = lax.while_loop(unfinished, look, begin)
    # beyond its zero a force may be no number, as (x - x*)^{3/2} is: there the last that is one
    back = end.at + jnp.sign(end.inside - end.at) * 2 * rounding * jnp.abs(end.at)
    back = jnp.where(jnp.isnan(force(back)), end.inside, back)
    last = jnp.where(jnp.isnan(force(end.at)), back, end.at)
    return jnp.where(end.arrived, last, end.inside)


def last_zero(force: Callable[[Array, Array], Array], peak: Array) -> tuple[Array, Array]:
    """The first overlap below the peak at which the force is no longer positive.

    Looked for at shares of the peak that come close to it, and to zero, by octaves; between three of them
    where the force is least in the middle its minimum is looked for, in case it vanishes there. What a force
    does between two of them without any of that is not seen.

    Args:
        force: of the overlap x and of x_m - x.

    Returns:
        x, 0 where there is none, and x_m - x, each to its own precision.
    """
    near, far = (peak * jnp.asarray(part, peak.dtype) for part in _shares(peak.dtype))
    recovered, x = jnp.concatenate([near, peak - far]), jnp.concatenate([peak - near, far])
    at_shares = jax.vmap(force)(x, recovered)
    lowest = _dip(force, peak, x, at_shares)
    dips = ~(force(lowest, peak - lowest) > 0)
    # in the place of the first share below it: its own neighbour above is where the force is positive
    below = jnp.argmax(x < lowest)
    replaced = dips & (jnp.arange(len(x)) == below)
    x = jnp.where(replaced, lowest, x)
    recovered = jnp.where(replaced, peak - lowest, recovered)
    gone = ~(at_shares > 0) | replaced
    exists, first = jnp.any(gone), jnp.argmax(gone)
    before = jnp.maximum(first - 1, 0)
    # by halves of what is the smaller, so that each has all its digits
    is_near = first < len(near)
    above = jnp.where(first > 0, jnp.where(is_near, recovered[before], x[before]), 0.0)
    below = jnp.where(is_near, recovered[first], x[first])

    def force_at(part):
        rest = peak - part
        return force(jnp.where(is_near, rest, part), jnp.where(is_near, part, rest))

    part = crossing(force_at, above, jnp.where(exists, below, above))
    x, recovered = jnp.where(is_near, peak - part, part), jnp.where(is_near, part, peak - part)
    return jnp.where(exists, x, 0.0), jnp.where(exists, recovered, peak)


def _dip(force, peak: Array, x: Array, values: Array) -> Array:
    """Where the force is least between two of its values that fall and rise again: the first it may vanish at.

    By golden sections, or, where it falls all the way, the peak. The parabola through three values says where
    the force may vanish; the first of these is taken, from the peak, else the one with the lowest parabola.
    """
    left, middle, right = values[:-2], values[1:-1], values[2:]
    is_dip = (middle < left) & (middle <= right) & (right > 0) & (middle > 0)
    first, second = x[1:-1] - x[:-2], x[2:] - x[1:-1]
    rise, fall = (right - middle) / second, (middle - left) / first
    bend = (rise - fall) / (first + second)
    slope = (rise * first + fall * second) / (first + second)
    vertex = middle - slope * slope / (4 * jnp.where(is_dip, bend, 1.0))
    vertex = jnp.where(is_dip, vertex, jnp.inf)
    may_vanish = vertex <= 0
    at = jnp.where(jnp.any(may_vanish), jnp.argmax(may_vanish), jnp.argmin(vertex))
    golden = 0.5 * (5**0.5 - 1)

    def unfinished(state):
        _, _, count = state
        return count < SHORTENINGS

    def shorten(state):
        low, high, count = state
        left, right = high - golden * (high - low), low + golden * (high - low)
        rises = force(left, peak - left) < force(right, peak - right)
        return jnp.where(rises, low, left), jnp.where(rises, right, high), count + 1

    # no section where nothing dips
    begin = jnp.where(jnp.any(is_dip), 0, SHORTENINGS)
    low, high, _ = lax.while_loop(unfinished, shorten, (x[at + 2], x[at], begin))
    return jnp.where(jnp.any(is_dip), 0.5 * (low + high), peak)


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

    Inside of the way it is where the force is stationary: F'(x) = 0. There dF is that at a fixed place, and d²F
    needs dx = -dF'/F'' of the place, which two of Newton's steps from a frozen one give (to third order).
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
    place = lax.stop_gradient(0.5 * (low + high))
    inside = lax.stop_gradient(force(place) > force(still))
    return force(jnp.where(inside, _stationary(force, place), end))


def _stationary(force: Callable[[Array], Array], place: Array) -> Array:
    """The place itself, with the derivatives of the zero of F' that it is near."""
    frozen = place
    for _ in range(2):
        along = lambda f, x: jax.jvp(f, (x,), (jnp.ones_like(x),))[1]  # noqa: E731
        slope = partial(along, force)
        first, second = jax.jvp(slope, (place,), (jnp.ones_like(place),))
        bent = second < 0
        # where it is flat, or has a kink, the place stays
        place = place - jnp.where(bent, first, 0.0) / jnp.where(bent, second, 1.0)
    return frozen + (place - lax.stop_gradient(place))


def chebyshev_shares(dtype) -> np.ndarray:
    """Shares of a way at which samples make a polynomial through it."""
    return (np.sin(np.linspace(0, 0.5 * np.pi, SAMPLES)) ** 2).astype(dtype)


def largest_of_samples(values: Array) -> Array:
    """The largest value of the polynomial through samples at `chebyshev_shares`, by its barycentric form."""
    nodes = chebyshev_shares(values.dtype)
    weights = (-1.0) ** np.arange(SAMPLES)
    weights[[0, -1]] *= 0.5
    weights = weights.astype(values.dtype)

    def between(share):
        away = share - nodes
        at = jnp.argmin(jnp.abs(away))
        parts = weights / jnp.where(away == 0, 1.0, away)
        return jnp.where(away[at] == 0, values[at], jnp.sum(parts * values) / jnp.sum(parts))

    return largest(between, jnp.ones_like(values[0]))
