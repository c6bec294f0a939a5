"""Tables that make no sense together, and what would be ignored: each refused by name."""

import math

import numpy as np
import pytest

from calibration.data import RestitutionData
from calibration.errors import DataError

BAD_TABLES = [
    ({"velocity": [1.0]}, "`set of columns` must be velocity with restitution, .* is velocity"),
    ({"drop_height": [1.0], "restitution": [0.9]}, "`set of columns` must be"),
    ({"velocity": [1.0], "launch": [1.0]}, "`set of columns` must be"),
    ({}, "`set of columns` must be .*, but is empty"),
    ([[1.0, 0.9]], "`set of columns` must be .*, but is empty"),
    ({"colour": [1.0]}, "`set of columns` must be .*, but is 'colour', of which none is known"),
    ({"t": [1.0]}, r"`set of columns` must be .*; is 't' interval or time\?, but is 't'"),
    ({"v1": [1.0], "v2": [1.0]}, "is 'v1' impact_velocity or rebound_velocity?"),
    (
        {"velocty": [1.0], "restitution": [0.9]},
        r"`column` must be a known name .*mean 'velocity'\?",
    ),
    ({"velocity [kg]": [1.0], "e": [0.9]}, r"`unit of velocity` must be in m/s, cm/s.*\[kg\]"),
    ({"interval": [1.0, 0.9], "launch [s]": [1, 1]}, "`unit of launch` must be without a unit"),
    ({"velocity": [1.0], "v [cm/s]": [1.0], "e": [0.9]}, "`column` must be there once, but is vel"),
    ({"velocity": [1.0], "v_in": [1.0], "e": [0.9]}, "there once, but is velocity twice"),
    ({"velocity": [1.0, 2.0], "restitution": [0.9]}, "`restitution` must be as long as `velocity`"),
    ({"velocity": ["fast"], "restitution": [0.9]}, "`velocity` must be an array of real numbers"),
    (
        {"velocity": [math.nan], "restitution": [0.9]},
        "`set of rows` must be one with velocity, res",
    ),
    ({"velocity": [math.inf], "restitution": [0.9]}, r"`velocity\[0\]` must be a positive speed"),
    ({"interval": [1.0, 0.0]}, r"`interval\[1\]` must be a positive time in s.*, but is 0"),
    ({"interval": [1.0, math.nan, 0.8]}, r"`interval\[1\]` must be .*leaves no gap, but is empty"),
    ({"time": [1.0, 1.5, 1.4]}, r"`time\[2\]` must be later than the one above it \(a launch"),
    ({"time": [1.0, math.nan, 1.4]}, r"`time\[1\]` must be a time in s.*, but is empty"),
    (
        {"interval": [1.0, 0.9, 1.5]},
        r"`interval\[2\]` must be shorter than the one above \(a launch",
    ),
    ({"time": [0.0, 1.0, 1.9, 3.4]}, r"`time\[3\]` must be sooner \(a launch column"),
    ({"interval": [1.0]}, "`launch` must be of 2 rows or more"),
    ({"interval": [1.0, 2.0], "launch": [1, 2]}, "`launch` must be of 2 rows or more"),
    ({"time": [1.0, 2.0]}, "`launch` must be of 3 rows or more"),
    ({"interval": [1.0, 0.9], "launch": ["a", ""]}, r"`launch\[1\]` must be a label"),
    ({"drop_height": [0.0], "rebound_height": [0.1]}, r"`drop_height\[0\]` must be a positive"),
    ({"drop_height": [1.0], "rebound_height": [-0.1]}, r"`rebound_height\[0\]` must be a height"),
    ({"drop_height": [1.0], "rebound_height": [1.5]}, r"`restitution\[0\]` must be at most 1"),
    (
        {"drop_height": [2.0, 1.0], "rebound_height": [1.0, 1.6]},
        r"`rebound_height\[1\]` must be at most its drop_height, 1, .* in the same unit, and in this",
    ),
    ({"v_in": [1.0], "v_out": [1.3]}, r"`rebound_velocity\[0\]` must be at most its impact_vel"),
    ({"v_in": [0.0], "v_out": [0.1]}, r"`impact_velocity\[0\]` must be a positive speed"),
    ({"v_in": [1.0, 1.0], "v_out": [0.9, -0.9]}, r"`rebound_velocity\[1\]` must be a speed of 0"),
    ({"v": [1.0], "e": [85.0]}, r"must be at most 1, .*\(is it in percent\? then the unit is"),
]


