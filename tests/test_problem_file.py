"""What a material file says of the fit: its parameters and its settings, with their lines."""

import math
import tomllib
from pathlib import Path

import pytest
from calibration.parameters_spec import ParameterSpec

from calibration.problem_file import read_problem
from tests.refused import TOML, Case, check_refused


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
    problem = read(TOML + PARAMETERS)
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
    toml = "[parameters]\nc1 = 0.03\nc2 = { value = 0.005 }\n" + TOML
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
    problem = read(fit + TOML)
    assert problem.settings == tomllib.loads(fit)["fit"]
    assert read(TOML).settings == {}
    error = problem.refusal("starts", "32 starts", "fewer")
    assert str(error) == f"{problem.source.file.file}:9: 32 starts; fewer"


def test_parameters_belong_to_the_materials_that_have_data(read):
    bare = TOML.replace('data = "m.csv"\n', "[material.parameters]\npsi = 0.5\n")
    other = TOML.replace("my alloy", "other") + "[material.parameters]\npsi = 0.7\n"
    problem = read(bare + other, needs_data=False)
    assert [specs["psi"].value for specs in problem.specs] == [0.5, 0.7]
    assert [specs["psi"].value for specs in problem.parameters] == [0.7]
    assert [entry.name for entry in problem.materials] == ["my alloy", "other"]
    assert len(problem.datasets) == 1


PARAMETERS_OF = TOML + "[material.parameters]\n"
BARE = '[[material]]\nname = "bare"\ndata = "m.csv"\n'
REFUSED = {
    "unknown parameter": Case(
        "m.toml:10: unknown key 'xi'",
        "known here are chi, sigma, psi",
        PARAMETERS_OF + "xi = 1.0\n",
    ),
    "unknown field of a parameter": Case(
        "m.toml:10: unknown key 'start'", "free, value", PARAMETERS_OF + "chi = { start = 1.0 }\n"
    ),
    "value out of range": Case(
        "m.toml:10: psi is 0", "it must be a positive number", PARAMETERS_OF + "psi = 0\n"
    ),
    "value out of its bounds": Case(
        "m.toml:11: value of chi is 3",
        "within its bounds, [1, 2]",
        PARAMETERS_OF + "[material.parameters.chi]\nvalue = 3.0\nbounds = [1.0, 2.0]\n",
    ),
    "bounds the wrong way round": Case(
        "m.toml:10: bounds of sigma is [2.0, 1.0]",
        "lowest below highest",
        PARAMETERS_OF + "sigma = { bounds = [2.0, 1.0] }\n",
    ),
    "bounds out of range": Case(
        "m.toml:10: bounds of sigma is [-1.0, 1.0]",
        "within [0, inf]",
        PARAMETERS_OF + "sigma = { bounds = [-1.0, 1.0] }\n",
    ),
    "prior without a width": Case(
        "m.toml:10: prior of sigma is [2.0, 0.0]",
        "positive standard deviation",
        PARAMETERS_OF + "sigma = { prior = [2.0, 0.0] }\n",
    ),
    "prior of one number": Case(
        "m.toml:10: prior of sigma is 2",
        "two numbers, [mean, standard deviation]",
        PARAMETERS_OF + "sigma = { prior = 2.0 }\n",
    ),
    "unknown transform": Case(
        "m.toml:10: transform of sigma is sqrt",
        "one of log, logit, none",
        PARAMETERS_OF + 'sigma = { transform = "sqrt" }\n',
    ),
    "logit without bounds": Case(
        "m.toml:10: transform of sigma is logit",
        "both bounds given",
        PARAMETERS_OF + 'sigma = { transform = "logit" }\n',
    ),
    "bounds of what is fixed": Case(
        "m.toml:10: bounds of psi is given",
        "left out where free is false",
        PARAMETERS_OF + "psi = { free = false, value = 0.5, bounds = [0.1, 1.0] }\n",
    ),
    "fixed without a value": Case(
        "m.toml:10: value of psi is missing",
        "given where",
        PARAMETERS_OF + "psi = { free = false }\n",
    ),
    "free as a word": Case(
        "m.toml:10: free of psi is no", "true or false", PARAMETERS_OF + 'psi = { free = "no" }\n'
    ),
    "text for a parameter": Case(
        'm.toml:10: psi is "half"', "a number, or a table", PARAMETERS_OF + 'psi = "half"\n'
    ),
    "chi without elastic properties": Case(
        "m.toml:5: chi without elastic properties",
        "give youngs_modulus",
        BARE + "[material.parameters]\nchi = 1.0\n",
    ),
    "chi beside its line": Case(
        "m.toml:10: chi beside c1 and c2",
        "only one is possible",
        PARAMETERS_OF + "chi = 1.0\n[parameters]\nc1 = { value = 0.0 }\n",
    ),
    "unknown objective": Case(
        'm.toml:10: objective is "twostep"',
        "did you mean 'two-step'?",
        TOML + '[fit]\nobjective = "twostep"\n',
    ),
    "unknown setting": Case(
        "m.toml:11: unknown key 'seeds'",
        "did you mean 'seed'?",
        TOML + "[fit]\nstarts = 8\nseeds = 1\n",
    ),
    "half a seed": Case(
        "m.toml:10: seed is 1.5", "a whole number of 0 or more", TOML + "[fit]\nseed = 1.5\n"
    ),
    "no starts": Case("m.toml:10: starts is 0", "of 1 or more", TOML + "[fit]\nstarts = 0\n"),
    "tolerance of the energy balance": Case(
        "m.toml:11: rtol beside the energy balance",
        'route = "ode" only',
        TOML + '[fit]\nroute = "energy balance"\nrtol = 1e-6\n',
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_malformed_parameters_and_settings_are_told_in_one_line(name, tmp_path):
    check_refused(REFUSED[name], tmp_path, read_problem)
