"""Tables of measured columns from Python: what becomes of them, in numbers worked out by hand."""

import math

import numpy as np
import pytest

import softjax as sj
from calibration.data import RestitutionData
from calibration.errors import DataError

PAIR = sj.Contact.between_spheres(sj.STAINLESS_STEEL, sj.STAINLESS_STEEL, 0.0127, 0.0127)


class Frame:
    """What a data frame offers: named columns, each an array-like."""

    def __init__(self, columns):
        self._columns = {name: np.asarray(values) for name, values in columns.items()}
        self.columns = list(columns)

    def __getitem__(self, name):
        return self._columns[name]


def test_a_frame_serves_as_a_mapping_does():
    table = {"velocity [cm/s]": [12, 29, 57], "restitution": [0.9, 0.8, 0.7]}
    table["velocity_uncertainty [mm/s]"] = [1.0, 2.0, 3.0]
    for source in (table, Frame(table)):
        data = RestitutionData.from_table(source, PAIR)
        # the doubles nearest to 0.12, ..., so that repeats in other units meet
        np.testing.assert_array_equal(data.velocity, [0.12, 0.29, 0.57])
        np.testing.assert_array_equal(data.velocity_uncertainty, [0.001, 0.002, 0.003])


def test_two_velocities():
    table = {"impact_velocity": [2.0, 4.0], "rebound_velocity": [1.8, 3.2]}
    data = RestitutionData.from_table(table)
    np.testing.assert_array_equal(data.velocity, [2.0, 4.0])
    np.testing.assert_allclose(data.restitution, [0.9, 0.8], rtol=1e-15)
    assert data.uncertainty is None
    both = RestitutionData.from_table(table, velocity_uncertainty=0.02)
    # √(0.02² + (ε 0.02)²)/v_in
    np.testing.assert_allclose(both.uncertainty, [0.01 * np.sqrt(1.81), 0.005 * np.sqrt(1.64)])
    np.testing.assert_allclose(both.velocity_uncertainty, [0.02, 0.02])
    (remark,) = both.remarks
    assert remark.startswith("velocity_uncertainty is taken for that of both impact_velocity and")
    told = {"impact_velocity_uncertainty": 0.02, "rebound_velocity_uncertainty": 0.02}
    assert RestitutionData.from_table(table, **told).errors.same_as(both.errors)


@pytest.mark.parametrize(("before", "after"), [(1, -1), (-1, 1)])
def test_velocities_of_opposite_sign_are_speeds(before, after):
    table = {"v_in": [before * 2.0, before * 4.0], "v_out": [after * 1.8, after * 3.2]}
    data = RestitutionData.from_table(table)
    np.testing.assert_allclose(data.restitution, [0.9, 0.8], rtol=1e-15)
    assert "velocities of opposite sign are taken without it" in data.remarks
    table["v_out"][1] *= -1
    with pytest.raises(
        DataError, match=r"`(rebound|impact)_velocity\[0\]` must be a (positive )?speed"
    ):
        RestitutionData.from_table(table)


def test_one_uncertainty_of_two_leaves_the_other_exact_and_says_so():
    table = {"drop_height": [1.0], "rebound_height": [0.64]}
    data = RestitutionData.from_table(table, rebound_height_uncertainty="5 mm")
    np.testing.assert_allclose(data.uncertainty, [0.005 / (2 * 0.8)], rtol=1e-12)
    assert data.velocity_uncertainty is None
    exact = "drop_height is taken for exact: no uncertainty of it is told"
    assert data.remarks == (exact, "velocities are those of free falls")


