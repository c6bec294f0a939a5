"""Fit, problem and leave-one-out are one likelihood: that of dense algebra, for every sort of noise."""

import jax
import numpy as np
import pytest
from scipy import optimize, stats

import calibration as cal
from tests.decay import Decay
from tests.decay import decay as curve

N = 20
V = np.linspace(0.5, 8.0, N)
STATED = np.linspace(0.5, 1.5, N) * 0.004
DAYS = np.repeat(np.arange(5), 4)
# five points of Gauss and Hermite, for a standard normal weight
NODES, WEIGHTS = np.polynomial.hermite_e.hermegauss(5)
SHARES = WEIGHTS / np.sum(WEIGHTS)
TIMED = np.stack([np.arange(N), np.arange(N) + 1, np.full(N, -1)], axis=1)
TO_EPS = np.stack([-0.9 * np.ones(N), np.ones(N), np.zeros(N)], axis=1)


def measured(seed=2, tails=False, **options):
    random = np.random.default_rng(seed)
    errors = stats.t.rvs(3, size=N, random_state=random) if tails else random.standard_normal(N)
    e = curve(V, 0.92, 0.09) + 0.006 * errors
    if "group" in options:
        e = e + 0.01 * random.standard_normal(5)[DAYS]
    return cal.RestitutionData(V, e, **options)


def bounces(size, by_time=0.0):
    """A train: each interval is in two points, and in their velocities; stated or unknown."""
    alone = None if size is None else STATED
    uncertainty = None if size is None else np.full(N + 1, size)
    to_v = by_time * (np.arange(3) == 1) * np.ones((N, 1))
    return measured(errors=cal.PointErrors(TIMED, TO_EPS, to_v, uncertainty, "times", alone))


BY_TIME = 2.0  # δv of a time [m/s²]
DAY = [f"day {k}" for k in DAYS]
MOVED = {"velocity_uncertainty": 0.06 * V}
U = {"uncertainty": STATED}
T = {"noise": "student-t"}
CASES = {
    "stated": (measured(**U), {}),
    "unknown": (measured(), {}),
    "extra": (measured(**U), {"extra_scatter": True}),
    "scale": (measured(**U), {"scale_uncertainty": True}),
    "velocities": (measured(**U, **MOVED), {}),
    "velocities, unknown": (measured(**MOVED), {}),
    "velocities, scale": (measured(**U, **MOVED), {"scale_uncertainty": True}),
    "groups": (measured(group=DAY), {}),
    "groups, stated": (measured(group=DAY, **U), {}),
    "groups, extra": (measured(group=DAY, **U), {"extra_scatter": True}),
    "groups, velocities": (measured(group=DAY, **U, **MOVED), {}),
    "bounces": (bounces(0.004), {}),
    "bounces, velocities": (bounces(0.004, BY_TIME), {}),
    "bounces, extra": (bounces(0.002), {"extra_scatter": True}),
    "bounces, times unknown": (bounces(None), {}),
    "student-t": (measured(tails=True, **U), T | {"noise_dof": 3}),
    "student-t, unknown": (measured(tails=True), T),
    "student-t, extra": (measured(tails=True, **U), T | {"extra_scatter": True}),
    "student-t, scale": (measured(tails=True, **U), T | {"scale_uncertainty": True}),
    "student-t, velocities": (measured(tails=True, **U, **MOVED), T),
    "student-t, dof": (measured(tails=True), T | {"noise_dof": "estimate"}),
}


FITTED = [
    "unknown",
    "extra",
    "velocities",
    "velocities, scale",
    "groups, stated",
    "bounces, times unknown",
    "student-t, extra",
    "student-t, dof",
]


