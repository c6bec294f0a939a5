"""Histories: what they end with, what they enclose, and the equation of motion along them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import softjax as sj
from tests.cases import FORMS, fitted

ROUTE = sj.ODE(rtol=1e-10)


def impacts(law):
    return law.contact.critical_velocity * np.array([0.6, 1.05, 3.0, 40.0])


@pytest.mark.parametrize("form", FORMS)
def test_ends_and_energy(form):
    law = fitted("nylon", form)
    velocity = impacts(law)
    hit = sj.collide(law, velocity, samples=2001, route=ROUTE)
    curve = sj.restitution(law, velocity)
    assert hit.time.shape == hit.overlap.shape == hit.velocity.shape == hit.force.shape == (4, 2001)
    plastic = curve.plastic_coefficient
    assert np.allclose(hit.velocity[:, -1], -plastic * velocity, rtol=1e-8)
    assert np.allclose(hit.velocity[:, 0], velocity, rtol=1e-14)
    assert np.allclose(hit.overlap[:, -1], curve.residual_overlap, rtol=0, atol=1e-14)
    assert np.allclose(hit.overlap[:, 1000], curve.peak_overlap, rtol=1e-9)
    assert np.allclose(hit.duration, curve.duration, rtol=1e-8)
    assert np.allclose(hit.coefficient, curve.coefficient, rtol=0, atol=1e-9)
    assert np.allclose(hit.plastic_coefficient, plastic, rtol=0, atol=1e-9)
    assert np.array_equal(hit.status, curve.status)
    loop = np.trapezoid(hit.force, hit.overlap, axis=-1)
    impact = 0.5 * law.contact.mass * velocity**2
    assert np.all(np.abs(loop - impact * (1 - plastic**2)) <= 1e-6 * impact)


@pytest.mark.parametrize("form", FORMS)
def test_the_states_are_those_of_an_ode_solver(form):
    """SciPy integrates the law's force in time, one velocity at a time."""
    law = fitted("nylon", form)
    velocity = float(10 * law.contact.critical_velocity)
    hit = jax.tree.map(np.asarray, sj.collide(law, velocity, samples=101, route=ROUTE))
    length, pace = law.contact.critical_overlap, law.contact.critical_velocity
    peak = hit.overlap[50]
    reduced = law.reduced()
    loading = jax.jit(lambda x: reduced.loading(jnp.maximum(x, 0.0)))
    unloading = jax.jit(lambda x: reduced.unloading(jnp.maximum(x, 0.0), peak / length))

    def integrate(force, state, times):
        motion = lambda t, u: [u[1], -1.25 * float(force(u[0]))]  # noqa: E731
        settings = {"method": "DOP853", "rtol": 1e-10, "atol": 1e-12}
        return solve_ivp(motion, times[[0, -1]], state, t_eval=times, **settings).y

    times = hit.time / (length / pace)
    there = integrate(loading, [0.0, velocity / pace], times[:51])
    back = integrate(unloading, [peak / length, 0.0], times[50:])
    assert np.allclose(hit.overlap[:51] / length, there[0], rtol=0, atol=1e-7 * there[0].max())
    assert np.allclose(hit.velocity[:51] / pace, there[1], rtol=0, atol=1e-7 * velocity / pace)
    assert np.allclose(hit.overlap[50:] / length, back[0], rtol=0, atol=1e-7 * there[0].max())
    assert np.allclose(hit.velocity[50:] / pace, back[1], rtol=0, atol=1e-7 * velocity / pace)


def test_force_is_the_laws():
    law = fitted("nylon")
    hit = sj.collide(law, float(10 * law.contact.critical_velocity), samples=101)
    there = law.loading_force(hit.overlap[:51])
    back = law.unloading_force(hit.overlap[51:], hit.overlap[50])
    assert np.allclose(hit.force, np.append(there, back), rtol=1e-12, atol=1e-12 * there.max())
    assert abs(hit.force[-1]) <= 1e-10 * there.max()


def test_time_runs_forward_and_everything_is_finite():
    law = fitted("stainless steel")
    ratios = np.array([[1e-6, 0.3, 1.0], [1.0 + 1e-9, 5.0, 250.0]])
    hit = sj.collide(law, law.contact.critical_velocity * ratios, samples=31)
    assert hit.time.shape == (2, 3, 31)
    assert np.all(np.diff(hit.time) > 0)
    assert np.all(np.diff(hit.velocity) < 0)
    for part in jax.tree.leaves(hit):
        assert np.all(np.isfinite(part))


def test_where_there_is_no_collision_there_is_no_history():
    law = fitted("nylon")
    velocity = np.array([0.0, 5.0, 3e3]) * law.contact.critical_velocity
    hit = sj.collide(law, velocity, samples=5)
    for part in (hit.time, hit.overlap, hit.velocity, hit.force):
        assert np.all(part[0] == 0)
        assert np.any(part[1] != 0)
        assert np.all(part[2] == 0)
    assert hit.status[2] & sj.Status.NO_TURNING_POINT


def test_a_history_has_derivatives():
    """The end of the velocity is -ε_p v; its derivative is that of the energy balance."""
    law, velocity = fitted("nylon"), float(5 * fitted("nylon").contact.critical_velocity)

    def last(chi):
        hit = sj.collide(fitted("nylon", chi=chi), velocity, samples=5, route=ROUTE)
        return hit.velocity[-1]

    def expected(chi):
        return -velocity * sj.restitution(fitted("nylon", chi=chi), velocity).plastic_coefficient

    for derivative in (jax.jacfwd, jax.jacrev):
        slope = jax.jit(derivative(last))(law.chi)
        assert slope == pytest.approx(float(jax.jit(derivative(expected))(law.chi)), rel=1e-6)


@pytest.mark.parametrize("samples", [2, 0, -1, 2.0, "5", None, True])
def test_samples(samples):
    with pytest.raises(ValueError, match="`samples` must be a whole number >= 3"):
        sj.collide(fitted("nylon"), 1.0, samples=samples)


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
