"""Confidence bands of fitted curves: the covariance carried through exact derivatives."""

from dataclasses import replace

import jax
import numpy as np

from calibration.assemble import LEAVES, Z_PADDING
from calibration.data.checks import require
from calibration.estimate import Band
from calibration.impacts import Model
from calibration.material_fit import MaterialFit
from calibration.objective import NO_REBOUND_BELOW, PADDING, Noise, Observations
from calibration.parameters import COLUMNS, NONE, Layout, column
from calibration.problem import Problem
from calibration.result import FitResult
from calibration.uncertainty import quantile

ACTING = {
    "empirical": ("sigma", "psi", "limit_velocity"),
    "constant": ("restitution",),
}


def band(
    result: FitResult, material: MaterialFit, velocity, confidence: float, empirical: bool = False
) -> Band:
    """ε(v) with its band; directions that the data do not determine are left out of it."""
    velocity = np.asarray(velocity, float)
    flat = velocity.ravel()
    require("velocity", flat, lambda v: v >= 0, "a speed of 0 m/s or more")
    kind = "empirical" if empirical else material.plan
    if kind in ("two-step", "model"):
        kind = "model"
    labels = _labels(result, material, kind)
    with jax.enable_x64(True):
        value, slope = _curve_and_slope(material, tuple(labels), flat, kind)
    error = _propagated(result, list(labels.values()), slope)
    g = result.materials.index(material)
    reach = quantile(confidence, result.degrees[g]) * error
    parts = (value, value - reach, value + reach, error)
    return Band(velocity, *(part.reshape(velocity.shape) for part in parts))


def _labels(result: FitResult, material: MaterialFit, kind: str) -> dict[str, str]:
    """Which covariance name belongs to which of the material's free parameters."""
    names = {}
    for name, estimate in material.parameters.items():
        acts = name in ACTING.get(kind, tuple(material.parameters))
        if estimate.free and acts:
            names[name] = label_of(result, material, name)
    return {name: label for name, label in names.items() if label in result.covariance_names}


def label_of(result: FitResult, material: MaterialFit, name: str) -> str:
    """The covariance's name for a parameter: its own, a shared one's, or the line's."""
    own = f"{name}[{material.name}]"
    if own in result.covariance_names:
        return own
    shared = [n for n in result.covariance_names if n.startswith(f"{name}[")]
    groups = result.settings.get("shared", {})
    for label in shared:
        if material.name in groups.get(label, []):
            return label
    return name


def _curve_and_slope(material, names, velocity, kind):
    """ε and its slopes in the named parameters, (n,) and (n, p), by the fit's own functions."""
    layout, theta = _layout(material, names)
    obs = _observations(material, velocity)
    noise = Noise(np.ones(PADDING), np.zeros_like(theta), np.zeros_like(theta))
    problem = Problem(layout, obs, noise, _model(material), kind, "squared", theta, np.arange(0))
    problem = replace(problem, active=np.arange(len(names)))
    values, slopes = [], []
    for first in range(0, len(velocity), PADDING):
        part = replace(problem, obs=_part(obs, first))
        _, jacobian, curve = part.linearised(theta, part.expansion(theta))
        values.append(curve)
        slopes.append(jacobian[:PADDING, : len(names)])
    value, slope = (np.concatenate(p)[: len(velocity)] for p in (values, slopes))
    rebounds = value > NO_REBOUND_BELOW
    return np.where(rebounds, value, 0.0), np.where(rebounds[:, None], slope, 0.0)


def _layout(material: MaterialFit, names) -> tuple[Layout, np.ndarray]:
    """The material's parameters as they are, no transform: slopes are those in physical units."""
    size = Z_PADDING * -(-max(len(names), 1) // Z_PADDING)
    columns = material.columns
    index = np.full((1, len(COLUMNS)), -1)
    for position, name in enumerate(names):
        index[0, column(name)] = position
    theta = np.ones(size)
    theta[: len(names)] = [columns[name] for name in names]
    open_ends = np.full(size, np.inf)
    on_line, up_given = "c1" in columns, "eps_up" in columns
    layout = Layout(
        fixed=np.array([[columns.get(name, 1.0) for name in COLUMNS]]),
        index=index,
        kind=np.full(size, NONE),
        lower=-open_ends,
        upper=open_ends,
        on_line=np.array([on_line]),
        up_given=np.array([up_given]),
    )
    return layout, theta


def _observations(material: MaterialFit, velocity) -> Observations:
    """Impacts at these velocities on the fitted contact; below its yield they are elastic."""
    count = len(velocity)
    own = dict.fromkeys(LEAVES, np.ones(count))
    elastic = np.zeros(count, bool)
    if material.contact is not None:
        leaves = material.contact.leaves()
        own = {name: np.broadcast_to(leaf, count) for name, leaf in leaves.items()}
        elastic = velocity <= np.asarray(material.contact.critical_velocity)
    elif material.data.limit_velocity is not None:
        own["limit_velocity"] = np.broadcast_to(material.data.limit_velocity, count)
    zero = np.zeros(count)
    group = np.zeros(count, int)
    return Observations(
        velocity=velocity, restitution=zero, weight=zero + 1, group=group, elastic=elastic, **own
    )


def _part(obs: Observations, first: int) -> Observations:
    """`PADDING` points from the first on, the last ones filled up by copies."""
    own = np.resize(np.arange(first, min(first + PADDING, len(obs.velocity))), PADDING)
    return Observations(*(a[own] for a in obs))


def _model(material: MaterialFit) -> Model:
    area = "zhou" if material.data.contact is None else material.data.contact.area
    return Model(material.form, material.kappa, area)


def _propagated(result: FitResult, labels: list[str], slope) -> np.ndarray:
    """√(J C Jᵀ) at each velocity."""
    rows = [result.covariance_names.index(label) for label in labels]
    covariance = np.nan_to_num(result.covariance[np.ix_(rows, rows)])
    variance = np.einsum("...i,ij,...j->...", slope, covariance, slope)
    return np.sqrt(np.maximum(variance, 0.0))
