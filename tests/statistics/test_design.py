"""Designs against closed forms, brute force, and simulated calibrations."""

import math
from functools import lru_cache

import numpy as np
import pytest
from scipy import optimize

import calibration as cal
import softjax as sj
from tests.cases import fitted
from tests.decay import Decay
from tests.statistics.test_information import simulated

DECAY = Decay(0.95, 0.05)
BOUNDS = (1.0, 60.0)
NOISE = 0.003
LAW = fitted("nylon")
CRITICAL = float(LAW.contact.critical_velocity)
ABOVE = (2 * CRITICAL, 80 * CRITICAL)


def rows(v, level=0.95, rate=0.05):
    """Slopes of a e^{-bv} in ln a and ln b, by hand."""
    curve = level * np.exp(-rate * np.asarray(v))
    return np.stack([curve, -rate * np.asarray(v) * curve], axis=-1)


def covariance(v, noise=0.01, **law):
    slopes = rows(v, **law) / noise
    return np.linalg.inv(slopes.T @ slopes)


def average_variance(matrix):
    """∫ s(v)ᵀ C s(v) dv over the bounds, a fine sum in place of it."""
    curve = rows(np.linspace(*BOUNDS, 4001))
    return float(np.mean(np.einsum("ki,ij,kj->k", curve, matrix, curve)))


VARIANCES = {
    "c": lambda c: c[1, 1],
    "D": lambda c: math.sqrt(np.linalg.det(c)),
    "A": lambda c: 0.5 * np.trace(c),
    "E": lambda c: np.linalg.eigvalsh(c)[-1],
    "I": average_variance,
}


@lru_cache
def brute_force(criterion: str, count: int) -> float:
    """The least variance of designs at two velocities, which two parameters need, however split."""
    found = []
    for first in range(1, count):

        def variance(pair, first=first):
            v = np.repeat(pair, [first, count - first])
            return math.log(VARIANCES[criterion](covariance(v)))

        spread = np.linspace(*BOUNDS, 25)
        pairs = [(a, b) for a in spread for b in spread if b > a]
        start = min(pairs, key=variance)
        inside = {"method": "Nelder-Mead", "bounds": [BOUNDS] * 2, "options": {"xatol": 1e-8}}
        found.append(optimize.minimize(variance, start, **inside).fun)
    return min(found)


@pytest.mark.parametrize("criterion", VARIANCES)
def test_each_criterion_is_as_small_as_a_brute_force_search_makes_it(criterion):
    aim = {"target": "rate"} if criterion == "c" else {}
    found = cal.optimal_velocities(DECAY, 7, BOUNDS, criterion=criterion, **aim)
    reached = math.log(VARIANCES[criterion](covariance(found.velocity)))
    assert reached == pytest.approx(brute_force(criterion, 7), abs=1e-5)
    even = math.log(VARIANCES[criterion](covariance(np.linspace(*BOUNDS, 7))))
    assert found.gain == pytest.approx(math.exp(0.5 * (even - reached)), rel=1e-3)
    assert found.gain > 1.05
    assert 0.9 < found.efficiency <= 1
    errors = np.sqrt(np.diag(covariance(found.velocity)))
    np.testing.assert_allclose(list(found.relative_errors.values()), errors, rtol=1e-6)


def test_one_velocity_is_told_to_tell_one_number():
    """ε_up is measured at v_cr, from where on nothing else tells it."""
    found = cal.optimal_velocities(LAW, 6, (0.1, 60.0), target="eps_up", starts=1)
    ((v, shots),) = found.support
    assert (v, shots) == (pytest.approx(CRITICAL, rel=1e-3), 6)
    assert "Shots at one velocity cannot test the law" in str(found)
    eps_up = float(sj.restitution(LAW, CRITICAL).coefficient)
    expected = found.uncertainty[0] / math.sqrt(6) / eps_up
    assert found.relative_errors["eps_up"] == pytest.approx(expected, rel=1e-3)
    assert found.relative_errors["sigma"] is None
    several = cal.optimal_velocities(DECAY, 6, BOUNDS, target="rate", starts=1)
    assert "cannot test the law" not in str(several)


