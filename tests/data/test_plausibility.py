"""Units and columns that are doubted, each by one set and not by its neighbour; properties far outside are refused."""

import contextlib
import io
from dataclasses import asdict

import numpy as np
import pytest

import calibration as cal
import softjax as sj
from calibration import cli
from tests.shown.conftest import shown

VELOCITY = np.linspace(0.5, 5.0, 10)
RESTITUTION = 0.95 - 0.05 * VELOCITY
ROWS = "\n".join(["v,e", *(f"{v},{e}" for v, e in zip(VELOCITY, RESTITUTION, strict=True))])
NYLON, STEEL = (asdict(body) | {"radius": 0.0127} for body in (sj.NYLON, sj.STAINLESS_STEEL))
WALL = "[material.wall]\nmaterial = 'nylon'\n"
# property: its code, its range, and what it is called
RANGES = {
    "youngs_modulus": ("modulus", 1e5, 1.3e12, "Young's modulus", "Pa"),
    "density": ("density", 10.0, 23_000.0, "the density", "kg/m³"),
    "yield_strength": ("yield-strength", 1e4, 1e11, "the yield strength", "Pa"),
    "radius": ("radius", 1e-6, 1.0, "the radius", "m"),
}
LINES = {name: 4 + i for i, name in enumerate(NYLON)}  # of the file, in its order


def material_file(folder, more="limit_velocity = 340.0", csv=ROWS, body=NYLON, **changes):
    (folder / "m.csv").write_text(csv, encoding="utf-8")
    lines = [f"{name} = {value!r}" for name, value in (body | changes).items()]
    head = ["[[material]]", 'name = "my alloy"', 'data = "m.csv"']
    (folder / "m.toml").write_text("\n".join([*head, *lines, more, ""]), encoding="utf-8")
    return folder / "m.toml"


def codes(file):
    (data,) = cal.read_toml(file)
    return {warning.code for warning in cal.plausibility(data)} - {"yield-beyond-limit"}


def of(velocity, restitution, **options):
    data = cal.RestitutionData(velocity, restitution, **options)
    return [warning.code for warning in cal.plausibility(data)]


@pytest.mark.parametrize("name", RANGES)
def test_the_ends_of_each_range_and_a_hundred_times_outside(name, tmp_path):
    code, low, high, *_ = RANGES[name]
    for value, doubted in ((0.99 * low, 1), (low, 0), (high, 0), (1.01 * high, 1)):
        assert codes(material_file(tmp_path, **{name: value})) == ({code} if doubted else set())
    for last, beyond in ((low / 100, 0.0099 * low), (100 * high, 101 * high)):
        assert codes(material_file(tmp_path, **{name: last}))
        file = material_file(tmp_path, **{name: beyond})
        with pytest.raises(ValueError, match="plausibility = false takes it as it is") as caught:
            cal.read_toml(file)
        assert str(caught.value).startswith(f"{file}:{LINES[name]}: {name} is {beyond:.3g} ")
        assert "\n" not in str(caught.value)
        allowed = "limit_velocity = 340.0\nplausibility = false"
        assert code in codes(material_file(tmp_path, allowed, **{name: beyond}))


def test_a_diameter_and_a_wall_far_outside(tmp_path):
    lines = "\n".join(f"{k} = {v!r}" for k, v in (NYLON | {"density": 0.05}).items() if k != "radius")  # fmt: skip
    file = material_file(tmp_path, f"[material.wall]\n{lines}")
    with pytest.raises(ValueError, match=r"m\.toml:12: density is 0\.05 kg/m³"):
        cal.read_toml(file)
    text = material_file(tmp_path).read_text(encoding="utf-8")
    file.write_text(text.replace("radius = 0.0127", "diameter = 300.0"), encoding="utf-8")
    with pytest.raises(ValueError, match=r"m\.toml:8: diameter is 300 m"):
        cal.read_toml(file)


