"""Repeats at one velocity, averaged: numbers worked out by hand, and what noise says of them."""

import math

import numpy as np
import pytest

import softjax as sj
from calibration.data import RestitutionData
from calibration.errors import DataError

PAIR = sj.Contact.between_spheres(sj.STAINLESS_STEEL, sj.STAINLESS_STEEL, 0.0127, 0.0127)
REPEATED = {
    "velocity": [2.0, 1.0, 1.0, 2.0, 1.0, 3.0],
    "restitution": [0.80, 0.90, 0.92, 0.84, 0.94, 0.70],
}
POOLED = math.sqrt(0.0016 / 3)  # s² = (2 · 0.02² of three + 0.04²/2 of two) / 3


def test_repeats_are_averaged_with_the_scatter_of_all():
    data = RestitutionData(**REPEATED, contact=PAIR, name="steel").averaged()
    np.testing.assert_array_equal(data.velocity, [1.0, 2.0, 3.0])
    np.testing.assert_allclose(data.restitution, [0.92, 0.82, 0.70], rtol=1e-14)
    expected = [POOLED / math.sqrt(3), POOLED / math.sqrt(2), POOLED]
    np.testing.assert_allclose(data.uncertainty, expected, rtol=1e-12)
    assert data.degrees == 3  # six readings less three velocities
    assert (data.name, data.contact) == ("steel", PAIR)


def test_repeats_with_scatters_of_their_own_on_request():
    data = RestitutionData(**REPEATED).averaged(pooled=False)
    # s = 0.02 of three, 0.04/√2 of two; 3 m/s takes the pooled one
    np.testing.assert_allclose(data.uncertainty, [0.02 / math.sqrt(3), 0.02, POOLED], rtol=1e-12)
    np.testing.assert_array_equal(data.degrees, [2, 1, 3])


def test_repeats_with_stated_uncertainties_are_weighted():
    data = RestitutionData(
        [1.0, 1.0, 2.0], [0.9, 0.8, 0.7], uncertainty=[0.01, 0.02, 0.03], velocity_uncertainty=0.1
    ).averaged()
    # (0.9 · 10⁴ + 0.8 · 2500)/12500, 1/√12500; velocities have the weights of their restitutions
    np.testing.assert_allclose(data.restitution, [0.88, 0.7], rtol=1e-14)
    np.testing.assert_allclose(data.uncertainty, [0.00894427191, 0.03], rtol=1e-9)
    expected = [0.1 * math.hypot(0.8, 0.2), 0.1]
    np.testing.assert_allclose(data.velocity_uncertainty, expected, rtol=1e-12)
    assert data.degrees is None


def test_what_a_point_shares_between_its_two_numbers_outlives_averaging():
    """Three drops from one height: the mean's covariance of (ε, v) is that of a weighted mean."""
    table = {"drop_height": [0.5] * 3 + [1.0], "rebound_height": [0.40, 0.41, 0.39, 0.7]}
    sizes = {"drop_height_uncertainty": 0.004, "rebound_height_uncertainty": 0.003}
    data = RestitutionData.from_table(table, **sizes)
    mean, slope = data.averaged(), -0.1
    weight = data.uncertainty[:3] ** -2 / np.sum(data.uncertainty[:3] ** -2)
    expected = weight**2 @ data.covariance_of(slope).diagonal[:3]
    np.testing.assert_allclose(mean.covariance_of(slope).diagonal[0], expected, rtol=1e-12)
    single = data.covariance_of(slope).diagonal[3]
    np.testing.assert_allclose(mean.covariance_of(slope).diagonal[1], single, rtol=1e-12)
    apart = mean.uncertainty[0] ** 2 + (slope * mean.velocity_uncertainty[0]) ** 2
    assert expected < 0.7 * apart  # a drop from higher up lowers ε and raises v


