"""Whether the tests notice small changes to the code, drawn at random.

    python -m tests.mutants --record                  # first: which test runs which line; as long as all tests
    python -m tests.mutants --seed 3 --count 70       # ten changes in each package
    python -m tests.mutants --package fitting --count 10

Each change is made in a copy of the project, where the tests that run the changed line are run, the
cheapest first, until one fails. What nobody noticed is printed with its difference. A change that
changes nothing belongs in `equivalent.txt`, with the reason.
"""

import argparse
import json
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
RECORD = TOP / ".coverage-contexts" / "record.json"
EQUIVALENT = Path(__file__).with_name("equivalent.txt")
PACKAGES = {  # the first that a file's path begins with
    "softjax": ("softjax/",),
    "fitting": ("calibration/fitting/",),
    "studies": ("calibration/studies/",),
    "data": ("calibration/data/", "calibration/problem_file.py"),
    "report and plots": ("calibration/report/", "calibration/plots/"),
    "handover": ("calibration/handover/", "calibration/particle_codes/"),
    "commands": ("calibration/",),
}
NOTICED, SURVIVED, TIMEOUT = "noticed", "survived", "timeout"
EQUAL = "equivalent"


class Outcome(NamedTuple):
    change: Change
    result: str
    by: str  # the test that failed


def package_of(file: str) -> str:
    return next(name for name, starts in PACKAGES.items() if file.startswith(starts))


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


class Recorder:
    """A plugin of pytest: which test ran which lines, and how long it took."""

    def __init__(self) -> None:
        import coverage

        self.coverage = coverage.Coverage(
            data_file=None,
            source=[str(TOP / "softjax"), str(TOP / "calibration")],
            config_file=False,
        )
        self.seconds: Counter[str] = Counter()
        self.failed: set[str] = set()
        self.module = ""

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_protocol(self, item):
        import jax

        module = item.nodeid.partition("::")[0]
        if module != self.module:  # what another file traced would not be run again
            jax.clear_caches()
            self.module = module
        self.coverage.switch_context(item.nodeid.partition("[")[0])
        return (yield)

    def pytest_runtest_logreport(self, report) -> None:
        name = report.nodeid.partition("[")[0]
        self.seconds[name] += report.duration
        if not report.passed:  # skipped ones notice nothing
            self.failed.add(name)

    def table(self) -> dict:
        """{"seconds": {test: s}, "lines": {file: {line: [numbers of tests]}}}"""
        tests = [name for name in self.seconds if name not in self.failed]
        number = {name: k for k, name in enumerate(tests)}
        data = self.coverage.get_data()
        lines = {}
        for path in data.measured_files():
            by_line = {
                line: sorted(number[name] for name in names if name in number)
                for line, names in data.contexts_by_lineno(path).items()
            }
            lines[Path(path).relative_to(TOP).as_posix()] = by_line
        return {"seconds": {name: self.seconds[name] for name in tests}, "lines": lines}


def record(words: list[str]) -> int:
    """Run the tests once, in one process, and write down which line is run by which of them."""
    recorder = Recorder()
    recorder.coverage.start()
    code = pytest.main(["-n", "0", "-p", "no:cacheprovider", *words], plugins=[recorder])
    recorder.coverage.stop()
    RECORD.parent.mkdir(exist_ok=True)
    RECORD.write_text(json.dumps(recorder.table()), encoding="utf-8")
    return int(code)


class Record:
    """What `record` wrote, of the tests that still exist."""

    def __init__(self, table: dict, top: Path = TOP):
        self.tests = list(table["seconds"])
        self.seconds, self.lines = table["seconds"], table["lines"]
        self.exists = {name for name in self.tests if _exists(top, name)}

    def tests_of(self, file: str, first: int, last: int) -> list[str]:
        """Tests that run these lines; of lines that only importing runs, those of the whole file.

        The cheapest first, and at last what else is in their files: what is traced once in a process
        counts for the first test alone.
        """
        by_line = self.lines.get(file, {})
        own = {k for n in range(first, last + 1) for k in by_line.get(str(n), [])}
        own = own or {k for some in by_line.values() for k in some}
        named = sorted({self.tests[k] for k in own} & self.exists, key=self.seconds.__getitem__)
        files = {name.partition("::")[0] for name in named}
        rest = {n for n in self.exists if n.partition("::")[0] in files} - set(named)
        return [*named, *sorted(rest, key=self.seconds.__getitem__)]


def _exists(top: Path, name: str) -> bool:
    file, *_, function = name.split("::")
    path = top / file
    return path.exists() and f"def {function}(" in path.read_text(encoding="utf-8")