def test_the_best_place_for_two_parameters_of_a_decay_is_known():
    """Box and Lucas, Biometrika 46, 77 (1959): half at the lowest velocity, half 1/b above it."""
    found = cal.optimal_velocities(DECAY, 8, BOUNDS, criterion="D")
    assert found.support == [(1.0, 4), (pytest.approx(21.0, rel=1e-4), 4)]
    assert found.efficiency > 0.999  # an even number can be halved
    odd = cal.optimal_velocities(DECAY, 7, BOUNDS, criterion="D")
    # of 7 shots 3 and 4: √(4 · 3 · 4)/7 of what halves would give
    assert odd.efficiency == pytest.approx(math.sqrt(48) / 7, abs=2e-3)


def test_of_one_parameter_all_shots_are_where_it_acts_most():
    """|∂ε/∂ln b| = a b v e^{-bv} is largest at v = 1/b."""
    fixed = {"level": cal.Parameter(free=False)}
    found = cal.optimal_velocities(DECAY, 5, BOUNDS, parameters=fixed, uncertainty=0.02)
    assert found.target == "rate"
    assert found.support == [(pytest.approx(20.0, rel=1e-4), 5)]
    error = 0.02 / (0.95 * math.exp(-1) * math.sqrt(5))
    assert found.relative_errors["rate"] == pytest.approx(error, rel=1e-6)
    assert found.uncertainty == pytest.approx(np.full(5, 0.02))


def test_a_curve_is_predicted_where_it_is_asked_for():
    low = cal.optimal_velocities(DECAY, 6, BOUNDS, criterion="I", over=(1.0, 5.0))
    high = cal.optimal_velocities(DECAY, 6, BOUNDS, criterion="I", over=(40.0, 60.0))
    assert np.mean(low.velocity) < np.mean(high.velocity)
    curve = rows(np.linspace(40.0, 60.0, 4001))
    of_high, of_low = (
        np.mean(np.einsum("ki,ij,kj->k", curve, covariance(one.velocity), curve))
        for one in (high, low)
    )
    assert of_high < 0.7 * of_low


def test_no_design_is_better_than_the_bound_says():
    """The bound comes from the tabulated slopes alone; a thousand random designs stay behind it."""
    random = np.random.default_rng(4)
    for criterion, variance in VARIANCES.items():
        aim = {"target": "rate"} if criterion == "c" else {}
        found = cal.optimal_velocities(DECAY, 4, BOUNDS, criterion=criterion, **aim)
        best = math.log(variance(covariance(found.velocity)))
        others = [math.log(variance(covariance(random.uniform(*BOUNDS, 4)))) for _ in range(200)]
        assert min(others) > best + math.log(found.efficiency) - 1e-6


def test_what_is_measured_already_counts():
    old = np.linspace(1.0, 20.0, 10)
    told = {"measured": old, "measured_uncertainty": 0.002, "uncertainty": 0.01}
    found = cal.optimal_velocities(DECAY, 3, BOUNDS, target="rate", **told)
    before = np.linalg.inv(covariance(old, 0.002))
    new = rows(found.velocity) / 0.01
    after = np.linalg.inv(before + new.T @ new)
    assert found.relative_errors["rate"] == pytest.approx(math.sqrt(after[1, 1]), rel=1e-6)
    expected = math.sqrt(np.linalg.inv(before)[1, 1])
    assert found.before["rate"] == pytest.approx(expected, rel=1e-6)
    assert cal.optimal_velocities(DECAY, 3, BOUNDS).before is None


