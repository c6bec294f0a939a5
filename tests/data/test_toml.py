"""Material files: bodies, radii, walls, repeats and places of data files, by hand-computed numbers."""

import json
import math

import numpy as np
import pytest

import calibration as cal
import softjax as sj
from tests.covariance import covariance_of

STEEL = "youngs_modulus = 1.93e11  # Pa\npoisson_ratio = 0.35\ndensity = 8030\nyield_strength = 3.10e8\n"
GLASS = "youngs_modulus = 7e10\npoisson_ratio = 0.25\ndensity = 2500\nyield_strength = 5e8\n"
PLANE_STRAIN = [1.93e11 / (1 - 0.35**2), 7e10 / (1 - 0.25**2)]
HARMONIC = 1 / (1 / PLANE_STRAIN[0] + 1 / PLANE_STRAIN[1])


def entry(*lines, properties=STEEL):
    return "\n".join(["[[material]]", properties, 'data = "m.csv"', *lines]) + "\n"


def mass(density, radius):
    return 4 / 3 * math.pi * density * radius**3


# lines: E* [Pa], R* [m], M* [kg] of the pair, and both radii; v_lim = √(3 Y/ρ) of the body that yields
WALL = f"[material.wall]\n{GLASS}"
EQUAL = (PLANE_STRAIN[0] / 2, 0.00635, mass(4015, 0.0127), 0.0127, 0.0127)
TWO = (PLANE_STRAIN[0] / 2, 0.0075, mass(8030, 0.01) * 27 / 28, 0.01, 0.03)
ON_GLASS = (HARMONIC, 0.01, mass(8030, 0.01), 0.01, None)
PAIRS = {
    "radius = 0.0127": EQUAL,
    "diameter = 0.0254": EQUAL,
    'diameter = "1 in"': EQUAL,
    "radius_1 = 0.01\nradius_2 = 0.03": TWO,
    'diameter_1 = 0.02\ndiameter_2 = "60 mm"': TWO,
    f"radius = 0.01\n[material.second]\n{GLASS}": (HARMONIC, 0.005, mass(8030 * 2500 / 10530, 0.01), 0.01, 0.01),
    f"radius = 0.01\n{WALL}": ON_GLASS,
    f'diameter = "2 cm"\n{WALL}': ON_GLASS,
}  # fmt: skip


@pytest.mark.parametrize("lines", PAIRS)
def test_contacts(lines, read_toml):
    modulus, radius, inertia, *radii = PAIRS[lines]
    (data,) = read_toml(entry(lines))
    found = data.contact
    numbers = [found.youngs_modulus, found.radius, found.mass, found.yield_strength]
    np.testing.assert_allclose(numbers, [modulus, radius, inertia, 3.10e8], rtol=1e-14)
    assert found.area == "zhou"
    assert data.limit_velocity == found.limit_velocity == pytest.approx(340.317045, rel=1e-8)
    assert [body.radius for body in data.bodies] == [r and pytest.approx(r) for r in radii]


def test_named_materials_limit_velocities_areas_and_entries_without_bodies(read_toml):
    """A limit in the file stands; an area is a material's own, else that of [fit]."""
    wall = '[[material]]\ndata = "m.csv"\nmaterial = "Chrome-Steel"\nradius = 0.01\n[material.wall]\n'  # fmt: skip
    (data,) = read_toml(wall + 'material = "nylon"\n')
    assert data.contact == sj.Contact.with_wall(sj.CHROME_STEEL, sj.NYLON, 0.01)
    for name in ("chrome steel", "nylon"):
        assert any(name in remark and "Table 1" in remark for remark in data.remarks)
    (same,) = read_toml(entry("radius = 0.01", "[material.second]", 'material = "stainless steel"'))
    assert same.contact == read_toml(entry("radius = 0.01"))[0].contact
    toml = '[fit]\narea = "hertz"\n' + entry("radius = 0.01", 'limit_velocity = "200 m/s"', 'name = "a"')  # fmt: skip
    toml += entry("radius = 0.01", 'area = "zhou"', 'name = "b"')
    toml += entry('name = "c"', "limit_velocity = 50.0", properties="")
    first, second, limited, constant = read_toml(toml + entry('name = "d"', properties=""))
    assert first.limit_velocity == first.contact.limit_velocity == 200.0
    assert first.contact.yield_strength == 3.10e8
    assert [data.contact.area for data in (first, second)] == ["hertz", "zhou"]
    assert (limited.contact, limited.limit_velocity) == (None, 50.0)
    assert (constant.contact, constant.limit_velocity) == (None, None)


UNCERTAINTIES = [  # a key for all rows, the column in its place
    ("uncertainty = 0.01\nvelocity_uncertainty = 0", "v,e", "v,e,uncertainty", "0.01"),
    ('velocity_uncertainty = "5 %"', "v,e", "v,e,u_v [%]", "5"),
    ("impact_velocity_uncertainty = 0.02", "v_in,v_out", "v_in,v_out,u_v_in", "0.02"),
    ('rebound_velocity_uncertainty = "2 cm/s"', "v_in,v_out", "v_in,v_out,u_v_out", "0.02"),
    ('height_uncertainty = "2 mm"', "h0,h1", "h0,h1,u_h", "0.002"),
    ("drop_height_uncertainty = 0.002", "h0,h1", "h0,h1,u_h0", "0.002"),
    ("rebound_height_uncertainty = 0.002", "h0,h1", "h0,h1,u_hf", "0.002"),
    ('interval_uncertainty = "2 ms"', "interval,x", "interval,x,u_dt", "0.002"),
    ("timing_uncertainty = 0.002", "time,note", "time,note,u_t", "0.002"),
    ("time_uncertainty = 0.002", "time,note", "time,note,u_time", "0.002"),
]


