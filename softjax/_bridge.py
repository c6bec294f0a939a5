"""The only bridge to diffrax: solver, steps, adjoint, and how a batch is differentiated."""

from functools import partial

import diffrax as dfx
import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero

from softjax.routes import ODE

SOLVER_CLASSES = {
    "dopri8": dfx.Dopri8,
    "dopri5": dfx.Dopri5,
    "tsit5": dfx.Tsit5,
    "bosh3": dfx.Bosh3,
}

IN_CACHE = 2048  # impacts, each with its tangents counting as one more


def over_batch(one, law, y, route):
    """`vmap` over all impacts, whatever the shapes in which y and the law's fields broadcast."""
    leaves, structure = jax.tree.flatten((law, y))
    shape = jnp.broadcast_shapes(*(jnp.shape(leaf) for leaf in leaves))
    flat = [jnp.broadcast_to(leaf, shape).ravel() for leaf in leaves]

    def single(*leaves):
        return one(*jax.tree.unflatten(structure, leaves), route)

    result = forward_differentiated(jax.vmap(single))(*flat)
    return jax.tree.map(lambda a: a.reshape(shape + a.shape[1:]), result)


def forward_differentiated(f):
    """f, of impacts one by one, with its derivatives taken forward whichever way the caller does.

    A collision has few inputs (the law's numbers and the velocity) and few outputs: tangents ride
    along one solve, and reverse mode is the transpose of the small matrix that they make. Only
    the inputs that really are differentiated get a tangent.
    """

    @jax.custom_jvp
    def wrapped(*leaves):
        return _in_rows(f, leaves, IN_CACHE)

    def rule(primals, tangents):
        active = [i for i, t in enumerate(tangents) if not isinstance(t, SymbolicZero)]
        value_and_slopes = partial(_value_and_slopes, f, active)
        value, slopes = _in_rows(value_and_slopes, primals, IN_CACHE // (1 + len(active)))
        change = jnp.stack([tangents[i] for i in active], -1)

        def contract(slope):
            if not jnp.issubdtype(slope.dtype, jnp.inexact):
                return slope[..., 0]
            between = (1,) * (slope.ndim - change.ndim)
            return jnp.sum(slope * change.reshape(len(change), *between, len(active)), -1)

        return value, jax.tree.map(contract, slopes)

    wrapped.defjvp(rule, symbolic_zeros=True)
    return wrapped


def _value_and_slopes(f, active, *primals):
    """f and its derivatives by the active inputs, which are a last axis; each impact by its own."""
    chosen = [primals[i] for i in active]

    def of_active(*some):
        full = list(primals)
        for i, value in zip(active, some, strict=True):
            full[i] = value
        return f(*full)

    def push(seed):
        along = [jnp.broadcast_to(s, x.shape) for s, x in zip(seed, chosen, strict=True)]
        return jax.jvp(of_active, chosen, along)

    return jax.vmap(push, out_axes=(None, -1))(jnp.eye(len(active), dtype=chosen[0].dtype))


def _in_rows(f, leaves, size: int):
    """`f(*leaves)`, so many impacts at a time: what a solver stores of them stays in the cache."""
    count = len(leaves[0])
    rows = -(-count // size)
    if rows <= 1:
        return f(*leaves)
    missing = -count % rows
    filled = [jnp.pad(leaf, (0, missing), mode="edge").reshape(rows, -1) for leaf in leaves]
    results = jax.lax.map(lambda row: f(*row), filled)
    return jax.tree.map(lambda a: a.reshape(-1, *a.shape[2:])[:count], results)


def solve(field, start, end, state, args, route: ODE, save=None):
    """Integrate dstate/ds = field(s, state, args) from s = start to end, all scaled to one.

    Returns the last state, or the states at the fractions `save` of the way (increasing, in
    [0, 1]), and whether the solver got there. Differentiable forward only: see
    `forward_differentiated`.
    """
    controller: dfx.AbstractStepSizeController
    dt0: float | None
    if route.steps is None:
        tolerance = max(route.tolerance, 4 * float(jnp.finfo(start.dtype).eps))
        controller = dfx.PIDController(rtol=tolerance, atol=tolerance)
        dt0, max_steps = None, route.max_steps
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
