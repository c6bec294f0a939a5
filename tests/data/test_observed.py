"""What else than ε was measured, and spheres of several sizes: columns, files, arrays, refusals."""

import numpy as np
import pytest

import calibration as cal
import softjax as sj

STEEL = sj.Material(1.93e11, 0.35, 8030.0, 3.10e8)
WALL = sj.Contact.with_wall(STEEL, STEEL, 0.005)
READ = cal.RestitutionData.from_table
NAN = float("nan")
CSV = """v [cm/s],e,contact duration [us],t_c uncertainty [us],F_max [kN],penetration [um],dent diameter [mm]
100,0.8,31,1,0.9,40,
200,,27,1,,80,1.4
300,0.7,,,3,120,1.6
"""
PROPERTIES = """
youngs_modulus = 1.93e11
poisson_ratio = 0.35
density = 8030
yield_strength = 3.10e8
"""
ON_WALL = f"[material.wall]{PROPERTIES}"
TOML = f"""[[material]]
name = "a"
data = "m.csv"{PROPERTIES}"""


def test_columns_are_read_in_their_units_with_gaps(read_toml):
    toml = f'{TOML}radius = 0.005\ndent = "residual"\npeak_force_uncertainty = "3 %"\n{ON_WALL}'
    (data,) = read_toml(toml, CSV)
    np.testing.assert_array_equal(data.restitution, [0.8, NAN, 0.7])
    columns = {
        "contact_time": [31e-6, 27e-6, NAN],
        "contact_time_uncertainty": [1e-6, 1e-6, NAN],
        "peak_force": [900, NAN, 3000],
        "peak_force_uncertainty": [27, NAN, 90],
        "peak_overlap": [40e-6, 80e-6, 120e-6],
        "dent_diameter": [NAN, 1.4e-3, 1.6e-3],
    }
    for name, expected in columns.items():
        np.testing.assert_allclose(getattr(data, name), expected, rtol=1e-14, err_msg=name)
    assert data.peak_overlap_uncertainty is None
    names = ["contact_time", "peak_force", "peak_overlap", "residual_dent_diameter"]
    assert [block.name for block in data.observed] == names
    assert "1 of peak_force" not in repr(data)
    assert "2 of peak_force, 3 of peak_overlap" in repr(data)
    given = {name: getattr(data, name) for name in columns}
    arrays = (data.velocity, data.restitution, data.contact)
    same = cal.RestitutionData(*arrays, name="a", dent="residual", **given)
    for one, other in zip(same.observed, data.observed, strict=True):
        np.testing.assert_equal(vars(one), vars(other))
    assert same != cal.RestitutionData(data.velocity, [0.8, 0.7, 0.7], data.contact, name="a")


def test_velocities_and_drops_serve_without_a_rebound():
    alone = READ({"velocity": [1.0, 2.0], "contact_time [ms]": [0.03, 0.025]})
    assert np.all(np.isnan(alone.restitution))
    assert "ε not measured" in repr(alone)
    table = {"drop_height": [0.5, 0.8, 1.0], "peak_force": [9.0, 11.0, 12.0]}
    options = {"height_uncertainty": 1e-3, "diameter": 0.01, "mass": 4e-3}
    fall = READ(table, **options)
    both = READ({**table, "rebound_height": [0.3, NAN, 0.6]}, **options)
    expected = np.sqrt(2 * 9.80665 * np.array(table["drop_height"]))
    for data in (fall, both):
        np.testing.assert_allclose(data.velocity, expected, rtol=3e-3)
        assert np.all(data.velocity_uncertainty > 0)
    np.testing.assert_array_equal(np.isnan(both.restitution), [False, True, False])
    np.testing.assert_array_equal(both.velocity, fall.velocity)
    speeds = {"impact_velocity": [1.0, 2.0], "rebound_velocity": [0.8, NAN], "peak_force": [1, 2]}
    np.testing.assert_array_equal(READ(speeds).restitution, [0.8, NAN])
    unmeasured = READ({"velocity": [1.0, 2.0], "restitution": [0.8, NAN], "peak_force": [1.0, NAN]})
    assert len(unmeasured) == 1


DROPS = {"drop_height": [0.5, 0.8], "rebound_height": [0.3, 0.5], "contact_time [ms]": [30, 700]}
FORCES = {"peak_force": [1, 2]}
V = [1.0, 2.0]


