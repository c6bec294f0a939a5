"""Terminals without Greek letters, narrow ones, plain ones; a sign of life before anything is loaded."""

import io
import os
import pty
import re
import select
import subprocess
import sys
import time
import tokenize
from pathlib import Path

import numpy as np
import pytest

import calibration as cal
from calibration import cli, progress, terminal
from calibration.report import terminal_report
from calibration.report.tables import aligned
from tests.cases import pair
from tests.slow_command import COMMAND

terminal.prepare()


class Screen(io.StringIO):
    """A terminal that keeps what is written to it."""

    encoding = "utf-8"  # type: ignore[assignment]

    def isatty(self) -> bool:
        return True


@pytest.fixture(scope="module")
def result():
    velocity = np.geomspace(0.5, 5.0, 8)
    noise = 0.01 * np.random.default_rng(2).standard_normal(8)
    data = cal.RestitutionData(velocity, 0.8 + noise, pair("nylon"), name="my alloy")
    return cal.fit(data, "constant")


def strings_of(path):
    """The texts of a source file that are no documentation, as they are written."""
    with path.open("rb") as file:
        for token in tokenize.tokenize(file.readline):
            if token.type == tokenize.STRING and not token.string.startswith('"""'):
                yield token.string


def test_every_letter_that_is_told_has_a_word():
    package = Path(cal.__file__).parent
    told = {c for path in package.rglob("*.py") for text in strings_of(path) for c in text}
    letters = {c for c in told if not c.isascii()} - {"ü"}
    assert {"χ", "σ", "ψ", "ε", "±"} < letters
    without = {c for c in letters if "\\" in c.encode("ascii", terminal.NAME).decode()}
    assert without == set()
    words = [c.encode("ascii", terminal.NAME).decode() for c in "χσψεμνρκηθτ"]
    assert len(set(words)) == len(words)


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("χ̃ = 0.2 ± 0.1", "chi = 0.2 +/- 0.1"),
        ("m s⁻¹, χ²/ν", "m s^-1, chi^2/nu"),
        ("Stahl für 中 \udcfc", "Stahl fur \\u4e2d \\udcfc"),
    ],
)
def test_what_ascii_cannot_show_is_told_in_words(text, shown):
    assert text.encode("ascii", terminal.NAME).decode() == shown


def test_a_terminal_that_has_some_of_the_letters_shows_these():
    assert "3 ± 1 für χ".encode("latin-1", terminal.NAME) == "3 ± 1 für chi".encode("latin-1")


def screen(monkeypatch, columns, encoding="utf-8"):
    shown = Screen()
    shown.encoding = encoding  # type: ignore[misc]
    monkeypatch.setattr(sys, "stdout", shown)
    monkeypatch.setenv("COLUMNS", str(columns))
    return shown


def test_columns_stand_below_each_other_in_the_letters_there_are(monkeypatch, result):
    screen(monkeypatch, 200, "ascii")
    lines = aligned(("name", "value"), [["χ̃", "1.0 ± 0.1"], ["σ", "2"], ["ψ", "3"]])
    assert lines == [
        "name   value",
        "-----  -----------",
        "chi    1.0 +/- 0.1",
        "sigma  2",
        "psi    3",
    ]
    report = terminal_report(result)
    monkeypatch.undo()
    tables = [line for line in report.splitlines() if "  " in line.strip()]
    assert tables
    assert all(line.isascii() for line in tables)


@pytest.mark.parametrize("columns", [40, 60, 200])
def test_no_line_is_wider_than_the_terminal(columns, monkeypatch, result):
    """Tables go into one cell a line; running text has 100 columns at most."""
    screen(monkeypatch, columns)
    narrow = terminal_report(result)
    monkeypatch.undo()
    wide = terminal_report(result)
    assert max(map(len, narrow.splitlines())) <= columns
    words = re.findall(r"[\w.±]+", narrow)
    for word in re.findall(r"[\w.±]+", wide):
        assert word in words
    assert (narrow == wide) == (columns == 200)


@pytest.mark.parametrize("term", ["dumb", "xterm"])
def test_a_sign_of_life_comes_before_the_command_is_imported(term, monkeypatch):
    shown = Screen()
    monkeypatch.setattr(sys, "stderr", shown)
    monkeypatch.setenv("TERM", term)
    at_import = []
    monkeypatch.setattr(cli, "_command", lambda name: at_import.append(shown.getvalue()) or Fake)
    assert cli.main(["fit", "--no-cache"]) == 0
    assert at_import[-1].startswith("softjax fit: loading")
    if term == "xterm":  # and goes when there is more to tell
        assert shown.getvalue().endswith(f"\r{' ' * len('softjax fit: loading')}\r")
    else:
        assert "\r" not in shown.getvalue()
    before = len(shown.getvalue())
    assert cli.main(["fit", "--no-cache", "--quiet"]) == 0
    assert len(shown.getvalue()) == before


class Fake:
    """A command without options that does nothing."""

    @staticmethod
    def add_arguments(parser) -> None:
        pass

    @staticmethod
    def run(arguments) -> int:
        return 0


def test_a_dumb_terminal_has_a_line_a_stage(monkeypatch):
    monkeypatch.setenv("TERM", "dumb")
    shown = Screen()
    with progress.Progress(file=shown) as bars:
        for stage in ("first", "second"):
            for done in range(3):
                bars(stage, done, 2)
        assert list(bars.over([1, 2], "third")) == [1, 2]
    assert shown.getvalue() == "first ...\nsecond ...\nthird ...\n"


@pytest.mark.parametrize("more", [{}, {"NO_COLOR": "1"}, {"TERM": "dumb"}])
def test_on_a_real_terminal(more, tmp_path):
    """Its first output at once; no colours, and no escape sequence but tqdm's own."""
    main, other = pty.openpty()
    begun = time.monotonic()
    process = subprocess.Popen(
        [*COMMAND, "--out", str(tmp_path / "results")],
        stdin=other,
        stdout=other,
        stderr=other,
        env=os.environ | {"TERM": "xterm"} | more,
    )
    os.close(other)
    shown, first = b"", None
    while select.select([main], [], [], 30)[0]:
        try:
            part = os.read(main, 4096)
        except OSError:  # the other end is closed
            break
        first = first or (time.monotonic() - begun)
        shown += part
        if not part:
            break
    os.close(main)
    assert process.wait() == 0
    assert shown.startswith(b"softjax slow: loading")
    assert first is not None
    assert b"\x1b" not in shown
    assert "χ̃ is new\r\n".encode() in shown
    print(f"first sign after {first:.2f} s")
