"""Properties outside what is plausible come first in the output; far outside they are refused."""

import numpy as np
import pytest

import calibration as cal
import softjax as sj
from tests.command import run

GOOD = {"youngs_modulus": 2.5e9, "poisson_ratio": 0.3, "density": 1140.0}
GOOD |= {"yield_strength": 4.0e7, "radius": 0.0127}
VELOCITY = np.linspace(0.5, 5.0, 10)
# property: its code, its range, and what it is called
RANGES = {
    "youngs_modulus": ("modulus", 1e5, 1.3e12, "Young's modulus", "Pa"),
    "density": ("density", 10.0, 23_000.0, "the density", "kg/m³"),
    "yield_strength": ("yield-strength", 1e4, 1e11, "the yield strength", "Pa"),
    "radius": ("radius", 1e-6, 1.0, "the radius", "m"),
}
LINES = {name: 4 + i for i, name in enumerate(GOOD)}  # of the file, in its order


def material_file(folder, more="", **changes):
    """A file with properties changed; each on its own line."""
    rows = [f"{v},{0.95 - 0.05 * v}" for v in VELOCITY]
    (folder / "m.csv").write_text("\n".join(["v,e", *rows]), encoding="utf-8")
    lines = [f"{name} = {value!r}" for name, value in (GOOD | changes).items()]
    head = ["[[material]]", 'name = "my alloy"', 'data = "m.csv"']
    text = "\n".join([*head, *lines, "limit_velocity = 340.0", more, ""])
    (folder / "m.toml").write_text(text, encoding="utf-8")
    return folder / "m.toml"


def codes(file, **options):
    (data,) = cal.read_toml(file, **options)
    return {one.code for one in cal.plausibility(data)} - {"yield-beyond-limit"}


@pytest.mark.parametrize("name", RANGES)
def test_the_ends_of_each_range(name, tmp_path):
    """One per cent inside nothing is doubted, one per cent outside it is."""
    code, low, high, *_ = RANGES[name]
    for value, doubted in ((0.99 * low, 1), (1.01 * low, 0), (0.99 * high, 0), (1.01 * high, 1)):
        assert codes(material_file(tmp_path, **{name: value})) == ({code} if doubted else set())


@pytest.mark.parametrize("name", RANGES)
@pytest.mark.parametrize("side", [1, 2])
def test_a_hundred_times_outside_is_refused(name, side, tmp_path):
    """At its line, unless the file or the caller says that it is right."""
    end = RANGES[name][side]
    far = 100.0 if side == 2 else 0.01
    assert codes(
        material_file(tmp_path, **{name: 0.99 * end * far if side == 2 else 1.01 * end * far})
    )
    beyond = 1.01 * end * far if side == 2 else 0.99 * end * far
    file = material_file(tmp_path, **{name: beyond})
    with pytest.raises(ValueError, match="plausibility = false takes it as it is") as caught:
        cal.read_toml(file)
    assert str(caught.value).startswith(f"{file}:{LINES[name]}: {name} is {beyond:.3g} ")
    assert "\n" not in str(caught.value)
    assert RANGES[name][0] in codes(file, plausibility=False)
    assert RANGES[name][0] in codes(
        material_file(tmp_path, "plausibility = false", **{name: beyond})
    )


def test_a_diameter_and_a_wall(tmp_path):
    lines = "\n".join(
        f"{k} = {v!r}" for k, v in (GOOD | {"density": 0.05}).items() if k != "radius"
    )
    file = material_file(tmp_path, f"[material.wall]\n{lines}")
    with pytest.raises(ValueError, match=r"m\.toml:13: density is 0\.05 kg/m³"):
        cal.read_toml(file)
    text = material_file(tmp_path).read_text(encoding="utf-8")
    (tmp_path / "m.toml").write_text(text.replace("radius = 0.0127", "diameter = 300.0"))
    with pytest.raises(ValueError, match=r"m\.toml:8: diameter is 300 m"):
        cal.read_toml(tmp_path / "m.toml")


