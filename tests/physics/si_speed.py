"""Laws written in SI against the built-in ones, by the ODE, in time: `python -m tests.physics.si_speed`.

Processor time alternates between the two, so that a busy machine slows both; the smallest of each
counts. Compilation is told beside it.
"""

import time

import jax
import numpy as np

import softjax as sj
from tests.physics.own_laws import PAIRS, STEEL

COUNT = 4096
REPEATS = 15
ROUTE = sj.ODE()
VELOCITY = float(STEEL.critical_velocity) * np.geomspace(1.5, 250.0, COUNT)


def run() -> dict[str, tuple[float, ...]]:
    """By law: µs a collision in SI and built in, and seconds of the first call of each."""
    found = {}
    for name, laws in PAIRS.items():
        first = [_seconds(law) for law in laws]
        each = [[_seconds(law) for law in laws] for _ in range(REPEATS)]
        fastest = np.min(each, axis=0) / COUNT * 1e6
        found[name] = (*fastest.tolist(), *first)
    return found


def _seconds(law) -> float:
    start = time.process_time()
    jax.block_until_ready(sj.restitution(law, VELOCITY, ROUTE).coefficient)
    return time.process_time() - start


if __name__ == "__main__":
    sj.enable_x64()
    print(f"{'law':16}{'SI, µs':>10}{'built in, µs':>14}{'ratio':>8}{'first calls, s':>18}")
    for name, (one, other, begun, began) in run().items():
        print(f"{name:16}{one:10.2f}{other:14.2f}{one / other:8.2f}{begun:12.1f}{began:6.1f}")
