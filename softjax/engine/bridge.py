"""The only bridge to diffrax: its solvers and the control of their steps.

A branch of a collision is an initial value problem over a variable whose end is known, dy/ds = f(s, y), from s = a
to b. With t = (s - a)/(b - a) every branch goes from 0 to 1, by steps h of an explicit Runge–Kutta method with
stages k_i = f(t + c_i h, y + h Σ_j a_ij k_j) and y → y + h Σ_i b_i k_i; the error estimate of a step, against the
tolerance, sets the next. `solve` takes these steps; `until` and `advance` integrate over time by diffrax's own
`diffeqsolve`, the first up to an event.

>>> import jax.numpy as jnp
>>> import softjax as sj
>>> sj.enable_x64()
>>> from softjax.engine.bridge import solve
>>> zero, one = jnp.asarray(0.0), jnp.asarray(1.0)
>>> (y,), arrived = solve(lambda s, y: (-y[0],), zero, 2 * one, (one,), sj.ODE())  # y = e^{-s}
>>> print(f"{y:.8f} {arrived}")
0.13533528 True
"""

import dataclasses
from functools import partial
from typing import Any, NamedTuple

import diffrax as dfx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array

from softjax.checks import ArgumentError
from softjax.numerics.derivatives import differentiate_active_inputs

# of the way: at the default tolerance two or three larger ones follow. Methods of fifth order would take
# a tenth at 1e-11 where their error estimate happens to pass through zero, and err by 1.3e-10.
FIRST_STEP = {"dopri8": 0.1}
# A field of forces may be flat where a contact begins or ends: the error estimate of a step there is
# next to nothing, and without a bound the following step crosses all that is left. Largest steps, and
# the share of the tolerance that a step may err by, for which 10 tolerances hold over laws of all kinds.
LARGEST_STEP = {"dopri8": 0.15, "dopri5": 0.1, "bosh3": 0.1}
SHARE = 0.1
# of any other method, the first one and the largest; tsit5 errs by up to 0.3 tolerances over three
# laws, by 0.4 with 0.1
SMALL_STEP = 0.05
REMEMBERED = 64  # steps that reverse mode goes back by at once: ten are usual
NEARLY = 100  # roundings before the end at which a step is taken to go all the way
FIRST_TIME, LARGEST_TIME = 0.01, 0.2  # steps in time; an elastic collision takes three


def check_solver(solver, adaptive: bool) -> None:
    """Raise unless it is an explicit solver of diffrax, with an error estimate if steps are adapted."""
    others = dfx.AbstractImplicitSolver | dfx.AbstractItoSolver | dfx.AbstractStratonovichSolver
    explicit = isinstance(solver, dfx.AbstractSolver) and not isinstance(solver, others)
    if not explicit and not isinstance(solver, dfx.Euler | dfx.AbstractERK):
        raise ArgumentError(f"`solver` must be an explicit solver of diffrax, but is {solver!r}")
    if adaptive and not isinstance(solver, dfx.AbstractAdaptiveSolver):
        raise ArgumentError(
            f"`solver` must have an error estimate unless `steps` are fixed, but is {solver!r}"
        )


def solve(field, start, end, state, route: Any, save=None, *, smooth: bool = False, idle=None):
    """Integrate dstate/ds = field(s, state) from s = start to end, all scaled to one.

    Returns the last state, or the states at the fractions `save` of the way (increasing, in
    [0, 1]), and whether the solver got there. Differentiable forward only, unless the route is
    reversible (`softjax.mapping` says when). `smooth`: the field has no kinks or flat parts; the step size is unbounded.

    Where `idle` holds no step is taken, unless the route is reversible.

    Step by step with diffrax's methods and its control of their steps; the reference (how it works) says
    why not by its `diffeqsolve`.
    """
    span = end - start

    def scaled(t, state, _):
        return tuple(span * rate for rate in field(start + span * t, state))

    if not route.by_reverse:
        now = integrate_steps(scaled, state, route, save, smooth, idle=idle)
        return (now.state if save is None else now.samples), now.before >= 1

    closed, constants = jax.closure_convert(scaled, jnp.zeros_like(span), state, None)

    def whole(state, constants):
        now = integrate_steps(_around(closed, constants), state, route, save, smooth)
        return (now.state if save is None else now.samples), now.before >= 1

    solver, backwards = _solver(route), None  # of samples, and by Euler's method: forward
    if isinstance(solver, dfx.AbstractERK) and save is None:
        backwards = partial(
            reverse_sensitivities, closed, len(state), route, smooth, solver.tableau
        )
    return differentiate_active_inputs(whole, state, constants, slopes=backwards)


