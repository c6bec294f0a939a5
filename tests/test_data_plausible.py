"""Doubts about units and columns: each raised by one set and not by its neighbour."""

from types import SimpleNamespace

import numpy as np
import pytest

import softjax as sj
from calibration.data import RestitutionData, plausibility, read_toml
from calibration.fitting.suspicions import _implausible

VELOCITY = np.linspace(0.5, 5.0, 10)
RESTITUTION = 0.95 - 0.05 * VELOCITY
GOOD = {
    "youngs_modulus": 1.93e11,
    "poisson_ratio": 0.35,
    "density": 8030.0,
    "yield_strength": 3.10e8,
    "radius": 0.0127,
}


@pytest.fixture
def doubts(tmp_path):
    """Codes that a file of one material raises, by what is changed in it."""

    def codes(below="", **changes):
        rows = [f"{v},{e}" for v, e in zip(VELOCITY, RESTITUTION, strict=True)]
        (tmp_path / "m.csv").write_text("\n".join(["v,e", *rows]))
        lines = [f"{name} = {value!r}" for name, value in (GOOD | changes).items()]
        toml = "\n".join(["[[material]]", 'data = "m.csv"', *lines, below])
        (tmp_path / "m.toml").write_text(toml)
        (data,) = read_toml(tmp_path / "m.toml")
        return [(one.code, one.cause, one.remedy) for one in plausibility(data)]

    return codes


NEIGHBOURS = [  # what is changed, to a value that is doubted, and to one that is not
    ("radius", 1.01, 0.99, "radius", "1.01 m", "in millimetres"),
    ("youngs_modulus", 2.1e12, 1.9e12, "modulus", "2.1e+12 Pa", "power of ten"),
    ("density", 25_100.0, 24_900.0, "density", "2.51e+04 kg/m³", "in kg/m³"),
    ("density", 9.9, 10.1, "density", "9.9 kg/m³", "in g/cm³"),
]


@pytest.mark.parametrize(("name", "doubted", "fine", "code", "cause", "question"), NEIGHBOURS)
def test_properties_of_the_bodies(doubts, name, doubted, fine, code, cause, question):
    found = doubts(**{name: doubted})
    assert [one[0] for one in found] == [code, code]  # of both spheres
    assert cause in found[0][1]
    assert question in found[0][2]
    assert doubts(**{name: fine}) == []


def test_a_soft_modulus_and_a_wall(doubts):
    wall = "[material.wall]\nmaterial = 'nylon'\n"
    soft = {"yield_strength": 10.0, "limit_velocity": 340.0}
    (found,) = doubts(wall, **soft, youngs_modulus=0.99e5)
    assert (found[0], "of the sphere is 9.9e+04 Pa" in found[1]) == ("modulus", True)
    assert doubts(wall, **soft, youngs_modulus=1.01e5) == []
    walls = wall.replace("material = 'nylon'", "{}")
    lines = "\n".join(f"{k} = {v}" for k, v in GOOD.items() if k not in ("radius", "density"))
    (found,) = doubts(walls.format(lines + "\ndensity = 1.14e6"))
    assert "the density of the wall" in found[1]


def test_yield_beyond_the_limit_velocity(doubts):
    assert doubts() == []
    (found,) = doubts(yield_strength=7e10)  # v_cr goes as Y^2.5, v_lim as Y^0.5, alike at 6.3e10
    assert found[0] == "yield-beyond-limit"
    assert doubts(yield_strength=6e10) == []


def test_yield_is_doubted_only_of_laws_that_yield():
    """A viscoelastic law takes nothing from the yield strength."""
    hard = sj.Material(1.93e11, 0.3, 8000.0, 7e10)
    pair = sj.Contact.between_spheres(hard, hard, 0.01, 0.01)
    data = RestitutionData(VELOCITY, RESTITUTION, pair, name="hard")
    laws = {sj.Zhou(pair, 1.0, 0.1, 0.5): 1, sj.Thornton(pair): 1}
    laws |= {sj.ViscoelasticHertz(pair, 1e-6): 0, sj.WaltonBraun(pair, 1e6, 2e6, 1.0): 0}
    for law, count in laws.items():
        found = _implausible(SimpleNamespace(data=data, law=law, name="hard"))
        assert len(found) == count
        assert all("first yield" in one.cause for one in found)


