"""`softjax export` from the command line to its files: each option by what it does."""

import ast
import json
import os
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest

import calibration as cal
import softjax as sj
from tests.cases import fitted, pair
from tests.command import BODIES, run
from tests.export.laws import compiled, compiler_says, needs_compiler

STEEL = ("stainless-steel", "--range", "0.1:5", "--quiet")
NYLON = ("--set", "chi=0.2", "sigma=0.4", "psi=0.5")


def export(*options) -> None:
    code, _, err = run("export", *options)
    assert (code, err) == (0, "")


def report(folder="results", name="export"):
    return json.loads(Path(folder, f"{name}.json").read_text(encoding="utf-8"))


def text(name, folder="results"):
    return Path(folder, name).read_text(encoding="utf-8")


def test_a_fit_is_exported_material_by_material(at):
    """Over the velocities of its data; beyond them, by a thousandth, the curve is said to be the law's alone."""
    sets = []
    for name, ends in (("stainless steel", (0.1, 3)), ("nylon", (1.5, 20))):
        law, v = sj.ViscoelasticHertz(pair(name), 1e-6), np.geomspace(*ends, 24)
        exact = np.asarray(sj.restitution(law, v).coefficient)
        sets.append(cal.RestitutionData(v, exact, law.contact, 0.003, name=name))
    fit = cal.fit(sets, "viscoelastic", profiles=False, starts=1)
    fit.save("fit.json")
    options = ("--fit", "fit.json", "--to", "c", "--tolerance", "0.05", "--quiet")
    for data, stated in zip(sets, ((), ("--range", "1.4986:20.019")), strict=True):
        export(*options, "--material", data.name, *stated)
        made, ends = report(), [data.velocity[0], data.velocity[-1]]
        assert made["material"] == data.name
        assert made["velocity_range"] == pytest.approx(ends, rel=1e-3 if stated else 1e-9)
        assert not any(warning.startswith("Measured") for warning in made["warnings"])
        law = sj.ViscoelasticHertz(data.contact, 1e-6)
        exact = sj.restitution(law, np.array(made["curve"]["velocity"])).coefficient
        np.testing.assert_allclose(made["curve"]["requested"], exact, atol=1e-6)
    code, out, _ = run("export", *options[:-1], "--material", "nylon", "--range", "1.5:20.021")
    assert code == 0
    codes = dict.fromkeys(d.code for d in fit.material("nylon").warnings)
    expected = ["Measured: 1.5 to 20 m/s. Outside, ε is that of the law."]
    expected += ["Overlaps reach 12 % of the radius: contact laws are for small ones."]
    expected += [f"Warnings of the fit: {', '.join(codes)}; see its report."]
    assert report()["warnings"] == expected
    for shown in (text("softjax_law.h"), out):
        assert all(one.replace("ε", "eps") in shown.replace("ε", "eps") for one in expected)


def test_of_two_spheres_the_smaller_one_is_the_radius(at):
    """Of parameters that are given, and of a fit."""
    other = 'radius_2 = 0.004\n[material.second]\nmaterial = "nylon"\n'
    bodies = BODIES.replace("radius", "radius_1") + other
    measured = bodies.replace("radius_1", 'data = "alloy.csv"\nradius_1')
    Path("alloy.csv").write_text("v [m/s],eps\n1,0.9\n2,0.89\n4,0.91\n", encoding="utf-8")
    law = ("--law", "hertz-dashpot")
    options = ("--to", "c", "--range", "1:4", "--tolerance", "0.1", "--quiet")
    Path("alloy.toml").write_text(bodies, encoding="utf-8")
    export("alloy.toml", *law, "--set", "restitution=0.9", *options, "--out", "given")
    Path("alloy.toml").write_text(measured, encoding="utf-8")
    assert run("fit", "alloy.toml", *law, "--no-profiles", "--quiet")[0] == 0
    export("--fit", "results/fit.json", *options, "--out", "fitted")
    for folder in ("given", "fitted"):
        assert report(folder)["radius"] == {"value": 0.004, "of": "sphere's"}


