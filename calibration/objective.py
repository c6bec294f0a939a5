"""Residuals of Eq. (17) and of the collision model against data, and their derivatives.

The collision enters only through ε_p², which each impact has for itself. It is therefore expanded
impact by impact (`expand`: value and slopes in χ̃, Y, E, through either route), and the rest, Eqs.
(16) to (18), transforms, weights, loss and priors, is differentiated around it. So one
compiled collision serves every objective, any number of data sets and any parameters.
"""

from dataclasses import dataclass
from functools import partial
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import softjax as sj
from calibration.parameters import CONTACT_COLUMNS, Layout, column

PLASTIC_COLUMNS = ("chi", "yield_strength", "youngs_modulus")
PADDING = 64  # numbers of points are rounded up to it, so that most data compile once
TINY_SQUARED = 1e-6  # below this ε² the root is continued by another, see `extended_root`
NO_REBOUND_BELOW = (2 - 2**0.5) * TINY_SQUARED**0.5  # what `extended_root` gives at ε² = 0

Points = Float[np.ndarray, "points"]
Kind = Literal["model", "empirical", "constant"]
KINDS = ("model", "empirical", "constant")


@dataclass(frozen=True)
class Model:
    """What is compiled for: the law's variant and the route through it."""

    form: str = "first-order"
    kappa: str = "consistent"
    area: str = "zhou"
    route: sj.EnergyBalance | sj.ODE = sj.EnergyBalance()


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


class Expansion(NamedTuple):
    """ε_p² of each impact around `at`, the `PLASTIC_COLUMNS` of each point, (3, N).

    Value (N,), slopes (3, N), zero for columns that are not free, and `softjax.Status` (N,) of the
    contact force alone.
    """

    at: Array
    value: Array
    slope: Array
    status: Array

    def __call__(self, columns: Array) -> Array:
        return self.value + jnp.sum(self.slope * (columns - self.at), axis=0)


class Noise(NamedTuple):
    """Scale of the loss in weighted residuals, and Gaussian priors on the elements of θ."""

    scale: Float[np.ndarray, "points"]  # tuning constant times one standard deviation
    prior_mean: np.ndarray
    prior_precision: np.ndarray  # 1/standard deviation, 0 without a prior


def plastic_squared(columns: Array, obs: Observations, model: Model) -> Array:
    """ε_p² of each impact on the plastic branch, see `collisions`."""
    return collisions(columns, obs, model)[0]


def collisions(columns: Array, obs: Observations, model: Model) -> tuple[Array, Array]:
    """ε_p² and status of each impact on the plastic branch, of the `PLASTIC_COLUMNS`, (3, N).

    Points held on this branch while v_cr moves beyond them are taken at v_cr.
    """
    chi, yield_strength, youngs_modulus = columns
    contact = sj.Contact(
        youngs_modulus=youngs_modulus,
        radius=obs.radius,
        mass=obs.mass,
        yield_strength=yield_strength,
        limit_velocity=jnp.full_like(chi, 1e30),  # acts in Eq. (17) alone
        area=model.area,
    )
    critical = contact.critical_velocity
    beyond = jnp.maximum(obs.velocity, critical * (1 + 1e-12))
    velocity = jnp.where(obs.elastic, 2 * critical, beyond)
    law = sj.Zhou(contact, chi, 0.0, 1.0, form=model.form, kappa=model.kappa)
    impact = sj.restitution(law, velocity, route=model.route)
    return impact.plastic_coefficient**2, impact.status


def only_free(columns: Array, free: tuple[str, ...]) -> Array:
    """The same, known to be constant where not free: the ODE then carries no tangent for it."""
    rows = zip(PLASTIC_COLUMNS, columns, strict=True)
    return [row if name in free else jax.lax.stop_gradient(row) for name, row in rows]


@partial(jax.jit, static_argnames=("free", "model"))
def expand(columns, obs: Observations, free: tuple[str, ...], model: Model) -> Expansion:
    """`plastic_squared` with its slopes, impact by impact, by one forward pass."""
    rows = np.array([PLASTIC_COLUMNS.index(name) for name in free], int)
    slope = jnp.zeros_like(columns)

    def value(some):
        every = list(columns)
        for row, values in zip(rows, some, strict=True):
            every[row] = values
        return collisions(every, obs, model)

    if not free:
        squared, status = value([])
        return Expansion(columns, squared, slope, status)

    def along(seed):
        tangent = seed[:, None] * jnp.ones_like(columns[rows])
        squared, change, status = jax.jvp(value, (columns[rows],), (tangent,), has_aux=True)
        return squared, change, status

    squared, slopes, status = jax.vmap(along, out_axes=(None, 0, None))(jnp.eye(len(rows)))
    return Expansion(columns, squared, slope.at[rows].set(slopes), status)


def extended_root(squared: Array) -> Array:
    """√(ε²), continued with a slope to below zero, where there is no rebound.

    For ε² < s = 1e-6 it is 2√s - √(2s - ε²), so that a search that starts where the losses exceed
    the impact energy finds its way back. Data points near a fit are far from it.
    """
    s = TINY_SQUARED
    inside = squared > s
    root = jnp.sqrt(jnp.where(inside, squared, s))
    return jnp.where(inside, root, 2 * s**0.5 - jnp.sqrt(2 * s - jnp.where(inside, s, squared)))


def point_values(table, layout: Layout, obs: Observations) -> dict[str, Array]:
    """The table at each point; what a data set does not fit of its contact stays as measured.

    χ̃ of a set on the line is c1 + c2 E/Y, Eq. (18).
    """
    points = {name: values[obs.group] for name, values in table.items()}
    for name in CONTACT_COLUMNS:
        fitted = layout.index[:, column(name)][obs.group] >= 0
        points[name] = jnp.where(fitted, points[name], getattr(obs, name))
    line = points["c1"] + points["c2"] * points["youngs_modulus"] / points["yield_strength"]
    # a line that dips below zero on the way has no collision to offer there
    on_line = layout.on_line[obs.group]
    return points | {"chi": jnp.where(on_line, jnp.maximum(line, 1e-9), points["chi"])}


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


@jax.jit
def point_columns(z, layout: Layout, obs: Observations) -> Array:
    """`PLASTIC_COLUMNS` of each point, (3, N)."""
    points = point_values(layout.table(z), layout, obs)
    return jnp.stack([points[name] for name in PLASTIC_COLUMNS])


@jax.jit
def physical_map(z, layout: Layout):
    """θ(z) and the diagonal of ∂θ/∂z."""
    return jax.jvp(layout.physical, (z,), (jnp.ones_like(z),))