@pytest.mark.parametrize(
    ("code", "doubted", "fine"),
    [
        ("radius", (1.93e11, 8000.0, 1.01), (1.93e11, 8000.0, 0.99)),
        ("density", (1.93e11, 9.9, 0.01), (1.93e11, 10.1, 0.01)),
        ("modulus", (0.99e5, 8000.0, 0.01), (1.01e5, 8000.0, 0.01)),
    ],
)
def test_properties_of_a_contact_alone_are_found_again(code, doubted, fine):
    """Those of two equal spheres of ν = 0.3."""
    for (modulus, density, radius), is_doubted in ((doubted, True), (fine, False)):
        ball = sj.Material(modulus, 0.3, density, 1.5e4)
        pair = sj.Contact.between_spheres(ball, ball, radius, radius)
        found = of(VELOCITY, RESTITUTION, contact=pair, limit_velocity=340.0)
        assert (code in found) == is_doubted


LAW = ("--law", "constant", "--set", "restitution=0.8")
COMMANDS = {
    "fit": ("--law", "constant", "--no-profiles"),
    "compare": ("--laws", "constant"),
    "curve": (*LAW, "--points", "5"),
    "sensitivity": LAW,
    "export": ("--law", *LAW[1:], "--to", "c", "--gravity", "0"),
}


@pytest.mark.parametrize("command", COMMANDS)
def test_the_first_line_of_every_command(command, tmp_path):
    cases = [("density", 7.6), ("youngs_modulus", 1.5e12), ("radius", 6.0)]
    for name, value in cases if command == "curve" else cases[-1:]:
        words = (command, material_file(tmp_path, **{name: value}), *COMMANDS[command])
        made = shown(tmp_path, *words)
        assert made.code == 0, made.err
        _, low, high, called, unit = RANGES[name]
        start = f"warning: plausibility (my alloy): {called} of the sphere is {value:.3g} {unit}"
        assert made.out.splitlines()[0].startswith(f"{start}, outside {low:g} to {high:g} {unit}. ")
    assert shown(tmp_path, *words, quiet=True).err.startswith(start)
    file = material_file(tmp_path, youngs_modulus=115.0)  # Pa are GPa without their unit
    made = shown(tmp_path / "none", command, file, *COMMANDS[command])
    start = f"{file}:4: youngs_modulus is 115 Pa, more than 100 times outside 100000 to 1.3e+12"
    assert (made.code, made.out, made.err.count("\n"), made.err[: len(start)]) == (2, "", 1, start)
    assert not (tmp_path / "none").exists()


def test_a_reader_has_the_first_line_before_the_work(tmp_path):
    out, there = io.StringIO(), []
    out.flush = lambda: there.append(out.getvalue())
    words = ("curve", material_file(tmp_path, radius=6.0), *LAW, "--out", tmp_path)
    with contextlib.redirect_stdout(out):
        assert cli.main([*map(str, words)]) == 0
    assert there[0].count("\n") == 1


def test_warnings_and_the_report_begin_with_it(tmp_path):
    fit = ("--law", "constant", "--no-profiles")
    made = shown(tmp_path, "fit", material_file(tmp_path, radius=6.0), *fit)
    first = next(x for x in made.page().paragraphs if x.startswith("- "))
    assert first.startswith("- plausibility")
    assert "6 m" in first
    result = cal.FitResult.load(made.folder / "fit.json")
    assert [warning.code for warning in result.warnings][:2] == ["plausibility"] * 2
    file = material_file(tmp_path, "limit_velocity = 340.0\nplausibility = false", radius=600.0)
    made = shown(tmp_path, "fit", file, *fit)
    (data,) = cal.read_toml(file)
    assert cal.FitResult.load(made.folder / "fit.json").materials[0].data == data


@pytest.mark.parametrize("below", ["", WALL])
def test_nothing_is_doubted_of_steel_that_yields_in_time(below, tmp_path):
    """v_cr goes as Y^2.5, v_lim as Y^0.5: alike at 6.3e10 Pa."""
    for strength, doubted in ((3.1e8, False), (6e10, False), (7e10, not below)):
        file = material_file(tmp_path, below, body=STEEL, yield_strength=strength)
        found = cal.plausibility(cal.read_toml(file)[0])
        assert [warning.code for warning in found] == ["yield-beyond-limit"] * doubted
        assert not doubted or "m/s" in found[0].cause


