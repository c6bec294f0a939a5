"""The equation of motion x'' = -(5/4) p integrated by diffrax: the only bridge to it.

Nothing of the energy balance is used here: the law gives its forces, and where they end.

Neither branch is integrated over time, because the ends of both are known in other variables
(Hénon's trick), so that no event has to be searched for:

* loading over what is left of the velocity, x' = y √(1 - ŝ^{2k}), where ŝ = 1 - η² is √x of the
  elastic collision at that velocity relative to its peak. The state is n, √x over that of the
  elastic collision (Encke's trick): n = 1 until yield, and smooth after;
* unloading over √x, from its value at the peak down to the residual overlap, with x'² as state;
* where time matters, over the angle of x = x* + ρ cosφ, x' = -Ω ρ sinφ, with ρ and t as states.
"""

from functools import partial

import diffrax as dfx
import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array

from softjax._numerics import implicit_root, parabolic_step, safe_power, safe_sqrt
from softjax.laws.base import Outcome, ReducedRateIndependent
from softjax.routes import ODE

RESIDUAL_STEPS = 13  # from the peak; the worst of 400 000 cases needed them all
HALF_PERIOD = {2.5: 1.4716375921622639, 2.0: 1.5707963267948966}  # ∫_0^1 dz/√(1 - z^k)
# p_el/p is capped: where the loading force vanishes the overlap runs away instead of dividing by 0
LARGEST_SOFTENING = 1e8
FIRST_ANGLE = 1e-6  # η at which a law without an elastic stage starts, ŝ = 1 - η²


def collide(law: ReducedRateIndependent, y: Array, route: ODE) -> Outcome:
    """Overlaps and ε_p² of collisions beyond the elastic limit, one ODE for each velocity."""
    return _over_batch(_collide_one, law, y, route)


def duration(law: ReducedRateIndependent, y: Array, route: ODE) -> tuple[Array, Array]:
    """Contact duration [L/V] and whether the contact ends."""
    return _over_batch(_duration_one, law, y, route)


def _over_batch(one, law, y, route):
    """`vmap` over all impacts, whatever the shapes in which y and the law's fields broadcast."""
    leaves, structure = jax.tree.flatten((law, y))
    shape = jnp.broadcast_shapes(*(jnp.shape(leaf) for leaf in leaves))
    flat = [jnp.broadcast_to(leaf, shape).ravel() for leaf in leaves]

    def single(*leaves):
        return one(*jax.tree.unflatten(structure, leaves), route)

    result = jax.vmap(_forward_differentiated(single))(*flat)
    return jax.tree.map(lambda a: a.reshape(shape), result)


def _forward_differentiated(f):
    """f with its Jacobian taken forward, whichever way the caller differentiates.

    A collision has few inputs (the law's numbers and the velocity) and few outputs: tangents ride
    along one solve, and reverse mode is the transpose of the small matrix that they make. Only
    the inputs that really are differentiated get a tangent.
    """

    @jax.custom_jvp
    def wrapped(*leaves):
        return f(*leaves)

    def rule(primals, tangents):
        active = [i for i, t in enumerate(tangents) if not isinstance(t, SymbolicZero)]

        def of_active(*some):
            full = list(primals)
            for i, value in zip(active, some, strict=True):
                full[i] = value
            return f(*full)

        chosen = [primals[i] for i in active]
        seeds = jnp.eye(len(active), dtype=chosen[0].dtype)
        push = partial(jax.jvp, of_active, chosen)
        value, columns = jax.vmap(lambda seed: push(list(seed)), out_axes=(None, 0))(seeds)
        change = [tangents[i] for i in active]

        def contract(column):
            if not jnp.issubdtype(column.dtype, jnp.inexact):
                return column[0]
            return sum(column[j] * change[j] for j in range(len(active)))

        return value, jax.tree.map(contract, columns)

    wrapped.defjvp(rule, symbolic_zeros=True)
    return wrapped


def _collide_one(law, y, route: ODE) -> Outcome:
    peak, turns = _loading(law, y, route, clock=False)[:2]
    residual = _residual(law, peak)
    energy = _unloading_energy(law, peak, residual, route)
    end = jax.lax.stop_gradient(law.end())
    return Outcome(
        peak=jnp.where(turns, peak, end),
        residual=jnp.where(turns, residual, end),
        plastic_squared=jnp.where(turns, energy / y**2, 0.0),
        turns=turns,
    )


def _duration_one(law, y, route: ODE):
    peak, turns, loading_time = _loading(law, y, route, clock=True)
    residual = _residual(law, peak)
    _, unloading_time = _unloading_angle(law, peak, residual, route)
    return jnp.where(turns, loading_time + unloading_time, 0.0), turns


def _loading(law, y, route: ODE, clock: bool):
    """Largest overlap, whether there is one, and the time it takes."""
    k = law.work_exponent
    state = (jnp.zeros_like(y), jnp.zeros_like(y)) if clock else (jnp.zeros_like(y),)
    field = partial(_loading_field, k=k, clock=clock)
    start, zero = _loading_start(law, y), jnp.zeros_like(y)
    (gain, *lag), solved = _solve(field, start, zero, state, (law, y), route)
    found = (y**2 * (1 + gain)) ** (1 / k)
    turns = solved & (found < law.end()) & jnp.isfinite(found)
    peak = jnp.where(turns, found, 1.5)
    if not clock:
        return peak, turns
    return peak, turns, HALF_PERIOD[k] * y ** (2 / k - 1) + lag[0]


