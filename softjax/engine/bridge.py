"""The only bridge to diffrax: its solvers and the control of their steps."""

from functools import partial
from typing import Any, NamedTuple

import diffrax as dfx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from softjax.checks import ArgumentError

SOLVER_CLASSES = {
    "dopri8": dfx.Dopri8,
    "dopri5": dfx.Dopri5,
    "tsit5": dfx.Tsit5,
    "bosh3": dfx.Bosh3,
}

# of the way: at the default tolerance two or three larger ones follow. Methods of fifth order would take
# a tenth at 1e-11 where their error estimate happens to pass through zero, and err by 1.3e-10.
FIRST_STEP = {"dopri8": 0.1}
# A field of forces may be flat where a contact begins or ends: the error estimate of a step there is
# next to nothing, and without a bound the following step crosses all that is left. Largest steps, and
# the share of the tolerance that a step may err by, for which 10 tolerances hold over laws of all kinds.
LARGEST_STEP = {"dopri8": 0.15, "dopri5": 0.1, "bosh3": 0.1}
SHARE = 0.1
SMALL_STEP = 0.05  # of any other method, the first one and the largest
NEARLY = 100  # roundings before the end at which a step is taken to go all the way


def check_solver(solver, adaptive: bool) -> None:
    """Raise unless it is an explicit solver of diffrax, with an error estimate if steps are adapted.

    Raises:
        ValueError: naming the solver and what is accepted.
    """
    others = dfx.AbstractImplicitSolver | dfx.AbstractItoSolver | dfx.AbstractStratonovichSolver
    explicit = isinstance(solver, dfx.AbstractSolver) and not isinstance(solver, others)
    if not explicit and not isinstance(solver, dfx.Euler | dfx.AbstractERK):
        raise ArgumentError(f"`solver` must be an explicit solver of diffrax, but is {solver!r}")
    if adaptive and not isinstance(solver, dfx.AbstractAdaptiveSolver):
        raise ArgumentError(
            f"`solver` must have an error estimate unless `steps` are fixed, but is {solver!r}"
        )


def solve(field, start, end, state, args, route: Any, save=None, *, smooth: bool = False):
    """Integrate dstate/ds = field(s, state, args) from s = start to end, all scaled to one.

    Returns the last state, or the states at the fractions `save` of the way (increasing, in
    [0, 1]), and whether the solver got there. Differentiable forward only: see
    `engine.rows`. `smooth` is for fields known to vary over the whole way alike: their
    steps have no upper bound.

    Step by step with diffrax's methods and its control of their steps. Its own `diffeqsolve` gives the
    same numbers as fast; the first call takes 2.7 s of processor time instead of 1.5 (the reference,
    how it works, says where).
    """
    span = end - start

    def scaled(t, state, args):
        return jax.tree.map(lambda rate: span * rate, field(start + span * t, state, args))

    reached, last, samples = _walked(dfx.ODETerm(scaled), state, args, route, save, smooth)
    return (last if save is None else samples), reached >= 1


class _Walk(NamedTuple):
    """Between two steps of a solve: the next one goes from `before` to `after`."""

    before: Array
    after: Array
    state: tuple[Array, ...]
    memory: Any  # of the method
    pace: Any  # of what controls the steps
    samples: tuple[Array, ...] | None
    steps: Array


def _walked(term, state, args, route: Any, save, smooth: bool):
    """How far of the way from 0 to 1 the method came, the state there, and those at `save`."""
    zero, one = (jnp.asarray(t, state[0].dtype) for t in (0, 1))
    controller, dt0, most = _controller(route, zero.dtype, smooth)
    named = isinstance(route.solver, str)
    solver = SOLVER_CLASSES[route.solver](scan_kind="lax") if named else route.solver
    order = solver.error_order(term)

    def unfinished(walk: _Walk):
        # a step that is shorter than rounding leads nowhere
        return (walk.before < walk.after) & (walk.before < one) & (walk.steps < most)

    def step(walk: _Walk) -> _Walk:
        tried = walk.before, walk.after
        new, error, dense, memory, _ = solver.step(
            term, *tried, walk.state, args, walk.memory, made_jump=False
        )
        # what is no number is tried again with a shorter step
        error = jax.tree.map(lambda e: jnp.where(jnp.isnan(e), jnp.inf, e), error)
        keep, before, after, _, pace, _ = controller.adapt_step_size(
            *tried, walk.state, new, args, error, order, walk.pace
        )
        samples = walk.samples
        if samples is not None:
            between = solver.interpolation_cls(t0=tried[0], t1=tried[1], **dense)
            samples = _sampled(between, keep, save, samples)
        kept = partial(jnp.where, keep)
        state, memory = jax.tree.map(kept, (new, memory), (walk.state, walk.memory))
        ends = after > 1 - NEARLY * jnp.finfo(after.dtype).eps
        after = jnp.where(ends, jnp.where(keep, one, 0.5 * (before + one)), after)
        return _Walk(before, after, state, memory, pace, samples, walk.steps + 1)

    first, pace = controller.init(term, zero, one, state, dt0, args, solver.func, order)
    memory = solver.init(term, zero, first, state, args)
    samples = None if save is None else tuple(jnp.broadcast_to(y, save.shape) for y in state)
    begin = _Walk(zero, jnp.minimum(first, one), state, memory, pace, samples, jnp.asarray(0))
    end = jax.lax.while_loop(unfinished, step, jax.tree.map(jnp.asarray, begin))
    return end.before, end.state, end.samples


def _sampled(between, keep, save, samples):
    """The samples, those of this step put in if it is kept."""
    save = jnp.asarray(save)
    here = keep & (save > between.t0) & (save <= between.t1)
    return jax.tree.map(partial(jnp.where, here), jax.vmap(between.evaluate)(save), samples)


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
