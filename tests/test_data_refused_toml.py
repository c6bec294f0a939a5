"""Malformed material files as far as data and bodies go (see `refused`)."""

import pytest

from calibration.data import read_toml
from calibration.errors import InputError
from tests.refused import TOML, Case, check_refused, written


def _toml(line: int, text: str) -> str:
    """The good TOML file with one line replaced."""
    lines = TOML.splitlines()
    lines[line - 1] = text
    return "\n".join(lines) + "\n"


CASES = {
    "no TOML": Case("m.toml:5: no valid TOML", "key = value", _toml(5, "density == 8030")),
    "text without quotation marks": Case(
        "m.toml:2: no valid TOML", "text in quotation marks", _toml(2, "name = my alloy")
    ),
    "key twice": Case("m.toml:7: no valid TOML", "key = value", _toml(7, "density = 1.0")),
    "not UTF-8": Case("m.toml:2: is not UTF-8", "UTF-8", _toml(2, 'name = "Ø"').encode("latin-1")),
    "empty file": Case("m.toml:1: no material", "[[material]]", ""),
    "one table for an array": Case(
        "m.toml:1: material is not an array",
        "[[material]]",
        TOML.replace("[[", "[", 1).replace("]]", "]", 1),
    ),
    "unknown key": Case(
        "m.toml:3: unknown key 'young_modulus'",
        "did you mean 'youngs_modulus'?",
        _toml(3, "young_modulus = 1.93e11"),
    ),
    "unknown table": Case(
        "m.toml:9: unknown key 'fits'", "did you mean 'fit'?", TOML + '[fits]\nloss = "huber"\n'
    ),
    "missing property": Case("m.toml:1: density is missing", "yield_strength", _toml(5, "")),
    "negative modulus": Case(
        "m.toml:3: youngs_modulus is -1", "a positive number [Pa]", _toml(3, "youngs_modulus = -1")
    ),
    "text for a number": Case(
        'm.toml:5: density is "8030"', "a positive number [kg/m³]", _toml(5, 'density = "8030"')
    ),
    "truth for a number": Case("m.toml:5: density is true", "[kg/m³]", _toml(5, "density = true")),
    "NaN property": Case("m.toml:6: yield_strength is nan", "[Pa]", _toml(6, "yield_strength=nan")),
    "yield strength in MPa": Case(
        "m.toml:6: yield_strength makes the limit velocity √(3 Y/ρ) 0.3403 m/s",
        "is it in Pa, or text with its unit",
        _toml(6, "yield_strength = 310"),
    ),
    "one velocity beyond": Case(
        "m.csv:4: velocity is 2",
        "below the limit velocity, 1.1204 m/s, √(3 Y/ρ) of the bodies",
        _toml(6, "yield_strength = 3360"),
    ),
    "a wall's yield strength in MPa": Case(
        "m.toml:13: yield_strength makes the limit velocity √(3 Y/ρ) 0.3403 m/s",
        "or text with its unit",
        TOML + "[material.wall]\n" + "\n".join(_toml(6, "yield_strength = 310").splitlines()[2:6]),
    ),
    "Poisson's ratio": Case(
        "m.toml:4: poisson_ratio is 0.51", "in (-1, 0.5]", _toml(4, "poisson_ratio = 0.51")
    ),
    "no radius": Case("m.toml:1: radii given are none", "radius, or radius_1", _toml(7, "")),
    "three radii": Case(
        "m.toml:7: radii given are radius, radius_1",
        "radius_1 and radius_2",
        _toml(7, "radius = 0.01; radius_1 = 0.02".replace("; ", "\n")),
    ),
    "unknown area": Case(
        'm.toml:9: area is "herz"',
        '"zhou" or "hertz" (did you mean \'hertz\'?)',
        TOML + 'area = "herz"\n',
    ),
    "wall and second body": Case(
        "m.toml:14: both a wall and a second body",
        "only one is possible",
        TOML
        + "[material.wall]\n"
        + "\n".join(TOML.splitlines()[2:6])
        + "\n[material.second]\ndensity = 1.0\n",
    ),
    "wall without a property": Case(
        "m.toml:10: youngs_modulus is missing",
        "a body has",
        TOML + "\n[material.wall]\ndensity = 1.0\n",
    ),
    "no data": Case("m.toml:1: data is missing", "name of a CSV file", _toml(8, "")),
    "missing data file": Case(
        "m.toml:8: data file", "name of a CSV file", _toml(8, 'data = "n.csv"')
    ),
    "number for a file": Case("m.toml:8: data is 3", "a text", _toml(8, "data = 3")),
    "two of one name": Case(
        "m.toml:10: a second material is named 'my alloy'", "a name of its own", TOML + TOML
    ),
    "uncertainty twice": Case(
        "m.csv:1: uncertainty is both a column and a number",
        "given once",
        TOML + "uncertainty = 0.01\n",
    ),
    "negative uncertainty": Case(
        "m.toml:9: uncertainty is -0.01", "a positive number", TOML + "uncertainty = -0.01\n"
    ),
    "gravity without a use": Case(
        "m.csv:1: gravity is given", "left out where velocities", TOML + "gravity = 9.81\n"
    ),
    "repeats": Case(
        'm.toml:9: average_repeats is "yes"',
        'true or false or "pooled"',
        TOML + 'average_repeats = "yes"\n',
    ),
    "fit as a value": Case("m.toml:1: fit is 3", "a table: [fit]", "fit = 3\n" + TOML),
    "a number of 5000 digits": Case(
        "m.toml:8: no valid TOML", "key = value", _toml(5, "density = " + "9" * 5000)
    ),
    "a whole number beyond floats": Case(
        "m.toml:5: density is a whole number of more",
        "a positive number",
        _toml(5, "density = " + "9" * 400),
    ),
    "no contact of these sizes": Case(
        "m.toml:1: no contact of these bodies", "other sizes", _toml(7, "radius = 1e-200")
    ),
    "unknown unit of a property": Case(
        'm.toml:3: youngs_modulus is "193 gpa"',
        "a positive number [Pa], in Pa, kPa, MPa, GPa, TPa, psi (did you mean",
        _toml(3, 'youngs_modulus = "193 gpa"'),
    ),
    "another dimension": Case(
        'm.toml:7: radius is "12.7 ms"', "in m, cm, mm", _toml(7, 'radius = "12.7 ms"')
    ),
    "decimal comma in a quantity": Case(
        'm.toml:7: radius is "12,7 mm"', "a positive number [m]", _toml(7, 'radius = "12,7 mm"')
    ),
    "percent of nothing": Case(
        'm.toml:7: radius is "5 %"', "a positive number [m]", _toml(7, 'radius = "5 %"')
    ),
    "a quantity beyond floats": Case(
        'm.toml:7: radius is "1e999 mm"', "a positive number [m]", _toml(7, 'radius = "1e999 mm"')
    ),
    "radius and diameter": Case(
        "m.toml:7: radii given are radius, diameter",
        "or the diameters in their place",
        _toml(7, "radius = 0.01\ndiameter = 0.02"),
    ),
    "one radius, one diameter": Case(
        "m.toml:7: radii given are radius_1, diameter_2",
        "needed is radius, or radius_1 and radius_2",
        _toml(7, "radius_1 = 0.01\ndiameter_2 = 0.02"),
    ),
    "a wall and two radii": Case(
        "m.toml:1: a wall without radius alone",
        "radius or diameter, of the sphere",
        _toml(7, "radius_1 = 0.01\nradius_2 = 0.02") + '[material.wall]\nmaterial = "nylon"\n',
    ),
    "a material without a source": Case(
        'm.toml:2: material is "AISI 304"',
        '"stainless steel", "chrome steel", "nylon" (Table 1 of Zhou (2013)); of any other give',
        '[[material]]\nmaterial = "AISI 304"\nradius = 0.01\ndata = "m.csv"\n',
    ),
    "a known material and a property": Case(
        "m.toml:3: density beside material",
        "either a known material, or its properties",
        '[[material]]\nmaterial = "nylon"\ndensity = 8000\nradius = 0.01\ndata = "m.csv"\n',
    ),
    "an uncertainty of what was not measured": Case(
        "m.csv:1: interval_uncertainty is given",
        "left out beside velocity and restitution",
        TOML + 'interval_uncertainty = "1 ms"\n',
    ),
    "repeats of a train": Case(
        "m.toml:9: average of repeats is asked for",
        "left out for bounce trains",
        TOML + "average_repeats = true\n",
        "interval\n0.5\n0.45\n0.4\n",
    ),
    "a data file beyond names": Case(
        "m.toml:8: data file 'aaa", "name of a CSV file", _toml(8, f'data = "{"a" * 5000}"')
    ),
    "a data file that is none": Case("m.toml:8: data file", "CSV", _toml(8, 'data = "a\\u0000b"')),
    "a directory for a data file": Case(
        ": is a directory", "a file of text", _toml(8, 'data = "."')
    ),
    "escape sequences": Case(
        "m.toml:3: unknown key '\\x1b[31m\\nred\\u202e'",
        "known here are",
        _toml(3, '"\\u001b[31m\\nred\\u202E" = 1'),
    ),
    "a key without end": Case(
        "m.toml:3: unknown key 'kkkkkkkk", "known here are", _toml(3, "k" * 20000 + " = 1")
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_malformed_material_files_are_told_in_one_line(name, tmp_path):
    check_refused(CASES[name], tmp_path, read_toml)


def test_the_files_that_the_cases_spoil_are_good(tmp_path):
    (data,) = read_toml(written(Case("", ""), tmp_path))
    assert len(data) == 3


def test_a_missing_material_file_is_told_without_a_line(tmp_path):
    with pytest.raises(InputError) as caught:
        read_toml(tmp_path / "n.toml")
    assert str(caught.value).startswith(f"{tmp_path}/n.toml: no such file; ")
    assert caught.value.line is None
    with pytest.raises(InputError, match="is a directory; a file of text is needed"):
        read_toml(tmp_path)
