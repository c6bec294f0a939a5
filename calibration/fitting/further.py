"""Errors of measurements that are not made yet, of the kind that the data are.

A further point is a drop from a height, a pair of velocities, a bounce, or an ε with uncertainties of its
own. Its variance comes from the code that reads measured ones, at its velocity and the ε of the curve.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float

from calibration.data import PointErrors, RestitutionData
from calibration.fitting.errors import Errors
from calibration.fitting.material import MaterialFit
from calibration.observables import RESTITUTION

STEP = 1e-4  # of a velocity, in the differences that give dε/dv
SLOWEST = 1e-6  # of the highest velocity: nothing is dropped from no height
LEAST_REBOUND = 1e-3  # of ε, of a bounce that is planned
ALIKE = 1e-3  # relative spread up to which stated uncertainties count as equal

Column = Float[np.ndarray, "n"]


def further_variances(
    material: MaterialFit,
    velocity: Column,
    curve: Callable[[Column], Column],
    observable: str = RESTITUTION,
) -> dict[str, Column]:
    """Variances of one more measurement at each velocity [m/s], by where they come from.

    Args:
        curve: ε of the fitted law, or the observable, at velocities.
        observable: what is measured; variances of others than ε are relative.
    """
    data, of_data, observed = material.data, material.variances, None
    value = data.restitution[np.isfinite(data.restitution)]
    if observable != RESTITUTION:
        of_data = material.observed[observable].variances
        observed = next(one for one in data.observed if one.name == observable)
        value = observed.value
    errors = Errors.of(data, observed=observed)
    points, timing = errors.points, material.timing
    found = {kind: np.full(len(velocity), mean) for kind, mean in of_data.items()}
    kind = next((name for name in found if name not in ("scatter", "group")), None)
    if kind is None or (points.uncertainty is None and kind != "timing"):
        return found

    def variance(velocity: Column) -> Column:
        down, middle, up = (curve(velocity * (1 + side * STEP)) for side in (-1, 0, 1))
        slope = (up - down) / (2 * STEP * velocity) / (1.0 if observed is None else middle)
        planned = like_measured(points, errors.velocity, value, velocity, middle, timing)
        return planned.covariance(slope).diagonal

    found[kind] = variance(np.maximum(velocity, SLOWEST * np.max(errors.velocity)))
    if kind == "scale":
        found[kind] = found[kind] * of_data[kind] / np.mean(variance(errors.velocity))
    return found


def like_measured(
    errors: PointErrors,
    velocity: Float[np.ndarray, "k"],
    restitution: Float[np.ndarray, "k"],
    at: Column,
    expected: Column,
    timing: float | None = None,
) -> PointErrors:
    """The errors of impacts that are planned, measured as others were.

    Args:
        errors, velocity, restitution: of those that were measured.
        at, expected: v [m/s] and ε of those that are planned.
        timing: standard uncertainty of a time [s] where `errors` state none.
    """

    def like(sizes: Any, was: Any = None, now: Any = None) -> Column:
        """All alike, or the same part of the quantity, or those of points next in velocity."""
        alike = [(np.ones(len(sizes)), np.ones(len(at)))]
        alike += [] if was is None else [(np.where(was > 0, was, np.nan), now)]
        for unit, ours in alike:
            parts = sizes / unit
            if np.ptp(parts) <= ALIKE * np.median(parts):
                return ours * np.median(parts)
        order = np.argsort(velocity, kind="stable")
        return np.interp(at, velocity[order], sizes[order])

    own: dict[str, Any] = {}
    if errors.kind == "repeats":
        return PointErrors.alone(len(at), like(errors.uncertainty))
    if errors.restitution_alone is not None:
        own["uncertainty"] = like(errors.restitution_alone)
    if errors.velocity_alone is not None and errors.kind != "velocities":  # v is one of the two
        own["velocity_uncertainty"] = like(errors.velocity_alone, velocity, at)
    if not errors.kind:
        return PointErrors.alone(len(at), own.get("uncertainty"), own.get("velocity_uncertainty"))
    gravity = _gravity(errors, velocity)
    table = _measured(errors.kind, at, np.maximum(expected, LEAST_REBOUND), gravity)
    told: dict[str, Any] = {"gravity": gravity}
    if errors.kind in ("intervals", "times"):
        per = len(table["launch"]) // len(at)
        own = {name: np.repeat(column, per) for name, column in own.items()}
        told["timing_uncertainty"] = timing if errors.size is None else np.median(errors.size)
    else:
        were = _measured(errors.kind, velocity, restitution, gravity)
        sizes = zip(table, errors.sizes(0.0)[errors.index[:, :2]].T, strict=True)
        own |= {f"{name}_uncertainty": like(u, were[name], table[name]) for name, u in sizes}
    return RestitutionData.from_table(
        table | own, plausibility=False, name="planned", **told
    ).errors


def _gravity(errors: PointErrors, velocity: Float[np.ndarray, "k"]) -> float | None:
    """As the data were read with: v ∂v/∂h of heights is g, ∂v/∂t of times g/2."""
    if errors.kind == "heights":
        return float(np.median(velocity * errors.to_velocity[:, 0]))
    if errors.kind == "velocities":
        return None
    return 2 * float(np.median(np.max(errors.to_velocity, axis=1)))


def _measured(kind: str, velocity: Column, restitution: Column, gravity: Any) -> dict[str, Any]:
    """What is read of impacts, in vacuum; of bounces a launch of two intervals, or three times, each."""
    if kind == "velocities":
        return {"impact_velocity": velocity, "rebound_velocity": restitution * velocity}
    if kind == "heights":
        drop = velocity**2 / (2 * gravity)
        return {"drop_height": drop, "rebound_height": restitution**2 * drop}
    first = 2 * velocity / gravity
    steps = {"interval": [first, restitution * first]}
    if kind == "times":
        steps = {"time": [0 * first, first, first * (1 + restitution)]}
    ((name, rows),) = steps.items()
    launch = np.repeat([str(k) for k in range(len(velocity))], len(rows))
    return {"launch": launch, name: np.transpose(rows).ravel()}
