"""Many fits of the same velocities at once: residuals and searches over a leading axis of sets."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from calibration import objective
from calibration.assemble import Setup
from calibration.impacts import PLASTIC_COLUMNS, Expansion, Impacts, Model, expand
from calibration.objective import KINDS, Observations

CHUNK = 250  # sets that are computed at once
MAX_STEPS = 300
STEP_TOLERANCE = 1e-8  # in log units
COST_TOLERANCE = 1e-12  # of the decrease that the next step promises, relative to the cost
ROUNDING = 1e-14
FARTHEST = 30.0  # from the start, in log units: beyond, nothing changes any more


class Batch:
    """One data set's velocities with many rows of restitutions, through the energy balance."""

    def __init__(self, setup: Setup, restitutions):
        count = setup.counts[0]
        obs = Observations(*(np.asarray(a)[:count] for a in setup.obs))
        noise = setup.noise._replace(scale=np.ones(count))
        self.setup, self.noise = setup, noise
        self.obs = obs._replace(restitution=np.asarray(restitutions, float))
        self.sets, self.points = self.obs.restitution.shape
        self.model = Model(area=setup.area)

    def linearise(self, z, active, kind: str, rows=None):
        """Residuals (sets, points) and Jacobian (sets, points, active) at z (sets, elements).

        `rows` are the sets that z belongs to, all of them by default. They go through the compiled
        functions in chunks of one size, the last one filled up.
        """
        rows = np.arange(self.sets) if rows is None else rows
        parts = []
        for first in range(0, len(rows), CHUNK):
            own = np.resize(np.arange(first, min(first + CHUNK, len(rows))), CHUNK)
            obs = self.obs._replace(restitution=self.obs.restitution[rows[own]])
            value, jacobian = self._chunk(z[own], obs, kind)
            count = min(CHUNK, len(rows) - first)
            parts.append((value[:count, : self.points], jacobian[:count, : self.points, active]))
        value, jacobian = zip(*parts, strict=True)
        return np.concatenate(value), np.concatenate(jacobian)

    def _chunk(self, z, obs: Observations, kind: str):
        layout = self.setup.layout
        columns = np.asarray(_columns(z, layout, obs))
        if kind == "model":
            expansion = self._expanded(columns)
        else:
            zero = np.zeros(columns.shape)
            flags = np.zeros((len(columns), self.points), np.int32)
            expansion = Expansion(columns, zero[:, 0], zero, flags)
        index = KINDS.index(kind)
        parts = _linearised(z, layout, obs, self.noise, expansion, index, model=self.model)
        return tuple(np.asarray(part) for part in parts)

    def _expanded(self, columns) -> Expansion:
        """The collisions of all sets of a chunk, columns (sets, 3, points), as one row of points."""
        sets = len(columns)
        impacts = Impacts(*(np.tile(a, sets) for a in Impacts.of(self.obs)))
        flat = np.concatenate(list(columns), axis=1)
        found = expand(flat, impacts, ("chi",), self.model)
        apart = lambda a: np.moveaxis(a.reshape(*a.shape[:-1], sets, self.points), -2, 0)  # noqa: E731
        return Expansion(*map(apart, found))


_OBS_AXES = Observations(*(0 if name == "restitution" else None for name in Observations._fields))


@jax.jit
def _columns(z, layout, obs):
    def one(z):
        points = objective.point_values(layout.table(z), layout, obs)
        return jnp.stack([points[name] for name in PLASTIC_COLUMNS])

    return jax.vmap(one)(z)


@partial(jax.jit, static_argnames="model")
def _linearised(z, layout, obs, noise, expansion, kind, model):
    def one(z, obs, expansion):
        return objective.linearised(z, layout, obs, noise, expansion, kind, model, "squared")[:2]

    return jax.vmap(one, in_axes=(0, _OBS_AXES, 0))(z, obs, expansion)


def minimise(batch: Batch, z, active, kind: str, limit: int = MAX_STEPS):
    """Levenberg–Marquardt for every set with a damping of its own, until each is done.

    Returns z, the sums of squares, and which sets converged.
    """
    z = np.array(z)
    costs, converged = np.zeros(batch.sets), np.zeros(batch.sets, bool)
    rows, here, damping = np.arange(batch.sets), np.array(z), np.full(batch.sets, 1e-3)
    value, jacobian = batch.linearise(here, active, kind, rows)
    cost = np.sum(value**2, axis=1)
    for _ in range(limit):
        step, promised = _step(value, jacobian, damping)
        trial = np.array(here)
        trial[:, active] += step
        new_value, new_jacobian = batch.linearise(trial, active, kind, rows)
        new_cost = np.sum(new_value**2, axis=1)
        better = new_cost <= cost * (1 + ROUNDING)
        small = better & (np.max(np.abs(step), axis=1) < STEP_TOLERANCE)
        flat = promised <= COST_TOLERANCE * cost
        here[better], cost[better] = trial[better], new_cost[better]
        value[better], jacobian[better] = new_value[better], new_jacobian[better]
        damping = np.where(better, damping * 0.2, np.minimum(damping * 5, 1e12))
        gone = np.max(np.abs(here - z[rows])[:, active], axis=1) > FARTHEST
        done = small | flat | gone
        costs[rows], converged[rows] = cost, done
        z[rows[done]] = here[done]
        if np.all(done):
            return z, costs, converged
        left = ~done
        rows, here, damping, cost = rows[left], here[left], damping[left], cost[left]
        value, jacobian = value[left], jacobian[left]
    z[rows], costs[rows] = here, cost
    return z, costs, converged


def _step(value, jacobian, damping):
    """The damped Gauss–Newton step, and the decrease of the cost that the undamped one promises."""
    normal = np.swapaxes(jacobian, 1, 2) @ jacobian
    gradient = np.einsum("snp,sn->sp", jacobian, value)
    diagonal = np.einsum("spp->sp", normal)
    size = np.sqrt(np.maximum(diagonal, 1e-300))
    scaled = normal / (size[:, :, None] * size[:, None, :])
    right = gradient / size
    eye = np.eye(normal.shape[1])
    damped = np.linalg.solve(scaled + damping[:, None, None] * eye, right[:, :, None])[:, :, 0]
    whole = np.linalg.solve(scaled + 1e-12 * eye, right[:, :, None])[:, :, 0]
    step = np.clip(-damped / size, -1.5, 1.5)
    return step, np.einsum("sp,sp->s", whole, right)
