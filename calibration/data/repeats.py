"""The mean of repeats at one velocity, and how well it is known."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from calibration.data.checks import codes_of
from calibration.data.kinds import REPEATS, three
from calibration.data.point_errors import PointErrors, paired
from calibration.errors import DataError

Values = Float[np.ndarray, " n"]
ALIKE = 1e-14  # equal readings differ from their mean by rounding alone


def average(velocity: Values, restitution: Values, errors: PointErrors, group=None):
    """Average the readings of one group at equal velocities; see `RestitutionData.averaged`.

    Returns m means by velocity, their errors, the degrees of freedom of the pooled scatter (None where
    uncertainties are stated or unknown), and the first reading of each.
    """
    if errors.shares:
        accepted = "left out for bounce sequences, whose points share intervals"
        raise DataError("average of repeats", "requested", accepted)
    of, rows = _repeats(velocity, group)
    counts = np.bincount(of)

    def total(values) -> Values:
        return np.bincount(of, weights=np.broadcast_to(values, of.shape))

    stated = errors.uncertainty
    if stated is None:
        weight = 1 / counts[of]
    else:
        smallest = np.full(len(counts), np.inf)
        np.minimum.at(smallest, of, stated)
        weight = (smallest[of] / stated) ** 2  # no smaller number is squared
        weight = weight / total(weight)[of]
    mean = total(weight * restitution)
    sizes = errors.sizes_at(0.0)
    to_eps, to_v = errors.to_restitution * sizes, errors.to_velocity * sizes
    of_eps: Values | None
    of_eps, of_v = (
        total(
            weight**2 * (np.sum(part**2, axis=1) + (0.0 if independent is None else independent**2))
        )
        for part, independent in ((to_eps, errors.u_restitution), (to_v, errors.u_velocity))
    )
    joint = total(weight**2 * np.sum(to_eps * to_v, axis=1))
    degrees = None
    if stated is None:
        residual = restitution - mean[of]
        left = len(of) - len(counts)
        degrees = left if left and np.max(np.abs(residual)) >= ALIKE else None
        of_eps = None if degrees is None else np.sum(residual**2) / left / counts
    known = errors.velocity_uncertainty is not None
    of_means = _errors_of(of_eps, of_v, joint, known)
    if errors.by_drag is not None:
        by_drag = np.stack([total(weight * column) for column in errors.by_drag.T], axis=1)
        of_means = replace(of_means, by_drag=by_drag)
    return mean, of_means, degrees, rows


def _repeats(velocity: Values, group) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " m"]]:
    """The mean that each reading is of, readings at exactly equal velocities of one group, and firsts."""
    codes = np.zeros(len(velocity)) if group is None else codes_of(group)
    both = np.stack([velocity, codes], axis=1)
    _, rows, of = np.unique(both, axis=0, return_index=True, return_inverse=True)
    return of.ravel(), rows


def _errors_of(of_eps: Values | None, of_v: Values, joint: Values, velocity_known: bool):
    """Errors of these variances and covariance: two input ones a point, where ε and v share."""
    if not np.any(joint):
        u_eps = None if of_eps is None else np.sqrt(of_eps)
        return PointErrors.independent(len(of_v), u_eps, np.sqrt(of_v) if velocity_known else None)
    spread = np.sqrt(of_v)
    common = joint / np.where(spread > 0, spread, 1.0)
    rest = np.sqrt(np.maximum(of_eps - common**2, 0.0))
    sizes = np.ones(2 * len(of_v))
    return PointErrors(paired(len(of_v)), three(common, rest), three(spread), sizes, REPEATS.name)
