"""The mean of repeats at one velocity, and how well it is known."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from calibration.data.checks import codes_of
from calibration.data.errors_of_points import PointErrors, paired, three
from calibration.errors import DataError

Values = Float[np.ndarray, " n"]
Means = Float[np.ndarray, " m"]
ALIKE = 1e-14  # equal readings differ from their mean by rounding alone


class Repeats(NamedTuple):
    """n readings in m sets of repeats: the set of each, and how many there are in each."""

    of: Int[np.ndarray, " n"]
    counts: Int[np.ndarray, " m"]

    def sum(self, values: Values) -> Means:
        return np.bincount(self.of, weights=values, minlength=len(self.counts))


class Averaged(NamedTuple):
    """m means, in the order of their velocity, the first reading of each, and degrees of freedom.

    `degrees` is None where uncertainties are stated or unknown, else that of the scatter, pooled
    over all velocities, that is behind every uncertainty.
    """

    velocity: Means
    restitution: Means
    errors: PointErrors
    degrees: int | None
    rows: Int[np.ndarray, " m"]


def average(velocity: Values, restitution: Values, errors: PointErrors, group=None) -> Averaged:
    """Average the readings of one group at equal velocities; see `RestitutionData.averaged`.

    Raises:
        DataError: where readings share errors with each other.
    """
    if errors.shares:
        accepted = "left out for bounce sequences, whose points share intervals"
        raise DataError("average of repeats", "requested", accepted)
    repeats, rows = _repeats(velocity, group)
    of_eps, of_v, joint = errors.moments()
    if errors.uncertainty is None:
        weight = 1 / repeats.counts[repeats.of]
    else:
        least = np.full(len(repeats.counts), np.inf)
        np.minimum.at(least, repeats.of, errors.uncertainty)
        weight = (least[repeats.of] / errors.uncertainty) ** 2  # no smaller number is squared
        weight = weight / repeats.sum(weight)[repeats.of]
    mean = repeats.sum(weight * restitution)
    moments = [repeats.sum(weight**2 * one) for one in np.broadcast_arrays(of_eps, of_v, joint)]
    degrees = None
    if errors.uncertainty is None:
        moments[0], degrees = _scatter(repeats, restitution - mean[repeats.of])
    known = errors.velocity_uncertainty is not None
    found = _errors_of(moments[0], moments[1], moments[2], known)
    if errors.by_drag is not None:
        by_drag = np.stack([repeats.sum(weight * one) for one in errors.by_drag.T], axis=1)
        found = replace(found, by_drag=by_drag)
    return Averaged(velocity[rows], mean, found, degrees, rows)


def _repeats(velocity: Values, group) -> tuple[Repeats, Int[np.ndarray, " m"]]:
    """Readings at exactly equal velocities of one group, in the order of velocity."""
    codes = np.zeros(len(velocity)) if group is None else codes_of(group)
    order = np.lexsort((codes, velocity))
    v, c = velocity[order], codes[order]
    fresh = np.concatenate([[True], (v[1:] != v[:-1]) | (c[1:] != c[:-1])])
    of = np.empty(len(order), int)
    of[order] = np.cumsum(fresh) - 1
    return Repeats(of, np.bincount(of)), order[fresh]


def _scatter(repeats: Repeats, residuals: Values):
    """Variance of each mean from the pooled scatter of all repeats, and its degrees of freedom.

    None where there are no repeats that differ.
    """
    total = int(np.sum(repeats.counts - 1))
    if not total or np.max(np.abs(residuals)) < ALIKE:
        return None, None
    return np.sum(residuals**2) / total / repeats.counts, total


def _errors_of(of_eps: Means | None, of_v: Means, joint: Means, velocity_known: bool):
    """Errors of these variances and covariance: two elementary ones a point, where ε and v share."""
    if not np.any(joint):
        return PointErrors.alone(
            len(of_v),
            None if of_eps is None else np.sqrt(of_eps),
            np.sqrt(of_v) if velocity_known else None,
        )
    spread = np.sqrt(of_v)
    common = joint / np.where(spread > 0, spread, 1.0)
    rest = np.sqrt(np.maximum(of_eps - common**2, 0.0))
    sizes = np.ones(2 * len(of_v))
    index = paired(len(of_v))
    return PointErrors(index, three(common, rest), three(spread), sizes, "repeats")
