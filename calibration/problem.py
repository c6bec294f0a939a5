"""One least-squares problem: which elements of z are searched, against what, by which collision."""

from dataclasses import dataclass, field, replace
from functools import partial

import jax
import numpy as np

import softjax as sj
from calibration import objective
from calibration.impacts import PLASTIC_COLUMNS, Expansion, Impacts, Model, expand
from calibration.objective import Kind, Noise, Observations
from calibration.parameters import COLUMNS, Layout


@dataclass
class Counter:
    """How often residuals with their Jacobian were asked for."""

    evaluations: int = 0


@dataclass(frozen=True)
class Problem:
    """Residuals of one objective as functions of the searched elements x of z.

    Attributes:
        layout, obs, noise, model, kind, loss: see `objective`.
        base: z; what is not searched stays at it.
        active: positions in z of what is searched.
    """

    layout: Layout
    obs: Observations
    noise: Noise
    model: Model
    kind: Kind
    loss: str
    base: np.ndarray
    active: np.ndarray
    counter: Counter = field(default_factory=Counter, compare=False)

    @property
    def free(self) -> tuple[str, ...]:
        """The inputs of the collision that the search moves."""
        searched = np.isin(self.layout.index, self.active)
        moves = {name for i, name in enumerate(COLUMNS) if np.any(searched[:, i])}
        if moves & {"c1", "c2"}:
            moves.add("chi")
        return tuple(name for name in PLASTIC_COLUMNS if name in moves)

    @property
    def names(self) -> list[str]:
        """The column of each searched element."""
        index = self.layout.index
        return [
            next((name for i, name in enumerate(COLUMNS) if position in index[:, i]), "")
            for position in self.active
        ]

    @property
    def start(self) -> np.ndarray:
        return self.base[self.active]

    def full(self, x) -> np.ndarray:
        """z with the searched elements at x."""
        z = np.array(self.base)
        z[self.active] = x
        return z

    def at(self, x) -> "Problem":
        """The same problem started from x."""
        return replace(self, base=self.full(x))

    def expansion(self, z) -> Expansion:
        """The collisions around z."""
        return self.expansions([z])[0]

    def expansions(self, zs) -> list[Expansion]:
        """The collisions around each of several z, computed as one batch."""
        count = len(self.obs.velocity)
        if self.kind != "model":
            zero = np.zeros((len(PLASTIC_COLUMNS), count))
            return [Expansion(zero, zero[0], zero, zero[0].astype(np.int32))] * len(zs)
        columns = [objective.point_columns(z, self.layout, self.obs) for z in zs]
        impacts = Impacts(*(np.tile(a, len(zs)) for a in Impacts.of(self.obs)))
        found = expand(np.concatenate(columns, axis=1), impacts, self.free, self.model)
        rows = [slice(first, first + count) for first in range(0, len(zs) * count, count)]
        return [Expansion(*(a[..., own] for a in found)) for own in rows]

    def linearise(self, x) -> tuple[np.ndarray, np.ndarray]:
        """Residuals, and their Jacobian in x."""
        value, jacobian = self.linearise_all(self.full(x))
        return value, jacobian[:, self.active]

    def linearise_all(self, z) -> tuple[np.ndarray, np.ndarray]:
        """Residuals, and their Jacobian in all of z; of the collision only in what is searched."""
        self.counter.evaluations += 1
        value, jacobian, _ = self.linearised(z, self.expansion(z))
        return value, jacobian

    def linearised(self, z, expansion):
        """Residuals, their Jacobian in z, and ε at every point, with the collisions given."""
        model = replace(self.model, route=sj.EnergyBalance())  # no route acts: compile once
        parts = objective.linearised(
            z,
            self.layout,
            self.obs,
            self.noise,
            expansion,
            objective.KINDS.index(self.kind),
            model=model,
            loss=self.loss,
        )
        return tuple(np.asarray(part) for part in parts)

    def prediction(self, z) -> np.ndarray:
        """ε at every point, padding included."""
        return self.linearised(z, self.expansion(z))[2]

    def status(self, z) -> np.ndarray:
        """`softjax.Status` at every point."""
        expansion = self.expansion(z)
        no_rebound = self.linearised(z, expansion)[2] < objective.NO_REBOUND_BELOW
        status = np.asarray(expansion.status) | np.where(no_rebound, int(sj.Status.NO_REBOUND), 0)
        return np.where(self.obs.elastic, int(sj.Status.ELASTIC), status)

    def elastic_at(self, z) -> np.ndarray:
        """Which points are below yield at z."""
        if not set(self.free) & {"yield_strength", "youngs_modulus"}:
            return np.asarray(self.obs.elastic)
        critical = _critical(z, self.layout, self.obs, self.model)
        return np.asarray(self.obs.velocity) <= np.asarray(critical)

    def with_elastic(self, elastic) -> "Problem":
        return replace(self, obs=self.obs._replace(elastic=elastic))

    def by(self, route) -> "Problem":
        """The same problem through another route, with a count of its own."""
        return replace(self, model=replace(self.model, route=route), counter=Counter())


@partial(jax.jit, static_argnames="model")
def _critical(z, layout, obs, model):
    points = objective.point_values(layout.table(z), layout, obs)
    return objective.critical_velocity(points, obs, model)
