"""The errors of one data set's points that share some: what is stated, and variances that are not.

    V = κ C + s_t² C_t + s² 1 + τ² Z Zᵀ

with C of the stated uncertainties, C_t of times whose uncertainty is unknown, s the scatter of single
points, and τ that of the groups Z (specimens, launches, days). C and C_t are narrow bands within a
group, so that all of this takes time and memory in proportion to the points.

Source: Woodbury's identity and its square root for a term of rank one in each group.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int
from scipy import sparse

from calibration.data import Covariance, PointErrors

Columns = Float[np.ndarray, "n k"]


@dataclass(frozen=True, eq=False)
class Structure:
    """What of V does not depend on the variances, made once for all of these.

    Attributes:
        points: how what was measured enters ε and v.
        slope: dε/dv of the curve at each point [s/m].
        group: the group of each point, None without any.
    """

    points: PointErrors
    slope: Float[np.ndarray, "n"]
    group: Int[np.ndarray, "n"] | None

    @cached_property
    def unit(self) -> Covariance:
        """What is stated; for times of unknown uncertainty that of 1 s."""
        return self.points.covariance(self.slope, size=1.0 if self.points.size_is_unknown else None)

    @cached_property
    def members(self) -> sparse.csr_matrix:
        """Z in the order of the band: 1 where a point belongs to a group."""
        assert self.group is not None
        rows = np.arange(len(self.group))
        group = self.group[self.unit.order]
        return sparse.csr_matrix((np.ones(len(group)), (rows, group)))

    @cached_property
    def groups(self) -> sparse.csr_matrix:
        """Zᵀ."""
        return self.members.T.tocsr()


@dataclass(frozen=True, eq=False)
class SetErrors:
    """V of one data set, see above.

    Attributes:
        structure: what does not depend on the variances.
        variance: κ, s_t², s² and τ² of what is unknown: "scale", "timing", "scatter", "group".
    """

    structure: Structure
    variance: Mapping[str, float]

    def with_variance(self, variance: Mapping[str, float]) -> "SetErrors":
        return SetErrors(self.structure, dict(variance))

    @property
    def points(self) -> PointErrors:
        return self.structure.points

    @property
    def slope(self) -> Float[np.ndarray, "n"]:
        return self.structure.slope

    @property
    def group(self) -> Int[np.ndarray, "n"] | None:
        return self.structure.group

    @cached_property
    def alone(self) -> Covariance:
        """V without the groups' part."""
        unit = self.structure.unit
        factor = self.variance.get("timing" if self.points.size_is_unknown else "scale", 1.0)
        bands = unit.bands * factor
        bands[0] += self.variance.get("scatter", 0.0)
        return Covariance(unit.order, bands)

    @property
    def diagonal(self) -> Float[np.ndarray, "n"]:
        """The variance of each point."""
        return self.alone.diagonal + self.variance.get("group", 0.0)

    @property
    def log_determinant(self) -> float:
        """ln det V."""
        value = self.alone.log_determinant
        if self._grouped:
            value += float(np.sum(np.log1p(self._offset * self._information)))
        return value

    def whiten(self, values: Columns) -> Columns:
        """K⁻¹ x with V = K Kᵀ; each row mixes points of one group only."""
        return self._in_order(self._levelled(self.alone.whiten(values)))

    def unwhiten(self, white: Columns) -> Columns:
        """K⁻ᵀ x: of whitened values V⁻¹ x."""
        return self.alone.unwhiten(self._levelled(white[self.alone.order]))

    def solved(self, values: Columns) -> Columns:
        """V⁻¹ x."""
        return self.unwhiten(self.whiten(values))

    def coloured(self, values: Columns) -> Columns:
        """Kᵀ x, the inverse of `unwhiten`: what each error of K⁻¹ makes in xᵀ."""
        return self._in_order(self._levelled(self.alone.coloured(values), 0.5))

    def _in_order(self, rows: Columns) -> Columns:
        """Of the points, from that of the band."""
        back = np.empty_like(rows)
        back[self.alone.order] = rows
        return back

    def _levelled(self, white: Columns, power: float = -0.5) -> Columns:
        """(1 + τ² L⁻¹ Z Zᵀ L⁻ᵀ)^power x, rows in the order of the band."""
        if not self._grouped:
            return white
        gain = ((1 + self._offset * self._information) ** power - 1) / self._information
        share = gain[:, None] * (self.structure.groups @ (self._level[:, None] * white))
        return white + self._level[:, None] * (self.structure.members @ share)

    def contributions(self, values: Columns) -> dict[str, Float[np.ndarray, "k k"]]:
        """xᵀ V_c x of each part of V with an unknown variance, that variance included."""
        found = {}
        for kind, variance in self.variance.items():
            if kind == "group":
                joined = self.structure.groups @ values[self.alone.order]
            elif kind == "scatter":
                joined = values
            else:
                joined = self._elementary(values)
            found[kind] = variance * joined.T @ joined
        return found

    def applied(self, solved: Columns, values: Columns) -> list[Columns]:
        """θ_c V_c x of each unknown variance, with x = V⁻¹ y; `values` are y."""
        parts = {"scatter": self.variance.get("scatter", 0.0) * solved}
        if self._grouped:
            joined = self._offset * (self.structure.groups @ solved[self.alone.order])
            parts["group"] = np.empty_like(solved)
            parts["group"][self.alone.order] = self.structure.members @ joined
        others = values - sum(parts.values())  # of V as it is stated, or timed
        return [
            parts.get(kind, np.zeros_like(solved) if kind == "group" else others)
            for kind in self.variance
        ]

    def simulate(self, random: np.random.Generator, count: int) -> Float[np.ndarray, "count n"]:
        """Errors of ε drawn from V."""
        size = self.points.sizes(1.0) * np.sqrt(self.variance.get("timing", 1.0))
        drawn = random.standard_normal((count, len(size))) * size
        padded = np.concatenate([drawn, np.zeros((count, 1))], axis=1)
        errors = np.sum(padded[:, self.points.index] * self.points.factors(self.slope), axis=2)
        single = self.points.variance_alone(self.slope)
        errors += random.standard_normal(errors.shape) * np.sqrt(single)
        errors *= np.sqrt(self.variance.get("scale", 1.0))
        errors += random.standard_normal(errors.shape) * self.variance.get("scatter", 0.0) ** 0.5
        if self._grouped:
            offsets = random.standard_normal((count, int(np.max(self.group)) + 1))  # type: ignore[arg-type]
            errors += offsets[:, self.group] * self._offset**0.5
        return errors

    def units(self) -> list[Int[np.ndarray, "k"]]:
        """The points of each group; single points where there is one group alone, or none."""
        count = len(self.slope)
        groups = 0 if self.group is None else int(np.max(self.group)) + 1
        if groups < 2:
            return [np.array([k]) for k in range(count)]
        assert self.group is not None
        order = np.argsort(self.group, kind="stable")
        return np.split(order, np.flatnonzero(np.diff(self.group[order])) + 1)

    def precision(self, points: Int[np.ndarray, "k"]) -> Float[np.ndarray, "k k"]:
        """(V⁻¹) of some points: rows and columns of the inverse of all of V."""
        ones = np.zeros((len(self.slope), len(points)))
        ones[points, np.arange(len(points))] = 1.0
        white = self.whiten(ones)
        return white.T @ white

    @property
    def _offset(self) -> float:
        return self.variance.get("group", 0.0)

    @property
    def _grouped(self) -> bool:
        return self.group is not None and self._offset > 0

    @cached_property
    def _level(self) -> Float[np.ndarray, "n"]:
        """L⁻¹ 1, in the order of the band."""
        return self.alone.whiten(np.ones(len(self.slope)))

    @cached_property
    def _information(self) -> Float[np.ndarray, "groups"]:
        """1ᵀ C⁻¹ 1 of each group."""
        return self.structure.groups @ self._level**2

    def _elementary(self, values: Columns) -> Columns:
        """What elementary errors of one standard deviation, and single ones, add to xᵀ."""
        sizes, factors = self.points.sizes(1.0), self.points.factors(self.slope)
        sums = np.zeros((len(sizes) + 1, values.shape[1]))
        np.add.at(sums, self.points.index, factors[:, :, None] * values[:, None, :])
        every = [sums[:-1] * sizes[:, None]]
        if self.points.size is not None:
            every.append(values * np.sqrt(self.points.variance_alone(self.slope))[:, None])
        return np.concatenate(every)