def test_over_several_laws_the_mean_of_the_logarithm_is_what_is_small():
    """Two rates 1/20 and 1/5 (D, Box and Lucas as above): between the two optima."""
    laws = [Decay(0.95, 0.05), Decay(0.95, 0.2)]
    found = cal.optimal_velocities(laws, 6, BOUNDS, criterion="D")

    def mean_log(v):
        return np.mean([np.linalg.slogdet(covariance(v, rate=law.rate))[1] for law in laws])

    scan = [mean_log(np.repeat([1.0, second], 3)) for second in np.linspace(2.0, 60.0, 2000)]
    assert mean_log(found.velocity) <= min(scan) + 1e-4
    assert 6.0 < found.velocity[-1] < 21.0
    each = [np.sqrt(np.diag(covariance(found.velocity, rate=law.rate))) for law in laws]
    expected = np.sqrt(np.mean(np.square(each), axis=0))
    np.testing.assert_allclose(list(found.relative_errors.values()), expected, rtol=1e-6)
    assert found.efficiency > 0.9


def test_optimal_velocities_lower_the_error_as_predicted():
    """600 calibrations each at the optimal velocities and at equally spaced ones."""
    found = cal.optimal_velocities(LAW, 12, ABOVE, uncertainty=NOISE)
    assert found.target == "chi"
    assert found.gain > 1.15
    best = simulated(LAW, found.velocity, NOISE, seed=1)["chi"]
    even = simulated(LAW, np.linspace(*ABOVE, 12), NOISE, seed=2)["chi"]
    assert best == pytest.approx(found.relative_errors["chi"], rel=0.1)
    assert even == pytest.approx(found.equally_spaced["chi"], rel=0.1)
    assert found.gain == pytest.approx(found.equally_spaced["chi"] / found.relative_errors["chi"])


def test_the_optimum_is_better_than_its_neighbours():
    found = cal.optimal_velocities(LAW, 12, ABOVE, uncertainty=NOISE)
    best = found.relative_errors["chi"]
    for place in {v for v, _ in found.support}:
        for factor in (0.8, 0.95, 1.05, 1.2):
            there = np.isclose(found.velocity, place, rtol=0.01)
            moved = np.clip(np.where(there, factor, 1.0) * found.velocity, *ABOVE)
            told = cal.fisher_information(LAW, moved, NOISE)
            assert told.relative_errors["chi"] > best * (1 - 1e-4)
    assert all(ABOVE[0] <= v <= ABOVE[1] for v in found.velocity)
    assert sum(count for _, count in found.support) == 12


def test_the_losses_are_best_measured_just_below_yield():
    """There ε is ε_up, which χ̃ does not touch; above, it and χ̃ act together."""
    found = cal.optimal_velocities(LAW, 12, (0.1 * CRITICAL, ABOVE[1]), uncertainty=NOISE)
    (first, _), (last, _) = found.support
    assert first == pytest.approx(CRITICAL, rel=2e-3)
    assert np.min(found.velocity) <= CRITICAL
    assert last == ABOVE[1]
    assert found.relative_errors["sigma"] is None  # only together with ψ
    even, best = (e["chi"] for e in (found.equally_spaced, found.relative_errors))
    assert found.gain == pytest.approx(even / best, rel=1e-6)
    reached = simulated(LAW, found.velocity, NOISE, seed=5)["chi"]
    assert best == pytest.approx(reached, rel=0.1)
    assert found.efficiency > 0.99


def test_of_a_fit_its_points_and_its_noise_are_taken():
    v = np.linspace(1.0, 12.0, 12)
    noise = 0.01 * np.random.default_rng(0).standard_normal(12)
    data = cal.RestitutionData(v, 0.9 * np.exp(-0.05 * v) + noise, name="balls")
    result = cal.fit(data, Decay, profiles=False)
    found = cal.optimal_velocities(result, 4, BOUNDS, target="rate", material="balls")
    assert found.uncertainty == pytest.approx(np.full(4, result.materials[0].noise))
    relative = {n: e / result.values[n] for n, e in result.standard_errors.items()}
    assert found.before == pytest.approx(relative, rel=1e-5)
    assert found.relative_errors["rate"] < 0.7 * found.before["rate"]
    assert found.names == ("level", "rate")


