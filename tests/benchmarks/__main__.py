"""Measure everything and write the reference's table of speed: `python -m tests.benchmarks`.

`softjax speed` measures the library, SciPy's loop and diffrax with events; compiled loops and refits are measured
here (`pip install numba pytest-benchmark`). The text between the two marks of the page is replaced.
"""

import csv
import json
import subprocess
import sys
import tempfile
from pathlib import Path

PAGE = Path(__file__).parents[2] / "notebooks" / "reference" / "speed.md"
MARKS = "<!-- speed table -->", "<!-- end of speed table -->"
BENCH = Path(__file__).with_name("bench_numba.py")


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        measure = [sys.executable, "-m", "calibration", "speed", "--quiet", "--out", folder]
        subprocess.run(measure, check=True)
        store = f"--benchmark-json={folder}/benchmarks.json"
        bench = [sys.executable, "-m", "pytest", "-n", "0", "-p", "no:randomly", BENCH, store]
        subprocess.run(bench, check=True)
        with (Path(folder) / "speed.csv").open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        text = (Path(folder) / "benchmarks.json").read_text(encoding="utf-8")
        found = json.loads(text)["benchmarks"]
    before, rest = PAGE.read_text(encoding="utf-8").split(MARKS[0])
    after = rest.split(MARKS[1])[1]
    lines = "\n".join([MARKS[0], *table(rows, found), "", *text_of_refits(found), MARKS[1]])
    PAGE.write_text(before + lines + after, encoding="utf-8")
    print(lines)


def table(rows: list[dict], found: list[dict]) -> list[str]:
    """Markdown, one method in each row."""
    cells = [
        (
            row["family"],
            row["setting"],
            int(row["batch"]),
            float(row["microseconds"]),
            float(row["largest_error"]),
            f"{float(row['gradient_microseconds']):.2g}" if row["gradient_microseconds"] else "",
        )
        for row in rows
    ]
    for one in found:
        more = one["extra_info"]
        if "family" in more:
            each = 1e6 * one["stats"]["median"] / more["batch"]
            cells.append((more["family"], more["setting"], more["batch"], each, more["error"], ""))
    heads = [
        "method",
        "setting",
        "batch",
        "µs a collision",
        "largest error of ε_p",
        "value and gradient, µs",
    ]
    lines = [f"| {' | '.join(heads)} |", "|" + "---|" * len(heads)]
    for method, setting, batch, each, error, gradient in cells:
        lines.append(
            f"| {method} | {setting} | {batch:,} | {each:.2g} | {error:.0e} | {gradient} |"
        )
    return lines


def text_of_refits(found: list[dict]) -> list[str]:
    """A thousand refits by both methods."""
    seconds = {
        one["extra_info"]["refits"]: one["stats"]["median"]
        for one in found
        if "refits" in one["extra_info"]
    }
    share = min(one["extra_info"].get("share", 1.0) for one in found)
    return [
        f"A thousand refits of a bootstrap, 30 points and three parameters each, take "
        f"{seconds['refits']:.2f} s as one batch, {seconds['scipys_refits']:.2f} s by SciPy's loop over the "
        f"same formulas in numba with exact derivatives; {share:.1%} end at the same minimum."
    ]


if __name__ == "__main__":
    main()