@pytest.mark.parametrize(("key", "header", "full", "cell"), UNCERTAINTIES)
def test_an_uncertainty_for_all_rows_is_its_column(read_toml, key, header, full, cell):
    values = (1.0, 1.8, 2.4) if "time," in header else (2.0, 1.8, 1.5)
    rows = [f"{x},{y}" for x, y in zip(values, (0.9, 0.8, 0.7), strict=True)]
    stated = read_toml(entry(key, properties=""), "\n".join([header, *rows]))
    rows = [f"{row},{cell}" for row in rows]
    column = read_toml(entry(properties=""), "\n".join([full, *rows]))
    sizes = [covariance_of(one, -0.1) for (one,) in (stated, column)]
    np.testing.assert_allclose(*sizes, rtol=1e-13)
    assert np.any(sizes[0])


REPEATS = "velocity,restitution\n2.0,0.8\n1.0,0.90\n1.0,0.94\n2.0,0.82\n"


def test_repeats_are_averaged_on_request(read_toml):
    for value in ("true", '"pooled"'):
        (data,) = read_toml(entry(f"average_repeats = {value}", properties=""), REPEATS)
        np.testing.assert_allclose(data.restitution, [0.92, 0.81], rtol=1e-14)
        # s² = (2 · 0.02² + 2 · 0.01²)/2, over √2
        np.testing.assert_allclose(data.uncertainty, [math.sqrt(0.00025)] * 2, rtol=1e-12)
        assert (data.degrees, data.origin.lines) == (2, (3, 2))
    assert len(read_toml(entry("average_repeats = false", properties=""), REPEATS)[0]) == 4


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_material_files_as_editors_save_them(read_toml, encoding, newline):
    text = entry('name = "Stahl für χ̃"', properties="").replace("\n", newline)
    assert read_toml(text, encoding=encoding)[0].name == "Stahl für χ̃"


def test_names_and_places_of_data_files(tmp_path):
    for place, value in (("there", 0.9), ("here", 0.8)):
        (tmp_path / place).mkdir()
        (tmp_path / place / "a b.csv").write_text(f"velocity,restitution\n1.0,{value}\n")
    (tmp_path / "m.toml").write_text('[[material]]\ndata = "there/a b.csv"\n')
    (data,) = cal.read_toml(tmp_path / "m.toml")
    assert (data.name, data.origin.file) == ("a b", str(tmp_path / "there" / "a b.csv"))


OF_ALL = "[parameters]\nsigma = 2.0\nxi = { value = 0.4 }\n"
OF_ONE = """
[material.parameters]
psi = 0.5
chi = { value = 0.1, bounds = [0.01, inf], transform = "log" }
yield_strength = { value = "310 MPa", prior = ["310 MPa", "50 Pa"], bounds = ["0.1 GPa", inf] }
rate = { prior = [3.1e8, 1e7], shared = "steel" }
limit_velocity = { free = false }
zeta = -0.0
[material.parameters.sigma]
shared = true
value = 3
"""


def test_parameters_and_settings_of_a_file(tmp_path):
    """A number fixes; the entry of one material goes before that of all."""

    def problem(toml):
        (tmp_path / "m.csv").write_text("velocity,restitution\n0.12,0.95\n3.0,0.7\n")
        (tmp_path / "m.toml").write_text(toml, encoding="utf-8")
        return cal.read_problem(tmp_path / "m.toml")

    (parameters,) = problem(OF_ALL + entry(properties="") + OF_ONE).parameters
    assert parameters == {
        "psi": cal.Parameter(0.5, free=False),
        "chi": cal.Parameter(0.1, bounds=(0.01, math.inf), transform="log"),
        "yield_strength": cal.Parameter(3.1e8, prior=(3.1e8, 50.0), bounds=(1e8, math.inf)),
        "rate": cal.Parameter(prior=(3.1e8, 1e7), shared="steel"),
        "limit_velocity": cal.Parameter(free=False),
        "zeta": cal.Parameter(0.0, free=False),
        "sigma": cal.Parameter(3.0, shared=True),
        "xi": cal.Parameter(0.4),
    }
    assert math.copysign(1, parameters["zeta"].value) == 1
    options = {
        "law": "zhou", "objective": "model", "optimiser": "levenberg-marquardt", "route": "ode",
        "rtol": 1e-8, "seed": 7, "starts": 32, "form": "full", "kappa": "printed", "area": "hertz",
        "confidence": 0.9, "max_steps": 50, "unloading_line": "curves", "profiles": False,
        "extra_scatter": True,
    }  # fmt: skip
    lines = [f"{key} = {json.dumps(value)}" for key, value in options.items()]
    assert problem("\n".join(["[fit]", *lines, entry(properties="")])).settings == options
    assert problem(entry(properties="")).settings == {}


def test_a_mass_alone_is_a_ball_whose_size_may_stand_in_the_rows(read_toml):
    """Without a size nothing is corrected for air, and the remark says so."""
    toml, drops = (
        '[[material]]\nmass = "2.7 g"\ndata = "m.csv"\n',
        "drop_height,rebound_height\n1,0.8\n",
    )
    (data,) = read_toml(toml, drops)
    assert any("not corrected for air" in remark for remark in data.remarks)
    assert data.contact is None
    (sized,) = read_toml(toml, "drop_height,rebound_height,diameter [mm]\n1,0.8,40\n")
    (same,) = read_toml(f"{toml}diameter = 0.04\n", drops)
    assert sized.restitution[0] == pytest.approx(same.restitution[0], rel=1e-12)
    assert sized.restitution[0] > data.restitution[0] + 0.01
