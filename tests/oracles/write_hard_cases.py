"""Writes hard_cases.json: what the table of hard impacts comes out as, in 25 digits.

    python -m tests.oracles.write_hard_cases

One record for each row and each precision that holds it: the inputs as rounded, ε² and ε_p²,
θ ∂ε²/∂θ for all nine inputs, and for each of these Σ|∂²ε²/∂ln θ ∂ln θ'| over θ', which is what the
rounding of the inputs does to it. ε² is the unclipped one of Eq. (16).
"""

import json
from pathlib import Path
from typing import Any

from mpmath import mp, mpf

from tests.hard.table import PRECISIONS, TABLE, Case
from tests.oracles import zhou_mp as z
from tests.oracles.reference import text

TARGET = Path(__file__).with_name("hard_cases.json")
BESIDE_YIELD = mpf("1e-20")  # which side of y = 1 an impact is on, beyond any difference's step
STEP = mpf("1e-25")
Record = dict[str, Any]

# How ln d, ln X and ln y move with the logarithms of the inputs (y = v/v_cr, Eqs. 2 and 5)
SLOPES = {
    "E": (-2, 1, 2),
    "R": (0, 0, mpf(-3) / 2),
    "M": (0, 0, mpf(1) / 2),
    "Y": (2, -1, mpf(-5) / 2),
    "v_lim": (0, 0, 0),
    "chi": (0, 1, 0),
    "sigma": (0, 0, 0),
    "psi": (0, 0, 0),
    "v": (0, 0, 1),
}


def exact_inputs(case: Case, precision: str) -> Record:
    """The rounded inputs; at yield the velocity is on the side of y = 1 that the row means."""
    inputs = case.rounded(precision)
    if case.at_yield is not None:
        side = BESIDE_YIELD if case.at_yield > 0 else -BESIDE_YIELD
        with mp.workdps(140):
            inputs["v"] = z.dimensionless(inputs)["v_cr"] * (1 + side)
    return inputs


def plastic_curvatures(inputs: Record) -> dict[tuple[int, int], mpf]:
    """The second derivatives of ε_p² with ln d, ln X and ln y, by central differences."""
    scale = z.dimensionless(inputs)
    at = [scale[name] for name in ("d", "X", "y")]

    def value(*steps):
        moved = (a * mp.exp(s) for a, s in zip(at, steps, strict=True))
        return z.plastic_squared(inputs["form"], *moved)

    def difference(i, j):
        def corner(a, b):
            steps = [mpf(0)] * 3
            steps[i] += a * STEP
            steps[j] += b * STEP
            return value(*steps)

        return (corner(1, 1) - corner(1, -1) - corner(-1, 1) + corner(-1, -1)) / (4 * STEP**2)

    return {(i, j): difference(i, j) for i in range(3) for j in range(3)}


def losses(inputs: Record) -> mpf:
    """ε_17² at v below yield and at v_cr above it."""
    v_cr = z.scales(*(inputs[k] for k in ("E", "R", "M", "Y")), inputs["area"])["v_cr"]
    acting = min(mpf(inputs["v"]), v_cr)
    return z.empirical(acting, *(inputs[k] for k in ("v_lim", "sigma", "psi"))) ** 2


def loss_curvature(inputs: Record, a: str, b: str) -> mpf:
    def corner(i, j):
        steps = {a: mpf(0), b: mpf(0)}
        steps[a] += i * STEP
        steps[b] += j * STEP
        return losses(inputs | {k: mpf(inputs[k]) * mp.exp(s) for k, s in steps.items()})

    return (corner(1, 1) - corner(1, -1) - corner(-1, 1) + corner(-1, -1)) / (4 * STEP**2)


def curvature_sums(inputs: Record) -> dict[str, mpf]:
    """Σ over θ' of |∂²ε²/∂ln θ ∂ln θ'| for each θ; STEP² over (1 - y/y_max)² is their error."""
    with mp.workdps(140):
        P = plastic_curvatures(inputs)

        def second(a, b):
            plastic = sum(SLOPES[a][i] * P[i, j] * SLOPES[b][j] for i, j in P)
            return plastic + loss_curvature(inputs, a, b)

        return {a: sum((abs(second(a, b)) for b in z.NUMBERS), mpf(0)) for a in z.NUMBERS}


def solved(case: Case, precision: str) -> Record:
    """One record."""
    inputs = exact_inputs(case, precision)
    result = z.coefficient(inputs, lasts=False)
    lost = "NO_TURNING_POINT" in result["flags"]
    none = dict.fromkeys(z.NUMBERS, mpf(0))
    slopes = z.log_sensitivities(inputs)
    slopes = none if lost else {name: slopes[name]["eps_squared"] for name in z.NUMBERS}
    sums = none if lost else curvature_sums(inputs)
    return {
        "name": case.name,
        "precision": precision,
        "inputs": case.rounded(precision),
        "eps_squared": text(result["eps_squared"]),
        "eps_p_squared": text(result["eps_p_squared"]),
        "slopes": {name: text(slope) for name, slope in slopes.items()},
        "sensitivity": text(sum((abs(s) for s in slopes.values()), mpf(0))),
        "curvatures": {name: f"{float(total):.6g}" for name, total in sums.items()},
        "flags": sorted(result["flags"]),
    }


def write(target: Path = TARGET) -> None:
    """Solve everything and replace the file at once; one record a line."""
    import softjax

    softjax.enable_x64()  # a row at yield asks the library for its v_cr
    records = [
        json.dumps(solved(case, precision))
        for case in TABLE
        for precision in PRECISIONS
        if precision == "float64" or case.float32 is None
    ]
    beside = target.with_suffix(".tmp")
    beside.write_text("[\n" + ",\n".join(records) + "\n]\n", encoding="utf-8")
    beside.replace(target)


if __name__ == "__main__":
    write()
