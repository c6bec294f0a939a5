"""Writes turning_point.json: collisions beside y_max, where loading just has a turning point.

    python -m tests.oracles.write_turning_point

There the work has nearly a double root in the overlap, on whose falling side a search may end.
Each row: d, X and y as the precision holds them, 1 - y/y_max, ε_p², x_m, and Σ|∂ε_p²/∂ln θ| over
d, X and y.
"""

import json
from pathlib import Path

import numpy as np
from mpmath import mp, mpf

from tests.hard.table import PRECISIONS
from tests.oracles import zhou_mp as z

TARGET = Path(__file__).with_name("turning_point.json")
STEP = mpf("1e-40")
CLOSEST = {"float64": -15.5, "float32": -6.5}  # powers of ten of 1 - y/y_max
COUNT = 150
FORM = "first-order"


def row(draw: np.random.Generator, precision: str) -> list[float] | None:
    """One collision, None where rounding of y put it beyond the last turning point."""
    kind = PRECISIONS[precision]
    near_one, any_ = 1 + 10 ** draw.uniform(-3, 1), 10 ** draw.uniform(-1, 8)
    d = float(kind(10 ** draw.uniform(-13, 0.5)))
    X = float(kind(near_one if draw.random() < 0.5 else any_))
    distance = 10 ** draw.uniform(CLOSEST[precision], -1)
    with mp.workdps(120):
        last = z.y_max(FORM, d)
        y = float(kind(float(last * (1 - mpf(distance)))))
        if y <= 1 or z.peak(FORM, d, y) is None:
            return None
        squared, peak = z.plastic_squared(FORM, d, X, y), z.peak(FORM, d, y)
        sensitivity = sum(abs(slope) for slope in _slopes(d, X, y))
        return [d, X, y, *(float(a) for a in (1 - y / last, squared, peak, sensitivity))]


def _slopes(d: float, X: float, y: float) -> list[mpf]:
    """∂ε_p²/∂ln θ by central differences."""
    ups = [[1 + STEP * (i == j) for j in range(3)] for i in range(3)]
    downs = [[1 - STEP * (i == j) for j in range(3)] for i in range(3)]
    value = lambda by: z.plastic_squared(FORM, d * by[0], X * by[1], y * by[2])  # noqa: E731
    return [(value(up) - value(down)) / (2 * STEP) for up, down in zip(ups, downs, strict=True)]


def main() -> None:
    rows = {}
    for precision in PRECISIONS:
        draw = np.random.default_rng(7)
        found = (row(draw, precision) for _ in range(COUNT))
        rows[precision] = [one for one in found if one is not None]
    lines = [json.dumps(rows[p])[1:-1].replace("], [", "],\n[") for p in rows]
    text = ",\n".join(f'"{p}": [\n{line}\n]' for p, line in zip(rows, lines, strict=True))
    TARGET.write_text(f"{{\n{text}\n}}\n", encoding="utf-8")


if __name__ == "__main__":
    main()
