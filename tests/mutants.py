"""Whether the tests notice small changes to the code, drawn at random.

    python -m tests.mutants --seed 3 --count 70       # ten changes in each package
    python -m tests.mutants --package fitting --count 10

Each change is made in a copy of the project, where the tests of its package are run until one fails.
What nobody noticed is printed with its difference. A change that changes nothing belongs in
`equivalent.txt`, with the reason.
"""

import argparse
import os
import random
import shutil
import subprocess
import sys
import tempfile
from collections import Counter, defaultdict
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import SimpleQueue
from typing import NamedTuple

import pytest

from tests.changes import Change, changes_of, drawn

TOP = Path(__file__).parents[1]
EQUIVALENT = Path(__file__).with_name("equivalent.txt")


class Package(NamedTuple):
    """Files whose path begins with one of `starts`, and where their tests are, the nearest first."""

    starts: tuple[str, ...]
    tests: tuple[str, ...]


PACKAGES = {  # a file is of the first that it begins with
    "softjax": Package(
        ("softjax/",),
        ("physics", "hard", "derivatives", "jax", "refusals", "fit/test_laws.py"),
    ),
    "fitting": Package(("calibration/fitting/",), ("fit", "statistics", "refusals", "golden")),
    "studies": Package(("calibration/studies/",), ("statistics", "commands", "shown", "golden")),
    "data": Package(
        ("calibration/data/", "calibration/schema.py"),
        ("data", "refusals", "commands", "golden"),
    ),
    "report and plots": Package(
        ("calibration/report/", "calibration/plots/"), ("shown", "commands", "golden")
    ),
    "export": Package(("calibration/particle_codes/",), ("export", "refusals", "golden")),
    "commands": Package(
        ("calibration/",), ("commands", "system", "shown", "refusals", "export", "golden")
    ),
}
NOTICED, SURVIVED, TIMEOUT = "noticed", "survived", "timeout"
EQUAL = "equivalent"


class Outcome(NamedTuple):
    change: Change
    result: str
    by: str  # the test that failed


def package_of(file: str) -> str:
    return next(name for name, one in PACKAGES.items() if file.startswith(one.starts))


def tests_of(file: str) -> list[str]:
    """Files and folders of the tests of a file's package, those with a name like its own first."""
    folders = [f"tests/{place}" for place in PACKAGES[package_of(file)].tests]
    stem = Path(file).stem.strip("_")
    near = [path for place in folders for path in sorted((TOP / place).glob(f"test_*{stem}*.py"))]
    return [*(path.relative_to(TOP).as_posix() for path in near), *folders]


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


# pytest, in a process that begins no test after half of its seconds of the processor
LIMITED = """
import resource, sys, time, pytest
limit = int(sys.argv[1])
resource.setrlimit(resource.RLIMIT_CPU, (limit, limit + 5))
class Half:
    def pytest_runtest_teardown(self, item):
        item.session.shouldstop = time.process_time() > limit / 2
sys.exit(pytest.main(sys.argv[2:], plugins=[Half()]))
"""


def tried(copy: Path, change: Change, tests: list[str], limit: int) -> Outcome:
    """The change made in a copy of the project, the tests run there, and the change undone."""
    path = copy / change.file
    source = path.read_bytes()
    path.write_bytes(change.applied(source))
    try:
        done = tests_run(copy, tests, limit)
    except subprocess.TimeoutExpired:
        return Outcome(change, TIMEOUT, "")
    finally:
        path.write_bytes(source)
    if done.returncode < 0:
        return Outcome(change, TIMEOUT, "")
    failed = [line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
    if not failed and done.returncode in (pytest.ExitCode.OK, pytest.ExitCode.INTERRUPTED):
        return Outcome(change, SURVIVED, "")
    if not failed:  # the change, or the place where the tests are run
        plain = tests_run(copy, ["--collect-only", *tests], limit)
        if plain.returncode:
            raise RuntimeError(
                f"no test runs in {copy}: {plain.stdout[-500:]}{plain.stderr[-500:]}"
            )
    return Outcome(change, NOTICED, [*failed, "not even collected"][0].partition(" - ")[0])


def tests_run(copy: Path, tests: list[str], limit: int) -> subprocess.CompletedProcess:
    words = ["-x", "-q", "-n", "0", "-p", "no:cacheprovider", "--tb=line"]
    return subprocess.run(
        [sys.executable, "-c", LIMITED, str(limit), *words, *tests],
        cwd=copy,
        env=os.environ | {"PYTHONPATH": str(copy), "PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
        errors="replace",
        timeout=10 * limit,
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--count", type=int, default=70, help="changes, of all packages together")
    parser.add_argument("--package", choices=PACKAGES, action="append")
    parser.add_argument("--limit", type=int, default=300, help="seconds of processor time a change")
    parser.add_argument("--jobs", type=int, default=2)
    outcomes = run(parser.parse_args())
    rates = defaultdict(Counter)
    for one in outcomes:
        rates[package_of(one.change.file)][one.result] += 1
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
        copies: SimpleQueue[Path] = SimpleQueue()
        ignored = shutil.ignore_patterns(".git", ".*_cache", "__pycache__")
        for k in range(arguments.jobs):
            copies.put(shutil.copytree(TOP, Path(folder) / str(k), ignore=ignored))
        os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", f"{folder}/compiled")
        os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")

        def outcome(change: Change) -> Outcome:
            if (change.file, change.before, change.after) in equal:
                return Outcome(change, EQUAL, "")
            copy = copies.get()
            try:
                return tried(copy, change, tests_of(change.file), arguments.limit)
            finally:
                copies.put(copy)

        outcomes = []
        with ThreadPoolExecutor(arguments.jobs) as pool:
            for one in pool.map(outcome, picked):
                outcomes.append(one)
                print(told(one), flush=True)
    return outcomes


def told(outcome: Outcome) -> str:
    change = outcome.change
    head = f"{outcome.result:9} {change.file}:{change.line} ({change.kind})  {outcome.by}"
    return f"{head}\n    - {change.before}\n    + {change.after}"


if __name__ == "__main__":
    sys.exit(main())
