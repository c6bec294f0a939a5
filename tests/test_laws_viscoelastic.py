"""Viscoelastic spheres: published numbers, another integrator, gradients, hard cases."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import softjax as sj
from tests import law_cases as lc

W_SQUARED = np.array([0.01, 0.1, 0.3, 1.0])  # w² = β v^{1/5}, β = 3/2 A (k/M)^{2/5}
PUBLISHED = np.array([0.98855, 0.89286, 0.72209, 0.39393])
# how far the published Padé approximant is off, to one digit
PADE_OFF = np.array([6e-8, 5e-5, 7e-4, 5e-3])


def dissipation_time(w_squared, velocity=1.0):
    """A that makes w² of an impact."""
    return w_squared / (1.5 * (lc.PAIR.stiffness / lc.PAIR.mass) ** 0.4 * velocity**0.2)


def integrated(w_squared):
    """ε by SciPy's DOP853 over time: δ'' = -δ^{3/2} - w² √δ δ', δ' = 1 at touch, until P = 0."""

    def motion(_, state):
        overlap = max(state[0], 0.0)
        return [state[1], -(overlap**1.5) - w_squared * np.sqrt(overlap) * state[1]]

    def force(time, state):
        return state[0] + w_squared * state[1] if time > 1.0 else 1.0

    force.terminal, force.direction = True, -1
    solution = solve_ivp(
        motion, (0, 10), [0.0, 1.0], method="DOP853", rtol=1e-12, atol=1e-14, events=force
    )
    return -solution.y_events[0][0, 1]


def pade(w_squared):
    """The approximant of Müller and Pöschel, Phys. Rev. E 84, 021302 (2011)."""
    w = np.sqrt(w_squared)
    above = 1 + 0.501086 * w
    return above / (above + 1.15345 * w**2 + 0.577977 * w**3 + 0.532178 * w**4)


@pytest.fixture(scope="module")
def batch():
    law = sj.ViscoelasticHertz(lc.PAIR, dissipation_time(W_SQUARED))
    return sj.restitution(law, np.ones(4), lc.ODE)


def test_published_numbers(batch):
    assert np.allclose(batch.coefficient, PUBLISHED, rtol=0, atol=5.5e-6)
    assert np.all(batch.status == sj.Status.PLAIN)


def test_distance_of_the_pade_approximant(batch):
    off = pade(W_SQUARED) - np.asarray(batch.coefficient)
    assert np.all(off > 0)
    assert np.all(np.abs(off / PADE_OFF - 1) < 0.09)


def test_another_integrator(batch):
    exact = [integrated(value) for value in W_SQUARED]
    assert np.allclose(batch.coefficient, exact, rtol=0, atol=1e-9)


def test_overlap_left_is_where_the_force_vanishes(batch):
    left = 1.5 * dissipation_time(W_SQUARED) * np.asarray(batch.coefficient)
    assert np.allclose(batch.residual_overlap, left, rtol=1e-8, atol=0)


def test_only_w_matters():
    """The same w² from a slow impact and from a fast one."""
    velocity = np.array([1e-6, 1e-2, 1.0, 1e3])
    law = sj.ViscoelasticHertz(lc.PAIR, dissipation_time(0.1, velocity))
    result = sj.restitution(law, velocity, lc.ODE)
    assert np.ptp(law.dissipation_time) > 0
    assert np.allclose(result.coefficient, integrated(0.1), rtol=0, atol=1e-9)


@pytest.mark.parametrize("dtype", [np.float64, pytest.param(np.float32, marks=pytest.mark.long)])
def test_gradients_and_hard_velocities(dtype):
    law = sj.ViscoelasticHertz(lc.PAIR, dissipation_time(0.3))
    least = 1e-300 if dtype is np.float64 else 1e-30
    route = lc.ODE if dtype is np.float64 else sj.ODE(rtol=1e-6)
    found, status = lc.assert_survives(law, route, dtype, least)
    assert np.all(status[1:] == sj.Status.PLAIN)
    # ε → 1 as v → 0; float32 stops at impacts whose square it cannot hold
    assert np.isclose(found[1], 1, rtol=0, atol=1e-14 if dtype is np.float64 else 2e-3)
    tolerance = 1e-9 if dtype is np.float64 else 1e-5
    for i, velocity in ((2, 1e-6), (3, 1.0)):
        assert np.isclose(found[i], integrated(0.3 * velocity**0.2), rtol=0, atol=tolerance)
    assert found[4] < found[3]


