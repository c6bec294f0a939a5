"""Whether the tests notice small changes to the code, drawn at random.

    python -m tests.mutants --seed 3 --count 70       # ten changes in each package
    python -m tests.mutants --package fitting --count 10 --lines lines.json

Each change is made in a copy of the project, where the tests that run its line are run until one
fails, the cheapest first, up to `--seconds` in all: where that left some out, it says how many.
What nobody noticed is printed with its difference. A change that changes nothing belongs in
`equivalent.txt`, with the reason.
"""

import argparse
import compileall
import json
import os
import py_compile
import random
import shutil
import subprocess
import sys
import tempfile
from collections import Counter, defaultdict
from concurrent.futures import ThreadPoolExecutor
from itertools import accumulate
from pathlib import Path
from queue import SimpleQueue
from typing import NamedTuple

import pytest

from tests.changes import Change, changes_of, drawn
from tests.lines import Lines, measured

TOP = Path(__file__).parents[1]
EQUIVALENT = Path(__file__).with_name("equivalent.txt")


PACKAGES = {  # a file is of the first that it begins with
    "softjax": ("softjax/",),
    "fitting": ("calibration/fitting/",),
    "studies": ("calibration/studies/",),
    "data": ("calibration/data/", "calibration/schema.py"),
    "report and plots": ("calibration/report/", "calibration/plots/"),
    "export": ("calibration/particle_codes/",),
    "commands": ("calibration/",),
}
# where the tests of users' doings are; those of documents, oracles and rules run or read other code
PLACES = (
    *("physics", "hard", "jax", "derivatives", "data", "fit", "statistics"),
    *("refusals", "commands", "shown", "export", "system", "golden", "coverage"),
)
# reads signatures, of which it runs no line
DEFAULTS = (
    "tests/refusals/test_refusals.py::"
    "test_arguments_of_public_names_have_the_defaults_that_are_recorded"
)
NOTICED, SURVIVED, TIMEOUT = "noticed", "survived", "timeout"
EQUAL = "equivalent"


class Outcome(NamedTuple):
    change: Change
    result: str
    by: str  # the test that failed, or how many did not


def package_of(file: str) -> str:
    return next(name for name, one in PACKAGES.items() if file.startswith(one))


def every_change(top: Path = TOP) -> dict[str, list[Change]]:
    """All changes by package."""
    found = defaultdict(list)
    for folder in ("softjax", "calibration"):
        for path in sorted((top / folder).rglob("*.py")):
            file = path.relative_to(top).as_posix()
            if path.name not in ("__init__.py", "__main__.py"):
                found[package_of(file)] += changes_of(file, path.read_bytes())
    return found


def equivalents(text: str) -> set[tuple[str, str, str]]:
    """(file, line before, line after) of the blocks `file`, `- before`, `+ after`, `= why`."""
    found = set()
    for block in text.strip().split("\n\n"):
        lines = [line for line in block.splitlines() if not line.startswith("#")]
        if lines:
            file, before, after, why = lines
            assert (before[:2], after[:2], why[:2]) == ("- ", "+ ", "= "), block
            found.add((file, before[2:], after[2:]))
    return found


def affordable(tests: list[str], seconds: dict[str, float], most: float) -> list[str]:
    """The first of the tests, of `most` seconds in all; the first in any case."""
    spent = accumulate(seconds[test] for test in tests)
    within = [test for test, all_of in zip(tests, spent, strict=True) if all_of <= most]
    return within or tests[:1]


def tried(copy: Path, change: Change, tests: list[str], limit: int) -> Outcome:
    """The change made in a copy of the project, the tests run there, and the change undone."""
    path = copy / change.file
    source = path.read_bytes()
    path.write_bytes(change.applied(source))
    try:
        code, out = tests_run(copy, tests, limit)
    finally:
        path.write_bytes(source)
    if code < 0:
        return Outcome(change, TIMEOUT, "")
    failed = [line for line in out.splitlines() if line.startswith(("FAILED", "ERROR"))]
    if not failed and code == pytest.ExitCode.OK:
        return Outcome(change, SURVIVED, "")
    if not failed:  # the change, or the place where the tests are run
        code, out = tests_run(copy, ["--collect-only", *tests], limit)
        if code:
            raise RuntimeError(f"no test runs in {copy}: {out[-1000:]}")
    return Outcome(change, NOTICED, [*failed, "not even collected"][0].partition(" - ")[0])


