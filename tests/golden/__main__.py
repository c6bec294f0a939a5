"""Golden numbers: `python -m tests.golden [--check] [name ...]`.

Without `--check` the scenarios are run and what they find is written to `recorded/`; what moved is
printed either way, and makes `--check` fail. Run it before and after a change to the inside: a
number marked `physics` or `estimate` moves for no reason but a mistake that was mended.
"""

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path

import softjax as sj
from tests.golden import errors, studies, written  # noqa: F401  they add their scenarios
from tests.golden.numbers import SCENARIOS, Numbers, differences, renewed, to_text
from tests.shown.capture import drawn

RECORDED = Path(__file__).parent / "recorded"


def found(name: str) -> dict:
    sj.enable_x64()
    numbers = Numbers()
    with drawn(), tempfile.TemporaryDirectory(prefix="softjax-golden-") as folder:
        SCENARIOS[name].run(numbers, Path(folder))
    return json.loads(to_text(numbers.table))


def recorded(name: str) -> dict:
    """What was recorded of a scenario; empty where nothing was."""
    path = RECORDED / f"{name}.json"
    empty = {mark: {} for mark in Numbers().table}
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else empty


def moved(name: str, new: dict) -> list[str]:
    return [f"{name}: {line}" for line in differences(recorded(name), new)]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="name", help="of scenarios; all of them")
    parser.add_argument("--check", action="store_true", help="write nothing")
    arguments = parser.parse_args()
    total = 0
    for name in arguments.names or SCENARIOS:
        started = time.process_time()
        new = found(name)
        lines = moved(name, new)
        total += len(lines)
        print("\n".join([*lines, f"{name}: {time.process_time() - started:.1f} s"]), flush=True)
        if not arguments.check and lines:
            RECORDED.mkdir(exist_ok=True)
            table = renewed(recorded(name), new)
            (RECORDED / f"{name}.json").write_text(to_text(table), encoding="utf-8")
    print(f"{total} numbers moved")
    return 1 if arguments.check and total else 0


if __name__ == "__main__":
    sys.exit(main())
