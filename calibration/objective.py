"""Residuals of Eq. (17) and of the collision model against data, and their derivatives.

The collision enters only through ε_p², which each impact has for itself. It is therefore expanded
impact by impact (`impacts`: value and slopes in χ̃, Y, E, through either route), and the rest, Eqs.
(16) to (18), transforms, weights, loss and priors, is differentiated around it. So one
compiled collision serves every objective, any number of data sets and any parameters.
"""

from functools import partial
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import softjax as sj
from calibration.impacts import PLASTIC_COLUMNS, Model, Points
from calibration.parameters import CONTACT_COLUMNS, Layout, column

PADDING = 64  # numbers of points are rounded up to it, so that most data compile once
TINY_SQUARED = 1e-6  # below this ε² the root is continued by another, see `extended_root`
NO_REBOUND_BELOW = (2 - 2**0.5) * TINY_SQUARED**0.5  # what `extended_root` gives at ε² = 0

Kind = Literal["model", "empirical", "constant"]
KINDS = ("model", "empirical", "constant")


class Observations(NamedTuple):
    """All data sets in one row of points, padded by points of weight 0."""

    velocity: Points
    restitution: Points
    weight: Points  # 1/uncertainty, or 1
    group: np.ndarray  # to which data set a point belongs
    elastic: np.ndarray  # below yield: held while a step is searched
    radius: Points  # the contact's five leaves, at each impact
    mass: Points
    youngs_modulus: Points
    yield_strength: Points
    limit_velocity: Points


class Noise(NamedTuple):
    """Scale of the loss in weighted residuals, and Gaussian priors on the elements of θ."""

    scale: Float[np.ndarray, "points"]  # tuning constant times one standard deviation
    prior_mean: np.ndarray
    prior_precision: np.ndarray  # 1/standard deviation, 0 without a prior


def extended_root(squared: Array) -> Array:
    """√(ε²), continued with a slope to below zero, where there is no rebound.

    For ε² < s = 1e-6 it is 2√s - √(2s - ε²), so that a search that starts where the losses exceed
    the impact energy finds its way back. Data points near a fit are far from it.
    """
    s = TINY_SQUARED
    inside = squared > s
    root = jnp.sqrt(jnp.where(inside, squared, s))
    return jnp.where(inside, root, 2 * s**0.5 - jnp.sqrt(2 * s - jnp.where(inside, s, squared)))


def point_values(table, layout: Layout, obs: Observations, xp=jnp) -> dict[str, Array]:
    """The table at each point; what a data set does not fit of its contact stays as measured.

    χ̃ of a set on the line is c1 + c2 E/Y, Eq. (18). `xp` is jax.numpy, or numpy.
    """
    points = {name: values[obs.group] for name, values in table.items()}
    for name in CONTACT_COLUMNS:
        fitted = layout.index[:, column(name)][obs.group] >= 0
        points[name] = xp.where(fitted, points[name], getattr(obs, name))
    line = points["c1"] + points["c2"] * points["youngs_modulus"] / points["yield_strength"]
    # a line that dips below zero on the way has no collision to offer there
    on_line = layout.on_line[obs.group]
    return points | {"chi": xp.where(on_line, xp.maximum(line, 1e-9), points["chi"])}


def predicted(table, layout: Layout, obs: Observations, plastic, model: Model, kind) -> Array:
    """ε of each point: the whole model, Eq. (17) alone, or a constant; `kind` indexes `KINDS`."""
    points = point_values(table, layout, obs)
    limit, sigma, psi = points["limit_velocity"], points["sigma"], points["psi"]
    empirical = sj.empirical_restitution(obs.velocity, limit, sigma, psi)  # Eq. (17)
    critical = critical_velocity(points, obs, model)
    at_yield = sj.empirical_restitution(critical, limit, sigma, psi)
    eps_up = jnp.where(layout.up_given[obs.group], points["eps_up"], at_yield)
    below = jnp.where(layout.up_given[obs.group], eps_up, empirical)
    columns = jnp.stack([points[name] for name in PLASTIC_COLUMNS])
    yielded = extended_root(plastic(columns) + eps_up**2 - 1)  # Eq. (16)
    whole = jnp.where(obs.elastic, below, yielded)
    return jnp.where(kind == 0, whole, jnp.where(kind == 1, empirical, points["restitution"]))


def critical_velocity(points, obs: Observations, model: Model) -> Array:
    """v_cr at each point [m/s]."""
    return sj.Contact(
        youngs_modulus=points["youngs_modulus"],
        radius=obs.radius,
        mass=obs.mass,
        yield_strength=points["yield_strength"],
        limit_velocity=1.0,
        area=model.area,
    ).critical_velocity


def robust(residual: Array, scale, loss: str) -> Array:
    """τ(r) with ½τ² the loss: r itself, Huber's, or soft-l1; beyond `scale` they weigh less."""
    if loss == "squared":
        return residual
    if loss == "soft-l1":
        return residual * jnp.sqrt(2 / (1 + jnp.sqrt(1 + (residual / scale) ** 2)))
    size = jnp.abs(residual)
    beyond = size > scale
    bent = jnp.sqrt(2 * scale * jnp.where(beyond, size, scale) - scale**2)
    return jnp.where(beyond, jnp.sign(residual) * bent, residual)


def residuals(z, layout, obs, noise: Noise, plastic, model: Model, kind, loss: str):
    """Weighted residuals through the loss, then the prior of each element of z; and ε itself."""
    curve = predicted(layout.table(z), layout, obs, plastic, model, kind)
    raw = (curve - obs.restitution) * obs.weight
    prior = (layout.physical(z) - noise.prior_mean) * noise.prior_precision
    return jnp.concatenate([robust(raw, noise.scale, loss), prior]), curve


@partial(jax.jit, static_argnames=("model", "loss"))
def linearised(z, layout, obs, noise, expansion, kind, model, loss):
    """Residuals, their Jacobian in z, and ε at every point."""

    def f(z):
        value, curve = residuals(z, layout, obs, noise, expansion, model, kind, loss)
        return value, (value, curve)

    jacobian, (value, curve) = jax.jacfwd(f, has_aux=True)(z)
    return value, jacobian, curve


def point_columns(z, layout: Layout, obs: Observations) -> np.ndarray:
    """`PLASTIC_COLUMNS` of each point, (3, N), by NumPy."""
    points = point_values(layout.numpy_table(z), layout, obs, np)
    return np.stack([points[name] for name in PLASTIC_COLUMNS])