def _around(closed, constants):
    return lambda t, state, args: closed(t, state, args, *constants)


class StepState(NamedTuple):
    """Between two steps of a solve: the next one goes from `before` to `after`."""

    before: Array
    after: Array
    state: tuple[Array, ...]
    memory: Any  # of the method
    control: Any  # memory of what controls the steps
    steps: Array
    samples: tuple[Array, ...] | None
    taken: Any = None  # beginnings, ends and first states of the last steps that were kept
    kept: Any = None  # how many were


def integrate_steps(
    field, state, route: Any, save, smooth: bool, until: Array | None = None, idle=None
) -> StepState:
    """As far of the way from 0 to 1 as the method comes; steps are remembered up to the last of `until`."""
    zero, one = (jnp.asarray(t, state[0].dtype) for t in (0, 1))
    controller, dt0, most = _controller(route, zero.dtype, smooth)
    term: dfx.ODETerm = dfx.ODETerm(field)
    solver, args = _solver(route), None
    order = solver.error_order(term)

    def unfinished(now: StepState):
        # a step that is shorter than rounding leads nowhere
        going = (now.before < now.after) & (now.before < one) & (now.steps < most)
        return going if until is None else going & (now.kept < until)

    def step(now: StepState) -> StepState:
        tried = now.before, now.after
        new, error, dense, memory, _ = solver.step(
            term, *tried, now.state, args, now.memory, made_jump=False
        )
        # what is no number is tried again with a shorter step
        error = jax.tree.map(lambda e: jnp.where(jnp.isnan(e), jnp.inf, e), error)
        keep, before, after, _, control, _ = controller.adapt_step_size(
            *tried, now.state, new, args, error, order, now.control
        )
        samples = now.samples
        if samples is not None:
            between = solver.interpolation_cls(t0=tried[0], t1=tried[1], **dense)
            at = jnp.asarray(save)
            here = keep & (at > between.t0) & (at <= between.t1)
            samples = jax.tree.map(
                partial(jnp.where, here), jax.vmap(between.evaluate)(at), samples
            )
        taken, kept = now.taken, now.kept
        if until is not None:  # of one that is not kept the next one takes the place
            at, here = kept % REMEMBERED, jnp.stack([*tried, *now.state])
            taken, kept = taken.at[at].set(here), kept + keep
        chosen = partial(jnp.where, keep)
        state, memory = jax.tree.map(chosen, (new, memory), (now.state, now.memory))
        ends = after > 1 - NEARLY * jnp.finfo(after.dtype).eps
        after = jnp.where(ends, jnp.where(keep, one, 0.5 * (before + one)), after)
        return StepState(before, after, state, memory, control, now.steps + 1, samples, taken, kept)

    first, control = controller.init(term, zero, one, state, dt0, args, solver.func, order)
    memory = solver.init(term, zero, first, state, args)
    samples = None if save is None else tuple(jnp.broadcast_to(y, save.shape) for y in state)
    begin = StepState(
        zero, jnp.minimum(first, one), state, memory, control, jnp.asarray(0), samples
    )
    if idle is not None:
        begin = begin._replace(before=jnp.where(idle, one, zero))
    if until is not None:
        nothing = jnp.zeros((REMEMBERED, 2 + len(state)), zero.dtype)
        begin = begin._replace(taken=nothing, kept=jnp.asarray(0))
    return jax.lax.while_loop(unfinished, step, jax.tree.map(jnp.asarray, begin))


