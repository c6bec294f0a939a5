"""Measure everything and write the reference's table and picture of speed: `pytest -n 0 tests/benchmarks/bench_speed.py`.

`softjax speed` measures the library, SciPy's loop and diffrax with events; compiled loops and a
thousand refits are measured here (`pip install softjax-contact[bench]`), and must be right to be reported.
The text between the two marks of the page is replaced where all passed.
"""

import csv
import json
import math
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

import calibration as cal
import softjax as sj
from tests.benchmarks import numba_loops

PAGE = Path(__file__).parents[2] / "notebooks" / "reference" / "speed.md"
MARKS = "<!-- speed table -->", "<!-- end of speed table -->"
HEADS = ("method", "setting", "batch", "µs a collision", "largest error of ε_p")
HEADS += ("value and gradient, µs",)
EXACT = json.loads(Path(cal.__file__).with_name("speed.json").read_text(encoding="utf-8"))["zhou"]
VELOCITY, PLASTIC = np.array(EXACT["rows"], float).T[:2]
VERLET = {100: 2e-3, 1000: 1e-4, 3000: 1e-5}  # steps, and the error of ε_p that they may have
REFITS, POINTS, NOISE, SEED = 1000, 30, 0.005, 0


def law():
    """Stainless steel of Table 1, as `softjax speed` has it."""
    x = EXACT["inputs"]
    contact = sj.Contact(x["E"], x["R"], x["M"], x["Y"], x["v_lim"], area=x["area"])
    return sj.Zhou(contact, x["chi"], x["sigma"], x["psi"], form=x["form"], kappa=x["kappa"])


def reduced(law):
    """d and X."""
    return float(law.plasticity()), float(law.chi * law.contact.yield_ratio)


@pytest.fixture(scope="module")
def table():
    """What the page is to say, which is written in the end."""
    found = {"rows": [], "refits": {}}
    yield found
    if len(found["refits"]) == 3 and len(found["rows"]) > len(VERLET) + 1:
        write(found["rows"], **found["refits"])


def median(benchmark, function) -> float:
    """[s]"""
    benchmark.pedantic(function, rounds=5, warmup_rounds=1)
    return benchmark.stats.stats.median


def plastic(y):
    """ε_p of impacts at y over v_cr by the same formulas, compiled by numba."""
    example = law()
    ratio = 1 / (float(example.contact.limit_velocity / example.contact.critical_velocity) - 1)
    up_loss = float(np.expm1(-2 * example.sigma * ratio**example.psi))
    return numba_loops.energy_balance(*reduced(example), y, up_loss)[1]


LOOPS = [("the same formulas in numba, all cores", "exact", 10**6, plastic, 1e-14)]
for n, most in VERLET.items():
    verlet = lambda y, n=n: numba_loops.verlet(*reduced(law()), y, n)  # noqa: E731
    LOOPS.append(("velocity Verlet, numba", f"{n} steps", 4096, verlet, most))


