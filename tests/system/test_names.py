"""Names from files are text: they make no rows, no pictures, no links, and move no cursor."""

import json
import os
import subprocess

import pytest

from tests.shown.conftest import shown

NAMES = {
    "newline": "steel\n9 0.5 0 0 0 0",
    "comment": "# heading",
    "script": "<script>alert(1)</script>",
    "entity": "&lt; a\\",
    "image": "![x](http://example.org/x.png)",
    "reference": "[x]: y",
    "cell": "a|b",
    "code": "`x` *y* _z_",
    "escape": "\x1b[2J\x1b]0;title\x07red",
    "direction": "abc\u202edef",
    "dollars": "$\\frac{1}{0}$",
}
PLAIN = ("script", "entity", "image", "reference", "cell", "code", "dollars")
MATERIAL = '[[material]]\nname = {}\nmaterial = "nylon"\nradius = 0.01\ndata = "a.csv"\n'
POINTS = (
    "velocity,restitution,uncertainty\n0.5,0.81,0.01\n1.0,0.79,0.01\n2.0,0.8,0.01\n4.0,0.82,0.01\n"
)
FOLDER = "it's `a` $(b) ü"


@pytest.fixture(scope="module")
def hostile(tmp_path_factory):
    """All names in one fit."""
    folder = tmp_path_factory.mktemp("names") / FOLDER
    folder.mkdir()
    (folder / "a.csv").write_text(POINTS)
    entries = "".join(MATERIAL.format(json.dumps(name)) for name in NAMES.values())
    text = '[fit]\nlaw = "constant"\nprofiles = false\n' + entries
    (folder / "m.toml").write_text(text.replace("\\u001b", "\\u001B"), encoding="utf-8")
    made = shown(folder, "fit", folder / "m.toml")
    assert (made.code, made.err) == (0, "")
    return made


def test_nothing_reaches_the_terminal_but_letters_and_the_report_has_the_command_again(hostile):
    out, folder = hostile.out, hostile.folder.parent
    assert all(line.isprintable() for line in out.replace(str(folder), "").splitlines())
    assert all(name in out for name in (r"steel\n9 0.5 0 0 0 0", r"\x1b[2J", r"abc\u202edef"))
    (command,) = (x for x in hostile.page().paragraphs if x.startswith("softjax fit "))
    words = ["bash", "-c", f"printf '%s\\0' {command}"]
    printed = subprocess.run(words, capture_output=True, check=True).stdout
    found = [os.fsdecode(word) for word in printed.split(b"\0")[:-1]]
    assert found == ["softjax", "fit", str(folder / "m.toml"), "--out", str(hostile.folder)]


def test_a_page_and_a_picture_show_each_name_and_nothing_acts(hostile):
    page = hostile.page()
    assert all(text.isprintable() for text in page.paragraphs)
    assert not any("heading" in text for text in page.paragraphs if text.startswith("#"))
    assert all(f"- {NAMES[name]}" in "\n".join(page.paragraphs) for name in PLAIN)
    assert all(len({*map(len, table)}) == 1 for table in page.tables)
    assert page.open == page.named("script") == page.named("link") == []
    addresses = [attrs.get("href") or attrs.get("src") for _, attrs in page.tags]
    assert all(a is None or a.startswith("data:image/png;base64,") for a in addresses)
    figure = hostile.figures["curves.png"]
    figure.draw_without_rendering()
    titles = [ax.get_title().replace("\\$", "$").strip("\u200b") for ax in figure.axes]
    for name in PLAIN:
        assert page.words.count(NAMES[name]) >= 3
        assert NAMES[name] in titles


def test_a_table_for_particle_codes_has_rows_of_numbers_alone(hostile, tmp_path):
    for name in (r"steel\n9 0.5 0 0 0 0", "# heading"):
        words = ["--fit", hostile.folder / "fit.json", "--material", name, "--points", 5]
        made = shown(tmp_path, "curve", *words, "--table")
        assert made.code == 0
        assert made.err.count("\n") == 1  # the fit's warning
        lines = made.text("curve.txt").splitlines()
        rows = [line for line in lines if not line.startswith("#")]
        assert len(rows) == 5
        assert name in lines[0]
        assert all(float(cell) >= 0 for row in rows for cell in row.split())
        assert made.out.replace("\n", "").isprintable()
