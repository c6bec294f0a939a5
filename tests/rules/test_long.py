"""The long tests are dealt out to parts: each file once, and the parts of nearly the same time."""

import pytest

from tests.long import dealt, part_of


def test_files_are_dealt_out_by_their_seconds():
    # 60, 50, 30 | 20, 20, 20: the longest first, each to the part that has least
    files = {"a": 60.0, "b": 50.0, "c": 30.0, "d": 20.0, "e": 20.0, "f": 20.0}
    assert dealt(files, 2) == [["a", "d", "e"], ["b", "c", "f"]]
    assert dealt(files, 3) == [["a"], ["b", "e"], ["c", "d", "f"]]


def test_more_parts_than_files_leave_some_empty():
    assert dealt({"a": 1.0}, 3) == [["a"], [], []]


@pytest.mark.parametrize("text", ["0/2", "3/2", "1", "a/b"])
def test_a_part_that_is_none_is_refused(text):
    with pytest.raises(ValueError):  # noqa: PT011  argparse words it
        part_of(text)
    assert part_of("2/3") == (2, 3)
