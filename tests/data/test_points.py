"""A set of data from arrays and tables: what it keeps, compares, prints and averages, and how errors reach ε and v."""

import inspect
import math
from dataclasses import replace
from decimal import Decimal

import jax
import numpy as np
import pandas
import pytest
from scipy import stats

import calibration as cal
import softjax as sj
from tests.covariance import covariance_of

PAIR = sj.Contact.between_spheres(sj.STAINLESS_STEEL, sj.STAINLESS_STEEL, 0.0127, 0.0127)
READ = cal.RestitutionData.from_table


def test_arrays_are_copies_labels_have_their_order_and_print_tells_what_it_is():
    velocity = np.array([1, 2, 3], dtype=np.int32)
    data = cal.RestitutionData(velocity, [0.9, 0.8, Decimal("0.7")], uncertainty=0.01)
    velocity[0] = 7
    assert data.velocity.dtype == data.restitution.dtype == np.float64
    np.testing.assert_array_equal(data.velocity, [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(data.uncertainty, [0.01, 0.01, 0.01])
    for array in (data.velocity, data.errors.u_restitution):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0
    table = {"velocity [cm/s]": [12, 29], "restitution": [0.9, 0.8], "group": ["a", "b"]}
    assert READ(pandas.DataFrame(table), PAIR) == READ(table, PAIR)
    data = cal.RestitutionData([1.0, 2.0, 3.0], [0.9, 0.8, 0.7], group=[7, 2.0, 7])
    assert list(data.group) == ["7", "2", "7"]
    assert data.groups == ("7", "2")
    np.testing.assert_array_equal(data.group_index, [0, 1, 0])
    assert cal.RestitutionData([1.0], [0.9]).groups == ()
    text = repr(cal.RestitutionData([0.1, 2.0], [0.9, 0.8], PAIR, name="my alloy"))
    for words in ["my alloy", "2 points", "0.1 to 2 m/s", "0.8 to 0.9", "not stated", "with con"]:
        assert words in text
    grouped = repr(cal.RestitutionData([0.1, 2.0], [0.9, 0.8], group=["a", "b"], uncertainty=0.01))
    assert "2 groups" in grouped
    assert "not stated" not in grouped
    assert "no contact" in grouped


def test_what_a_set_and_a_parameter_take_by_position():
    fields = (
        "velocity restitution contact uncertainty name velocity_uncertainty limit_velocity remarks"
    )
    for made, names in ((cal.RestitutionData, fields), (cal.Parameter, "value")):
        taken = inspect.signature(made).parameters.values()
        assert [one.name for one in taken if one.kind != one.KEYWORD_ONLY] == names.split()


def test_sets_that_differ_in_one_thing_differ_and_errors_are_one_statement():
    fields = {"velocity": [0.1, 2.0], "restitution": [0.9, 0.8], "contact": PAIR, "uncertainty": 0.01}  # fmt: skip
    same = cal.RestitutionData(**fields)
    assert same == cal.RestitutionData(**fields)
    other = sj.Contact.between_spheres(sj.NYLON, sj.NYLON, 0.0127, 0.0127)
    changed = {"velocity": [0.1, 2.1], "restitution": [0.9, 0.7], "velocity_uncertainty": 0.1}
    changed |= {"name": "b", "limit_velocity": 300.0, "group": ["x", "x"], "degrees": 3}
    pairs = [*changed.items(), ("remarks", ("x",)), ("contact", None), ("contact", other)]
    for name, value in (*pairs, ("uncertainty", None), ("uncertainty", [0.01, 0.02])):
        assert same != cal.RestitutionData(**fields | {name: value}), name
    errors = cal.PointErrors.independent(2, np.array([0.01, 0.02]), np.array([0.1, 0.2]))
    data = cal.RestitutionData([1.0, 2.0], [0.9, 0.8], errors=errors)
    stated = {"uncertainty": [0.01, 0.02], "velocity_uncertainty": [0.1, 0.2]}
    assert data == cal.RestitutionData([1.0, 2.0], [0.9, 0.8], **stated)
    assert replace(data, contact=PAIR).errors is errors
    again = replace(data, uncertainty=0.03, errors=None)
    np.testing.assert_array_equal(again.uncertainty, [0.03, 0.03])
    # variance of each point: u² + (dε/dv u_v)²
    expected = [0.01**2 + (2 * 0.1) ** 2, 0.02**2 + (3 * 0.2) ** 2]
    np.testing.assert_allclose(np.diag(covariance_of(data, [2.0, 3.0])), expected, rtol=1e-12)


def test_one_limit_velocity_absurd_numbers_and_restitutions_above_one():
    data = cal.RestitutionData([1.0], [0.9], PAIR)
    assert data.limit_velocity == pytest.approx(math.sqrt(3 * 3.10e8 / 8030), rel=1e-14)
    stated = cal.RestitutionData([1.0], [0.9], PAIR, limit_velocity=250)
    assert stated.limit_velocity == stated.contact.limit_velocity == 250.0
    assert stated.contact.yield_strength == PAIR.yield_strength
    assert len(cal.RestitutionData([np.nextafter(2.0, 0.0)], [0.0], limit_velocity=2.0)) == 1
    huge = cal.RestitutionData([1e300, 1e-300], [1e-300, 0.0], uncertainty=[1e140, 1e-60])
    assert len(huge.averaged()) == 2
    data = cal.RestitutionData([1.0, 2.0], [0.9, 1.01], remarks=("seen",))
    assert data.restitution[1] == 1.01
    assert data.notes[0] == "seen"
    assert "1 of 2" in data.notes[1]
    assert "0.01" in data.notes[1]


def test_an_unknown_kind_of_reading_is_refused_and_another_set_differs_by_what_it_measured():
    with pytest.raises(cal.DataError, match=r"'velocities', 'heights'.*but is 'energies'"):
        replace(cal.PointErrors.independent(2), kind="energies")
    timed = cal.RestitutionData([1.0, 2.0], [0.9, 0.8], contact_time=[1e-5, math.nan])
    assert timed != cal.RestitutionData([1.0, 2.0], [0.9, 0.8])
    assert timed == cal.RestitutionData([1.0, 2.0], [0.9, 0.8], measured=timed.measured)
    longer = replace(timed, contact_time=2e-5)
    np.testing.assert_array_equal(longer.contact_time, [2e-5, 2e-5])
    assert longer.contact_time_uncertainty is None
    with pytest.raises(cal.DataError, match=r"`measured` must be of contact_time, .*heat"):
        cal.RestitutionData([1.0], [0.9], measured={"heat": [1.0]})


@pytest.mark.parametrize("name", ["interval", "time"])
def test_two_launches(name):
    """By intervals, the uncertainty in the row of the first; by times, in the row of the bounce."""
    intervals = [np.array([0.8, 0.72, 0.648]), np.array([0.5, 0.4])]
    nan = math.nan
    if name == "interval":
        values, labels = np.concatenate(intervals), ["first"] * 3 + ["second"] * 2
        uncertainty = [0.01, 0.02, nan, 0.03, nan]
    else:
        values = np.concatenate([7 + np.cumsum([0, *part]) for part in intervals])
        labels = ["first"] * 4 + ["second"] * 3
        uncertainty = [nan, 0.01, 0.02, nan, nan, 0.03, nan]
    data = READ({name: values, "launch": labels, "uncertainty": uncertainty})
    # 9.80665 · t/2 of all but each launch's last
    np.testing.assert_allclose(data.velocity, [3.92266, 3.530394, 2.4516625], rtol=1e-13)
    np.testing.assert_allclose(data.restitution, [0.9, 0.9, 0.8], rtol=1e-12)
    np.testing.assert_array_equal(data.uncertainty, [0.01, 0.02, 0.03])
    assert list(data.group) == ["first", "first", "second"]


def test_bounces_follow_each_other_within_a_launch():
    """Up to 1.3 times the interval before, which noise may bring; a label that comes back is another launch."""
    data = READ({"interval": [0.8, 0.4, 0.519]}, uncertainty=0.1)
    np.testing.assert_allclose(data.restitution, [0.5, 1.2975], rtol=1e-14)
    assert data.group is None
    table = {"interval": [0.4, 0.36, 0.4, 0.32, 0.8, 0.72], "launch": [1, 1, 2, 2, 1, 1]}
    data = READ(table)
    np.testing.assert_allclose(data.restitution, [0.9, 0.8, 0.9], rtol=1e-14)
    assert (len(data.groups), data.groups[:2]) == (3, ("1", "2"))
    balls = READ(table | {"group": ["ball a"] * 4 + ["ball b"] * 2})
    assert list(balls.group) == ["ball a", "ball a", "ball b"]
    for short in (
        {"interval": [0.4, 0.36, 0.5], "launch": [1, 1, 2]},
        {"time": [0.0, 0.4, 0.76, 0.0, 0.4], "launch": [1, 1, 1, 2, 2]},
    ):  # a launch that gives no restitution is noted
        data = READ(short)
        np.testing.assert_allclose(data.restitution, [0.9], rtol=1e-12)
        what = "a single interval" if "interval" in short else "fewer than three bounces"
        assert f"1 launch(es) of {what} give no restitution and are not used" in data.remarks


EMBEDDED = {  # Table 1 of Zhou (2013): σ, ψ, and where the panels of Fig. 2 end [v_cr]
    "stainless steel": (sj.STAINLESS_STEEL, 3.0432, 0.5400, 250),
    "chrome steel": (sj.CHROME_STEEL, 0.1418, 0.3114, 25),
    "nylon": (sj.NYLON, 0.4355, 0.5414, 80),
}


def test_the_embedded_data_are_eq_17_over_the_ranges_of_the_paper():
    found = cal.paper_materials()
    assert [data.name for data in found] == list(EMBEDDED)
    for data, (body, sigma, psi, end) in zip(found, EMBEDDED.values(), strict=True):
        contact = sj.Contact.between_spheres(body, body, 0.0127, 0.0127, area="zhou")
        assert data.contact == contact
        assert data.remarks == (cal.PAPER_NOTE,)
        v = float(contact.critical_velocity) * np.linspace(1, end, 41)[1:]
        np.testing.assert_allclose(data.velocity, v, rtol=1e-13)
        y = v / (float(contact.limit_velocity) - v)
        np.testing.assert_allclose(data.restitution, np.exp(-sigma * y**psi), rtol=1e-13)


@pytest.mark.parametrize("count", [1, 5, 30])
def test_one_gross_error_is_refused_by_its_place(count):
    velocity = np.arange(1.0, count + 1)
    restitution = 0.95 + 0.01 * np.sin(7 * velocity)
    restitution[: count // 2] *= 0.05  # of percents the largest tells
    restitution[count // 2] = 1.501
    assert len(cal.RestitutionData(velocity, np.minimum(restitution, 1.5))) == count
    with pytest.raises(cal.DataError, match=rf"restitution\[{count // 2}\]"):
        cal.RestitutionData(velocity, restitution)
    with pytest.raises(cal.DataError, match=r"percent.*\[%\]"):
        cal.RestitutionData(velocity, 100 * restitution)


@pytest.mark.parametrize(
    ("before", "after", "most"), [("v_in", "v_out", 1.25), ("h0", "hf", 1.25**2)]
)
def test_a_rebound_may_be_faster_by_a_quarter(before, after, most):
    assert READ({before: [2.0], after: [1.999 * most]}).restitution[0] > 1
    with pytest.raises(cal.DataError, match="in the same unit, and in this order"):
        READ({before: [2.0], after: [2.001 * most]})


# repeats at one velocity, averaged

VELOCITIES = [2.0, 1.0, 1.0, 2.0, 1.0, 3.0]
REPEATED = {"velocity": VELOCITIES, "restitution": [0.80, 0.90, 0.92, 0.84, 0.94, 0.70]}
POOLED = math.sqrt(0.0016 / 3)  # s² = (2 · 0.02² of three + 0.04²/2 of two) / 3


def test_repeats_are_averaged_with_the_scatter_of_all_or_by_weight_and_within_groups():
    data = cal.RestitutionData(**REPEATED, contact=PAIR, name="steel").averaged()
    np.testing.assert_array_equal(data.velocity, [1.0, 2.0, 3.0])
    np.testing.assert_allclose(data.restitution, [0.92, 0.82, 0.70], rtol=1e-14)
    expected = [POOLED / math.sqrt(3), POOLED / math.sqrt(2), POOLED]
    np.testing.assert_allclose(data.uncertainty, expected, rtol=1e-12)
    assert data.degrees == 3  # six readings less three velocities
    assert (data.name, data.contact) == ("steel", PAIR)
    stated = {"uncertainty": [0.01, 0.02, 0.03], "velocity_uncertainty": 0.1}
    data = cal.RestitutionData([1.0, 1.0, 2.0], [0.9, 0.8, 0.7], **stated).averaged()
    # (0.9 · 10⁴ + 0.8 · 2500)/12500, 1/√12500; velocities have the weights of their restitutions
    np.testing.assert_allclose(data.restitution, [0.88, 0.7], rtol=1e-14)
    np.testing.assert_allclose(data.uncertainty, [0.00894427191, 0.03], rtol=1e-9)
    expected = [0.1 * math.hypot(0.8, 0.2), 0.1]
    np.testing.assert_allclose(data.velocity_uncertainty, expected, rtol=1e-12)
    assert data.degrees is None
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


def test_what_a_point_shares_between_its_two_numbers_outlives_averaging():
    """Three drops from one height: the mean's covariance of (ε, v) is that of a weighted mean."""
    table = {"drop_height": [0.5] * 3 + [1.0], "rebound_height": [0.40, 0.41, 0.39, 0.7]}
    sizes = {"drop_height_uncertainty": 0.004, "rebound_height_uncertainty": 0.003}
    data = READ(table, **sizes)
    mean, slope = data.averaged(), -0.1
    weight = data.uncertainty[:3] ** -2 / np.sum(data.uncertainty[:3] ** -2)
    single = np.diag(covariance_of(data, slope))
    expected = [weight**2 @ single[:3], single[3]]
    np.testing.assert_allclose(np.diag(covariance_of(mean, slope)), expected, rtol=1e-12)
    apart = mean.uncertainty[0] ** 2 + (slope * mean.velocity_uncertainty[0]) ** 2
    assert expected[0] < 0.7 * apart  # a drop from higher up lowers ε and raises v


def test_what_is_not_averaged():
    single = cal.RestitutionData([2.0, 1.0], [0.8, 0.9]).averaged()
    np.testing.assert_array_equal(single.velocity, [1.0, 2.0])
    np.testing.assert_array_equal(single.restitution, [0.9, 0.8])
    alike = cal.RestitutionData([1.0] * 3 + [2.0], [0.1 + 0.2] * 3 + [0.8]).averaged()
    for data in (single, alike):
        assert (data.uncertainty, data.degrees) == (None, None)
    single = {"interval": [0.8, 0.72, 0.8, 0.7], "launch": [1, 1, 2, 2], "group": ["x"] * 4}
    assert len(READ(single).averaged()) == 1  # nothing is shared
    longer = {"interval": [0.8, 0.72, 0.65, 0.8, 0.7], "launch": [1, 1, 1, 2, 2]}
    with pytest.raises(cal.DataError, match=r"repeats.*sequences"):
        READ(longer).averaged()
    radius = np.array([0.001, 0.01])
    pair = sj.Contact.between_spheres(sj.NYLON, sj.NYLON, radius, radius)
    with pytest.raises(ValueError, match=r"contact.*single numbers"):
        cal.RestitutionData([1.0, 2.0], [0.9, 0.8], pair).averaged()


G = 9.80665
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
    one = READ({"drop_height": [1.0], "rebound_height": [0.64]}, rebound_height_uncertainty="5 mm")
    np.testing.assert_allclose(one.uncertainty, [0.005 / (2 * 0.8)], rtol=1e-12)
    assert one.velocity_uncertainty is None
    table = {"drop_height": [1.0, 1.0], "rebound_height": [0.0, 0.0025 / 4]}
    data = READ(table, rebound_height_uncertainty=0.0025)
    np.testing.assert_allclose(data.uncertainty, [0.05, 0.05])  # √(0.0025/1), the slope at u/4
    exact = READ(table, drop_height_uncertainty=0.001)  # ε/2 of its relative uncertainty
    np.testing.assert_allclose(exact.uncertainty, [0.0, 0.0125 * 0.001], rtol=1e-12)
    assert READ(table).uncertainty is None


def test_timing_that_is_not_told_is_one_unknown_size():
    table = {"interval": [0.5, 0.4, 0.3, 0.9, 0.8, 0.7], "launch": ["a"] * 3 + ["b"] * 3}
    unknown, known = READ(table), READ(table, interval_uncertainty=0.002)
    assert unknown.uncertainty is None
    given = covariance_of(unknown, SLOPE, size=0.002, added=1e-5)
    np.testing.assert_allclose(given, covariance_of(known, SLOPE) + 1e-5 * np.eye(4))
    linked = covariance_of(known) != 0
    np.testing.assert_array_equal(linked, np.kron(np.eye(2), np.ones((2, 2))))
    # a launch of one interval comes first: its timing is nobody's
    first, timing = {"interval": [0.9, 0.5, 0.4, 0.3], "launch": [1, 2, 2, 2]}, [1e-3, 2e-3, 3e-3]
    alone = covariance_of(data_of("intervals", first["interval"][1:], timing), -1.0)
    found = covariance_of(READ(first | {"u_t": [0.1, *timing]}), -1.0)
    np.testing.assert_array_equal(found, alone)
    # ε₁ = t₂/t₁, ε₂ = t₃/t₂: what makes t₂ long raises one and lowers the other
    expected = -(0.002**2) * (1 / 0.5) * (0.75 / 0.4)
    assert covariance_of(known)[0, 1] == pytest.approx(expected, rel=1e-12)


def test_uncertainties_of_points_come_on_top_of_what_is_shared():
    table = {"interval": [0.5, 0.4, 0.3]}
    more = table | {"velocity_uncertainty": [0.1, 0.2, np.nan]}
    timing = {"interval_uncertainty": 0.001}
    sets = READ(table, **timing), READ(more, **timing), READ(more, **timing, uncertainty=0.02)
    shared, alone, both = (covariance_of(d, SLOPE) for d in sets)
    expected = shared + np.diag((SLOPE * np.array([0.1, 0.2])) ** 2)
    np.testing.assert_allclose(alone, expected, rtol=1e-12)
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
