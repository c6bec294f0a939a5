"""The only bridge to diffrax: solver, steps, adjoint, and how a batch is differentiated."""

from functools import partial

import diffrax as dfx
import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_derivatives import SymbolicZero

from softjax._impacts import Mapped, in_rows
from softjax.routes import Stepping

SOLVER_CLASSES = {
    "dopri8": dfx.Dopri8,
    "dopri5": dfx.Dopri5,
    "tsit5": dfx.Tsit5,
    "bosh3": dfx.Bosh3,
}

FIRST_STEP = 0.1  # of the way: at the default tolerance two or three larger ones follow
IN_CACHE = 2048  # impacts, each with its tangents counting as one more


def forward_differentiated(f: Mapped, whole: list[bool], size: int = IN_CACHE) -> Mapped:
    """f, of impacts one by one, with its derivatives taken forward whichever way the caller does.

    A collision has few inputs (the law's numbers and the velocity) and few outputs: tangents ride
    along one solve, and reverse mode is the transpose of the small matrix that they make. Only
    the inputs that really are differentiated get a tangent, of what is whole every number one. The
    matrix is differentiated in the same way again.
    """

    @jax.custom_jvp
    def wrapped(*leaves):
        _check_not_told_apart(leaves)
        return in_rows(f, leaves, whole, size)

    def rule(primals, tangents):
        active = [i for i, t in enumerate(tangents) if not isinstance(t, SymbolicZero)]
        change = _directions([tangents[i] for i in active], [whole[i] for i in active])
        with_slopes = partial(_value_and_slopes, f, active, whole)
        fewer = max(size // (1 + change.shape[-1]), 1)
        value, slopes = forward_differentiated(with_slopes, whole, fewer)(*primals)

        def contract(slope):
            if not jnp.issubdtype(slope.dtype, jnp.inexact):
                return slope[..., 0]
            between = (1,) * (slope.ndim - change.ndim)
            return jnp.sum(slope * change.reshape(len(change), *between, -1), -1)

        return value, jax.tree.map(contract, slopes)

    wrapped.defjvp(rule, symbolic_zeros=True)
    return wrapped


def _check_not_told_apart(leaves) -> None:
    """Raise where `shard_map` follows what differs between devices: diffrax's loops do not."""
    for leaf in leaves:
        kind = jax.typeof(leaf)
        varying = getattr(kind, "vma", None) or getattr(getattr(kind, "mat", None), "varying", None)
        if varying:
            raise ValueError("`jax.shard_map` must have check_vma=False for the route ODE(...)")


def _directions(tangents, whole):
    """One column for each direction that `_value_and_slopes` takes, one row for each impact."""
    count = next((len(t) for t, held in zip(tangents, whole, strict=True) if not held), 1)
    columns = [
        jnp.broadcast_to(t.ravel(), (count, t.size)) if held else t[:, None]
        for t, held in zip(tangents, whole, strict=True)
    ]
    return jnp.concatenate(columns, -1)


def _value_and_slopes(f, active, whole, *primals):
    """f and its derivatives by the active inputs, which are a last axis; each impact by its own."""
    chosen = [primals[i] for i in active]

    def of_active(*some):
        full = list(primals)
        for i, value in zip(active, some, strict=True):
            full[i] = value
        return f(*full)

    def push(seeds):
        along = [jnp.broadcast_to(s, x.shape) for s, x in zip(seeds, chosen, strict=True)]
        return jax.jvp(of_active, chosen, along)

    sizes = [x.size if whole[i] else 1 for i, x in zip(active, chosen, strict=True)]
    every = jnp.split(jnp.eye(sum(sizes), dtype=chosen[0].dtype), np.cumsum(sizes)[:-1], axis=1)
    shapes = [x.shape if whole[i] else (1,) for i, x in zip(active, chosen, strict=True)]
    seeds = [part.reshape(-1, *shape) for part, shape in zip(every, shapes, strict=True)]
    return jax.vmap(push, out_axes=(None, -1))(seeds)


def solve(field, start, end, state, args, route: Stepping, save=None):
    """Integrate dstate/ds = field(s, state, args) from s = start to end, all scaled to one.

    Returns the last state, or the states at the fractions `save` of the way (increasing, in
    [0, 1]), and whether the solver got there. Differentiable forward only: see
    `forward_differentiated`.
    """
    controller: dfx.AbstractStepSizeController
    if route.steps is None:
        least = 4 * float(jnp.finfo(start.dtype).eps)
        tolerance = jnp.maximum(jnp.asarray(route.tolerance, start.dtype), least)
        controller = dfx.PIDController(rtol=tolerance, atol=tolerance)
        dt0, max_steps = jnp.asarray(FIRST_STEP, start.dtype), route.max_steps
    else:
        # one more: in float32 their sum may end short of the whole
        controller, max_steps = dfx.ConstantStepSize(), route.steps + 1
        dt0 = jnp.asarray(1 / route.steps, start.dtype)
    span = end - start

    def scaled(t, state, args):
        return jax.tree.map(lambda rate: span * rate, field(start + span * t, state, args))

    solution = dfx.diffeqsolve(
        dfx.ODETerm(scaled),
        SOLVER_CLASSES[route.solver](),
        t0=jnp.zeros((), start.dtype),  # a Python number would make float64 of all of it
        t1=jnp.ones((), start.dtype),
        dt0=dt0,
        y0=state,
        args=args,
        saveat=dfx.SaveAt(t1=True) if save is None else dfx.SaveAt(ts=save),
        stepsize_controller=controller,
        adjoint=dfx.ForwardMode(),
        max_steps=max_steps,
        throw=False,
    )
    solved = solution.result == dfx.RESULTS.successful
    if save is None:
        return jax.tree.map(lambda leaf: leaf[0], solution.ys), solved
    return solution.ys, solved
