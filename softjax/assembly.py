"""Where a rate-independent collision is put together: the same way by either route.

A route gives pieces (`parts.Pieces`), the law its hooks: where loading ends, what remains, whether
the unloading force vanishes, kinks, the range it was derived for. Here, and nowhere else, they meet.
"""

from functools import partial
from typing import NamedTuple

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool

from softjax import energy
from softjax._impacts import over_impacts, recomputed_in_rows
from softjax._numerics import safe_power
from softjax.laws.reduced import Reduced, ReducedClosedForm, ReducedRateIndependent
from softjax.parts import Pieces
from softjax.routes import EnergyBalance, Stepping

SETTLED = {"float64": 1e-10, "float32": 1e-5}  # of the impact's energy


class Outcome(NamedTuple):
    """A collision as either route computes it, in reduced variables or in metres; over impacts.

    Attributes:
        peak: x_m, the largest overlap.
        residual: x*, where the unloading force vanishes; 0 where it does not.
        plastic_squared: ε_p², the part of the impact energy that the force gives back.
        turns: whether the bodies ever come to rest against each other.
        solved: whether the solver got there.
        exact: whether quadratures settled.
        released: whether the unloading force vanishes at some positive overlap.
        beyond: whether the law was pushed beyond the range it was derived for.
        gains: whether more is given back than was taken, beyond what rounding does.
    """

    peak: Array
    residual: Array
    plastic_squared: Array
    turns: Bool[Array, "..."]
    solved: Bool[Array, "..."]
    exact: Bool[Array, "..."]
    released: Bool[Array, "..."]
    beyond: Bool[Array, "..."]
    gains: Bool[Array, "..."]


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
        return over_impacts(by_time, batch, collision.forward_differentiated)
    if isinstance(law, ReducedClosedForm):
        return what(energy.closed_forms(y.dtype), law, y, below)
    pieces = energy.quadratures(y.dtype)
    around = recomputed_in_rows(energy.IN_CACHE)
    return over_impacts(partial(what, pieces), (law, y, below), around)


def _collide(pieces: Pieces, law: ReducedRateIndependent, y: Array, below: Array | None) -> Outcome:
    peak = pieces.loading(law, y)
    release = pieces.release(law, peak.overlap)
    back = pieces.energy(law, peak, release)
    solved = peak.solved & (back.solved | ~peak.turns)
    answered = peak.turns & solved
    end = lax.stop_gradient(jnp.where(solved, peak.end, 0.0))
    error = peak.error + back.error
    far = _shrunk(law, peak.overlap, below)
    return Outcome(
        peak=jnp.where(answered, peak.overlap * far, end),
        residual=jnp.where(answered, release.residual * far, end),
        plastic_squared=jnp.where(answered, back.value, 0.0),
        turns=peak.turns,
        solved=solved,
        exact=(error <= SETTLED[str(y.dtype)]) & release.clean,
        released=release.released,
        beyond=law.beyond_expansion(jnp.where(answered, peak.overlap, end)),
        gains=back.value > 1 + pieces.gain + back.error,
    )


def _duration(pieces: Pieces, law: ReducedRateIndependent, y: Array, below: Array | None):
    peak = pieces.loading(law, y, clock=True)
    release = pieces.release(law, peak.overlap)
    fall = pieces.time(law, peak, release)
    ends = peak.turns & peak.solved & fall.solved
    pace = 1.0 if below is None else _shrunk(law, peak.overlap, below) / _positive(below)
    return jnp.where(ends, (peak.time + fall.value) * pace, 0.0), ends


def _positive(below):
    return jnp.where(below > 0, below, 1.0)


def _shrunk(law: ReducedRateIndependent, peak: Array, below: Array | None):
    """Overlaps of slow impacts over those of the lifted ones, by the power law near rest."""
    return 1.0 if below is None else safe_power(below, 2 / law.exponent_at(peak))
