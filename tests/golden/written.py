"""Scenarios: the cells of tables that commands print and write, and the numbers for particle codes."""

import re

import numpy as np

import calibration as cal
import softjax as sj
from tests.command import run
from tests.golden import simulated
from tests.golden.cases import contact
from tests.golden.numbers import NUMBER, scenario
from tests.golden.studies import DROPS, record_table
from tests.physics.own_laws import Hardening


def record_printed(numbers, text, name=""):
    """The numbers of the tables that a command prints, but of those with times."""
    text = text.replace(" ± ", " +- ") if name == "compare " else text
    blocks = [block for block in text.split("\n\n") if "seconds" not in block]
    lines = [line.strip() for block in blocks for line in block.splitlines()]
    heads = [k - 1 for k, line in enumerate(lines) if line.startswith("──")]
    rows = [re.split(r"\s{2,}", line) for k, line in enumerate(lines) if k not in heads]
    record_table(numbers, [row for row in rows if len(row) > 1], f"{name}printed: ")


@scenario
def tables(numbers, folder):
    """What `compare`, `sensitivity` and `curve` print and write."""
    (folder / "drops.csv").write_text(simulated.drops(), encoding="utf-8")
    (folder / "drops.toml").write_text(DROPS, encoding="utf-8")
    out = ("--out", folder, "--no-cache")
    laws = ("--laws", "zhou,viscoelastic")
    record_printed(numbers, run("compare", folder / "drops.toml", *laws, *out)[1], "compare ")
    local = run("sensitivity", "nylon", "--study", "local", "--at", "2", "20", *out)[1]
    record_printed(numbers, local, "local ")
    span = ("--from", "0.2", "--to", "20", "--points", "12", "--format", "csv", "table")
    run("curve", "nylon", "--law", "thornton", "--set", "yield_factor=2.5", *span, *out)
    for name in ("curve.csv", "curve.txt"):
        record_rows(numbers, folder / name)


def record_rows(numbers, path):
    """The columns of a file of numbers; what is no number in a row is left aside."""
    lines = path.read_text(encoding="utf-8").splitlines()
    rows = [NUMBER.findall(line) for line in lines if line[:1].isdigit()]
    for k, column in enumerate(zip(*rows, strict=True)):
        numbers.physics(f"{path.name} column {k}", np.array(column, float))


@scenario
def exports(numbers, folder):
    """A law at given parameters for each particle code."""
    pair, spring = contact(), 5e7
    zhou, exact = sj.Zhou(pair, 1.2, 0.9, 0.5), {"law": "exact"}
    cases = {
        "lammps, hertz-dashpot": (sj.HertzDashpot(pair, 0.8, end="zero-force"), {}),
        "liggghts, linear": (sj.LinearSpringDashpot(pair, spring, 0.8, end="zero-force"), {}),
        "yade, walton-braun": (sj.WaltonBraun(pair, spring, spring, 3000.0), {}),
        "c, zhou": (zhou, exact),
        "c, held": (zhou, exact | {"below": "hold", "tolerance": 0.004}),
        "c, own": (Hardening(pair, 1e-4), exact),
        "lammps, viscoelastic": (zhou, {"sizes": (0.01, 0.004), "overlap": 0.05}),
    }
    for name, (law, options) in cases.items():
        to, key = name.split(", ")
        given = {"velocity_range": (0.2, 2.0), "tolerance": 0.2, "law": key} | options
        made = cal.export(law, to, folder / name, **given)
        record_export(numbers, made, folder / name, f"{name}: ")


def record_export(numbers, made, folder, name):
    """The numbers on every line of the input or header that is no comment, and the step."""
    numbers.physics(f"{name}time step", made.time_step)
    numbers.physics(f"{name}error of dissipated energy", made.energy_error, 1e-6, 1e-9)
    numbers.physics(f"{name}largest overlap", made.overlap)
    steps, errors = made.choice.steps, [made.choice.error, made.choice.hold_error]
    errors += [steps.error, steps.order]
    numbers.physics(f"{name}errors of law, held ε and time step, its order", errors, 1e-5, 1e-9)
    for file in made.files:
        if file.endswith((".py", ".h")) or file == "in.softjax":
            text = (folder / file).read_text(encoding="utf-8")
            record_lines(numbers, text, f"{name}{file}: ")


def record_lines(numbers, text, name):
    """Numbers of lines that set something, by the line's words."""
    text = re.sub(r'""".*?"""', "", text, flags=re.S)
    text = re.sub(r"(0x|_)[0-9a-f]{8}\b", "", text)  # names of laws by the hash of their numbers
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
