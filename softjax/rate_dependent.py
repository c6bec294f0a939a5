"""The equation of motion x'' = -(5/4) p(x, x') of a rate-dependent law.

Not integrated over time, because the ends are known in other variables (Hénon's trick). With k the
law's `work_exponent` the elastic part of the motion is a circle in (x^{k/2}, x'), on which an angle
θ runs from touch (0) over the peak (π/2) to parting (π) while the radius r shrinks by what the
dashpot takes:

    x^{k/2} = r sinθ,  x' = r cosθ,    sinθ = sin^{2k}φ,  so that  x = r^{2/k} sin⁴φ

φ instead of θ makes all powers of x smooth at both ends. The state is λ = -ln(r/y), and the time.

* Loading, and unloading to zero overlap, go over φ to π/2 and to π.
* Unloading to zero force goes over the ratio h of damping to elastic force, which grows from 0 at
  the peak to 1 where they cancel. It is put as an angle too, -cotϑ = h/h0 with h0 such that ϑ = θ
  near the peak: with little damping h stays small until the bodies part, the angle does not.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from softjax._bridge import over_batch, solve
from softjax.laws.base import Outcome, ReducedRateDependent
from softjax.routes import ODE

# φ where the integration starts, and how near π it ends: x is 1e-16 of its peak there, and any
# power of it still a number. What happens before is less than rounding.
EDGE = 1e-4
PEAK = 0.5 * np.pi
# without damping there is no ratio h to go over: this much of the critical damping, in units of
# the rounding error, is added to every law
LEAST_DAMPING = 0.01


def collide(law: ReducedRateDependent, y: Array, route: ODE) -> Outcome:
    """Overlaps and the part of the impact energy given back, one ODE for each velocity y > 0."""
    return over_batch(_collide_one, law, y, route)


def duration(law: ReducedRateDependent, y: Array, route: ODE) -> tuple[Array, Array]:
    """Contact duration [L/V] and whether the contact ends."""
    return over_batch(_duration_one, law, y, route)


def history(
    law: ReducedRateDependent, y: Array, fractions: tuple[np.ndarray, np.ndarray], route: ODE
) -> tuple[Array, Array, Array, Array]:
    """Time, overlap, velocity and force at fixed fractions of loading and of unloading.

    Args:
        fractions: two increasing arrays in [0, 1], of the angle of loading and of unloading; the
            peak is sampled once, as the end of loading.
        y: impact velocities > 0.

    Returns:
        Four arrays, a last axis of samples beyond the shape of y, zero where nothing turns.
    """
    along, back = fractions

    def one(law, y, route):
        loading, reached = _loading(law, y, route, clock=True, save=along)
        unloading, ended = _unloading(law, y, _last(loading), route, clock=True, save=back)
        joined = jax.tree.map(lambda *parts: jnp.concatenate(parts), loading, unloading)
        samples = _samples(law, y, joined)
        return tuple(jnp.where(reached & ended, sample, 0.0) for sample in samples)

    return over_batch(one, law, y, route)


def _last(states):
    return jax.tree.map(lambda state: state[-1], states)


def _samples(law, y, states):
    """Time, overlap, velocity and force of (φ, λ, τ)."""
    phi, loss, clock = states
    k = law.work_exponent
    x, speed = _position(law, y, phi, loss)
    # the edges stand for touch and, where it ends there, zero overlap
    x = jnp.where((phi <= EDGE) | (phi >= np.pi - EDGE), 0.0, x)
    clock = jnp.where(phi <= EDGE, 0.0, clock)
    return clock * y ** (2 / k - 1), x, speed, law.force(x, speed)


def _collide_one(law, y, route: ODE) -> Outcome:
    peak_state, reached = _loading(law, y, route, clock=False)
    end_state, ended = _unloading(law, y, peak_state, route, clock=False)
    turns = reached & ended
    peak, _ = _position(law, y, *peak_state)
    residual, _ = _position(law, y, *end_state)
    rebound = jnp.exp(-end_state[1]) * _theta(end_state[0], law.work_exponent)[1]  # x'/y
    parts_at_zero = law.ends_at == "zero-overlap"
    return Outcome(
        peak=jnp.where(turns, peak, 0.0),
        residual=jnp.where(turns & (not parts_at_zero), residual, 0.0),
        plastic_squared=jnp.where(turns, rebound**2, 0.0),
        turns=turns,
    )


def _duration_one(law, y, route: ODE):
    peak_state, reached = _loading(law, y, route, clock=True)
    (_, _, clock), ended = _unloading(law, y, peak_state, route, clock=True)
    turns = reached & ended
    return jnp.where(turns, clock * y ** (2 / law.work_exponent - 1), 0.0), turns


def _loading(law, y, route: ODE, clock: bool, save=None):
    """(φ, λ) and, with a clock, τ = t y^{1 - 2/k}, from touch to the peak."""
    zero = jnp.zeros_like(y)
    start = (zero, zero) if clock else (zero,)
    return _over_angle(law, y, EDGE, PEAK, start, route, save)


def _unloading(law, y, peak_state, route: ODE, clock: bool, save=None):
    if law.ends_at == "zero-overlap":
        return _over_angle(law, y, PEAK, np.pi - EDGE, peak_state[1:], route, save)
    return _to_zero_force(law, y, peak_state, route, save)


def _over_angle(law, y, start, end, state, route: ODE, save):
    start, end = jnp.full_like(y, start), jnp.full_like(y, end)
    field = partial(_angle_field, clock=len(state) == 2)
    states, solved = solve(field, start, end, state, (law, y), route, save)
    phi = end if save is None else start + (end - start) * save
    return (phi, *states), solved & jnp.isfinite(_final(states[0]))


def _final(values):
    return values if values.ndim == 0 else values[-1]


def _angle_field(phi, state, args, *, clock):
    """dλ/dφ and dτ/dφ."""
    law, y = args
    rates = _rates(law, y, phi, state[0])
    return rates if clock else rates[:1]


def _rates(law, y, phi, loss):
    k = law.work_exponent
    sin = jnp.sin(phi)
    sin_theta, cos_theta, root = _theta(phi, k)
    x, speed = _position(law, y, phi, loss)
    circling = 0.5 * k * x ** (0.5 * k - 1)  # θ' without damping
    # divided one by one: the product's square, which derivatives meet, would underflow
    damping = 1.25 * _dissipative(law, x, speed) / (y * jnp.exp(-loss)) / circling
    pace = 1 + damping * sin_theta  # θ' over that
    turn = 2 * k * sin ** (2 * k - 1) / root  # dθ/dφ
    time = 4 * sin**3 * jnp.exp((1 - 2 / k) * loss) / (root * pace)
    return damping * cos_theta * turn / pace, time


def _dissipative(law, x, speed):
    """The law's damping force, kept from vanishing."""
    k = law.work_exponent
    least = LEAST_DAMPING * float(jnp.finfo(x.dtype).eps)
    return law.dissipative(x, speed) + 0.4 * k * least * x ** (0.5 * k - 1) * speed


