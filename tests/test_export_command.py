"""`softjax export` from the command line to its files: each option by what it does."""

import ast
import json
import os
import subprocess

import numpy as np
import pytest

import calibration as cal
import softjax as sj
from calibration.cli import main
from tests.cases import fitted
from tests.command import BODIES
from tests.export_cases import compile_alone, compiled, needs_compiler

STEEL = ("stainless-steel", "--range", "0.1:5")


@pytest.fixture
def export(tmp_path, monkeypatch):
    """Run the command in a directory of its own; gives its exit code."""
    monkeypatch.chdir(tmp_path)
    return lambda *options: main(["export", *options])


@pytest.fixture(scope="module")
def fit_file(tmp_path_factory):
    """Fits of two materials, of which the second knows nothing below first yield."""
    steel, nylon = fitted("stainless steel"), fitted("nylon")
    sets = []
    for name, law, velocity in (
        ("steel", steel, np.geomspace(0.1, 3, 24)),
        ("nylon", nylon, np.geomspace(1.5, 20, 24)),
    ):
        exact = np.asarray(sj.restitution(law, velocity).coefficient)
        sets.append(cal.RestitutionData(velocity, exact, law.contact, 0.003, name=name))
    path = tmp_path_factory.mktemp("fit") / "fit.json"
    cal.fit(sets, profiles=False).save(path)
    return path


def report(folder="results"):
    with open(f"{folder}/export.json", encoding="utf-8") as file:
        return json.load(file)


def text(name, folder="results"):
    with open(f"{folder}/{name}", encoding="utf-8") as file:
        return file.read()


def test_a_named_material_becomes_a_header(export, capsys, tmp_path):
    assert export(*STEEL, "--to", "c", "--tolerance", "0.005") == 0
    told = capsys.readouterr()
    assert told.err == ""
    assert "χ̃ = 1.7944" in told.out
    assert "Zhou's law itself (by header)" in told.out
    assert {p.name for p in (tmp_path / "results").iterdir()} == {
        "softjax_law.h",
        "export.json",
        "export.png",
    }
    made = report()
    assert made["velocity_range"] == [0.1, 5.0]
    assert made["largest_error"] <= made["tolerance"] == 0.005
    assert made["radius"] == {"value": 0.0127, "of": "sphere's"}


def test_a_fit_is_handed_over_material_by_material(export, fit_file):
    options = ("--fit", str(fit_file), "--to", "c", "--tolerance", "0.02")
    assert export(*options, "--material", "steel", "--out", "steel") == 0
    assert export(*options, "--material", "nylon", "--out", "nylon", "--quiet") == 0
    steel, nylon = report("steel"), report("nylon")
    assert (steel["material"], nylon["material"]) == ("steel", "nylon")
    assert steel["velocity_range"] == pytest.approx([0.1, 3.0])  # those of the data
    assert nylon["velocity_range"] == pytest.approx([1.5, 20.0])
    assert not any(caution.startswith("Measured") for caution in nylon["cautions"])
    exact = sj.restitution(fitted("nylon"), np.array(nylon["curve"]["velocity"])).coefficient
    np.testing.assert_allclose(nylon["curve"]["wanted"], exact, atol=1e-6)


def test_what_would_not_act_on_a_fit_is_refused_by_its_own_name(export, fit_file, capsys):
    assert export("--fit", str(fit_file), "--to", "c", "--wanted-law", "zhou") == 2
    assert "`--wanted-law` must be left out with --fit" in capsys.readouterr().err


def test_what_nobody_measured_and_what_is_doubted_is_said(export, fit_file, capsys):
    options = ("--fit", str(fit_file), "--to", "c", "--tolerance", "0.02", "--material", "nylon")
    assert export(*options, "--range", "1.5:21") == 0
    fit = cal.FitResult.load(fit_file)
    doubts = dict.fromkeys(d.code for d in fit.material("nylon").warnings)
    expected = ["Measured were 1.5 to 20 m/s: beyond them the curve is the law's alone."]
    expected += [f"Doubts about the fit: {', '.join(doubts)}; its report has them."] * bool(doubts)
    assert set(expected) <= set(report()["cautions"])
    for told in (text("softjax_law.h"), capsys.readouterr().out):
        assert all(caution in told for caution in expected)


def test_overlaps_that_are_not_small_are_said(at):
    steel = sj.Hertz(fitted("stainless steel").contact)
    for radius, cautions in ((0.0127, 0), (1e-4, 1)):
        options = {"to": "c", "velocity_range": (0.1, 5.0), "radius": radius, "out": "radii"}
        made = cal.export(steel, **options)
        assert len(made.cautions) == cautions
    share = f"{100 * made.overlap:.0f} %"
    assert made.cautions == (f"Overlaps reach {share} of the radius: laws are for small ones.",)
    assert f"{share} of the sphere's radius" in str(made)


