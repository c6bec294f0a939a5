"""Writes reference.json: collisions with known answers, as strings of 25 digits.

    python -m tests.oracles.reference

Inputs are float64 numbers and the answers belong to exactly those numbers. Undefined answers (the
duration of an impact without a turning point, or at rest) are null.
"""

from __future__ import annotations

import json
import math
import os
import tempfile
from collections.abc import Iterator
from itertools import combinations_with_replacement
from pathlib import Path
from typing import Any

from mpmath import mp, mpf

from . import zhou_mp as zhou

TARGET = Path(__file__).with_name("reference.json")
FORMS = ("first-order", "full")
BOXES = 150  # a form
STEP = mpf("1e-30")

# Table 1; chi as fitted to the paper's curves with the consistent kappa; y_end as in Fig. 2.
MATERIALS: dict[str, dict[str, float]] = {
    "stainless steel": {
        "E": 1.93e11, "nu": 0.35, "rho": 8030.0, "Y": 3.10e8, "R": 0.0127,
        "chi": 1.7944, "sigma": 3.0432, "psi": 0.5400, "y_end": 250.0,
    },
    "chrome steel": {
        "E": 2.03e11, "nu": 0.28, "rho": 7830.0, "Y": 2.03e9, "R": 0.0127,
        "chi": 0.09867, "sigma": 0.1418, "psi": 0.3114, "y_end": 25.0,
    },
    "nylon": {
        "E": 2.5e9, "nu": 0.30, "rho": 1140.0, "Y": 4.0e7, "R": 0.0127,
        "chi": 0.21998, "sigma": 0.4355, "psi": 0.5414, "y_end": 80.0,
    },
}  # fmt: skip
CHOICES = {"area": "zhou", "kappa": "consistent"}
PROPERTIES = ("E", "nu", "rho", "Y", "R", "chi", "sigma", "psi", "v")
PAIRED = ("chi", "sigma", "psi", "E", "Y", "v")

Record = dict[str, Any]


def text(value: mpf) -> str | None:
    """25 digits; the rounding noise of a derivative that is exactly zero becomes zero."""
    if not mp.isfinite(value):
        return None
    return mp.nstr(value if abs(value) > mpf("1e-50") else mpf(0), 25)


def texts(values: dict[str, Any]) -> Record:
    """The same for a table of numbers, whatever its depth."""
    return {k: texts(v) if isinstance(v, dict) else text(v) for k, v in values.items()}


def low_discrepancy(count: int) -> Iterator[tuple[float, ...]]:
    """Points that fill the unit cube evenly: an additive recurrence, no random numbers."""
    g = 1.2207440846057596  # g⁴ = g + 1
    for n in range(1, count + 1):
        yield tuple((0.5 + n / g**k) % 1.0 for k in (1, 2, 3))


def box_inputs(form: str) -> Iterator[Record]:
    """E/Y from 20 to 1000, X from 0.3 to 3000, y from 0 to 300, every eighth below yield."""
    for n, (a, b, c) in enumerate(low_discrepancy(BOXES)):
        yield_ratio = 20.0 * 50.0**a
        d = 3 / 8 * math.pi ** (8 / 3) / yield_ratio**2  # 3 δ_cr/(2A) with Zhou's area
        y = (0.0 if n == 0 else c) if n % 8 == 0 else 300.0**c
        yield {"form": form, "d": d, "X": 0.3 * 1e4**b, "y": y}


def sensitivities_of_plastic_squared(form: str, **at: float) -> dict[str, mpf]:
    """∂ε_p²/∂ln θ for θ in d, X, y, by central differences."""
    slopes = {}
    with mp.workdps(140):
        for name, value in at.items():
            above, below = (
                zhou.plastic_squared(form, **(at | {name: value * (1 + h)})) for h in (STEP, -STEP)
            )
            slopes[name] = (above - below) / (2 * STEP)
    return slopes


