"""Where a rate-independent collision is put together: the same way by either route.

A route gives pieces (`parts.Pieces`), the law its hooks: where loading ends, what remains, whether
the unloading force vanishes, kinks, the range it was derived for. Here, and nowhere else, they meet.
"""

from functools import partial

import jax.numpy as jnp
from jaxtyping import Array, Bool

from softjax import energy
from softjax._impacts import over_impacts
from softjax.laws.reduced import Reduced, ReducedClosedForm, ReducedRateIndependent
from softjax.outcome import Outcome, outcome, shrunk
from softjax.parts import Pieces
from softjax.routes import EnergyBalance, Stepping


def collide(impacts: Reduced, route: EnergyBalance | Stepping) -> Outcome:
    """Collisions beyond the elastic stage.

    Where there is no turning point the overlaps are where the loading force vanishes, or zero, and
    ε_p is zero, without a gradient; where the solver gave up everything is zero.
    """
    return _each(_collide, impacts, route)


def duration(impacts: Reduced, route: EnergyBalance | Stepping) -> tuple[Array, Bool[Array, "..."]]:
    """Contact duration [L/V] of collisions beyond the elastic stage, and whether there is one."""
    return _each(_duration, impacts, route)


def _each(what, impacts: Reduced, route: EnergyBalance | Stepping):
    """`what(pieces, law, y, below)` for all impacts."""
    law, y, below = impacts.law, impacts.y, impacts.below
    if isinstance(route, Stepping):
        from softjax import collision  # diffrax is imported when the ODE is asked for

        def by_time(law, y, below, route):
            return what(collision.pieces(law, route, y.dtype), law, y, below)

        batch = law, y, below, route
        return over_impacts(by_time, batch, forward=True)
    if isinstance(law, ReducedClosedForm):
        return what(energy.closed_forms(y.dtype), law, y, below)
    pieces = energy.quadratures(y.dtype)
    return over_impacts(partial(what, pieces), (law, y, below), forward=False)


def _collide(pieces: Pieces, law: ReducedRateIndependent, y: Array, below: Array | None) -> Outcome:
    peak = pieces.loading(law, y)
    release = pieces.release(law, peak.overlap)
    back = pieces.energy(law, peak, release)
    return outcome(law, peak, release, back, below, pieces.gain)


def _duration(pieces: Pieces, law: ReducedRateIndependent, y: Array, below: Array | None):
    peak = pieces.loading(law, y, clock=True)
    release = pieces.release(law, peak.overlap)
    fall = pieces.time(law, peak, release)
    ends = peak.turns & peak.solved & fall.solved
    pace = 1.0 if below is None else shrunk(law, peak.overlap, below) / _positive(below)
    return jnp.where(ends, (peak.time + fall.value) * pace, 0.0), ends


def _positive(below):
    return jnp.where(below > 0, below, 1.0)