def test_a_file_of_materials_with_given_parameters(export, tmp_path):
    (tmp_path / "alloy.toml").write_text(BODIES, encoding="utf-8")
    options = ("--chi", "0.2", "--sigma", "0.4", "--psi", "0.5", "--to", "lammps", "--range", "2:9")
    assert export("alloy.toml", *options, "--law", "viscoelastic", "--tolerance", "0.05") == 0
    made = report()
    assert (made["material"], made["law"]) == ("alloy", "viscoelastic")
    assert [made["wanted"][name] for name in ("chi", "sigma", "psi")] == [0.2, 0.4, 0.5]


NAMES = (
    r"x\nshell echo hi",
    r"x\u2028shell echo hi",
    r"a\"\"\"b C:\\users \\N{x} \\x",
    r"x\"\"\"+str(1/0)+\"\"\"",
    r"coding: utf-7 +AAo-import nothing",
    r"A&",
    r"${nope} $(1/0)",
    r"a*/b/*c//*d\\",
    r"$\\foo{$",
)
CODES = {
    "lammps": ("in.softjax", "linear"),
    "liggghts": ("in.softjax", "linear"),
    "c": ("softjax_law.h", "linear"),
    "yade": ("softjax_yade.py", "linear"),
    "yade by header": ("softjax_yade.py", "itself"),
}


@pytest.fixture(scope="module")
def named(tmp_path_factory):
    """What is written for a code of a material whose name a file tells."""
    folder = tmp_path_factory.mktemp("named")

    def written(name, code):
        file, law = CODES[code]
        (folder / "a.toml").write_text(BODIES.replace("alloy", name), encoding="utf-8")
        told = ["--chi", "0.2", "--sigma", "0.4", "--psi", "0.5", "--range", "2:2.1", "--quiet"]
        told += ["--to", code.split()[0], "--law", law, "--steps", "30", "--tolerance", "0.2"]
        assert main(["export", str(folder / "a.toml"), *told, "--out", str(folder)]) == 0
        return (folder / file).read_bytes()

    return written


@pytest.mark.parametrize(
    "code",
    [
        "lammps",
        "yade",
        *(pytest.param(c, marks=pytest.mark.long) for c in ("liggghts", "c", "yade by header")),
    ],
)
def test_no_name_of_a_material_acts_in_a_code(code, named, tmp_path):
    """What stands outside of comments is what stands there for a plain name."""

    def acting(source):
        if code.startswith("yade"):  # as bytes: a comment may tell how they are to be read
            return ast.dump(ast.parse(source))
        if code == "c":
            assert compile_alone(source.decode(), "c", tmp_path) == ""
            return source.partition(b"*/")[2]
        assert b'"""' not in source  # with which a line of LAMMPS goes on, be it a comment
        assert all(line.startswith(b"#") for line in source.partition(b"\n\n")[0].splitlines())
        return source.partition(b"\n\n")[2]

    plain = acting(named("alloy", code))
    for name in NAMES:
        assert acting(named(name, code)) == plain


SPRINGS = "walton-braun loading_stiffness=1e6 unloading_stiffness=1.2e6 growth=200"
HEADING = "# between {}, as wanted:\n"


@pytest.mark.parametrize("code", ["lammps", "liggghts"])
def test_the_line_of_what_was_measured_acts_and_says_so(code, export, tmp_path):
    """A ball on a wall is another mass than two balls; without a wall there may be none at z = 0."""
    law, *fields = SPRINGS.split()
    told = ("--wanted-law", law, *(word for field in fields for word in ("--set", field)))
    bodies = {"pair": BODIES, "wall": f'{BODIES}\n[material.wall]\nmaterial = "nylon"\n'}
    for name, body in bodies.items():
        (tmp_path / f"{name}.toml").write_text(body, encoding="utf-8")
        options = ("--to", code, "--range", "0.5:5", "--tolerance", "0.3", "--out", name)
        assert export(f"{name}.toml", *told, *options, "--quiet") == 0
    pair, wall = text("in.softjax", "pair"), text("in.softjax", "wall")
    assert HEADING.format("two balls") + "pair_style" in pair
    assert "needs numbers of its own:\n# fix ID group " in pair
    assert HEADING.format("a ball and a flat wall") + "fix softjax_wall all " in wall
    assert "# between two balls, which needs numbers of its own:\npair_style" in wall
    assert "of a ball on a flat wall" in wall
    assert [report(name)["bodies"] for name in bodies] == ["two balls", "a ball on a flat wall"]


def test_another_wanted_law(export):
    options = ("--wanted-law", "hertz-dashpot", "--set", "restitution=0.8")
    assert export(*STEEL, *options, "--to", "c", "--tolerance", "1e-2", "--quiet") == 0
    made = report()
    assert made["wanted"]["law"] == "HertzDashpot"
    assert made["error_of_law"] < 1e-6
    np.testing.assert_allclose(made["curve"]["wanted"], 0.8)


