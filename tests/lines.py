"""Which test runs which lines, and how long it takes: what `tests.mutants` chooses tests by.

In a copy of the project each statement of a function notes that it ran. A jitted function runs once
for all later tests of its file, so that programs are forgotten between files.
"""

import ast
import json
import os
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from typing import NamedTuple

import pytest

from tests.ran import ELSEWHERE, ran

FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)
NOTE = "from tests.ran import ran as _ran"


class Lines(NamedTuple):
    """Numbers of statements by file and line; the seconds and the statements of each test."""

    numbers: dict[str, dict[str, int]]
    seconds: dict[str, float]
    statements: dict[str, list[int]]

    def chosen(self, file: str, line: int) -> list[str]:
        """Tests that run a line (of no function: any of its file): those below a second, then others.

        At last those beside them that run the file elsewhere: what was compiled runs unseen. Tests of
        a file stay together, the cheapest files first.
        """
        of_file, near = self.numbers.get(file), [file]
        if of_file == {}:  # tables alone, which the functions of its folder read
            near = [path for path in self.numbers if Path(path).parent == Path(file).parent]
        whole = {number for path in near for number in self.numbers.get(path, {}).values()}
        expected = {of_file[str(line)]} if of_file and str(line) in of_file else whole
        ranks = {}
        for test, noted in self.statements.items():
            if not whole.isdisjoint(noted):
                own = not expected.isdisjoint(noted)
                ranks[test] = 1 + (self.seconds[test] >= 1) if own else 3, test.partition("::")[0]
        files = {path for rank, path in ranks.values() if rank < 3}
        places = {test: place for test, place in ranks.items() if place[1] in files}
        totals: dict[tuple[int, str], float] = defaultdict(float)
        for test, place in places.items():
            totals[place] += self.seconds[test]
        return sorted(
            places, key=lambda test: (places[test][0], totals[places[test]], places[test])
        )


def noting(source: str, numbers: Iterator[int]) -> tuple[str, dict[str, int]]:
    """A file whose functions note which statements run, and the number of each line of theirs."""
    tree = ast.parse(source)
    of_lines: dict[str, int] = {}
    _note(tree.body, False, numbers, of_lines)
    place = next((k for k, node in enumerate(tree.body) if not _is_head(node)), len(tree.body))
    tree.body[place:place] = ast.parse(NOTE).body
    return ast.unparse(tree), of_lines


def _note(body: list, inside: bool, numbers: Iterator[int], of_lines: dict[str, int]) -> None:
    for node in tuple(body):
        number, function = next(numbers), isinstance(node, FUNCTIONS)
        notes = function or (inside and not _is_head(node))
        if notes:
            first = min(part.lineno for part in (node, *getattr(node, "decorator_list", ())))
            of_lines |= dict.fromkeys(map(str, range(first, node.end_lineno + 1)), number)
        for block in _blocks(node):
            _note(block, inside or function, numbers, of_lines)
        if notes:
            within = node.body if function else body
            place = int(_is_head(node.body[0])) if function else body.index(node)
            within[place:place] = ast.parse(f"_ran.add({number})").body


def _blocks(node) -> list[list]:
    parts = [node, *getattr(node, "handlers", ()), *getattr(node, "cases", ())]
    blocks = [getattr(part, name, []) for part in parts for name in ("body", "orelse", "finalbody")]
    return [block for block in blocks if block]


def _is_head(node) -> bool:
    """A docstring, or an import from the future: these stay first."""
    text = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    return text or (isinstance(node, ast.ImportFrom) and node.module == "__future__")


class Noted:
    """The plugin of pytest in the copy."""

    def __init__(self, elsewhere: Path):
        self.elsewhere, self.fixtures = elsewhere, {}
        self.seconds, self.statements, self.failed, self.path = {}, {}, set(), None

    def pytest_runtest_setup(self, item):
        if item.path != self.path:
            import jax

            jax.clear_caches()
            self.path = item.path

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef):
        """What a fixture runs is run for every test that uses it."""
        before = set(ran)
        ran.clear()
        made = yield
        self.fixtures[fixturedef] = set(ran)
        ran.update(before)
        return made

    def pytest_runtest_teardown(self, item):
        for fixtures in item._fixtureinfo.name2fixturedefs.values():
            ran.update(*(self.fixtures.get(one, ()) for one in fixtures))

    def pytest_runtest_logstart(self, nodeid):
        ran.clear()
        self.started = sum(os.times()[:4])  # of this process and of those that it started

    def pytest_runtest_logreport(self, report):
        if report.failed:
            self.failed.add(report.nodeid)

    def pytest_runtest_logfinish(self, nodeid):
        if nodeid not in self.failed:  # as some do that look at their own sources
            self.seconds[nodeid] = sum(os.times()[:4]) - self.started
            for path in self.elsewhere.iterdir():
                ran.update(json.loads(path.read_text(encoding="utf-8")))
                path.unlink()
            self.statements[nodeid] = sorted(ran)


def main(place: str, to: str) -> None:
    """Run the tests of a place, and write what each runs."""
    with tempfile.TemporaryDirectory(prefix="softjax-ran-") as folder:
        os.environ[ELSEWHERE] = folder
        noted = Noted(Path(folder))
        pytest.main(["-q", "-n", "0", "-p", "no:cacheprovider", "--tb=no", place], plugins=[noted])
    text = json.dumps([noted.seconds, noted.statements])
    Path(to).write_text(text, encoding="utf-8")


def measured(copy: Path, places: list[str]) -> Lines:
    """Run the tests of the places in a copy of the project, which is changed, a process a place."""
    numbers, every = {}, count()
    for path in sorted((*copy.glob("softjax/**/*.py"), *copy.glob("calibration/**/*.py"))):
        text, of_lines = noting(path.read_text(encoding="utf-8"), every)
        path.write_text(text, encoding="utf-8")
        numbers[path.relative_to(copy).as_posix()] = of_lines
    lines, to = Lines(numbers, {}, {}), copy / "noted.json"
    for place in places:
        command = [sys.executable, "-m", "tests.lines", place, str(to)]
        subprocess.run(command, cwd=copy, env=os.environ | {"PYTHONPATH": str(copy)}, check=True)
        seconds, statements = json.loads(to.read_text(encoding="utf-8"))
        lines.seconds.update(seconds)
        lines.statements.update(statements)
    return lines


if __name__ == "__main__":
    main(*sys.argv[1:])
