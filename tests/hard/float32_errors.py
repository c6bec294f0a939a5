"""What float32 costs: errors of value and gradient over the boxes, and of the three materials.

    python -m tests.hard.float32_errors [--samples 200000] [--seed 0]

Against float64 at the same inputs, rounded to float32 beforehand (float64 itself is checked
against 40-digit arithmetic by the tests, to 1e-12). The slopes are θ ∂ε²/∂θ for all nine inputs.
"""

import argparse
from typing import NamedTuple

import numpy as np

import softjax as sj
from tests import cases
from tests.physics import boxes
from tests.physics.boxes import solve

EPS = float(np.finfo(np.float32).eps)
CHUNK = 20_000
SLOWEST = 1e-30  # of v_lim and in m/s: float32 ends at 1e-38
NEAR = 1e-5  # relative to a threshold of y: there rounding of float32 inputs decides the status
SHARES = (0.5, 0.9, 0.99, 0.999, 1.0)
ELASTIC = int(sj.Status.ELASTIC)


class Errors(NamedTuple):
    """Of each impact whose status both precisions agree on, and how many there are else."""

    sensitivity: np.ndarray  # Σ|∂ε²/∂ln θ|
    value: np.ndarray  # |Δε²|
    slope: np.ndarray  # largest |Δ(θ ∂ε²/∂θ)|
    near: int  # impacts whose status differs, near a threshold
    wrong: int  # and away from all
    not_finite: int


def errors(seed: int, size: int, choice: boxes.Choice) -> Errors:
    """float32 against float64 on one sample of the boxes."""
    inputs = boxes.sample(seed, size, choice)
    slowest = SLOWEST * np.maximum(inputs["v_lim"], 1)
    inputs["v"] = np.where(inputs["v"] > 0, np.maximum(inputs["v"], slowest), 0)
    inputs = {name: value.astype(np.float32).astype(float) for name, value in inputs.items()}
    short, exact = (_squares(inputs, choice, dtype) for dtype in (np.float32, np.float64))
    same = short[2] == exact[2]
    sensitivity = np.abs(exact[1]).sum(0)
    # a gain is told from 4 eps on, and computed to the 8 eps of `_print_boxes`
    rounding = np.maximum(8 * EPS * (1 + sensitivity), 16 * EPS)
    _, clear = boxes.expected_status(inputs, choice, exact[3], NEAR, rounding)
    return Errors(
        sensitivity[same],
        np.abs(short[0] - exact[0])[same],
        np.abs(short[1] - exact[1]).max(0)[same],
        int(np.sum(~same & ~clear)),
        int(np.sum(~same & clear)),
        int(np.sum(~np.isfinite(short[0]) | ~np.all(np.isfinite(short[1]), axis=0))),
    )


def _squares(inputs, choice, dtype):
    """ε², θ ∂ε²/∂θ, the status and ε_p²."""
    result, slopes = solve(inputs, choice, dtype)
    epsilon = result["coefficient"].astype(float)
    scaled = [2 * epsilon * slopes[name].astype(float) * inputs[name] for name in boxes.INPUTS]
    plastic = result["plastic_coefficient"].astype(np.longdouble)
    return epsilon**2, np.array(scaled), result["status"], plastic**2


def over_boxes(samples: int, seed: int, choice: boxes.Choice) -> Errors:
    """The same over many chunks."""
    parts = [errors(seed + k, CHUNK, choice) for k in range(-(-samples // CHUNK))]
    joined = [np.concatenate(column) for column in list(zip(*parts, strict=True))[:3]]
    return Errors(*joined, *(sum(p[k] for p in parts) for k in (3, 4, 5)))


def of_material(name: str, form: str, route) -> float:
    """Largest |Δε| over the reference curve, from SI inputs, against 40-digit arithmetic."""
    records = [r for r in cases.of_form("curves", form) if r["material"] == name]
    velocity = cases.column(records, "inputs", "v").astype(np.float32)
    result = sj.restitution(cases.fitted(name, form), velocity, route)
    assert result.coefficient.dtype == np.float32
    return float(np.max(np.abs(np.float64(result.coefficient) - cases.column(records, "eps"))))


def _print_boxes(samples: int, seed: int) -> None:
    heads = "".join(f"{'max' if q == 1 else f'{q:.1%}':>10}" for q in SHARES)
    for choice in boxes.CHOICES:
        found = over_boxes(samples, seed, choice)
        print(f"{choice.form}, {choice.area}, {choice.kappa}: {samples} impacts,")
        print(f"  status differs: {found.near} near a threshold, {found.wrong} else")
        print(f"  not finite: {found.not_finite}")
        print(f"  {'':34}{heads}")
        fair = 8 * EPS * (1 + found.sensitivity)
        mild = found.sensitivity < 1
        for label, values in {
            "|Δε²|": found.value,
            "|Δε²|, Σ|∂ε²/∂ln θ| < 1": found.value[mild],
            "|Δε²|/(8 eps (1 + Σ|∂ε²/∂ln θ|))": found.value / fair,
            "|Δ(θ ∂ε²/∂θ)|": found.slope,
            "|Δ(θ ∂ε²/∂θ)|, Σ|∂ε²/∂ln θ| < 1": found.slope[mild],
        }.items():
            print(f"  {label:34}" + "".join(f"{np.quantile(values, q):10.1e}" for q in SHARES))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=200_000)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    sj.enable_x64()
    _print_boxes(arguments.samples, arguments.seed)
    for route in (sj.EnergyBalance(), sj.ODE(rtol=1e-6)):
        for name in cases.MATERIALS:
            worst = (of_material(name, form, route) for form in cases.FORMS)
            print(f"{name}, {route.name}: |Δε| " + ", ".join(f"{e:.1e}" for e in worst))


if __name__ == "__main__":
    main()
