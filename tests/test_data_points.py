"""A set of data from arrays: what it holds, what it refuses, and what it says of itself."""

import math
from dataclasses import replace
from decimal import Decimal

import numpy as np
import pytest

import softjax as sj
from calibration.data import PointErrors, RestitutionData
from calibration.errors import DataError, InputError, Origin

PAIR = sj.Contact.between_spheres(sj.STAINLESS_STEEL, sj.STAINLESS_STEEL, 0.0127, 0.0127)


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
        {"group": ["x", "x"]},
        {"degrees": 3},
        {"uncertainty": None, "errors": PointErrors.alone(2, np.array([0.01, 0.02]))},
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
    (
        {"name": " "},
        "`name` must be a text that is not empty, of 200 characters at most, but is ' '",
    ),
    ({"name": 3}, "`name` must be a text that is not empty, of 200 characters at most, but is 3"),
    ({"group": ["a"]}, "`group` must be as long as `velocity`, 2, but is 1 long"),
    ({"group": "ab"}, "`group` must be one label for each point, but is ab"),
    ({"group": ["a", " "]}, r"`group\[1\]` must be a label, .*, but is empty"),
    ({"group": ["a", None]}, r"`group\[1\]` must be a label, .*, but is empty"),
    ({"group": ["a", math.nan]}, r"`group\[1\]` must be a label, .*, but is empty"),
    ({"degrees": [1.0]}, "`degrees` must be of single numbers or 2 long like `velocity`"),
    ({"degrees": 0}, "`degrees` must be a positive number, but is 0"),
    ({"degrees": [1.0, -1.0]}, r"`degrees\[1\]` must be a positive number, but is -1"),
    ({"errors": PointErrors.alone(3)}, "`errors` must be of as many points as `velocity`, 2"),
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
    grouped = RestitutionData([0.1, 2.0], [0.9, 0.8], group=["a", "b"], uncertainty=0.01)
    assert "2 groups, uncertainty stated, no contact" in repr(grouped)


def test_groups_are_labels_in_the_order_of_their_appearance():
    data = RestitutionData([1.0, 2.0, 3.0], [0.9, 0.8, 0.7], group=[7, 2.0, 7])
    assert list(data.group) == ["7", "2", "7"]
    assert data.groups == ("7", "2")
    np.testing.assert_array_equal(data.group_index, [0, 1, 0])
    none = RestitutionData([1.0], [0.9])
    assert (none.group, none.groups, none.group_index) == (None, (), None)


def test_errors_and_the_two_uncertainties_are_one_statement():
    """What `replace` hands on is taken; another uncertainty beside the old errors is refused."""
    errors = PointErrors.alone(2, np.array([0.01, 0.02]), np.array([0.1, 0.2]))
    data = RestitutionData([1.0, 2.0], [0.9, 0.8], errors=errors)
    np.testing.assert_array_equal(data.uncertainty, [0.01, 0.02])
    np.testing.assert_array_equal(data.velocity_uncertainty, [0.1, 0.2])
    told = RestitutionData(
        [1.0, 2.0], [0.9, 0.8], None, [0.01, 0.02], velocity_uncertainty=[0.1, 0.2]
    )
    assert data == told
    moved = replace(data, contact=PAIR)
    assert moved.errors is errors
    with pytest.raises(DataError, match="`uncertainty` must be left out, or errors=None"):
        replace(data, uncertainty=0.03)
    again = replace(data, uncertainty=0.03, errors=None)
    np.testing.assert_array_equal(again.uncertainty, [0.03, 0.03])
    # variance of each point: u² + (dε/dv u_v)²
    expected = [0.01**2 + (2 * 0.1) ** 2, 0.02**2 + (3 * 0.2) ** 2]
    np.testing.assert_allclose(data.covariance_of([2.0, 3.0]).diagonal, expected, rtol=1e-12)


def test_restitutions_above_one_are_noted_and_never_clipped():
    data = RestitutionData([1.0, 2.0], [0.9, 1.01], remarks=("seen",))
    assert data.restitution[1] == 1.01
    assert data.notes[0] == "seen"
    assert data.notes[1].startswith("1 of 2 restitutions are above 1, by 0.01 at most")


def test_absurd_numbers_raise_no_warning():
    """Warnings are errors in these tests."""
    huge = RestitutionData([1e300, 1e-300], [1e-300, 0.0], uncertainty=[1e140, 1e-140])
    huge.averaged()
    huge.covariance_of(1e300)
    with pytest.raises(ValueError, match=r"`velocity\[0\]` must be a positive speed in m/s"):
        RestitutionData.from_table(
            {"drop_height": [1e308], "rebound_height": [1e308]}, gravity=1e10
        )
