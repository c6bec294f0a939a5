"""Material files and their CSV files, read as people write them; numbers worked out by hand."""

import math
import tomllib
from pathlib import Path

import numpy as np
import pytest
from calibration.csv_file import read_csv

from calibration.errors import InputError
from calibration.parameters_spec import ParameterSpec
from calibration.problem_file import read_problem, read_toml

STEEL = """\
youngs_modulus = 1.93e11     # Pa
poisson_ratio = 0.35
density = 8030               # kg/m³
yield_strength = 3.10e8      # Pa
"""
GLASS = """\
youngs_modulus = 7e10
poisson_ratio = 0.25
density = 2500
yield_strength = 5e8
"""
ROWS = "velocity [cm/s],restitution,uncertainty\n12,0.95,0.004\n300,0.7,0.02\n"
PLANE_STRAIN_STEEL = 1.93e11 / (1 - 0.35**2)
PLANE_STRAIN_GLASS = 7e10 / (1 - 0.25**2)


@pytest.fixture
def read(tmp_path):
    """Write a material file and its data files; read the problem."""

    def write_and_read(toml, needs_data=True, **files):
        for name, text in ({"m": ROWS} | files).items():
            (tmp_path / f"{name}.csv").write_text(text, encoding="utf-8")
        (tmp_path / "m.toml").write_text(toml, encoding="utf-8")
        return read_problem(tmp_path / "m.toml", needs_data)

    return write_and_read


def material(*lines, properties=STEEL, data="m.csv"):
    return "\n".join(["[[material]]", properties, f'data = "{data}"', *lines]) + "\n"


def mass(density, radius):
    return 4 / 3 * math.pi * density * radius**3


def test_two_equal_spheres(read):
    problem = read(material('name = "my alloy"', "radius = 0.0127"))
    (data,) = problem.datasets
    assert data.name == "my alloy"
    np.testing.assert_allclose(data.velocity, [0.12, 3.0], rtol=1e-15)
    np.testing.assert_array_equal(data.restitution, [0.95, 0.7])
    np.testing.assert_array_equal(data.uncertainty, [0.004, 0.02])
    contact = data.contact
    assert contact.youngs_modulus == pytest.approx(PLANE_STRAIN_STEEL / 2, rel=1e-14)
    assert contact.radius == pytest.approx(0.00635, rel=1e-14)
    assert contact.mass == pytest.approx(mass(8030, 0.0127) / 2, rel=1e-14)
    assert (contact.yield_strength, contact.area) == (3.10e8, "zhou")
    assert data.limit_velocity == pytest.approx(math.sqrt(3 * 3.10e8 / 8030), rel=1e-14)


def test_two_radii_and_another_area(read):
    toml = material("radius_1 = 0.01", "radius_2 = 0.03", 'area = "hertz"')
    contact = read(toml).datasets[0].contact
    assert contact.radius == pytest.approx(0.0075, rel=1e-14)
    assert contact.mass == pytest.approx(mass(8030, 0.01) * 27 / 28, rel=1e-14)
    assert contact.area == "hertz"


def test_the_area_of_the_fit_serves_materials_without_their_own(read):
    toml = '[fit]\narea = "hertz"\n' + material("radius = 0.01", 'name = "a"')
    toml += material("radius = 0.01", 'area = "zhou"', 'name = "b"')
    problem = read(toml)
    assert [data.contact.area for data in problem.datasets] == ["hertz", "zhou"]


@pytest.mark.parametrize(
    "radii", [("radius = 0.01",), ("radius_1 = 0.01", "radius_2 = 0.01")], ids=["one", "two"]
)
def test_dissimilar_spheres(read, radii):
    contact = read(material(*radii, "[material.second]", GLASS)).datasets[0].contact
    modulus = 1 / (1 / PLANE_STRAIN_STEEL + 1 / PLANE_STRAIN_GLASS)
    assert contact.youngs_modulus == pytest.approx(modulus, rel=1e-14)
    assert contact.radius == pytest.approx(0.005, rel=1e-14)
    reduced = 8030 * 2500 / (8030 + 2500)
    assert contact.mass == pytest.approx(mass(reduced, 0.01), rel=1e-14)
    assert contact.yield_strength == 3.10e8  # the weaker one's


def test_a_sphere_on_a_wall(read):
    contact = read(material("radius = 0.01", "[material.wall]", GLASS)).datasets[0].contact
    modulus = 1 / (1 / PLANE_STRAIN_STEEL + 1 / PLANE_STRAIN_GLASS)
    assert contact.youngs_modulus == pytest.approx(modulus, rel=1e-14)
    assert contact.radius == 0.01
    assert contact.mass == pytest.approx(mass(8030, 0.01), rel=1e-14)


