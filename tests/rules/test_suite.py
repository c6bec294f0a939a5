"""What the suite has about itself: the sampler of small changes, and `long` tests in parts."""

import random
import textwrap
from itertools import count

import pytest

from tests import mutants
from tests.changes import changes_of, drawn
from tests.conftest import dealt
from tests.lines import Lines, noting
from tests.mutants import NOTICED, SURVIVED, affordable, equivalents, tried
from tests.ran import ran

MODULE = textwrap.dedent(
    '''\
    """Ten lines, 3 of which do nothing."""
    LIMIT = 2.0
    def scaled(x: "float[3]", factor=2):
        """Twice x, at most 7."""
        if x < 0 and factor:
            raise ValueError(f"{x + 1}")
        low = min(x * factor, LIMIT)
        return round(low, ndigits=3)
    def negative(x):
        return -x
    '''
).encode()


def test_every_sort_of_change_is_found_once():
    found = {(change.line, change.kind, change.after) for change in changes_of("module.py", MODULE)}
    assert found == {
        (2, "constant", "LIMIT = 3.0"),
        (3, "constant", 'def scaled(x: "float[3]", factor=3):'),
        (5, "negation", "if not (x < 0 and factor):"),
        (5, "operator", "if x < 0 or factor:"),
        (5, "comparison", "if x <= 0 and factor:"),
        (5, "constant", "if x < 1 and factor:"),
        (7, "opposite", "low = max(x * factor, LIMIT)"),
        (7, "operator", "low = min(x / factor, LIMIT)"),
        (8, "keyword", "return round(low)"),
        (8, "constant", "return round(low, ndigits=4)"),
        (10, "sign", "return x"),
    }


def test_what_commutes_what_only_checks_and_looks_are_left_alone():
    def of(line):
        return {change.after for change in changes_of("module.py", line.encode())}

    assert of("x = max(a, b)") == {"x = min(a, b)"}
    assert of("x = atan2(a, b)") == {"x = atan2(b, a)"}
    assert of("x = zip(a, b, strict=True)") == {"x = zip(b, a, strict=True)"}
    assert of('f(a, alpha=0.5, **{"linewidth": 1, "x": 2})') == {
        'f(a, alpha=0.5, **{"linewidth": 1, "x": 3})'
    }
    assert of("@dataclass(frozen=True, eq=False)\nclass Pair:\n    n: int = 1") == {"n: int = 2"}


def test_a_seed_draws_the_same_again(project):
    every = changes_of("module.py", MODULE)
    one, again, other = (drawn(every, 5, random.Random(seed), project) for seed in (1, 1, 2))
    assert one == again != other
    broken = every[0]._replace(new="2 +")
    some = drawn([broken, *every], 99, random.Random(0), project)
    assert (len(some), set(some)) == (len(every), set(every))


def test_equivalents_are_read_by_file_and_both_lines_and_still_stand_in_their_files():
    text = "# by hand\n\nmodule.py\n- a = 1\n+ a = 2\n= never read\n"
    assert equivalents(text) == {("module.py", "a = 1", "a = 2")}
    assert equivalents("# none\n") == set()
    equal = equivalents(mutants.EQUIVALENT.read_text(encoding="utf-8"))
    sources = {file: (mutants.TOP / file).read_bytes() for file, *_ in equal}
    every = (change for source in sources.items() for change in changes_of(*source))
    assert equal <= {(change.file, change.before, change.after) for change in every}


@pytest.fixture
def project(tmp_path):
    (tmp_path / "module.py").write_bytes(MODULE)
    (tmp_path / "tests").mkdir()
    body = (
        "from module import negative, scaled\ndef test_it():\n    assert scaled(0.6004) == 1.201\n"
    )
    body += "def test_negative():\n    assert negative(1) == -1\n"
    (tmp_path / "tests" / "test_module.py").write_text(body, encoding="utf-8")
    return tmp_path


def test_each_line_of_a_function_notes_that_it_ran():
    source = """'A module.'
def sign(x, least=0):
    'Of x.'
    if (
        x > least
    ):
        return 1
    try:
        1 / x
    except ZeroDivisionError:
        return 0
    return -1
LIMIT = 2
"""
    text, numbers = noting(source, count())
    names: dict = {}
    exec(text, names)
    assert names["__doc__"] == "A module."
    assert names["sign"].__doc__ == "Of x."
    assert sorted(map(int, numbers)) == list(range(2, 13))

    def lines(x):
        ran.clear()
        names["sign"](x)
        return [int(line) for line, number in numbers.items() if number in ran]

    assert set(range(2, 13)) - {*lines(3)} == {8, 9, 10, 11, 12}
    assert set(range(2, 13)) - {*lines(0)} == {7, 12}


def test_tests_that_run_a_line_are_chosen_the_cheapest_first():
    lines = Lines(
        {
            "module.py": {"3": 1, "4": 2},
            "other.py": {"1": 5},
            "a/tables.py": {},
            "a/read.py": {"2": 5},
        },
        {"a::slow": 9.0, "a::quick": 0.5, "b::one": 0.1, "b::two": 0.2, "c::other": 0.1},
        {"a::slow": [1, 2], "a::quick": [1], "b::one": [1], "b::two": [1, 5], "c::other": [5]},
    )
    every = ["b::one", "b::two", "a::quick", "a::slow"]
    assert lines.chosen("module.py", 3) == every
    assert lines.chosen("module.py", 4) == ["a::slow", "a::quick"]
    assert lines.chosen("module.py", 1) == every  # of no function
    assert lines.chosen("none.py", 1) == []
    assert lines.chosen("a/tables.py", 1) == ["c::other", "b::two"]
    assert affordable(every, lines.seconds, 1.0) == every[:3]
    assert affordable(["a::slow"], lines.seconds, 1.0) == ["a::slow"]


def test_changes_are_noticed_or_not_and_undone(project):
    tests = ["tests/test_module.py"]
    every = {change.after: change for change in changes_of("module.py", MODULE)}
    changes = (every["low = min(x / factor, LIMIT)"], every["if x <= 0 and factor:"])
    seen, unseen = (tried(project, change, tests, 60) for change in changes)
    assert (seen.result, unseen.result) == (NOTICED, SURVIVED)
    assert seen.by == "FAILED tests/test_module.py::test_it"
    assert (project / "module.py").read_bytes() == MODULE


def test_files_are_dealt_out_by_how_many_tests_they_have():
    # 6, 5, 3 | 2, 2, 2: the longest first, each to the part that has least
    files = {"a": 6, "b": 5, "c": 3, "d": 2, "e": 2, "f": 2}
    assert dealt(files, 2) == [["a", "d", "e"], ["b", "c", "f"]]
    assert dealt(files, 3) == [["a"], ["b", "e"], ["c", "d", "f"]]
    assert dealt({"a": 1}, 3) == [["a"], [], []]
