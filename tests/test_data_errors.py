"""How errors of measurement reach ε and v: against finite differences, formulas and drawn noise."""

from dataclasses import replace

import numpy as np
import pytest

from calibration.data import PointErrors, RestitutionData
from calibration.errors import DataError

G = 9.80665
RNG = np.random.default_rng(7)
SLOPE = -0.05  # dε/dv [s/m]


def of_velocities(before, after):
    return after / before, before


def of_heights(drop, rebound):
    return np.sqrt(rebound / drop), np.sqrt(2 * G * drop)


def of_intervals(*intervals):
    t = np.array(intervals)
    return t[1:] / t[:-1], G * t[:-1] / 2


def of_times(*times):
    return of_intervals(*np.diff(times))


def data_of(kind, values, sizes):
    """The data of one table, with the uncertainty of each measured number."""
    if kind in ("velocities", "heights"):
        names = {
            "velocities": ("impact_velocity", "rebound_velocity"),
            "heights": ("drop_height", "rebound_height"),
        }[kind]
        table = {name: [x] for name, x in zip(names, values, strict=True)}
        table |= {f"{name}_uncertainty": [u] for name, u in zip(names, sizes, strict=True)}
    else:
        name = kind.removesuffix("s")
        table = {name: values, f"{name}_uncertainty": sizes}
    return RestitutionData.from_table(table)


# made so that all is measured with another uncertainty; the function is the test's own
CASES = {
    "velocities": (of_velocities, [2.0, 1.7], [0.02, 0.03]),
    "heights": (of_heights, [0.5, 0.4], [0.001, 0.002]),
    "intervals": (of_intervals, [0.7, 0.62, 0.56, 0.5, 0.46], [1e-3, 2e-3, 3e-3, 1e-3, 2e-3]),
    "times": (of_times, [0.1, 0.8, 1.42, 1.98, 2.48, 2.94], [1e-3, 2e-3, 3e-3, 1e-3, 2e-3, 1e-3]),
}


def covariance_by_differences(function, values, sizes):
    """That of δε - slope δv for independent errors of what was measured."""
    columns = []
    for i, size in enumerate(sizes):
        step = np.zeros(len(values))
        step[i] = 1e-6 * values[i]
        (e_1, v_1), (e_0, v_0) = function(*(values + step)), function(*(values - step))
        change = (e_1 - e_0) - SLOPE * (v_1 - v_0)
        columns.append(np.atleast_1d(size * change / (2 * step[i])))
    jacobian = np.stack(columns, axis=1)
    return jacobian @ jacobian.T


@pytest.mark.parametrize("kind", CASES)
def test_errors_enter_as_finite_differences_have_it(kind):
    function, values, sizes = CASES[kind]
    data = data_of(kind, values, sizes)
    expected = covariance_by_differences(function, np.array(values), sizes)
    np.testing.assert_allclose(data.covariance_of(SLOPE).dense(), expected, rtol=1e-6, atol=1e-14)
    assert data.errors.kind == kind


@pytest.mark.parametrize("kind", CASES)
def test_whitened_noise_is_independent_and_of_variance_one(kind):
    """Noise drawn, read, and divided by the covariance: 4000 sets, 1 within four standard errors."""
    function, values, sizes = CASES[kind]
    data = data_of(kind, values, sizes)
    covariance, sets = data.covariance_of(SLOPE), 4000
    noise = 0.05 * np.array(sizes) * RNG.standard_normal((sets, len(sizes)))  # small: linear
    found = [function(*(np.array(values) + one)) for one in noise]
    e, v = (np.array(part).reshape(sets, -1).T for part in zip(*found, strict=True))
    error = (e - data.restitution[:, None]) - SLOPE * (v - data.velocity[:, None])
    white = covariance.whiten(error) / 0.05
    sample = white @ white.T / sets
    allowed = 4 * np.sqrt((1 + np.eye(len(sample))) / sets)
    np.testing.assert_array_less(np.abs(sample - np.eye(len(sample))), allowed)


