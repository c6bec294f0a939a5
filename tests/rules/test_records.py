"""Records: one way to keep, compare and renew them; none is kept that no test compares."""

import ast
import json
import re
from types import SimpleNamespace

import pytest

from tests import conftest, records
from tests.shown import capture

HERE = "tests/rules/test_records.py::"


@pytest.fixture
def kept(tmp_path, monkeypatch):
    """A record of each sort."""
    monkeypatch.setattr(records, "recording", False)
    monkeypatch.setattr(capture, "RECORDED", tmp_path / "recorded.json")
    (tmp_path / "recorded.json").write_text('{"help": {"fit": ["ε = 0.5012", "12 points"]}}')
    (tmp_path / "refused.txt").write_text("fit a | a is no file\nfit b |\nfit --c | …'--c'…\n")
    (tmp_path / "page.md").write_text("# Page\n<!-- rows -->\n| a |\n<!-- end -->\nmore\n")
    return tmp_path


MARKS = "<!-- rows -->", "<!-- end -->"
WAYS = {  # what is found, the line that says what was, what is, and where
    "a text": lambda f: capture.as_recorded("help", {"fit": "ε = 0.5034\n\n12 points"}),
    "a count": lambda f: capture.as_recorded("help", {"fit": "ε = 0.5012\n\n13 points"}),
    "a new text": lambda f: capture.as_recorded("new", {"fit": "new"}),
    "a new file": lambda f: capture.as_recorded(
        "help", {"fit": "ε = 0.5012\n\n12 points", "of none": ""}
    ),
    "a sentence": lambda f: records.as_sentence(f / "refused.txt", "fit a", "a is a folder"),
    "a new sentence": lambda f: records.as_sentence(f / "refused.txt", "fit b", "no b"),
    "parts": lambda f: records.as_sentence(f / "refused.txt", "fit --c", "what is --c?"),
    "a row": lambda f: records.as_table(f / "page.md", MARKS, ["| b |"]),
    "no row": lambda f: records.as_table(f / "page.md", MARKS, ["| a |", "| b |"]),
}


@pytest.mark.parametrize("way", WAYS)
def test_what_differs_is_shown_with_the_command_that_records_it_and_then_kept(
    way, kept, monkeypatch
):
    before = {path.name: path.read_text("utf-8") for path in kept.iterdir()}
    with pytest.raises(AssertionError, match=re.escape(f"record me: pytest --record '{HERE}")):
        WAYS[way](kept)
    assert before == {path.name: path.read_text("utf-8") for path in kept.iterdir()}
    monkeypatch.setattr(records, "recording", True)
    WAYS[way](kept)
    (line,) = records.changed()
    assert line.startswith(str(kept))
    assert records.changed() == []
    after = {path.name: path.read_text("utf-8") for path in kept.iterdir()}
    assert [name for name in before if before[name] != after[name]] == [
        line.split(":")[0][len(str(kept)) + 1 :]
    ]
    monkeypatch.setattr(records, "recording", False)
    WAYS[way](kept)


def test_what_agrees_is_left_as_it_stands(kept, monkeypatch):
    monkeypatch.setattr(records, "recording", True)
    before = {path.name: path.read_text("utf-8") for path in kept.iterdir()}
    capture.as_recorded("help", {"fit": "ε = 0.5013\n\n12 points"})  # of the last digit
    records.as_sentence(kept / "refused.txt", "fit --c", "no '--c' here")
    records.as_table(kept / "page.md", MARKS, ["| a |"])
    assert records.changed() == []
    assert before == {path.name: path.read_text("utf-8") for path in kept.iterdir()}


def test_of_long_lines_the_part_that_changed_is_shown_and_of_lists_the_line():
    words = " ".join(f"word{k}" for k in range(40))
    was, now = words.replace("word20 ", ""), words.replace("word20 ", "two words ")
    assert records.differences(["a", "b"], ["b"]) == ["was a"]
    assert records.differences(["first", was], ["first", now, "new"]) == [
        "was …rd14 word15 word16 word17 word18 word19 word21 word22 word23 word24 word25 word2…",
        "is  …rd14 word15 word16 word17 word18 word19 two words word21 word22 word23 word24 word25 word2…",
        "is  new",
    ]


def test_what_all_workers_recorded_is_printed_once():
    shown = []
    reports = [SimpleNamespace(user_properties=[("recorded", text)]) for text in ("a", "b", "a")]
    reporter = SimpleNamespace(
        stats={"passed": reports, "": [object()]}, section=shown.append, write_line=shown.append
    )
    for asked, printed in ((True, ["recorded", "a\n\nb"]), (False, [])):
        shown.clear()
        conftest.pytest_terminal_summary(reporter, SimpleNamespace(getoption=lambda _, a=asked: a))
        assert shown == printed


def test_every_record_has_a_test_that_compares_it():
    """A name of `as_recorded` may have parts in braces, which stand for literals of its file."""
    patterns = []
    for path in (records.ROOT / "tests").rglob("test_*.py"):
        text = path.read_text("utf-8")
        names = re.findall(r'as_recorded\(\s*(f?)"([^"]+)"', text)
        literals = {str(x.value) for x in ast.walk(ast.parse(text)) if isinstance(x, ast.Constant)}
        for formatted, name in names:
            parts = re.split(r"\{[^}]*\}", name) if formatted else [name]
            patterns.append((re.compile("(.+)".join(map(re.escape, parts))), literals))
    assert len(patterns) > 30

    def is_compared(key):
        found = ((pattern.fullmatch(key), literals) for pattern, literals in patterns)
        return any(match and {*match.groups()} <= literals for match, literals in found)

    assert is_compared("warnings, at-bound, at zero")
    assert not is_compared("warnings, of a case that went")
    table = json.loads(capture.RECORDED.read_text(encoding="utf-8"))
    assert [key for key in table if not is_compared(key)] == []