def dense(case, theta):
    """The mean of the points, and their covariance."""
    data, _ = CASES[case]
    level, rate = theta["level"], theta["rate"]
    mean, slope, variance = curve(V, level, rate), np.zeros(N), np.zeros(N)
    if data.velocity_uncertainty is not None:  # by quadrature; slopes are means over it too
        u = data.velocity_uncertainty
        ends = curve(V + NODES[:, None] * u, level, rate)
        mean, slope = SHARES @ ends, SHARES @ (NODES[:, None] * ends) / u
        variance = SHARES @ (ends - mean) ** 2
        if "bounces" in case:
            variance = variance - (u * slope) ** 2
        else:
            mean = mean + slope * nearer_the_middle(u)
    if case != "bounces, times unknown" and data.uncertainty is not None:
        variance = variance + STATED**2
    covariance = np.diag(variance)
    if "bounces" in case:
        size = theta.get("timing", None if data.errors.size is None else data.errors.size[0])
        spread = np.zeros((N, N + 1))
        for k in range(2):
            to = TO_EPS[:, k] - slope * data.errors.to_velocity[:, k]
            spread[np.arange(N), TIMED[:, k]] += to * size
        covariance = covariance + spread @ spread.T
    covariance = covariance * theta.get("scale", 1.0) ** 2 + np.eye(N) * theta.get("noise", 0) ** 2
    return mean, covariance + theta.get("group", 0.0) ** 2 * (DAYS[:, None] == DAYS)


def densities(case, theta):
    """ln p, and ln p of each point where the others are known."""
    data, options = CASES[case]
    mean, covariance = dense(case, theta)
    off = data.restitution - mean
    if options.get("noise") == "student-t":
        dof = theta.get("dof", options.get("noise_dof", 4))
        points = stats.t.logpdf(off, dof, 0, np.sqrt(np.diag(covariance)))
        return np.sum(points), points
    inverse = np.linalg.inv(covariance)
    whole = np.linalg.slogdet(covariance)[1] + N * np.log(2 * np.pi) + off @ inverse @ off
    deviation = np.diag(inverse) ** -0.5
    return -0.5 * whole, stats.norm.logpdf(inverse @ off * deviation**2, 0, deviation)


def nearer_the_middle(u):
    """What the true velocities are expected to be off by: normal ln v, errors in proportion to v."""
    place, square = np.log(V), (u / V) ** 2
    of_true = place.var(ddof=1) - square.mean()
    return V * (place.mean() - place + of_true) * square / (square + of_true)


@pytest.mark.parametrize("case", CASES)
def test_a_problem_is_the_dense_density_wherever_it_is_asked(case):
    data, options = CASES[case]
    problem = cal.problem(data, Decay, **options)
    noises = {"noise": 0.006, "scale": 1.3, "timing": 0.004, "group": 0.008, "dof": 5.0}
    for level, rate, factor in ((0.9, 0.1, 1.0), (0.97, 0.05, 2.0), (0.7, 0.2, 0.5)):
        theta = {"level": level, "rate": rate}
        theta |= {name: factor * noises[name] for name in problem.noises}
        theta |= {"dof": 2.0 + 3 * factor} if "dof" in theta else {}
        whole, points = densities(case, theta)
        assert float(problem.log_likelihood(theta)) == pytest.approx(whole, rel=1e-10)
        found = problem.point_log_likelihood(theta)
        np.testing.assert_allclose(found, points, rtol=1e-8, atol=1e-8)
    if options.get("noise") == "student-t":
        return
    mean, covariance = dense(case, theta)  # residuals are whitened; simulations have V
    off = mean - data.restitution
    squares = float(np.sum(np.asarray(problem.residuals(theta)) ** 2))
    assert squares == pytest.approx(off @ np.linalg.solve(covariance, off), rel=1e-9)
    draws = jax.jit(jax.vmap(lambda one: problem.simulated(theta, one)))(np.eye(N))
    root = np.asarray(draws).T - np.concatenate(problem.predict(theta))[:, None]
    np.testing.assert_allclose(root @ root.T, covariance, atol=1e-14)


