"""What is known of a rate-independent collision, from its peak, its release and its rebound."""

from typing import NamedTuple

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool

from softjax._numerics import safe_power
from softjax.laws.reduced import ReducedRateIndependent
from softjax.parts import Peak, Rebound
from softjax.release import Release

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


def outcome(
    law: ReducedRateIndependent,
    peak: Peak,
    release: Release,
    back: Rebound,
    below: Array | None,
    gain: Array | float,
) -> Outcome:
    """The law's hooks and what a route computed, put together: the same way by either route.

    Args:
        back: ε_p².
        below: y over that of the lifted impact, of laws that act down to rest.
        gain: see `Pieces`.
    """
    solved = peak.solved & ((back.solved & jnp.isfinite(back.value)) | ~peak.turns)
    answered = peak.turns & solved
    end = lax.stop_gradient(jnp.where(solved, peak.end, 0.0))
    error = peak.error + back.error
    far = shrunk(law, peak.overlap, below)
    return Outcome(
        peak=jnp.where(answered, peak.overlap * far, end),
        residual=jnp.where(answered, release.residual * far, end),
        plastic_squared=jnp.where(answered, back.value, 0.0),
        turns=peak.turns,
        solved=solved,
        exact=(error <= SETTLED[str(peak.velocity.dtype)]) & release.clean,
        released=release.released,
        beyond=law.beyond_expansion(jnp.where(answered, peak.overlap, end)),
        gains=back.value > 1 + gain + back.error,
    )


def shrunk(law, peak: Array, below: Array | None):
    """Overlaps of slow impacts over those of the lifted ones, by the power law near rest."""
    return 1.0 if below is None else safe_power(below, 2 / law.exponent_at(peak))