@needs_compiler
def test_the_contact_force_alone_gives_the_plastic_restitution(export):
    common = (*STEEL, "--to", "c", "--law", "itself", "--steps", "400", "--quiet")
    assert export(*common) == 0
    assert export(*common, "--contact-force", "--out", "force") == 0
    velocity = np.array([0.2, 1.0, 4.0])
    hit = sj.restitution(fitted("stainless steel"), velocity)
    for folder, wanted in (("results", hit.coefficient), ("force", hit.plastic_coefficient)):
        made = report(folder)
        found = compiled(text("softjax_law.h", folder)).rebounds(velocity, made["time_step"])
        np.testing.assert_allclose(found, wanted, atol=2 * made["error_of_time_step"] + 1e-6)
        assert made["steps_in_shortest_contact"] == 400


def test_names_of_a_header(export):
    assert export(*STEEL, "--to", "c", "--prefix", "steel", "--quiet") == 0
    assert "steel_force(" in text("softjax_law.h")
    assert "softjax" not in text("softjax_law.h").lower()


def test_a_softer_spring(export):
    assert export(*STEEL, "--to", "c", "--overlap", "0.03", "--quiet") == 0
    made = report()
    assert made["largest_overlap_over_radius"] == pytest.approx(0.03)
    assert made["softer"]["forces"] == pytest.approx(1 / made["softer"]["overlaps"])
    assert made["softer"]["overlaps"] > 3


@pytest.mark.parametrize(
    ("version", "damping"),
    [("20250722", "damping coeff_restitution"), ("20230802", "damping tsuji")],
)
def test_what_a_version_of_lammps_can_be_told(version, damping, export):
    options = ("--to", "lammps", "--law", "hertz-dashpot", "--tolerance", "0.1")
    assert export(*STEEL, *options, "--lammps-version", version, "--quiet") == 0
    assert f"{damping} limit_damping" in text("in.softjax")


@pytest.mark.parametrize(
    ("law", "version", "of_mass"),
    [
        ("linear", "20230802", True),  # mass_velocity, η = 2ξ√(k/M)
        ("linear", "20250722", False),
        ("hertz-dashpot", "20230802", False),
        ("viscoelastic", "20250722", True),
    ],
)
def test_damping_that_is_of_one_mass_says_so(law, version, of_mass, export):
    options = ("--to", "lammps", "--law", law, "--tolerance", "0.1", "--lammps-version", version)
    assert export(*STEEL, *options, "--quiet") == 0
    assert ("Its damping is told for that mass" in text("in.softjax")) == of_mass


@pytest.mark.parametrize("code", ["lammps", "liggghts", "yade"])
def test_each_code_has_its_files(code, export, tmp_path):
    options = ("--to", code, "--law", "linear", "--tolerance", "0.1")
    assert export(*STEEL, *options, "--quiet") == 0
    made = report()
    assert made["carrier"] == "input"
    assert {p.name for p in (tmp_path / "results").iterdir()} == set(made["files"])
    script = text(next(name for name in made["files"] if not name.startswith("export")))
    assert repr(made["time_step"]) in script
    assert script.isascii()


def test_a_build_that_gets_no_answer_from_lammps_says_what_to_do(export):
    assert export(*STEEL, "--to", "lammps", "--tolerance", "0.005", "--quiet") == 0
    silent = os.environ | {"PYTHON": "false"}
    ended = subprocess.run(["sh", "results/build.sh"], env=silent, capture_output=True, text=True)
    assert ended.returncode == 1
    assert ended.stderr.endswith("where libmpi is not found put its folder on LD_LIBRARY_PATH\n")


@pytest.mark.parametrize(
    ("options", "blamed"),
    [
        (("--to", "fortran"), "fortran"),
        ((), "--to"),
        (("--to", "c", "--range", "5"), "lowest:highest"),
        (("--to", "c", "--wanted-law", "hertz-dashpot", "--set", "restitution=2"), "but is 2.0"),
        (("--to", "c", "--wanted-law", "hertz-dashpot"), "`--wanted-law` must be given with --set"),
        (("--to", "c", "--tolerance", "2"), "tolerance"),
        (("--to", "c", "--law", "viscoelastc"), "did you mean 'viscoelastic'"),
        (("--to", "liggghts", "--law", "zhou"), "no law like Zhou's"),
        (("--to", "liggghts", "--range", "0.1:5", "--tolerance", "0.001"), "--tolerance 0.072"),
        (("--to", "c", "--prefix", "A"), "a name in C"),
        (("--to", "c", "--lammps-version", "20250722"), "left out with c"),
        (("--to", "c", "--overlap", "1e-9"), "the largest overlap"),
        (("--to", "c", "--overlap", "nan"), "100 at most"),
    ],
)
def test_what_cannot_be_done_is_told_in_one_line(options, blamed, export, capsys, tmp_path):
    try:
        code = export("stainless-steel", *options)
    except SystemExit as stop:
        code = stop.code
    told = capsys.readouterr()
    assert code == 2
    assert told.out == ""
    assert len(told.err.splitlines()) == 1
    assert blamed in told.err
    assert list(tmp_path.iterdir()) == []
