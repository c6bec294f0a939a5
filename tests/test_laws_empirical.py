"""Eq. (17) as a law without a force, and hard spheres without a contact."""

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest

import softjax as sj
from tests import law_cases as lc

LIMIT, SIGMA, PSI = 340.0, 3.0432, 0.54
LAW = sj.EmpiricalRestitution(LIMIT, SIGMA, PSI)
VELOCITY = np.array([1e-6, 0.1, 1.0, 30.0, 339.0])


def eq_17(limit, sigma, psi, velocity):
    return mp.exp(-sigma * (velocity / (limit - velocity)) ** psi)


def test_it_is_the_printed_formula_and_nothing_else():
    result = sj.restitution(LAW, VELOCITY)
    expected = [float(eq_17(LIMIT, SIGMA, PSI, mp.mpf(v))) for v in VELOCITY]
    assert np.allclose(result.coefficient, expected, rtol=1e-13, atol=0)
    assert np.array_equal(result.coefficient, result.plastic_coefficient)
    assert np.all(result.status == sj.Status.PLAIN)
    assert np.all(result.duration == 0)
    assert np.all(result.peak_overlap == 0)
    function = sj.empirical_restitution(VELOCITY, LIMIT, SIGMA, PSI)
    assert np.allclose(function, expected, rtol=1e-13, atol=0)


def test_rest_and_the_limit_velocity():
    result = sj.restitution(LAW, [0.0, LIMIT, 500.0])
    assert np.array_equal(result.coefficient, [1, 0, 0])
    rest, limit = sj.Status.ELASTIC | sj.Status.ZERO_VELOCITY, sj.Status.ABOVE_LIMIT_VELOCITY
    assert np.array_equal(result.status, [rest, limit, limit])


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_derivatives(dtype):
    def total(law, velocity):
        return sj.restitution(law, velocity).coefficient.sum()

    law = jax.tree.map(lambda leaf: jnp.full(3, leaf, dtype), LAW)
    velocity = np.array([0.1, 30.0, 339.0], dtype)
    by_law, by_velocity = jax.grad(total, (0, 1))(law, velocity)
    found = [by_law.limit_velocity, by_law.sigma, by_law.psi, by_velocity]
    for k, v in enumerate(velocity):
        at = [mp.mpf(LIMIT), mp.mpf(SIGMA), mp.mpf(PSI), mp.mpf(float(v))]
        for j in range(4):
            order = [int(i == j) for i in range(4)]
            exact = float(mp.diff(eq_17, tuple(at), tuple(order)) * at[j])
            assert float(found[j][k]) * float(at[j]) == pytest.approx(
                exact, rel=2e-4 if dtype == np.float32 else 1e-9, abs=1e-15
            )


def test_a_history_is_refused():
    with pytest.raises(ValueError, match="EmpiricalRestitution is one of hard spheres"):
        sj.collide(LAW, 1.0)


def test_wrong_input_is_named():
    lc.assert_refused(lambda a: sj.EmpiricalRestitution(a, 1.0, 1.0), "limit_velocity", 0.0, "1")
    lc.assert_refused(lambda a: sj.EmpiricalRestitution(1.0, a, 1.0), "sigma", -1.0, np.nan)
    lc.assert_refused(lambda a: sj.EmpiricalRestitution(1.0, 1.0, a), "psi", 0.0, None)
    function = sj.empirical_restitution
    lc.assert_refused(lambda a: function(a, LIMIT, SIGMA, PSI), "velocity", -1.0, np.nan, "1")
    lc.assert_refused(lambda a: function(1.0, LIMIT, a, PSI), "sigma", -1.0)


def test_under_jit_the_status_tells_and_the_function_gives_zero():
    velocity = np.array([0.5, np.nan, -1.0, np.inf])
    result = jax.jit(sj.restitution)(LAW, velocity)
    assert np.array_equal(result.status == sj.Status.INVALID_INPUT, [False, True, True, True])
    total = lambda v, sigma: sj.empirical_restitution(v, LIMIT, sigma, PSI)  # noqa: E731
    values = jax.jit(total)(velocity, SIGMA)
    assert values[0] > 0.9
    assert np.array_equal(values[1:], [0, 0, 0])
    assert jax.jit(total)(0.5, -1.0) == 0
    slopes = jax.jit(jax.grad(lambda v: total(v, SIGMA).sum()))(velocity)
    assert np.all(np.isfinite(slopes))
    assert np.array_equal(slopes[1:], [0, 0, 0])


def test_a_constant_needs_no_contact():
    law = sj.ConstantRestitution(None, restitution=0.9)
    result = sj.restitution(law, [0.5, 2.0])
    assert np.allclose(result.coefficient, 0.9, rtol=1e-15, atol=0)
    assert jax.grad(lambda e: sj.restitution(sj.ConstantRestitution(None, e), 1.0).coefficient)(
        0.9
    ) == pytest.approx(1.0)