@pytest.mark.parametrize("case", FITTED)
def test_a_fit_has_its_largest_value_and_leaves_points_out_by_the_same(case):
    """ln L over parameters and noise by SciPy; the terms of each point at the fit itself."""
    data, settings = CASES[case]
    result = cal.fit(data, Decay, profiles=False, starts=4, **settings)
    problem = cal.problem(data, Decay, **settings)
    names = ["level", "rate", *problem.noises]

    def cost(x):
        theta = dict(zip(names, np.exp(x), strict=True))
        if "dof" in theta and not 2 <= theta["dof"] <= 30:
            return np.inf
        return -densities(case, theta)[0]

    start = {"noise": 0.005, "scale": 1.5, "timing": 0.004, "group": 0.008, "dof": 4.0}
    begin = np.log([0.92, 0.09, *(start[name] for name in problem.noises)])
    options = {"xatol": 1e-9, "fatol": 1e-12, "maxiter": 8000, "maxfev": 8000}
    best = optimize.minimize(cost, begin, method="Nelder-Mead", options=options)
    best = optimize.minimize(cost, best.x, method="Nelder-Mead", options=options)
    assert result.log_likelihood == pytest.approx(-best.fun, abs=2e-6)
    fitted = len(names)
    assert result.aic == pytest.approx(2 * fitted - 2 * result.log_likelihood)
    assert result.bic == pytest.approx(fitted * np.log(N) - 2 * result.log_likelihood)
    material = result.materials[0]
    theta = {name: result.values[name] for name in ("level", "rate")}
    for kind, name in (("scatter", "noise"), ("group", "group")):
        if name in problem.noises:
            theta[name] = material.variances.get(kind, 0.0) ** 0.5
    theta |= {"timing": material.timing} if "timing" in problem.noises else {}
    theta |= {"dof": material.noise_dof} if "dof" in problem.noises else {}
    if "scale" in problem.noises:
        ratio = material.variances["scale"] / float(np.mean(unscaled(data, theta)))
        theta["scale"] = ratio**0.5
    found = result.leave_one_out().pointwise
    np.testing.assert_allclose(found, densities(case, theta)[1], rtol=1e-8, atol=1e-8)


def unscaled(data, theta):
    """Variances of ε as stated, those of the velocities included."""
    if data.velocity_uncertainty is None:
        return STATED**2
    u = data.velocity_uncertainty
    ends = curve(V + NODES[:, None] * u, theta["level"], theta["rate"])
    return STATED**2 + SHARES @ (ends - SHARES @ ends) ** 2


# the functions of a problem, with an unknown noise; and for JAX

ABOUT = {"level": 0.9, "rate": 0.1}


def test_slopes_and_the_noise_left_out_are_those_of_differences():
    """Reverse mode through noise and prior too; a noise left out is where the likelihood is largest."""
    data = measured()
    problem = cal.problem(data, Decay, {"level": cal.Parameter(prior=(0.85, 0.1))})
    names = (*problem.names, "noise")

    @jax.jit
    def density(x):
        theta = dict(zip(names, x, strict=True))
        return problem.log_likelihood(theta) + problem.log_prior(theta)

    at = np.array([0.9, 0.1, 0.03])
    expected = optimize.approx_fprime(at, lambda x: float(density(x)), 1e-7)
    np.testing.assert_allclose(jax.grad(density)(at), expected, rtol=1e-4)
    for theta, prior in (
        (ABOUT, stats.norm.logpdf(0.9, 0.85, 0.1)),
        (ABOUT | {"level": -0.1}, -np.inf),
        (ABOUT | {"noise": -0.01}, -np.inf),
    ):
        assert float(problem.log_prior(theta)) == pytest.approx(prior)
    prior = stats.norm.logpdf(0.9, 0.85, 0.1)
    of_noise = lambda s: prior - float(density(np.array([0.9, 0.1, s])))  # noqa: E731
    ends = {"bounds": (1e-4, 1.0), "method": "bounded", "options": {"xatol": 1e-10}}
    best = optimize.minimize_scalar(of_noise, **ends)
    np.testing.assert_allclose(problem.log_likelihood(ABOUT), -best.fun, rtol=1e-9)
    off = curve(V, 0.9, 0.1) - data.restitution
    np.testing.assert_allclose(problem.residuals(ABOUT)[:N], off)
    for ask in (problem.log_likelihood, problem.residuals, problem.log_prior):
        with pytest.raises(ValueError, match=r"`theta` must be with level, rate, .* 'rate'"):
            ask({"level": 0.9, "rates": 0.1})


def test_simulated_measurements_take_the_place_of_the_measured_ones():
    problem, errors = cal.problem(*CASES["stated"][:1], Decay), np.linspace(-1, 1, N)
    expected = np.sum(stats.norm.logpdf(errors * STATED, 0, STATED))
    found = problem.log_likelihood(ABOUT, problem.simulated(ABOUT, errors))
    assert float(found) == pytest.approx(expected, rel=1e-12)
