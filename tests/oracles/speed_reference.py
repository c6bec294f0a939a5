"""Exact answers for the speed benchmark: `python -m tests.oracles.speed_reference` writes them.

Stainless steel of Table 1 with its fitted unloading factor, first-order form, at 128 impact
velocities between 1.5 and 250 times the critical one.
"""

import json
import os
from pathlib import Path

from mpmath import mp

from tests.oracles import zhou_mp as z

TARGET = Path(__file__).parents[2] / "calibration" / "speed" / "exact.json"
MATERIAL = {"E": "1.93e11", "nu": "0.35", "rho": "8030", "Y": "3.10e8", "R": "0.0127"}
CHI, SIGMA, PSI = 1.7944, 3.0432, 0.54
NAMES = ("chi", "E", "Y")


def effective_inputs() -> dict:
    """The contact's five leaves and the law's three numbers as the floats a program would use."""
    m = MATERIAL
    sphere = (m["E"], m["nu"], m["rho"], m["Y"], m["R"])
    contact = z.contact(*sphere, *sphere, area="zhou")
    leaves = {name: float(contact[name]) for name in ("E", "R", "M", "Y", "v_lim")}
    law = {"chi": CHI, "sigma": SIGMA, "psi": PSI, "area": "zhou"}
    return leaves | law | {"form": "first-order", "kappa": "consistent"}


def one(inputs: dict, velocity: float) -> dict:
    full = inputs | {"v": velocity}
    answer = z.coefficient(full, duration=False)
    slopes = z.log_sensitivities(full, NAMES)
    with mp.workdps(30):
        twice = 2 * answer["eps_p"]
        log = {n: mp.nstr(slopes[n]["eps_p_squared"] / twice, 20) for n in NAMES}
        return {"velocity": velocity, "eps_p": mp.nstr(answer["eps_p"], 20), "slopes": log}


def main() -> None:
    inputs = effective_inputs()
    critical = float(z.dimensionless(inputs | {"v": 1.0})["v_cr"])
    ratios = [1.5 + (250 - 1.5) * i / 127 for i in range(128)]
    rows = [one(inputs, critical * ratio) for ratio in ratios]
    text = json.dumps({"inputs": inputs, "rows": rows}, indent=1)
    beside = TARGET.with_suffix(".tmp")
    beside.write_text(text + "\n")
    os.replace(beside, TARGET)


if __name__ == "__main__":
    main()
