"""`scipy.integrate.solve_ivp` in a Python loop, with events."""

import numpy as np
from scipy.integrate import solve_ivp

from calibration.speed.scene import Scene
from calibration.speed.ways import Way


def scipy_loop(scene: Scene, batch: int, method: str, rtol: float) -> Way:
    d, steepness, _ = scene.reduced()
    critical = scene.contact.critical_velocity

    def value(velocity):
        return np.array([_one(d, steepness, y, method, rtol) for y in velocity / critical])

    return Way("SciPy loop", f"{method}, rtol {rtol:.0e}", batch, value)


def _one(d, steepness, y, method, rtol):
    def loading(t, state):
        x, u = state
        s = max(x, 0.0) ** 0.5
        force = x * s + (d * (x * x - 1) * (1 - s) if x > 1 else 0.0)
        return u, -1.25 * force

    def stopped(t, state):
        return state[1]

    stopped.terminal = True
    tolerances = {"method": method, "rtol": rtol, "atol": rtol * np.array([y**0.8, y])}
    solution = solve_ivp(loading, (0.0, 10.0), (0.0, y), events=stopped, **tolerances)
    x_m = solution.y_events[0][0][0]

    def force(x):
        s = max(x, 0.0) ** 0.5
        line = 1 - steepness * (1 - x / x_m)
        return (1 - d * x_m) * x * s + d * s + d * (x_m * x_m - 1) * line

    def unloading(t, state):
        return state[1], -1.25 * force(state[0])

    def released(t, state):
        return force(state[0])

    released.terminal = True
    solution = solve_ivp(unloading, (0.0, 10.0), (x_m, 0.0), events=released, **tolerances)
    return -solution.y_events[0][0][1] / y
