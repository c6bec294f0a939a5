"""What commands refuse: one line that names it, exit code 2, nothing written; and the command line itself."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import softjax as sj
from calibration.cli import COMMANDS
from tests import records
from tests.command import noisy, run, write_alloy
from tests.shown.capture import as_recorded

# each command line and the sentence that it gets; of those of Python's parser the parts that count, between …
REFUSED = Path(__file__).with_name("refused.txt")


@pytest.fixture(scope="module")
def files(tmp_path_factory, above_yield):
    alloy = write_alloy(tmp_path_factory.mktemp("given"))
    return {"ALLOY": str(alloy), "FIT": above_yield[1], "EMPTY": ""}


def check(argv, parts=()) -> str:
    code, out, err = run(*argv)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert all(part in err for part in parts), err
    return err


@pytest.mark.parametrize("words", records.sentences(REFUSED))
def test_unusable_command_lines_are_refused(words, files, at):
    err = check([files.get(word, word) for word in words.split()])
    err = err.replace(str(files["FIT"]), "FIT").replace(files["ALLOY"], "ALLOY")
    assert list(at.iterdir()) == []
    records.as_sentence(REFUSED, words, " ".join(err.split()))


FREE = "give --set chi=X, fix it by a plain number, or read its fit by --fit"
OF_START = f"alloy.toml:13: chi is free, and its value a start; {FREE}"
FACTOR = "--set yield_factor=X"
NOT_SAID = [
    ("fit", "", "restitution = 0.5", "alloy.toml:13: parameter is restitution; it must be of"),
    ("fit", 'law = "hertz"\nobjective = "two-step"', "", "alloy.toml:4: objective is"),
    ("fit", 'law = "thornton"\nroute = "closed form"', "", "Thornton"),
    ("curve", "", "chi = { value = 0.1, bounds = [0.01, 10.0] }", OF_START),
    ("export --to c", "", "chi = { prior = [0.1, 0.05] }", f"alloy.toml:13: chi is free; {FREE}"),
    ("sensitivity", "", "chi = { value = 0.1 }", OF_START),
    # which has a default: a file that leaves it to a fit does not say so
    (
        "curve --law thornton",
        "",
        "yield_factor = { value = 1.2 }",
        f":13: yield_factor is free|{FACTOR}",
    ),
]


@pytest.mark.parametrize(("words", "settings", "below", "blamed"), NOT_SAID)
def test_what_a_file_may_not_say_is_refused(words, settings, below, blamed, capsys, at):
    command, *more = words.split()
    more += [] if command == "fit" or "thornton" in more else ["--set", "sigma=1", "psi=0.5"]
    file = str(write_alloy(at, settings, below=below))
    check([command, file, *more], blamed.split("|"))
    assert not (at / "results").exists()


ALLOY = noisy().contact
ZHOU, THORNTON = sj.Zhou(ALLOY, 0.2, 1.0, 0.5), 'law = "thornton"'
TAKEN = [
    ("", "chi = { value = 0.1 }", "--set chi=0.2 sigma=1 psi=0.5", ZHOU),
    ("", "chi = 0.2", "--set sigma=1 psi=0.5", ZHOU),
    ("", "chi = { value = 0.2, free = false }", "--set sigma=1 psi=0.5", ZHOU),
    (THORNTON, "yield_factor = { value = 1.2 }", f"{FACTOR[:-1]}1.3", sj.Thornton(ALLOY, 1.3)),
    (THORNTON, "yield_factor = 2.5", "", sj.Thornton(ALLOY, 2.5)),
    (THORNTON, "yield_factor = 2.5", f"{FACTOR[:-1]}2", sj.Thornton(ALLOY, 2.0)),
    (THORNTON, "yield_factor = 2.5", "--law hertz", sj.Hertz(ALLOY)),
    ("", "chi = { value = 0.1 }", "--law thornton", sj.Thornton(ALLOY)),  # another law's
]


@pytest.mark.parametrize(("settings", "below", "more", "law"), TAKEN)
def test_a_value_that_is_fixed_or_given_is_taken(settings, below, more, law, at):
    words = ("--from", 2, "--to", 20, "--points", 5, "--format", "csv", "--out", "results")
    file = write_alloy(at, settings, below)
    assert run("curve", file, *more.split(), *words)[0] == 0
    rows = np.loadtxt(at / "results/curve.csv", delimiter=",", skiprows=1, usecols=(0, 1))
    expected = sj.restitution(law, rows[:, 0]).coefficient
    np.testing.assert_allclose(rows[:, 1], expected, rtol=1e-12)


# the command line itself

HEAVY = ("jax", "numpy", "diffrax", "optax", "matplotlib", "scipy", "softjax")
CURVE = ["nylon", "--points", "3", "--format", "csv"]


@pytest.mark.parametrize(
    "argv",
    [
        ["--out", "there", "--quiet", "curve", *CURVE],
        ["curve", *CURVE, "--out", "there", "--quiet"],
        ["--quiet", "curve", "--out=there", *CURVE],
        ["--out", "fit", "curve", "--quiet", *CURVE, "--out", "there"],
        ["--out", "elsewhere", "curve", "--quiet", "--out", "there", *CURVE],
    ],
)
def test_common_options_stand_before_or_after_the_command(argv, at):
    assert run(*argv) == (0, "", "")
    assert [str(path.relative_to(at)) for path in at.rglob("*.csv")] == ["there/curve.csv"]


def test_the_help_of_every_command_is_that_which_is_recorded(monkeypatch):
    """Options with their words and defaults, those of all commands, exit codes."""
    monkeypatch.setenv("COLUMNS", "9999")  # no word is parted
    texts = {}
    for name in ("", *COMMANDS):
        code, texts[name], _ = run(*name.split(), "--help")
        assert (code, "default: None" in texts[name]) == (0, False)
    as_recorded("help", texts, exactly=True)


def test_help_imports_nothing_heavy():
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