@pytest.mark.parametrize(("unit", "per_metre"), [("m", 1), ("cm", 100), ("mm", 1000)])
def test_heights(unit, per_metre):
    table = {
        f"drop_height [{unit}]": [1.0 * per_metre, 0.5 * per_metre],
        "rebound_height [m]": [0.81, 0.32],
    }
    data = RestitutionData.from_table(table, uncertainty=0.01, name="drops")
    # √(2 · 9.80665 · 1) and √(9.80665); √0.81 and √0.64
    np.testing.assert_allclose(data.velocity, [4.428690551, 3.131557120], rtol=1e-9)
    np.testing.assert_allclose(data.restitution, [0.9, 0.8], rtol=1e-14)
    moon = RestitutionData.from_table(table, gravity=1.62)
    np.testing.assert_allclose(moon.velocity, [1.8, 1.272792206], rtol=1e-9)


@pytest.mark.parametrize("name", ["interval", "time"])
def test_two_launches(name):
    """The same bounces told by their intervals, or by their times."""
    intervals = [np.array([0.8, 0.72, 0.648]), np.array([0.5, 0.4])]
    if name == "interval":
        values, labels = np.concatenate(intervals), ["first"] * 3 + ["second"] * 2
        uncertainty = [0.01, 0.02, math.nan, 0.03, math.nan]  # in the row of the first interval
    else:
        values = np.concatenate([7 + np.cumsum([0, *part]) for part in intervals])
        labels = ["first"] * 4 + ["second"] * 3
        uncertainty = [math.nan, 0.01, 0.02, math.nan, math.nan, 0.03, math.nan]  # of the bounce
    table = {f"{name} [ms]": 1000 * values, "launch": labels, "uncertainty": uncertainty}
    data = RestitutionData.from_table(table)
    # 9.80665 · t/2 of all but each launch's last
    np.testing.assert_allclose(data.velocity, [3.92266, 3.530394, 2.4516625], rtol=1e-13)
    np.testing.assert_allclose(data.restitution, [0.9, 0.9, 0.8], rtol=1e-12)
    np.testing.assert_array_equal(data.uncertainty, [0.01, 0.02, 0.03])
    assert list(data.group) == ["first", "first", "second"]
    assert data.remarks == ("velocities are those of free falls",)


def test_without_a_launch_column_all_bounces_follow_each_other():
    data = RestitutionData.from_table({"interval": [0.8, 0.4, 0.3]}, gravity=10.0)
    np.testing.assert_allclose(data.velocity, [4.0, 2.0], rtol=1e-15)
    np.testing.assert_allclose(data.restitution, [0.5, 0.75], rtol=1e-15)
    assert data.group is None


def test_a_label_that_comes_back_is_another_launch():
    """Two heights with launches 1 and 2 each: no ε between the last bounce and a new drop."""
    table = {"interval": [0.4, 0.36, 0.4, 0.32, 0.8, 0.72], "launch": [1, 1, 2, 2, 1, 1]}
    data = RestitutionData.from_table(table)
    np.testing.assert_allclose(data.restitution, [0.9, 0.8, 0.9], rtol=1e-14)
    assert list(data.group) == ["1", "2", "1 (2)"]
    table["group"] = ["ball a"] * 4 + ["ball b"] * 2
    assert list(RestitutionData.from_table(table).group) == ["ball a", "ball a", "ball b"]
    del table["launch"]
    assert len(RestitutionData.from_table(table | {"interval": [4, 3, 2, 1, 0.8, 0.72]})) == 4


def test_groups_stand_beside_any_kind_of_data():
    for table in (
        {"velocity": [1.0, 2.0], "restitution": [0.9, 0.8]},
        {"impact_velocity": [1.0, 2.0], "rebound_velocity": [0.9, 0.8]},
        {"drop_height": [1.0, 2.0], "rebound_height": [0.9, 0.8]},
    ):
        for name in ("group", "specimen", "launch"):
            assert RestitutionData.from_table(table | {name: ["x", "y"]}).groups == ("x", "y")
        assert RestitutionData.from_table(table, group=[1, 2]).groups == ("1", "2")
        both = table | {"group": ["x", "x"], "launch": ["a", "b"]}
        assert RestitutionData.from_table(both).groups == ("x",)


