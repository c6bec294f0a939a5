"""Drops and bounces in air, against flights integrated with a drag that depends on Reynolds' number."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import calibration as cal
import softjax as sj

READ = cal.RestitutionData.from_table
G, RHO, VISCOSITY, FASTEST = 9.80665, 1.2, 1.81e-5, 2e5
# diameter [m], density [kg/m³], fall [m], ε
BALLS = {
    "3 mm plastic": (3e-3, 1100.0, 0.8, 0.9),
    "1 mm glass": (1e-3, 2500.0, 0.002, 0.9),
    "6 mm nylon": (6e-3, 1140.0, 1.2, 0.9),
    "12.7 mm nylon": (12.7e-3, 1140.0, 0.5, 0.9),
    "40 mm table tennis": (40e-3, 85.0, 1.0, 0.8),
    "25 mm steel": (25e-3, 7800.0, 1.3, 0.7),
    "40 mm steel": (40e-3, 7800.0, 45.0, 0.6),
}


def drag_coefficient(reynolds):
    """Brown and Lawler (2003), Eq. 19."""
    return 24 / reynolds * (1 + 0.150 * reynolds**0.681) + 0.407 / (1 + 8710 / reynolds)


def flight(diameter, density, height=0.0, speed=0.0, factor=1.0):
    """The time to the top and the height there, or the time to the ground and the speed there."""
    volume, area = np.pi / 6 * diameter**3, np.pi / 4 * diameter**2
    moved = (density + 0.5 * RHO) * volume

    def rate(time, state):
        v = state[1]
        drag = factor * drag_coefficient(max(RHO * abs(v) * diameter / VISCOSITY, 1e-9))
        push = (density - RHO) * volume * G + 0.5 * RHO * drag * area * v * abs(v)
        return [v, -push / moved]

    def end(time, state):
        return state[1] if speed else state[0]

    end.terminal, end.direction = True, -1
    found = solve_ivp(rate, [0, 100], [height, speed], events=end, rtol=1e-9, atol=1e-12)
    return found.t[-1], found.y[0, -1] if speed else -found.y[1, -1]


def simulated(name, factor=1.0):
    """Three bounces: tables of heights, flight times and times, each with its first bounce; speeds."""
    *ball, height, restitution = BALLS[name]
    heights, times, speeds = [height], [], []
    for _ in range(3):
        down, v = flight(*ball, height=heights[-1], factor=factor)
        up, top = flight(*ball, speed=restitution * v, factor=factor)
        speeds.append(v)
        heights.append(top)
        times += [down, up]
    assert 10 < RHO * speeds[0] * ball[0] / VISCOSITY < FASTEST
    intervals = [times[1] + times[2], times[3] + times[4]]
    tables = {
        "heights": ({"drop_height": heights[:2], "rebound_height": heights[1:3]}, 0),
        "intervals": ({"interval": intervals}, 1),
        "times": ({"time": np.cumsum([0.1, *intervals])}, 1),
    }
    return tables, speeds, dict(zip(("diameter", "density"), ball, strict=True))


@pytest.mark.parametrize("name", BALLS)
def test_restitutions_of_simulated_flights_come_back(name):
    restitution = BALLS[name][-1]
    tables, speeds, ball = simulated(name)
    for kind, (table, first) in tables.items():
        data = READ(table, **ball)
        bare = READ(table, air=False, **ball)
        expected = np.array(speeds[first : first + len(data)])
        assert np.all(np.abs(data.restitution / restitution - 1) < 0.03), kind
        off, correction = data.restitution - restitution, bare.restitution - restitution
        assert np.all(np.abs(off) < 0.03 * np.abs(correction)), kind
        off, correction = data.velocity - expected, bare.velocity - expected
        assert np.all(np.abs(off) < 0.03 * np.abs(correction) + 1e-6 * expected), kind
        by = data.restitution - bare.restitution, 100 * (data.velocity / bare.velocity - 1)
        of_e, of_v = (x[np.argmax(np.abs(x))] for x in by)
        text = f"(drag, buoyancy, added mass): ε by {of_e:+.2g} and v by {of_v:+.2g} % at most"
        assert f"corrected for air of 1.2 kg/m³ {text}" in data.remarks
        if kind == "heights":
            drop, rebound = map(np.array, table.values())
            np.testing.assert_array_equal(bare.velocity, np.sqrt(2 * G * drop))
            np.testing.assert_array_equal(bare.restitution, np.sqrt(rebound / drop))
            for flown in (data, bare):
                speed = flown.restitution * flown.velocity
                np.testing.assert_allclose(flown.fall.height(flown.velocity), drop, rtol=1e-9)
                np.testing.assert_allclose(flown.fall.rebound_height(speed), rebound, rtol=1e-9)
            assert data.fall.has_rebounds
            assert np.isinf(data.fall.height(np.array([1e4]))[0])  # no fall is as fast


TABLES = {
    "heights": {"drop_height": [0.5, 0.8], "rebound_height": [0.3, 0.5]},
    "interval": {"interval": [0.62, 0.55, 0.49]},
    "time": {"time": [0.0, 0.62, 1.17, 1.66]},
}


@pytest.mark.parametrize("kind", TABLES)
def test_errors_follow_the_derivatives(kind):
    def points(**changed):
        options = {f"{kind.removesuffix('s')}_uncertainty": 1e-3}
        return READ({**TABLES[kind], **changed}, diameter=6e-3, mass=1.3e-4, **options)

    data, step = points(), 1e-6
    e = data.errors
    for name, values in TABLES[kind].items():
        for row in range(len(values)):
            values = np.array(TABLES[kind][name])
            values[row] += step
            off = points(**{name: values})
            column = 2 * row + list(TABLES[kind]).index(name) if kind == "heights" else row
            for slopes, to in ((e.to_restitution, "restitution"), (e.to_velocity, "velocity")):
                found = np.sum(np.where(e.index == column, slopes, 0.0), axis=1)
                by = (getattr(off, to) - getattr(data, to)) / step
                np.testing.assert_allclose(found, by, rtol=2e-5, atol=2e-6)


BALL = {"diameter": 6e-3, "mass": 1.3e-4}


def test_a_restitution_as_if_in_vacuum_is_corrected_and_one_in_air_or_measured_directly_is_not():
    table = TABLES["heights"]
    in_air = READ(table, **BALL)
    bare = READ(table, air=False, **BALL)
    for given in (in_air, bare):
        data = READ({**table, "restitution": given.restitution}, **BALL)
        np.testing.assert_allclose(data.restitution, in_air.restitution, rtol=1e-14)
    data = READ({"impact_velocity": [1.0, 2.0], "rebound_velocity": [0.8, 1.6]}, **BALL)
    np.testing.assert_array_equal(data.restitution, [0.8, 0.8])
    assert data.errors.by_drag is None
    heavy = READ(table, diameter=6e-3, mass=100.0)
    np.testing.assert_allclose(heavy.restitution, bare.restitution, rtol=1e-7)


def test_drag_enters_all_points_by_one_coefficient():
    more, less = (simulated("6 mm nylon", 1 + c) for c in (0.02, -0.02))
    for kind, (_, first) in more[0].items():
        found = []
        for tables, speeds, ball in (more, less):
            data = READ(tables[kind][0], **ball)
            off = speeds[first : first + len(data)] - data.velocity
            found.append(np.stack([BALLS["6 mm nylon"][-1] - data.restitution, off], axis=1))
        by = (found[0] - found[1]) / 0.04
        np.testing.assert_allclose(data.errors.by_drag, by, rtol=0.04, err_msg=kind)
    every = READ({"drop_height": [0.5, 0.5, 0.8], "rebound_height": [0.3, 0.3, 0.5]}, **BALL)
    np.testing.assert_allclose(every.averaged().errors.by_drag, every.errors.by_drag[1:])


def test_the_ball_is_that_of_the_bodies_or_of_a_contact_with_a_wall():
    wall = sj.Contact.with_wall(sj.Material(3e9, 0.35, 1140.0, 6e7), sj.STAINLESS_STEEL, 3e-3)
    of_contact = READ(TABLES["heights"], wall)
    stated = READ(TABLES["heights"], diameter=6e-3, density=1140.0)
    np.testing.assert_allclose(of_contact.restitution, stated.restitution, rtol=1e-14)
    unknown = READ(TABLES["heights"])
    assert unknown.errors.by_drag is None


@pytest.mark.parametrize(
    ("lines", "air"),
    [("", 1.2), ('air = "0.6 kg/m³"\n', 0.6), ("air = 2.4\n", 2.4), ("air = false\n", False)],
)
def test_a_file_says_what_the_balls_fly_in(read_toml, lines, air):
    csv = "drop_height [m],rebound_height [m]\n0.5,0.3\n0.8,0.5\n"
    toml = '[[material]]\nname = "a"\ndata = "m.csv"\ndiameter = "6 mm"\nmass = "0.13 g"\n' + lines
    (data,) = read_toml(toml, csv)
    expected = READ(TABLES["heights"], air=air, **BALL).restitution
    np.testing.assert_allclose(data.restitution, expected, rtol=1e-12)
    with pytest.raises(ValueError, match='air is "5 %"; it must be true, false, or a density'):
        read_toml(toml.replace(lines or "\x00", "") + 'air = "5 %"\n', csv)
