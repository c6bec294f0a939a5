"""A million impacts over the boxes of all inputs, checked one by one.

    python -m tests.physics.long_run [--samples 1000000] [--seed 0]

Prints how many break each rule of `boxes.count`, by form, area and κ. Exits 1 if any does.
"""

import argparse
import sys

from rich.progress import track

import softjax as sj
from tests.physics import boxes
from tests.physics.boxes import count

CHUNK = 20_000


def run(samples: int, seed: int) -> dict[str, dict[str, int]]:
    """The counts, by choice and rule."""
    chunks = -(-samples // (CHUNK * len(boxes.CHOICES)))
    totals: dict[str, dict[str, int]] = {}
    for choice in boxes.CHOICES:
        name = f"{choice.form}, {choice.area}, {choice.kappa}"
        total = totals.setdefault(name, {"impacts": 0})
        for k in track(range(chunks), name, disable=not sys.stderr.isatty()):
            total["impacts"] += CHUNK
            for rule, broken in count(boxes.sample(seed + k, CHUNK, choice), choice).items():
                total[rule] = total.get(rule, 0) + broken
    return totals


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    sj.enable_x64()
    totals = run(arguments.samples, arguments.seed)
    for name, total in totals.items():
        print(f"{name}: {total.pop('impacts')} impacts")
        for rule, broken in total.items():
            print(f"  {rule:24} {broken}")
    violations = sum(sum(total.values()) for total in totals.values())
    print(f"violations: {violations}")
    return 1 if violations else 0


if __name__ == "__main__":
    sys.exit(main())
