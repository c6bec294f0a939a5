"""Exact answers for the speed of laws with damping: `python -m tests.oracles.speed_damped`.

Viscoelastic spheres of Table 1's stainless steel, w² between 0.03 and 0.6.
"""

import json
from pathlib import Path

import mpmath as mp

from tests.oracles import closed_forms
from tests.oracles.speed_reference import effective_inputs

TARGET = Path(__file__).parents[2] / "calibration" / "speed" / "exact_damped.json"
COUNT, SLOWEST, FASTEST = 32, 1e-3, 1e3
TIME = 4e-6


def row(inputs: dict, velocity: float) -> dict:
    with mp.workdps(closed_forms.DIGITS):
        x = {name: mp.mpf(inputs[name]) for name in ("E", "R", "M")}
        rate = (mp.mpf(4) / 3 * x["E"] * mp.sqrt(x["R"]) / x["M"]) ** mp.mpf("0.4")
        b = mp.mpf("1.5") * mp.mpf(TIME) * rate * mp.mpf(velocity) ** mp.mpf("0.2")
        step = mp.mpf("1e-18")
        up, here, down = (
            closed_forms.of_squared(b * (1 + k * step)).restitution for k in (1, 0, -1)
        )
        slope = (up - down) / (2 * step)
        told = {"w_squared": b, "restitution": here, "slope": slope}
        return {"velocity": velocity} | {name: mp.nstr(v, 20) for name, v in told.items()}


def main() -> None:
    every = effective_inputs()
    inputs = {name: every[name] for name in ("E", "R", "M", "Y", "v_lim")}
    ratio = FASTEST / SLOWEST
    velocities = [SLOWEST * ratio ** (i / (COUNT - 1)) for i in range(COUNT)]
    rows = [row(inputs, v) for v in velocities]
    told = {"inputs": inputs | {"dissipation_time": TIME}, "rows": rows}
    TARGET.write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
