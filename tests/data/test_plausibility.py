"""Doubts about units and columns: each raised by one set, and not by its neighbour."""

import numpy as np
import pytest

import calibration as cal
import softjax as sj

VELOCITY = np.linspace(0.5, 5.0, 10)
RESTITUTION = 0.95 - 0.05 * VELOCITY
GOOD = {"youngs_modulus": 1.93e11, "poisson_ratio": 0.35, "density": 8030.0}
GOOD |= {"yield_strength": 3.10e8, "radius": 0.0127}
ROWS = "\n".join(["v,e", *(f"{v},{e}" for v, e in zip(VELOCITY, RESTITUTION, strict=True))])
WALL = "[material.wall]\nmaterial = 'nylon'\n"


@pytest.fixture
def doubts(read_toml):
    """What a file of one material raises, by what is changed in it."""

    def found(below="", csv=ROWS, **changes):
        lines = [f"{name} = {value!r}" for name, value in (GOOD | changes).items()]
        (data,) = read_toml("\n".join(["[[material]]", 'data = "m.csv"', *lines, below]), csv)
        return cal.plausibility(data)

    return found


def codes(doubts):
    return [one.code for one in doubts]


def of(velocity, restitution, **told):
    return codes(cal.plausibility(cal.RestitutionData(velocity, restitution, **told)))


@pytest.mark.parametrize("below", ["", WALL])
def test_nothing_is_doubted_of_steel(doubts, below):
    assert doubts(below) == ()


def test_first_yield_beyond_the_limit_velocity(doubts):
    """v_cr goes as Y^2.5, v_lim as Y^0.5: alike at 6.3e10 Pa."""
    (found,) = doubts(yield_strength=7e10)
    assert found.code == "yield-beyond-limit"
    assert "m/s" in found.cause
    assert "yield-beyond-limit" not in codes(doubts(yield_strength=6e10))


def test_falls_from_higher_than_anybody_drops_a_ball():
    """300 in a column whose header says no unit is 300 m; 500 in one of intervals 500 s."""
    table = {"drop_height": np.array([0.3, 0.2]), "rebound_height": np.array([0.2, 0.15])}
    assert cal.plausibility(cal.RestitutionData.from_table(table)) == ()
    high = {name: 1000.0 * heights for name, heights in table.items()}
    (found,) = cal.plausibility(cal.RestitutionData.from_table(high))
    assert found.code == "height"
    assert "76.7 m/s" in found.cause  # √(2 · 9.80665 · 300)
    assert "300 m" in found.cause
    assert "[mm]" in found.advice
    # 20 m/s is the fall of 20.39 m
    for height, doubted in ((20.3, False), (20.5, True)):
        data = cal.RestitutionData.from_table({"h0": [height], "hf": [1.0]})
        assert codes(cal.plausibility(data)) == (["height"] if doubted else [])
    times = cal.RestitutionData.from_table({"interval": [500.0, 450.0, 405.0]})
    assert codes(cal.plausibility(times)) == ["height"]
    beyond = cal.RestitutionData.from_table(
        {"interval": [1e160, 1.0, 0.9]}
    )  # a height beyond floats
    assert any("inf m" in one.cause for one in cal.plausibility(beyond))


@pytest.mark.parametrize(
    ("columns", "falls"), [("h0 [m],h1 [m]", True), ("v_in [m/s],v_out [m/s]", False)]
)
def test_balls_that_fell_on_a_ball(columns, falls, doubts):
    """Without a wall two spheres are meant, which balls are seldom dropped on."""
    csv = f"{columns}\n1,0.8\n2,1.5\n3,2.2\n"
    assert codes(doubts(csv=csv)) == (["no-wall"] if falls else [])
    assert codes(doubts(WALL, csv=csv)) == []


def test_percent_taken_twice():
    """All below 0.02."""
    assert of(VELOCITY, RESTITUTION * 0.0199 / RESTITUTION[0]) == ["percent"]
    assert of(VELOCITY, RESTITUTION * 0.0201 / RESTITUTION[0]) == []


def test_velocities_beyond_all_guns():
    assert of(VELOCITY * 1001, RESTITUTION) == ["velocity"]
    assert of(VELOCITY * 999, RESTITUTION) == []


def test_restitutions_above_one_on_the_whole():
    noise = 0.02 * np.random.default_rng(1).standard_normal(100)
    velocity = np.linspace(0.5, 5, 100)
    assert of(velocity, 1.04 + noise) == ["above-one"]
    assert of(velocity, 1.0 + noise) == []
    assert of(velocity, 1.04 + noise, uncertainty=0.2) == []
    assert of(velocity[:7], 1.04 + noise[:7]) == []  # too few
    # the median's standard error is √(π/2n) u = 0.01253 for u = 0.1: 4 of them are 0.0501
    level = np.where(np.arange(100) % 2, 0.001, -0.001)
    assert of(velocity, 1.0495 + level, uncertainty=0.1) == []
    assert of(velocity, 1.0515 + level, uncertainty=0.1) == ["above-one"]


ASCENDING = np.array([1.0, 2.0, 3.0, 4.0])


@pytest.mark.parametrize(
    ("velocity", "is_doubted"),
    [
        (np.tile(ASCENDING, 3), True),
        (np.tile(ASCENDING[::-1], 3), True),
        (np.concatenate([ASCENDING, ASCENDING[1:] + 0.1, ASCENDING + 0.2]), True),
        (np.tile(ASCENDING, 2), True),
        (np.tile(ASCENDING[:3], 3), True),
        (np.repeat(ASCENDING, 3), False),  # repeats one after the other
        (np.linspace(1, 4, 12), False),
        (np.random.default_rng(2).permutation(np.repeat(ASCENDING, 3)), False),
        (np.tile([1.0, 2.0], 6), False),  # two heights in turns
        (np.tile(ASCENDING, 1), False),  # too few to tell
        (np.concatenate([ASCENDING, ASCENDING[:3]]), False),  # seven are too few
        (np.repeat([2.0, 1.0], 6), False),
    ],
)
def test_velocities_that_restart_look_like_groups(velocity, is_doubted):
    restitution = 0.9 - 0.02 * velocity
    assert of(velocity, restitution) == (["groups"] if is_doubted else [])
    assert of(velocity, restitution, group=[i // 4 for i in range(len(velocity))]) == []


def test_bounce_trains_are_groups_already():
    table = {"interval": np.tile(0.5 * 0.9 ** np.arange(5), 3), "launch": np.repeat([1, 2, 3], 5)}
    assert cal.plausibility(cal.RestitutionData.from_table(table)) == ()


@pytest.mark.parametrize(
    ("code", "doubted", "fine"),
    [
        ("radius", (1.93e11, 8000.0, 1.01), (1.93e11, 8000.0, 0.99)),
        ("density", (1.93e11, 9.9, 0.01), (1.93e11, 10.1, 0.01)),
        ("modulus", (0.99e5, 8000.0, 0.01), (1.01e5, 8000.0, 0.01)),
    ],
)
def test_a_contact_alone_is_taken_for_two_equal_spheres(code, doubted, fine):
    """Of ν = 0.3: their modulus, density and radius are found again."""
    for (modulus, density, radius), is_doubted in ((doubted, True), (fine, False)):
        ball = sj.Material(modulus, 0.3, density, 1.5e4)
        pair = sj.Contact.between_spheres(ball, ball, radius, radius)
        found = of(VELOCITY, RESTITUTION, contact=pair, limit_velocity=340.0)
        assert (code in found) == is_doubted
