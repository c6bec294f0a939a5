"""Lists of places in the code and of tests do not outlive them."""

from pathlib import Path

import pytest

from tests.slow import SLOW
from tests.small_changes import CHANGES

TESTS = Path(__file__).parent


@pytest.mark.parametrize("file", CHANGES)
def test_what_is_changed_stands_there_once(file):
    text = (TESTS.parent / file).read_text(encoding="utf-8")
    for before, after, tests in CHANGES[file]:
        assert text.count(before) == 1, before
        compile(text.replace(before, after), file, "exec")
        assert tests
        for name in tests.split():
            assert (TESTS / f"test_{name}.py").exists(), name


def test_what_is_long_by_its_name_is_a_test():
    for name in SLOW:
        file, function = name.partition("[")[0].split("::")
        assert f"def {function}(" in (TESTS / file).read_text(encoding="utf-8"), name