def test_given_parameters_another_law_and_names_of_a_header(at):
    Path("alloy.toml").write_text(BODIES, encoding="utf-8")
    options = "--to lammps --range 2:9 --export-law viscoelastic --tolerance 0.05 --quiet"
    export("alloy.toml", *NYLON, *options.split())
    made = report()
    assert (made["material"], made["law"]) == ("alloy", "viscoelastic")
    assert [made["requested"][name] for name in ("chi", "sigma", "psi")] == [0.2, 0.4, 0.5]
    options = ("--law", "hertz-dashpot", "--set", "restitution=0.8", "--prefix", "steel")
    export(*STEEL, *options, "--to", "c", "--tolerance", "1e-2")
    made = report(name="export_steel")
    assert made["requested"]["law"] == "HertzDashpot"
    assert made["error_of_law"] < 1e-6
    np.testing.assert_allclose(made["curve"]["requested"], 0.8)
    assert "steel_force(" in text("steel_law.h")
    assert "softjax" not in text("steel_law.h").lower()


NAMES = (
    r"x\nshell echo hi",
    r"x\u2028shell echo hi",
    r"a\"\"\"b C:\\users \\N{x} \\x",
    r"x\"\"\"+str(1/0)+\"\"\"",
    r"coding: utf-7 +AAo-import nothing",
    r"A&",
    r"${nope} $(1/0)",
    r"a*/b/*c//*d\\",
)
CODES = {
    "lammps": "in.softjax",
    "liggghts": "in.softjax",
    "c": "softjax_law.h",
    "yade": "softjax_yade.py",
}


def acting(code: str, source: bytes, folder: Path):
    """What a code reads of a file: all but comments."""
    if code == "yade":  # as bytes: a comment may tell how they are to be read
        return ast.dump(ast.parse(source))
    if code == "c":
        assert compiler_says(source.decode(), "c", folder) == ""
        return source.partition(b"*/")[2]
    assert b'"""' not in source  # with which a line of LAMMPS goes on, be it a comment
    assert all(line.startswith(b"#") for line in source.partition(b"\n\n")[0].splitlines())
    return source.partition(b"\n\n")[2]


@needs_compiler
@pytest.mark.parametrize("code", CODES)
def test_no_name_of_a_material_acts_in_a_code(code, at):
    options = [*NYLON, "--range", "2:2.1", "--quiet", "--to", code, "--export-law", "linear"]
    options += ["--steps", "30", "--tolerance", "0.2"]
    found = []
    for name in ("alloy", " ".join(NAMES)):
        Path("a.toml").write_text(BODIES.replace("alloy", name), encoding="utf-8")
        export("a.toml", *options)
        found.append(acting(code, Path("results", CODES[code]).read_bytes(), at))
    assert found[0] == found[1]


def test_a_wall_of_the_file_makes_its_line_act(at):
    """A ball on a wall is another mass than two balls; without a wall there may be none at z = 0."""
    law = ("--law", "walton-braun", "--set", "loading_stiffness=1e6")
    law += ("--set", "unloading_stiffness=1.2e6", "--set", "growth=200")
    bodies = {"pair": BODIES, "wall": f'{BODIES}\n[material.wall]\nmaterial = "nylon"\n'}
    for name, body in bodies.items():
        Path(f"{name}.toml").write_text(body, encoding="utf-8")
        options = ("--to", "lammps", "--range", "0.5:5", "--tolerance", "0.3", "--out", name)
        export(f"{name}.toml", *law, *options, "--quiet")
    pair, wall = text("in.softjax", "pair"), text("in.softjax", "wall")
    heading = "# between {}, as requested:\n"
    assert pair.index(heading.format("two balls")) < pair.index("\npair_style")
    assert "needs an export of its own:\n# fix ID group " in pair
    assert wall.index(heading.format("a ball and a flat wall")) < wall.index(
        "\nfix softjax_wall all"
    )
    assert (
        "# between two balls, which needs an export of its own:\n# These lines do not act" in wall
    )
    assert "\npair_" not in wall  # included after lines for balls it leaves them as they are
    assert [report(name)["bodies"] for name in bodies] == ["two balls", "a ball on a flat wall"]


