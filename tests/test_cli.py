"""The command line: what it refuses, with which exit code, and what it imports for that."""

import argparse
import importlib
import subprocess
import sys

import pytest

from calibration import cli
from calibration.commands import COMMANDS
from calibration.errors import InputError

HEAVY = ("jax", "numpy", "diffrax", "optax", "matplotlib", "scipy", "softjax")


def exit_code(argv) -> int:
    """What the shell would see."""
    try:
        return cli.main(argv)
    except SystemExit as stop:
        return int(stop.code or 0)


@pytest.fixture
def parsed(monkeypatch):
    """The arguments that `softjax fit` was run with; nothing is fitted."""
    seen = []

    def run(arguments):
        seen.append(arguments)
        return 0

    monkeypatch.setattr("calibration.commands.fit.run", run)
    return seen


@pytest.mark.parametrize(
    ("argv", "blamed"),
    [
        ([], "COMMAND"),
        (["fti"], "did you mean 'fit'"),
        (["--colour", "fit"], "--colour"),
        (["fit", "--colour"], "--colour"),
        (["fit", "--objective", "three-step"], "two-step"),
        (["fit", "--route", "euler"], "energy-balance"),
        (["fit", "--seed", "-1"], "--seed"),
        (["fit", "--starts", "0"], "1 or more"),
        (["fit", "--starts", "many"], "'many'"),
        (["fit", "a.toml", "b.toml"], "b.toml"),
        (["fit", "no such.toml"], "no such file"),
        (["fit", "--out"], "--out"),
    ],
)
def test_unusable_command_lines_are_refused(argv, blamed, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert exit_code(argv) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert len(err.splitlines()) == 1
    assert blamed in err
    assert list(tmp_path.iterdir()) == []


def test_a_refused_file_is_named_with_its_line_and_leaves_no_directory(capsys, tmp_path):
    file = tmp_path / "bad.toml"
    file.write_text('[[material]]\nname = "a"\ncolour = "red"\ndata = "a.csv"\n', encoding="utf-8")
    out = tmp_path / "results"
    assert exit_code(["fit", str(file), "--out", str(out)]) == 2
    line = capsys.readouterr().err
    assert line.startswith(f"{file}:3: ")
    assert ";" in line
    assert not out.exists()


def test_an_output_that_is_a_file_is_refused_before_any_work(capsys, tmp_path, parsed, monkeypatch):
    monkeypatch.undo()  # the real command
    taken = tmp_path / "taken"
    taken.write_text("mine", encoding="utf-8")
    assert exit_code(["fit", "--out", str(taken / "below")]) == 2
    assert "taken" in capsys.readouterr().err
    assert taken.read_text(encoding="utf-8") == "mine"


@pytest.mark.parametrize(
    "argv",
    [
        ["--out", "there", "--quiet", "fit", "x.toml", "--seed", "7"],
        ["fit", "x.toml", "--seed", "7", "--out", "there", "--quiet"],
        ["--quiet", "fit", "--out=there", "--seed=7", "x.toml"],
        ["--out", "elsewhere", "fit", "--quiet", "--out", "there", "--seed", "7", "x.toml"],
    ],
)
def test_common_options_stand_before_or_behind_the_command(argv, parsed):
    assert exit_code(argv) == 0
    (arguments,) = parsed
    assert str(arguments.out) == "there"
    assert arguments.quiet is True
    assert (arguments.file, arguments.seed) == ("x.toml", 7)


def test_defaults(parsed):
    assert exit_code(["fit"]) == 0
    (arguments,) = parsed
    assert str(arguments.out) == "results"
    assert arguments.quiet is False
    assert arguments.file is None
    assert arguments.objective is None  # so that a file's own setting is not overridden


@pytest.mark.parametrize("code", [0, 1])
def test_the_command_gives_the_exit_code(code, monkeypatch):
    monkeypatch.setattr("calibration.commands.fit.run", lambda arguments: code)
    assert exit_code(["fit"]) == code


def test_a_refusal_deep_inside_becomes_one_line(monkeypatch, capsys):
    def run(arguments):
        raise InputError("f.csv", 3, "epsilon is\n-1", "zero or more")

    monkeypatch.setattr("calibration.commands.fit.run", run)
    assert exit_code(["fit"]) == 2
    assert capsys.readouterr().err == "f.csv:3: epsilon is -1; zero or more\n"


def test_a_bug_is_no_refusal(monkeypatch):
    def run(arguments):
        raise ValueError("a bug")

    monkeypatch.setattr("calibration.commands.fit.run", run)
    with pytest.raises(ValueError, match="a bug"):
        cli.main(["fit"])


def test_an_interrupt_is_told_in_one_line(monkeypatch, capsys):
    def run(arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr("calibration.commands.fit.run", run)
    assert exit_code(["fit"]) == 130
    assert len(capsys.readouterr().err.splitlines()) == 1


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_is_what_the_command_line_expects(name, capsys):
    command = importlib.import_module(f"calibration.commands.{name}")
    command.add_arguments(argparse.ArgumentParser())
    assert callable(command.run)
    assert exit_code([name, "--help"]) == 0
    told = capsys.readouterr().out
    assert "--out" in told
    assert "--quiet" in told


def test_help_names_every_command_and_imports_nothing_heavy():
    script = (
        "import sys\nfrom calibration.cli import main\n"
        "try:\n    main(sys.argv[1:])\nexcept SystemExit:\n    pass\n"
        f"print([name for name in {HEAVY!r} if name in sys.modules])"
    )
    for argv in (["--help"], ["fit", "--help"]):
        run = subprocess.run(
            [sys.executable, "-c", script, *argv], capture_output=True, text=True, check=True
        )
        assert run.stdout.splitlines()[-1] == "[]"
        assert run.stderr == ""
        if argv == ["--help"]:
            assert all(name in run.stdout for name in COMMANDS)


def test_python_m_calibration_is_the_same_command():
    run = subprocess.run(
        [sys.executable, "-m", "calibration", "fit", "--loss", "absolute"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 2
    assert run.stderr.startswith("softjax fit: ")
    assert "huber" in run.stderr
