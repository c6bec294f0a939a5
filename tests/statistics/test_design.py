"""Designs against closed forms, brute force, and simulated calibrations."""

import math

import numpy as np
import pytest
from scipy import optimize

import calibration as cal
import softjax as sj
from tests.cases import fitted
from tests.decay import Decay
from tests.statistics.test_information import QUICK, decays
from tests.statistics.test_information import rows as slopes_of

DECAY = Decay(0.95, 0.05)
BOUNDS = (1.0, 60.0)
NOISE = 0.003
LAW = fitted("nylon")
CRITICAL = float(LAW.contact.critical_velocity)


def rows(v, level=0.95, rate=0.05):
    return slopes_of(v, level, rate)


def covariance(v, noise=0.01, **law):
    slopes = rows(v, **law) / noise
    return np.linalg.inv(slopes.T @ slopes)


CURVE = rows(np.linspace(*BOUNDS, 4001))
VARIANCES = {
    "c": lambda c: c[1, 1],
    "D": lambda c: math.sqrt(np.linalg.det(c)),
    "A": lambda c: 0.5 * np.trace(c),
    "I": lambda c: float(np.mean(np.einsum("ki,ij,kj->k", CURVE, c, CURVE))),
}


def brute_force(criterion: str, count: int) -> float:
    """The least variance of designs at two velocities, which two parameters need, however split."""
    found = []
    for first in range(1, count):

        def variance(pair, first=first):
            v = np.repeat(pair, [first, count - first])
            return math.log(VARIANCES[criterion](covariance(v)))

        spread = np.linspace(*BOUNDS, 13)
        pairs = [(a, b) for a in spread for b in spread if b > a]
        start = min(pairs, key=variance)
        inside = {"method": "Nelder-Mead", "bounds": [BOUNDS] * 2, "options": {"xatol": 1e-8}}
        found.append(optimize.minimize(variance, start, **inside).fun)
    return min(found)


@pytest.mark.parametrize("criterion", VARIANCES)
def test_each_criterion_is_as_small_as_a_brute_force_search_makes_it(criterion):
    """And no random design is better than the bound on the efficiency says."""
    aim, variance = {"target": "rate"} if criterion == "c" else {}, VARIANCES[criterion]
    found = cal.optimal_velocities(DECAY, 5, BOUNDS, criterion=criterion, starts=4, **aim)
    reached = math.log(variance(covariance(found.velocity)))
    assert reached == pytest.approx(brute_force(criterion, 5), abs=1e-5)
    even = math.log(variance(covariance(np.linspace(*BOUNDS, 5))))
    assert found.gain == pytest.approx(math.exp(0.5 * (even - reached)), rel=5e-3)
    assert found.gain > 1.05
    here, now, spaced = found.minimised
    assert now is None
    assert (here, spaced) == pytest.approx(np.exp([0.5 * reached, 0.5 * even]), rel=0.02)
    assert f"(criterion {criterion}) will be {here:.3g}; it would be {spaced:.3g}" in str(found)
    assert 0.9 < found.efficiency <= 1
    errors = np.sqrt(np.diag(covariance(found.velocity)))
    np.testing.assert_allclose(list(found.relative_errors.values()), errors, rtol=1e-6)
    random = np.random.default_rng(4)
    others = [math.log(variance(covariance(random.uniform(*BOUNDS, 5)))) for _ in range(200)]
    assert min(others) > reached + math.log(found.efficiency) - 1e-6


def test_the_best_place_for_two_parameters_of_a_decay_is_known():
    """Box and Lucas, Biometrika 46, 77 (1959): half at the lowest velocity, half 1/b above it."""
    calls = []
    options = {"criterion": "D", "starts": 3, "progress": lambda *call: calls.append(call)}
    found = cal.optimal_velocities(DECAY, 8, BOUNDS, **options)
    assert found.support == [(1.0, 4), (pytest.approx(21.0, rel=1e-4), 4)]
    assert found.efficiency > 0.999  # an even number can be halved
    assert calls == [("velocities", k, 3) for k in (1, 2, 3)]
    first, second, *_ = str(found).splitlines()
    assert first == "Best shots: 4 at 1 m/s (ε = 0.904 ± 0.01), 4 at 21 m/s (ε = 0.332 ± 0.01)."
    start = "The geometric mean of the standard errors of ln θ, correlations included (criterion D) will be "
    assert second.startswith(f"{start}{found.minimised[0]:.3g}; it would be ")
    assert "shots equally spaced. No 8 shots make it more than 0.1 % smaller." in second
    text = "Velocities allowed: 1 to 60 m/s; planned 1 to 21 m/s, standard uncertainty of ε 0.01."
    assert text in str(found)
    assert "cannot test the law" not in str(found)
    table = found.to_dict()
    assert table["support"][0] == {"velocity": 1.0, "shots": 4}
    assert table["relative_errors"] == found.relative_errors
    odd = cal.optimal_velocities(DECAY, 7, BOUNDS, criterion="D", starts=3, seed=7)
    # of 7 shots 3 and 4: √(4 · 3 · 4)/7 of what halves would give
    assert odd.efficiency == pytest.approx(math.sqrt(48) / 7, abs=2e-3)
    again = cal.optimal_velocities(DECAY, 7, BOUNDS, criterion="D", starts=3, seed=7)
    np.testing.assert_array_equal(odd.velocity, again.velocity)