def test_gradients():
    """θ ∂ε/∂θ = dε/d(ln w²) times w²'s power of θ."""
    law = sj.ViscoelasticHertz(lc.PAIR, dissipation_time(0.3))
    step = 1e-3
    change = [integrated(0.3 * np.exp(n * step)) for n in (-2, -1, 1, 2)]
    slope = np.dot([1, -8, 8, -1], change) / (12 * step)
    powers = dict.fromkeys(lc.LEAVES, 0.0)
    powers |= {"youngs_modulus": 0.4, "radius": 0.2, "mass": -0.4}
    powers |= {"dissipation_time": 1.0, "velocity": 0.2}
    _, _, slopes = lc.derivatives(law, lc.hard_velocities(), lc.ODE)
    found = {name: value[3] for name, value in slopes.items()}
    lc.assert_slopes(found, {name: power * slope for name, power in powers.items()}, 1e-7)


def test_without_viscosity_nothing_is_lost():
    law = sj.ViscoelasticHertz(lc.PAIR, np.zeros(4))
    result = sj.restitution(law, np.ones(4), lc.ODE)
    assert np.allclose(result.coefficient, 1, rtol=0, atol=1e-14)
    peak = sj.restitution(sj.Hertz(lc.PAIR), 1.0).peak_overlap
    assert np.allclose(result.peak_overlap, peak, rtol=1e-12, atol=0)
    assert np.all(result.status == sj.Status.PLAIN)


def test_history():
    velocity = np.array([0.01, 1.0])
    law = sj.ViscoelasticHertz(lc.PAIR, dissipation_time(0.3))
    hit = sj.collide(law, velocity, samples=2001, route=lc.ODE)
    impact = 0.5 * lc.PAIR.mass * velocity**2
    lost = 1 - np.square(hit.plastic_coefficient)
    assert np.isclose(hit.plastic_coefficient[1], integrated(0.3), rtol=0, atol=1e-9)
    assert np.allclose(lc.loop_area(hit) / impact, lost, rtol=0, atol=2e-6)
    assert np.allclose(hit.velocity[:, -1], -hit.coefficient * velocity, rtol=1e-9, atol=0)
    viscous = 1.5 * law.dissipation_time * np.sqrt(hit.overlap) * hit.velocity
    force = lc.PAIR.stiffness * (hit.overlap**1.5 + viscous)
    assert np.allclose(hit.force, force, rtol=0, atol=1e-12 * hit.force.max())
    assert np.all(np.abs(hit.force[:, -1]) < 1e-9 * hit.force.max(axis=-1))
    # δ' is the rate of δ: the trapezoidal rule over time gives the overlap back
    middle = 0.5 * (hit.velocity[:, 1:] + hit.velocity[:, :-1])
    path = np.cumsum(middle * np.diff(hit.time), axis=-1)
    assert np.allclose(path, hit.overlap[:, 1:], rtol=0, atol=1e-5 * hit.overlap.max())


def test_traced_failures():
    law = sj.ViscoelasticHertz(lc.PAIR, dissipation_time(0.1))
    lc.assert_traced_failures(law, "dissipation_time", -1.0, lc.ODE)


def test_wrong_input_is_named():
    law = sj.ViscoelasticHertz(lc.PAIR, 1e-6)
    lc.assert_contact_refused(law)
    wrong = (-1.0, np.nan, np.inf, "1", None, [1e-6, -1e-6])
    lc.assert_refused(lambda a: sj.ViscoelasticHertz(lc.PAIR, a), "dissipation_time", *wrong)
    with pytest.raises(
        ValueError, match=r"`route` must be ClosedForm\(\) or ODE\(\.\.\.\) for Visc"
    ):
        sj.restitution(law, 1.0, sj.EnergyBalance())
