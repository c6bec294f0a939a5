"""How errors of what was measured reach ε and v: against finite differences, formulas and drawn noise."""

import jax
import numpy as np
import pytest
from scipy import stats

import calibration as cal
from tests.covariance import covariance_of

G = 9.80665
SLOPE = -0.05  # dε/dv [s/m]
READ = cal.RestitutionData.from_table


def of_velocities(before, after):
    return after / before, before


def of_heights(drop, rebound):
    return np.sqrt(rebound / drop), np.sqrt(2 * G * drop)


def of_intervals(*intervals):
    t = np.array(intervals)
    return t[1:] / t[:-1], G * t[:-1] / 2


def of_times(*times):
    return of_intervals(*np.diff(times))


# the test's own function, what was measured, and an uncertainty of its own for each number
CASES = {
    "velocities": (of_velocities, [2.0, 1.7], [0.02, 0.03]),
    "heights": (of_heights, [0.5, 0.4], [0.001, 0.002]),
    "intervals": (of_intervals, [0.7, 0.62, 0.56, 0.5, 0.46], [1e-3, 2e-3, 3e-3, 1e-3, 2e-3]),
    "times": (of_times, [0.1, 0.8, 1.42, 1.98, 2.48, 2.94], [1e-3, 2e-3, 3e-3, 1e-3, 2e-3, 1e-3]),
}


def data_of(kind, values, sizes):
    names = {"velocities": ("v_in", "v_out"), "heights": ("h0", "h_rebound")}.get(kind)
    if names is None:
        return READ({kind.removesuffix("s"): values, f"u_{kind.removesuffix('s')}": sizes})
    table = {name: [x] for name, x in zip(names, values, strict=True)}
    return READ(table | {f"u_{name}": [u] for name, u in zip(names, sizes, strict=True)})


@pytest.mark.parametrize("kind", CASES)
def test_errors_enter_as_finite_differences_have_it(kind):
    """Covariance of δε − slope δv for independent errors; and the two uncertainties alone."""
    function, values, sizes = CASES[kind]
    data = data_of(kind, values, sizes)
    columns = {"ε": [], "v": []}
    for i, size in enumerate(sizes):
        step = np.zeros(len(values))
        step[i] = 1e-6 * values[i]
        ends = [function(*(values + sign * step)) for sign in (1, -1)]
        for j, part in enumerate(columns.values()):
            part.append(np.atleast_1d(size * (ends[0][j] - ends[1][j]) / (2 * step[i])))
    to_eps, to_v = (np.stack(part, axis=1) for part in columns.values())
    both = to_eps - SLOPE * to_v
    close = {"rtol": 1e-6, "atol": 1e-14}
    np.testing.assert_allclose(covariance_of(data, SLOPE), both @ both.T, **close)
    np.testing.assert_allclose(data.uncertainty, np.linalg.norm(to_eps, axis=1), **close)
    np.testing.assert_allclose(data.velocity_uncertainty, np.linalg.norm(to_v, axis=1), **close)


def test_one_uncertainty_of_both_numbers_or_of_one_and_of_a_rebound_of_zero_height():
    """`velocity_uncertainty` beside two velocities is of both; what has none is exact."""
    speeds = {"v_in": [2.0, 4.0], "v_out": [1.8, 3.2]}
    both = READ(speeds, velocity_uncertainty=0.02)
    # √(0.02² + (ε 0.02)²)/v_in
    np.testing.assert_allclose(both.uncertainty, [0.01 * np.sqrt(1.81), 0.005 * np.sqrt(1.64)])
    np.testing.assert_allclose(both.velocity_uncertainty, [0.02, 0.02])
    apart = READ(speeds, impact_velocity_uncertainty=0.02, rebound_velocity_uncertainty=0.02)
    np.testing.assert_array_equal(covariance_of(apart, SLOPE), covariance_of(both, SLOPE))
    assert any("both" in remark for remark in both.remarks)
    one = READ({"drop_height": [1.0], "rebound_height": [0.64]}, rebound_height_uncertainty="5 mm")
    np.testing.assert_allclose(one.uncertainty, [0.005 / (2 * 0.8)], rtol=1e-12)
    assert one.velocity_uncertainty is None
    assert any("drop_height" in remark and "exact" in remark for remark in one.remarks)
    table = {"drop_height": [1.0, 1.0], "rebound_height": [0.0, 0.0025 / 4]}
    data = READ(table, rebound_height_uncertainty=0.0025)
    np.testing.assert_allclose(data.uncertainty, [0.05, 0.05])  # √(0.0025/1), the slope at u/4
    exact = READ(table)
    assert exact.uncertainty is None