def test_numbers_for_the_whole_set(read):
    toml = material(
        "radius = 0.01", "limit_velocity = 200", "uncertainty = 0.02", "velocity_uncertainty = 0.1"
    )
    (data,) = read(toml, m="velocity,restitution\n1.0,0.9\n2.0,0.8\n").datasets
    assert data.limit_velocity == data.contact.limit_velocity == 200.0
    np.testing.assert_array_equal(data.uncertainty, [0.02, 0.02])
    np.testing.assert_array_equal(data.velocity_uncertainty, [0.1, 0.1])


def test_without_elastic_properties(read):
    limited, constant = read(
        material('name = "a"', "limit_velocity = 50.0", properties="")
        + material('name = "b"', properties="")
    ).datasets
    assert (limited.contact, limited.limit_velocity) == (None, 50.0)
    assert (constant.contact, constant.limit_velocity) == (None, None)


def test_a_name_is_that_of_the_data_file_where_none_is_given(read):
    assert read(material("radius = 0.01")).datasets[0].name == "m"


def test_data_may_lie_in_a_folder_beside_the_file(tmp_path):
    (tmp_path / "runs").mkdir()
    (tmp_path / "runs" / "a.csv").write_text(ROWS)
    (tmp_path / "m.toml").write_text('[[material]]\ndata = "runs/a.csv"\n')
    (data,) = read_toml(tmp_path / "m.toml")
    assert data.name == "a"
    assert data.origin.file == str(tmp_path / "runs" / "a.csv")


def test_heights_and_gravity(read):
    drops = "drop_height [cm],rebound_height [mm]\n50,320\n"
    bare = {"properties": ""}
    standard = read(material(**bare), m=drops).datasets[0]
    assert standard.velocity[0] == pytest.approx(3.131557120, rel=1e-9)  # √9.80665
    assert standard.restitution[0] == pytest.approx(0.8, rel=1e-14)
    moon = read(material("gravity = 1.62", **bare), m=drops).datasets[0]
    assert moon.velocity[0] == pytest.approx(1.272792206, rel=1e-9)  # √1.62


def test_bounces_of_a_ball(read):
    """Two launches from one height, labelled, times in milliseconds; the lines are the tₙ's."""
    bounces = (
        "# a ball on a plate\n"
        "launch,interval [ms],uncertainty\n"
        "A,720,0.01\nA,648,0.01\nA,583.2,\n"
        "\n"
        "B,730,0.01\nB,664.3,\n"
    )
    (data,) = read(material('name = "ball"', properties=""), m=bounces).datasets
    np.testing.assert_allclose(data.restitution, [0.9, 0.9, 0.91], rtol=1e-14)
    # 9.80665/2 · (0.72, 0.648, 0.73)
    np.testing.assert_allclose(data.velocity, [3.530394, 3.1773546, 3.57942725], rtol=1e-14)
    np.testing.assert_array_equal(data.uncertainty, [0.01, 0.01, 0.01])
    assert data.origin.lines == (3, 4, 7)


def test_repeats_are_averaged_on_request(read):
    repeats = "velocity,restitution\n2.0,0.8\n1.0,0.90\n1.0,0.94\n2.0,0.82\n"
    plain = read(material(properties=""), m=repeats).datasets[0]
    assert len(plain) == 4
    own = read(material("average_repeats = true", properties=""), m=repeats).datasets[0]
    np.testing.assert_allclose(own.restitution, [0.92, 0.81], rtol=1e-14)
    np.testing.assert_allclose(own.uncertainty, [0.02, 0.01], rtol=1e-12)  # half the difference
    assert own.origin.lines == (3, 2)
    toml = material('average_repeats = "pooled"', properties="")
    pooled = read(toml, m=repeats).datasets[0]
    # s² = (2 · 0.02² + 2 · 0.01²)/2, over √2
    np.testing.assert_allclose(pooled.uncertainty, [math.sqrt(0.00025)] * 2, rtol=1e-12)


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig"])
@pytest.mark.parametrize("newline", ["\n", "\r\n", "\r"])
def test_csv_files_as_programs_save_them(tmp_path, delimiter, encoding, newline):
    rows = [
        '# saved by "a program", 5; 6',
        "",
        '"velocity [mm/s]", restitution ,',
        "  # a comment",
        "120,0.95,",
        ",,",
        " 3.0e3 ,+.7",
    ]
    text = newline.join(rows).replace(",", delimiter) + newline
    (tmp_path / "a.csv").write_bytes(text.encode(encoding))
    data = read_csv(tmp_path / "a.csv")
    np.testing.assert_array_equal(data.velocity, [0.12, 3.0])
    np.testing.assert_array_equal(data.restitution, [0.95, 0.7])
    assert (data.name, data.origin.line, data.origin.lines) == ("a", 3, (5, 7))