def _solver(route: Any):
    solver = route.solver
    if isinstance(solver, str):
        return getattr(dfx, solver.capitalize())(scan_kind="lax")
    # left to itself diffrax takes its stages by a loop that has no forward derivatives
    undecided = getattr(solver, "scan_kind", "lax") is None
    return dataclasses.replace(solver, scan_kind="lax") if undecided else solver


def reverse_sensitivities(closed, count: int, route: Any, smooth: bool, tableau, active, *leaves):
    """The last state, whether it was reached, and its derivatives by every number of the active leaves.

    A state is two numbers at most: the steps are remembered, and gone through backwards, each
    differentiated in reverse as it was taken. Where there were more than `REMEMBERED`, the way is gone
    once more for those before. What controls the steps is no function of what is differentiated.

    Args:
        closed: the field, of `leaves` beyond the first `count`, which are the state.
    """
    start, constants = leaves[:count], leaves[count:]
    of_field = [i - count for i in active if i >= count]
    integrated = partial(integrate_steps, _around(closed, constants), start, route, None, smooth)

    def stepped(before, after, state, chosen):
        full = list(constants)
        for i, value in zip(of_field, chosen, strict=True):
            full[i] = value
        return _step(tableau, _around(closed, full), before, after - before, state)

    chosen = [constants[i] for i in of_field]

    def back(taken):
        """The derivatives of the state after a step, from those of the state before it."""
        before, after, state = taken[0], taken[1], taken[2:]
        _, transposed = jax.vjp(partial(stepped, before, after), state, chosen)
        return jax.vmap(transposed)

    def portion(state):
        until, first, *slopes = state
        now = integrated(until)
        left = jnp.maximum(now.kept - REMEMBERED, 0)

        def undo(state):
            at, by_state, by_field = state
            by_state, more = back(now.taken[(at - 1) % REMEMBERED])(by_state)
            return at - 1, by_state, jax.tree.map(jnp.add, by_field, more)

        _, *slopes = jax.lax.while_loop(lambda s: s[0] > left, undo, (now.kept, *slopes))
        reached = now.state, now.before >= 1
        first = jax.tree.map(partial(jnp.where, until > route.max_steps), reached, first)
        return left, first, *slopes

    by_state = jnp.eye(count, dtype=start[0].dtype)
    by_field = [jnp.zeros((count, *jnp.shape(x)), x.dtype) for x in chosen]
    none = (start, jnp.asarray(False))
    begin = jnp.asarray(2 * REMEMBERED + route.max_steps), none, by_state, by_field
    _, (last, solved), by_state, by_field = jax.lax.while_loop(lambda s: s[0] > 0, portion, begin)
    parts = [by_state[:, i : i + 1] for i in active if i < count]
    parts += [x.reshape(count, -1) for x in by_field]
    slopes = jnp.where(solved, jnp.concatenate(parts, 1), 0.0)
    return (last, solved), (tuple(slopes), np.zeros(1, jax.dtypes.float0))


def _step(tableau, field, t, dt, state):
    """One explicit Runge–Kutta step of a vector, written to be differentiated: stages are a `scan`."""
    used = 1 + max(np.flatnonzero(tableau.b_sol))  # a stage that is the next step's first is not
    lower = np.zeros((used, used))
    for i, row in enumerate(tableau.a_lower[: used - 1]):
        lower[i + 1, : i + 1] = row
    nodes = np.append(0.0, tableau.c)[:used]
    rows = (jnp.asarray(x, state.dtype) for x in (lower, nodes))

    def stage(rates, row):
        at, weights, node = row
        here = state + dt * (weights @ rates)
        rate = jnp.stack(field(t + node * dt, tuple(here), None))
        return rates.at[at].set(rate), None

    none = jnp.zeros((used, len(state)), state.dtype)
    rates, _ = jax.lax.scan(stage, none, (np.arange(used), *rows))
    return state + dt * (jnp.asarray(tableau.b_sol[:used], state.dtype) @ rates)


