"""Each point predicted by the fit to all others, against refits and densities by SciPy alone."""

import numpy as np
import pytest
from scipy import optimize, stats

import calibration as cal
from tests.decay import Decay
from tests.decay import decay as curve

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
    assert left.exact


@pytest.mark.parametrize("stated", [False, True])
def test_many_points_are_left_out_to_first_order_by_the_same_density(stated):
    """Beyond 1000 points nothing is refitted: against the fit of all but one, and its noise."""
    data = imprecise(count=1100, seed=7)
    u, of_v = np.linspace(0.5, 1.5, 1100) * NOISE, errors_of_velocity(data)[0]

    def fitted(kept):
        errors = {"uncertainty": u, "velocity_uncertainty": data.velocity_uncertainty}
        name = "uncertainty" if stated else "velocity_uncertainty"
        some = {name: errors[name][kept]}
        points = cal.RestitutionData(data.velocity[kept], data.restitution[kept], **some)
        return cal.fit(points, Decay, scale_uncertainty=stated, **QUICK)

    whole = fitted(np.arange(1100))
    left = whole.leave_one_out()
    assert not left.exact
    for k in (0, 300, 1099):
        kept = np.arange(1100) != k
        other = fitted(kept)
        theta = other.values["level"], other.values["rate"]
        at = curve(data.velocity, *theta)
        if stated:  # scaled by reduced χ²
            moved = whole.band(data.velocity[k]).coefficient - at[k]
            assert abs(left.predicted[k] - at[k]) < 0.25 * abs(moved)
            predicted, known, near = at, u**2, 0.02
            squares = (at - data.restitution)[kept] ** 2
            variance = known * np.sum(squares / known[kept]) / (len(squares) - 2)
        else:  # errors of velocities enter by more than the slope; a scatter by Paule and Mandel
            predicted, near = expected_at(data, *theta), 0.1
            known = (slope(data.velocity, *theta) * of_v) ** 2
            known = known + 0.5 * (theta[1] ** 2 * at * of_v**2) ** 2
            squares = (predicted - data.restitution)[kept] ** 2
            excess = lambda s: np.sum(squares / (s + known[kept])) - len(squares) + 2  # noqa: B023, E731
            variance = known + optimize.brentq(excess, 1e-9, 1e-2, xtol=1e-16)
        expected = stats.norm.logpdf(data.restitution[k], predicted[k], np.sqrt(variance[k]))
        assert left.log_density[k] == pytest.approx(expected, abs=near)


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