def test_in_python(tmp_path):
    """A contact is taken for that of two equal spheres."""
    for radius, far in ((0.5, False), (6.0, False), (99.0, False), (101.0, True)):
        ball = sj.Material(1.93e11, 0.3, 8000.0, 3.1e8)
        pair = sj.Contact.between_spheres(ball, ball, radius, radius)
        if far:
            with pytest.raises(ValueError, match="plausibility = false") as caught:
                cal.RestitutionData(VELOCITY, 0.9 + 0 * VELOCITY, pair)
            assert "radius" in str(caught.value)
            table = {"v": VELOCITY, "e": 0.9 + 0 * VELOCITY}
            with pytest.raises(ValueError, match="radius"):
                cal.RestitutionData.from_table(table, pair)
            cal.RestitutionData.from_table(table, pair, plausibility=False)
        data = cal.RestitutionData(VELOCITY, 0.9 + 0 * VELOCITY, pair, plausibility=not far)
        assert [one.code for one in cal.plausibility(data)] == ["radius"] * (radius > 1)
    with pytest.raises(ValueError, match="plausibility"):
        cal.RestitutionData(VELOCITY, 0.9 + 0 * VELOCITY, plausibility="no")  # type: ignore[arg-type]


LAW = ("--law", "constant", "--set", "restitution=0.8")
COMMANDS = {
    "fit": ("--law", "constant", "--no-profiles"),
    "compare": ("--laws", "constant"),
    "curve": (*LAW, "--points", "5"),
    "sensitivity": LAW,
    "export": ("--law", *LAW[1:], "--to", "c"),
}
SLIPS = {"density": 7.6, "radius": 6.0, "youngs_modulus": 1.5e12}


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("name", SLIPS)
def test_the_first_line_of_every_command(command, name, at):
    """Fails where the warning is the fourth of five; quiet commands say it on standard error."""
    file = material_file(at, **{name: SLIPS[name]})
    words = (command, file, *COMMANDS[command])
    code, out, error = run(*words)
    assert code == 0, error
    _, low, high, called, unit = RANGES[name]
    start = f"warning: plausibility (my alloy): {called} of the sphere is {SLIPS[name]:.3g} {unit}"
    assert out.splitlines()[0].startswith(f"{start}, outside {low:g} to {high:g} {unit}. ")
    assert run(*words, "--quiet")[2].startswith(start)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_refuses_what_is_far_outside(command, at):
    """115 Pa are 115 GPa without their unit."""
    file = material_file(at, youngs_modulus=115.0)
    code, out, error = run(command, file, *COMMANDS[command])
    assert (code, out) == (2, "")
    assert error.startswith(
        f"{file}:4: youngs_modulus is 115 Pa, more than 100 times outside 100000 to 1.3e+12"
    )
    assert error.count("\n") == 1
    assert not (at / "results").exists()


def test_warnings_and_the_report_begin_with_it(at):
    """Before those that were raised earlier in the fit."""
    file = material_file(at, radius=6.0)
    assert run("fit", file, "--law", "constant", "--no-profiles")[0] == 0
    lines = (at / "results" / "report.md").read_text(encoding="utf-8").splitlines()
    first = next(line for line in lines if line.startswith(("-", "*", ">")) or "plausib" in line)
    assert "plausibility" in first
    assert "6 m" in first
    result = cal.FitResult.load(at / "results" / "fit.json")
    assert [one.code for one in result.warnings][:2] == ["plausibility"] * 2


def test_what_was_accepted_once_is_loaded_again(at):
    file = material_file(at, "plausibility = false", radius=600.0)
    assert run("fit", file, "--law", "constant", "--no-profiles")[0] == 0
    result = cal.FitResult.load(at / "results" / "fit.json")
    (data,) = cal.read_toml(file)
    assert result.materials[0].data == data