# pytest, in a process that limits its own seconds of the processor
LIMITED = """
import resource, sys, pytest
limit = int(sys.argv[1])
resource.setrlimit(resource.RLIMIT_CPU, (limit, limit + 5))
sys.exit(pytest.main(sys.argv[2:]))
"""


def tried(copy: Path, change: Change, tests: list[str], limit: int) -> Outcome:
    """The change made in a copy of the project, the tests run there, and the change undone."""
    if not tests:
        return Outcome(change, SURVIVED, "no test runs it")
    path = copy / change.file
    source = path.read_bytes()
    path.write_bytes(change.applied(source))
    words = ["-x", "-q", "-n", "0", "-p", "no:cacheprovider", "--tb=line"]
    env = os.environ | {"PYTHONPATH": str(copy), "PYTHONDONTWRITEBYTECODE": "1"}
    try:
        done = subprocess.run(
            [sys.executable, "-c", LIMITED, str(limit), *words, *tests],
            cwd=copy,
            env=env,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=10 * limit,
        )
    except subprocess.TimeoutExpired:
        return Outcome(change, TIMEOUT, "")
    finally:
        path.write_bytes(source)
    if done.returncode == 0:
        return Outcome(change, SURVIVED, "")
    if done.returncode < 0:
        return Outcome(change, TIMEOUT, "")
    failed = (line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR")))
    return Outcome(change, NOTICED, next(failed, "not even collected").partition(" - ")[0])


def within(tests: list[str], seconds: dict[str, float], limit: int) -> list[str]:
    """As many of them as take half of the limit; one at least."""
    total, kept = 0.0, []
    for name in tests:
        total += seconds[name]
        if kept and total > limit / 2:
            break
        kept.append(name)
    return kept


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--record", action="store_true", help="which test runs which line")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--count", type=int, default=70, help="changes, of all packages together")
    parser.add_argument("--package", choices=PACKAGES, action="append")
    parser.add_argument("--limit", type=int, default=240, help="seconds of processor time a change")
    parser.add_argument("--jobs", type=int, default=2)
    arguments, words = parser.parse_known_args()
    if arguments.record:
        return record(words)
    known = Record(json.loads(RECORD.read_text(encoding="utf-8")))
    outcomes = run(arguments, known)
    rates = defaultdict(Counter)
    for one in outcomes:
        rates[package_of(one.change.file)][one.result] += 1
    for name, counts in rates.items():
        of = counts[NOTICED] + counts[SURVIVED]
        rest = ", ".join(f"{counts[k]} {k}" for k in (TIMEOUT, EQUAL) if counts[k])
        print(f"{name:18} {counts[NOTICED]:3} of {of:3} noticed  {rest}")
    return 0


def run(arguments, known: Record) -> list[Outcome]:
    """Draw the changes, try them, and print each as it is done."""
    packages = arguments.package or list(PACKAGES)
    every, equal = every_change(), equivalents(EQUIVALENT.read_text(encoding="utf-8"))
    picked = []
    for k, name in enumerate(packages):
        share = arguments.count // len(packages) + (k < arguments.count % len(packages))
        picked += drawn(every[name], share, random.Random(f"{arguments.seed} {name}"), TOP)
    with tempfile.TemporaryDirectory(prefix="softjax-mutants-") as folder:
        copies: SimpleQueue[Path] = SimpleQueue()
        ignored = shutil.ignore_patterns(".git", ".*_cache", "__pycache__", ".coverage-contexts")
        for k in range(arguments.jobs):
            copies.put(shutil.copytree(TOP, Path(folder) / str(k), ignore=ignored))
        os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", f"{folder}/compiled")
        os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")

        def outcome(change: Change) -> Outcome:
            if (change.file, change.before, change.after) in equal:
                return Outcome(change, EQUAL, "")
            last = change.line + _lines(change)
            tests = within(
                known.tests_of(change.file, change.line, last), known.seconds, arguments.limit
            )
            copy = copies.get()
            try:
                return tried(copy, change, tests, arguments.limit)
            finally:
                copies.put(copy)

        outcomes = []
        with ThreadPoolExecutor(arguments.jobs) as pool:
            for one in pool.map(outcome, picked):
                outcomes.append(one)
                print(told(one), flush=True)
    return outcomes


def _lines(change: Change) -> int:
    """How many lines after its first the changed text goes on."""
    return (TOP / change.file).read_bytes()[change.start : change.end].count(b"\n")


def told(outcome: Outcome) -> str:
    change = outcome.change
    head = f"{outcome.result:9} {change.file}:{change.line} ({change.kind})  {outcome.by}"
    return f"{head}\n    - {change.before}\n    + {change.after}"


if __name__ == "__main__":
    sys.exit(main())
