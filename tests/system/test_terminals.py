"""Terminals as they are: narrow, dumb, without letters; and a sign of life before anything is loaded."""

import contextlib
import io
import os
import pty
import re
import select
import subprocess
import sys

import pytest

import calibration as cal
import softjax as sj
from calibration import cli
from tests.shown.capture import drawn


class Screen(io.StringIO):
    encoding = "utf-8"  # type: ignore[assignment]

    def isatty(self) -> bool:
        return True


@pytest.fixture
def shown(monkeypatch, tmp_path, quick):
    """What a fit writes to standard output and standard error."""

    def outputs(*words, columns=None, term="xterm", error=None):
        monkeypatch.setenv("TERM", term)
        if columns is not None:
            monkeypatch.setenv("COLUMNS", str(columns))
        out, error = Screen(), error or Screen()
        with drawn(), contextlib.redirect_stdout(out), contextlib.redirect_stderr(error):
            code = cli.main(["fit", str(quick), "--no-cache", "--out", str(tmp_path / "r"), *words])
        assert code == 0
        return out.getvalue(), error.getvalue()

    return outputs


def test_no_line_is_wider_than_the_terminal_and_progress_is_for_terminals(shown, tmp_path):
    """Every word of a wide one is there; without going back a line a stage, in a pipe or when quiet nothing."""
    plain = re.compile(r"\x1b\[[0-9;]*m")
    texts = {n: plain.sub("", shown(columns=n)[0]) for n in (50, 70, 200)}
    for columns, text in texts.items():
        report = text.partition(str(tmp_path))[0].splitlines()[:-1]  # a path is as long as it is
        assert max(map(len, report)) <= columns
    words = {n: set(re.findall(r"[^\W\d]\w{2,}", text)) for n, text in texts.items()}
    assert words[200] <= words[50] & words[70]
    assert all("0.9563 ± 0.0020" in text for text in texts.values())  # mean and s/√24 of the points
    assert texts[50] != texts[200]
    able, dumb = shown()[1], shown(term="dumb")[1]
    for text in (able, dumb):
        assert text.startswith("softjax fit: loading")
    assert "\r" in able
    assert len(dumb.splitlines()) > 1
    assert not {"\r", "\x1b"} & set(dumb)
    assert shown(error=io.StringIO())[1] == ""
    assert shown("--quiet") == ("", "")


def test_a_fit_in_python_shows_its_stages(monkeypatch):
    """`progress=True`: a bar on a terminal, a line a stage in a pipe or a notebook; else nothing. Streams stay."""
    data = cal.RestitutionData([1.0, 2.0, 3.0, 4.0], [0.8, 0.81, 0.79, 0.8])

    def law(restitution):
        assert (sys.stdout, sys.stderr) == (out, error)
        return sj.ConstantRestitution(None, restitution)

    out, start = sys.stdout, {"restitution": cal.Parameter(0.8, bounds=(0.01, 1))}
    monkeypatch.setenv("TERM", "xterm")
    found = []
    for error, progress in ((Screen(), True), (io.StringIO(), True), (Screen(), False)):
        with contextlib.redirect_stderr(error):
            cal.fit(data, law, start, progress=progress)
        found.append(error.getvalue())
    bar, lines, nothing = found
    assert lines.splitlines() == ["fit ...", "profiles ..."]
    assert "profiles" in bar
    assert "\x1b" in bar
    assert nothing == ""


@pytest.mark.parametrize("encoding", ["ascii", "cp1252"])
def test_letters_that_a_terminal_lacks_are_spelled(encoding, monkeypatch):
    """Parameters with Greek names differ; what is no letter, and half a character of a path, becomes "?"."""
    raw = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(raw, encoding=encoding))
    with pytest.raises(SystemExit):
        cli.main(["fit", "--help"])
    print("±0.1 é √ ─ 中 \udcfc", flush=True)
    text = raw.getvalue().decode(encoding)
    assert "it fits chi, sigma and psi of the three materials" in text
    assert "from a law to epsilon; default" in " ".join(text.split())
    assert text.endswith(
        {"ascii": "+-0.1 e ? - ? ?", "cp1252": "±0.1 é ? - ? ?"}[encoding] + os.linesep
    )


def test_on_a_real_terminal_without_colours_and_a_home_that_takes_no_files(tmp_path):
    """Its first output is there before anything heavy is imported; no escape sequence; Matplotlib prints
    nothing on its own cache."""
    main, other = pty.openpty()
    unset = ("JAX_COMPILATION_CACHE_DIR", "MPLCONFIGDIR")
    environment = {k: v for k, v in os.environ.items() if k not in unset}
    environment |= {"TERM": "dumb", "NO_COLOR": "1", "PYTHONPATH": os.getcwd()}
    environment |= {"HOME": "/dev/null", "XDG_CONFIG_HOME": "", "XDG_CACHE_HOME": ""}
    words = ["curve", "nylon", "--law", "constant", "--set", "restitution=0.9", "--out", "r"]
    command = [sys.executable, "-X", "importtime", "-m", "calibration", *words]
    streams = {"stdin": other, "stdout": other, "stderr": other}
    process = subprocess.Popen(command, cwd=tmp_path, env=environment, **streams)
    os.close(other)
    seen = b""
    with contextlib.suppress(OSError):  # the other end is closed
        while select.select([main], [], [], 600)[0] and (part := os.read(main, 65536)):
            seen += part
    os.close(main)
    assert process.wait() == 0
    before, sign, after = seen.partition(b"softjax curve: loading")
    assert sign
    assert not re.search(rb"\| +(jax|numpy|scipy|matplotlib)\r", before)
    assert re.search(rb"\| +jax\r", after)
    assert b"\x1b" not in seen
    lines = [line for line in after.splitlines() if not line.startswith(b"import time:")]
    assert lines == [b" ...", *lines[1:-1], b"Written to r: curve.csv, curve.png"]
    assert not [line for line in lines if b"Matplotlib" in line or b"warning" in line]