@pytest.mark.parametrize(
    ("table", "told"),
    [
        ({"interval": [0.4, 0.36, 0.5], "launch": [1, 1, 2]}, "1 launch(es) of a single interval"),
        (
            {"time": [0.0, 0.4, 0.76, 0.0, 0.4], "launch": [1, 1, 1, 2, 2]},
            "1 launch(es) of fewer than three bounces",
        ),
    ],
)
def test_launches_that_give_no_restitution_are_told(table, told):
    data = RestitutionData.from_table(table)
    np.testing.assert_allclose(data.restitution, [0.9], rtol=1e-12)
    assert data.remarks[0].startswith(told)


def test_rows_without_a_measurement_are_left_out_and_told():
    table = {"velocity": [1.0, 2.0, 3.0], "restitution": [0.9, math.nan, 0.7], "group": "abc"}
    table["group"] = list("abc")
    data = RestitutionData.from_table(table)
    np.testing.assert_array_equal(data.velocity, [1.0, 3.0])
    assert data.groups == ("a", "c")
    told = "1 row(s) without a measurement are left out, the first of them row 2"
    assert data.remarks == (told,)


def test_restitution_beside_a_pair_is_checked_and_used():
    heights = {"drop_height": [1.0, 1.0], "rebound_height": [0.81, 0.64]}
    data = RestitutionData.from_table(heights | {"restitution": [0.91, 0.79]})
    np.testing.assert_array_equal(data.restitution, [0.91, 0.79])
    timed = {"velocity": [4.4, 4.5], "restitution": [0.91, 0.79]}
    data = RestitutionData.from_table(heights | timed)
    np.testing.assert_array_equal(data.velocity, [4.4, 4.5])
    speeds = {"v_in": [2.0, 4.0], "v_out": [1.8, 3.2], "e": [0.89, 0.81]}
    np.testing.assert_array_equal(RestitutionData.from_table(speeds).restitution, [0.89, 0.81])
    speeds["e"][1] = 0.7
    with pytest.raises(DataError, match=r"`restitution\[1\]` must be rebound_velocity/impact_vel"):
        RestitutionData.from_table(speeds)


@pytest.mark.parametrize("with_velocity", [False, True])
@pytest.mark.parametrize(
    "root", [[0.9, 0.8, 0.5], [0.99, 0.985, 0.98]], ids=["far from one", "near one"]
)
def test_a_ratio_of_heights_given_as_restitution_is_noticed(with_velocity, root):
    root = np.array(root)
    table = {"drop_height": np.ones(3), "rebound_height": root**2}
    if with_velocity:
        table["velocity"] = np.full(3, 4.4)
    good = table | {"restitution": np.round(root, 3)}
    np.testing.assert_array_equal(RestitutionData.from_table(good).restitution, np.round(root, 3))
    slip = table | {"restitution": np.round(root**2, 3)}
    with pytest.raises(DataError, match=r"`restitution\[0\]` must be √.*but is .*the ratio of"):
        RestitutionData.from_table(slip)


def test_one_slip_among_good_points_is_noticed_and_noise_is_not():
    heights = {"drop_height": np.ones(4), "rebound_height": [0.81, 0.64, 0.98, 0.96]}
    noisy = [0.91, 0.79, 0.984, 0.985]  # the third is nearer to the ratio, by noise
    assert len(RestitutionData.from_table(heights | {"restitution": noisy})) == 4
    with pytest.raises(DataError, match=r"`restitution\[1\]` .*the ratio of the heights"):
        RestitutionData.from_table(heights | {"restitution": [0.91, 0.64, 0.984, 0.985]})
    with pytest.raises(DataError, match=r"`restitution\[0\]` .*not what stands beside it"):
        RestitutionData.from_table(heights | {"restitution": [0.5, 0.79, 0.984, 0.985]})
