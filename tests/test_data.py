"""Measurements from Python: units, conversions, rules, repeats; numbers worked out by hand."""

import math
from decimal import Decimal

import numpy as np
import pytest
from calibration.table import parse_header

import softjax as sj
from calibration.data.measurements import RestitutionData
from calibration.errors import DataError, InputError, Origin

PAIR = sj.Contact.between_spheres(sj.STAINLESS_STEEL, sj.STAINLESS_STEEL, 0.0127, 0.0127)


class Frame:
    """What a data frame offers: named columns, each an array-like."""

    def __init__(self, columns):
        self._columns = {name: np.asarray(values) for name, values in columns.items()}
        self.columns = list(columns)

    def __getitem__(self, name):
        return self._columns[name]


def test_arrays_are_held_as_float64_copies_that_cannot_be_written():
    velocity = np.array([1, 2, 3], dtype=np.int32)
    data = RestitutionData(velocity, [0.9, 0.8, Decimal("0.7")], uncertainty=0.01)
    velocity[0] = 7
    assert data.velocity.dtype == data.restitution.dtype == np.float64
    np.testing.assert_array_equal(data.velocity, [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(data.uncertainty, [0.01, 0.01, 0.01])
    assert len(data) == 3
    with pytest.raises(ValueError, match="read-only"):
        data.velocity[0] = 0.0


def test_equality_looks_at_everything_but_the_origin():
    def build(**changes):
        fields = {"velocity": [0.1, 2.0], "restitution": [0.9, 0.8], "contact": PAIR}
        return RestitutionData(**(fields | {"uncertainty": 0.01, "name": "a"} | changes))

    other_pair = sj.Contact.between_spheres(sj.NYLON, sj.NYLON, 0.0127, 0.0127)
    assert build() == build(origin=Origin("a.csv", 1, (2, 3)))
    for changes in (
        {"velocity": [0.1, 2.1]},
        {"restitution": [0.9, 0.7]},
        {"uncertainty": None},
        {"uncertainty": [0.01, 0.02]},
        {"velocity_uncertainty": 0.1},
        {"name": "b"},
        {"contact": None},
        {"contact": other_pair},
        {"limit_velocity": 300.0},
    ):
        assert build() != build(**changes), changes


def test_one_limit_velocity_in_the_contact_and_beside_it():
    data = RestitutionData([1.0], [0.9], PAIR)
    # sqrt(3 * 3.10e8 / 8030)
    assert data.limit_velocity == pytest.approx(340.317045, rel=1e-8)
    told = RestitutionData([1.0], [0.9], PAIR, limit_velocity=250)
    assert told.limit_velocity == told.contact.limit_velocity == 250.0
    assert told.contact.yield_strength == PAIR.yield_strength
    assert RestitutionData([1.0], [0.9], limit_velocity=250.0).contact is None
    assert RestitutionData([1.0], [0.9]).limit_velocity is None


def test_a_contact_of_other_bodies_at_each_impact():
    radius = np.array([0.001, 0.01])
    pair = sj.Contact.between_spheres(sj.NYLON, sj.NYLON, radius, radius)
    assert len(RestitutionData([1.0, 2.0], [0.9, 0.8], pair)) == 2
    with pytest.raises(ValueError, match="`contact` must be of single numbers or 3 long"):
        RestitutionData([1.0, 2.0, 3.0], [0.9, 0.8, 0.7], pair)
    with pytest.raises(ValueError, match="`contact` must be of single numbers for repeats"):
        RestitutionData([1.0, 2.0], [0.9, 0.8], pair).averaged()


@pytest.mark.parametrize(
    ("uncertainty", "allowed", "refused"),
    [
        (None, 1.0499999, 1.0500001),  # 0.05 above 1
        (0.01, 1.0299999, 1.0300001),  # 3 x 0.01
        ([0.1, 0.002], 1.0059999, 1.0060001),  # the point's own
    ],
)
def test_restitution_above_one_is_noise_up_to_a_bound(uncertainty, allowed, refused):
    data = RestitutionData([1.0, 2.0], [0.9, allowed], uncertainty=uncertainty)
    assert data.restitution[1] == allowed  # never clipped
    (note,) = data.notes
    assert note.startswith("1 of 2 restitutions are above 1")
    with pytest.raises(DataError, match=r"`restitution\[1\]` must be at most 1, or above it") as e:
        RestitutionData([1.0, 2.0], [0.9, refused], uncertainty=uncertainty)
    assert e.value.index == 1


def test_no_note_without_a_reason():
    assert RestitutionData([1.0, 2.0], [1.0, 0.0]).notes == ()


BAD_ARGUMENTS = [
    ({"velocity": [1.0, 0.0]}, r"`velocity\[1\]` must be a positive speed in m/s, but is 0"),
    ({"velocity": [-1.0, 1.0]}, r"`velocity\[0\]` must be a positive speed in m/s, but is -1"),
    ({"velocity": [1.0, math.nan]}, r"`velocity\[1\]` must be .*, but is nan"),
    ({"velocity": [math.inf, 1.0]}, r"`velocity\[0\]` must be .*, but is inf"),
    ({"velocity": [1.0]}, "`restitution` must be as long as `velocity`, 1, but is 2 long"),
    ({"velocity": 1.0}, r"`velocity` must be a one-dimensional array .* shape \(\)"),
    ({"velocity": []}, r"`velocity` must be a one-dimensional array .* shape \(0,\)"),
    ({"velocity": ["1", "2"]}, "`velocity` must be an array of real numbers"),
    ({"velocity": [1j, 2.0]}, "`velocity` must be an array of real numbers"),
    ({"velocity": [True, False]}, "`velocity` must be an array of real numbers"),
    ({"velocity": [None, "x"]}, "`velocity` must be an array of real numbers"),
    ({"limit_velocity": 2.0}, r"`velocity\[1\]` must be below the limit velocity, 2 m/s"),
    ({"limit_velocity": -2.0}, "`limit_velocity` must be a positive number, but is -2"),
    ({"limit_velocity": "fast"}, "`limit_velocity` must be a positive number, but is fast"),
    ({"restitution": [-1e-9, 0.5]}, r"`restitution\[0\]` must be a number of 0 or more"),
    ({"restitution": [0.5, math.nan]}, r"`restitution\[1\]` must be .*, but is nan"),
    ({"uncertainty": 0.0}, r"`uncertainty\[0\]` must be a positive number, but is 0"),
    ({"uncertainty": [0.1, -0.1]}, r"`uncertainty\[1\]` must be a positive number"),
    ({"uncertainty": [0.1]}, "`uncertainty` must be as long as `velocity`, 2, but is 1 long"),
    ({"uncertainty": "small"}, "`uncertainty` must be a number, or one for each point, but"),
    ({"velocity_uncertainty": -1.0}, r"`velocity_uncertainty\[0\]` must be a speed of 0 m/s"),
    ({"name": " "}, "`name` must be a text that is not empty, but is ' '"),
    ({"name": 3}, "`name` must be a text that is not empty, but is 3"),
    ({"contact": sj.NYLON}, "`contact` must be a softjax.Contact or None"),
]


@pytest.mark.parametrize(("changes", "message"), BAD_ARGUMENTS)
def test_arguments_that_make_no_sense_are_named(changes, message):
    fields = {"velocity": [1.0, 2.0], "restitution": [0.9, 0.8]} | changes
    with pytest.raises(ValueError, match=message):
        RestitutionData(**fields)


def test_velocity_at_the_limit_is_refused_and_just_below_is_not():
    below = np.nextafter(2.0, 0.0)
    assert len(RestitutionData([below], [0.0], limit_velocity=2.0)) == 1
    with pytest.raises(ValueError, match="below the limit velocity"):
        RestitutionData([2.0], [0.0], limit_velocity=2.0)


@pytest.mark.parametrize("unit", ["m/s", "cm/s", "mm/s"])
def test_units_of_velocity(unit):
    per_metre = {"m/s": 1, "cm/s": 100, "mm/s": 1000}[unit]
    table = {
        f"velocity [{unit}]": [0.12 * per_metre, 3 * per_metre],
        "restitution": [0.9, 0.8],
        f"velocity_uncertainty [{unit}]": [0.01 * per_metre, 0.02 * per_metre],
    }
    for source in (table, Frame(table)):
        data = RestitutionData.from_table(source, PAIR)
        np.testing.assert_allclose(data.velocity, [0.12, 3.0], rtol=1e-15)
        np.testing.assert_allclose(data.velocity_uncertainty, [0.01, 0.02], rtol=1e-15)


def test_hundredths_are_exact():
    """12 cm/s is the double nearest to 0.12 m/s, so that repeats in other units meet."""
    table = {"velocity [cm/s]": [12, 29, 57], "restitution": [0.9, 0.8, 0.7]}
    np.testing.assert_array_equal(RestitutionData.from_table(table).velocity, [0.12, 0.29, 0.57])


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


@pytest.mark.parametrize(("unit", "per_second"), [("s", 1), ("ms", 1000)])
def test_intervals_of_two_launches(unit, per_second):
    table = {
        f"interval [{unit}]": np.array([0.8, 0.72, 0.648, 0.5, 0.4]) * per_second,
        "launch": ["first"] * 3 + ["second"] * 2,
        "uncertainty": [0.01, 0.02, math.nan, 0.03, math.nan],  # the last of a launch is not read
    }
    data = RestitutionData.from_table(table)
    # 9.80665 · t/2 of all but each launch's last
    np.testing.assert_allclose(data.velocity, [3.92266, 3.530394, 2.4516625], rtol=1e-14)
    np.testing.assert_allclose(data.restitution, [0.9, 0.9, 0.8], rtol=1e-14)
    np.testing.assert_array_equal(data.uncertainty, [0.01, 0.02, 0.03])


def test_without_a_launch_column_all_intervals_follow_each_other():
    data = RestitutionData.from_table({"interval": [0.8, 0.4, 0.3]}, gravity=10.0)
    np.testing.assert_allclose(data.velocity, [4.0, 2.0], rtol=1e-15)
    np.testing.assert_allclose(data.restitution, [0.5, 0.75], rtol=1e-15)


def test_a_label_that_comes_back_is_another_launch():
    """Two heights with launches 1 and 2 each: no ε between the last bounce and a new drop."""
    table = {"interval": [0.4, 0.36, 0.4, 0.32, 0.8, 0.72], "launch": [1, 1, 2, 2, 1, 1]}
    data = RestitutionData.from_table(table)
    np.testing.assert_allclose(data.restitution, [0.9, 0.8, 0.9], rtol=1e-14)


def test_a_single_interval_is_remarked():
    table = {"interval": [0.4, 0.36, 0.5], "launch": [1, 1, 2]}
    data = RestitutionData.from_table(table)
    assert len(data) == 1
    assert data.notes == data.remarks
    assert data.notes[0].startswith("1 launch(es) of a single interval")


def test_restitution_beside_heights_is_used():
    heights = {"drop_height": [1.0, 1.0], "rebound_height": [0.81, 0.64]}
    data = RestitutionData.from_table(heights | {"restitution": [0.91, 0.79]})
    np.testing.assert_array_equal(data.restitution, [0.91, 0.79])
    timed = {"velocity": [4.4, 4.5], "restitution": [0.91, 0.79]}
    data = RestitutionData.from_table(heights | timed)
    np.testing.assert_array_equal(data.velocity, [4.4, 4.5])


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
    with pytest.raises(DataError, match=r"`restitution\[0\]` .*not what the heights give"):
        RestitutionData.from_table(heights | {"restitution": [0.5, 0.79, 0.984, 0.985]})


BAD_TABLES = [
    ({"velocity": [1.0]}, "`set of columns` must be velocity with restitution, .* is velocity"),
    ({"drop_height": [1.0], "restitution": [0.9]}, "`set of columns` must be"),
    ({"velocity": [1.0], "interval": [1.0]}, "`set of columns` must be"),
    ({}, "`set of columns` must be .*, but is empty"),
    ([[1.0, 0.9]], "`set of columns` must be .*, but is empty"),
    ({"velocty": [1.0], "restitution": [0.9]}, r"`column` must be one of .*mean 'velocity'\?"),
    ({"velocity [km/h]": [1.0]}, r"`unit of velocity` must be in m/s, cm/s, mm/s, .*\[km/h\]"),
    ({"launch [s]": [1.0]}, "`unit of launch` must be without a unit"),
    ({"velocity": [1.0], "velocity [cm/s]": [1.0]}, "`column` must be named once"),
    ({"velocity": [1.0, 2.0], "restitution": [0.9]}, "`restitution` must be as long as `velocity`"),
    ({"velocity": ["fast"], "restitution": [0.9]}, "`velocity` must be an array of real numbers"),
    ({"interval": [1.0, 0.0]}, r"`interval\[1\]` must be a positive time in s, but is 0"),
    ({"interval": [1.0]}, "`launch` must be of two or more"),
    ({"interval": [1.0, 2.0], "launch": [1, 2]}, "`launch` must be of two or more"),
    ({"drop_height": [0.0], "rebound_height": [0.1]}, r"`drop_height\[0\]` must be a positive"),
    ({"drop_height": [1.0], "rebound_height": [-0.1]}, r"`rebound_height\[0\]` must be a height"),
    ({"drop_height": [1.0], "rebound_height": [1.2]}, r"`restitution\[0\]` must be at most 1"),
]


@pytest.mark.parametrize(("table", "message"), BAD_TABLES)
def test_tables_that_make_no_sense(table, message):
    with pytest.raises(DataError, match=message):
        RestitutionData.from_table(table)


def test_what_would_be_ignored_or_given_twice_is_refused():
    table = {"velocity": [1.0], "restitution": [0.9], "uncertainty": [0.1]}
    with pytest.raises(DataError, match="`uncertainty` must be given once"):
        RestitutionData.from_table(table, uncertainty=0.1)
    with pytest.raises(DataError, match="`gravity` must be left out where velocities are given"):
        RestitutionData.from_table(table, gravity=9.81)
    for gravity in (0.0, -9.81, math.nan, "strong"):
        with pytest.raises(DataError, match="`gravity` must be a positive acceleration"):
            RestitutionData.from_table({"interval": [1.0, 0.9]}, gravity=gravity)


@pytest.mark.parametrize(
    ("header", "name", "divisor"),
    [
        ("velocity", "velocity", 1),
        (" Drop height [ mm ] ", "drop_height", 1000),
        ("restitution [-]", "restitution", 1),
        ("interval[ms]", "interval", 1000),
    ],
)
def test_headers(header, name, divisor):
    assert parse_header(header) == (name, divisor)


REPEATED = {
    "velocity": [2.0, 1.0, 1.0, 2.0, 1.0, 3.0],
    "restitution": [0.80, 0.90, 0.92, 0.84, 0.94, 0.70],
}


def test_repeats_are_averaged_with_their_standard_error():
    data = RestitutionData(**REPEATED, contact=PAIR, name="steel").averaged()
    np.testing.assert_array_equal(data.velocity, [1.0, 2.0, 3.0])
    np.testing.assert_allclose(data.restitution, [0.92, 0.82, 0.70], rtol=1e-14)
    # s = 0.02 of three, 0.04/√2 of two; 3 m/s takes s² = (2·0.0004 + 0.0008)/3
    expected = [0.02 / math.sqrt(3), 0.02, math.sqrt(0.0016 / 3)]
    np.testing.assert_allclose(data.uncertainty, expected, rtol=1e-12)
    assert (data.name, data.contact) == ("steel", PAIR)


def test_repeats_with_the_scatter_of_all():
    data = RestitutionData(**REPEATED).averaged(pooled=True)
    pooled = math.sqrt(0.0016 / 3)
    expected = [pooled / math.sqrt(3), pooled / math.sqrt(2), pooled]
    np.testing.assert_allclose(data.uncertainty, expected, rtol=1e-12)


def test_repeats_with_stated_uncertainties_are_weighted():
    data = RestitutionData(
        [1.0, 1.0, 2.0], [0.9, 0.8, 0.7], uncertainty=[0.01, 0.02, 0.03], velocity_uncertainty=0.1
    ).averaged()
    # (0.9 · 10⁴ + 0.8 · 2500)/12500, 1/√12500
    np.testing.assert_allclose(data.restitution, [0.88, 0.7], rtol=1e-14)
    np.testing.assert_allclose(data.uncertainty, [0.00894427191, 0.03], rtol=1e-9)
    np.testing.assert_allclose(data.velocity_uncertainty, [0.0707106781, 0.1], rtol=1e-9)


def test_averaging_without_repeats_or_scatter_finds_no_uncertainty():
    single = RestitutionData([2.0, 1.0], [0.8, 0.9]).averaged()
    np.testing.assert_array_equal(single.velocity, [1.0, 2.0])
    np.testing.assert_array_equal(single.restitution, [0.9, 0.8])
    assert single.uncertainty is None
    alike = RestitutionData([1.0] * 3 + [2.0], [0.1 + 0.2] * 3 + [0.8]).averaged()
    assert alike.uncertainty is None


def test_readings_alike_take_the_scatter_of_the_others():
    data = RestitutionData([1.0, 1.0, 2.0, 2.0], [0.9, 0.9, 0.8, 0.82]).averaged()
    # pooled s² = 0.0002/2 over √2; own s = 0.02/√2 over √2
    np.testing.assert_allclose(data.uncertainty, [math.sqrt(0.0001 / 2), 0.01], rtol=1e-12)


def test_refusals_name_file_and_line_where_there_is_one():
    data = RestitutionData([1.0, 2.0], [0.9, 0.8], name="a", origin=Origin("a.csv", 1, (2, 5)))
    error = data.refusal("2 points for 3 parameters", "4 or more are needed")
    assert str(error) == "a.csv:1: 2 points for 3 parameters; 4 or more are needed"
    assert str(data.refusal("odd", "even", 1)) == "a.csv:5: odd; even"
    plain = RestitutionData([1.0, 2.0], [0.9, 0.8], name="a").refusal("odd", "even")
    assert str(plain) == "a: odd; even"
    assert (plain.file, plain.line, plain.problem, plain.accepted) == (None, None, "a: odd", "even")


def test_an_origin_turns_every_refusal_into_file_and_line():
    origin = Origin("a.csv", 1, (2, 5))
    with pytest.raises(InputError) as caught:
        RestitutionData([1.0, 2.0], [0.9, -0.8], origin=origin)
    assert str(caught.value) == "a.csv:5: restitution is -0.8; it must be a number of 0 or more"


def test_printed_data_tells_what_it_is():
    text = repr(RestitutionData([0.1, 2.0], [0.9, 0.8], PAIR, name="my alloy"))
    assert text == (
        "RestitutionData('my alloy': 2 points, v 0.1 to 2 m/s, ε 0.8 to 0.9, "
        "uncertainty not stated, with contact)"
    )
