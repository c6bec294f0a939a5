"""Signals at any moment: one line, old results or new ones, and nothing left behind."""

import os
import random
import signal
import subprocess
import sys
import time

import pytest

from calibration import signals
from tests.command import write_alloy
from tests.slow_command import COMMAND, LINES

SECONDS = 0.005 * LINES + 0.15  # that it takes from its first line on, at least
CODES = {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGHUP: 129}


def begun(out, *options):
    """The command, where it has begun to write; output and errors to be read."""
    process = subprocess.Popen(
        [*COMMAND, "--out", str(out), *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        encoding="utf-8",
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "begun\n"
    return process


def old_results(out) -> None:
    out.mkdir()
    for name in ("a", "c"):
        (out / name).write_text("old\n")


def found(out) -> str:
    """Which set of files there is: all old or all new; nothing else lies there or beside."""
    assert [path.name for path in out.parent.iterdir()] == [out.name]
    texts = {path.name: set(path.read_text().split()) for path in out.iterdir()}
    whole = "new\n" * 100 * LINES
    if texts == {"a": {"old"}, "c": {"old"}}:
        return "old"
    assert texts == {"a": {"new"}, "b": {"new"}, "c": {"old"}}
    assert (out / "a").read_text() == (out / "b").read_text() == whole
    return "new"


def test_ten_moments_drawn_at_random(tmp_path):
    """SIGINT, SIGTERM and SIGHUP between the first line and the last."""
    draw = random.Random(int.from_bytes(os.urandom(4)))
    out = tmp_path / "results"
    seen = []
    for number in [*CODES] * 3 + [signal.SIGTERM]:
        if out.exists():
            for path in out.iterdir():
                path.unlink()
            out.rmdir()
        old_results(out)
        process = begun(out)
        wait = draw.uniform(0, SECONDS)
        time.sleep(wait)
        process.send_signal(number)
        _, error = process.communicate(timeout=30)
        which = found(out)
        seen.append((wait, number, process.returncode, which))
        if process.returncode in (0, -number):  # it had done all, or all but to end
            assert (which, error) == ("new", ""), seen
            continue
        assert process.returncode == CODES[number], seen
        told = "nothing written" if which == "old" else f"after its results were written to {out}"
        assert error.startswith("softjax: interrupted"), seen
        assert error.endswith(f"{told}\n"), seen
        assert len(error.splitlines()) == 1
    assert any(code == CODES[number] for _, number, code, _ in seen)


@pytest.mark.long
def test_ten_moments_of_a_fit(tmp_path):
    """While modules load, programs compile, pictures are drawn: whatever is left is whole."""
    file = write_alloy(tmp_path, 'law = "walton-braun"')
    out = tmp_path / "results"
    command = [
        sys.executable,
        "-m",
        "calibration",
        "--no-cache",
        "fit",
        str(file),
        "--out",
        str(out),
    ]
    begun_at = time.monotonic()
    subprocess.run(command, check=True, capture_output=True)
    whole = time.monotonic() - begun_at
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    codes = []
    for number in [*CODES] * 3 + [signal.SIGTERM]:
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        time.sleep(random.uniform(0.1, whole))
        process.send_signal(number)
        error = process.communicate(timeout=120)[1].decode()
        codes.append(process.returncode)
        assert sorted(path.name for path in tmp_path.iterdir()) == [
            "alloy.toml",
            "my_alloy.csv",
            "results",
        ]
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


def test_an_ignored_hangup_stays_ignored(tmp_path):
    """As under nohup."""
    script = "trap '' HUP; exec \"$@\""
    process = subprocess.Popen(
        ["sh", "-c", script, "sh", *COMMAND, "--out", str(tmp_path / "results")],
        stdout=subprocess.PIPE,
        text=True,
        encoding="utf-8",
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "begun\n"
    process.send_signal(signal.SIGHUP)
    assert process.communicate(timeout=30)[0] == "χ̃ is new\n"
    assert process.returncode == 0


class Fickle:
    """Raises what comes while it goes, as callbacks of the garbage collector do."""

    def __del__(self):
        signal.raise_signal(signal.SIGTERM)


def test_a_signal_that_a_callback_swallows_comes_again(capsys):
    def work() -> None:
        fickle = Fickle()
        del fickle
        for _ in range(1000):
            time.sleep(0.01)

    with signals.heard(), pytest.raises(signals.Stopped):
        work()
    assert capsys.readouterr().err == ""


def test_a_signal_waits_until_what_is_begun_is_done():
    done = []

    def renamed() -> None:
        with signals.held():
            signal.raise_signal(signal.SIGTERM)
            done.append("the whole set")

    with signals.heard():
        with pytest.raises(signals.Stopped) as stopped:
            renamed()
        assert done == ["the whole set"]
        assert stopped.value.code == 143
    assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL
