"""The golden numbers are found again, and the comparison notices what moves."""

import copy
import json

import pytest

from tests.golden.__main__ import RECORDED, found, moved
from tests.golden.numbers import SCENARIOS, Numbers, differences, renewed, to_text

CASES = [pytest.param(n, marks=[pytest.mark.long] * s.long) for n, s in SCENARIOS.items()]


@pytest.mark.parametrize("name", CASES)
def test_numbers_are_those_recorded(name):
    lines = moved(name, found(name))
    assert not lines, "\n".join(
        [*lines, f"If that is meant, record me: python -m tests.golden {name}"]
    )


def test_every_scenario_is_recorded_and_no_other():
    assert {path.stem for path in RECORDED.glob("*.json")} == set(SCENARIOS)


def test_a_number_that_moves_is_named_and_recorded_anew():
    numbers = Numbers()
    numbers.physics("restitution", [0.5, None])
    numbers.estimate("chi", 2.0, 0.1)
    numbers.error("chi error", 0.1, 0.1)
    numbers.printed("row", ["3.10 ± 0.25", "12"])
    table = json.loads(to_text(numbers.table))
    assert differences(table, table) == []
    for mark, name, within, beyond in (
        ("physics", "restitution", [0.5 + 4e-10, None], [0.5 + 6e-10, None]),
        ("physics", "restitution", [0.5, None], [0.5, 0.1]),
        ("estimate", "chi", 2.000009, 2.000011),  # 1e-4 of the standard error
        ("error", "chi error", 0.10009, 0.10011),  # 1e-3 of it
        ("estimate", "row, estimates", "3.11", "3.12"),
        ("error", "row, errors", "0.25 11", "0.25 12 1"),
        ("error", "row, errors", "0.251 12", "0.253 12"),  # other digits
    ):
        for value, moves in ((within, False), (beyond, True)):
            new = copy.deepcopy(table)
            new[mark][name] = value if isinstance(value, str) else [value, table[mark][name][1]]
            lines = differences(table, new)
            assert len(lines) == moves
            assert all(f"{name} [{mark}]: " in line and "was " in line for line in lines)
            assert renewed(table, new) == (new if moves else table)
    fewer = copy.deepcopy(table)
    del fewer["estimate"]["chi"]
    assert differences(table, fewer) == ["chi [estimate]: recorded, no longer there"]
    assert differences(fewer, table) == ["chi [estimate]: new, not recorded"]
