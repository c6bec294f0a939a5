"""What cannot be written: one line, exit code 3, and the results where they can be."""

import contextlib
import io
import json
import os
import resource
import subprocess
import sys
import time

import jax
import pytest

import calibration as cal
from calibration import cache, cli
from calibration.atomic import check_writable
from calibration.errors import InputError, NotWritten
from tests.command import run, write_alloy
from tests.slow_command import COMMAND


@contextlib.contextmanager
def files_of_at_most(size):
    """No file grows beyond so many bytes, as on a full disk; JAX's cache is left alone."""
    before = jax.config.jax_persistent_cache_min_compile_time_secs
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 1e9)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", before)


@pytest.fixture(scope="module")
def alloy(tmp_path_factory):
    """A material file that is soon fitted."""
    return write_alloy(tmp_path_factory.mktemp("alloy"), 'law = "constant"\nprofiles = false')


@pytest.mark.parametrize("most", [500, 20_000])
def test_a_full_disk_costs_the_files_and_not_the_report(most, alloy, tmp_path):
    """The first file is the larger of both, the picture the other."""
    out = tmp_path / "results"
    out.mkdir()
    (out / "fit.json").write_text("old")
    with files_of_at_most(most):
        code, told, error = run("--no-cache", "fit", alloy, "--out", out)
    assert code == 3
    assert error == f"softjax: {str(out)!r} could not be written to (File too large)\n"
    assert "my alloy  constant" in told or "ε" in told
    assert "converged" in told
    assert "Written to" not in told
    assert [path.name for path in tmp_path.iterdir()] == ["results"]
    assert {path.name: path.read_text() for path in out.iterdir()} == {"fit.json": "old"}


COMMANDS = {
    "compare": (["compare", "ALLOY", "--laws", "constant"], "constant"),
    "sensitivity": (["sensitivity", "nylon", "--law", "constant", "--set", "restitution=0.8"], "e"),
}


@pytest.mark.parametrize("name", COMMANDS)
def test_other_commands_tell_what_they_found(name, alloy, tmp_path):
    words, found = COMMANDS[name]
    words = [str(alloy) if word == "ALLOY" else word for word in words]
    with files_of_at_most(100):
        code, told, error = run("--no-cache", *words, "--out", tmp_path / "results")
    assert code == 3
    assert len(error.splitlines()) == 1
    assert found in told
    assert list(tmp_path.iterdir()) == []


PLACES = {
    "a long name": ("x" * 300, "File name too long"),
    "a long name below": (f"new/{'x' * 300}", "File name too long"),
    "of the system": ("/proc/results", "No such file or directory"),
}