def test_falls_from_higher_than_anybody_drops_a_ball():
    """300 in a column whose header says no unit is 300 m; 500 in one of intervals 500 s."""

    def found(**table):
        return cal.plausibility(cal.RestitutionData.from_table(table))

    assert found(drop_height=[0.3, 0.2], rebound_height=[0.2, 0.15]) == ()
    (high,) = found(drop_height=[300.0, 200.0], rebound_height=[200.0, 150.0])
    assert high.code == "height"
    assert "76.7 m/s" in high.cause  # √(2 · 9.80665 · 300)
    assert "300 m" in high.cause
    # 20 m/s is the fall of 20.39 m
    for height, doubted in ((20.3, False), (20.5, True)):
        assert [warning.code for warning in found(h0=[height], hf=[1.0])] == ["height"] * doubted
    assert [warning.code for warning in found(interval=[500.0, 450.0, 405.0])] == ["height"]
    beyond = found(interval=[1e160, 1.0, 0.9])  # a height beyond floats
    assert any("inf m" in warning.cause for warning in beyond)


@pytest.mark.parametrize("columns", ["h0 [m],h1 [m]", "interval [s],launch", "v_in,v_out"])
def test_balls_that_fell_on_a_ball(columns, tmp_path):
    """Their velocities are those of falls."""
    rows = "0.5,a\n0.4,a\n0.33,a\n0.27,a\n" if "launch" in columns else "1,0.8\n2,1.5\n3,2.2\n"
    for below, doubted in (("", "v_in" not in columns), (WALL, False)):
        file = material_file(tmp_path, below, f"{columns}\n{rows}", STEEL)
        assert codes(file) == ({"no-wall"} if doubted else set())


def test_percent_taken_twice_velocities_beyond_all_guns_and_restitutions_above_one():
    """All ε below 0.02; 5 km/s; more above 1 than chance would put there; bounce sequences are groups already."""
    assert of(VELOCITY, RESTITUTION * 0.0199 / RESTITUTION[0]) == ["percent"]
    assert of(VELOCITY, RESTITUTION * 0.0201 / RESTITUTION[0]) == []
    assert of(VELOCITY * 1001, RESTITUTION) == ["velocity"]
    assert of(VELOCITY * 999, RESTITUTION) == []
    noise = 0.02 * np.random.default_rng(1).standard_normal(100)
    velocity = np.linspace(0.5, 5, 100)
    assert of(velocity, 1.04 + noise) == ["above-one"]
    assert of(velocity, 1.0 + noise) == []
    # of 100 tosses 15 heads more than half are three standard deviations, of 9 all, of 8 never
    for count, above, warns in ((100, 65, True), (100, 64, False), (9, 9, True), (8, 8, False)):
        expected = ["above-one"] if warns else []
        assert of(velocity[:count], np.where(np.arange(count) < above, 1.01, 0.99)) == expected
    table = {"interval": np.tile(0.5 * 0.9 ** np.arange(5), 3), "launch": np.repeat([1, 2, 3], 5)}
    assert cal.plausibility(cal.RestitutionData.from_table(table)) == ()


ASCENDING = np.array([1.0, 2.0, 3.0, 4.0])
RESTARTS = [
    (np.tile(ASCENDING, 3), True),
    (np.concatenate([ASCENDING, ASCENDING[1:] + 0.1, ASCENDING + 0.2]), True),
    (np.tile(ASCENDING, 2), True),
    (np.tile(ASCENDING[:3], 3), True),
    (np.repeat(ASCENDING, 3), False),  # repeats one after the other
    (np.random.default_rng(2).permutation(np.repeat(ASCENDING, 3)), False),
    (np.tile([1.0, 2.0], 6), False),  # two heights in turns
    (np.concatenate([ASCENDING, [1.0, 4.0], ASCENDING]), False),  # and once among longer runs
    (ASCENDING, False),  # too few to tell
    (np.concatenate([ASCENDING, ASCENDING[:3]]), False),  # seven are too few
    (np.array([1.0, 1.3, 1.6, 2.1, 1.9, 2.4, 3.0, 4.0]), False),  # one series, velocities to 10 %
]


@pytest.mark.parametrize(("velocity", "is_doubted"), RESTARTS)
def test_velocities_that_restart_look_like_groups(velocity, is_doubted):
    restitution = 0.9 - 0.02 * velocity
    assert of(velocity, restitution) == (["groups"] if is_doubted else [])
    assert of(velocity, restitution, group=[i // 4 for i in range(len(velocity))]) == []