def test_material_files_with_a_byte_order_mark_and_windows_lines(tmp_path):
    (tmp_path / "m.csv").write_text(ROWS)
    toml = material('name = "a"', properties="", data="m.csv")
    (tmp_path / "m.toml").write_bytes(b"\xef\xbb\xbf" + toml.replace("\n", "\r\n").encode())
    assert read_toml(tmp_path / "m.toml")[0].name == "a"


PARAMETERS = """
[material.parameters]
psi = 0.5
chi = { value = 0.1, bounds = [0.01, inf], transform = "log" }
yield_strength = { prior = [3.1e8, 1e7], shared = "steel" }
limit_velocity = { free = false }

[material.parameters.sigma]
shared = true
value = 3
"""


def test_parameters_of_a_material(read):
    problem = read(material("radius = 0.01", PARAMETERS))
    (specs,) = problem.parameters
    assert specs == {
        "psi": ParameterSpec("psi", free=False, value=0.5),
        "chi": ParameterSpec("chi", value=0.1, bounds=(0.01, math.inf), transform="log"),
        "yield_strength": ParameterSpec("yield_strength", prior=(3.1e8, 1e7), shared="steel"),
        "limit_velocity": ParameterSpec("limit_velocity", free=False),
        "sigma": ParameterSpec("sigma", value=3.0, shared="all"),
    }
    assert specs["sigma"].free
    lines = {name: spec.origin.line for name, spec in specs.items()}
    written = Path(problem.file.file).read_text(encoding="utf-8").split("\n")
    assert written[lines["chi"] - 1].startswith("chi =")
    assert written[lines["sigma"] - 1] == "[material.parameters.sigma]"


def test_open_bounds_are_drawn_in_to_what_makes_sense():
    spec = ParameterSpec("restitution", bounds=(-math.inf, 0.9))
    assert spec.bounds == (0.0, 0.9)
    assert ParameterSpec("c1", bounds=(-1.0, math.inf)).bounds == (-1.0, math.inf)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"name": "xi"}, "`name` must be one of chi, sigma, psi"),
        ({"free": 1}, "`free` must be true or false"),
        ({"value": math.nan}, "`value` must be a number of 0 or more"),
        ({"value": True}, "`value` must be a number of 0 or more"),
        ({"bounds": (0.0,)}, "`bounds` must be two numbers"),
        ({"bounds": (0.0, math.nan)}, "`bounds` must be two numbers"),
        ({"prior": (1.0, -0.1)}, "`prior` must be .*positive standard deviation"),
        ({"transform": "cube"}, "`transform` must be one of log, logit, none"),
        ({"shared": ""}, "`shared` must be the name of a group"),
        ({"name": "c1", "transform": "log"}, "`transform` must be logit or none without a lower"),
    ],
)
def test_parameters_that_make_no_sense(fields, message):
    with pytest.raises(ValueError, match=message):
        ParameterSpec(**({"name": "sigma"} | fields))


def test_the_line_through_all_materials(read):
    toml = "[parameters]\nc1 = 0.03\nc2 = { value = 0.005 }\n" + material("radius = 0.01")
    shared = read(toml).shared_parameters
    assert shared == {
        "c1": ParameterSpec("c1", free=False, value=0.03),
        "c2": ParameterSpec("c2", value=0.005),
    }


def test_settings(read):
    fit = """
    [fit]
    objective = "model"
    optimiser = "levenberg-marquardt"
    loss = "huber"
    route = "ode"
    rtol = 1e-8
    seed = 7
    starts = 32
    form = "full"
    kappa = "printed"
    confidence = 0.9
    """
    problem = read(fit + material("radius = 0.01"))
    assert problem.settings == tomllib.loads(fit)["fit"]
    assert read(material("radius = 0.01")).settings == {}
    error = problem.refusal("starts", "32 starts", "fewer")
    assert str(error) == f"{problem.file.file}:9: 32 starts; fewer"


def test_materials_without_measurements(read):
    toml = '[[material]]\nname = "a"\nradius = 0.01\n' + STEEL + material("radius = 0.02")
    problem = read(toml, needs_data=False)
    assert [entry.name for entry in problem.materials] == ["a", "m"]
    assert [entry.data is None for entry in problem.materials] == [True, False]
    assert problem.materials[0].contact.radius == pytest.approx(0.005)
    assert (len(problem.datasets), len(problem.parameters)) == (1, 1)
    with pytest.raises(InputError, match=r"m\.toml:1: data is missing"):
        read_problem(problem.file.file)
