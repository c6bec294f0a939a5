"""Which ways are measured, in which order."""

from collections.abc import Callable, Iterator
from functools import partial
from importlib.util import find_spec

import softjax as sj
from calibration.speed import energy_numba, plain_diffrax, scipy_loop, verlet
from calibration.speed.scene import Scene
from calibration.speed.ways import Way, energy_balance, ode

BATCH = 4096
LARGE = 1_000_000
FEW = 16  # of the slow loops in Python
# with their gradients, or without
ROUTES: list[tuple[sj.ODE, bool]] = [
    (sj.ODE(solver="dopri5", steps=2), True),
    (sj.ODE(rtol=1e-8), True),
    (sj.ODE(solver="dopri5", steps=1), False),
    (sj.ODE(solver="bosh3", steps=4), False),
    (sj.ODE(solver="dopri8", steps=2), True),
    (sj.ODE(solver="tsit5", rtol=1e-5), False),
    (sj.ODE(rtol=1e-12), False),
]


def plan(scene: Scene, quick: bool) -> Iterator[Callable[[], Way]]:
    """Ways as functions that build them.

    The energy balance and its rival come last, next to each other: some machines lend all their
    cores in full only after seconds of work.
    """
    numba = find_spec("numba") is not None
    for route, gradient in ROUTES[:1] if quick else ROUTES:
        yield partial(ode, scene, BATCH, route, gradient and not quick)
    if not quick:
        yield partial(ode, scene, BATCH, sj.ODE(solver="dopri5", steps=2), precision="float32")
    for method in ("DOP853",) if quick else ("DOP853", "LSODA"):
        for rtol in (1e-6, 1e-8) if quick else (1e-4, 1e-6, 1e-8, 1e-11):
            yield partial(scipy_loop.scipy_loop, scene, FEW, method, rtol)
    for rtol in (1e-6,) if quick else (1e-4, 1e-6, 1e-8):
        yield partial(plain_diffrax.plain_diffrax, scene, BATCH, rtol, rtol == 1e-6 and not quick)
    for steps in () if quick else (30, 100, 1000):
        yield partial(verlet.verlet_jax, scene, BATCH, steps)
    if numba:
        for steps in (100, 1000) if quick else (30, 100, 300, 1000, 3000, 10_000):
            yield partial(verlet.verlet_numba, scene, BATCH, steps)
    if not quick:
        yield partial(energy_balance, scene, BATCH, precision="float32")
        yield partial(energy_balance, scene, BATCH)
        for batch in (1, 100, 100_000):
            yield partial(energy_balance, scene, batch, gradient=False)
    yield partial(energy_balance, scene, LARGE, gradient=not quick)
    yield partial(energy_balance, scene, LARGE, gradient=False, overlaps=False)
    if numba:
        for batch in (LARGE,) if quick else (LARGE, BATCH):
            yield partial(energy_numba.energy_numba, scene, batch)
    if not quick:
        yield partial(energy_balance, scene, 10 * LARGE)
