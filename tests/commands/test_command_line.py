"""What commands refuse: one line that names it, exit code 2, nothing written; and the command line itself."""

import subprocess
import sys

import numpy as np
import pytest

import softjax as sj
from tests.command import noisy, run, write_alloy
from tests.shown.capture import as_recorded

CONSTANT = "curve nylon --law constant"
SENSITIVITY = "sensitivity nylon"
GLOBAL = f"{SENSITIVITY} --study global"
EXPORT = "export stainless-steel"
# words of the command line, _ for a space within one: what the line has, parted by |
REFUSED = {
    "": "COMMAND",
    "fti ALLOY --law compare": "'fti'|did you mean 'fit'",  # whatever stands behind it
    "no_such.toml fit": "'no_such.toml'",
    "--vesion": "did you mean '--version'",
    "fit --colour": "--colour",
    "fit --sead 3": "did you mean '--seed'",
    "fit shots.csv": "give the TOML file that names it, with data = 'shots.csv'",
    "fit --objective three-step": "two-step",
    "fit --route euler": "energy-balance",
    "fit --seed -1": "--seed",
    "fit --starts 0": "greater than or equal to 1",
    "fit a.toml b.toml": "b.toml",
    "fit no_such.toml": "no such file",
    "fit --out": "--out",
    "fit --posterior --objective two-step": "`--objective` must be model for a posterior: it has a likelihood",
    "fit ALLOY --rtol 1e-6 --route energy-balance": "`--rtol` must be left out",
    "fit ALLOY --noise-dof 5": "`--noise-dof` must be left out",
    "fit ALLOY --law hertz --form full": "`--form` must be left out with hertz (its options: none)",
    "fit ALLOY --law hertz --objective two-step": "`--objective` must be",
    "fit ALLOY --extra-scatter --scale-uncertainty": "`--scale-uncertainty` must be left out",
    f"{SENSITIVITY} --study globl": "did you mean 'global'",
    "compare ALLOY --laws ,": "--laws",
    "compare ALLOY --laws hertz --form full": "zhou among the laws",
    "compare ALLOY --laws zhou --end zero-force": "hertz-dashpot or linear",
    "compare ALLOY --free yield_factor": "--free",
    "curve --law herz": "did you mean 'hertz'",
    "curve shots.csv": "is a table of measurements",
    "curve brass": "nylon",
    "curve nylo": "did you mean 'nylon'",
    "curve nylon --from 2 --to 1": "--to|2",
    "curve nylon --from -1": "--from|-1",
    "curve nylon --from 0 --spacing log": "--from|above 0",
    "curve nylon --points 0": "--points|1 or more",
    "curve nylon --points 1000001": "--points|1000000 rows|softjax.restitution",
    "curve nylon --to inf": "--to|inf",
    "curve nylon --velocities none.csv": "none.csv|no such file",
    "curve nylon --velocities - --points 3": "--velocities",
    "curve nylon --area hertz": "--chi",
    "curve ALLOY": "--chi",
    "curve nylon --rtol 1e-9": "--rtol",
    "curve nylon --set chii=1": "did you mean 'chi'",
    "curve nylon --set contact=1": "--set",
    "curve nylon --law hertz --chi 1": "--chi",
    "curve nylon --law hertz --set sigma=1": "--set",
    CONSTANT: "restitution",
    f"{CONSTANT} --set restitution": "name=value",
    f"{CONSTANT} --set restitution=2": "[0, 1]|2",
    "curve --fit none.json": "none.json|no such file",
    "curve --fit none.json --law zhou": "--law",
    "curve nylon --material x": "--material",
    "curve EMPTY --points 3": "MATERIAL",
    "curve --fit FIT --chi 0": "--chi",
    "curve --fit FIT --set chi=0.1": "--set",
    "curve --fit FIT --route ode": "--route",
    "curve --fit FIT chrome-steel --material nylon": "MATERIAL|--fit",
    "curve --fit FIT --material EMPTY": "--material",
    "curve --fit FIT --from 0.1 --to 0.2 --points 5": "do not determine",
    f"{SENSITIVITY} --range chi=0.1:0.4": "--range",
    f"{SENSITIVITY} --from 0": "--from",
    f"{SENSITIVITY} --to inf": "`--to` must be a finite velocity above 0 m/s, but is inf",
    f"{SENSITIVITY} --posterior x.nc": "`--posterior` must be left out without --fit",
    f"{SENSITIVITY} --at -1": "--at",
    f"{SENSITIVITY} --points 1": "--points",
    f"{SENSITIVITY} --shots 4": "--shots",
    f"{SENSITIVITY} --law constant --set restitution=0": "ε = 0 everywhere",
    f"{GLOBAL} --range chi=-0.1:0.1": "chi = -0.1 … 0.1",
    f"{SENSITIVITY} --study design --target critical_velocity": "none of them affects it",
    f"{SENSITIVITY} --study design --over 1:2": "`--over` must be left out with criterion c",
    f"{SENSITIVITY} --study design --shots 0": "`--shots` must be a whole number >= 1, but is 0",
    f"{SENSITIVITY} --study design --sensor foo=2": "`--sensor` must be of contact_time",
    f"{SENSITIVITY} --study design --criterion I --over fast": "--over",
    f"{SENSITIVITY} --study design --criterion I --over 3:1": "`--over` must be LOW:HIGH, the lower one first, but is 3:1",
    f"{SENSITIVITY} --study information --shots 0": "`--shots` must be a whole number of 1",
    f"{SENSITIVITY} --study information --free yield_strength=much": "--free",
    "sensitivity --fit FIT --study design --free radius": "--free",
    "sensitivity --fit FIT --study design --fix psi": "--fix",
    "export nylon --to lamps": "did you mean 'lammps'",
    EXPORT: "--to",
    f"{EXPORT} --to c --range 5": "--range|LOW:HIGH",
    f"{EXPORT} --to c --range 6:1": "`--range` must be LOW:HIGH, the lower one first, but is 6:1",
    f"{EXPORT} --to c --export-law foo": "`--export-law` must be auto, linear",
    f"{EXPORT} --to c --law hertz-dashpot": "`--law` must be given with --set",
    "export --fit FIT --to c --law zhou": "`--law` must be left out with --fit",
    "export --fit FIT --to c --range 0.05:20": "where the data determine",
}


