"""Confidence bands of fitted curves: the covariance carried through exact derivatives."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

import softjax as sj
from calibration.objective import extended_root
from calibration.result import Band, FitResult, MaterialFit
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
    kind = "empirical" if empirical else material.plan
    columns = dict(material.columns)
    if kind in ("two-step", "model"):
        kind = "model"
    labels = _labels(result, material, kind)
    with jax.enable_x64(True):
        value, slope = _curve_and_slope(material, columns, tuple(labels), velocity, kind)
    error = _propagated(result, list(labels.values()), slope)
    g = result.materials.index(material)
    reach = quantile(confidence, result.degrees[g]) * error
    return Band(velocity, value, value - reach, value + reach, error)


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


def _curve_and_slope(material, columns, names, velocity, kind):
    theta = np.array([columns[name] for name in names], float)
    leaves = {}
    if material.contact is not None:
        leaves = {k: np.asarray(v, float) for k, v in material.contact.leaves().items()}
    area = "zhou" if material.data.contact is None else material.data.contact.area
    value, slope = _expanded(
        theta,
        {k: float(v) for k, v in columns.items()},
        leaves,
        velocity,
        names=names,
        static=(kind, "eps_up" in material.parameters, material.form, material.kappa, area),
    )
    return np.asarray(value), np.asarray(slope)


@partial(jax.jit, static_argnames=("names", "static"))
def _expanded(theta, columns, leaves, velocity, names, static):
    def curve(theta):
        value = _curve(columns | dict(zip(names, theta, strict=True)), leaves, velocity, static)
        return value, value

    slope, value = jax.jacfwd(curve, has_aux=True)(theta)
    return value, slope


def _curve(columns, leaves, velocity, static):
    kind, up_given, form, kappa, area = static
    if kind == "constant":
        return columns["restitution"] + 0 * velocity
    limit = columns["limit_velocity"]
    if kind == "empirical":
        return sj.empirical_restitution(velocity, limit, columns["sigma"], columns["psi"])
    fitted = {k: columns[k] for k in ("yield_strength", "youngs_modulus", "limit_velocity")}
    leaves = {k: fitted.get(k, v) if np.ndim(v) == 0 else v for k, v in leaves.items()}
    contact = sj.Contact(**leaves, area=area)
    chi = columns["chi"]
    if "c1" in columns:
        chi = columns["c1"] + columns["c2"] * contact.yield_ratio  # Eq. (18)
    law = sj.Zhou(contact, chi, columns["sigma"], columns["psi"], form, kappa)
    curve = sj.restitution(law, velocity)
    if not up_given:
        return curve.coefficient
    above = extended_root(curve.plastic_coefficient**2 + columns["eps_up"] ** 2 - 1)
    return jnp.where(velocity <= contact.critical_velocity, columns["eps_up"], above)


def _propagated(result: FitResult, labels: list[str], slope) -> np.ndarray:
    """√(J C Jᵀ) at each velocity."""
    rows = [result.covariance_names.index(label) for label in labels]
    covariance = np.nan_to_num(result.covariance[np.ix_(rows, rows)])
    variance = np.einsum("...i,ij,...j->...", slope, covariance, slope)
    return np.sqrt(np.maximum(variance, 0.0))