def test_timing_that_is_not_told_is_one_unknown_size():
    table = {"interval": [0.5, 0.4, 0.3, 0.9, 0.8, 0.7], "launch": ["a"] * 3 + ["b"] * 3}
    unknown, known = READ(table), READ(table, interval_uncertainty=0.002)
    assert unknown.uncertainty is None
    given = covariance_of(unknown, SLOPE, size=0.002, added=1e-5)
    np.testing.assert_allclose(given, covariance_of(known, SLOPE) + 1e-5 * np.eye(4))
    linked = covariance_of(known) != 0
    np.testing.assert_array_equal(linked, np.kron(np.eye(2), np.ones((2, 2))))
    # a launch of one interval comes first: its timing is nobody's
    first = {
        "interval": [0.9, 0.5, 0.4, 0.3],
        "launch": [1, 2, 2, 2],
        "u_t": [0.1, 1e-3, 2e-3, 3e-3],
    }
    alone = covariance_of(data_of("intervals", [0.5, 0.4, 0.3], first["u_t"][1:]), -1.0)
    np.testing.assert_array_equal(covariance_of(READ(first), -1.0), alone)
    # ε₁ = t₂/t₁, ε₂ = t₃/t₂: what makes t₂ long raises one and lowers the other
    expected = -(0.002**2) * (1 / 0.5) * (0.75 / 0.4)
    assert covariance_of(known)[0, 1] == pytest.approx(expected, rel=1e-12)


def test_uncertainties_of_points_come_on_top_of_what_is_shared():
    table = {"interval": [0.5, 0.4, 0.3]}
    more = table | {"velocity_uncertainty": [0.1, 0.2, np.nan]}
    timing = {"interval_uncertainty": 0.001}
    sets = READ(table, **timing), READ(more, **timing), READ(more, **timing, uncertainty=0.02)
    shared, alone, both = (covariance_of(d, SLOPE) for d in sets)
    np.testing.assert_allclose(
        alone, shared + np.diag((SLOPE * np.array([0.1, 0.2])) ** 2), rtol=1e-12
    )
    np.testing.assert_allclose(both, alone + 0.02**2 * np.eye(2), rtol=1e-12)
    assert any("is added to" in data for data in sets[2].remarks)
    # stated for each ε and nothing of the timing: nothing is left to be estimated
    stated = covariance_of(READ(table, uncertainty=0.01), SLOPE)
    np.testing.assert_array_equal(stated, 1e-4 * np.eye(2))


def test_points_in_any_order_have_the_same_covariances():
    index = np.array([[0, 1, -1], [1, 2, -1], [2, 3, -1], [-1, -1, -1]])
    to_eps, to_v = np.array([[1.0, 2, 0], [3, 4, 0], [5, 6, 0], [0, 0, 0]]), np.zeros((4, 3))
    alone, eps = np.array([0.1, 0.2, 0.3, 0.4]), np.array([0.3, 0.5, 0.8, 0.4])
    # C_ij = Σ f_i f_j u² of the errors in common
    expected = np.diag(alone**2 + [5, 25, 61, 0])
    expected[0, 1] = expected[1, 0] = 2 * 3
    expected[1, 2] = expected[2, 1] = 4 * 5
    whole = stats.multivariate_normal(np.full(4, 0.6), expected).logpdf(eps)
    for order in ([0, 1, 2, 3], [2, 0, 3, 1]):
        parts = index[order], to_eps[order], to_v, np.ones(4), "times", alone[order]
        data = cal.RestitutionData(np.arange(1.0, 5.0), eps[order], errors=cal.PointErrors(*parts))
        np.testing.assert_allclose(covariance_of(data), expected[np.ix_(order, order)], rtol=1e-14)
        found = jax.jit(cal.problem(data, "constant").log_likelihood)({"restitution": 0.6})
        assert found == pytest.approx(whole, rel=1e-12)
