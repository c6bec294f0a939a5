"""ln L of a fit is the Gaussian density at its estimates, as `cal.problem` and SciPy have it."""

import numpy as np
import pytest
from scipy import optimize, stats

import calibration as cal
from tests.decay import Decay

V = np.linspace(0.5, 8.0, 24)
STATED = np.linspace(0.5, 1.5, 24) * 0.004
DAYS = [f"day {k}" for k in np.arange(24) // 4]


def measured(factor=1.0, extra=0.0, seed=2, **told):
    """Errors of so many times the stated ones, some scatter beside them, and an offset a day."""
    random = np.random.default_rng(seed)
    v = V
    if "velocity_uncertainty" in told:
        v = V + factor * told["velocity_uncertainty"] * random.standard_normal(24)
    e = 0.92 * np.exp(-0.09 * V) + np.hypot(factor * STATED, extra) * random.standard_normal(24)
    if "group" in told:
        e = e + 0.01 * np.repeat(random.standard_normal(6), 4)
    return cal.RestitutionData(v, e, **told)


CASES = {
    "scatter": (measured(1.0, 0.006, uncertainty=STATED), {"extra_scatter": True}),
    "none left": (measured(0.3, uncertainty=STATED), {"extra_scatter": True}),
    "scale": (measured(2.0, uncertainty=STATED), {"scale_uncertainty": True}),
    "velocities": (measured(velocity_uncertainty=0.1 * V, uncertainty=STATED), {}),
    "overstated velocities": (measured(0.3, velocity_uncertainty=0.1 * V), {}),
    "bare velocities": (measured(velocity_uncertainty=0.02 * V), {}),
    "velocities and days": (measured(velocity_uncertainty=0.02 * V, group=DAYS), {}),
}


def dense(data, theta, noise):
    """ln of the multivariate normal density, velocities carried into ε by the curve's slope."""
    curve = theta["level"] * np.exp(-theta["rate"] * data.velocity)
    stated = 0 if data.uncertainty is None else data.uncertainty
    variance = (noise.get("scale", 1.0) * stated) ** 2 + noise.get("noise", 0.0) ** 2
    if data.velocity_uncertainty is not None:
        variance = variance + (theta["rate"] * curve * data.velocity_uncertainty) ** 2
    covariance = np.diag(np.broadcast_to(variance, 24))
    if "group" in noise:
        index = np.asarray(data.group_index)
        covariance = covariance + noise["group"] ** 2 * (index[:, None] == index)
    return stats.multivariate_normal.logpdf(data.restitution, curve, covariance)


@pytest.mark.parametrize("case", CASES)
def test_ln_l_is_the_density_at_the_estimates(case):
    """What is unknown of the noise at its maximum, which may be none at all."""
    data, asked = CASES[case]
    result = cal.fit(data, Decay, profiles=False, **asked)
    problem = cal.problem(data, Decay, **asked)
    theta = {name: result.values[name] for name in problem.names}

    def noise_at(x):
        return dict(zip(problem.noises, np.abs(x), strict=True))

    def density(x):
        return -dense(data, theta, noise_at(x))

    best = np.full(len(problem.noises), 0.5 if "scale" in problem.noises else 0.003)
    if len(best):
        options = {"xatol": 1e-9, "fatol": 1e-13, "maxiter": 2000}
        best = optimize.minimize(density, best, method="Nelder-Mead", options=options).x
        if case in ("none left", "overstated velocities"):
            assert abs(best[0]) < 1e-6
            best = np.zeros(1)
    assert result.log_likelihood == pytest.approx(-density(best), abs=1e-8)
    traced = float(problem.log_likelihood(theta | noise_at(best)))
    assert result.log_likelihood == pytest.approx(traced, rel=1e-10)
    fitted = len(theta) + len(best)
    assert result.aic == pytest.approx(2 * fitted - 2 * traced, rel=1e-10)
    assert result.bic == pytest.approx(fitted * np.log(24) - 2 * traced, rel=1e-10)
