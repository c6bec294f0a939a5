"""Exact answers for `softjax speed`: `python -m tests.oracles.speed_reference` writes them.

Stainless steel of Table 1 with its fitted unloading factor, first-order form, at 128 impact
velocities between 1.5 and 250 times the critical one; and as viscoelastic spheres, w² between 0.03
and 0.6.
"""

import json
from pathlib import Path

from mpmath import mp, mpf

from tests.oracles import closed_forms
from tests.oracles import zhou_mp as z

FILE = Path(__file__).parents[2] / "calibration" / "speed.json"
SPHERE = ("1.93e11", "0.35", "8030", "3.10e8", "0.0127")
NAMES = ("chi", "E", "Y")
LEAVES = ("E", "R", "M", "Y", "v_lim")
COUNT, SLOWEST, FASTEST, TIME = 32, 1e-3, 1e3, 4e-6


def effective_inputs() -> dict:
    """The contact's five leaves and the law's three numbers as the floats a program would use."""
    contact = z.contact(*SPHERE, *SPHERE, area="zhou")
    law = {"chi": 1.7944, "sigma": 3.0432, "psi": 0.54, "area": "zhou"}
    leaves = {name: float(contact[name]) for name in LEAVES}
    return leaves | law | {"form": "first-order", "kappa": "consistent"}


def plastic(inputs: dict, velocity: float) -> list:
    """Velocity, ε_p and θ ∂ε_p/∂θ by `NAMES`."""
    full = inputs | {"v": velocity}
    answer = z.coefficient(full, lasts=False)
    slopes = z.log_sensitivities(full, NAMES)
    with mp.workdps(30):
        twice = 2 * answer["eps_p"]
        log = [slopes[n]["eps_p_squared"] / twice for n in NAMES]
        return [velocity, *(mp.nstr(x, 20) for x in (answer["eps_p"], *log))]


def damped(inputs: dict, velocity: float) -> list:
    """Velocity, ε and its slope by ln w²."""
    with mp.workdps(closed_forms.DIGITS):
        E, R, M = (mpf(inputs[name]) for name in ("E", "R", "M"))
        rate = (mpf(4) / 3 * E * mp.sqrt(R) / M) ** mpf("0.4")
        b = mpf("1.5") * mpf(TIME) * rate * mpf(velocity) ** mpf("0.2")
        step = mpf("1e-18")
        up, here, down = (
            closed_forms.of_squared(b * (1 + k * step)).restitution for k in (1, 0, -1)
        )
        return [velocity, *(mp.nstr(x, 20) for x in (here, (up - down) / (2 * step)))]


def as_json(name: str, inputs: dict, rows: list) -> str:
    """One row a line."""
    lines = ",\n".join(json.dumps(row) for row in rows)
    return f'"{name}": {{"inputs": {json.dumps(inputs)}, "rows": [\n{lines}\n]}}'


def main() -> None:
    inputs = effective_inputs()
    critical = float(z.dimensionless(inputs | {"v": 1.0})["v_cr"])
    ratios = [1.5 + (250 - 1.5) * i / 127 for i in range(128)]
    zhou = as_json("zhou", inputs, [plastic(inputs, critical * ratio) for ratio in ratios])
    inputs = {name: inputs[name] for name in LEAVES}
    velocities = [SLOWEST * (FASTEST / SLOWEST) ** (i / (COUNT - 1)) for i in range(COUNT)]
    rows = [damped(inputs, v) for v in velocities]
    other = as_json("viscoelastic", inputs | {"dissipation_time": TIME}, rows)
    FILE.write_text(f"{{\n{zhou},\n{other}\n}}\n", encoding="utf-8")


if __name__ == "__main__":
    main()
