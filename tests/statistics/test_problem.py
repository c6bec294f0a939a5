"""`cal.problem`: the likelihood as pure JAX functions, against SciPy's densities and differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats
from scipy.optimize import approx_fprime, minimize_scalar

import calibration as cal
import softjax as sj
from tests import fit_oracle
from tests.decay import Decay
from tests.fit_data import TRUTH, twin

V = np.linspace(0.5, 4.0, 12)
ABOUT = {"level": 0.9, "rate": 0.1}


def decaying(seed=0, noise=0.02, **told):
    random = np.random.default_rng(seed)
    errors = noise * random.standard_normal(len(V))
    return cal.RestitutionData(V, 0.92 * np.exp(-0.08 * V) + errors, **told)


def off(data, theta=ABOUT):
    return theta["level"] * np.exp(-theta["rate"] * data.velocity) - data.restitution


def test_slopes_are_those_of_differences():
    """Reverse mode, as samplers use it; through noise and prior too."""
    prior = {"level": cal.Parameter(prior=(0.85, 0.1))}
    problem = cal.problem(decaying(), Decay, prior)
    names = (*problem.names, "noise")

    @jax.jit
    def density(x):
        theta = dict(zip(names, x, strict=True))
        return problem.log_likelihood(theta) + problem.log_prior(theta)

    at = np.array([0.9, 0.1, 0.03])
    expected = approx_fprime(at, lambda x: float(density(x)), 1e-7)
    np.testing.assert_allclose(jax.grad(density)(at), expected, rtol=1e-4)
    assert float(problem.log_prior({**ABOUT})) == pytest.approx(stats.norm.logpdf(0.9, 0.85, 0.1))
    assert float(problem.log_prior({"level": -0.1, "rate": 0.1})) == -np.inf
    assert float(problem.log_prior({**ABOUT, "noise": -0.01})) == -np.inf


def test_noise_that_is_left_out_is_where_the_likelihood_is_largest():
    problem = cal.problem(decaying(), Decay)
    density = jax.jit(problem.log_likelihood)
    of_noise = lambda s: -float(density({**ABOUT, "noise": s}))  # noqa: E731
    best = minimize_scalar(of_noise, bounds=(1e-4, 1.0), method="bounded", options={"xatol": 1e-10})
    np.testing.assert_allclose(density(ABOUT), -best.fun, rtol=1e-9)
    np.testing.assert_allclose(problem.residuals(ABOUT), off(decaying()))


def test_a_parameter_that_is_left_out_is_named():
    problem = cal.problem(decaying(), Decay)
    for ask in (problem.log_likelihood, problem.residuals, problem.log_prior):
        with pytest.raises(ValueError, match=r"`theta` must be with level, rate, .* 'rate'"):
            ask({"level": 0.9, "rates": 0.1})


def test_times_of_bounces_enter_two_restitutions():
    """Each interval is in two points, and in their velocities: V by dense algebra from the factors."""
    count = len(V)
    index = np.stack([np.arange(count), np.arange(count) + 1, np.full(count, -1)], axis=1)
    to_eps = np.stack([-0.9 * np.ones(count), np.ones(count), np.zeros(count)], axis=1)
    to_v = np.stack([np.zeros(count), 2.0 * np.ones(count), np.zeros(count)], axis=1)
    curve = 0.92 * np.exp(-0.08 * V)
    alone = 0.01 * np.ones(count)
    errors = cal.PointErrors(index, to_eps, to_v, 0.004 * np.ones(count + 1), "times", alone)
    data = cal.RestitutionData(V, curve + 0.01 * np.cos(7 * V), errors=errors)
    problem = cal.problem(data, Decay)
    assert problem.noises == ()
    nodes, shares = np.polynomial.hermite_e.hermegauss(5)
    ends = 0.9 * np.exp(-0.1 * (V + 0.008 * nodes[:, None]))
    shares = shares / np.sum(shares)
    slope, mean = (shares * nodes) @ ends / 0.008, shares @ ends
    spread = np.zeros((count, count + 1))
    for k in range(2):
        spread[np.arange(count), index[:, k]] += to_eps[:, k] - slope * to_v[:, k]
    bend = shares @ (ends - mean) ** 2 - (0.008 * slope) ** 2
    covariance = 0.004**2 * spread @ spread.T + np.diag(alone**2 + bend)
    check_joint(problem, ABOUT, mean - data.restitution, covariance)


def check_joint(problem, theta, residual, covariance):
    """ln p, ln p of each point where the others are known, whitened residuals, simulated data."""
    count = len(residual)
    expected = stats.multivariate_normal.logpdf(residual, np.zeros(count), covariance)
    assert float(jax.jit(problem.log_likelihood)(theta)) == pytest.approx(expected, rel=1e-10)
    points = []
    for k in range(count):
        rest = np.arange(count) != k
        weights = np.linalg.solve(covariance[np.ix_(rest, rest)], covariance[rest, k])
        variance = covariance[k, k] - weights @ covariance[rest, k]
        points.append(stats.norm.logpdf(residual[k], weights @ residual[rest], variance**0.5))
    np.testing.assert_allclose(jax.jit(problem.point_log_likelihood)(theta), points, rtol=1e-8)
    squares = residual @ np.linalg.solve(covariance, residual)
    assert float(jnp.sum(jax.jit(problem.residuals)(theta) ** 2)) == pytest.approx(
        squares, rel=1e-10
    )
    curve = np.concatenate(problem.predict(theta))
    simulated = jax.jit(problem.simulated)
    root = np.stack([simulated(theta, one) - curve for one in np.eye(count)], axis=1)
    np.testing.assert_allclose(root @ root.T, covariance, atol=1e-14)


def test_simulated_measurements_take_the_place_of_the_measured_ones():
    data = decaying(uncertainty=0.02)
    problem = cal.problem(data, Decay)
    other = problem.simulated(ABOUT, np.linspace(-1, 1, len(V)))
    expected = np.sum(stats.norm.logpdf(np.linspace(-1, 1, len(V)) * 0.02, 0, 0.02))
    assert float(problem.log_likelihood(ABOUT, other)) == pytest.approx(expected, rel=1e-12)


def test_zhou_s_likelihood_is_the_normal_density_about_scipy_s_curve():
    name = "nylon"
    _, chi, sigma, psi, _ = TRUTH[name]
    data = twin(name, noise=0.01)
    problem = cal.problem(data)
    assert problem.names == ("chi", "sigma", "psi")
    assert problem.noises == ("noise",)
    theta = {"chi": 1.1 * chi, "sigma": 0.8 * sigma, "psi": psi, "noise": 0.013}
    curve = fit_oracle.curve(
        data.velocity, fit_oracle.numbers(data.contact), 1.1 * chi, 0.8 * sigma, psi
    )
    expected = stats.norm.logpdf(data.restitution, curve, 0.013)
    points, whole, residuals = (
        jax.jit(f)(theta)
        for f in (problem.point_log_likelihood, problem.log_likelihood, problem.residuals)
    )
    np.testing.assert_allclose(points, expected, rtol=1e-6)
    np.testing.assert_allclose(whole, np.sum(expected), rtol=1e-7)
    np.testing.assert_allclose(residuals, (curve - data.restitution) / 0.013, atol=1e-6)


@pytest.mark.long
def test_several_laws_side_by_side_and_time_integration():
    """Reverse mode through the ODE of a viscoelastic contact; two data sets that share A."""
    sets = []
    for name in ("nylon", "chrome steel"):
        data = twin(name, y=[0.2, 0.5, 0.9])
        sets.append(cal.RestitutionData(data.velocity, [0.9, 0.88, 0.87], data.contact, name=name))
    problem = cal.problem(
        sets, sj.ViscoelasticHertz, {"dissipation_time": cal.Parameter(shared=True)}
    )
    (name,) = problem.names
    density = lambda log: problem.log_likelihood({name: jnp.exp(log)})  # noqa: E731
    at = np.log(3e-6)
    ends = [float(density(at + h)) for h in (-1e-4, 1e-4)]
    assert float(jax.grad(density)(at)) == pytest.approx((ends[1] - ends[0]) / 2e-4, rel=1e-4)
