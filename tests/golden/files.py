"""Scenarios: `softjax fit`, and the cells of its tables."""

import json
import re

from tests.command import run
from tests.golden import simulated
from tests.golden.numbers import scenario
from tests.shown.tables import markdown_tables

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
    """What `softjax fit` writes: numbers of fit.json, and those of the tables of report.md row by row."""
    code, _, error = run("fit", *words, "--out", out, "--no-cache")
    assert code == 0, error
    record_json(numbers, out / "fit.json", name)
    tables = markdown_tables((out / "report.md").read_text(encoding="utf-8"))
    rows = [row for header, *rows in tables if "seconds" not in header for row in rows]
    seen: dict[str, int] = {}
    for label, *cells in ([cell for cell in row if cell] for row in rows):
        seen[label] = seen.get(label, 0) + 1
        again = f" ({seen[label]})" if seen[label] > 1 else ""
        found = [c for c in cells if not ROUNDING.fullmatch(c)]
        numbers.printed(f"{name}report: {label}{again}", found)


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
