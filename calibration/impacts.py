"""ε_p² of impacts and its slopes in χ̃, Y and E: the only place where a fit computes collisions.

Impacts are independent of each other, so they go through one compiled function in blocks of one
size: any number of them, of starts and of data sets is one compilation.
"""

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import softjax as sj

PLASTIC_COLUMNS = ("chi", "yield_strength", "youngs_modulus")
# A block costs what it costs, filled or not: small ones for a data set, which most fits are, and
# large ones for simulations.
BLOCKS = {"energy balance": 128, "ode": 64}
LARGE = 4096

Points = Float[np.ndarray, "points"]


@dataclass(frozen=True)
class Model:
    """What is compiled for: the law's variant and the route through it."""

    form: str = "first-order"
    kappa: str = "consistent"
    area: str = "zhou"
    route: sj.EnergyBalance | sj.ODE = sj.EnergyBalance()


class Impacts(NamedTuple):
    """What a collision is made of beside the `PLASTIC_COLUMNS`."""

    velocity: Points
    elastic: np.ndarray  # below yield: held while a step is searched
    radius: Points
    mass: Points

    @classmethod
    def of(cls, obs) -> "Impacts":
        """Those of `Observations`."""
        return cls(*(np.asarray(getattr(obs, name)) for name in cls._fields))


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


def collisions(columns: Array, impacts, model: Model) -> tuple[Array, Array]:
    """ε_p² and status of each impact on the plastic branch, of the `PLASTIC_COLUMNS`, (3, N).

    Points held on this branch while v_cr moves beyond them are taken at v_cr.
    """
    chi, yield_strength, youngs_modulus = columns
    contact = sj.Contact(
        youngs_modulus=youngs_modulus,
        radius=impacts.radius,
        mass=impacts.mass,
        yield_strength=yield_strength,
        limit_velocity=jnp.full_like(chi, 1e30),  # acts in Eq. (17) alone
        area=model.area,
    )
    critical = contact.critical_velocity
    beyond = jnp.maximum(impacts.velocity, critical * (1 + 1e-12))
    velocity = jnp.where(impacts.elastic, 2 * critical, beyond)
    law = sj.Zhou(contact, chi, 0.0, 1.0, form=model.form, kappa=model.kappa)
    impact = sj.restitution(law, velocity, route=model.route)
    return impact.plastic_coefficient**2, impact.status


def only_free(columns: Array, free: tuple[str, ...]) -> list[Array]:
    """The same, known to be constant where not free: the ODE then carries no tangent for it."""
    rows = zip(PLASTIC_COLUMNS, columns, strict=True)
    return [row if name in free else jax.lax.stop_gradient(row) for name, row in rows]


def expand(columns, impacts: Impacts, free: tuple[str, ...], model: Model) -> Expansion:
    """ε_p² with its slopes along the `free` columns, impact by impact, in NumPy arrays."""
    columns = np.asarray(columns, float)
    count = columns.shape[1]
    size = LARGE if count > LARGE else BLOCKS[model.route.name]
    values, slopes, flags = [], [], []
    for first in range(0, count, size):
        own = np.resize(np.arange(first, min(first + size, count)), size)  # the last is filled up
        block = Impacts(*(a[own] for a in impacts))
        value, slope, status = _block(columns[:, own], block, free or ("chi",), model)
        values.append(np.asarray(value))
        slopes.append(np.asarray(slope))
        flags.append(np.asarray(status))
    value, status = (np.concatenate(parts)[:count] for parts in (values, flags))
    return Expansion(columns, value, np.concatenate(slopes, axis=1)[:, :count], status)


@partial(jax.jit, static_argnames=("free", "model"))
def _block(columns, impacts: Impacts, free: tuple[str, ...], model: Model):
    """Values, slopes and statuses of one block, by one forward pass."""
    rows = np.array([PLASTIC_COLUMNS.index(name) for name in free], int)

    def value(some):
        every = list(columns)
        for row, values in zip(rows, some, strict=True):
            every[row] = values
        return collisions(every, impacts, model)

    def along(seed):
        tangent = seed[:, None] * jnp.ones_like(columns[rows])
        return jax.jvp(value, (columns[rows],), (tangent,), has_aux=True)

    squared, slopes, status = jax.vmap(along, out_axes=(None, 0, None))(jnp.eye(len(rows)))
    return squared, jnp.zeros_like(columns).at[rows].set(slopes), status