def of(stated=None, **table):
    return READ({"velocity": V, **table}, **stated or {})


REFUSED = [
    (lambda: of(contact_time=[-1e-5, 1e-5]), r"`contact_time\[0\]` must be a positive number in s"),
    (lambda: of(**{"peak_force [m]": [1, 2]}), r"`unit of peak_force` must be in N, kN, mN"),
    (lambda: of({"dent": "deep"}, dent_diameter=[1e-3, 2e-3]), "'largest' or 'residual', but is deep"),
    (lambda: of({"peak_force_uncertainty": 0}, **FORCES), r"`peak_force_uncertainty\[0\]`"),
    (lambda: of({"contact_time_uncertainty": 1e-6}, **FORCES), "`contact_time_uncertainty`"),
    (lambda: of(diameter=[1e-2, NAN], **FORCES), r"`diameter\[1\]` must be a positive"),
    (lambda: of({"contact": WALL}, radius=[1e-2, 2e-2], **FORCES), "`radius` must be given once"),
    (lambda: of({"contact": lambda r: WALL}, **FORCES), "a column diameter, radius or mass"),
    (lambda: READ({**DROPS, "contact_time [ms]": [30, 900]}, air=False), r"`contact_time\[1\]` must be shorter than the flight, 0.80"),
    (lambda: READ(DROPS, air=False).averaged(), "must be left out with contact_time, but is requested"),
    (lambda: cal.RestitutionData(V, [0.8, NAN], peak_force=[1.0, NAN]), r"`restitution\[1\]` must be a number, or measured by peak"),
    (lambda: cal.RestitutionData(V, [0.8, 0.7], peak_force_uncertainty=0.1), "`peak_force_uncertainty` must be left out without peak_f"),
]  # fmt: skip


@pytest.mark.parametrize(("call", "message"), REFUSED)
def test_what_makes_no_sense_is_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_sizes_in_the_rows_make_a_contact_for_each(read_toml):
    csv = "velocity [m/s],restitution,{}\n1,0.9,{}\n2,0.8,{}\n"
    radii = np.array([0.005, 0.01])
    mass = 8030 * np.pi / 6 * (2 * radii) ** 3
    expected = sj.Contact.with_wall(STEEL, STEEL, radii)
    columns = {"diameter [mm]": (10, 20), "radius [cm]": (0.5, 1.0), "mass [g]": 1e3 * mass}
    for header, cells in columns.items():
        (data,) = read_toml(TOML + ON_WALL, csv.format(header, *cells))
        for name, leaf in expected.leaves().items():
            np.testing.assert_allclose(getattr(data.contact, name), leaf, rtol=1e-9, err_msg=header)
        np.testing.assert_allclose(data.bodies[0].radius, radii, rtol=1e-9)
    (equal,) = read_toml(TOML, csv.format("diameter [mm]", 10, 20))
    np.testing.assert_allclose(equal.contact.radius, radii / 2, rtol=1e-12)
    second = "radius_2 = 0.03\n[material.second]" + PROPERTIES
    (data,) = read_toml(TOML + second, csv.format("diameter [mm]", 10, 20))
    np.testing.assert_allclose(data.contact.radius, radii * 0.03 / (radii + 0.03), rtol=1e-12)
    np.testing.assert_allclose(data.bodies[0].radius, radii, rtol=1e-9)
    table = {"velocity": [1.0, 2.0], "restitution": [0.9, 0.8], "diameter": 2 * radii}
    same = READ(table, lambda r: sj.Contact.with_wall(STEEL, STEEL, r))
    np.testing.assert_array_equal(same.contact.mass, expected.mass)
    with pytest.raises(ValueError, match="diameter is a column, and the bodies have one size"):
        read_toml(TOML + "radius = 0.01\n" + ON_WALL, csv.format("diameter [mm]", 10, 20))
    with pytest.raises(ValueError, match="radius or diameter is missing; it must be stated"):
        read_toml(TOML + ON_WALL, "velocity,restitution\n1,0.9\n")
    drops = "drop_height [m],rebound_height [m],diameter [mm]\n0.5,0.3,3\n0.5,0.3,30\n"
    (data,) = read_toml(TOML + ON_WALL, drops)
    small, large = data.velocity
    assert small < large < np.sqrt(2 * 9.80665 * 0.5)