def test_falls_from_higher_than_anybody_drops_a_ball():
    """300 in a column whose header says no unit is 300 m."""
    table = {"drop_height": np.array([0.3, 0.2]), "rebound_height": np.array([0.2, 0.15])}
    found = [
        plausibility(RestitutionData.from_table({k: scale * v for k, v in table.items()}))
        for scale in (1.0, 1000.0)
    ]
    assert found[0] == ()
    ((code, cause, remedy),) = found[1]
    assert (code, cause) == ("height", "falls as fast as 76.7 m/s, from 300 m")
    assert "drop_height [mm]" in remedy
    times = {"interval": np.array([500.0, 450.0, 405.0])}
    (doubt,) = plausibility(RestitutionData.from_table(times))
    assert doubt.code == "height"
    times = {"interval": np.array([1e160, 1.0, 0.9])}  # a height beyond all numbers
    causes = [one.cause for one in plausibility(RestitutionData.from_table(times))]
    assert "falls as fast as 4.9e+160 m/s, from inf m" in causes


@pytest.mark.parametrize(
    ("columns", "falls"), [("h0 [m],h1 [m]", True), ("v_in [m/s],v_out [m/s]", False)]
)
def test_balls_that_fell_on_a_ball(columns, falls, tmp_path):
    """Without a wall two spheres are meant, which balls are seldom dropped on."""
    (tmp_path / "m.csv").write_text(f"{columns}\n1,0.8\n2,1.5\n3,2.2\n")
    lines = [f"{name} = {value!r}" for name, value in GOOD.items()]
    codes = {}
    for wall in ("", "[material.wall]\nmaterial = 'nylon'\n"):
        text = "\n".join(["[[material]]", 'data = "m.csv"', *lines, wall])
        (tmp_path / "m.toml").write_text(text)
        (data,) = read_toml(tmp_path / "m.toml")
        codes[wall] = [one.code for one in plausibility(data)]
    assert list(codes.values()) == [["no-wall"] if falls else [], []]


def test_a_contact_alone_is_taken_for_two_equal_spheres():
    def codes(radius, density):
        ball = sj.Material(1.93e11, 0.3, density, 3.1e8)
        pair = sj.Contact.between_spheres(ball, ball, radius, radius)
        return [d.code for d in plausibility(RestitutionData(VELOCITY, RESTITUTION, pair))]

    assert codes(1.01, 8000.0) == ["radius"]
    assert codes(0.99, 24_900.0) == []
    assert codes(0.99, 25_100.0) == ["density"]


def codes_of(velocity, restitution, **told):
    return [one.code for one in plausibility(RestitutionData(velocity, restitution, **told))]


def test_percent_taken_twice():
    assert codes_of(VELOCITY, RESTITUTION / 100) == ["percent"]
    assert codes_of(VELOCITY, RESTITUTION / 40) == []


def test_velocities_beyond_all_guns():
    assert codes_of(VELOCITY * 1001, RESTITUTION) == ["velocity"]
    assert codes_of(VELOCITY * 999, RESTITUTION) == []


def test_restitutions_above_one_on_the_whole():
    noise = 0.02 * np.random.default_rng(1).standard_normal(100)
    velocity = np.linspace(0.5, 5, 100)
    assert codes_of(velocity, 1.04 + noise) == ["above-one"]
    assert codes_of(velocity, 1.0 + noise) == []
    assert codes_of(velocity, 1.04 + noise, uncertainty=0.2) == []


ASCENDING = np.array([1.0, 2.0, 3.0, 4.0])


@pytest.mark.parametrize(
    ("velocity", "is_doubted"),
    [
        (np.tile(ASCENDING, 3), True),
        (np.tile(ASCENDING[::-1], 3), True),
        (np.concatenate([ASCENDING, ASCENDING[1:] + 0.1, ASCENDING + 0.2]), True),
        (np.repeat(ASCENDING, 3), False),  # repeats one after the other
        (np.linspace(1, 4, 12), False),
        (np.random.default_rng(2).permutation(np.repeat(ASCENDING, 3)), False),
        (np.tile([1.0, 2.0], 6), False),  # two heights in turns
        (np.tile(ASCENDING, 1), False),  # too few to tell
    ],
)
def test_velocities_that_restart_look_like_groups(velocity, is_doubted):
    restitution = 0.9 - 0.02 * velocity
    assert codes_of(velocity, restitution) == (["groups"] if is_doubted else [])
    labels = [i // 4 for i in range(len(velocity))]
    assert codes_of(velocity, restitution, group=labels) == []


def test_bounce_trains_are_groups_already():
    table = {"interval": np.tile(0.5 * 0.9 ** np.arange(5), 3), "launch": np.repeat([1, 2, 3], 5)}
    assert plausibility(RestitutionData.from_table(table)) == ()


@pytest.mark.parametrize("scale", [1e-30, 1e30])
def test_absurd_properties_are_told_without_a_warning(doubts, scale):
    """Warnings are errors in these tests."""
    for name in ("youngs_modulus", "density", "yield_strength"):
        found = doubts(**{name: GOOD[name] * scale, "limit_velocity": 340.0})
        assert found or name == "yield_strength"
    assert doubts(radius=1e30)[0][0] == "radius"