def test_standard_uncertainties_by_hand():
    heights = data_of("heights", *CASES["heights"][1:])
    e = np.sqrt(0.8)
    # ε/2 √((0.002/0.4)² + (0.001/0.5)²); v/2 · 0.001/0.5
    expected = e / 2 * np.hypot(0.005, 0.002)
    np.testing.assert_allclose(heights.uncertainty, [expected], rtol=1e-12)
    np.testing.assert_allclose(heights.velocity_uncertainty, [3.131557120 * 0.001], rtol=1e-9)
    trains = data_of("intervals", [0.5, 0.4, 0.3], [0.01, 0.02, 0.03])
    expected = [np.hypot(0.02, 0.8 * 0.01) / 0.5, np.hypot(0.03, 0.75 * 0.02) / 0.4]
    np.testing.assert_allclose(trains.uncertainty, expected, rtol=1e-12)
    np.testing.assert_allclose(trains.velocity_uncertainty, [G * 0.005, G * 0.01], rtol=1e-12)


def test_consecutive_restitutions_share_an_interval():
    """ε₁ = t₂/t₁ and ε₂ = t₃/t₂: what makes t₂ long raises one and lowers the other."""
    data = data_of("intervals", [0.5, 0.4, 0.3], [0.01] * 3)
    dense = data.covariance_of().dense()
    assert dense.shape == (2, 2)
    assert dense[0, 1] == dense[1, 0] == pytest.approx(-(0.01**2) * (1 / 0.5) * (0.75 / 0.4))


def test_timing_that_is_not_told_is_one_unknown_size():
    table = {"interval": [0.5, 0.4, 0.3, 0.9, 0.8, 0.7], "launch": ["a"] * 3 + ["b"] * 3}
    unknown = RestitutionData.from_table(table)
    assert unknown.errors.size_is_unknown
    assert unknown.uncertainty is None
    known = RestitutionData.from_table(table, interval_uncertainty=0.002)
    given = unknown.covariance_of(SLOPE, size=0.002, added=1e-5).dense()
    np.testing.assert_allclose(given, known.covariance_of(SLOPE).dense() + 1e-5 * np.eye(4))
    linked = known.covariance_of().dense() != 0
    np.testing.assert_array_equal(linked, np.kron(np.eye(2), np.ones((2, 2))))
    with pytest.raises(DataError, match="`size` must be given where"):
        unknown.covariance_of()
    with pytest.raises(DataError, match=r"and only there, but is 0\.1"):
        known.covariance_of(size=0.1)


def test_timing_errors_stay_with_their_rows_where_some_are_not_used():
    """A launch of one interval comes first: its timing is nobody's."""
    sizes = [0.1, 0.001, 0.002, 0.003]
    table = {"interval": [0.9, 0.5, 0.4, 0.3], "launch": [1, 2, 2, 2], "u_t": sizes}
    data = RestitutionData.from_table(table)
    alone = data_of("intervals", table["interval"][1:], sizes[1:])
    assert data.errors.same_as(alone.errors)
    np.testing.assert_array_equal(data.errors.size, sizes[1:])


def test_uncertainties_of_points_come_on_top_of_what_is_shared():
    table = {"interval": [0.5, 0.4, 0.3], "velocity_uncertainty": [0.1, 0.2, np.nan]}
    alone = RestitutionData.from_table(table, interval_uncertainty=0.001)
    both = RestitutionData.from_table(table, interval_uncertainty=0.001, uncertainty=0.02)
    shared = RestitutionData.from_table({"interval": table["interval"]}, interval_uncertainty=0.001)
    extra = np.diag((SLOPE * np.array([0.1, 0.2])) ** 2)
    shared, alone, both = (d.covariance_of(SLOPE).dense() for d in (shared, alone, both))
    np.testing.assert_allclose(alone, shared + extra, rtol=1e-12)
    np.testing.assert_allclose(both, alone + 0.02**2 * np.eye(2), rtol=1e-12)
    data = RestitutionData.from_table(table, interval_uncertainty=0.001, uncertainty=0.02)
    assert "uncertainty is taken to come on top of that of the intervals" in data.remarks


def test_stated_restitution_errors_leave_no_timing_to_be_estimated():
    data = RestitutionData.from_table({"interval": [0.5, 0.4, 0.3]}, uncertainty=0.01)
    assert not data.errors.size_is_unknown
    np.testing.assert_array_equal(data.covariance_of(SLOPE).dense(), 1e-4 * np.eye(2))


