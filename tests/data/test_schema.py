"""The published JSON Schemas accept what is read, and refuse what is refused for a key or its kind."""

import json
import tomllib

import jsonschema
import pytest

import calibration as cal
from tests.command import run
from tests.refusals.table import CASES, CSV, TOML, WALL, changed, genuine, refusal, written

KINDS = [  # refusals that a single entry deserves, whatever stands beside it
    *("unknown key", "unknown key of a wall", "unknown table", "zero density"),
    *("truth for a number", "Poisson's ratio", "Poisson's ratio of -1", "unknown area"),
    *("a name that is a number", "repeats", "fit as a value"),
]
RESULTS = [
    *("fits: []", "data velocity: {}", "data restitution 2: -0.5"),
    *("rms: 1.0", "rms: True", "confidence: 5", "n: 2.5", "another format"),
]


@pytest.fixture(scope="module")
def schemas(tmp_path_factory):
    """Validators of both schemas, as the command writes them."""
    out = tmp_path_factory.mktemp("schemas")
    assert run("doctor", "--schema", out)[0] == 0
    tables = {path.name: json.loads(path.read_text("utf-8")) for path in out.iterdir()}
    assert set(tables) == {"material_file.schema.json", "fit.schema.json"}
    for table in tables.values():
        jsonschema.Draft202012Validator.check_schema(table)
    return {name: jsonschema.Draft202012Validator(table) for name, table in tables.items()}


SAID = "[fit]\nlaw = 'zhou'\nconfidence = 0.9\n[parameters]\nsigma = { bounds = [0, 1] }\nxi = 1\n"


@pytest.mark.parametrize("text", [TOML, TOML + WALL, SAID + TOML.replace("0.0127", '"12.7 mm"')])
def test_material_files_that_are_read_are_valid(text, schemas, tmp_path):
    assert schemas["material_file.schema.json"].is_valid(tomllib.loads(text))
    assert len(cal.read_problem(written(tmp_path, text, CSV)).datasets) == 1


@pytest.mark.parametrize("name", KINDS)
def test_material_files_that_are_not_valid_are_refused(name, schemas, tmp_path):
    text = CASES["TOML files", name][2]
    assert not schemas["material_file.schema.json"].is_valid(tomllib.loads(text))
    assert refusal("TOML files", name, tmp_path) is not None


def test_a_result_is_valid(schemas):
    schemas["fit.schema.json"].validate(genuine())


@pytest.mark.parametrize("name", RESULTS)
def test_results_that_are_not_valid_are_refused(name, schemas, tmp_path):
    _, _, place, value = CASES["results", name]
    way = [int(part) if part.isdigit() else part for part in place.split(".")]
    assert not schemas["fit.schema.json"].is_valid(changed(genuine(), way, value))
    assert refusal("results", name, tmp_path) is not None
