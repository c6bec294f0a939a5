"""Material files and their data files, read as people write them; numbers worked out by hand."""

import json
import math

import numpy as np
import pytest

import softjax as sj
from calibration.data import read_materials, read_toml
from calibration.data.as_json import data_from_dict, data_to_dict
from calibration.data.json_file import plain
from calibration.errors import InputError

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
    """Write a material file and its data files; read it."""

    def write_and_read(toml, needs_data=True, **files):
        for name, text in ({"m": ROWS} | files).items():
            (tmp_path / f"{name}.csv").write_text(text, encoding="utf-8")
        (tmp_path / "m.toml").write_text(toml, encoding="utf-8")
        return read_materials(tmp_path / "m.toml", needs_data)

    return write_and_read


def material(*lines, properties=STEEL, data="m.csv"):
    return "\n".join(["[[material]]", properties, f'data = "{data}"', *lines]) + "\n"


def mass(density, radius):
    return 4 / 3 * math.pi * density * radius**3


def test_two_equal_spheres(read):
    (data,) = read(material('name = "my alloy"', "radius = 0.0127")).datasets
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
    assert [(body.name, body.radius) for body in data.bodies] == [
        ("sphere", 0.0127),
        ("second sphere", 0.0127),
    ]


def test_quantities_with_their_units_as_text(read):
    units = """\
    youngs_modulus = "193 GPa"
    poisson_ratio = 0.35
    density = "8.03 g/cm3"
    yield_strength = "310 N/mm²"
    radius = "12.7 mm"
    limit_velocity = "200 m/s"
    uncertainty = 0.01
    velocity_uncertainty = "5 %"
    """
    plain = ("radius = 0.0127", "limit_velocity = 200", "uncertainty = 0.01")
    rows = {"m": "velocity,restitution\n1.0,0.9\n2.0,0.8\n"}
    (told,) = read(material(properties=units), **rows).datasets
    (same,) = read(material(*plain), **rows).datasets
    assert told.contact == same.contact
    np.testing.assert_array_equal(told.uncertainty, [0.01, 0.01])
    np.testing.assert_allclose(told.velocity_uncertainty, [0.05, 0.1], rtol=1e-15)
    drops = {"m": "drop_height,rebound_height\n0.5,0.32\n"}
    toml = material('height_uncertainty = "2 mm"', 'gravity = "1.62 m/s²"', properties="")
    (data,) = read(toml, **drops).datasets
    assert data.velocity[0] == pytest.approx(1.272792206, rel=1e-9)  # √1.62
    # ε/2 √((2 mm/320 mm)² + (2 mm/500 mm)²)
    np.testing.assert_allclose(data.uncertainty, [0.4 * math.hypot(0.00625, 0.004)], rtol=1e-12)


@pytest.mark.parametrize(
    ("radii", "diameters"),
    [
        (("radius = 0.0127",), ("diameter = 0.0254",)),
        (("radius = 0.0127",), ('diameter = "1 in"',)),
        (("radius_1 = 0.01", "radius_2 = 0.03"), ("diameter_1 = 0.02", 'diameter_2 = "60 mm"')),
        (
            ("radius = 0.01", "[material.wall]", GLASS),
            ('diameter = "2 cm"', "[material.wall]", GLASS),
        ),
    ],
)
def test_diameters_in_place_of_radii(read, radii, diameters):
    one, other = (read(material(*lines)).datasets[0].contact for lines in (radii, diameters))
    assert {k: float(v) for k, v in one.leaves().items()} == pytest.approx(
        other.leaves(), rel=1e-14
    )


def test_named_materials_are_those_of_the_paper(read):
    toml = 'material = "Chrome-Steel"\nradius = 0.01\n[material.wall]\nmaterial = "nylon"\n'
    (data,) = read(f'[[material]]\ndata = "m.csv"\n{toml}').datasets
    assert data.contact == sj.Contact.with_wall(sj.CHROME_STEEL, sj.NYLON, 0.01)
    assert data.remarks == (
        "properties of Chrome-Steel from Table 1 of Zhou (2013)",
        "properties of nylon from Table 1 of Zhou (2013)",
    )
    plain = read(material("radius = 0.01", "[material.second]", 'material = "stainless steel"'))
    assert plain.datasets[0].contact == read(material("radius = 0.01")).datasets[0].contact


def test_what_a_file_of_a_fit_keeps_of_the_bodies(read):
    (data,) = read(material("radius = 0.01", "[material.wall]", GLASS)).datasets
    again = data_from_dict("m", json.loads(json.dumps(plain(data_to_dict(data)))))
    assert again.bodies == data.bodies
    assert [body.radius for body in again.bodies] == [0.01, None]
    older = {key: one for key, one in data_to_dict(data).items() if key != "bodies"}
    assert data_from_dict("m", older).bodies == ()