def test_softjax_speed(table, tmp_path):
    measure = [sys.executable, "-m", "calibration", "speed", "--quiet", "--out", tmp_path]
    subprocess.run(measure, check=True)
    numbers = ("microseconds", "largest_error", "gradient_microseconds")
    shutil.copy(tmp_path / "speed.png", PAGE.parents[1] / "figures")  # of the same run as the table
    with (tmp_path / "speed.csv").open(newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            each = (float(row[n] or "nan") for n in numbers)
            table["rows"].append((row["family"], row["setting"], int(row["batch"]), *each))


@pytest.mark.parametrize(("family", "setting", "batch", "function", "most"), LOOPS)
def test_compiled_loops(benchmark, table, family, setting, batch, function, most):
    y = np.resize(VELOCITY / float(law().contact.critical_velocity), batch)
    error = float(np.max(np.abs(function(y) - np.resize(PLASTIC, batch))))
    assert error <= most
    each = 1e6 * median(benchmark, lambda: function(y)) / batch
    table["rows"].append((family, setting, batch, each, error, float("nan")))


@pytest.fixture(scope="module")
def result():
    return fitted()


def own_refits(result):
    return result.bootstrap(REFITS, seed=SEED).values


def fitted():
    """A fit of 30 points on both sides of first yield."""
    example = law()
    velocity = float(example.contact.critical_velocity) * np.geomspace(0.02, 200.0, POINTS)
    noise = NOISE * np.random.default_rng(1).standard_normal(POINTS)
    measured = np.asarray(sj.restitution(example, velocity).coefficient) + noise
    data = cal.RestitutionData(velocity, np.minimum(measured, 1.0), example.contact)
    start = {name: cal.Parameter(getattr(example, name)) for name in ("chi", "sigma", "psi")}
    return cal.fit(data, None, start, starts=1)


def scipys_refits(result):
    """One fit after the other by SciPy's Levenberg–Marquardt, of the data that `bootstrap` draws."""
    law, velocity = result.law, result.data.velocity
    mean = np.asarray(sj.restitution(law, velocity).coefficient)
    noise = np.random.default_rng(SEED).standard_normal((REFITS, POINTS))
    drawn = np.maximum(mean + noise * result.materials[0].noise, 0.0)
    critical = float(law.contact.critical_velocity)
    d, steepness = reduced(law)
    limit, y = float(law.contact.limit_velocity) / critical, velocity / critical

    def at(z):
        chi, sigma, psi = np.exp(z)
        return numba_loops.curve(y, d, steepness / law.chi * chi, sigma, psi, limit)

    start = np.log([result.values[name] for name in ("chi", "sigma", "psi")])
    options = {"method": "lm", "xtol": 1e-9, "ftol": 1e-12}
    ends = [
        least_squares(lambda z, m=m: at(z)[0] - m, start, lambda z: at(z)[1], **options)
        for m in drawn
    ]
    return np.exp([end.x for end in ends])


def test_both_end_at_the_same_minima(result, table):
    found, others = own_refits(result), scipys_refits(result)
    share = float(np.mean(np.max(np.abs(np.log(found / others)), axis=1) < 1e-4))
    assert share > 0.95
    table["refits"]["share"] = share


@pytest.mark.parametrize("way", [own_refits, scipys_refits])
def test_a_thousand_refits(benchmark, result, table, way):
    table["refits"][way.__name__] = median(benchmark, lambda: way(result))


def write(rows, share, own_refits, scipys_refits) -> None:
    lines = [f"| {' | '.join(HEADS)} |", "|" + "---|" * len(HEADS)]
    methods = list(dict.fromkeys(row[0] for row in sorted(rows, key=lambda row: row[4])))
    rows = sorted(rows, key=lambda row: (methods.index(row[0]), row[2], -row[4]))
    for method, setting, batch, *numbers in rows:
        setting = setting.replace("e-0", "e-")
        each, error, slope = numbers
        slope = "" if math.isnan(slope) else f"{slope:.2g}"
        each = f"{each:.2g}" if each < 100 else f"{each:.0f}"
        cells = (method, setting, f"{batch:,}", each, f"{error:.0e}".replace("e-0", "e-"), slope)
        lines.append(f"| {' | '.join(cells)} |")
    refits = (
        f"A thousand refits of a bootstrap, 30 points and three parameters each, take "
        f"{own_refits:.2f} s as one batch, {scipys_refits:.2f} s by SciPy's\nloop over the same "
        f"formulas in numba with exact derivatives; {100 * share:.1f} % end at the same minimum."
    )
    text = "\n".join([MARKS[0], *lines, "", refits, MARKS[1]])
    before, rest = PAGE.read_text(encoding="utf-8").split(MARKS[0])
    PAGE.write_text(before + text + rest.split(MARKS[1])[1], encoding="utf-8")
