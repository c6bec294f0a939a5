"""A collision in time: M δ'' = -P(δ, δ') by `diffrax.diffeqsolve`, each branch ended by an event.

With X = x/L, U = x'/y and L = y^{2/k}, the overlap that the elastic power law of work x^k reaches at the
velocity y, and with time in L/y, the reduced equation x'' = -(5/4) p becomes

    dX/dt = U,    dU/dt = -(5/4) (L/y²) p,    X(0) = 0,  U(0) = 1,

for any law. Loading ends where U falls through 0; unloading where the force does, or the overlap if that comes
first (of damped laws that end at zero overlap: there alone). Nothing is shared with the other routes but the
law: neither their variables nor their knowledge of where a branch ends. Where loading is lost, because its force
pulls or is no number, no body comes to rest.

Linear springs have k = 2: X = sin t, so that the duration is π, whatever the stiffness. Numbers of Hertz's
contact against this: 2.943 L/y.

>>> import softjax as sj
>>> sj.enable_x64()
>>> pair = sj.Contact.between_spheres(sj.NYLON, sj.NYLON, 0.0127, 0.0127)
>>> spring = sj.LinearSpringDashpot(pair, stiffness=1e6, restitution=0.5)
>>> hit = sj.restitution(spring, 2.0, sj.TimeODE())
>>> print(f"{hit.coefficient:.5f} {hit.duration / sj.restitution(spring, 2.0).duration:.7f}")
0.50000 1.0000000
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from softjax.engine import outcome
from softjax.engine.bridge import advance, until
from softjax.engine.outcome import Collision, Peak, Rebound, UnloadingEnd
from softjax.fields import Flags, Numbers
from softjax.laws.reduced import ReducedRateDependent, ReducedRateIndependent
from softjax.numerics.roots import chebyshev_shares, largest_of_samples

LEAST = (
    1e-30  # overlap at which a force is taken where there is none: laws are of positive overlaps
)
NOTHING = 1e-30  # of the force at the peak: a force that is cut off at 0 does not fall below it
ASIDE = 1e-14  # velocity just beyond the peak: a force may jump where the velocity changes its sign
JUMP = 1e-3  # of the force at the peak: what is left of it just before it vanishes, but for a jump
CREEPS = 1e-9  # of overlap and velocity: a contact that damping keeps from ending
GAIN = 30.0  # tolerances that ε_p² of an elastic collision may be off


class Motion(NamedTuple):
    """One impact, what its force depends on.

    Attributes:
        law: reduced.
        length, unit: L, and (5/4) L/y².
        y: impact velocity.
        top: X at the peak, 1 on loading.
    """

    law: Any
    length: Numbers
    unit: Numbers
    y: Numbers
    top: Numbers


class State(NamedTuple):
    """X and U."""

    overlap: Numbers
    velocity: Numbers


class Branch(NamedTuple):
    """A branch of the motion: functions of a `Motion` and a `State`.

    Attributes:
        force: (5/4) (L/y²) p.
        ends: falls through 0 at the end of the branch.
        released: falls through 0 where the force vanishes, which ends it too; None: it does not.
        lost: whether the force leads nowhere.
    """

    force: Callable
    ends: Callable
    released: Callable | None
    lost: Callable


class End(NamedTuple):
    """The end of a branch.

    Attributes:
        time, state: there.
        reached, lost: whether the body got there; whether its force led nowhere. Neither: steps were used up.
    """

    time: Numbers
    state: State
    reached: Flags
    lost: Flags


def _end(branch: Branch, motion: Motion, start: State, route: Any) -> End:
    """The end of a branch; differentiated as a root of what ends it, by the motion up to that time."""
    settings = route.tolerance, route.max_steps

    def field_of(motion):
        return lambda state: (state[1], -branch.force(motion, State(*state)))

    @jax.custom_jvp
    def found(motion: Motion, start: State) -> End:
        ends = [end for end in (branch.released, branch.ends, branch.lost) if end is not None]
        at = [lambda state, end=end: end(motion, State(*state)) for end in ends]
        time, state, which = until(field_of(motion), at, tuple(start), *settings)
        return End(time, State(*state), sum(which[1:-1], start=which[0]) > 0, which[-1])

    @found.defjvp
    def rule(primals, tangents):
        end, (motion, _) = found(*primals), primals
        time = jnp.where(end.reached, end.time, 1.0)

        def there(motion, start):
            return State(*advance(field_of(motion), tuple(start), time, *settings))

        state, moved = jax.jvp(there, primals, tangents)
        rates = State(*field_of(motion)(state))

        def later(ends, step=0.0):
            """By how much the branch ends later, and how steeply it does, at an overlap so much larger."""
            here = state._replace(overlap=state.overlap + step)
            _, change = jax.jvp(ends, (motion, here), (tangents[0], moved))
            _, rate = jax.jvp(lambda state: ends(motion, state), (here,), (rates,))
            return jnp.where(rate == 0, 0.0, -change / jnp.where(rate == 0, 1.0, rate)), rate

        delay, _ = later(branch.ends)
        if branch.released is not None:
            direct, rate = later(branch.released)
            way = motion.top - state.overlap
            step = float(jnp.finfo(time.dtype).eps) ** (1 / 3) * way
            near = [later(branch.released, k * step)[0] for k in (1, 2, 3)]
            limit = 3 * near[0] - 3 * near[1] + near[2]  # of the parabola through them
            steep = jnp.abs(rate) * way > outcome.STRAIGHT * jnp.abs(state.velocity)
            direct = jnp.where(
                steep, direct, limit
            )  # a force like (x - x*)^{3/2} has no slope there
            delay = jnp.where(_releases(branch, motion, end.state), direct, delay)
        change = jax.tree.map(lambda moved, rate: moved + rate * delay, moved, rates)
        none = np.zeros((), jax.dtypes.float0)
        return end, End(delay, change, none, none)

    return found(motion, start)


def _releases(branch: Branch, motion: Motion, state: State) -> Flags:
    """Whether the force vanishes at some positive overlap: and not only below the smallest numbers."""
    if branch.released is None:
        return jnp.zeros_like(state.overlap, dtype=bool)
    nearer = branch.released(motion, state._replace(overlap=0.9 * state.overlap))
    return (state.overlap > 0) & ~(nearer > 0)


def _at(motion: Motion, state: State) -> Numbers:
    """The overlap, above zero, reduced."""
    return motion.length * jnp.maximum(state.overlap, LEAST)


def _is_attractive(force: Callable) -> Callable:
    return lambda motion, state: ~(force(motion, state) >= 0)


def _is_no_number(force: Callable) -> Callable:
    return lambda motion, state: jnp.isnan(force(motion, state))


def _velocity(_, state: State) -> Numbers:
    return state.velocity


def _overlap(motion: Motion, state: State) -> Numbers:
    return state.overlap / motion.top


def _motion(law, y) -> Motion:
    length = y ** (2 / law.work_exponent)
    return Motion(law, length, 1.25 * (length / y) / y, y, jnp.ones_like(y))


def _started(like: Numbers) -> State:
    return State(jnp.zeros_like(like), jnp.ones_like(like))


def _there_and_back(law, y, route: Any, approach: Branch, rebound: Branch):
    """The motion with its largest overlap, and where the approach and the rebound from there end."""
    motion = _motion(law, y)
    up = _end(approach, motion, _started(y), route)
    top = jnp.where(up.reached, up.state.overlap, 1.0)
    motion = motion._replace(top=top)
    return motion, up, _end(rebound, motion, State(top, jnp.zeros_like(top)), route)


# rate-independent laws


def _loading(motion: Motion, state: State) -> Numbers:
    return motion.unit * motion.law.loading(_at(motion, state))


def _unloading(motion: Motion, state: State) -> Numbers:
    x, peak = _at(motion, state), motion.top * motion.length
    return motion.unit * motion.law.unloading_at(x, jnp.maximum(peak - x, 0.0), peak)


def _remaining(motion: Motion, state: State) -> Numbers:
    """Of the force, over that at the peak."""
    whole = _unloading(motion, State(motion.top, state.velocity))
    return _unloading(motion, state) / whole - NOTHING


LOADING = Branch(_loading, _velocity, None, _is_attractive(_loading))
UNLOADING = Branch(_unloading, _overlap, _remaining, _is_no_number(_unloading))


def rate_independent(
    law: ReducedRateIndependent, y, speed_ratio, route: Any, *, clock=False, force=False
) -> Collision:
    """One collision beyond the elastic stage."""
    motion, up, down = _there_and_back(law, y, route, LOADING, UNLOADING)
    top = motion.top
    positive = _releases(UNLOADING, motion, down.state)
    inside = State(down.state.overlap * (1 + ASIDE), down.state.velocity)
    jumps = positive & (_remaining(motion, inside) > JUMP)
    x_m, residual = top * motion.length, down.state.overlap * motion.length
    end = UnloadingEnd(residual, x_m - residual, positive, ~jumps)
    peak = Peak(x_m, y, jnp.asarray(law.end(), y.dtype), ~up.lost, up.reached | up.lost)
    back = Rebound(jnp.square(down.state.velocity), down.reached)
    if clock:
        back = back._replace(time=(up.time + down.time) * (motion.length / y))
    gain = GAIN * route.error(y.dtype)
    unloaded = outcome.as_stated(law, x_m, end)
    collision = outcome.assemble(law, peak, unloaded, back, gain, force)
    return outcome.undo_rescaling(law, collision, speed_ratio)


# rate-dependent laws


def _force(motion: Motion, state: State) -> Numbers:
    return motion.unit * motion.law.force(_at(motion, state), state.velocity * motion.y)


def _returning(motion: Motion, state: State) -> Numbers:
    return _force(motion, state._replace(velocity=jnp.minimum(state.velocity, -ASIDE)))


def _repulsion(motion: Motion, state: State) -> Numbers:
    return _returning(motion, state) - NOTHING


APPROACH = Branch(_force, _velocity, None, _is_attractive(_force))


def _creeps(motion: Motion, state: State) -> Flags:
    """Whether the force is no number, or the overlap nears zero without a velocity."""
    still = (state.overlap < CREEPS * motion.top) & (jnp.abs(state.velocity) < CREEPS)
    return still | jnp.isnan(_returning(motion, state))


TO_ZERO_OVERLAP = Branch(_returning, _overlap, None, _creeps)
TO_ZERO_FORCE = Branch(_returning, _overlap, _repulsion, _is_no_number(_returning))


def rate_dependent(
    law: ReducedRateDependent, y, speed_ratio, route: Any, *, clock=False, force=False
) -> Collision:
    """One collision at y > 0."""
    stays = law.ends_at == "zero-force"
    branch = TO_ZERO_FORCE if stays else TO_ZERO_OVERLAP
    motion, up, down = _there_and_back(law, y, route, APPROACH, branch)
    top = motion.top
    residual = jnp.where(_releases(branch, motion, down.state), down.state.overlap, 0.0)
    collision = outcome.damped(
        energy=jnp.square(down.state.velocity),
        peak=top * motion.length,
        residual=residual * motion.length,
        solved=up.reached & (down.reached | (down.lost & (not stays))),
        turns=~up.lost,
        endless=down.lost & (not stays),
        gain=GAIN * route.error(y.dtype),
    )
    if clock:
        time = (up.time + down.time) * (motion.length / y)
        collision = collision._replace(duration=jnp.where(collision.answered, time, 0.0))
    if force:
        shares = chebyshev_shares(y.dtype)
        field = lambda state: (state[1], -_force(motion, State(*state)))  # noqa: E731
        way = advance(
            field, tuple(_started(y)), up.time, route.tolerance, route.max_steps, save=shares**4
        )  # X is a fourth power of the share there, in which its own powers are smooth
        forces = jax.vmap(_force, (None, 0))(motion, State(*way)) / motion.unit
        largest = jnp.where(collision.turns, largest_of_samples(forces), 0.0)
        collision = collision._replace(force=largest)
    return outcome.undo_rescaling(law, collision, speed_ratio)