def test_a_rebound_of_zero_height_is_as_uncertain_as_a_height_of_its_uncertainty():
    table = {"drop_height": [1.0, 1.0], "rebound_height": [0.0, 0.0025 / 4]}
    data = RestitutionData.from_table(table, rebound_height_uncertainty=0.0025)
    np.testing.assert_allclose(data.uncertainty, [0.05, 0.05])  # √(0.0025/1), the slope at u/4


@pytest.mark.parametrize("count", [1, 2, 3, 50])
def test_whitening_and_determinant_are_those_of_the_whole_matrix(count):
    times = np.cumsum(0.5 * 0.97 ** np.arange(count + 2))
    data = RestitutionData.from_table({"time": times}, time_uncertainty=2e-4, uncertainty=0.003)
    covariance = data.covariance_of(RNG.normal(size=count))
    dense = covariance.dense()
    r = RNG.normal(size=(count, 3))
    np.testing.assert_allclose(
        covariance.whiten(r).T @ covariance.whiten(r), r.T @ np.linalg.solve(dense, r), rtol=1e-8
    )
    assert covariance.log_determinant == pytest.approx(np.linalg.slogdet(dense)[1], rel=1e-10)
    np.testing.assert_allclose(covariance.diagonal, np.diag(dense), rtol=1e-14)
    np.testing.assert_allclose(covariance.whiten(r[:, 0]), covariance.whiten(r)[:, 0])


def test_points_in_any_order_have_the_same_covariances():
    data = data_of("times", *CASES["times"][1:])
    order = np.array([2, 0, 3, 1])
    e = data.errors
    alone = np.array([0.01, 0.02, 0.03, 0.04])
    data = replace(
        data,
        uncertainty=None,
        velocity_uncertainty=None,
        errors=replace(e, restitution_alone=alone, velocity_alone=alone[::-1].copy()),
    )
    e = data.errors
    moved = PointErrors(
        e.index[order],
        e.to_restitution[order],
        e.to_velocity[order],
        e.size,
        e.kind,
        alone[order],
        alone[::-1][order],
    )
    expected = data.covariance_of(SLOPE).dense()[np.ix_(order, order)]
    np.testing.assert_allclose(moved.covariance(SLOPE).dense(), expected, rtol=1e-14)
    r = RNG.normal(size=4)
    squares = [
        np.sum(c.whiten(x) ** 2)
        for c, x in ((data.covariance_of(SLOPE), r), (moved.covariance(SLOPE), r[order]))
    ]
    assert squares[0] == pytest.approx(squares[1])


def test_what_has_no_narrow_band_or_no_inverse_is_refused():
    common = np.array([[0, 1, -1], [0, 2, -1], [0, 3, -1], [0, 4, -1]])  # one scale for four points
    ones = np.ones(common.shape)
    with pytest.raises(DataError, match="of 3 points that follow each other"):
        PointErrors(common, ones, ones, np.ones(5))
    assert len(PointErrors(common[:3], ones[:3], ones[:3], np.ones(5))) == 3
    with pytest.raises(DataError, match="`covariance` must be positive definite"):
        PointErrors.alone(2).covariance().whiten(np.ones(2))
    assert PointErrors.alone(2).covariance(added=1.0).log_determinant == 0.0


@pytest.mark.long
def test_a_million_points_take_a_second_or_two():
    count = 1_000_000
    table = {"interval": 0.7 * 0.95 ** (np.arange(count) % 10), "launch": np.arange(count) // 10}
    data = RestitutionData.from_table(table, interval_uncertainty=1e-4)
    covariance = data.covariance_of(SLOPE)
    white = covariance.whiten(np.ones(len(data)))
    assert len(white) == len(data) == 900_000
    # all trains are alike: the quadratic form is that of one, 100 000 times
    one = RestitutionData.from_table(
        {"interval": table["interval"][:10]}, interval_uncertainty=1e-4
    )
    form = np.sum(one.covariance_of(SLOPE).whiten(np.ones(9)) ** 2)
    assert np.sum(white**2) == pytest.approx(1e5 * form, rel=1e-9)
