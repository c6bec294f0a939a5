"""What cannot be written, and signals: one line, the exit code, older files as they were, and results still printed."""

import contextlib
import gc
import importlib
import io
import json
import os
import resource
import signal
import subprocess
import sys
import threading
import time
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import jax
import numpy as np
import pytest
import scipy.linalg
from matplotlib.figure import Figure

import calibration as cal
from tests.command import run, write_alloy

COMMAND = [sys.executable, "-m", "calibration", "--no-cache"]
CONSTANT = ["nylon", "--law", "constant", "--set", "restitution=0.8"]
CURVE = ["curve", *CONSTANT, "--points", 20]


@contextlib.contextmanager
def files_of_at_most(size):
    """No file grows beyond so many bytes, as on a full disk; caches of JAX and Python are left alone."""
    least = "jax_persistent_cache_min_compile_time_secs"
    before = getattr(jax.config, least)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "dont_write_bytecode", True)
        jax.config.update(least, 1e9)
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
            jax.config.update(least, before)


@pytest.mark.parametrize("most", [500, 20_000])
def test_a_full_disk_costs_the_files_and_not_the_report(most, quick, tmp_path):
    """The first file is the larger of both, the picture the other."""
    out = tmp_path / "results"
    out.mkdir()
    (out / "fit.json").write_text("old")
    with files_of_at_most(most):
        code, printed, error = run("--no-cache", "fit", quick, "--out", out)
    assert code == 3
    assert error == f"softjax: {str(out)!r} could not be written to (File too large)\n"
    assert "my alloy" in printed
    assert "rms 0.03" in printed
    assert str(out) not in printed
    assert {path.name: path.read_text() for path in out.iterdir()} == {"fit.json": "old"}
    assert os.listdir(tmp_path) == ["results"]


@pytest.mark.parametrize("command", ["compare", "sensitivity"])
def test_other_commands_tell_what_they_found(command, quick, tmp_path):
    words = [*CONSTANT] if command == "sensitivity" else [quick, "--laws", "constant"]
    with files_of_at_most(100):
        code, printed, error = run("--no-cache", command, *words, "--out", tmp_path / "results")
    assert (code, error.count("\n")) == (3, 1)
    assert {"compare": "constant", "sensitivity": "0.80000"}[command] in printed
    assert list(tmp_path.iterdir()) == []


# where results are to go: exit code, and words of the line
PLACES = {
    "x" * 300: (3, "File name too long"),
    f"new/{'x' * 300}": (3, "File name too long"),
    "/proc/results": (3, "could not be written"),
    "file": (2, "'{}/file' is a file"),
    "file/below/it": (2, "'{}/file' is a file"),
    "link": (2, "link"),
    "folder": (2, "curve.csv"),  # where a directory has the name of a result
}