def box(case: Record) -> Record:
    """One dimensionless collision."""
    form, d, X, y = case["form"], case["d"], case["X"], case["y"]
    x_m = zhou.peak(form, d, y)
    turns = x_m is not None
    slopes = sensitivities_of_plastic_squared(form, d=d, X=X, y=y)
    answers = {
        "x_m": x_m if turns else zhou.loading_end(form, d),
        "x_star": zhou.residual(form, d, X, x_m) if turns else zhou.loading_end(form, d),
        "eps_p_squared": zhou.plastic_squared(form, d, X, y),
        "duration": zhou.duration(form, d, X, y),
        "log_sensitivities": slopes,
        "log_sensitivity_sum": sum((abs(z) for z in slopes.values()), mpf(0)),
    }
    return case | texts(answers) | {"flags": sorted(zhou.flags(form, d, X, y))}


def sphere_inputs(name: str, form: str) -> Record:
    """Two equal spheres of a material of Table 1, without a velocity."""
    own = {k: v for k, v in MATERIALS[name].items() if k != "y_end"}
    return own | CHOICES | {"form": form}


def geometric(first: float, last: float, count: int) -> list[float]:
    """Values in constant ratio."""
    return [first * (last / first) ** (n / (count - 1)) for n in range(count)]


def solved(inputs: Record) -> Record:
    """ε, overlaps, duration and flags of one impact."""
    result = zhou.coefficient(inputs)
    flags = sorted(result.pop("flags"))
    return texts(result) | {"flags": flags}


def curves() -> Iterator[Record]:
    """ε(v) of the three materials with its sensitivities, the contact's effective leaves given."""
    for name, material in MATERIALS.items():
        y_values = [0.1, 0.4, 0.8, 0.99, 1.0002, 1.02, *geometric(1.1, material["y_end"], 19)]
        for form in FORMS:
            pair = zhou.equal_spheres(sphere_inputs(name, form))
            leaves = {k: float(pair[k]) for k in ("E", "R", "M", "Y", "v_lim")}
            v_cr = float(zhou.scales(pair["E"], pair["R"], pair["M"], pair["Y"], "zhou")["v_cr"])
            for y in y_values:
                inputs = pair | leaves | {"v": y * v_cr}
                slopes = zhou.log_sensitivities(inputs)
                answers = solved(inputs) | {"log_sensitivities": texts(slopes)}
                yield {"material": name, "inputs": inputs} | answers


def materials() -> Iterator[Record]:
    """First and second derivatives with respect to properties of a material."""
    for name, material in MATERIALS.items():
        for form in FORMS:
            own = sphere_inputs(name, form)
            pair = zhou.equal_spheres(own)
            v_cr = float(zhou.scales(pair["E"], pair["R"], pair["M"], pair["Y"], "zhou")["v_cr"])
            for y in (0.5, 1.05, *geometric(2.0, material["y_end"], 4)):
                inputs = own | {"v": y * v_cr}
                seconds = {
                    f"{a},{b}": zhou.second(inputs, a, b, zhou.equal_spheres)
                    for a, b in combinations_with_replacement(PAIRED, 2)
                }
                slopes = zhou.log_sensitivities(inputs, PROPERTIES, zhou.equal_spheres)
                derivatives = {"log_sensitivities": slopes, "second": seconds}
                answers = solved(zhou.equal_spheres(inputs)) | texts(derivatives)
                yield {"material": name, "inputs": inputs} | answers


def write(target: Path = TARGET) -> None:
    """Solve everything and replace the file at once; one collision a line."""
    sections = {
        "boxes": [box(case) for form in FORMS for case in box_inputs(form)],
        "curves": list(curves()),
        "materials": list(materials()),
    }
    lines = (
        f'"{name}": [\n' + ",\n".join(json.dumps(r) for r in records) + "\n]"
        for name, records in sections.items()
    )
    source = '"source": "Zhou, Theor. Appl. Mech. Lett. 3, 021003 (2013); mpmath"'
    descriptor, beside = tempfile.mkstemp(dir=target.parent, suffix=".tmp")
    with os.fdopen(descriptor, "w", encoding="utf-8") as file:
        file.write("{\n" + ",\n".join([source, *lines]) + "\n}\n")
    Path(beside).chmod(0o644)  # mkstemp's own is for its owner alone
    Path(beside).replace(target)


if __name__ == "__main__":
    write()