@pytest.mark.parametrize(("table", "message"), BAD_TABLES)
def test_tables_that_make_no_sense(table, message):
    with pytest.raises(DataError, match=message):
        RestitutionData.from_table(table)


PLAIN = {"velocity": [1.0, 2.0], "restitution": [0.9, 0.8]}
SPEEDS = {"v_in": [1.0, 2.0], "v_out": [0.9, 1.6]}
HEIGHTS = {"drop_height": [1.0, 2.0], "rebound_height": [0.9, 1.6]}
TRAIN = {"interval": [1.0, 0.9, 0.8]}
IGNORED = [
    (PLAIN, {"interval_uncertainty": 0.1}, "left out beside velocity and restitution"),
    (PLAIN, {"height_uncertainty": 0.1}, "`height_uncertainty` must be left out beside"),
    (PLAIN, {"gravity": 9.81}, "`gravity` must be left out where velocities are given"),
    (SPEEDS, {"gravity": 9.81}, "`gravity` must be left out where velocities are given"),
    (PLAIN | {"uncertainty": [0.1, 0.1]}, {"uncertainty": 0.1}, "`uncertainty` must be given once"),
    (PLAIN | {"group": ["a", "b"]}, {"group": ["a", "b"]}, "`group` must be given once"),
    (
        SPEEDS,
        {"velocity_uncertainty": 0.1, "impact_velocity_uncertainty": 0.1},
        "`impact_velocity_uncertainty` must be given once, but is given beside velocity_unc",
    ),
    (
        HEIGHTS,
        {"height_uncertainty": 0.1, "rebound_height_uncertainty": 0.1},
        "`rebound_height_uncertainty` must be given once",
    ),
    (
        TRAIN,
        {"interval_uncertainty": 0.1, "timing_uncertainty": 0.1},
        "`timing_uncertainty` must be given once",
    ),
    (TRAIN, {"time_uncertainty": 0.1}, "`time_uncertainty` must be left out beside interval"),
    (TRAIN, {"interval_uncertainty": 0.0}, r"`interval_uncertainty\[0\]` must be a positive time"),
    (TRAIN, {"interval_uncertainty": -1.0}, "`interval_uncertainty` must be a number of 0 or more"),
    (TRAIN, {"interval_uncertainty": "1 mm"}, r"`unit` must be in s, ms, us.*\[mm\]"),
    (TRAIN, {"interval_uncertainty": "1"}, "`quantity` must be a number, or one with its unit"),
    (TRAIN, {"group": ["a"]}, "`group` must be as long as `interval`, 3"),
    ({"time": [0, 1, 1.9]}, {"timing_uncertainty": "1 %"}, "in s, ms or us, as times have no zero"),
    (HEIGHTS, {"height_uncertainty": 0.0, "uncertainty": 0.0}, r"`uncertainty\[0\]` must be a pos"),
    *((TRAIN, {"gravity": g}, "`gravity` must be a pos") for g in (0.0, -9.81, math.nan, "strong")),
]


@pytest.mark.parametrize(("table", "options", "message"), IGNORED)
def test_what_would_be_ignored_or_is_given_twice_is_refused(table, options, message):
    with pytest.raises(DataError, match=message):
        RestitutionData.from_table(table, **options)


def test_an_argument_that_is_none():
    with pytest.raises(TypeError, match=r"'uncertainy' \(did you mean 'uncertainty'\?\)"):
        RestitutionData.from_table(PLAIN, uncertainy=0.1)


def test_the_row_of_the_table_is_told_where_rows_are_left_out():
    table = {"velocity": [1.0, np.nan, 2.0, -3.0], "restitution": [0.9, 0.8, 0.7, 0.6]}
    with pytest.raises(DataError, match=r"`velocity\[3\]` must be a positive speed"):
        RestitutionData.from_table(table)
    table = {"v_in": [1.0, np.nan, 2.0, -3.0], "v_out": [0.9, 0.8, 0.7, 0.6]}
    with pytest.raises(DataError, match=r"`impact_velocity\[3\]`"):
        RestitutionData.from_table(table)
    table = {"velocity": [1.0, np.nan, 2.0], "restitution": [0.9, 0.8, 0.7]}
    with pytest.raises(DataError, match=r"`uncertainty\[2\]` must be a positive.*, but is empty"):
        RestitutionData.from_table(table | {"uncertainty": [0.1, np.nan, np.nan]})
