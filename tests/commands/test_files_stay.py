"""No command removes or changes a file that it does not write in this run."""

import re

import pytest

from tests.command import run

# all that a command may write, whichever command it is
RESULTS = (
    *("fit.json", "points.csv", "report.html", "curves.png", "profiles.png", "correlation.png"),
    *("posterior.png", "posterior.nc", "compare.json", "compare.png"),
    *("curve.csv", "curve.png", "curve.txt"),
    *("sensitivity.json", "sensitivity.csv", "sensitivity.png", "tornado.png", "design.png"),
    *("design.csv", "export.json", "export.png", "in.softjax", "softjax_law.h"),
    *("softjax_lammps.cpp", "build.sh", "softjax_yade.py"),
    *("speed.csv", "speed.png"),
)
STRANGERS = ("notes.txt", "fit.json.bak", ".hidden", "parts/thesis.tex", "parts/0123/000000")
UNFINISHED = ".softjax-unfinished-mine"  # as a killed command leaves one
CONSTANT = ("--law", "constant", "--set", "restitution=0.8")
SENSITIVITY = ("sensitivity", "nylon", *CONSTANT)
EXPORT = ("export", "nylon", "--law", *CONSTANT[1:])
COMMANDS = {
    "fit": (("fit", "ALLOY"), {"fit.json", "points.csv", "report.html", "curves.png"}),
    "compare": (("compare", "ALLOY", "--laws", "constant"), {"compare.json", "compare.png"}),
    "curve": (("curve", "nylon", *CONSTANT, "--points", "9"), {"curve.csv", "curve.png"}),
    "table": (("curve", "nylon", *CONSTANT, "--points", "9", "--table"), {"curve.txt"}),
    "local": (
        (*SENSITIVITY, "--study", "local"),
        {"sensitivity.json", "sensitivity.csv", "sensitivity.png", "tornado.png"},
    ),
    "information": ((*SENSITIVITY, "--study", "information"), {"sensitivity.json"}),
    "design": (
        (*SENSITIVITY, "--study", "design", "--shots", "2"),
        {"sensitivity.json", "design.png", "design.csv"},
    ),
    "c": ((*EXPORT, "--to", "c"), {"export.json", "export.png", "softjax_law.h"}),
    "liggghts": ((*EXPORT, "--to", "liggghts"), {"export.json", "export.png", "in.softjax"}),
    "lammps": ((*EXPORT, "--to", "lammps"), {"export.json", "export.png", "in.softjax"}),
    "yade": ((*EXPORT, "--to", "yade"), {"export.json", "export.png", "softjax_yade.py"}),
}


@pytest.mark.parametrize("name", COMMANDS)
def test_only_what_is_written_again_changes(name, quick, tmp_path):
    words, expected = COMMANDS[name]
    out = tmp_path / "results"
    every = {*RESULTS, *STRANGERS, f"{UNFINISHED}/fit.json", f"../{UNFINISHED}/fit.json"}
    for one in every:
        (out / one).parent.mkdir(parents=True, exist_ok=True)
        (out / one).write_text(f"old {one}")
    words = [str(quick) if word == "ALLOY" else word for word in words]
    code, printed, error = run("--no-cache", *words, "--out", out)
    assert code == 0, error
    line = f"Written to {out}: {', '.join(sorted(expected))}\n"
    assert printed.endswith(line)
    kept = {one for one in every if (out / one).read_bytes() == f"old {one}".encode()}
    assert every - kept == expected
    there = {path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file()}
    assert there == {one for one in every if not one.startswith("..")}  # nothing else is left
    # the command knows what it writes in its other forms
    others = [files for of, files in COMMANDS.values() if of[0] == words[0]]
    named = re.findall(r"[\w.]+\.\w+", error.partition("not written by this run")[2])
    assert set().union(*others) - expected <= {*named}


FEWER = {
    "fit": "fit: not written by this run, in OUT: posterior.png, posterior.nc",
    "local": "sensitivity: not written by this run, in OUT: design.csv",
    "c": "export: not written by this run, in OUT: build.sh",
}


@pytest.mark.parametrize("name", FEWER)
def test_what_this_run_did_not_write_is_named(name, quick, tmp_path):
    """One line for results of another run that look like this one's; the user's own are no matter."""
    line = FEWER[name].replace("OUT", str(tmp_path))
    for one in ("notes.txt", *line.partition(": not")[2].split(": ")[-1].split(", ")):
        (tmp_path / one).write_text("old")
    words = [str(quick) if word == "ALLOY" else word for word in COMMANDS[name][0]]
    assert run(*words, "--out", tmp_path)[2] == f"softjax {line}\n"
    assert run(*words, "--out", tmp_path, "--quiet")[2] == ""
