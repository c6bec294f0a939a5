"""Errors of measured quantities, propagated to the restitution and the velocity of each point."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from calibration.data.checks import Column, require
from calibration.data.covariance import Covariance, band_order
from calibration.errors import DataError

TOUCHED = 3  # input errors that one point has at most: the times of three bounces
Index = Int[np.ndarray, "n 3"]
Slopes = Float[np.ndarray, "n 3"]


@dataclass(frozen=True, eq=False)
class PointErrors:
    """Errors of n points, linear in m independent input errors e, and independent errors of each point:

        δε_i = Σ_k to_restitution[i, k] e[index[i, k]] + error of ε_i alone
        δv_i = Σ_k to_velocity[i, k] e[index[i, k]] + error of v_i alone

    Two velocities, or two heights, of a point are input errors that enter both its ε and its
    v. Each interval of a bounce sequence enters two points, each time of a bounce three.

    Attributes:
        index: (n, 3), which input error, from 0; -1: none.
        to_restitution: (n, 3), ∂ε_i/∂e [1/unit of e], 0 where there is none.
        to_velocity: (n, 3), ∂v_i/∂e [m/s/unit of e].
        size: (m,), standard deviation of each input error, in its own SI unit; None where
            it is unknown, one and the same for all, and to be estimated.
        kind: what the input errors are of: "velocities", "heights", "intervals", "times",
            "repeats"; "" where there are none.
        restitution_alone: (n,), independent standard uncertainty of each ε; None: not stated.
        velocity_alone: (n,) [m/s], the same of each v.
        by_drag: (n, 2), ∂ε_i/∂c and ∂v_i/∂c [m/s] of points from flights in air, where the drag
            coefficient is (1 + c) that of `calibration.data.air`, with one c for all; None without.

    Raises:
        DataError: for an invalid uncertainty, or an input error that enters points which
            do not follow each other.
    """

    index: Index
    to_restitution: Slopes
    to_velocity: Slopes
    size: Column | None
    kind: str = ""
    restitution_alone: Column | None = None
    velocity_alone: Column | None = None
    by_drag: Float[np.ndarray, "n 2"] | None = None

    def __post_init__(self):
        for name, array in list(vars(self).items()):
            if isinstance(array, np.ndarray):
                view = array.view()  # the caller's own stays as it is
                view.setflags(write=False)
                object.__setattr__(self, name, view)
        band_order(self.index)  # refuses what has no narrow band
        if self.restitution_alone is not None:
            positive = "a positive number"
            require("uncertainty", self.restitution_alone, lambda u: u > 0, positive)
        if self.velocity_alone is not None:
            speed = "a speed of 0 m/s or more"
            require("velocity_uncertainty", self.velocity_alone, lambda u: u >= 0, speed)
        if self.size is not None:
            size = f"uncertainty of the {self.kind}"
            require(size, self.size, lambda u: u >= 0, "a number of 0 or more")

    @classmethod
    def alone(cls, count: int, restitution=None, velocity=None) -> "PointErrors":
        """Points without shared errors."""
        index = np.broadcast_to(-1, (count, TOUCHED))  # takes no memory
        none = np.broadcast_to(0.0, (count, TOUCHED))
        return cls(index, none, none, np.zeros(0), "", restitution, velocity)

    def some(self, rows: Int[np.ndarray, "k"]) -> "PointErrors":
        """Select points, which share no input error with the others."""
        independent = (self.restitution_alone, self.velocity_alone)
        restitution, velocity = (None if u is None else u[rows] for u in independent)
        index, back = np.unique(self.index[rows], return_inverse=True)
        index, back = index[index >= 0], back.reshape(len(rows), -1) - np.any(index < 0)
        return replace(
            self,
            index=back,
            to_restitution=self.to_restitution[rows],
            to_velocity=self.to_velocity[rows],
            size=None if self.size is None else self.size[index],
            restitution_alone=restitution,
            velocity_alone=velocity,
            by_drag=None if self.by_drag is None else self.by_drag[rows],
        )

    def __len__(self) -> int:
        return len(self.index)

    @property
    def size_is_unknown(self) -> bool:
        """Whether the size of the input errors is to be estimated."""
        return self.size is None

    @property
    def uncertainty(self) -> Column | None:
        """Standard uncertainty of ε, (n,), of all stated errors; None if none is stated."""
        return _total(self.restitution_alone, self._sized(self.to_restitution))

    @property
    def velocity_uncertainty(self) -> Column | None:
        """Standard uncertainty of v [m/s], (n,), of all stated errors; None if none is stated."""
        return _total(self.velocity_alone, self._sized(self.to_velocity))

    def covariance(
        self, slope: Column | float = 0.0, *, size: float | None = None, added=0.0
    ) -> Covariance:
        """Covariance of δε - slope δv, O(n) in time and memory (see `Covariance`).

        Args:
            slope: dε/dv [s/m] of the curve at each point.
            size: standard deviation of the input errors where that is unknown, in the SI
                unit of what was measured; refused where the sizes are stated.
            added: further variance of ε, one number or (n,): noise that is estimated.

        Raises:
            DataError: for a size that is missing, or given with stated ones.
        """
        slopes = np.broadcast_to(np.asarray(slope, float), (len(self),))
        if self.size_is_unknown != (size is not None):
            accepted = "given where the size of the input errors is unknown, and only there"
            raise DataError("size", size, accepted)
        with np.errstate(all="ignore"):
            factors = self.factors(slopes) * self.sizes_at(size or 0.0)
            return Covariance.of(self.index, factors, added + self.variance_alone(slopes))

    def moments(self) -> tuple[Column, Column, Column]:
        """Variance of each ε, of its v, and their covariance, of all that is stated."""
        to_eps, to_v = self._sized(self.to_restitution), self._sized(self.to_velocity)
        return (
            np.sum(to_eps**2, axis=1) + _squared(self.restitution_alone),
            np.sum(to_v**2, axis=1) + _squared(self.velocity_alone),
            np.sum(to_eps * to_v, axis=1),
        )

    @property
    def shares(self) -> bool:
        """Whether an input error enters more than one point."""
        used = self.index[self.index >= 0]
        return bool(used.size) and int(np.max(np.bincount(used))) > 1

    def same_as(self, other: "PointErrors") -> bool:
        """Equal in every number."""
        mine, theirs = vars(self), vars(other)
        return self.kind == other.kind and all(
            same(mine[name], theirs[name]) for name in mine if name != "kind"
        )

    @property
    def count(self) -> int:
        """Number of input errors."""
        return int(np.max(self.index, initial=-1)) + 1

    def sizes(self, unknown: float) -> Column:
        """Standard deviation of each input error, (m,); `unknown` where it is to be estimated."""
        return np.full(self.count, unknown) if self.size is None else self.size

    def sizes_at(self, unknown: float) -> Slopes:
        """Standard deviations of the input errors of each point, (n, 3), 0 where there is none."""
        return np.concatenate([self.sizes(unknown), [0.0]])[self.index]  # -1 is the last

    def factors(self, slope: Any) -> Any:
        """∂(δε - slope δv)/∂e, (n, 3), for a slope of each point, (n,), of NumPy or of JAX."""
        return self.to_restitution - slope[:, None] * self.to_velocity

    def variance_alone(self, slope: Any) -> Any:
        """Variance of δε - slope δv that each point has for itself, of NumPy or of JAX, (n,)."""
        alone: Any = np.zeros(len(self))
        if self.restitution_alone is not None:
            alone = alone + self.restitution_alone**2
        if self.velocity_alone is not None:
            alone = alone + (slope * self.velocity_alone) ** 2
        return alone

    def _sized(self, factors: Slopes) -> Slopes:
        with np.errstate(all="ignore"):
            return factors * self.sizes_at(0.0)


def three(*columns: Column) -> Slopes:
    """Columns of n as (n, 3), zeros where there are fewer."""
    none = np.zeros(len(columns[0]))
    return np.stack([*columns, *[none] * (TOUCHED - len(columns))], axis=1)


def paired(count: int) -> Index:
    """The index of two input errors a point, which no other point has."""
    return np.stack([2 * np.arange(count), 2 * np.arange(count) + 1, np.full(count, -1)], axis=1)


def same(one, other) -> bool:
    """Whether two arrays, or numbers, or None are equal."""
    if one is None or other is None:
        return one is other
    return np.array_equal(one, other)


def _squared(values: Column | None):
    return 0.0 if values is None else values**2


def _total(alone: Column | None, shared: Slopes) -> Column | None:
    """√(alone² + Σ shared²) by `hypot`, which does not overflow on the way."""
    if alone is None and not np.any(shared):
        return None
    total = np.zeros(len(shared)) if alone is None else alone
    for column in shared.T:
        total = np.hypot(total, column)
    return total
