"""Restitutions above 1: noise is let pass, a slip is not, in sets drawn many times over."""

from contextlib import suppress

import numpy as np
import pytest

from calibration.data import RestitutionData
from calibration.data.above_one import scatter_of
from calibration.errors import DataError

TRUTHS = {
    "one": lambda v: np.ones_like(v),  # the hardest of all
    "near one": lambda v: 1 - 0.01 * v**0.3,
    "falling": lambda v: np.exp(-0.08 * v**0.6),
}


def drawn(truth, count, noise, rng):
    velocity = np.sort(rng.uniform(0.05, 8.0, count))
    return velocity, np.abs(TRUTHS[truth](velocity) + noise * rng.standard_normal(count))


def refused(velocity, restitution, **told):
    with suppress(DataError):
        RestitutionData(velocity, restitution, **told)
        return False
    return True


def share_refused(truth, noise, sets, seed, **told):
    rng = np.random.default_rng(seed)
    counts = rng.integers(5, 60, sets)
    return np.mean([refused(*drawn(truth, n, noise, rng), **told) for n in counts])


@pytest.mark.parametrize("truth", TRUTHS)
@pytest.mark.parametrize("noise", [0.01, 0.03, 0.05])
def test_honest_sets_pass(truth, noise):
    """At most 1 of 100; a fixed 0.05 refuses 118 of the 300 near one at a noise of 0.03."""
    assert share_refused(truth, noise, 300, seed=1) <= 0.01


@pytest.mark.long
@pytest.mark.parametrize("truth", TRUTHS)
@pytest.mark.parametrize("noise", [0.002, 0.01, 0.02, 0.03, 0.04, 0.05])
def test_honest_sets_pass_many(truth, noise):
    assert share_refused(truth, noise, 5000, seed=2) <= 0.005


@pytest.mark.parametrize("truth", ["one", "falling"])
def test_honest_sets_with_honest_uncertainties_pass(truth):
    assert share_refused(truth, 0.02, 300, seed=3, uncertainty=0.02) <= 0.003
    # and with uncertainties that are four times too small, which the scatter shows
    assert share_refused(truth, 0.02, 300, seed=4, uncertainty=0.005) <= 0.05


def gross_refused(count, place, sets, seed, noise=0.02, value=1.3):
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(sets):
        velocity = np.sort(rng.uniform(0.05, 8.0, count))
        restitution = 0.95 + noise * rng.standard_normal(count)
        restitution[int(place * (count - 1))] = value
        found.append(refused(velocity, restitution))
    return np.mean(found)


@pytest.mark.parametrize("count", [1, 3, 5, 8, 12, 30, 100])
@pytest.mark.parametrize("place", [0.0, 0.5, 1.0])
def test_one_gross_error_is_refused(count, place):
    assert gross_refused(count, place, 60, seed=5) >= 0.98


@pytest.mark.long
@pytest.mark.parametrize("count", [4, 5, 6, 7, 8, 9, 10, 12, 15, 20, 30, 50, 100])
def test_one_gross_error_is_refused_many(count):
    assert np.mean([gross_refused(count, place, 1000, seed=6) for place in (0, 0.3, 1)]) >= 0.99


def test_the_point_that_is_refused_is_the_gross_one():
    velocity = np.arange(1.0, 13.0)
    restitution = 0.95 + 0.01 * np.sin(7 * velocity)
    restitution[[2, 8]] = 1.01, 1.4
    with pytest.raises(DataError, match=r"`restitution\[8\]` must be at most 1, or above it by no"):
        RestitutionData(velocity, restitution)


def test_a_point_is_judged_by_the_others_alone():
    restitution = np.array([0.951, 0.950, 0.949, 1.15, 0.950, 0.951, 0.949])
    with pytest.raises(DataError, match=r"`restitution\[3\]` .* brings it, 0\.02"):
        RestitutionData(np.arange(1.0, 8.0), restitution)


def test_however_wild_the_others_are_half_above_one_is_too_far():
    velocity = np.arange(1.0, 41.0)
    restitution = 0.5 + 0.4 * np.sin(5.0 * velocity)
    restitution[20] = 1.499
    assert len(RestitutionData(velocity, restitution)) == 40
    restitution[20] = 1.501
    with pytest.raises(DataError, match=r"brings it, 0\.5 here"):
        RestitutionData(velocity, restitution)


def test_stated_uncertainties_reach_to_four():
    data = RestitutionData([1.0, 2.0], [0.9, 1.0399999], uncertainty=0.01)
    assert data.restitution[1] == 1.0399999
    with pytest.raises(DataError, match=r"`restitution\[1\]` must be .* brings it, 0\.04 here"):
        RestitutionData([1.0, 2.0], [0.9, 1.0400001], uncertainty=0.01)
    with pytest.raises(DataError, match=r"`restitution\[1\]` .* brings it, 0\.008 here"):
        RestitutionData([1.0, 2.0], [1.3, 1.01], uncertainty=[0.1, 0.002])


def test_too_few_points_to_tell():
    assert len(RestitutionData([1.0, 2.0], [0.9, 1.1499])) == 2
    with pytest.raises(DataError, match=r"brings it, 0\.15 here"):
        RestitutionData([1.0, 2.0], [0.9, 1.1501])


@pytest.mark.parametrize("value", [85.0, 2.0, 1.7])
def test_percent_is_asked_about(value):
    restitution = value * (1 - 0.002 * np.arange(1.0, 21.0))
    with pytest.raises(DataError, match=r"\(is it in percent\? then the unit is \[%\]\)"):
        RestitutionData(np.arange(1.0, 21.0), restitution)
    with pytest.raises(DataError) as caught:
        RestitutionData([1.0], [1.4])
    assert "percent" not in str(caught.value)


def test_the_scatter_is_that_of_the_noise_whatever_the_curve():
    rng = np.random.default_rng(7)
    velocity = np.sort(rng.uniform(0.1, 5.0, 4000))
    for curve in (0 * velocity, np.exp(-velocity), 0.9 - 0.1 * velocity):
        found = scatter_of(velocity, curve + 0.01 * rng.standard_normal(4000))
        assert found == pytest.approx(0.01, rel=0.05)
    spoiled = 0.01 * rng.standard_normal(4000)
    spoiled[::20] += 5.0  # a twentieth of them wild
    assert scatter_of(velocity, spoiled) == pytest.approx(0.01, rel=0.35)
    assert scatter_of(np.repeat(velocity[:50], 3), np.zeros(150)) == 0.0