@pytest.mark.parametrize("place", PLACES, ids=range(len(PLACES)))
def test_an_impossible_place(place, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("mine")
    (tmp_path / "link").symlink_to("nowhere")
    (tmp_path / "folder" / "curve.csv").mkdir(parents=True)
    before = sorted(tmp_path.rglob("*"))
    out = place if place.startswith("/") else tmp_path / place
    code, printed, error = run("--no-cache", *CURVE, "--format", "csv", "--out", out)
    assert (code, printed, error.count("\n")) == (PLACES[place][0], "", 1)
    assert PLACES[place][1].format(tmp_path) in error
    assert sorted(tmp_path.rglob("*")) == before
    assert (tmp_path / "file").read_text() == "mine"


@contextlib.contextmanager
def without_rights():
    """Root may write anywhere: as nobody for a while."""
    is_root = os.geteuid() == 0
    if is_root:
        os.setresuid(65534, 65534, 0)
    try:
        yield
    finally:
        if is_root:
            os.setresuid(0, 0, 0)


def test_a_folder_without_permission(tmp_path):
    for folder in [tmp_path, *list(tmp_path.parents)[:-2]]:
        if folder.owner() == tmp_path.owner():
            folder.chmod(0o755)
    (tmp_path / "closed").mkdir(0o555)
    with without_rights():
        out = tmp_path / "closed" / "results"
        code, printed, error = run("--no-cache", *CURVE, "--out", out)
    assert (code, printed, error.count("\n")) == (3, "", 1)
    assert "permission" in error.lower()
    assert str(tmp_path / "closed") in error


def test_a_result_not_saved_is_an_os_error(tmp_path):
    data = cal.RestitutionData([1.0, 2.0, 3.0], [0.8, 0.81, 0.79])
    result = cal.fit(data, "constant", profiles=False)
    with pytest.raises(OSError, match="could not be written to"):
        result.save(tmp_path / ("x" * 300) / "fit.json")


def redirected(streams, *words, **options):
    command = ["sh", "-c", f'"$@" {streams}', "sh", *COMMAND, *words]
    return subprocess.run(command, capture_output=True, check=False, **options)


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="of Linux")
@pytest.mark.parametrize("streams", [">/dev/full", ">&-", "<&- >&- 2>&-"])
def test_output_that_is_full_or_closed(streams):
    done = redirected(streams, "--help")
    assert done.returncode == 3
    assert done.stderr.count(b"\n") == (0 if "2>" in streams else 1)
    assert b"Traceback" not in done.stderr


def test_an_umlaut_where_there_is_only_ascii_and_a_path_that_is_no_text(tmp_path):
    """With closed errors and input: a file of results never becomes a stream that was closed."""
    file = write_alloy(tmp_path, 'law = "constant"\nprofiles = false')
    (tmp_path / "my_alloy.csv").rename(tmp_path / "prüfung.csv")
    text = file.read_text(encoding="utf-8").replace("my_alloy.csv", "prüfung.csv")
    file.rename(tmp_path / "härte.toml").write_text(text, encoding="utf-8")
    plain = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    out = b"st\xfc/ergebnis_\xc3\xbc"
    environment = os.environ | plain | {"PYTHONPATH": os.getcwd()}
    words = ("fit", b"h\xc3\xa4rte.toml", "--out", out)
    done = redirected("<&- 2>&-", *words, env=environment, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, b"")
    assert "std. error" in done.stdout.decode("ascii")
    folder = os.path.join(os.fsencode(tmp_path), out)
    assert set(os.listdir(folder)) >= {b"fit.json", b"report.html", b"curves.png"}
    with open(os.path.join(folder, b"report.html"), encoding="utf-8") as report:
        assert "±" in report.read()
    with open(os.path.join(folder, b"fit.json"), encoding="utf-8") as table:
        assert json.load(table)["converged"] is True


# errors of softjax itself are no fault of the input: a trace, and an exit code of their own

INTERNAL = "softjax: an error of softjax itself, please report it with the lines above\n"


def raising(error):
    def raises(*_, **__):
        raise error

    return raises


@pytest.mark.parametrize("kind", [np.linalg.LinAlgError, ValueError])
def test_what_fails_inside_a_fit_is_not_told_as_the_users_input(kind, quick, tmp_path, monkeypatch):
    """Any ValueError within, LinAlgError is one, was one line, exit code 2 and "nothing was fitted"."""
    failing = raising(kind("did not converge"))
    for name in ("inv", "pinv", "solve", "svd", "qr", "eigh", "cholesky", "lstsq"):
        monkeypatch.setattr(np.linalg, name, failing)
    for name in ("solve_triangular", "cho_factor", "cho_solve", "cholesky"):
        monkeypatch.setattr(scipy.linalg, name, failing)
    code, _, error = run("--no-cache", "fit", quick, "--out", tmp_path / "results")
    assert code == 70
    assert error.startswith("Traceback (most recent call last):\n")
    assert error.endswith(f"{kind.__name__}: did not converge\n{INTERNAL}")
    assert not (tmp_path / "results").exists()


