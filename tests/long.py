"""The tests marked `long`, in parts: `python -m tests.long --part 1/3 [--record] [pytest's options]`.

Files are dealt out to the parts by their seconds in `long_seconds.json`; `--record` measures those of
this part and writes them there. The tests of one file stay together, as they share what they compile.
"""

import argparse
import json
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

TOP = Path(__file__).parents[1]
SECONDS = Path(__file__).with_name("long_seconds.json")
UNKNOWN = 15.0  # of a test that was never measured [s]


def dealt(files: dict[str, float], count: int) -> list[list[str]]:
    """The files in `count` parts of nearly the same time, the longest dealt first."""
    parts: list[list[str]] = [[] for _ in range(count)]
    times = [0.0] * count
    for file in sorted(files, key=lambda file: (-files[file], file)):
        k = times.index(min(times))
        parts[k].append(file)
        times[k] += files[file]
    return parts


def collected() -> Counter[str]:
    """How many long tests each file has."""
    words = ["--collect-only", "-q", "-q", "-n", "0", "-m", "long"]
    command = [sys.executable, "-m", "pytest", *words]
    lines = subprocess.run(command, cwd=TOP, capture_output=True, text=True).stdout.splitlines()
    found = [line.rpartition(": ") for line in lines if line.startswith("tests/")]
    return Counter({file: int(count) for file, _, count in found})


def part_of(text: str) -> tuple[int, int]:
    """`2/3` as (2, 3)."""
    k, count = map(int, text.split("/"))
    if not 1 <= k <= count:
        raise ValueError
    return k, count


class Watch:
    """Seconds of each file, as pytest reports them."""

    def __init__(self) -> None:
        self.seconds: Counter[str] = Counter()

    def pytest_runtest_logreport(self, report) -> None:
        self.seconds[report.nodeid.partition("::")[0]] += report.duration


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--part", type=part_of, default=(1, 1), metavar="K/N")
    parser.add_argument("--record", action="store_true", help="write down the seconds of each file")
    arguments, others = parser.parse_known_args()
    known = json.loads(SECONDS.read_text(encoding="utf-8")) if SECONDS.exists() else {}
    files = {file: known.get(file, UNKNOWN * n) for file, n in collected().items()}
    k, count = arguments.part
    mine = dealt(files, count)[k - 1]
    minutes = sum(files[file] for file in mine) / 60
    print(
        f"part {k} of {count}: {len(mine)} files, some {minutes:.0f} minutes of one core",
        flush=True,
    )
    if not mine:
        return 0
    watch = Watch()
    code = pytest.main(["-m", "long", "--dist", "worksteal", *others, *mine], plugins=[watch])
    if arguments.record:
        measured = {file: round(seconds) for file, seconds in watch.seconds.items()}
        kept = {file: t for file, t in (known | measured).items() if file in files}
        text = json.dumps(dict(sorted(kept.items())), indent=1) + "\n"
        SECONDS.write_text(text, encoding="utf-8")
    return int(code)


if __name__ == "__main__":
    sys.exit(main())
