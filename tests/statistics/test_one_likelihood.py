"""Fit, problem and leave-one-out are one likelihood: that of dense algebra, and refits by SciPy."""

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


def bounces(size, by_time=0.0, timed=TIMED, **options):
    """Trains: each interval is in two points, and in their velocities; stated or unknown."""
    alone = None if size is None else STATED
    uncertainty = None if size is None else np.full(np.max(timed) + 1, size)
    to_v = by_time * (np.arange(3) == 1) * np.ones((N, 1))
    errors = cal.PointErrors(timed, TO_EPS, to_v, uncertainty, "times", alone)
    return measured(errors=errors, **options)


BY_TIME = 2.0  # δv of a time [m/s²]
DAY = [f"day {k}" for k in DAYS]
MOVED = {"velocity_uncertainty": 0.06 * V}
U = {"uncertainty": STATED}
T = {"noise": "student-t"}
EXTRA, SCALE = {"extra_scatter": True}, {"scale_uncertainty": True}
# a train a day
DAILY = np.stack([np.arange(N) + DAYS, np.arange(N) + DAYS + 1, np.full(N, -1)], axis=1)
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
    # what else may go together
    "velocities, extra": (measured(**U, **MOVED), EXTRA),
    "groups, scale": (measured(group=DAY, **U), SCALE),
    "groups, velocities, unknown": (measured(group=DAY, **MOVED), {}),
    "groups, velocities, extra": (measured(group=DAY, **U, **MOVED), EXTRA),
    "groups, velocities, scale": (measured(group=DAY, **U, **MOVED), SCALE),
    "bounces, scale": (bounces(0.004), SCALE),
    "bounces, times unknown, extra": (bounces(None), EXTRA),
    "bounces, groups": (bounces(0.004, timed=DAILY, group=DAY), {}),
    "bounces, groups, extra": (bounces(0.004, timed=DAILY, group=DAY), EXTRA),
    "bounces, groups, scale": (bounces(0.004, BY_TIME, DAILY, group=DAY), SCALE),
    "bounces, times unknown, groups": (bounces(None, timed=DAILY, group=DAY), EXTRA),
    "student-t, velocities, unknown": (measured(tails=True, **MOVED), T),
    "student-t, velocities, extra": (measured(tails=True, **U, **MOVED), T | EXTRA),
    "student-t, velocities, scale": (measured(tails=True, **U, **MOVED), T | SCALE),
}