@needs_compiler
def test_a_second_law_of_one_prefix_does_not_act_silently(at):
    """Of two headers the guard left the second out; a plugin of other numbers answered to the same name."""
    texts = []
    for folder, restitution in (("one", "0.8"), ("other", "0.7"), ("again", "0.8")):
        law = ("--law", "hertz-dashpot", "--set", f"restitution={restitution}")
        export(*STEEL, *law, "--to", "c", "--out", folder)
        texts.append(text("softjax_law.h", folder))
    assert texts[0] == texts[2]
    assert compiler_says(texts[0] + texts[2], "c", at) == ""
    said = compiler_says(texts[0] + texts[1], "c", at)
    assert "two laws of the prefix softjax: export one of them with another --prefix" in said
    names = []
    for sigma in ("0.4", "0.5", "0.4"):
        law = ("--set", "chi=0.2", "--set", f"sigma={sigma}", "--set", "psi=0.5", "--range", "2:4")
        Path("alloy.toml").write_text(BODIES, encoding="utf-8")
        options = ("--to", "lammps", "--export-law", "exact", "--tolerance", "0.1", "--quiet")
        export("alloy.toml", *law, *options)
        (name,) = re.findall(
            r"^variable softjax_law string (softjax_[0-9a-f]{8})$", text("in.softjax"), re.M
        )
        assert f'#define SOFTJAX_LAW "{name}"' in text("softjax_law.h")
        assert "\npair_coeff * * ${softjax_law}\n" in text("in.softjax")
        assert "# fix ID group softjax/wall ${softjax_law} zplane 0.0 NULL\n" in text("in.softjax")
        names.append(name)
        stale = [one for one in report()["warnings"] if one.startswith("Build again")]
        assert len(stale) == Path("results/softjaxplugin.so").exists()
        Path("results/softjaxplugin.so").touch()
    assert names[0] == names[2] != names[1]
    code, out, _ = run("export", "alloy.toml", *law, *options[:-1])
    assert code == 0
    assert "Build again by build.sh: softjaxplugin.so there is of an earlier export." in out


def test_what_a_file_of_a_wall_does_not_do_is_its_first_line(at):
    """150 balls that were poured went through each other."""
    wall = f'{BODIES}\n[material.wall]\nmaterial = "nylon"\n'
    Path("wall.toml").write_text(wall, encoding="utf-8")
    law = ("--law", "hertz-dashpot", "--set", "restitution=0.8", "--range", "0.5:5")
    said = {
        "lammps": "No law between balls: they pass through each other until another file sets one.",
        "yade": "For walls alone: YADE takes a wall for a ball",
    }
    for to, expected in said.items():
        options = (*law, "--to", to, "--export-law", "hertz-dashpot", "--tolerance", "0.05")
        code, out, _ = run("export", "wall.toml", *options)
        assert code == 0
        assert f"! {expected}" in out
        lines = text(CODES[to]).splitlines()
        assert next(
            one
            for one in lines
            if one != "# coding: ascii, first, so that no name below is read as one"
        ).startswith(f"# {expected}")
    export(
        "wall.toml", *law, "--to", "lammps", "--tolerance", "0.05", "--types", "1", "1", "--quiet"
    )
    assert "No law between balls" not in text("in.softjax")


