"""Partial pooling: against the normal model's closed form, and limits."""

import jax
import numpy as np
import pytest
from scipy import stats

import calibration as cal
import softjax as sj
from tests.decay import Decay

V = np.linspace(1.0, 5.0, 6)
NAMES = ("a", "b", "c", "d", "e")
POOLED = {"restitution": cal.Parameter(shared="pooled", transform="none")}


def constants(spread=0.03, noise=0.02, seed=0):
    """Five specimens of constant ε, each with a level of its own and stated uncertainties."""
    random = np.random.default_rng(seed)
    sets = []
    for name in NAMES:
        level = 0.8 + spread * random.standard_normal()
        measured = level + noise * random.standard_normal(len(V))
        sets.append(cal.RestitutionData(V, measured, name=name, uncertainty=noise))
    return sets


def test_the_normal_model_in_closed_form(tmp_path):
    """And the members' errors given τ: (1/τ² + n/s²)⁻¹ about the mean, and the mean's own share."""
    sets = constants()
    result = cal.fit(sets, sj.ConstantRestitution, POOLED, profiles=False)
    # equal groups: μ, τ by the analysis of variance; members by shrinking their means
    means, variance = np.array([np.mean(data.restitution) for data in sets]), 0.02**2 / len(V)
    mean, tau = np.mean(means), np.sqrt(np.var(means, ddof=1) - variance)
    members = mean + tau**2 / (tau**2 + variance) * (means - mean)
    assert tau > 0.01
    assert result.values["restitution_spread"] == pytest.approx(tau, rel=1e-4)
    assert result.values["restitution"] == pytest.approx(mean, rel=1e-6)
    found = [result.values[f"restitution[{name}]"] for name in NAMES]
    np.testing.assert_allclose(found, members, rtol=1e-5)
    error = np.sqrt((tau**2 + 0.02**2 / len(V)) / len(NAMES))  # of the mean of equal specimens
    pool = result.pooled["restitution"]
    assert pool.standard_error == pytest.approx(error, rel=1e-4)
    reach = stats.t.ppf(0.975, len(NAMES) - 1) * error
    assert (pool.low, pool.high) == pytest.approx((mean - reach, mean + reach), rel=1e-4)
    precision = (len(V) / 0.02**2) * np.eye(len(NAMES))
    precision += (np.eye(len(NAMES)) - 1 / len(NAMES)) / tau**2  # the mean integrated over
    errors = [result.standard_errors[f"restitution[{name}]"] for name in NAMES]
    np.testing.assert_allclose(errors, np.sqrt(np.diag(np.linalg.inv(precision))), rtol=1e-4)
    assert result.converged
    assert result.log_likelihood is None
    result.save(tmp_path / "fit.json")
    assert cal.FitResult.load(tmp_path / "fit.json") == result


def test_specimens_that_are_alike_have_no_spread():
    """Fewer differences than the noise makes: τ = 0, as if the parameter were shared."""
    sets = [
        cal.RestitutionData(V, 0.8 + 0.02 * np.cos(3 * V + k), name=n, uncertainty=0.05)
        for k, n in enumerate(NAMES)
    ]
    pooled = cal.fit(sets, sj.ConstantRestitution, POOLED, profiles=False)
    shared = {"restitution": cal.Parameter(shared=True)}
    together = cal.fit(sets, sj.ConstantRestitution, shared, profiles=False)
    assert pooled.values["restitution_spread"] == 0.0
    assert pooled.pooled["restitution_spread"].low == 0.0
    assert 0 < pooled.pooled["restitution_spread"].high < 0.1
    for name in NAMES:
        value = pooled.values[f"restitution[{name}]"]
        assert value == pytest.approx(together.values["restitution"], abs=1e-6)


def test_likelihood_functions_know_the_pool():
    """Members' density about the mean, on the scale that is searched: a log-normal one."""
    sets = [cal.RestitutionData(V, 0.9 * np.exp(-0.1 * V), name=n, uncertainty=0.01) for n in "ab"]
    problem = cal.problem(sets, Decay, {"rate": cal.Parameter(shared="pooled")})
    expected = ("level[a]", "rate[a]", "level[b]", "rate[b]", "rate", "rate_spread")
    assert problem.names == expected
    theta = dict(zip(problem.names, (0.9, 0.12, 0.9, 0.08, 0.1, 0.3), strict=True))
    density = sum(stats.lognorm.logpdf(rate, 0.3, scale=0.1) for rate in (0.12, 0.08))
    prior = jax.jit(problem.log_prior)
    assert float(prior(theta)) == pytest.approx(density, rel=1e-10)
    rows = np.asarray(jax.jit(problem.residuals)(theta))[-2:]
    np.testing.assert_allclose(rows, np.log([1.2, 0.8]) / 0.3, rtol=1e-10)
    assert float(prior(theta | {"rate_spread": -1.0})) == -np.inf
