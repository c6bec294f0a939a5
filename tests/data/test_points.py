"""A set of data from arrays and tables: what it keeps, compares and prints."""

import math
from contextlib import suppress
from dataclasses import replace
from decimal import Decimal

import numpy as np
import pytest

import calibration as cal
import softjax as sj

PAIR = sj.Contact.between_spheres(sj.STAINLESS_STEEL, sj.STAINLESS_STEEL, 0.0127, 0.0127)
READ = cal.RestitutionData.from_table


class Frame:
    """What a data frame offers: named columns, each an array-like."""

    def __init__(self, table):
        self._table, self.columns = table, list(table)

    def __getitem__(self, name):
        return np.asarray(self._table[name])


def test_arrays_are_float64_copies_that_cannot_be_written():
    velocity = np.array([1, 2, 3], dtype=np.int32)
    data = cal.RestitutionData(velocity, [0.9, 0.8, Decimal("0.7")], uncertainty=0.01)
    velocity[0] = 7
    assert data.velocity.dtype == data.restitution.dtype == np.float64
    np.testing.assert_array_equal(data.velocity, [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(data.uncertainty, [0.01, 0.01, 0.01])
    with pytest.raises(ValueError, match="read-only"):
        data.velocity[0] = 0.0


def test_a_frame_serves_as_a_mapping_does():
    table = {"velocity [cm/s]": [12, 29], "restitution": [0.9, 0.8], "group": ["a", "b"]}
    assert READ(Frame(table), PAIR) == READ(table, PAIR)


@pytest.mark.parametrize(
    "changes",
    [
        {"velocity": [0.1, 2.1]},
        {"restitution": [0.9, 0.7]},
        {"uncertainty": None},
        {"uncertainty": [0.01, 0.02]},
        {"velocity_uncertainty": 0.1},
        {"name": "b"},
        {"contact": None},
        {"contact": sj.Contact.between_spheres(sj.NYLON, sj.NYLON, 0.0127, 0.0127)},
        {"limit_velocity": 300.0},
        {"group": ["x", "x"]},
        {"degrees": 3},
        {"remarks": ("x",)},
    ],
)
def test_sets_that_differ_in_one_thing_differ(changes):
    fields = {
        "velocity": [0.1, 2.0],
        "restitution": [0.9, 0.8],
        "contact": PAIR,
        "uncertainty": 0.01,
    }
    same = cal.RestitutionData(**fields)
    assert same == cal.RestitutionData(**fields)
    assert same != cal.RestitutionData(**(fields | changes))


def test_one_limit_velocity_in_the_contact_and_beside_it():
    data = cal.RestitutionData([1.0], [0.9], PAIR)
    assert data.limit_velocity == pytest.approx(math.sqrt(3 * 3.10e8 / 8030), rel=1e-14)
    told = cal.RestitutionData([1.0], [0.9], PAIR, limit_velocity=250)
    assert told.limit_velocity == told.contact.limit_velocity == 250.0
    assert told.contact.yield_strength == PAIR.yield_strength
    assert len(cal.RestitutionData([np.nextafter(2.0, 0.0)], [0.0], limit_velocity=2.0)) == 1


def test_printed_data_tells_what_it_is():
    text = repr(cal.RestitutionData([0.1, 2.0], [0.9, 0.8], PAIR, name="my alloy"))
    for words in (
        "my alloy",
        "2 points",
        "0.1 to 2 m/s",
        "0.8 to 0.9",
        "not stated",
        "with contact",
    ):
        assert words in text
    grouped = repr(cal.RestitutionData([0.1, 2.0], [0.9, 0.8], group=["a", "b"], uncertainty=0.01))
    assert "2 groups" in grouped
    assert "not stated" not in grouped
    assert "no contact" in grouped


def test_groups_are_labels_in_the_order_of_their_appearance():
    data = cal.RestitutionData([1.0, 2.0, 3.0], [0.9, 0.8, 0.7], group=[7, 2.0, 7])
    assert list(data.group) == ["7", "2", "7"]
    assert data.groups == ("7", "2")
    np.testing.assert_array_equal(data.group_index, [0, 1, 0])
    assert cal.RestitutionData([1.0], [0.9]).groups == ()


def test_errors_and_the_two_uncertainties_are_one_statement():
    errors = cal.PointErrors.alone(2, np.array([0.01, 0.02]), np.array([0.1, 0.2]))
    data = cal.RestitutionData([1.0, 2.0], [0.9, 0.8], errors=errors)
    stated = {"uncertainty": [0.01, 0.02], "velocity_uncertainty": [0.1, 0.2]}
    assert data == cal.RestitutionData([1.0, 2.0], [0.9, 0.8], **stated)
    assert replace(data, contact=PAIR).errors is errors
    again = replace(data, uncertainty=0.03, errors=None)
    np.testing.assert_array_equal(again.uncertainty, [0.03, 0.03])
    # variance of each point: u² + (dε/dv u_v)²
    expected = [0.01**2 + (2 * 0.1) ** 2, 0.02**2 + (3 * 0.2) ** 2]
    np.testing.assert_allclose(data.covariance_of([2.0, 3.0]).diagonal, expected, rtol=1e-12)


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


def test_bounces_without_a_launch_column_follow_each_other():
    """Up to 1.3 times the interval before, which noise may bring: no new drop."""
    data = READ({"interval": [0.8, 0.4, 0.519]}, uncertainty=0.1)
    np.testing.assert_allclose(data.restitution, [0.5, 1.2975], rtol=1e-14)
    assert data.group is None


def test_a_label_that_comes_back_is_another_launch():
    """Two heights with launches 1 and 2 each: no ε between the last bounce and a new drop."""
    table = {"interval": [0.4, 0.36, 0.4, 0.32, 0.8, 0.72], "launch": [1, 1, 2, 2, 1, 1]}
    data = READ(table)
    np.testing.assert_allclose(data.restitution, [0.9, 0.8, 0.9], rtol=1e-14)
    assert len(data.groups) == 3
    assert data.groups[:2] == ("1", "2")
    balls = READ(table | {"group": ["ball a"] * 4 + ["ball b"] * 2})
    assert list(balls.group) == ["ball a", "ball a", "ball b"]


@pytest.mark.parametrize(
    "table",
    [
        {"interval": [0.4, 0.36, 0.5], "launch": [1, 1, 2]},
        {"time": [0.0, 0.4, 0.76, 0.0, 0.4], "launch": [1, 1, 1, 2, 2]},
    ],
)
def test_launches_that_give_no_restitution_are_told(table):
    data = READ(table)
    np.testing.assert_allclose(data.restitution, [0.9], rtol=1e-12)
    assert data.remarks[0].startswith("1 launch(es)")


def test_absurd_numbers_raise_no_warning():
    """Warnings are errors in these tests."""
    huge = cal.RestitutionData([1e300, 1e-300], [1e-300, 0.0], uncertainty=[1e140, 1e-140])
    assert len(huge.averaged()) == 2
    assert not np.any(np.isnan(huge.covariance_of(1e300).diagonal))


EMBEDDED = {  # Table 1 of Zhou (2013): σ, ψ, and where the panels of Fig. 2 end [v_cr]
    "stainless steel": (sj.STAINLESS_STEEL, 3.0432, 0.5400, 250),
    "chrome steel": (sj.CHROME_STEEL, 0.1418, 0.3114, 25),
    "nylon": (sj.NYLON, 0.4355, 0.5414, 80),
}


def test_the_embedded_data_are_eq_17_over_the_ranges_of_the_paper():
    """40 velocities evenly spaced above first yield, up to the end of each panel."""
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


def test_restitutions_above_one_are_noted_and_never_clipped():
    data = cal.RestitutionData([1.0, 2.0], [0.9, 1.01], remarks=("seen",))
    assert data.restitution[1] == 1.01
    assert data.notes[0] == "seen"
    assert "1 of 2" in data.notes[1]
    assert "0.01" in data.notes[1]


def slips(count, noise, fall, rng):
    """1 where an honest set near ε = 1 is refused."""
    velocity = np.sort(rng.uniform(0.05, 8.0, count))
    measured = np.abs(1 - fall * velocity**0.3 + noise * rng.standard_normal(count))
    with suppress(cal.DataError):
        cal.RestitutionData(velocity, measured)
        return 0
    return 1


@pytest.mark.parametrize("fall", [0.0, 0.01])
@pytest.mark.parametrize("noise", [0.01, 0.05])
def test_honest_sets_near_one_are_read(fall, noise):
    """At most 1 of 100 sets of 5 to 60 points is refused."""
    rng = np.random.default_rng(1)
    assert sum(slips(n, noise, fall, rng) for n in rng.integers(5, 60, 200)) <= 2


@pytest.mark.parametrize("count", [1, 5, 30])
def test_one_gross_error_is_refused_by_its_place(count):
    velocity = np.arange(1.0, count + 1)
    restitution = 0.95 + 0.01 * np.sin(7 * velocity)
    restitution[count // 2] = 1.501
    with pytest.raises(cal.DataError, match=rf"restitution\[{count // 2}\]"):
        cal.RestitutionData(velocity, restitution)
    with pytest.raises(cal.DataError, match=r"percent.*\[%\]"):
        cal.RestitutionData(velocity, 100 * restitution)