@pytest.fixture(scope="module")
def files(tmp_path_factory, above_yield):
    alloy = write_alloy(tmp_path_factory.mktemp("given"))
    return {"ALLOY": str(alloy), "FIT": above_yield[1], "EMPTY": ""}


def check(argv, blamed):
    code, out, err = run(*argv)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert all(part in err for part in blamed.split("|")), err
    return err


@pytest.mark.parametrize("words", REFUSED)
def test_unusable_command_lines_are_refused(words, files, at):
    err = check([files.get(word, word) for word in words.split()], REFUSED[words])
    if "--help lists" not in err:  # which are the parser's own, another Python has others
        err = err.replace(str(files["FIT"]), "FIT").replace(files["ALLOY"], "ALLOY")
        as_recorded(f"refused: {words}", {"error": err}, exactly=True)
    assert list(at.iterdir()) == []


FREE = "give --chi X, fix it by a plain number, or read its fit by --fit"
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
    more += [] if command == "fit" or "thornton" in more else ["--sigma", "1", "--psi", "0.5"]
    file = str(write_alloy(at, settings, below=below))
    check([command, file, *more], blamed)
    assert not (at / "results").exists()


ALLOY = noisy().contact
ZHOU, THORNTON = sj.Zhou(ALLOY, 0.2, 1.0, 0.5), 'law = "thornton"'
TAKEN = [
    ("", "chi = { value = 0.1 }", "--chi 0.2 --sigma 1 --psi 0.5", ZHOU),
    ("", "chi = 0.2", "--sigma 1 --psi 0.5", ZHOU),
    ("", "chi = { value = 0.2, free = false }", "--sigma 1 --psi 0.5", ZHOU),
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

COMMANDS = ("curve", "sensitivity", "fit", "compare", "export", "speed", "doctor")
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