def test_repeats_of_different_groups_stay_apart():
    data = RestitutionData(**REPEATED, group=list("abaabb")).averaged()
    # 1 m/s: b 0.90, a 0.92, b 0.94; 2 m/s: a 0.80 and 0.84; 3 m/s: b
    np.testing.assert_array_equal(data.velocity, [1.0, 1.0, 2.0, 3.0])
    assert sorted(zip(data.velocity, data.group, data.restitution.round(12), strict=True)) == [
        (1.0, "a", 0.92),
        (1.0, "b", 0.92),
        (2.0, "a", 0.82),
        (3.0, "b", 0.70),
    ]
    assert data.degrees == 2
    s = math.sqrt((2 * 0.02**2 + 2 * 0.02**2) / 2)
    expected = {("a", 1.0): s, ("b", 1.0): s / math.sqrt(2), ("a", 2.0): s / math.sqrt(2)}
    found = dict(zip(zip(data.group, data.velocity, strict=True), data.uncertainty, strict=True))
    for key, value in expected.items():
        assert found[key] == pytest.approx(value, rel=1e-9)


def test_averaging_without_repeats_or_scatter_finds_no_uncertainty():
    single = RestitutionData([2.0, 1.0], [0.8, 0.9]).averaged()
    np.testing.assert_array_equal(single.velocity, [1.0, 2.0])
    np.testing.assert_array_equal(single.restitution, [0.9, 0.8])
    assert (single.uncertainty, single.degrees) == (None, None)
    alike = RestitutionData([1.0] * 3 + [2.0], [0.1 + 0.2] * 3 + [0.8]).averaged()
    assert (alike.uncertainty, alike.degrees) == (None, None)


def test_readings_alike_take_the_scatter_of_the_others():
    data = RestitutionData([1.0, 1.0, 2.0, 2.0], [0.9, 0.9, 0.8, 0.82]).averaged(pooled=False)
    # pooled s² = 0.0002/2 over √2; own s = 0.02/√2 over √2
    np.testing.assert_allclose(data.uncertainty, [math.sqrt(0.0001 / 2), 0.01], rtol=1e-12)
    np.testing.assert_array_equal(data.degrees, [2, 1])


def test_bounces_of_a_train_are_not_averaged():
    single = {"interval": [0.8, 0.72, 0.8, 0.7], "launch": [1, 1, 2, 2], "group": ["x"] * 4}
    assert len(RestitutionData.from_table(single).averaged()) == 1  # nothing is shared
    longer = {"interval": [0.8, 0.72, 0.65, 0.8, 0.7], "launch": [1, 1, 1, 2, 2]}
    with pytest.raises(DataError, match="left out for bounce trains, whose points share"):
        RestitutionData.from_table(longer).averaged()


def test_contacts_of_other_bodies_at_each_impact_are_not_averaged():
    radius = np.array([0.001, 0.01])
    pair = sj.Contact.between_spheres(sj.NYLON, sj.NYLON, radius, radius)
    with pytest.raises(ValueError, match="`contact` must be of single numbers for repeats"):
        RestitutionData([1.0, 2.0], [0.9, 0.8], pair).averaged()


@pytest.mark.parametrize("repeats", [2, 3, 5])
def test_the_pooled_error_with_its_degrees_of_freedom_holds_the_mean(repeats):
    """95 % t intervals of 2000 means each: the share that holds the truth is binomial about 95 %."""
    from scipy import stats

    rng, sets = np.random.default_rng(repeats), 250
    held = []
    for _ in range(sets):
        velocity = np.repeat(np.arange(1.0, 9.0), repeats)
        truth = 0.9 - 0.05 * velocity
        data = RestitutionData(
            velocity, truth + 0.02 * rng.standard_normal(len(velocity))
        ).averaged()
        reach = stats.t.ppf(0.975, data.degrees) * data.uncertainty
        held.append(np.abs(data.restitution - (0.9 - 0.05 * data.velocity)) <= reach)
    share = np.mean(held)
    # means of one set share their s: their number counts less, by at most the 8 of a set
    assert abs(share - 0.95) < 2.6 * math.sqrt(0.95 * 0.05 / (sets * 8 / 2))