def tests_run(copy: Path, tests: list[str], limit: int) -> tuple[int, str]:
    """The exit code of pytest in a copy of the project, below 0 beyond the limit, and its output."""
    options = ["-x", "-q", "-n", "0", "-p", "no:cacheprovider", "--tb=line", "--assert=plain"]
    command = ["sh", "-c", f'ulimit -t {limit}; exec "$@"', "sh", sys.executable, "-m", "pytest"]
    try:
        place = {"cwd": copy, "env": os.environ | {"PYTHONPATH": str(copy)}, "timeout": 10 * limit}
        text = {"capture_output": True, "text": True, "errors": "replace"}
        done = subprocess.run([*command, *options, *tests], **place, **text)
    except subprocess.TimeoutExpired:
        return -1, ""
    return done.returncode, done.stdout + done.stderr


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--count", type=int, default=70, help="changes, of all packages together")
    parser.add_argument("--package", choices=PACKAGES, action="append")
    parser.add_argument("--seconds", type=float, default=60, help="of the tests of a change")
    parser.add_argument("--limit", type=int, default=300, help="seconds of processor time a change")
    parser.add_argument(
        "--lines", type=Path, help="which test runs which line: read if it is there, else written"
    )
    parser.add_argument("--jobs", type=int, default=2)
    outcomes = run(parser.parse_args())
    rates = defaultdict(Counter)
    for outcome in outcomes:
        rates[package_of(outcome.change.file)][outcome.result] += 1
    for name, counts in rates.items():
        of = counts[NOTICED] + counts[SURVIVED]
        rest = ", ".join(f"{counts[k]} {k}" for k in (TIMEOUT, EQUAL) if counts[k])
        print(f"{name:18} {counts[NOTICED]:3} of {of:3} noticed  {rest}")
    return 0


def run(arguments) -> list[Outcome]:
    """Draw the changes, try them, and print each as it is done."""
    packages = arguments.package or list(PACKAGES)
    every, equal = every_change(), equivalents(EQUIVALENT.read_text(encoding="utf-8"))
    picked = []
    for k, name in enumerate(packages):
        share = arguments.count // len(packages) + (k < arguments.count % len(packages))
        picked += drawn(every[name], share, random.Random(f"{arguments.seed} {name}"), TOP)
    with tempfile.TemporaryDirectory(prefix="softjax-mutants-") as folder:
        os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", f"{folder}/compiled")
        os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
        lines = known_lines(arguments.lines, Path(folder) / "noted")
        copies: SimpleQueue[Path] = SimpleQueue()
        for k in range(arguments.jobs):
            copies.put(copied(Path(folder) / str(k)))

        def outcome(change: Change) -> Outcome:
            if (change.file, change.before, change.after) in equal:
                return Outcome(change, EQUAL, "")
            chosen = lines.chosen(change.file, change.line)
            tests = affordable(chosen, lines.seconds, arguments.seconds)
            copy = copies.get()
            found = tried(copy, change, [DEFAULTS, *tests], arguments.limit)
            copies.put(copy)
            return found._replace(by=found.by or f"{len(tests)} of {len(chosen)} tests")

        outcomes = []
        with ThreadPoolExecutor(arguments.jobs) as pool:
            for found in pool.map(outcome, picked):
                outcomes.append(found)
                print(told(found), flush=True)
    return outcomes


def copied(to: Path) -> Path:
    """A copy of the project, whose compiled files are of a source's content, not of its time."""
    ignored = shutil.ignore_patterns(".git", ".*_cache", "__pycache__")
    shutil.copytree(TOP, to, ignore=ignored)
    for name in ("softjax", "calibration", "tests"):
        mode = py_compile.PycInvalidationMode.CHECKED_HASH
        compileall.compile_dir(to / name, quiet=1, invalidation_mode=mode)
    return to


def known_lines(file: Path | None, copy: Path) -> Lines:
    """What a file of lines says, or what the tests show in a copy."""
    if file is not None and file.exists():
        return Lines(*json.loads(file.read_text(encoding="utf-8")))
    lines = measured(copied(copy), [f"tests/{place}" for place in PLACES])
    if file is not None:
        file.write_text(json.dumps(lines), encoding="utf-8")
    return lines


def told(outcome: Outcome) -> str:
    change = outcome.change
    head = f"{outcome.result:9} {change.file}:{change.line} ({change.kind})  {outcome.by}"
    return f"{head}\n    - {change.before}\n    + {change.after}"


if __name__ == "__main__":
    sys.exit(main())