def _loading_start(law, y):
    """η at the elastic limit, from which the ODE starts."""
    return safe_sqrt(1 - law.elastic_limit**0.5 * y ** (-1 / law.work_exponent))


def _loading_field(eta, state, args, *, k, clock):
    """dζ/dη and, with a clock, the lag behind the elastic collision d(t - t_el)/dη."""
    law, y = args
    s_hat = 1 - eta**2
    lost = s_hat ** (2 * k)
    x = (y**2 * (lost + state[0])) ** (1 / k)
    elastic_force = 0.4 * k * x ** (k - 1)
    floor = elastic_force / LARGEST_SOFTENING
    softening = elastic_force / jnp.maximum(law.loading(x), floor)
    change = -4 * k * eta * s_hat ** (2 * k - 1) * (softening - 1)
    if not clock:
        return (change,)
    speed = jnp.sqrt(-jnp.expm1(2 * k * jnp.log1p(-(eta**2))))  # x'/y
    ratio = jnp.where(eta > 0, eta / jnp.where(eta > 0, speed, 1.0), (2 * k) ** -0.5)
    weaker = softening * (y ** (2 / k) * s_hat**2 / x) ** (k - 1)  # elastic force at x' over p
    return change, -4 * y ** (2 / k - 1) * s_hat * (weaker - 1) * ratio


def _residual(law, peak):
    """x* of p_U(x*) = 0, or 0, from the unloading force alone."""
    leaves, structure = jax.tree.flatten(law)

    def force(r, peak, *leaves):
        law = jax.tree.unflatten(structure, leaves)
        return law.unloading(peak * r**2, peak)

    def solve(peak, *leaves):
        f = lambda r: force(r, peak, *leaves)  # noqa: E731
        slope = jax.grad(f)
        curvature = jax.grad(slope)
        r = jnp.ones_like(peak)
        for _ in range(RESIDUAL_STEPS):
            step = parabolic_step(f(r), jnp.maximum(slope(r), 0.0), curvature(r))
            r = jnp.clip(r - step, 1e-12, 1.0)
        return r

    released = law.releases(peak)
    r = implicit_root(solve, force)(peak, *leaves)
    return jnp.where(released, peak * r**2, 0.0)


def _unloading_energy(law, peak, residual, route: ODE):
    """x'² at the end of the contact."""
    top, bottom = jnp.sqrt(peak), safe_sqrt(residual)

    def field(t, state, args):
        law, peak, top, bottom = args
        s = top - (top - bottom) * t
        return (5 * s * (top - bottom) * law.unloading(s**2, peak),)

    zero, one = jnp.zeros_like(peak), jnp.ones_like(peak)
    scale = peak**law.work_exponent  # of the order of y²: tolerances are relative to one
    scaled = lambda t, state, args: (field(t, state, args)[0] / scale,)  # noqa: E731
    (energy,), _ = _solve(scaled, zero, one, (zero,), (law, peak, top, bottom), route)
    return energy * scale


def _unloading_angle(law, peak, residual, route: ODE):
    """x' at the end of the contact, and the time since the peak."""
    amplitude = peak - residual
    frequency = jnp.sqrt(1.25 * law.unloading(peak, peak) / amplitude)
    args = (law, peak, residual, frequency)
    zero = jnp.zeros_like(peak)
    end = jnp.full_like(peak, 0.5 * jnp.pi)
    (stretch, phase), _ = _solve(_angle_field, zero, end, (jnp.ones_like(peak), zero), args, route)
    return -frequency * amplitude * stretch, phase / frequency


def _angle_field(phi, state, args):
    """d/dφ of ρ/(x_m - x*) and of Ω t, for x = x* + ρ cosφ and x' = -Ω ρ sinφ."""
    law, peak, residual, frequency = args
    stretch, _ = state
    sin, cos = jnp.sin(phi), jnp.cos(phi)
    radius = (peak - residual) * stretch
    x = jnp.clip(residual + radius * cos, residual, peak)
    pull = 1.25 * law.unloading(x, peak) / (frequency**2 * radius)
    turn = sin**2 + pull * cos  # dφ/d(Ω t)
    return stretch * sin * (pull - cos) / turn, 1 / turn


def _solve(field, start, end, state, args, route: ODE, save=None):
    """Integrate a scaled system, forward-mode differentiable; the last state and whether it got there."""
    solver = {"dopri8": dfx.Dopri8, "dopri5": dfx.Dopri5, "tsit5": dfx.Tsit5, "bosh3": dfx.Bosh3}
    if route.steps is None:
        tolerance = max(route.tolerance, 4 * float(jnp.finfo(start.dtype).eps))
        controller = dfx.PIDController(rtol=tolerance, atol=tolerance)
        dt0, max_steps = None, route.max_steps
    else:
        controller, dt0, max_steps = dfx.ConstantStepSize(), 1 / route.steps, route.steps
    span = end - start
    solution = dfx.diffeqsolve(
        dfx.ODETerm(
            lambda t, state, args: jax.tree.map(
                lambda f: span * f, field(start + span * t, state, args)
            )
        ),
        solver[route.solver](),
        t0=0.0,
        t1=1.0,
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
    if save is not None:
        return solution.ys, solved
    return jax.tree.map(lambda leaf: leaf[0], solution.ys), solved
