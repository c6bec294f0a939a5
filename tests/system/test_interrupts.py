"""Signals: one line, the shell's code, old results as they were, and nothing left behind."""

import os
import random
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from tests.command import run, write_alloy

CODES = {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGHUP: 129}
COMMAND = [sys.executable, "-m", "calibration", "--no-cache"]
CURVE = ["curve", "nylon", "--law", "constant", "--set", "restitution=0.9", "--format", "csv"]
MORE_THAN_A_PIPE_HOLDS = b"velocity\n" + b"1.0\n" * 50_000


def at_work(folder, *before):
    """A command that has begun to read its velocities, and waits for their end."""
    # tests in the background ignore SIGINT, those under nohup SIGHUP, and a command inherits this
    inherited = {number: signal.signal(number, signal.SIG_DFL) for number in CODES}
    try:
        process = subprocess.Popen(
            [*before, *COMMAND, *CURVE, "--velocities", "-", "--out", "results"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            cwd=folder,
            env=os.environ | {"PYTHONPATH": os.getcwd()},
        )
    finally:
        for number, handler in inherited.items():
            signal.signal(number, handler)
    assert process.stdin is not None
    process.stdin.write(MORE_THAN_A_PIPE_HOLDS)
    process.stdin.flush()  # returns once most of it was read
    return process


def stopped(process, number):
    """The exit code after a signal; its input stays open, so that nothing else ends it."""
    for _ in range(5):  # a callback of the garbage collector may swallow one
        process.send_signal(number)
        with suppress(subprocess.TimeoutExpired):
            return process.wait(timeout=100)
    raise AssertionError("it goes on")


def test_a_command_that_is_stopped_leaves_what_was_there(tmp_path):
    """SIGINT, SIGTERM and SIGHUP, each in a folder of its own with older results."""
    running = {}
    for number in CODES:
        (tmp_path / number.name / "results").mkdir(parents=True)
        (tmp_path / number.name / "results" / "curve.csv").write_text("old")
        running[number] = at_work(tmp_path / number.name)
    for number, process in running.items():
        code = stopped(process, number)
        out, error = process.communicate()
        assert (code, out) == (CODES[number], b""), error
        assert error.startswith(b"softjax: interrupted")
        assert error.endswith(b"nothing written\n")
        assert error.count(b"\n") == 1
        files = [path for path in (tmp_path / number.name).rglob("*") if path.is_file()]
        assert [path.read_text() for path in files] == ["old"]
        assert os.listdir(tmp_path / number.name) == ["results"]


def test_an_ignored_hangup_stays_ignored(tmp_path):
    """As under nohup."""
    process = at_work(tmp_path, "sh", "-c", "trap '' HUP; exec \"$@\"", "sh")
    process.send_signal(signal.SIGHUP)
    _, error = process.communicate(timeout=600)
    assert (process.returncode, error.count(b"\n")) == (0, 0)
    assert len((tmp_path / "results" / "curve.csv").read_text().splitlines()) > 50_000


def test_a_reader_that_has_gone_is_no_error():
    """`softjax --help | head`."""
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run([*COMMAND, "--help"], stdout=write, stderr=subprocess.PIPE, check=False)
    os.close(write)
    assert (done.returncode, done.stderr) == (0, b"")


def test_what_is_not_in_its_place_yet_is_not_written(tmp_path, monkeypatch):
    """Stopped while a picture is drawn, when other files of the report are ready in a folder of their own."""
    file = write_alloy(tmp_path, 'law = "walton-braun"')

    def save(figure, path, **_):
        assert (Path(path).parent / "fit.json").exists()
        raise KeyboardInterrupt

    monkeypatch.setattr(Figure, "savefig", save)
    code, _, error = run("fit", file, "--out", tmp_path / "results", "--no-cache", "--quiet")
    assert (code, error) == (130, "softjax: interrupted, nothing written\n")
    assert sorted(os.listdir(tmp_path)) == ["alloy.toml", "my_alloy.csv"]


@pytest.mark.long
def test_ten_moments_of_a_fit(tmp_path):
    """While modules load, programs compile, pictures are drawn: whatever is left is whole."""
    file = write_alloy(tmp_path, 'law = "walton-braun"')
    out = tmp_path / "results"
    command = [*COMMAND, "fit", str(file), "--out", str(out)]
    begun = time.monotonic()
    subprocess.run(command, check=True, capture_output=True)
    whole = time.monotonic() - begun
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    draw, codes = random.Random(5), []
    for number in [*CODES] * 3 + [signal.SIGTERM]:
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        time.sleep(draw.uniform(0.1, whole))
        process.send_signal(number)
        error = process.communicate(timeout=120)[1].decode()
        codes.append(process.returncode)
        assert sorted(os.listdir(tmp_path)) == ["alloy.toml", "my_alloy.csv", "results"]
        after = {path.name: path.read_bytes() for path in out.iterdir()}
        assert after.keys() == before.keys()
        if process.returncode == CODES[number]:
            assert len(error.splitlines()) == 1, error
            assert ("nothing written" in error) == (after == before)
        else:  # before Python listened, or after all was done
            assert process.returncode in (0, -number)
            assert error == ""
        before = after
    assert any(code in CODES.values() for code in codes), codes
