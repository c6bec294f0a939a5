"""The command line itself: what it refuses, its exit codes, and what it imports before it works."""

import re
import subprocess
import sys

import pytest

from calibration import cli
from tests.command import run

COMMANDS = ("curve", "sensitivity", "fit", "compare", "export", "speed", "doctor")
HEAVY = ("jax", "numpy", "diffrax", "optax", "matplotlib", "scipy", "softjax")


def exit_code(argv) -> int:
    """What the shell would see."""
    try:
        return cli.main(argv)
    except SystemExit as stop:
        return int(stop.code or 0)


CURVE = ["nylon", "--points", "3", "--format", "csv"]


@pytest.mark.parametrize(
    "argv",
    [
        ["--out", "there", "--quiet", "curve", *CURVE],
        ["curve", *CURVE, "--out", "there", "--quiet"],
        ["--quiet", "curve", "--out=there", *CURVE],
        ["--out", "elsewhere", "curve", "--quiet", "--out", "there", *CURVE],
    ],
)
def test_common_options_stand_before_or_after_the_command(argv, at):
    assert run(*argv) == (0, "", "")
    assert [str(path.relative_to(at)) for path in at.rglob("*.csv")] == ["there/curve.csv"]


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_documents_the_common_options(name, capsys):
    assert exit_code([name, "--help"]) == 0
    text = capsys.readouterr().out
    for word in ("--out", "--quiet", "--no-cache", "exit codes"):
        assert word in text
    assert "default: None" not in text


def test_help_lists_every_command_and_imports_nothing_heavy():
    script = (
        "import sys\nfrom calibration.cli import main\n"
        "try:\n    main(sys.argv[1:])\nexcept SystemExit:\n    pass\n"
        f"print([name for name in {HEAVY!r} if name in sys.modules])"
    )
    for argv in (["--help"], ["fit", "--help"]):
        ended = subprocess.run(
            [sys.executable, "-c", script, *argv], capture_output=True, text=True, check=True
        )
        assert ended.stdout.splitlines()[-1] == "[]"
        assert ended.stderr == ""
        if argv == ["--help"]:
            listed = re.search(r"commands:\n(.*?)\n\n", ended.stdout, re.S)[1]
            assert tuple(line.split()[0] for line in listed.splitlines()) == COMMANDS
