"""The mean of repeats at one velocity, and how well it is known."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

Values = Float[np.ndarray, " n"]
Means = Float[np.ndarray, " m"]


class Repeats(NamedTuple):
    """n readings in m groups: the group of each, and how many there are in each."""

    group: Int[np.ndarray, " n"]
    counts: Int[np.ndarray, " m"]

    def sum(self, values: Values) -> Means:
        return np.bincount(self.group, weights=values, minlength=len(self.counts))


class Averaged(NamedTuple):
    """m means, in the order of their velocity, and the first reading of each."""

    velocity: Means
    restitution: Means
    uncertainty: Means | None
    velocity_uncertainty: Means | None
    rows: Int[np.ndarray, " m"]


def average(
    velocity: Values,
    restitution: Values,
    uncertainty: Values | None,
    velocity_uncertainty: Values | None,
    pooled: bool = False,
) -> Averaged:
    """Average the readings at equal velocities; see `RestitutionData.averaged`.

    The uncertainties of the velocity are taken as independent: √Σu²/n.
    """
    means, rows, group, count = np.unique(
        velocity, return_index=True, return_inverse=True, return_counts=True
    )
    repeats = Repeats(group, count)
    if uncertainty is None:
        mean = repeats.sum(restitution) / count
        error = _standard_error(repeats, restitution - mean[group], pooled)
    else:
        weight = repeats.sum(uncertainty**-2)
        mean = repeats.sum(restitution * uncertainty**-2) / weight
        error = weight**-0.5
    u_v = velocity_uncertainty
    u_v_mean = None if u_v is None else np.sqrt(repeats.sum(u_v**2)) / count
    return Averaged(means, mean, error, u_v_mean, rows)


def _standard_error(repeats: Repeats, residuals: Values, pooled: bool) -> Means | None:
    """s/√n with each velocity's own scatter s, the pooled one where it has none; None without."""
    squares = repeats.sum(residuals**2)
    freedom = repeats.counts - 1
    # readings that are all alike differ from their mean by rounding alone
    if not np.any(freedom) or np.max(np.abs(residuals)) < 1e-14:
        return None
    variance = np.full(len(freedom), np.sum(squares) / np.sum(freedom))
    if not pooled:
        own = squares > 1e-28
        variance[own] = squares[own] / freedom[own]
    return np.sqrt(variance / repeats.counts)
