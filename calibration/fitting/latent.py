"""Velocities with errors: the true ones are estimated along with the curve.

A measured point (v_m, ε_m) with errors δv and δε belongs to the point of the curve that is nearest in
units of the errors. Around an estimate v of its velocity, with f = ε(v) and its derivatives f', f'',

    e = ε_m - f + f' (v - v_m) = δε - f' δv,     v ← v_m - cov(δv, e) V⁻¹ e,     V = var(e)

Fitting ε_m + f' (v - v_m) at v with weights 1/V until all settles is the likelihood of curve and
velocities together. Its first bias, of the curve's bend over the velocity's remaining uncertainty, is
taken out by + ½ f'' var(δv | e). An uncertainty that goes with the measured velocity (5 % of it) is
taken at the true one: weights that followed δv would pull.

Source: Fuller, Measurement Error Models (1987), sections 3.2 and 3.3.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from calibration.data import PointErrors, RestitutionData

STEP = 3e-3  # of a velocity, in the differences that give dε/dv and d²ε/dv²
FARTHEST = 5.0  # standard errors of a velocity
LEAST_SHARE = 0.2  # of a velocity that is left after all corrections

Column = Float[np.ndarray, "n"]


@dataclass(frozen=True, eq=False)
class Latent:
    """Where the points of a data set are taken to be.

    Attributes:
        velocity: the estimates of the true ones [m/s].
        target: ε to be fitted there.
        slope: dε/dv of the curve there [s/m].
        errors: those of the points, at these velocities.
    """

    velocity: Column
    target: Column
    slope: Column
    errors: PointErrors


def not_moved(data: RestitutionData, slope: Column) -> Latent:
    """As measured, with the errors of the velocities carried into ε."""
    return Latent(data.velocity, data.restitution, slope, data.errors)


def moved(
    data: RestitutionData, at: Latent, curve: "Curve", solved: Column, variance: Column
) -> Latent:
    """Towards the curve.

    Args:
        at: where the points were taken to be.
        curve: ε and its derivatives there.
        solved: V⁻¹ e.
        variance: the diagonal of V.
    """
    _, of_v, joint = at.errors.moments()
    shared = joint - curve.slope * of_v
    spread = np.sqrt(of_v)
    step = np.clip(-shared * solved, -FARTHEST * spread, FARTHEST * spread)
    velocity = np.maximum(data.velocity + step, LEAST_SHARE * data.velocity)
    velocity = np.clip(velocity, curve.lowest, curve.highest)
    bend = 0.5 * curve.bend * np.maximum(of_v - shared**2 / variance, 0.0)
    target = data.restitution + curve.slope * (velocity - data.velocity) + bend
    return Latent(velocity, target, curve.slope, _errors_at(data, velocity))


def residual(data: RestitutionData, at: Latent, curve: "Curve") -> Column:
    """e, see above."""
    return data.restitution - curve.value + curve.slope * (at.velocity - data.velocity)


@dataclass(frozen=True, eq=False)
class Curve:
    """ε, dε/dv and d²ε/dv² at some velocities, and between which velocities they hold."""

    value: Column
    slope: Column
    bend: Column
    lowest: Column
    highest: Column


def _errors_at(data: RestitutionData, velocity: Column) -> PointErrors:
    """The errors of the velocities as the stated ones go with the velocity: as vᵞ, 0 ≤ γ ≤ 1."""
    ratio = (velocity / data.velocity) ** _power(data)
    errors = data.errors
    alone = errors.velocity_alone
    return replace(
        errors,
        velocity_alone=None if alone is None else alone * ratio,
        to_velocity=errors.to_velocity * ratio[:, None],
    )


def _power(data: RestitutionData) -> float:
    """γ of stated u_v ~ vᵞ: 0 for uncertainties that are all alike, 1 for a percentage."""
    assert data.velocity_uncertainty is not None
    told = data.velocity_uncertainty > 0
    x, y = np.log(data.velocity[told]), np.log(data.velocity_uncertainty[told])
    spread = np.sum((x - np.mean(x)) ** 2) if np.any(told) else 0.0
    if not spread > 1e-6:
        return 0.0
    return float(np.clip(np.sum((x - np.mean(x)) * y) / spread, 0.0, 1.0))
