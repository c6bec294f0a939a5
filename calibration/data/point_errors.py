"""Errors of measured quantities, propagated to the restitution and the velocity of each point."""

from dataclasses import dataclass, replace
from functools import reduce

import numpy as np
from jaxtyping import Float, Int

from calibration.data.checks import Column, require, require_size
from calibration.data.kinds import TOUCHED, Kind, Slopes, kind_named

Index = Int[np.ndarray, "n k"]


@dataclass(frozen=True, eq=False)
class PointErrors:
    """Errors of n points, linear in m independent input errors e, and independent errors of each point:

        δε_i = Σ_k to_restitution[i, k] e[index[i, k]] + independent error of ε_i
        δv_i = Σ_k to_velocity[i, k] e[index[i, k]] + independent error of v_i

    Two velocities, or two heights, of a point are input errors that enter both its ε and its
    v. Each interval of a bounce sequence enters two points, each time of a bounce three, and each error of
    a track all of its impacts.

    Attributes:
        index: (n, k), which input error, from 0; -1: none.
        to_restitution: (n, k), ∂ε_i/∂e [1/unit of e], 0 where there is none.
        to_velocity: (n, k), ∂v_i/∂e [m/s/unit of e].
        size: (m,), standard deviation of each input error, in its own SI unit; None where
            it is unknown, one and the same for all, and to be estimated.
        kind: what the input errors are of, by its name in `calibration.data.kinds.KINDS`; "" where
            there are none.
        u_restitution: (n,), independent standard uncertainty of each ε; None: not stated.
        u_velocity: (n,) [m/s], the same of each v.
        by_drag: (n, 2), ∂ε_i/∂c and ∂v_i/∂c [m/s] of points from flights in air, where the drag
            coefficient is (1 + c) that of `calibration.data.air`, with one c for all; None without.

    Raises:
        DataError: for an invalid uncertainty, or an unknown kind.
    """

    index: Index
    to_restitution: Slopes
    to_velocity: Slopes
    size: Column | None
    kind: str = ""
    u_restitution: Column | None = None
    u_velocity: Column | None = None
    by_drag: Float[np.ndarray, "n 2"] | None = None

    def __post_init__(self):
        kind_named(self.kind)
        for name, array in list(vars(self).items()):
            if isinstance(array, np.ndarray):
                view = array.view()  # the caller's own stays as it is
                view.setflags(write=False)
                object.__setattr__(self, name, view)
        if self.u_restitution is not None:
            require_size("uncertainty", self.u_restitution)
        if self.u_velocity is not None:
            speed = "a speed of 0 m/s or more"
            require("velocity_uncertainty", self.u_velocity, lambda u: u >= 0, speed)
        if self.size is not None:
            size = f"uncertainty of the {self.kind}"
            require(size, self.size, lambda u: u >= 0, "a number of 0 or more")

    @classmethod
    def independent(cls, count: int, restitution=None, velocity=None) -> "PointErrors":
        """Points without shared errors."""
        index = np.broadcast_to(-1, (count, TOUCHED))  # takes no memory
        none = np.broadcast_to(0.0, (count, TOUCHED))
        return cls(index, none, none, np.zeros(0), "", restitution, velocity)

    def select(self, rows: Int[np.ndarray, " k"]) -> "PointErrors":
        """Select points, which share no input error with the others."""
        index, back = np.unique(self.index[rows], return_inverse=True)
        index, back = index[index >= 0], back.reshape(len(rows), -1) - np.any(index < 0)
        names = ("to_restitution", "to_velocity", "u_restitution", "u_velocity", "by_drag")
        chosen = {name: getattr(self, name) for name in names}
        chosen = {name: column[rows] for name, column in chosen.items() if column is not None}
        size = None if self.size is None else self.size[index]
        return replace(self, index=back, size=size, **chosen)

    def __len__(self) -> int:
        return len(self.index)

    @property
    def measured_by(self) -> Kind:
        """The kind of measurement that the input errors are of."""
        return kind_named(self.kind)

    @property
    def size_is_unknown(self) -> bool:
        """Whether the size of the input errors is to be estimated."""
        return self.size is None

    @property
    def uncertainty(self) -> Column | None:
        """Standard uncertainty of ε, (n,), of all stated errors; None if none is stated."""
        return self._total(self.u_restitution, self.to_restitution)

    @property
    def velocity_uncertainty(self) -> Column | None:
        """Standard uncertainty of v [m/s], (n,), of all stated errors; None if none is stated."""
        return self._total(self.u_velocity, self.to_velocity)

    def _total(self, independent: Column | None, slopes: Slopes) -> Column | None:
        """√(independent² + Σ shared²) by `hypot`, which does not overflow on the way."""
        with np.errstate(all="ignore"):
            shared = slopes * self.sizes_at(0.0)
        if independent is None and not np.any(shared):
            return None
        return reduce(
            np.hypot, shared.T, np.zeros(len(self)) if independent is None else independent
        )

    def variance(self, slope: Column) -> Column:
        """Variance of δε - slope δv of each point, (n,), of all stated errors."""
        shared = (self.to_restitution - slope[:, None] * self.to_velocity) * self.sizes_at(0.0)
        independent = (self.u_restitution, self.u_velocity)
        of_eps, of_v = (0.0 if part is None else part for part in independent)
        return np.sum(shared**2, axis=1) + of_eps**2 + (slope * of_v) ** 2

    @property
    def shares(self) -> bool:
        """Whether an input error enters more than one point."""
        used = self.index[self.index >= 0]
        return bool(used.size) and int(np.max(np.bincount(used))) > 1

    def sizes(self, unknown: float) -> Column:
        """Standard deviation of each input error, (m,); `unknown` where it is to be estimated."""
        if self.size is not None:
            return self.size
        return np.full(int(np.max(self.index, initial=-1)) + 1, unknown)

    def sizes_at(self, unknown: float) -> Slopes:
        """Standard deviations of the input errors of each point, (n, 3), 0 where there is none."""
        return np.append(self.sizes(unknown), 0.0)[self.index]  # -1 is the last


def paired(count: int) -> Index:
    """The index of two input errors a point, which no other point has."""
    return np.stack([2 * np.arange(count), 2 * np.arange(count) + 1, np.full(count, -1)], axis=1)