def _theta(phi, k):
    """sinθ, cosθ and √((1 - sin²θ)/cos²φ) of sinθ = sin^{2k}φ."""
    square = jnp.sin(phi) ** 2
    root = jnp.sqrt(sum(square**j for j in range(round(2 * k))))
    return jnp.sin(phi) ** (2 * k), jnp.cos(phi) * root, root


def _position(law, y, phi, loss):
    """Overlap x and velocity x'."""
    k = law.work_exponent
    radius = y * jnp.exp(-loss)
    return radius ** (2 / k) * jnp.sin(phi) ** 4, radius * _theta(phi, k)[1]


def _to_zero_force(law, y, peak_state, route: ODE, save):
    """From the peak over ϑ, with φ as a state beside the others."""
    _, *state = peak_state
    k = law.work_exponent
    peak, _ = _position(law, y, *peak_state[:2])
    scale = _initial_damping(law, peak)  # h0
    sin_end = scale / jnp.sqrt(1 + scale**2)  # h = 1
    start = jnp.full_like(y, PEAK)
    end = np.pi - jnp.arcsin(sin_end ** (1 / (2 * k)))
    field = partial(_ratio_field, clock=len(state) == 2)
    states, solved = solve(field, start, end, (start, *state), (law, y, scale), route, save)
    return states, solved & jnp.isfinite(_final(states[1]))


def _initial_damping(law, peak):
    """h0 = -dh/dcotθ at the peak."""
    k = law.work_exponent
    _, slope = jax.jvp(partial(_dissipative, law, peak), (jnp.zeros_like(peak),), (peak * 0 + 1,))
    return 1.25 * slope / (0.5 * k * peak ** (0.5 * k - 1))


def _ratio_field(angle, state, args, *, clock):
    """dφ, dλ and dτ over the angle of h."""
    law, y, scale = args
    k = law.work_exponent
    phi, loss = state[:2]
    rates = _rates(law, y, phi, loss)
    sin = jnp.sin(angle)
    root = _theta(angle, k)[2]
    # d(-cotϑ)/dangle over dh/dφ
    wanted = scale * 2 * k / (sin ** (2 * k + 1) * root)
    change = wanted / _ratio_slope(law, y, phi, loss, rates[1])
    moved = tuple(change * rate for rate in rates)
    return (change, *(moved if clock else moved[:1]))


def _ratio_slope(law, y, phi, loss, time_rate):
    """dh/dφ on the way, h = -damping/elastic force."""
    k = law.work_exponent
    x, speed = _position(law, y, phi, loss)
    force, elastic = partial(_dissipative, law), law.elastic(x)
    acceleration = -1.25 * (elastic + force(x, speed))
    damping, change = jax.jvp(force, (x, speed), (speed, acceleration))
    root = jnp.sqrt(elastic)  # again so that no square underflows
    slope = (damping / root) / root * (k - 1) * (speed / x) - (change / root) / root
    return slope * time_rate * y ** (2 / k - 1)