FITTED = [
    "unknown",
    "extra",
    "velocities",
    "velocities, scale",
    "groups, stated",
    "bounces, times unknown",
    "student-t, extra",
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
    if "times unknown" not in case and data.uncertainty is not None:
        variance = variance + STATED**2
    covariance = np.diag(variance)
    if "bounces" in case:
        size = theta.get("timing", None if data.errors.size is None else data.errors.size[0])
        index = data.errors.index
        spread = np.zeros((N, np.max(index) + 1))
        for k in range(2):
            to = TO_EPS[:, k] - slope * data.errors.to_velocity[:, k]
            spread[np.arange(N), index[:, k]] += to * size
        covariance = covariance + spread @ spread.T
    covariance = covariance * theta.get("scale", 1.0) ** 2 + np.eye(N) * theta.get("noise", 0) ** 2
    return mean, covariance + theta.get("group", 0.0) ** 2 * (DAYS[:, None] == DAYS)


def densities(case, theta):
    """ln p, and ln p of each point where the others are known."""
    data, options = CASES[case]
    mean, covariance = dense(case, theta)
    off = data.restitution - mean
    if options.get("noise") == "student-t":
        dof = options.get("noise_dof", 4)
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
    noises = {"noise": 0.006, "scale": 1.3, "timing": 0.004, "group": 0.008}
    for level, rate, factor in ((0.9, 0.1, 1.0), (0.97, 0.05, 2.0), (0.7, 0.2, 0.5)):
        theta = {"level": level, "rate": rate}
        theta |= {name: factor * noises[name] for name in problem.noises}
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
        return -densities(case, theta)[0]

    start = {"noise": 0.005, "scale": 1.5, "timing": 0.004, "group": 0.008}
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


QUICK = {"profiles": False, "starts": 1}
SHARED = {name: cal.Parameter(shared=True) for name in ("level", "rate")}
TRUTH = (0.92, 0.09)
NOISE = 0.004


def slope(v, level, rate):
    return -rate * curve(v, level, rate)


def gradient(v, level, rate):
    return np.stack([np.exp(-rate * v), -v * curve(v, level, rate)], axis=-1)


def imprecise(overstated=1.0, count=40, seed=3, share=0.1, **options):
    """Velocities with errors of some share of them, stated as so many times what they are."""
    random = np.random.default_rng(seed)
    v = np.linspace(0.5, 8.0, count)
    e = curve(v, *TRUTH) + NOISE * random.standard_normal(count)
    measured = v + share * v / overstated * random.standard_normal(count)
    return cal.RestitutionData(measured, e, velocity_uncertainty=share * v, **options)


def errors_of_velocity(data):
    """Of each measured velocity, along a power of these; and the power."""
    line = np.polyfit(np.log(data.velocity), np.log(data.velocity_uncertainty), 1)
    return np.exp(np.polyval(line, np.log(data.velocity))), line[0]


def expected_at(data, level, rate):
    """ε where the true velocities are expected: ln v normal, errors along a power of v."""
    v, (of_v, power) = data.velocity, errors_of_velocity(data)
    share = of_v / v
    of_true = np.var(np.log(v), ddof=1) - np.mean(share**2)
    towards = np.mean(np.log(v)) - np.log(v) + (2 * power - 1) * of_true
    off = v * towards * share**2 / (of_true + share**2)
    bend = 0.5 * rate**2 * of_v**2 * curve(v, level, rate)
    return curve(v, level, rate) + bend + slope(v, level, rate) * off


def without(data, k):
    """θ of the likelihood of all points but one, its covariance, and the variance of every point."""
    v, e, of_v = data.velocity, data.restitution, errors_of_velocity(data)[0]
    kept = np.arange(len(v)) != k

    def cost(theta):
        variance = NOISE**2 + (slope(v, *theta) * of_v) ** 2
        return 0.5 * np.sum(
            ((expected_at(data, *theta) - e) ** 2 / variance + np.log(variance))[kept]
        )

    options = {"xatol": 1e-8, "fatol": 1e-10}
    theta = optimize.minimize(cost, TRUTH, method="Nelder-Mead", options=options).x
    variance = NOISE**2 + (slope(v, *theta) * of_v) ** 2
    rows = gradient(v, *theta)[kept]
    return theta, np.linalg.inv((rows / variance[kept, None]).T @ rows), variance


def test_a_velocity_with_an_error_is_not_corrected_by_the_point_left_out():
    """Refits by SciPy; the corrected velocity of a point knows its ε: elpd 115.3 and rms 0.0021."""
    data = imprecise(3.0, uncertainty=NOISE)
    left = cal.fit(data, Decay, **QUICK).leave_one_out()
    expected, predicted = [], []
    for k in range(len(data)):
        theta, covariance, variance = without(data, k)
        row = gradient(data.velocity[k], *theta)
        middle = expected_at(data, *theta)[k]
        spread = np.sqrt(variance[k] + row @ covariance @ row)
        expected.append(stats.norm.logpdf(data.restitution[k], middle, spread))
        predicted.append(middle)
    assert left.elpd == pytest.approx(np.sum(expected), abs=0.3)
    rms = np.sqrt(np.mean((predicted - data.restitution) ** 2))
    assert left.rms == pytest.approx(rms, rel=0.04)
    np.testing.assert_allclose(left.predicted, predicted, atol=0.005)


def joint(seed=0):
    """A, whose stated uncertainties are too small by 2.5, and B, of which nothing is stated."""
    random = np.random.default_rng(seed)
    v, w = np.linspace(0.5, 6, 14), np.linspace(0.4, 7, 30)
    u = np.linspace(0.02, 0.04, 14)
    one = curve(v, *TRUTH) + 2.5 * u * random.standard_normal(14)
    other = curve(w, *TRUTH) + 0.003 * random.standard_normal(30)
    return [
        cal.RestitutionData(v, one, uncertainty=u, name="A"),
        cal.RestitutionData(w, other, name="B"),
    ]


def density_in_joint(sets, k):
    """ln p of a point by weighted least squares to all others, B's noise from B's other points."""
    v = np.concatenate([data.velocity for data in sets])
    e = np.concatenate([data.restitution for data in sets])
    of_b, kept, noise = np.arange(44) >= 14, np.arange(44) != k, 0.003
    for _ in range(6):
        u = np.concatenate([sets[0].uncertainty, np.full(30, noise)])
        off = lambda theta, u=u: ((curve(v, *theta) - e) / u)[kept]  # noqa: E731
        theta = optimize.least_squares(off, TRUTH, xtol=1e-15, ftol=1e-15, gtol=1e-15).x
        rows = gradient(v, *theta) / u[:, None]
        covariance = np.linalg.inv(rows[kept].T @ rows[kept])
        leverage = np.einsum("np,pq,nq->n", rows, covariance, rows)
        degrees = np.sum((1 - leverage)[of_b & kept])
        noise = np.sqrt(np.sum((curve(v, *theta) - e)[of_b & kept] ** 2) / degrees)
    spread = u[k] * np.sqrt(1 + leverage[k])
    law = stats.t(degrees, 0, spread) if of_b[k] else stats.norm(0, spread)
    return law.logpdf(e[k] - curve(v[k], *theta))


def test_each_set_of_a_joint_fit_has_its_own_noise():
    """Stated uncertainties stay what they are beside a set without: one factor for both gave 13.6."""
    sets = joint()
    left = cal.fit(sets, Decay, SHARED, **QUICK).leave_one_out()
    expected = np.array([density_in_joint(sets, k) for k in (*range(14), 20, 43)])
    np.testing.assert_allclose(left.log_density[:14], expected[:14], atol=1e-4)
    np.testing.assert_allclose(left.log_density[[20, 43]], expected[14:], atol=0.02)
    assert np.sum(left.log_density[:14]) < 1.0
    assert left.in_folds is None


def test_scatters_of_sets_that_share_a_parameter_are_those_of_the_restricted_likelihood():
    """ε = a x: each set pays for its share of a alone, not for all of it; by NumPy, a at its best for each pair."""
    random, truth = np.random.default_rng(8), (0.9, 0.05)
    speeds, noise = (np.linspace(1, 5, 4), np.linspace(1, 8, 15)), (0.01, 0.02)
    values = [
        curve(v, *truth) + s * random.standard_normal(len(v))
        for v, s in zip(speeds, noise, strict=True)
    ]
    sets = [cal.RestitutionData(*x, name=n) for *x, n in zip(speeds, values, "ab", strict=True)]
    parameters = {"level": cal.Parameter(shared=True), "rate": truth[1]}
    fit = cal.fit(sets, Decay, parameters, **QUICK)
    shapes = [curve(v, 1.0, truth[1]) for v in speeds]

    def restricted(logs):
        s, pairs = np.exp(logs), [*zip(shapes, values, strict=True)]
        known = sum(x @ x / u for (x, _), u in zip(pairs, s, strict=True))
        a = sum(x @ e / u for (x, e), u in zip(pairs, s, strict=True)) / known
        parts = (
            len(e) * np.log(u) + np.sum((e - a * x) ** 2) / u
            for (x, e), u in zip(pairs, s, strict=True)
        )
        return sum(parts) + np.log(known)

    tight = {"xatol": 1e-10, "fatol": 1e-12}
    best = optimize.minimize(restricted, [-9.0, -8.0], method="Nelder-Mead", options=tight)
    found = [material.variances["scatter"] for material in fit.materials]
    np.testing.assert_allclose(found, np.exp(best.x), rtol=1e-4)


def test_many_points_are_left_out_in_twenty_folds_by_the_same_density():
    """Above 400 points: against the fit without the fold of a point, and its noise."""
    data = imprecise(count=1100, seed=7)
    of_v = errors_of_velocity(data)[0]

    def fitted(kept):
        some = {"velocity_uncertainty": data.velocity_uncertainty[kept]}
        points = cal.RestitutionData(data.velocity[kept], data.restitution[kept], **some)
        return cal.fit(points, Decay, **QUICK)

    left = fitted(np.arange(1100)).leave_one_out()
    assert left.in_folds == 20
    assert np.bincount(left.fold).tolist() == [55] * 20
    for k in (0, 1099):
        kept = left.fold != left.fold[k]
        theta = (values := fitted(kept).values)["level"], values["rate"]
        # errors of velocities enter by more than the slope; a scatter by Paule and Mandel
        predicted = expected_at(data, *theta)
        known = (slope(data.velocity, *theta) * of_v) ** 2
        known = known + 0.5 * (theta[1] ** 2 * curve(data.velocity, *theta) * of_v**2) ** 2
        squares = (predicted - data.restitution)[kept] ** 2
        excess = lambda s: np.sum(squares / (s + known[kept])) - len(squares) + 2  # noqa: B023, E731
        variance = known + optimize.brentq(excess, 1e-9, 1e-2, xtol=1e-16)
        expected = stats.norm.logpdf(data.restitution[k], predicted[k], np.sqrt(variance[k]))
        assert left.log_density[k] == pytest.approx(expected, abs=0.1)


@pytest.mark.parametrize("prior", [None, (0.89, 3e-4)])
def test_many_points_of_a_linear_law_are_left_out_exactly(prior):
    """ε = a x by sums over all points but those of a fold; with a factor of the errors Student's t of as many degrees."""
    data, u = imprecise(count=1100), np.linspace(0.5, 1.5, 1100) * NOISE
    x, e = np.exp(-0.09 * data.velocity), data.restitution
    points = cal.RestitutionData(data.velocity, e, uncertainty=u)
    parameters = {"rate": 0.09, "level": cal.Parameter(0.9, prior=prior)}
    fit = cal.fit(points, Decay, parameters, scale_uncertainty=prior is None, **QUICK)
    left = fit.leave_one_out()
    others = lambda terms: np.sum(terms) - np.bincount(left.fold, terms)[left.fold]  # noqa: E731
    mean, weight = (0, 0) if prior is None else (prior[0], prior[1] ** -2)
    information = others((x / u) ** 2) + weight
    level = (others(x * e / u**2) + mean * weight) / information
    squares = (others((e / u) ** 2) - level**2 * information) / 1044 if prior is None else 1
    spread = np.sqrt(squares * (u**2 + x**2 / information))
    np.testing.assert_allclose(left.predicted, level * x, rtol=1e-9)
    family = stats.t(1044) if prior is None else stats.norm
    expected = family.logpdf((e - level * x) / spread) - np.log(spread)
    np.testing.assert_allclose(left.log_density, expected, rtol=0, atol=1e-6)


def test_days_stay_together_in_folds_and_count_as_one_each():
    """105 days of 4 points: a day's points share a fold, are predicted together, and the error is over days."""
    random, day = np.random.default_rng(2), np.arange(420) % 105
    v = np.geomspace(0.5, 8.0, 420)
    e = curve(v, 0.9, 0.09) + 0.01 * random.standard_normal(105)[day]
    e = e + 0.004 * random.standard_normal(420)
    data = cal.RestitutionData(v, e, group=[f"day {k}" for k in day])
    left = cal.fit(data, Decay, **QUICK).leave_one_out()
    assert left.in_folds == 20
    assert all(len({*left.fold[day == k]}) == len({*left.unit[day == k]}) == 1 for k in range(105))
    assert {*np.bincount(left.fold).tolist()} == {20, 24}
    sums = np.bincount(day, left.log_density)
    assert left.elpd_se == pytest.approx(np.std(sums, ddof=1) * 105**0.5)
    # one density of a day: the offset that its four points share is no error of each
    apart = stats.norm.logpdf(left.residual, 0, np.hypot(0.01, 0.004))
    assert left.elpd > np.sum(apart) + 200


def test_a_day_left_out_does_not_correct_its_velocities():
    """Against the fit to the other days, where velocities are expected without their ε."""
    data = imprecise(count=24)
    days = np.arange(24) % 6
    restitution = data.restitution + 0.01 * np.array([1.0, -1.2, 0.3, 0.8, -0.9, 0.0])[days]

    def of(kept):
        return cal.RestitutionData(
            data.velocity[kept],
            restitution[kept],
            velocity_uncertainty=data.velocity_uncertainty[kept],
            group=[f"day {k}" for k in days[kept]],
        )

    left = cal.fit(of(days >= 0), Decay, **QUICK).leave_one_out()
    for day in (0, 3):
        other = cal.fit(of(days != day), Decay, **QUICK)
        expected = expected_at(data, other.values["level"], other.values["rate"])[days == day]
        np.testing.assert_allclose(left.predicted[days == day], expected, atol=0.005)
