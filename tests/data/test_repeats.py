"""Repeats at one velocity, averaged: numbers worked out by hand, and coverage of their intervals."""

import math

import numpy as np
import pytest
from scipy import stats

import calibration as cal
import softjax as sj

PAIR = sj.Contact.between_spheres(sj.STAINLESS_STEEL, sj.STAINLESS_STEEL, 0.0127, 0.0127)
REPEATED = {
    "velocity": [2.0, 1.0, 1.0, 2.0, 1.0, 3.0],
    "restitution": [0.80, 0.90, 0.92, 0.84, 0.94, 0.70],
}
POOLED = math.sqrt(0.0016 / 3)  # s² = (2 · 0.02² of three + 0.04²/2 of two) / 3


def test_repeats_are_averaged_with_the_scatter_of_all():
    data = cal.RestitutionData(**REPEATED, contact=PAIR, name="steel").averaged()
    np.testing.assert_array_equal(data.velocity, [1.0, 2.0, 3.0])
    np.testing.assert_allclose(data.restitution, [0.92, 0.82, 0.70], rtol=1e-14)
    expected = [POOLED / math.sqrt(3), POOLED / math.sqrt(2), POOLED]
    np.testing.assert_allclose(data.uncertainty, expected, rtol=1e-12)
    assert data.degrees == 3  # six readings less three velocities
    assert (data.name, data.contact) == ("steel", PAIR)


def test_repeats_with_stated_uncertainties_are_weighted():
    stated = {"uncertainty": [0.01, 0.02, 0.03], "velocity_uncertainty": 0.1}
    data = cal.RestitutionData([1.0, 1.0, 2.0], [0.9, 0.8, 0.7], **stated).averaged()
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
    data = cal.RestitutionData.from_table(table, **sizes)
    mean, slope = data.averaged(), -0.1
    weight = data.uncertainty[:3] ** -2 / np.sum(data.uncertainty[:3] ** -2)
    single = data.covariance_of(slope).diagonal
    expected = [weight**2 @ single[:3], single[3]]
    np.testing.assert_allclose(mean.covariance_of(slope).diagonal, expected, rtol=1e-12)
    apart = mean.uncertainty[0] ** 2 + (slope * mean.velocity_uncertainty[0]) ** 2
    assert expected[0] < 0.7 * apart  # a drop from higher up lowers ε and raises v


def test_repeats_of_different_groups_stay_apart():
    data = cal.RestitutionData(**REPEATED, group=list("abaabb")).averaged()
    # 1 m/s: b 0.90, a 0.92, b 0.94; 2 m/s: a 0.80 and 0.84; 3 m/s: b
    s = math.sqrt((2 * 0.02**2 + 2 * 0.02**2) / 2)
    expected = {("a", 1.0): (0.92, s), ("b", 1.0): (0.92, s / math.sqrt(2))}
    expected |= {("a", 2.0): (0.82, s / math.sqrt(2)), ("b", 3.0): (0.7, s)}
    columns = zip(data.group, data.velocity, data.restitution, data.uncertainty, strict=True)
    found = {(group, v): (e, u) for group, v, e, u in columns}
    assert list(data.velocity) == [1.0, 1.0, 2.0, 3.0]
    assert found.keys() == expected.keys()
    for key, pair in expected.items():
        assert found[key] == pytest.approx(pair, rel=1e-9)
    assert data.degrees == 2


def test_averaging_without_repeats_or_scatter_finds_no_uncertainty():
    single = cal.RestitutionData([2.0, 1.0], [0.8, 0.9]).averaged()
    np.testing.assert_array_equal(single.velocity, [1.0, 2.0])
    np.testing.assert_array_equal(single.restitution, [0.9, 0.8])
    alike = cal.RestitutionData([1.0] * 3 + [2.0], [0.1 + 0.2] * 3 + [0.8]).averaged()
    for data in (single, alike):
        assert (data.uncertainty, data.degrees) == (None, None)


def test_single_bounces_of_launches_are_averaged_and_trains_are_not():
    single = {"interval": [0.8, 0.72, 0.8, 0.7], "launch": [1, 1, 2, 2], "group": ["x"] * 4}
    assert len(cal.RestitutionData.from_table(single).averaged()) == 1  # nothing is shared
    longer = {"interval": [0.8, 0.72, 0.65, 0.8, 0.7], "launch": [1, 1, 1, 2, 2]}
    with pytest.raises(cal.DataError, match=r"repeats.*sequences"):
        cal.RestitutionData.from_table(longer).averaged()


def test_contacts_of_other_bodies_at_each_impact_are_not_averaged():
    radius = np.array([0.001, 0.01])
    pair = sj.Contact.between_spheres(sj.NYLON, sj.NYLON, radius, radius)
    with pytest.raises(ValueError, match=r"contact.*single numbers"):
        cal.RestitutionData([1.0, 2.0], [0.9, 0.8], pair).averaged()


@pytest.mark.parametrize("repeats", [2, 5])
def test_the_pooled_error_with_its_degrees_of_freedom_holds_the_mean(repeats):
    """95 % t intervals of 2000 means: the share that holds the truth is binomial about 95 %."""
    rng, sets = np.random.default_rng(repeats), 250
    inside = []
    for _ in range(sets):
        velocity = np.repeat(np.arange(1.0, 9.0), repeats)
        noise = 0.02 * rng.standard_normal(len(velocity))
        data = cal.RestitutionData(velocity, 0.9 - 0.05 * velocity + noise).averaged()
        reach = stats.t.ppf(0.975, data.degrees) * data.uncertainty
        inside.append(np.abs(data.restitution - (0.9 - 0.05 * data.velocity)) <= reach)
    # means of one set share their s: their number counts less, by at most the 8 of a set
    assert abs(np.mean(inside) - 0.95) < 2.6 * math.sqrt(0.95 * 0.05 / (sets * 8 / 2))