def _controller(route: Any, dtype, smooth: bool):
    """What controls the steps, the first of them, and how many there may be."""
    if route.steps is not None:
        # one more: in float32 their sum may end short of the whole
        return dfx.ConstantStepSize(), jnp.asarray(1 / route.steps, dtype), route.steps + 1
    least = 4 * float(jnp.finfo(dtype).eps)
    share, largest = (1.0, None) if smooth else (SHARE, LARGEST_STEP.get(route.solver, SMALL_STEP))
    tolerance = jnp.maximum(share * jnp.asarray(route.tolerance, dtype), least)
    controller = dfx.PIDController(rtol=tolerance, atol=tolerance, dtmax=largest)
    first = FIRST_STEP.get(route.solver, SMALL_STEP)
    return controller, jnp.asarray(first, dtype), route.max_steps


def until(field, ends, state, tolerance, max_steps: int):
    """Integrate dstate/dt = field(state) from t = 0 by `diffrax.diffeqsolve`, until an event.

    Args:
        ends: functions of the state; where a number falls through 0 the motion ends, which is looked for by
            bisection in the step's interpolation, and where a truth value holds, at the end of the step.
        tolerance: relative, and absolute: states are of the order of one.

    Returns:
        t and the state at the end, and which of `ends` it was: all False where `max_steps` were used up.
    """
    fine = 4 * float(jnp.finfo(state[0].dtype).eps)
    conditions = tuple(partial(_of_state, end) for end in ends)
    solution = _by_diffeqsolve(
        lambda t, state, _: field(state),
        state,
        tolerance,
        max_steps,
        t1=jnp.inf,
        event=dfx.Event(conditions, _Bisection(fine, fine, flip=True), direction=False),
    )
    time, last = jax.tree.map(lambda x: x[-1], (solution.ts, solution.ys))
    return time, last, solution.event_mask


class _Bisection(optx.Bisection):
    """Bisection of the one condition that holds; diffrax gives 0 for each other one.

    What falls through 0 is positive before: to detect that would raise where a truth value ends the motion, or nothing.
    """

    def init(self, fn, y, args, options, f_struct, aux_struct, tags):
        kind = jax.tree.leaves(f_struct)[0]
        return super().init(_summed(fn), y, args, options, kind, aux_struct, tags)

    def step(self, fn, y, args, options, state, tags):
        return super().step(_summed(fn), y, args, options, state, tags)

    def postprocess(self, fn, y, aux, args, options, state, tags, result):
        return super().postprocess(_summed(fn), y, aux, args, options, state, tags, result)


def _summed(fn):
    def total(time, args):
        values, more = fn(time, args)
        return sum(jax.tree.leaves(values)), more

    return total


def _of_state(end, t, y, args, **_):
    return end(y)


def advance(field, state, time, tolerance, max_steps: int, save=None):
    """The state at a given time, or at shares `save` of it; differentiable forward, in the time too."""
    scaled = lambda _, state, time: tuple(time * rate for rate in field(state))  # noqa: E731
    saveat = dfx.SaveAt(t1=True) if save is None else dfx.SaveAt(ts=save)
    solution = _by_diffeqsolve(
        scaled, state, tolerance, max_steps, t1=1.0, args=time, saveat=saveat
    )
    return jax.tree.map(lambda x: x[-1], solution.ys) if save is None else solution.ys


def _by_diffeqsolve(field, state, tolerance, max_steps: int, **more):
    return dfx.diffeqsolve(
        dfx.ODETerm(field),
        dfx.Tsit5(),
        t0=0.0,
        dt0=FIRST_TIME,
        y0=state,
        stepsize_controller=dfx.PIDController(rtol=tolerance, atol=tolerance, dtmax=LARGEST_TIME),
        adjoint=dfx.ForwardMode(),
        max_steps=max_steps,
        throw=False,
        **more,
    )
