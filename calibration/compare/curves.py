"""ε(v; θ) of a candidate: one compiled function for residuals, predictions and curves alike."""

from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import softjax as sj
from calibration.compare.candidates import Candidate
from calibration.data.measurements import RestitutionData
from calibration.empirical import effective_uncertainty

Column = Float[np.ndarray, "..."]
PADDING = 64  # numbers of points are rounded up to it, so that most data compile once


class Points(NamedTuple):
    """Impacts, padded by copies of the first.

    Every leaf of the contact has one value an impact: sets of equal length compile once.
    """

    velocity: Column
    contact: sj.Contact | None
    limit_velocity: Column  # infinite where unknown


@dataclass(frozen=True)
class Observed:
    """What is measured, and with which weight.

    Attributes:
        points: where, padded.
        restitution: ε as measured, (n,).
        weight: 1/u over its root mean square, 1 without uncertainties, (n,).
        variance: of a weighted residual where uncertainties are stated; None: to be estimated.
    """

    points: Points
    restitution: Column
    weight: Column
    variance: float | None

    @property
    def count(self) -> int:
        """n."""
        return len(self.restitution)


def observe(data: RestitutionData) -> Observed:
    """A data set made ready for all candidates."""
    known = effective_uncertainty(data)
    weight = np.ones(len(data)) if known is None else 1 / known
    scale = float(np.sqrt(np.mean(weight**2)))
    return Observed(
        jax.device_put(points_of(data, data.velocity)),
        data.restitution,
        weight / scale,
        None if data.uncertainty is None else scale**-2,
    )


def points_of(data: RestitutionData, velocity: np.ndarray) -> Points:
    """Impacts of the data's bodies at these velocities; only the data's own if the bodies vary."""
    limit = np.inf if data.limit_velocity is None else data.limit_velocity
    count = len(velocity)
    return Points(padded(velocity, count), _spread(data.contact, count), padded(limit, count))


def padded(values, count: int) -> np.ndarray:
    """Values at each of `count` points, then the first again up to a multiple of `PADDING`."""
    values = np.broadcast_to(np.asarray(values, float), (count,))
    return np.concatenate([values, np.full(-count % PADDING, values[0])])


def _spread(contact: sj.Contact | None, count: int) -> sj.Contact | None:
    if contact is None:
        return None
    return replace(contact, **{k: padded(v, count) for k, v in contact.leaves().items()})


def law_of(candidate: Candidate, contact: sj.Contact, theta) -> sj.ContactLaw:
    """The contact law with these parameters."""
    assert candidate.law is not None
    return candidate.law(contact, *theta)


def restitution_of(candidate: Candidate, z: Array, units, points: Points) -> tuple[Array, Array]:
    """ε and status at each impact; z: (p,), or (p, points) for parameters that vary."""
    theta = candidate.physical(z, units, jnp)
    if candidate.law is None:
        value = sj.empirical_restitution(points.velocity, points.limit_velocity, *theta)
        return value, jnp.zeros(value.shape, jnp.int32)
    assert points.contact is not None
    law = law_of(candidate, points.contact, theta)
    curve = sj.restitution(law, points.velocity, candidate.route)
    return curve.coefficient, curve.status


class Expanded(NamedTuple):
    """ε (points,), ∂ε/∂z (points, p) and status (points,)."""

    value: np.ndarray
    slope: np.ndarray
    status: np.ndarray

    def first(self, count: int) -> "Expanded":
        return Expanded(*(part[:count] for part in self))


def expand(candidate: Candidate, z: Float[np.ndarray, "..."], units, points: Points) -> Expanded:
    """ε with its slopes at each impact; z: (p,), or (points, p) with θ of its own for each."""
    z = np.broadcast_to(z, (len(points.velocity), len(candidate.parameters)))
    return Expanded(*map(np.asarray, _expanded(candidate, jnp.asarray(z.T), units, points)))


@partial(jax.jit, static_argnames="candidate")
def _expanded(candidate: Candidate, z, units, points: Points):
    def along(seed):
        tangent = jnp.broadcast_to(seed[:, None], z.shape)
        value = partial(restitution_of, candidate, units=units, points=points)
        return jax.jvp(value, (z,), (tangent,), has_aux=True)

    if not candidate.parameters:
        value, status = restitution_of(candidate, z, units, points)
        return value, jnp.zeros((len(value), 0)), status
    seeds = jnp.eye(len(candidate.parameters))
    value, slope, status = jax.vmap(along, out_axes=(None, 1, None))(seeds)
    return value, slope, status


def curve_of(candidate: Candidate, z: np.ndarray, data: RestitutionData, velocity) -> np.ndarray:
    """ε over any velocities, NaN where the law has no value; bodies must not vary.

    In blocks of the size that the data were compiled for.
    """
    from calibration.plots.lines import NO_VALUE

    units = candidate.units(data)
    block = len(data) + -len(data) % PADDING
    parts = []
    for first in range(0, len(velocity), block):
        own = velocity[first : first + block]
        filled = np.concatenate([own, np.full(block - len(own), own[0])])
        part = expand(candidate, z, units, points_of(data, filled)).first(len(own))
        none = part.status & int(NO_VALUE) != 0
        parts.append(np.where(none, np.nan, part.value))
    return np.concatenate(parts)