def test_gravity_is_that_of_the_option_else_of_the_file_else_of_the_earth(at):
    law = ("--law", "hertz-dashpot", "--set", "restitution=0.8", "--to", "c", "--range", "1:4")
    drops = 'data = "drops.csv"\ngravity = 1.62\nair = false\nradius'
    rows = "drop_height [m],rebound_height [m]\n1,0.64\n1.5,0.97\n2,1.27\n"
    Path("drops.csv").write_text(rows, encoding="utf-8")
    Path("moon.toml").write_text(BODIES.replace("radius", drops, 1), encoding="utf-8")
    Path("alloy.toml").write_text(BODIES, encoding="utf-8")
    for file, stated, expected in (
        ("alloy.toml", (), 9.80665),
        ("moon.toml", (), 1.62),
        ("moon.toml", ("--gravity", "3.7"), 3.7),
        ("moon.toml", ("--gravity", "0"), 0.0),
    ):
        export(file, *law, *stated, "--quiet")
        made = report()
        assert made["tolerance"] == 0.01  # of no option, as the help has it
        assert made["gravity"] == expected
        number = expected * made["curve"]["contact_duration"][0] / 1.0
        assert made["weight_number"] == pytest.approx(number)
    assert run("fit", "moon.toml", "--law", "hertz-dashpot", "--no-profiles", "--quiet")[0] == 0
    export(
        "--fit", "results/fit.json", *law[4:], "--tolerance", "0.1", "--quiet", "--out", "fitted"
    )
    assert report("fitted")["gravity"] == 1.62
    code, _, err = run("export", "alloy.toml", *law, "--gravity", "-1")
    assert code == 2
    assert "gravity" in err
    assert "an acceleration in m/s², or 0" in err


@pytest.mark.parametrize("law", ["linear", "hertz-dashpot"])
def test_holding_below_the_range_says_what_a_dashpot_does(law, at):
    law = ("--law", "hertz-dashpot", "--set", "restitution=0.8", "--export-law", law)
    export(*STEEL, *law, "--to", "lammps", "--below", "hold")
    assert "Below 0.1 m/s ε is 0.8 too, by the same dashpot." in report()["warnings"]


@needs_compiler
def test_the_contact_force_alone_gives_the_plastic_restitution(at):
    common = (*STEEL, "--to", "c", "--export-law", "exact", "--steps", "400", "--tolerance", "0.1")
    export(*common, "--overlap", "0.03")
    export(*common, "--contact-force", "--out", "force")
    velocity = np.array([0.2, 1.0, 4.0])
    hit = sj.restitution(fitted("stainless steel"), velocity)
    for folder, expected in (("results", hit.coefficient), ("force", hit.plastic_coefficient)):
        made = report(folder)
        found = compiled(text("softjax_law.h", folder)).rebounds(velocity, made["time_step"])
        np.testing.assert_allclose(found, expected, atol=2 * made["error_of_time_step"] + 1e-6)
        assert made["steps_in_shortest_contact"] == 400
    assert report()["largest_overlap_over_radius"] == pytest.approx(0.03)
    assert report()["softer"]["overlaps"] > 3


def test_a_named_material_becomes_a_plugin_whose_build_says_what_it_lacks(at):
    code, out, err = run("export", *STEEL[:-1], "--to", "lammps", "--tolerance", "0.005")
    assert (code, err) == (0, "")
    assert "χ̃ = 1.7944" in out
    made, names = report(), sorted(path.name for path in Path("results").iterdir())
    assert out.endswith(f"Written to results: {', '.join(names)}\n")
    assert set(names) == set(made["files"]) == {
        *("softjax_law.h", "softjax_lammps.cpp", "build.sh", "in.softjax"),
        *("export.json", "export.png"),
    }  # fmt: skip
    assert (made["velocity_range"], made["backend"]) == ([0.1, 5.0], "header")
    assert made["largest_error"] <= made["tolerance"] == 0.005
    assert made["radius"] == {"value": 0.0127, "of": "sphere's"}
    silent = os.environ | {"PYTHON": "false"}
    ended = subprocess.run(["sh", "results/build.sh"], env=silent, capture_output=True, text=True)
    assert ended.returncode == 1
    assert ended.stderr.endswith("where libmpi is not found put its folder on LD_LIBRARY_PATH\n")