def test_shots_at_a_data_set_are_aimed_at_its_own_parameter():
    """Shared rates join two data sets; of the other one's level these shots tell little."""
    v, random = np.linspace(1.0, 12.0, 12), np.random.default_rng(1)
    noise = 0.01 * random.standard_normal((2, 12))
    curves = [level * np.exp(-0.04 * v) + off for level, off in zip((0.9, 0.8), noise, strict=True)]
    pairs = zip("ab", curves, strict=True)
    data = [cal.RestitutionData(v, e, None, 0.01, name) for name, e in pairs]
    result = cal.fit(data, Decay, {"rate": cal.Parameter(shared=True)}, profiles=False)
    found = cal.optimal_velocities(result, 4, (1.0, 20.0), material="b", starts=1)
    assert found.target == "level[b]"
    (shots,) = found.support
    assert shots == (1.0, 4)  # where ε depends on the rate least
    named = cal.optimal_velocities(result, 4, (1.0, 20.0), material="b", starts=1, target="rate")
    assert named.support[0][0] > 10.0


def test_the_same_seed_gives_the_same_design_and_progress_is_told():
    calls = []
    told = {"starts": 3, "progress": lambda *call: calls.append(call)}
    one = cal.optimal_velocities(DECAY, 5, BOUNDS, seed=7, **told)
    two = cal.optimal_velocities(DECAY, 5, BOUNDS, seed=7, starts=3)
    np.testing.assert_array_equal(one.velocity, two.velocity)
    assert calls == [("velocities", k, 3) for k in (1, 2, 3)]


def test_a_design_tells_itself():
    found = cal.optimal_velocities(DECAY, 8, BOUNDS, criterion="D")
    assert str(found).startswith(
        "D-optimal: 4 at 1 m/s (ε = 0.904 ± 0.01), 4 at 21 m/s (ε = 0.332 ± 0.01); standard error of ln a"
    )
    assert "Sought from 1 to 60 m/s; planned 1 to 21 m/s, standard uncertainty of ε 0.01." in str(
        found
    )
    table = found.to_dict()
    assert table["support"][0] == {"velocity": 1.0, "shots": 4}
    assert table["efficiency"] == found.efficiency
    assert table["relative_errors"] == found.relative_errors


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        ({"count": 0}, "count"),
        ({"bounds": (2.0, 1.0)}, "bounds"),
        ({"bounds": (0.0, 1.0)}, "bounds"),
        ({"law": LAW, "bounds": (1.0, 1e4)}, "velocity"),
        ({"criterion": "G"}, "criterion"),
        ({"bounds": (1.0,)}, r"`bounds` must be two numbers, \(low, high\)"),
        ({"criterion": "I", "over": 3.0}, r"`over` must be two numbers, \(low, high\)"),
        ({"count": True}, "`count` must be a whole number"),
        ({"law": []}, "`law` must be one law or more"),
        ({"target": "eps"}, "target"),
        ({"target": "rate", "criterion": "D"}, "`target` must be left out with criterion D"),
        ({"over": (1.0, 5.0)}, "`over` must be left out with criterion c"),
        ({"measured_uncertainty": 0.1}, "`measured_uncertainty` must be given with measured"),
        ({"objective": "two-step"}, "objective"),
        ({"uncertainty": 0.0}, "uncertainty"),
        ({"starts": 0}, "starts"),
        ({"seed": -1}, "`seed` must be a whole number"),
        ({"law": [DECAY, "steel"]}, "law"),
    ],
)
def test_what_makes_no_sense_is_named(changed, named):
    arguments = {"law": DECAY, "count": 5, "bounds": BOUNDS} | changed
    with pytest.raises(ValueError, match=named) as caught:
        cal.optimal_velocities(**arguments)
    assert "\n" not in str(caught.value)
