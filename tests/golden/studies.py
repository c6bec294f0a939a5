"""Scenarios: laws compared, what measurements can tell before they are made, and `softjax fit` with its tables."""

import json
import re

import numpy as np

import calibration as cal
import softjax as sj
from tests.command import run
from tests.golden import simulated
from tests.golden.cases import contact, plain_fit, rebounds
from tests.golden.numbers import scenario
from tests.shown.tables import Tags

LAW = (1.2, 0.9, 0.5)
SHOTS = [0.02, 0.06, 0.1, 0.3, 1.0, 5.0]


@scenario
def comparison(numbers, folder):
    laws = ["zhou", "thornton", "viscoelastic", "constant"]
    found = cal.compare(rebounds(), laws)
    numbers.text("error", "ranking", ", ".join(found.ranking))
    for label in found.ranking:
        result = found[label]
        left = result.leave_one_out()
        numbers.estimate(f"{label}: rms", result.rms, 0.1 * result.rms)
        numbers.estimate(f"{label}: ln L, AIC", [result.log_likelihood, result.aic], 0.1)
        numbers.error(f"{label}: elpd", [left.elpd, left.elpd_se], 0.1 * left.elpd_se)


@scenario
def information(numbers, folder):
    """Of a law, of a law with a prior, and of further shots of a fit."""
    law = sj.Zhou(contact(), *LAW)
    found = cal.fisher_information(law, SHOTS, uncertainty=0.003)
    numbers.error("law: matrix", found.matrix, 1e-4 * np.abs(found.matrix))
    modulus = float(contact().youngs_modulus)
    prior = cal.Parameter(prior=(modulus, 0.03 * modulus))
    parameters = {"psi": 0.5, "contact.youngs_modulus": prior}
    plans = {
        "law": found,
        "prior": cal.fisher_information(law, SHOTS, uncertainty=0.003, parameters=parameters),
        "fit": cal.fisher_information(plain_fit(), [0.05, 3.0]),
    }
    for name, plan in plans.items():
        for parameter, error in plan.standard_errors.items():
            numbers.error(f"{name}: {parameter}", error, error)


@scenario
def designs(numbers, folder):
    law = sj.Zhou(contact(), *LAW)
    for criterion in ("c", "D"):
        found = cal.optimal_velocities(law, 8, (0.01, 8.0), criterion=criterion, uncertainty=0.003)
        # the criterion is flat where it is least
        numbers.error(f"{criterion}: velocity", found.velocity, 3 * found.velocity)
        for name, error in found.relative_errors.items():
            numbers.error(f"{criterion}: {name}", error, error)
        numbers.error(f"{criterion}: gain", found.gain, 1.0)


@scenario(long=True)
def sensitivities(numbers, folder):
    """θ ∂ε/∂θ of the inputs of two spheres and of a law's own fields."""
    metal = sj.Material(71e9, 0.33, 2700.0, 280e6)
    spheres = cal.of_spheres(metal, 0.0125, chi=1.2, sigma=0.9, psi=0.5)
    for name, inputs in (("spheres", spheres), ("law", sj.ViscoelasticHertz(contact(), 2e-6))):
        found = cal.sensitivity(inputs, [0.02, 0.3, 4.0])
        for column in found.names:
            numbers.physics(f"{name}: {column}", found.of(column), least=1e-12)


DROPS = """
[[material]]
name = "aluminium bronze"
youngs_modulus = "115 GPa"
poisson_ratio = 0.33
density = "7600 kg/m3"
yield_strength = "300 MPa"
diameter = "12 mm"
height_uncertainty = "2 mm"
air = false  # as the rebounds were simulated
data = "drops.csv"

[material.wall]
youngs_modulus = "210 GPa"
poisson_ratio = 0.3
density = 7850
yield_strength = "355 MPa"
"""
ROUNDING = re.compile(r"0|-?\de-\d+|\S+e-1[5-9]")  # differences of two fits, or of no noise


def record_command(numbers, words, out, name=""):
    """What `softjax fit` writes: numbers of fit.json, and those of the tables of report.html row by row."""
    code, _, error = run("fit", *words, "--out", out, "--no-cache")
    assert code == 0, error
    record_json(numbers, out / "fit.json", name)
    tables = Tags((out / "report.html").read_text(encoding="utf-8")).tables
    rows = [row for header, *rows in tables if "seconds" not in header for row in rows]
    record_table(numbers, rows, f"{name}report: ")


def record_table(numbers, rows, name):
    """Each row by its label, the first of its cells that is not empty."""
    seen: dict[str, int] = {}
    for label, *cells in ([cell for cell in row if cell] for row in rows):
        seen[label] = seen.get(label, 0) + 1
        again = f" ({seen[label]})" if seen[label] > 1 else ""
        found = [c for c in cells if not ROUNDING.fullmatch(c)]
        numbers.printed(f"{name}{label}{again}", found)


def record_json(numbers, path, name=""):
    """Parameters, standard errors and intervals of fit.json."""
    table = json.loads(path.read_text(encoding="utf-8"))
    for fit in table["fits"]:
        numbers.estimate(f"{name}{fit['material']}: rms", fit["rms"], 0.01 * fit["rms"])
        for key, found in fit["parameters"].items():
            value, error = found["value"], found["standard_error"]
            scale = max(error or 0.0, 1e-3 * abs(value))
            numbers.estimate(f"{name}{fit['material']}: {key}", value, scale)
            if error and error > 1e-9 * abs(value):
                ends = [error, found["low"], found["high"]]
                numbers.error(f"{name}{fit['material']}: {key} error, interval", ends, error)
    for key in ("c1", "c2"):
        if table["unloading_line"] is not None:
            value = table["unloading_line"][key]["value"]
            numbers.estimate(f"{name}line: {key}", value, 1e-3 * abs(value))


@scenario
def drops(numbers, folder):
    """Drop tests: a 12 mm bronze ball on steel, heights to 2 mm, with scatter; and of a skewed likelihood."""
    (folder / "drops.toml").write_text(DROPS, encoding="utf-8")
    far = {"truth": (6.0, 3.0, 0.5), "scatter": 0.0, "seed": 0}
    cases = (("", {}, ()), ("extra: ", {}, ("--extra-scatter",)), ("skewed: ", far, ()))
    for name, made, options in cases:
        (folder / "drops.csv").write_text(simulated.drops(**made), encoding="utf-8")
        record_command(numbers, [folder / "drops.toml", *options], folder / "out", name)


@scenario
def main_job(numbers, folder):
    """`softjax fit` alone: the three materials of the paper."""
    record_command(numbers, [], folder)