@pytest.mark.parametrize("name", PLACES)
def test_an_impossible_place(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    out, reason = PLACES[name]
    if not os.path.exists("/proc") and out.startswith("/proc"):
        pytest.skip("there is no /proc")
    code, told, error = run(
        "--no-cache", "curve", "nylon", "--points", 20, "--format", "csv", "--out", out
    )
    assert (code, told) == (3, "")
    assert error.endswith(f"could not be written to ({reason})\n")
    assert list(tmp_path.iterdir()) == []


def test_compilations_that_may_be_cut_short_are_not_kept(tmp_path, monkeypatch):
    """JAX takes up no cut entry, and writes none that is there: it would be compiled for ever."""
    monkeypatch.setattr(cache, "_kept", tmp_path)
    for name, age in (("old-cache", 60.0), ("new-cache", 0.0)):
        (tmp_path / name).write_text("")
        os.utime(tmp_path / name, times=(time.time() - age,) * 2)
    cache.forget_since(time.time() - 2.0)
    assert [path.name for path in tmp_path.iterdir()] == ["old-cache"]


def test_a_link_to_nothing_is_called_one(tmp_path):
    for name, target in (("results", "nowhere"), ("ring", "ring")):
        (tmp_path / name).symlink_to(target)
        for path in (tmp_path / name, tmp_path / name / "below"):
            with pytest.raises(InputError, match=f"is a link to '{target}', which is not there;"):
                check_writable(path)


def test_a_result_that_cannot_be_saved_is_an_os_error(tmp_path):
    with pytest.raises(NotWritten) as caught:
        cal.FitResult.save(None, tmp_path / ("x" * 300) / "fit.json")  # type: ignore[arg-type]
    assert isinstance(caught.value, OSError)


STREAMS = {  # how standard streams are given, exit code, standard output, standard error
    "full output": (">/dev/full", 3, "", "standard output could not be written to (No space left"),
    "closed output": (
        ">&-",
        3,
        "",
        "standard output could not be written to (Bad file descriptor)",
    ),
    "closed errors": ("2>&-", 0, "begun\nχ̃ is new\n", ""),
    "closed input": ("<&-", 0, "begun\nχ̃ is new\n", ""),
    "all closed": ("<&- >&- 2>&-", 3, "", ""),
}


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="of Linux")
@pytest.mark.parametrize("name", STREAMS)
def test_streams_that_are_closed_or_full(name, tmp_path):
    streams, code, told, error = STREAMS[name]
    # what is printed stays in the buffer until the end, as it does without a terminal
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONUNBUFFERED"}
    done = subprocess.run(
        ["sh", "-c", f'"$@" {streams}', "sh", *COMMAND, "--out", str(tmp_path / "results")],
        capture_output=True,
        text=True,
        encoding="utf-8",
        env=environment,
        check=False,
    )
    assert done.returncode == code
    assert done.stdout == told
    assert error in done.stderr
    assert len(done.stderr.splitlines()) == bool(error)
    if name != "full output" and "closed output" not in name and name != "all closed":
        assert {path.name for path in (tmp_path / "results").iterdir()} == {"a", "b"}


def test_help_into_a_full_disk():
    with open("/dev/full", "w") as full, contextlib.redirect_stdout(full):
        error = io.StringIO()
        with contextlib.redirect_stderr(error):
            assert cli.main(["--help"]) == 3
    assert "No space left" in error.getvalue()


@pytest.mark.parametrize("command", ["", "fit"])
def test_the_exit_codes_are_told(command, capsys):
    with pytest.raises(SystemExit):
        cli.main([*command.split(), "--help"])
    told = capsys.readouterr().out
    assert "3  results could not be written" in told


def test_an_umlaut_where_there_is_only_ascii_and_a_path_that_is_no_text(tmp_path):
    """Both lost the fit while the report was written."""
    file = write_alloy(tmp_path, 'law = "constant"\nprofiles = false')
    (tmp_path / "my_alloy.csv").rename(tmp_path / "prüfung.csv")
    text = file.read_text(encoding="utf-8").replace("my_alloy.csv", "prüfung.csv")
    file.rename(tmp_path / "härte.toml").write_text(text, encoding="utf-8")
    plain = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    out = b"st\xfc/ergebnis_\xc3\xbc"
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "calibration",
            "--no-cache",
            "fit",
            b"h\xc3\xa4rte.toml",
            "--out",
            out,
        ],
        capture_output=True,
        env=os.environ | plain | {"PYTHONPATH": os.getcwd()},
        cwd=tmp_path,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, b"")
    told = done.stdout.decode("ascii")
    assert "value +/- std. error" in told
    assert "eps" in told
    folder = os.path.join(os.fsencode(tmp_path), out)
    assert set(os.listdir(folder)) >= {b"fit.json", b"report.md", b"curves.png"}
    with open(os.path.join(folder, b"report.md"), encoding="utf-8") as report:
        text = report.read()
    assert "±" in text
    assert r"`softjax fit $'h\xc3\xa4rte.toml' --out $'st\xfc/ergebnis_\xc3\xbc'`" in text
    with open(os.path.join(folder, b"fit.json"), encoding="utf-8") as table:
        assert json.load(table)["converged"] is True