def test_of_one_parameter_all_shots_are_where_it_acts_most():
    """|∂ε/∂ln b| = a b v e^{-bv} is largest at v = 1/b; one velocity cannot test the law."""
    fixed = {"level": cal.Parameter(free=False)}
    found = cal.optimal_velocities(DECAY, 5, BOUNDS, parameters=fixed, uncertainty=0.02)
    assert found.target == "rate"
    assert found.support == [(pytest.approx(20.0, rel=1e-4), 5)]
    error = 0.02 / (0.95 * math.exp(-1) * math.sqrt(5))
    assert found.relative_errors["rate"] == pytest.approx(error, rel=1e-6)
    assert found.uncertainty == pytest.approx(np.full(5, 0.02))
    assert "Shots at one velocity cannot test the law" in str(found)


def test_what_follows_from_the_parameters_is_a_target():
    """ε_up is measured at v_cr, from where on nothing else tells it."""
    found = cal.optimal_velocities(LAW, 6, (0.1, 60.0), target="eps_up", starts=1)
    assert found.support == [(pytest.approx(CRITICAL, rel=1e-3), 6)]
    eps_up = float(sj.restitution(LAW, CRITICAL).coefficient)
    expected = found.uncertainty[0] / math.sqrt(6) / eps_up
    assert found.relative_errors["eps_up"] == pytest.approx(expected, rel=1e-3)
    assert found.relative_errors["sigma"] is None


def test_what_is_measured_already_counts():
    old = np.linspace(1.0, 20.0, 10)
    options = {"measured": old, "measured_uncertainty": 0.002, "uncertainty": 0.01}
    found = cal.optimal_velocities(DECAY, 3, BOUNDS, target="rate", **options)
    before = np.linalg.inv(covariance(old, 0.002))
    new = rows(found.velocity) / 0.01
    after = np.linalg.inv(before + new.T @ new)
    assert found.relative_errors["rate"] == pytest.approx(math.sqrt(after[1, 1]), rel=1e-6)
    expected = math.sqrt(np.linalg.inv(before)[1, 1])
    assert found.before["rate"] == pytest.approx(expected, rel=1e-6)
    assert found.minimised[1] == found.before["rate"]
    assert f"it is {expected:.3g} now, and would be" in str(found)


def test_over_several_laws_the_mean_of_the_logarithm_is_what_is_small():
    """Two rates 1/20 and 1/5 (D, Box and Lucas as above): between the two optima."""
    laws = [Decay(0.95, 0.05), Decay(0.95, 0.2)]
    found = cal.optimal_velocities(laws, 6, BOUNDS, criterion="D", starts=3)

    def mean_log(v):
        return np.mean([np.linalg.slogdet(covariance(v, rate=law.rate))[1] for law in laws])

    scan = [mean_log(np.repeat([1.0, second], 3)) for second in np.linspace(2.0, 60.0, 2000)]
    assert mean_log(found.velocity) <= min(scan) + 1e-4
    assert 6.0 < found.velocity[-1] < 21.0
    each = [np.sqrt(np.diag(covariance(found.velocity, rate=law.rate))) for law in laws]
    expected = np.sqrt(np.mean(np.square(each), axis=0))
    np.testing.assert_allclose(list(found.relative_errors.values()), expected, rtol=1e-6)
    assert found.before is None


def test_shots_at_a_data_set_are_aimed_at_its_own_parameter():
    """A shared rate joins two data sets; of the other one's level these shots tell little."""
    shared = {"rate": cal.Parameter(shared=True)}
    result = cal.fit(decays(2, 0.01), Decay, shared, **QUICK)
    options = {"material": "b", "starts": 1}
    found = cal.optimal_velocities(result, 4, (1.0, 20.0), **options)
    assert found.target == "level[b]"
    assert found.support == [(1.0, 4)]  # where ε depends on the rate least
    named = cal.optimal_velocities(result, 4, (1.0, 20.0), target="rate", **options)
    assert named.support[0][0] > 10.0
