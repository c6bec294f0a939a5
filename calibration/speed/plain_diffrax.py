"""The plain way with diffrax: two phases over time, each ended by an `Event` and a root find."""

import diffrax as dfx
import jax
import jax.numpy as jnp
import optimistix as optx

from calibration.speed.scene import Scene
from calibration.speed.ways import Way


def plain_diffrax(scene: Scene, batch: int, rtol: float, gradient: bool = False) -> Way:
    d, steepness, _ = scene.reduced()
    critical = scene.contact.critical_velocity

    @jax.jit
    def value(velocity):
        return _batch(jnp.asarray(d), jnp.asarray(steepness), velocity / critical, rtol)

    @jax.jit
    def value_and_gradient(theta, velocity):
        def total(theta):
            law = scene.law_of(*theta)
            y = velocity / law.contact.critical_velocity
            return jnp.sum(_batch(law.plasticity(), theta[0] * law.contact.yield_ratio, y, rtol))

        value, slopes = jax.value_and_grad(total)(theta)
        return value, tuple(t * s for t, s in zip(theta, slopes, strict=True))

    return Way(
        "diffrax, two events",
        f"tsit5, rtol {rtol:.0e}",
        batch,
        value,
        (lambda velocity: value_and_gradient(scene.theta, velocity)) if gradient else None,
    )


def _batch(d, steepness, y, rtol):
    return jax.vmap(lambda y: _one(d, steepness, y, rtol))(y)


def _one(d, steepness, impact, rtol):
    # diffrax hands the state of the ODE to events under the name y
    def loading(t, y, args):
        x, u = y
        return u, -1.25 * _loading_force(x, d)

    def stopped(t, y, args, **kwargs):
        return y[1]

    x_m, _ = _phase(loading, stopped, (jnp.zeros_like(impact), impact), rtol)

    def unloading(t, y, args):
        x, u = y
        return u, -1.25 * _unloading_force(x, x_m, d, steepness)

    def released(t, y, args, **kwargs):
        return _unloading_force(y[0], x_m, d, steepness)

    _, u = _phase(unloading, released, (x_m, jnp.zeros_like(impact)), rtol)
    return -u / impact


def _phase(field, condition, start, rtol):
    solution = dfx.diffeqsolve(
        dfx.ODETerm(field),
        dfx.Tsit5(),
        t0=0.0,
        t1=10.0,
        dt0=None,
        y0=start,
        stepsize_controller=dfx.PIDController(rtol=rtol, atol=rtol),
        event=dfx.Event(condition, optx.Newton(1e-10, 1e-10, optx.rms_norm)),
        max_steps=4096,
        throw=False,
    )
    return jax.tree.map(lambda leaf: leaf[-1], solution.ys)


def _loading_force(x, d):
    s = jnp.sqrt(jnp.maximum(x, 1e-30))
    return x * s + jnp.where(x > 1, d * (x**2 - 1) * (1 - s), 0.0)


def _unloading_force(x, x_m, d, steepness):
    s = jnp.sqrt(jnp.maximum(x, 1e-30))
    line = 1 - steepness * (1 - x / x_m)
    return (1 - d * x_m) * x * s + d * s + d * (x_m**2 - 1) * line