def test_a_file_of_a_library_that_is_missing_is_no_want_of_space(tmp_path, monkeypatch):
    missing = FileNotFoundError(2, "No such file or directory", "/usr/share/fonts/none.ttf")
    monkeypatch.setattr(Figure, "savefig", raising(missing))
    code, _, error = run("--no-cache", *CURVE, "--out", tmp_path / "results")
    assert code == 3
    assert "/usr/share/fonts/none.ttf" in error
    assert "space" not in error
    assert {path.suffix for path in (tmp_path / "results").iterdir()} == {".csv"}


CODES = {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGHUP: 129}


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
        words = ("--velocities", "-", "--format", "csv", "--out", "results", "--quiet")
        try:
            result = run("--no-cache", "curve", *CONSTANT, *words)
            assert signal.getsignal(number) is handler
        finally:
            signal.signal(number, inherited)
        return result

    return said


def test_results_of_a_working_directory_that_was_removed_are_not_written(at, monkeypatch):
    (at / "gone").mkdir()
    monkeypatch.chdir(at / "gone")
    (at / "gone").rmdir()
    code, out, error = run("--no-cache", *CURVE, "--out", "results")
    monkeypatch.chdir(at)
    line = "softjax: 'results' could not be written to (No such file or directory)\n"
    assert (code, out, error) == (3, "", line)


def wait(steps=500):
    """Five seconds, between whose steps a signal is heard."""
    for _ in range(steps):
        time.sleep(0.01)


def while_collecting(number):
    """Send a signal during a garbage collection, whose callbacks swallow what is raised in them."""

    def callback(*_):
        gc.callbacks.remove(callback)
        signal.raise_signal(number)

    gc.callbacks.append(callback)
    gc.collect()
    wait()


def while_an_extension_begins(number):
    """Extension modules make an `ImportError` of what is raised then."""
    try:
        signal.raise_signal(number)
    except KeyboardInterrupt:
        raise ImportError("an extension that was interrupted") from None


def while_importing(number):
    """What an extension calls while it begins may crash it: the process ended by a segmentation fault."""
    Path("begins.py").write_text(
        f"import signal\nsignal.raise_signal({number:d})\nis_whole = True\n"
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(os.getcwd())
        assert importlib.import_module("begins").is_whole
        os.remove("begins.py")
        wait()


def while_swallowing(number, then=500):
    """C code that looks an attribute up clears whatever is raised meanwhile."""
    try:
        signal.raise_signal(number)
    except KeyboardInterrupt:
        wait(then)


STOPS = [(number, signal.raise_signal) for number in CODES]
STOPS += [(signal.SIGINT, while_swallowing)]
HOW = (while_collecting, while_an_extension_begins, while_importing)
STOPS += [(signal.SIGTERM, send) for send in HOW]


@pytest.mark.parametrize(("number", "send"), STOPS)
def test_a_command_that_is_stopped_leaves_what_was_there(number, send, signalled, at):
    line = "softjax: interrupted, nothing written\n"
    assert signalled(number, unheard, send) == (CODES[number], "", line)
    assert {path.name for path in at.iterdir()} <= {"results", "__pycache__"}
    assert os.listdir("results") == ["curve.csv"]
    assert (at / "results" / "curve.csv").read_text() == "old"


def test_a_signal_stops_where_a_thread_is_long_in_starting_and_says_what_was_written(
    signalled, monkeypatch
):
    code, out, error = signalled(signal.SIGTERM, unheard, partial(while_swallowing, then=0))
    line = "softjax: interrupted after its results were written to results\n"
    assert (code, out, error) == (143, "", line)
    start = threading.Thread.start
    monkeypatch.setattr(threading.Thread, "start", lambda self: (start(self), time.sleep(0.5)))
    code, out, error = signalled(signal.SIGTERM, unheard, while_collecting)
    assert (code, out, error.splitlines()[-1]) == (
        143,
        "",
        "softjax: interrupted, nothing written",
    )


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
