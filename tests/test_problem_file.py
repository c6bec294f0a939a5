"""What a material file says of the fit: its parameters and its settings, with their lines."""

import math
import tomllib
from pathlib import Path

import pytest

from calibration.parameters_spec import ParameterSpec
from calibration.problem_file import read_problem

ALLOY = """\
[[material]]
name = "my alloy"
youngs_modulus = 1.93e11
poisson_ratio = 0.35
density = 8030
yield_strength = 3.10e8
radius = 0.01
data = "m.csv"
"""


@pytest.fixture
def read(tmp_path):
    """Write a material file and its data file; read the problem."""

    def write_and_read(toml, needs_data=True):
        (tmp_path / "m.csv").write_text("velocity,restitution\n0.12,0.95\n3.0,0.7\n")
        (tmp_path / "m.toml").write_text(toml, encoding="utf-8")
        return read_problem(tmp_path / "m.toml", needs_data)

    return write_and_read


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
    problem = read(ALLOY + PARAMETERS)
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
    written = Path(problem.source.file.file).read_text(encoding="utf-8").split("\n")
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
    toml = "[parameters]\nc1 = 0.03\nc2 = { value = 0.005 }\n" + ALLOY
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
    problem = read(fit + ALLOY)
    assert problem.settings == tomllib.loads(fit)["fit"]
    assert read(ALLOY).settings == {}
    error = problem.refusal("starts", "32 starts", "fewer")
    assert str(error) == f"{problem.source.file.file}:9: 32 starts; fewer"


def test_parameters_belong_to_the_materials_that_have_data(read):
    bare = ALLOY.replace('data = "m.csv"\n', "[material.parameters]\npsi = 0.5\n")
    other = ALLOY.replace("my alloy", "other") + "[material.parameters]\npsi = 0.7\n"
    problem = read(bare + other, needs_data=False)
    assert [specs["psi"].value for specs in problem.specs] == [0.5, 0.7]
    assert [specs["psi"].value for specs in problem.parameters] == [0.7]
    assert [entry.name for entry in problem.materials] == ["my alloy", "other"]
    assert len(problem.datasets) == 1
