"""The plain way with diffrax: two phases over time, each ended by an `Event` and a root find."""

import diffrax as dfx
import jax
import jax.numpy as jnp
import optimistix as optx

from calibration.speed.scene import Scene
from calibration.speed.ways import Way, with_gradient

LEAST = 1e-30  # of an overlap, whose root is taken


def plain_diffrax(scene: Scene, batch: int, rtol: float, gradient: bool = False) -> Way:
    def coefficient(theta, velocity):
        law = scene.law_of(*theta)
        contact, d = law.contact, jnp.asarray(law.plasticity())
        steepness, y = law.chi * contact.yield_ratio, velocity / contact.critical_velocity
        return jax.vmap(lambda y: _one(d, steepness, y, rtol))(y)

    value = jax.jit(coefficient)
    return Way(
        "diffrax, two events",
        f"tsit5, rtol {rtol:.0e}",
        batch,
        lambda velocity: value(scene.theta, velocity),
        with_gradient(scene, coefficient) if gradient else None,
    )


def _one(d, steepness, impact, rtol):
    # diffrax hands the state of the ODE to events under the name y
    def loading(t, y, args):
        x, u = y
        return u, -1.25 * loading_force(x, d)

    def stopped(t, y, args, **kwargs):
        return y[1]

    x_m, _ = phase(loading, stopped, (jnp.zeros_like(impact), impact), rtol)

    def unloading(t, y, args):
        x, u = y
        return u, -1.25 * unloading_force(x, x_m, d, steepness)

    def released(t, y, args, **kwargs):
        return unloading_force(y[0], x_m, d, steepness)

    _, u = phase(unloading, released, (x_m, jnp.zeros_like(impact)), rtol)
    return -u / impact


def phase(field, condition, start, rtol, longest=10.0, direction=None):
    """The state where `condition` vanishes, going through zero in a direction if one is told."""
    newton = optx.Newton(1e-10, 1e-10, optx.rms_norm)
    solution = dfx.diffeqsolve(
        dfx.ODETerm(field),
        dfx.Tsit5(),
        t0=0.0,
        t1=longest,
        dt0=None,
        y0=start,
        stepsize_controller=dfx.PIDController(rtol=rtol, atol=rtol),
        event=dfx.Event(condition, newton, direction=direction),
        max_steps=4096,
        throw=False,
    )
    return jax.tree.map(lambda leaf: leaf[-1], solution.ys)


def loading_force(x, d):
    """Eq. (8) in units of first yield."""
    s = jnp.sqrt(jnp.maximum(x, LEAST))
    return x * s + jnp.where(x > 1, d * (x**2 - 1) * (1 - s), 0.0)


def unloading_force(x, x_m, d, steepness):
    """Eq. (12)."""
    s = jnp.sqrt(jnp.maximum(x, LEAST))
    line = 1 - steepness * (1 - x / x_m)
    return (1 - d * x_m) * x * s + d * s + d * (x_m**2 - 1) * line
