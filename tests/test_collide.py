"""Histories: what they end with, what they enclose, and the equation of motion along them."""

from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import softjax as sj
from tests.cases import fitted

ROUTE = sj.ODE(rtol=1e-10)
HISTORY = ("time", "overlap", "velocity", "force")


# v/v_cr, as two rows: at rest, slow, elastic, just yielding; plain ones; without a turning point
RATIOS = np.array([[0.0, 1e-6, 0.6, 1.0 + 1e-9, 1.05], [3.0, 10.0, 40.0, 250.0, 3e3]])
MOVING = (RATIOS > 0) & (RATIOS < 300)
PLAIN = (RATIOS > 0.5) & (RATIOS < 50)
PEAK = 1000  # the sample of 2001 where unloading begins


@lru_cache
def histories(form):
    """The law, its impacts, their histories and what `restitution` says of them."""
    law = fitted("nylon", form)
    velocity = law.contact.critical_velocity * RATIOS
    hit = sj.collide(law, velocity, samples=2001, route=ROUTE)
    return law, velocity, jax.tree.map(np.asarray, hit), sj.restitution(law, velocity)


@pytest.mark.parametrize("form", ["first-order", pytest.param("full", marks=pytest.mark.long)])
def test_ends_and_energy(form):
    law, velocity, hit, curve = histories(form)
    for part in (hit.time, hit.overlap, hit.velocity, hit.force):
        assert part.shape == (2, 5, 2001)
    assert np.array_equal(hit.status, curve.status)
    assert np.allclose(hit.duration[MOVING], curve.duration[MOVING], rtol=1e-8)
    velocity, plastic = velocity[PLAIN], np.asarray(curve.plastic_coefficient)[PLAIN]
    at = {name: np.asarray(getattr(hit, name))[PLAIN] for name in HISTORY}
    assert np.allclose(at["velocity"][:, -1], -plastic * velocity, rtol=1e-8)
    assert np.allclose(at["velocity"][:, 0], velocity, rtol=1e-14)
    assert np.allclose(at["overlap"][:, -1], curve.residual_overlap[PLAIN], rtol=0, atol=1e-14)
    assert np.allclose(at["overlap"][:, PEAK], curve.peak_overlap[PLAIN], rtol=1e-9)
    assert np.allclose(hit.coefficient[PLAIN], curve.coefficient[PLAIN], rtol=0, atol=1e-9)
    assert np.allclose(hit.plastic_coefficient[PLAIN], plastic, rtol=0, atol=1e-9)
    loop = np.trapezoid(at["force"], at["overlap"], axis=-1)
    impact = 0.5 * law.contact.mass * velocity**2
    assert np.all(np.abs(loop - impact * (1 - plastic**2)) <= 1e-6 * impact)


def tenfold(form):
    """The impact of ten critical velocities alone."""
    law, velocity, hit, _ = histories(form)
    return law, velocity[1, 1], {name: getattr(hit, name)[1, 1] for name in HISTORY}


@pytest.mark.parametrize("form", ["first-order", pytest.param("full", marks=pytest.mark.long)])
def test_the_states_are_those_of_an_ode_solver(form):
    """SciPy integrates the law's force in time, one velocity at a time."""
    law, velocity, hit = tenfold(form)
    length, pace = law.contact.critical_overlap, law.contact.critical_velocity
    peak = hit["overlap"][PEAK]
    reduced = law.reduced()
    loading = jax.jit(lambda x: reduced.loading(jnp.maximum(x, 0.0)))
    unloading = jax.jit(lambda x: reduced.unloading(jnp.maximum(x, 0.0), peak / length))

    def integrate(force, state, times):
        motion = lambda t, u: [u[1], -1.25 * float(force(u[0]))]  # noqa: E731
        settings = {"method": "DOP853", "rtol": 1e-10, "atol": 1e-12}
        return solve_ivp(motion, times[[0, -1]], state, t_eval=times, **settings).y

    times = hit["time"] / (length / pace)
    there = integrate(loading, [0.0, velocity / pace], times[: PEAK + 1])
    back = integrate(unloading, [peak / length, 0.0], times[PEAK:])
    states = np.array([hit["overlap"] / length, hit["velocity"] / pace])
    allowed = 1e-7 * np.array([[peak / length], [velocity / pace]])
    assert np.all(np.abs(states[:, : PEAK + 1] - there) <= allowed)
    assert np.all(np.abs(states[:, PEAK:] - back) <= allowed)


def test_force_is_the_laws():
    law, _, hit = tenfold("first-order")
    there = law.loading_force(hit["overlap"][: PEAK + 1])
    back = law.unloading_force(hit["overlap"][PEAK + 1 :], hit["overlap"][PEAK])
    exact = np.append(there, back)
    assert np.allclose(hit["force"], exact, rtol=1e-12, atol=1e-12 * exact.max())
    assert abs(hit["force"][-1]) <= 1e-10 * exact.max()


@pytest.mark.parametrize("form", ["first-order", pytest.param("full", marks=pytest.mark.long)])
def test_time_runs_forward_and_everything_is_finite(form):
    hit = histories(form)[2]
    assert np.all(np.diff(hit.time[MOVING]) > 0)
    assert np.all(np.diff(hit.velocity[MOVING]) < 0)
    for part in jax.tree.leaves(hit):
        assert np.all(np.isfinite(part))


def test_where_there_is_no_collision_there_is_no_history():
    hit = histories("first-order")[2]
    for name in HISTORY:
        still = np.all(getattr(hit, name) == 0, axis=-1)
        assert np.array_equal(still, ~MOVING), name
    assert hit.status[1, -1] & sj.Status.NO_TURNING_POINT


@pytest.mark.parametrize(
    "derivative", [jax.jacfwd, pytest.param(jax.jacrev, marks=pytest.mark.long)]
)
def test_a_history_has_derivatives(derivative):
    """The end of the velocity is -ε_p v; its derivative is that of the energy balance."""
    law, velocity = fitted("nylon"), float(5 * fitted("nylon").contact.critical_velocity)

    def last(chi):
        hit = sj.collide(fitted("nylon", chi=chi), velocity, samples=5, route=ROUTE)
        return hit.velocity[-1]

    def expected(chi):
        return -velocity * sj.restitution(fitted("nylon", chi=chi), velocity).plastic_coefficient

    exact = float(jax.jit(derivative(expected))(law.chi))
    assert jax.jit(derivative(last))(law.chi) == pytest.approx(exact, rel=1e-6)


@pytest.mark.parametrize("samples", [2, 0, -1, 2.0, "5", None, True])
def test_samples(samples):
    with pytest.raises(ValueError, match="`samples` must be a whole number >= 3"):
        sj.collide(fitted("nylon"), 1.0, samples=samples)


def test_samples_may_be_numpys():
    hit = sj.collide(sj.Hertz(fitted("nylon").contact), 1.0, samples=np.int64(5))
    assert hit.time.shape == (5,)


@pytest.mark.parametrize("route", [sj.EnergyBalance(), "ode", 1])
def test_only_the_ode_has_histories(route):
    with pytest.raises(ValueError, match=r"`route` must be ODE\(...\)"):
        sj.collide(fitted("nylon"), 1.0, route=route)


@pytest.mark.parametrize("velocity", [-1.0, np.nan, "fast", np.ones(3)])
def test_velocity(velocity):
    law = fitted("nylon", chi=np.array([0.1, 0.2]))
    with pytest.raises(ValueError, match="`velocity`"):
        sj.collide(law, velocity)
    with pytest.raises(ValueError, match="`law`"):
        sj.collide("nylon", velocity)
