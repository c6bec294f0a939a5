"""Measured ε = 0 where the law has no rebound: the likelihood is of the law's own ε, which is 0 there."""

import jax
import numpy as np
import pytest

import calibration as cal
import softjax as sj

TRUTH = {"chi": 0.6, "sigma": 16.0, "psi": 0.54}
U = 0.01


def data(seed):
    """26 impacts up to 80 times the critical velocity, of which the fastest stick."""
    pair = sj.Contact.between_spheres(sj.NYLON, sj.NYLON, 0.0127, 0.0127)
    velocity = np.geomspace(0.3, 80, 26) * float(pair.critical_velocity)
    exact = np.asarray(sj.restitution(sj.Zhou(pair, **TRUTH), velocity).coefficient)
    noisy = np.maximum(exact + U * np.random.default_rng(seed).standard_normal(26), 0)
    return cal.RestitutionData(velocity, np.where(exact > 0, noisy, 0), pair, uncertainty=U), exact


def test_the_likelihood_is_of_the_law_s_own_restitution():
    """A root continued below zero makes ln L less by thousands, and predictions negative."""
    measured, exact = data(0)
    assert np.sum(exact == 0) >= 8
    problem = cal.problem(measured)
    residual = (exact - measured.restitution) / U
    expected = -0.5 * np.sum(residual**2 + np.log(2 * np.pi * U**2))
    np.testing.assert_allclose(jax.jit(problem.predict)(TRUTH)[0], exact, rtol=0, atol=1e-12)
    assert float(jax.jit(problem.log_likelihood)(TRUTH)) == pytest.approx(expected, rel=1e-10)


def test_a_fit_to_impacts_that_stick_finds_the_truth():
    measured, _ = data(3)
    result = cal.fit(measured, profiles=False, starts=4)
    assert result.converged
    low, high = result.intervals["chi"]
    assert low < 0.6 < high < low + 0.1
    assert (
        result.log_likelihood >= float(jax.jit(cal.problem(measured).log_likelihood)(TRUTH)) - 1e-6
    )
    assert np.all(result.band(measured.velocity).coefficient >= 0)


def test_a_search_finds_its_way_back_from_where_nothing_rebounds():
    """At χ̃ = 20 most impacts stick that were seen to rebound: the law's own ε has no slope there."""
    measured, _ = data(0)
    losses = {"sigma": 16.0, "psi": 0.54}
    parameters = losses | {"chi": cal.Parameter(20.0)}
    result = cal.fit(measured, None, parameters, starts=1, profiles=False)
    assert result.converged
    assert result.values["chi"] == pytest.approx(0.6, abs=0.06)


@pytest.mark.long
def test_intervals_hold_the_truth_in_40_sets():
    inside = 0
    for seed in range(40):
        low, high = cal.fit(data(seed)[0]).intervals["chi"]
        inside += low <= 0.6 <= high
    assert inside >= 34
