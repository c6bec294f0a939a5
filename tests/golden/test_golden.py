"""The golden numbers are found again, and the comparison notices what moves."""

import copy
import json

import pytest

from tests.golden.__main__ import RECORDED, found, moved
from tests.golden.numbers import SCENARIOS, Numbers, differences, renewed, to_text

CASES = [pytest.param(name, marks=[pytest.mark.long] * one.long) for name, one in SCENARIOS.items()]


@pytest.mark.parametrize("name", CASES)
def test_numbers_are_those_recorded(name):
    lines = moved(name, found(name))
    assert not lines, "\n".join(lines)


def test_every_scenario_is_recorded_and_no_other():
    assert {path.stem for path in RECORDED.glob("*.json")} == set(SCENARIOS)


@pytest.fixture
def table():
    numbers = Numbers()
    numbers.physics("restitution", [0.5, None])
    numbers.estimate("chi", 2.0, 0.1)
    numbers.error("chi error", 0.1, 0.1)
    numbers.printed("row", ["3.10 ± 0.25", "12"])
    return json.loads(to_text(numbers.table))


@pytest.mark.parametrize(
    ("mark", "name", "within", "beyond"),
    [
        ("physics", "restitution", [0.5 + 4e-10, None], [0.5 + 6e-10, None]),
        ("physics", "restitution", [0.5, None], [0.5, 0.1]),
        ("estimate", "chi", 2.000009, 2.000011),  # 1e-4 of the standard error
        ("error", "chi error", 0.10009, 0.10011),  # 1e-3 of it
        ("estimate", "row, estimates", "3.11", "3.12"),
        ("error", "row, errors", "0.25 11", "0.25 12 1"),
    ],
)
def test_a_number_that_moves_is_named_with_both_values_and_its_mark(
    table, mark, name, within, beyond
):
    assert differences(table, table) == []
    for value, moves in ((within, False), (beyond, True)):
        new = copy.deepcopy(table)
        new[mark][name] = value if isinstance(value, str) else [value, None]
        lines = differences(table, new)
        assert len(lines) == moves
        assert all(f"{name} [{mark}]: " in line and "was " in line for line in lines)


def test_a_number_that_goes_or_comes_is_named(table):
    fewer = copy.deepcopy(table)
    del fewer["estimate"]["chi"]
    assert differences(table, fewer) == ["chi [estimate]: recorded, no longer there"]
    assert differences(fewer, table) == ["chi [estimate]: new, not recorded"]


def test_only_what_moved_is_recorded_anew(table):
    new = copy.deepcopy(table)
    new["estimate"]["chi"] = [2.000009, 1e-5]
    new["error"]["chi error"] = [0.2, 1e-4]
    again = renewed(table, new)
    assert again["estimate"]["chi"] == [2.0, 1e-5]
    assert again["error"]["chi error"] == [0.2, 1e-4]
    new["estimate"]["chi"] = [2.0, 1e-3]  # another tolerance
    assert renewed(table, new)["estimate"]["chi"] == [2.0, 1e-3]
