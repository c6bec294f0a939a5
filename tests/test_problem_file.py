"""What a material file says of the fit: its parameters and its settings, with their lines."""

import math
import tomllib
from pathlib import Path

import pytest

from calibration.fitting.specs import specs_of
from calibration.parameters import Parameter, as_parameter
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
    (said,) = problem.parameters
    assert said == {
        "psi": Parameter(0.5, free=False),
        "chi": Parameter(0.1, bounds=(0.01, math.inf), transform="log"),
        "yield_strength": Parameter(prior=(3.1e8, 1e7), shared="steel"),
        "limit_velocity": Parameter(free=False),
        "sigma": Parameter(3.0, shared=True),
    }
    assert said["sigma"].free
    lines = {name: one.origin.line for name, one in said.items()}
    written = Path(problem.file.file).read_text(encoding="utf-8").split("\n")
    assert written[lines["chi"] - 1].startswith("chi =")
    assert written[lines["sigma"] - 1] == "[material.parameters.sigma]"


def test_minus_zero_is_zero(read):
    (said,) = read(TOML + "[material.parameters]\nsigma = -0.0\n").parameters
    for parameter in (said["sigma"], Parameter(-0.0), as_parameter("sigma", -0.0)):
        assert math.copysign(1, parameter.value) == 1


def test_what_is_said_of_all_materials_gives_way_to_what_is_said_of_one(read):
    toml = "[parameters]\nsigma = 2.0\npsi = { value = 0.4 }\n" + TOML
    (said,) = read(toml + "[material.parameters]\nsigma = 3.0\n").parameters
    assert said == {"sigma": Parameter(3.0, free=False), "psi": Parameter(0.4)}


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
    loss_scale = 2.0
    max_steps = 50
    law = "zhou"
    unloading_line = "weighted"
    profiles = false
    extra_scatter = true
    scale_uncertainty = false
    area = "hertz"
    """
    problem = read(fit + TOML)
    assert problem.settings == tomllib.loads(fit)["fit"]
    assert read(TOML).settings == {}
    assert problem.line("starts") == 9


def test_parameters_belong_to_the_materials_that_have_data(read):
    bare = TOML.replace('data = "m.csv"\n', "[material.parameters]\npsi = 0.5\n")
    other = TOML.replace("my alloy", "other") + "[material.parameters]\npsi = 0.7\n"
    problem = read(bare + other, needs_data=False)
    assert [said["psi"].value for said in problem.said] == [0.5, 0.7]
    assert [said["psi"].value for said in problem.parameters] == [0.7]
    assert [entry.name for entry in problem.materials] == ["my alloy", "other"]
    assert len(problem.datasets) == 1


PARAMETERS_OF = TOML + "[material.parameters]\n"
BARE = '[[material]]\nname = "bare"\ndata = "m.csv"\n'
REFUSED = {
    "unknown field of a parameter": Case(
        "m.toml:10: unknown key 'start'", "free, value", PARAMETERS_OF + "chi = { start = 1.0 }\n"
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
    "bounds of what is fixed": Case(
        "m.toml:10: bounds of psi is given",
        "left out where free is false",
        PARAMETERS_OF + "psi = { free = false, value = 0.5, bounds = [0.1, 1.0] }\n",
    ),
    "free as a word": Case(
        "m.toml:10: free of psi is no", "true or false", PARAMETERS_OF + 'psi = { free = "no" }\n'
    ),
    "text for a parameter": Case(
        'm.toml:10: psi is "half"', "a number, or a table", PARAMETERS_OF + 'psi = "half"\n'
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
    "a robust loss's scale without one": Case(
        "m.toml:10: loss_scale would do nothing",
        'loss = "huber" or "soft-l1"',
        TOML + "[fit]\nloss_scale = 2.0\n",
    ),
    "tolerance of the energy balance": Case(
        "m.toml:11: rtol would do nothing",
        'route = "ode" only',
        TOML + '[fit]\nroute = "energy balance"\nrtol = 1e-6\n',
    ),
    "an objective that is a law": Case(
        'm.toml:10: objective is "empirical", which is a law',
        'write law = "eq-17"',
        TOML + '[fit]\nobjective = "empirical"\n',
    ),
    "scatter as a number": Case(
        "m.toml:10: extra_scatter is 0.01",
        "true or false",
        TOML + "[fit]\nextra_scatter = 0.01\n",
    ),
    "no starts": Case("m.toml:10: starts is 0", "of 1 or more", TOML + "[fit]\nstarts = 0\n"),
}
OF_THE_LAW = {  # told by the law that is fitted, with the line that says it
    "unknown parameter": Case(
        "m.toml:10: parameter is xi", "chi, sigma, psi", PARAMETERS_OF + "xi = 1.0\n"
    ),
    "value out of range": Case(
        "m.toml:10: value of psi is 0", "a positive exponent", PARAMETERS_OF + "psi = 0\n"
    ),
    "bounds out of range": Case(
        "m.toml:10: bounds of sigma is [-1, 1]",
        "within [0, inf",
        PARAMETERS_OF + "sigma = { bounds = [-1.0, 1.0] }\n",
    ),
    "logit without bounds": Case(
        "m.toml:10: transform of sigma is logit",
        "both bounds given",
        PARAMETERS_OF + 'sigma = { transform = "logit" }\n',
    ),
    "fixed without a value": Case(
        "m.toml:10: value of psi is missing",
        "given where",
        PARAMETERS_OF + "psi = { free = false }\n",
    ),
    "chi without elastic properties": Case(
        "m.toml:5: parameter is chi",
        "of constant: restitution",
        BARE + "[material.parameters]\nchi = 1.0\n",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_malformed_parameters_and_settings_are_told_in_one_line(name, tmp_path):
    check_refused(REFUSED[name], tmp_path, read_problem)


def asked_of_the_fit(path):
    problem = read_problem(path)
    return specs_of(problem.datasets, None, problem.parameters, None)


@pytest.mark.parametrize("name", OF_THE_LAW)
def test_parameters_that_the_law_refuses_are_told_with_their_line(name, tmp_path):
    check_refused(OF_THE_LAW[name], tmp_path, asked_of_the_fit)
