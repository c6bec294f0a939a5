"""Whether the tests notice small changes to the code: `python -m tests.mutants [part of a file's name]`.

Each change of `tests.small_changes` is made in a copy of the project, where the tests that should
notice it are run until one of them fails. What nobody noticed is printed, and makes the command
fail where it is more than a tenth. Seven minutes on two cores.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import SimpleQueue
from typing import NamedTuple

from tests.small_changes import CHANGES

TOP = Path(__file__).parents[1]
LEAST = 0.9  # of the changes have to be noticed
AT_ONCE = 2
NOTICED, UNNOTICED = 1, 0  # pytest's exit codes


class Outcome(NamedTuple):
    where: str
    change: str
    code: int
    told: str


def main() -> int:
    wanted = sys.argv[1] if len(sys.argv) > 1 else ""
    every = [(file, *one) for file, some in CHANGES.items() for one in some if wanted in file]
    with tempfile.TemporaryDirectory(prefix="softjax-mutants-") as folder:
        copies: SimpleQueue[Path] = SimpleQueue()
        for k in range(AT_ONCE):
            copies.put(_copy(Path(folder) / str(k)))
        os.environ["JAX_COMPILATION_CACHE_DIR"] = f"{folder}/compiled"
        with ThreadPoolExecutor(AT_ONCE) as pool:
            outcomes = []
            for outcome in pool.map(lambda one: _tried(copies, *one), every):
                outcomes.append(outcome)
                _tell(outcome)
    noticed = sum(one.code == NOTICED for one in outcomes)
    print(f"{noticed} of {len(outcomes)} changes noticed")
    return 0 if outcomes and noticed >= LEAST * len(outcomes) else 1


def _copy(to: Path) -> Path:
    shutil.copytree(TOP, to, ignore=shutil.ignore_patterns(".git", ".*_cache", "__pycache__"))
    return to


def _tried(copies, file: str, before: str, after: str, tests: str) -> Outcome:
    copy = copies.get()
    path = copy / file
    text = path.read_text(encoding="utf-8")
    try:
        path.write_text(text.replace(before, after), encoding="utf-8")
        names = [f"tests/test_{name}.py" for name in tests.split()]
        command = [sys.executable, "-m", "pytest", "-x", "-q", "-n", "0", "--tb=line", *names]
        found = subprocess.run(
            command, cwd=copy, env=os.environ | {"PYTHONPATH": str(copy)}, capture_output=True
        )
    finally:
        path.write_text(text, encoding="utf-8")
        copies.put(copy)
    lines = found.stdout.decode(errors="replace").splitlines()
    told = next((line for line in lines if line.startswith("FAILED")), "")
    return Outcome(file, f"{before} -> {after}", found.returncode, told)


def _tell(outcome: Outcome) -> None:
    words = {NOTICED: "noticed ", UNNOTICED: "MISSED  "}
    word = words.get(outcome.code, f"pytest {outcome.code}")
    told = outcome.told.removeprefix("FAILED tests/").split(" - ")[0]
    print(word, f"{outcome.where}: {outcome.change!r}", told, sep="  ", flush=True)


if __name__ == "__main__":
    sys.exit(main())
