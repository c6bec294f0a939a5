"""Names from files are text: they make no rows, no pictures, no links, and move no cursor."""

import html
import json
import os
import re
import subprocess

import pytest

from calibration.report.tables import code, escaped, markdown
from calibration.terminal import shell_line
from tests.command import run

NAMES = {
    "newline": "steel\n9 0.5 0 0 0 0",
    "comment": "# heading",
    "script": "<script>alert(1)</script>",
    "image": "![x](http://example.org/x.png)",
    "cell": "a|b",
    "code": "`x` *y* _z_",
    "escape": "\x1b[2J\x1b]0;title\x07red",
    "direction": "abc\u202edef",
    "dollars": "$\\frac{1}{0}$",
}
MATERIAL = """
[[material]]
name = {name}
material = "nylon"
radius = 0.01
limit_velocity = 300.0
data = "a.csv"
"""
POINTS = "velocity,restitution,uncertainty\n" + "".join(
    f"{v},{e},0.01\n" for v, e in ((0.5, 0.81), (1.0, 0.79), (2.0, 0.80), (4.0, 0.82))
)


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    """All names in one fit: what its files and the terminal say."""
    folder = tmp_path_factory.mktemp("names")
    (folder / "a.csv").write_text(POINTS)
    entries = "".join(MATERIAL.format(name=json.dumps(name)) for name in NAMES.values())
    text = '[fit]\nlaw = "constant"\nprofiles = false\n' + entries
    (folder / "m.toml").write_text(text.replace("\\u001b", "\\u001B"), encoding="utf-8")
    code, out, error = run("--no-cache", "fit", folder / "m.toml", "--out", folder / "r")
    assert (code, error) == (0, "")
    return folder, out, (folder / "r" / "report.md").read_text(encoding="utf-8")


def test_nothing_reaches_the_terminal_but_letters(told):
    _, out, _ = told
    assert all(line.isprintable() for line in out.splitlines())
    assert r"steel\n9 0.5 0 0 0 0" in out
    assert r"\x1b[2J" in out
    assert r"abc\u202edef" in out


def test_a_report_has_its_own_structure_alone(told):
    _, _, report = told
    lines = report.splitlines()
    assert all(line.isprintable() for line in lines)
    assert {line for line in lines if line.startswith("#")} <= {
        "# Coefficients of restitution, fitted",
        "## Bodies",
        "## Parameters",
        "## How closely the curves follow",
        "## Doubts",
        "## How it was computed",
    }
    assert "<" not in report
    assert set(re.findall(r"\]\(([^)]*)\)", report)) <= {
        "curves.png",
        "profiles.png",
        "correlation.png",
    }
    assert "://" not in report
    tables = [block.splitlines() for block in report.split("\n\n") if block.startswith("|")]
    assert len(tables) == 4
    for table in tables:
        assert len({len(re.findall(r"(?<!\\)\|", row)) for row in table}) == 1
    # and shows each name as it is
    shown = html.unescape(report.replace("\\|", "|"))
    for name in (
        "<script>alert(1)</script>",
        "![x](http://example.org/x.png)",
        "a|b",
        "`x` *y* _z_",
    ):
        assert f"- **{name}**" in shown


def test_a_table_for_particle_codes_has_rows_of_numbers_alone(told):
    folder, _, _ = told
    fit = folder / "r" / "fit.json"
    for name in (r"steel\n9 0.5 0 0 0 0", "# heading"):
        words = ["curve", "--fit", fit, "--material", name, "--table", "--points", 5]
        code, out, error = run("--no-cache", *words, "--out", folder / "c")
        assert (code, error) == (0, "")
        lines = (folder / "c" / "curve.txt").read_text(encoding="utf-8").splitlines()
        rows = [line for line in lines if not line.startswith("#")]
        assert len(rows) == 5
        assert lines[0] == f"# restitution of {name}"
        assert all(float(cell) >= 0 for row in rows for cell in row.split())
        assert out.isprintable() or out.replace("\n", "").isprintable()


def test_a_name_too_long_for_tables_and_pictures_is_refused(tmp_path):
    (tmp_path / "a.csv").write_text(POINTS)
    (tmp_path / "m.toml").write_text(MATERIAL.format(name=json.dumps("x" * 100_000)))
    code, out, error = run("--no-cache", "fit", tmp_path / "m.toml", "--out", tmp_path / "r")
    assert (code, out) == (2, "")
    assert "200 characters at most" in error
    assert len(error) < 400


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("my_alloy v1.2 (a), χ̃ [m/s]", "my_alloy v1.2 (a), χ̃ [m/s]"),
        ("<b>", "&#60;b&#62;"),
        ("&lt;", "&#38;lt;"),
        ("![x](y)", "&#33;[x&#93;(y)"),
        ("[x]: y", "[x&#93;: y"),
        ("a|b", r"a\|b"),
        ("_a_b_", "&#95;a_b&#95;"),
        ("a\\", "a&#92;"),
        ("https://x", "https&#58;//x"),
        ("a\nb", "a&#92;nb"),
    ],
)
def test_what_would_be_structure_becomes_an_entity(text, shown):
    assert escaped(text) == shown


def test_cells_with_bars_stay_cells():
    assert markdown(("a",), [["x|y"]])[-1] == r"| x\|y |"


@pytest.mark.parametrize(
    ("text", "shown"),
    [("softjax fit", "`softjax fit`"), ("a`b", "`` a`b ``"), ("``", "``` `` ```")],
)
def test_a_line_of_code_ends_where_it_should(text, shown):
    assert code(text) == shown


def test_a_shell_reads_the_words_again():
    words = ["a b", "it's", "x`y$z", "st\udcfc", "ü\n", "\x1b", "$(reboot)", ""]
    done = subprocess.run(
        ["bash", "-c", f"printf '%s\\0' {shell_line(words)}"], capture_output=True, check=True
    )
    assert done.stdout == b"".join(os.fsencode(word) + b"\0" for word in words)