def test_two_radii_and_another_area(read):
    toml = material("radius_1 = 0.01", "radius_2 = 0.03", 'area = "hertz"')
    contact = read(toml).datasets[0].contact
    assert contact.radius == pytest.approx(0.0075, rel=1e-14)
    assert contact.mass == pytest.approx(mass(8030, 0.01) * 27 / 28, rel=1e-14)
    assert contact.area == "hertz"


def test_the_area_of_the_fit_serves_materials_without_their_own(read):
    toml = '[fit]\narea = "hertz"\n' + material("radius = 0.01", 'name = "a"')
    toml += material("radius = 0.01", 'area = "zhou"', 'name = "b"')
    assert [data.contact.area for data in read(toml).datasets] == ["hertz", "zhou"]


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
    (data,) = read(material("radius = 0.01", "[material.wall]", GLASS)).datasets
    modulus = 1 / (1 / PLANE_STRAIN_STEEL + 1 / PLANE_STRAIN_GLASS)
    assert data.contact.youngs_modulus == pytest.approx(modulus, rel=1e-14)
    assert data.contact.radius == 0.01
    assert data.contact.mass == pytest.approx(mass(8030, 0.01), rel=1e-14)
    assert [(body.name, body.radius) for body in data.bodies] == [("sphere", 0.01), ("wall", None)]


def test_without_elastic_properties(read):
    limited, constant = read(
        material('name = "a"', "limit_velocity = 50.0", properties="")
        + material('name = "b"', properties="")
    ).datasets
    assert (limited.contact, limited.limit_velocity) == (None, 50.0)
    assert (constant.contact, constant.limit_velocity) == (None, None)


def test_repeats_are_averaged_on_request(read):
    repeats = "velocity,restitution\n2.0,0.8\n1.0,0.90\n1.0,0.94\n2.0,0.82\n"

    def averaged(value):
        return read(material(f"average_repeats = {value}", properties=""), m=repeats).datasets[0]

    assert len(averaged("false")) == 4
    for value in ("true", '"pooled"'):
        pooled = averaged(value)
        np.testing.assert_allclose(pooled.restitution, [0.92, 0.81], rtol=1e-14)
        # s² = (2 · 0.02² + 2 · 0.01²)/2, over √2
        np.testing.assert_allclose(pooled.uncertainty, [math.sqrt(0.00025)] * 2, rtol=1e-12)
        assert (pooled.degrees, pooled.origin.lines) == (2, (3, 2))
    own = averaged('"separate"')
    np.testing.assert_allclose(own.uncertainty, [0.02, 0.01], rtol=1e-12)  # half the difference
    np.testing.assert_array_equal(own.degrees, [1, 1])


def test_names_and_places_of_data_files(tmp_path):
    (tmp_path / "runs").mkdir()
    (tmp_path / "runs" / "a.csv").write_text(ROWS)
    (tmp_path / "m.toml").write_text('[[material]]\ndata = "runs/a.csv"\n')
    (data,) = read_toml(tmp_path / "m.toml")
    assert data.name == "a"
    assert data.origin.file == str(tmp_path / "runs" / "a.csv")


def test_a_byte_order_mark_and_windows_lines(tmp_path):
    (tmp_path / "m.csv").write_text(ROWS)
    toml = material('name = "a"', properties="", data="m.csv").replace("\n", "\r\n")
    for raw in (b"\xef\xbb\xbf" + toml.encode(), ("\ufeff" + toml).encode("utf-16-le")):
        (tmp_path / "m.toml").write_bytes(raw)
        assert read_toml(tmp_path / "m.toml")[0].name == "a"


def test_materials_without_measurements_and_what_is_said_of_the_fit(read):
    toml = '[[material]]\nname = "a"\nradius = 0.01\n' + STEEL + material("radius = 0.02")
    toml += (
        "[material.parameters]\npsi = { anything = [1] }\n[fit]\nlaw = 'x'\n[parameters]\nc = 1\n"
    )
    file = read(toml, needs_data=False)
    assert [entry.name for entry in file.materials] == ["a", "m"]
    assert [entry.data is None for entry in file.materials] == [True, False]
    assert file.materials[0].contact.radius == pytest.approx(0.005)
    assert file.materials[0].parameters is None
    # handed over as they stand, with their lines
    assert file.materials[1].parameters.values == {"psi": {"anything": [1]}}
    fit, parameters = map(file.file.table, ("fit", "parameters"))
    assert (fit.values, parameters.values) == ({"law": "x"}, {"c": 1})
    assert fit.line("law") == toml[: toml.index("law")].count("\n") + 1
    with pytest.raises(InputError, match=r"m\.toml:1: data is missing"):
        read_toml(file.file.file)
