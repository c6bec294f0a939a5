"""Scenarios: the commands, the cells of their tables, and the numbers written for particle codes."""

import contextlib
import io
import json
import re

import numpy as np

import calibration as cal
import softjax as sj
from calibration import cli
from tests.golden import simulated
from tests.golden.cases import contact
from tests.golden.numbers import NUMBER, scenario
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
ROUNDING = re.compile(
    r"0|-?\de-\d+|\S+e-1[5-9]"
)  # a relative difference of two fits, or of no noise


def command(*words) -> str:
    """What a command line prints."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(io.StringIO()):
        code = cli.main([str(word) for word in words])
    assert code == 0, words
    return out.getvalue()


def record_report(numbers, path, name=""):
    """The numbers of the tables of report.md, row by row."""
    tables = markdown_tables(path.read_text(encoding="utf-8"))
    rows = [row for header, *rows in tables if "seconds" not in header for row in rows]
    record_table(numbers, rows, f"{name}report: ")


def record_printed(numbers, text, name=""):
    """The numbers of the tables that a command prints, but of those with times."""
    text = text.replace(" ± ", " +- ") if name == "compare " else text
    blocks = [block for block in text.split("\n\n") if "seconds" not in block]
    lines = [line.strip() for block in blocks for line in block.splitlines()]
    heads = [k - 1 for k, line in enumerate(lines) if line.startswith("──")]
    rows = [re.split(r"\s{2,}", line) for k, line in enumerate(lines) if k not in heads]
    record_table(numbers, [row for row in rows if len(row) > 1], f"{name}printed: ")


def record_table(numbers, rows, name):
    """Each row by its label, the first of its cells that is not empty."""
    seen: dict[str, int] = {}
    for row in rows:
        label, *cells = [cell for cell in row if cell]
        seen[label] = seen.get(label, 0) + 1
        again = f" ({seen[label]})" if seen[label] > 1 else ""
        numbers.printed(f"{name}{label}{again}", [c for c in cells if not ROUNDING.fullmatch(c)])


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


@scenario()
def drops(numbers, folder):
    """Drop tests: a 12 mm bronze ball on steel, heights to 2 mm, with scatter; and of a skewed likelihood."""
    (folder / "drops.toml").write_text(DROPS, encoding="utf-8")
    far = {"truth": (6.0, 3.0, 0.5), "scatter": 0.0, "seed": 0}
    cases = (("", {}, ()), ("extra: ", {}, ("--extra-scatter",)), ("skewed: ", far, ()))
    for name, made, options in cases:
        (folder / "drops.csv").write_text(simulated.drops(**made), encoding="utf-8")
        out = folder / (name or "plain")
        command("fit", folder / "drops.toml", "--out", out, "--no-cache", *options)
        record_json(numbers, out / "fit.json", name)
        record_report(numbers, out / "report.md", name)


@scenario()
def main_job(numbers, folder):
    """`softjax fit` alone: the three materials of the paper."""
    command("fit", "--out", folder, "--no-cache")
    record_json(numbers, folder / "fit.json")
    record_report(numbers, folder / "report.md")


@scenario()
def tables(numbers, folder):
    """What `compare`, `sensitivity` and `curve` print and write."""
    (folder / "drops.csv").write_text(simulated.drops(), encoding="utf-8")
    (folder / "drops.toml").write_text(DROPS, encoding="utf-8")
    out = ("--out", folder, "--no-cache")
    laws = ("--laws", "zhou,viscoelastic")
    record_printed(numbers, command("compare", folder / "drops.toml", *laws, *out), "compare ")
    local = command("sensitivity", "nylon", "--study", "local", "--at", "2", "20", *out)
    record_printed(numbers, local, "local ")
    span = ("--from", "0.2", "--to", "20", "--points", "12", "--format", "csv", "table")
    command("curve", "nylon", "--law", "thornton", "--set", "yield_factor=2.5", *span, *out)
    for name in ("curve.csv", "curve.txt"):
        record_rows(numbers, folder / name)


def record_rows(numbers, path):
    """The columns of a file of numbers; what is no number in a row is left aside."""
    lines = path.read_text(encoding="utf-8").splitlines()
    rows = [NUMBER.findall(line) for line in lines if line[:1].isdigit()]
    for k, column in enumerate(zip(*rows, strict=True)):
        numbers.physics(f"{path.name} column {k}", np.array(column, float))


@scenario()
def exports(numbers, folder):
    """A law at given parameters for each particle code."""
    pair, spring = contact(), 5e7
    laws = {
        "lammps": sj.HertzDashpot(pair, 0.8, end="zero-force"),
        "liggghts": sj.LinearSpringDashpot(pair, spring, 0.8, end="zero-force"),
        "yade": sj.WaltonBraun(pair, spring, spring, 3000.0),
        "c": sj.Zhou(pair, 1.2, 0.9, 0.5),
    }
    names = {"lammps": "hertz-dashpot", "liggghts": "linear", "yade": "walton-braun", "c": "zhou"}
    for to, law in laws.items():
        given = "exact" if to == "c" else names[to]
        options = {"velocity_range": (0.2, 2.0), "tolerance": 0.2, "law": given}
        made = cal.export(law, to, folder / to, **options)
        record_export(numbers, made, folder / to, f"{to}, {names[to]}: ")


def record_export(numbers, made, folder, name):
    """The numbers on every line of the input or header that is no comment, and the step."""
    numbers.physics(f"{name}time step", made.time_step)
    numbers.physics(f"{name}error of dissipated energy", made.energy_error, 1e-6, 1e-9)
    numbers.physics(f"{name}largest overlap", made.overlap)
    for file in made.files:
        if file.endswith((".py", ".h")) or file == "in.softjax":
            text = (folder / file).read_text(encoding="utf-8")
            record_lines(numbers, text, f"{name}{file}: ")


def record_lines(numbers, text, name):
    """Numbers of lines that set something, by the line's words."""
    text = re.sub(r'""".*?"""', "", text, flags=re.S)
    text = re.sub(r"/\*.*?\*/", "", text, flags=re.S)
    header = "#define" in text
    seen: dict[str, int] = {}
    for line in text.splitlines():
        code = line if header else line.partition("#")[0]
        found = NUMBER.findall(code)
        if not found or (header and not code.startswith("#define")):
            continue
        words = " ".join(NUMBER.sub("@", code).split())
        seen[words] = seen.get(words, 0) + 1
        label = words if seen[words] == 1 else f"{words} ({seen[words]})"
        numbers.physics(f"{name}{label}", np.array(found, float))
    for table in re.findall(r"\{([-+\d.e,\s]+)\}", text):
        values = np.array([float(cell) for cell in table.split(",") if cell.strip()])
        key = f"{name}table {seen.setdefault('tables', 0)}"
        seen["tables"] += 1
        numbers.physics(key, [len(values), values.sum(), *values[:: max(len(values) // 8, 1)]])
