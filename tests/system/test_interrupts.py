"""Signals: one line, the shell's code, old results as they were, and nothing left behind."""

import gc
import io
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
from matplotlib.figure import Figure

from tests.command import run

CODES = {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGHUP: 129}
COMMAND = [sys.executable, "-m", "calibration", "--no-cache"]
CURVE = ["curve", "nylon", "--law", "constant", "--set", "restitution=0.9", "--format", "csv"]


def unheard(*_):
    raise AssertionError("the command does not handle the signal")


@pytest.fixture
def signalled(at, monkeypatch):
    """What a command says that is sent a signal while it reads its velocities, in a folder with older results."""
    (at / "results").mkdir()
    (at / "results" / "curve.csv").write_text("old")

    def said(number, handler, send=signal.raise_signal):
        class Input(io.BytesIO):
            def read(self, *size):
                send(number)
                return super().read(*size)

        monkeypatch.setattr(sys, "stdin", SimpleNamespace(buffer=Input(b"velocity\n1.0\n2.0\n")))
        inherited = signal.signal(number, handler)  # tests in the background ignore SIGINT
        try:
            result = run("--no-cache", *CURVE, "--velocities", "-", "--out", "results", "--quiet")
            assert signal.getsignal(number) is handler
        finally:
            signal.signal(number, inherited)
        return result

    return said


@pytest.mark.parametrize("number", CODES)
def test_a_command_that_is_stopped_leaves_what_was_there(number, signalled, at):
    line = "softjax: interrupted, nothing written\n"
    assert signalled(number, unheard) == (CODES[number], "", line)
    assert [path.name for path in at.rglob("*")] == ["results", "curve.csv"]
    assert (at / "results" / "curve.csv").read_text() == "old"


def while_collecting(number):
    """Send a signal during a garbage collection, whose callbacks swallow what is raised in them, and wait."""

    def callback(*_):
        gc.callbacks.remove(callback)
        signal.raise_signal(number)

    gc.callbacks.append(callback)
    gc.collect()
    time.sleep(5)


def test_a_signal_that_garbage_collection_swallowed_stops_a_command(signalled, at):
    line = "softjax: interrupted, nothing written\n"
    assert signalled(signal.SIGTERM, unheard, while_collecting) == (143, "", line)


def test_an_ignored_hangup_stays_ignored(signalled, at):
    assert signalled(signal.SIGHUP, signal.SIG_IGN) == (0, "", "")
    assert len((at / "results" / "curve.csv").read_text().splitlines()) == 3


def test_a_reader_that_has_gone_is_no_error():
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run([*COMMAND, "--help"], stdout=write, stderr=subprocess.PIPE, check=False)
    os.close(write)
    assert (done.returncode, done.stderr) == (0, b"")


def test_what_is_not_in_its_place_yet_is_not_written(quick, tmp_path, monkeypatch):
    """Stopped while a picture is drawn, when other files of the report are ready in a folder of their own."""

    def save(figure, path, **_):
        assert (Path(path).parent / "fit.json").exists()
        raise KeyboardInterrupt

    monkeypatch.setattr(Figure, "savefig", save)
    code, _, error = run("fit", quick, "--out", tmp_path / "results", "--no-cache", "--quiet")
    assert (code, error) == (130, "softjax: interrupted, nothing written\n")
    assert os.listdir(tmp_path) == []
