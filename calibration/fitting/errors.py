"""The errors of one observable of one data set, V(s), and the density of its residuals.

This is the one likelihood of a fit. Values other than ε are in units of what was measured, and so are
their errors: a scatter of theirs is relative.

    V = κ (stated) + s_t² (times of bounces) + s² 1 + τ² Z Zᵀ

Three points, the first two of one group, with a scatter of 0.01 and offsets of groups of 0.02:

>>> import calibration as cal
>>> data = cal.RestitutionData([1.0, 2.0, 3.0], [0.9, 0.8, 0.7], group=["a", "a", "b"])
>>> errors, s = Errors.of(data), {"scatter": 1e-4, "group": 4e-4}
>>> 1e4 * errors.times(errors.factor(s, 0.0, 0.0), np.eye(3)).round(9)
array([[5., 4., 0.],
       [4., 5., 0.],
       [0., 0., 5.]])

A velocity with an error u_v enters ε through the curve. With δ ~ N(0, u_v²), by five Gauss–Hermite
nodes around the measured velocity,

    E[ε] = E f(v + δ),   g = E[f δ]/u_v²,   c = Var f - g² u_v²,
    V_ii = var(δε) - 2 g cov(δε, δv) + g² u_v² + c

which is f + ½ f″ u_v² and f′² u_v² + ½ f″² u_v⁴ where f bends little, and stays right at a kink. The true velocity
is expected to be off by d (`true_velocities`), which adds (g - cov(δε, δv)/u_v²) d to E[ε]. Where ε falls by 0.1
a m/s, 0.1 m/s counts as much as 0.01 of ε:

>>> data = cal.RestitutionData([1.0], [0.9], uncertainty=[0.02], velocity_uncertainty=[0.1])
>>> errors = Errors.of(data)
>>> curve = errors.measured_curve(1 - 0.1 * errors.nodes)
>>> float(curve.slope[0].round(9)), float(errors.diagonal({}, *curve[1:])[0].round(9))
(-0.1, 0.0005)

The density of residuals that share nothing is that of a family in `noise.py`; normal residuals that do have

    -2 ln p = ln det V + rᵀ V⁻¹ r + n ln 2π

Everything here works for NumPy and for jax.numpy (`xp`), and for many fits side by side, whose axis
leads: variances (fits,), residuals and slopes (fits, n), columns (fits, n, k).

Source: Woodbury's identity and its square root for a term of rank one in each group; Särkkä, Bayesian
Filtering and Smoothing (2013), section 5.3, of the statistical linearisation.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Int

from calibration.data import PointErrors, RestitutionData
from calibration.fitting.noise import LN_2PI, Family, Normal, broadcast_variance, family_of
from calibration.fitting.true_velocities import expected_shift, with_power
from calibration.observables import Observed
from calibration.options import FitOptions

ROOT = 10**0.5  # of Gauss and Hermite
NODES = np.sqrt([0, 5 + ROOT, 5 - ROOT, 5 - ROOT, 5 + ROOT]) * [0, -1, -1, 1, 1]
SHARES = np.array([32, 7 - 2 * ROOT, 7 + 2 * ROOT, 7 + 2 * ROOT, 7 - 2 * ROOT]) / 60
# of a velocity, the least distance of the nodes; no effect from 1e-6 to 1e-2 on a fit of times and
# on three of velocities half of which are exact
STEP = 1e-4
# of a velocity: no node lies below; reached by errors of 35 % and more, of 40 % 0.002 and 0.1 move
# -2 ln L of three fits by up to 1
SLOWEST = 0.02
PLAIN = FitOptions()
CALLED = {"scatter": "noise"}  # in θ the square root of a variance; others have one name
Variances = Mapping[str, Any]


class MeasuredCurve(NamedTuple):
    """The curve with uncertain velocities: mean of ε, g = dε/dv, and c; see above."""

    mean: Any
    slope: Any
    curvature_variance: Any


class Factor(NamedTuple):
    """V = K Kᵀ with K = L (1 + τ² l lᵀ)^½ in each group."""

    # L; deviations where no points share input errors, else of launches by their size
    lower: Any
    level: Any = None  # l = L⁻¹ 1, and `per` its square over each group; None without groups
    per: Any = None
    offset: Any = None  # τ²


@dataclass(frozen=True, eq=False)
class Errors:
    """Errors of one data set."""

    points: PointErrors  # how what was measured enters ε and v
    # the group of each point, None where no offset of groups is unknown
    group: Int[np.ndarray, " n"] | None
    # variances that are not stated: "scale" κ, "timing" s_t² [s², of heights m²], "scatter" s², "group" τ²
    unknown: tuple[str, ...]
    noise: Family
    # degrees of freedom behind stated uncertainties, None where they are known
    degrees: float | None
    velocity: np.ndarray  # the measured velocities, and up to where a node may lie [m/s]
    fastest: Any
    shift: Any = 0.0  # d, of `true_velocities` [m/s]
    log_unit: Any = 0.0  # ln of the unit of each value, so that densities are those of values in SI
    # the group of each point, whether or not they have an offset; None without groups
    labels: Int[np.ndarray, " n"] | None = None

    @classmethod
    def of(cls, data: RestitutionData, options=PLAIN, observed: Observed | None = None) -> "Errors":
        """The errors that the data state of ε, or of what else was observed, and those that options add."""
        rows = np.flatnonzero(np.isfinite(data.restitution)) if observed is None else observed.rows
        points, degrees = data.errors, data.degrees
        log_unit: Any = 0.0
        if observed is not None:
            of_eps = observed.in_parts
            u_v = data.velocity_uncertainty
            of_velocity = None if u_v is None else u_v[rows]
            points = PointErrors.independent(len(rows), of_eps, of_velocity)
            degrees, log_unit = None, np.log(observed.scale)
        elif len(rows) < len(data):
            points = points.select(rows)
            degrees = degrees if np.ndim(degrees) == 0 else degrees[rows]
        stated = points.uncertainty is not None
        group = data.group_index
        if group is not None:
            group = np.unique(group[rows], return_inverse=True)[1]
        has_groups = group is not None and 1 < np.max(group, initial=0) + 1 < len(rows)
        is_estimated = {
            "scale": stated and options.scale_uncertainty,
            "timing": points.size_is_unknown,
            "scatter": not stated or options.extra_scatter,
            "group": has_groups,
        }
        limit = np.asarray(np.inf if data.limit_velocity is None else data.limit_velocity)
        limit = limit[rows] if limit.ndim else limit
        velocity = data.velocity[rows]
        points, power = with_power(points, velocity)
        errors = cls(
            points,
            group if has_groups else None,
            tuple(kind for kind, is_unknown in is_estimated.items() if is_unknown),
            family_of(options),
            None if degrees is None else float(np.mean(degrees)),
            velocity,
            limit,
            log_unit=log_unit,
            labels=group,
        )
        # times of a train, good to parts of a thousand, are in two points each
        u_v = 0.0 * velocity if points.shares else errors._of_velocity
        return replace(errors, shift=expected_shift(velocity, u_v, power))

    @classmethod
    def known(cls, velocity: np.ndarray, variance: Any) -> "Errors":
        """Independent errors of known variance."""
        deviation = np.sqrt(np.broadcast_to(variance, len(velocity)))
        points = PointErrors.independent(len(velocity), np.maximum(deviation, 1e-150))
        return cls(points, None, (), Normal(), None, velocity, np.inf)

    def __len__(self) -> int:
        return len(self.velocity)

    @property
    def is_stated(self) -> bool:
        """Whether the uncertainties are stated and used as they are."""
        return not {"scatter", "timing", "scale"} & set(self.unknown)

    @property
    def is_plain(self) -> bool:
        """Whether one scatter of single points is all that there is."""
        nothing = self.points.uncertainty is None and not self.has_velocity_errors
        return nothing and set(self.unknown) <= {"scatter"} and not self.shares

    @property
    def shares(self) -> bool:
        """Whether points share errors: those of a group, or of a bounce sequence."""
        return self.group is not None or self.points.shares

    @cached_property
    def has_velocity_errors(self) -> bool:
        """Whether V depends on the curve: velocities have errors."""
        return bool(np.any(self.points.to_velocity)) or bool(np.any(self._u_velocity))

    @property
    def units(self) -> Int[np.ndarray, " n"]:
        """Numbers of the points, 0, 1, 2, ..., equal for those of one group or launch."""
        if self.labels is not None:
            return self.labels
        numbers = np.arange(len(self))
        if self.points.shares:
            for members, _ in self._launches:
                numbers[members] = members[:, :1]
        return np.unique(numbers, return_inverse=True)[1]

    @property
    def is_fixed(self) -> bool:
        """Whether V is diagonal and does not move with the law's parameters."""
        return not (self.shares or self.has_velocity_errors)

    # ------------------------------------------------------------------ errors of velocities

    @cached_property
    def steps(self) -> np.ndarray:
        """Distance of the nodes over their standard abscissae, (n,) [m/s]."""
        return np.maximum(self._of_velocity, STEP * self.velocity)

    @cached_property
    def nodes(self) -> np.ndarray:
        """Velocities at which the curve is computed, (5, n) [m/s]; the first are those measured."""
        unclipped = self.velocity + NODES[:, None] * self.steps
        return np.clip(unclipped, SLOWEST * self.velocity, self.fastest)

    def measured_curve(self, value: Any) -> MeasuredCurve:
        """Mean of ε from its values at the nodes, (..., 5, n)."""
        shares, ratio = SHARES[:, None], (self._of_velocity / self.steps) ** 2
        mean = (shares * value).sum(-2)
        slope = (shares * NODES[:, None] * value).sum(-2) / self.steps
        beyond = (shares * (value - mean[..., None, :]) ** 2).sum(-2) - (slope * self.steps) ** 2
        first = value[..., 0, :]
        of_shift = (slope - self._pull) * self.shift
        return MeasuredCurve(first + ratio * (mean - first) + of_shift, slope, ratio**2 * beyond)

    def measured_curve_slopes(self, value: Any, per: Any, slope: Any) -> MeasuredCurve:
        """Mean of the derivatives from their values at the nodes, (..., 5, n, p); `slope` is g."""
        shares, ratio = SHARES[:, None, None], ((self._of_velocity / self.steps) ** 2)[:, None]
        steps, x = self.steps[:, None], NODES[:, None, None]
        mean = (SHARES[:, None] * value).sum(-2)
        of_mean = (shares * per).sum(-3)
        of_slope = (shares * x * per).sum(-3) / steps
        deviation = (value - mean[..., None, :])[..., None]
        beyond = 2 * (shares * deviation * per).sum(-3) - 2 * slope[..., None] * steps**2 * of_slope
        first = per[..., 0, :, :]
        of_mean = first + ratio * (of_mean - first) + of_slope * self.shift[:, None]
        return MeasuredCurve(of_mean, of_slope, ratio**2 * beyond)

    def changes(self, s: Variances, slope: Any) -> tuple[Any, Any]:
        """½ ∂V_ii/∂g and ½ ∂V_ii/∂c of each point."""
        half = 0.5 * self._size(s)
        return 2 * half * (slope * self._moments[1] - self._moments[2]), half

    # ------------------------------------------------------------------ V

    def variance(self, s: Variances, slope: Any, curvature_variance: Any) -> Any:
        """V_ii without the groups' part."""
        u_eps, u_v, both = self._moments
        stated = u_eps + slope * (slope * u_v - 2 * both) + curvature_variance
        return self._size(s) * stated + broadcast_variance(s.get("scatter", 0.0))

    def steady(self, s: Variances) -> Any:
        """The least V_ii that any slope of the curve makes; the zero of ln det V for a search."""
        u_eps, u_v, both = self._moments
        least = u_eps - both**2 / np.where(u_v > 0, u_v, 1.0)
        least = np.maximum(least, 1e-6 * (u_eps + u_v))
        return np.maximum(self._size(s) * least + broadcast_variance(s.get("scatter", 0.0)), 1e-300)

    def diagonal(self, s: Variances, slope: Any = 0.0, curvature_variance: Any = 0.0) -> Any:
        """V_ii of each point, with the groups' part."""
        return self.variance(s, slope, curvature_variance) + broadcast_variance(s.get("group", 0.0))

    def factor(self, s: Variances, slope: Any, curvature_variance: Any, xp: Any = np) -> Factor:
        """Factor of V at given variances and slopes of the curve."""
        variance = self.variance(s, slope, curvature_variance)
        lower = xp.sqrt(variance + xp.zeros(len(self)))
        if self.points.shares:
            lower = tuple(
                xp.linalg.cholesky(block)
                for block in self._blocks(s, slope, curvature_variance, xp)
            )
        if self.group is None or "group" not in s:
            return Factor(lower)
        level = self._solved(lower, xp.ones((len(self), 1)), xp)[..., 0]
        per = self._sums(level[..., None] ** 2, xp)[..., 0]
        return Factor(lower, level, per, broadcast_variance(xp.asarray(s["group"])))

    def whiten(self, factor: Factor, x: Any, xp: Any = np) -> Any:
        """K⁻¹ x of columns (..., n, k); each row mixes points of one group only."""
        return self._levelled(factor, self._solved(factor.lower, x, xp), -0.5, xp)

    def solve(self, factor: Factor, x: Any, xp: Any = np) -> Any:
        """V⁻¹ x."""
        levelled = self._levelled(factor, self._solved(factor.lower, x, xp), -1.0, xp)
        return self._solved(factor.lower, levelled, xp, turned=True)

    def colour(self, factor: Factor, x: Any, xp: Any = np) -> Any:
        """K x: errors of covariance V from standard normal numbers (..., n)."""
        rows = self._levelled(factor, x[..., None], 0.5, xp)
        return self._applied(factor.lower, rows, xp)[..., 0]

    def times(self, factor: Factor, x: Any, xp: Any = np) -> Any:
        """V x."""
        rows = self._levelled(factor, self._applied(factor.lower, x, xp, turned=True), 1.0, xp)
        return self._applied(factor.lower, rows, xp)

    def log_det(self, factor: Factor, xp: Any = np) -> Any:
        """ln det V."""
        if self.points.shares:
            of_block = lambda a: xp.log(xp.diagonal(a, axis1=-2, axis2=-1)).sum((-2, -1))  # noqa: E731
            total = 2 * sum(of_block(lower) for lower in factor.lower)
        else:
            total = 2 * xp.log(factor.lower).sum(-1)
        if factor.level is None:
            return total
        return total + xp.log1p(factor.offset * factor.per).sum(-1)

    def precisions(self, factor: Factor, xp: Any = np) -> Any:
        """(V⁻¹)_ii, (..., n)."""
        if self.points.shares:
            rows = []
            for lower in factor.lower:
                inverse = xp.linalg.inv(lower)
                rows.append((inverse**2).sum(-2).reshape(*lower.shape[:-3], -1))
            precisions = xp.concatenate(rows, -1)[..., self._back]
        else:
            precisions = factor.lower**-2.0
        if factor.level is None:
            return precisions
        deviations = self._solved(factor.lower, factor.level[..., None], xp, turned=True)[..., 0]
        share = factor.offset / (1 + factor.offset * factor.per)
        return precisions - share[..., self.group] * deviations**2

    def scores(self, factor: Factor, s: Variances, slope: Any, residual: Any) -> tuple[Any, Any]:
        """∂(-ln p)/∂g and ∂(-ln p)/∂c of each point, of normal errors; for NumPy."""
        solved = self.solve(factor, residual[..., None])[..., 0]
        excess = self.precisions(factor) - solved**2
        by_slope, by_curvature_variance = self.changes(s, slope)
        if not self.points.shares:
            return excess * by_slope, excess * by_curvature_variance
        independent = self._size(s) * slope * self._u_velocity**2
        sizes = np.sqrt(self._size(s) + np.zeros(1))[..., None] * self.points.sizes_at(1.0)
        f, w = self._factors(s, slope, np), -self.points.to_velocity * sizes
        level = None
        if factor.level is not None:
            level = self._solved(factor.lower, factor.level[..., None], np, turned=True)
            share = factor.offset / (1 + factor.offset * factor.per)
        parts = []
        for lower, (members, incidence) in zip(factor.lower, self._launches, strict=True):
            inverse, q = np.linalg.inv(lower), solved[..., members, None]
            inner = np.swapaxes(inverse, -1, -2) @ inverse - q @ np.swapaxes(q, -1, -2)
            if level is not None:
                h = level[..., members, :]
                of_group = share[..., self.group[members[:, 0]], None, None]  # type: ignore[index]
                inner -= of_group * h @ np.swapaxes(h, -1, -2)
            spread, turned = (
                np.einsum("...bik,bike->...bie", a[..., members, :], incidence) for a in (f, w)
            )
            mixed = turned @ np.swapaxes(spread, -1, -2)
            parts.append((inner * mixed).sum(-1).reshape(*lower.shape[:-3], -1))
        return independent * excess + np.concatenate(parts, -1)[
            ..., self._back
        ], excess * by_curvature_variance

    # ------------------------------------------------------------------ densities

    def deviance(
        self, s: Variances, residual: Any, slope: Any, curvature_variance: Any, xp: Any = np
    ) -> Any:
        """-2 ln p of all points together."""
        if not self.shares:
            return -2 * self.by_point(s, residual, slope, curvature_variance, xp).sum(-1)
        factor = self.factor(s, slope, curvature_variance, xp)
        white = self.whiten(factor, residual[..., None], xp)[..., 0]
        known = len(self) * LN_2PI + 2 * np.sum(self.log_unit)
        return self.log_det(factor, xp) + (white**2).sum(-1) + known

    def by_point(
        self, s: Variances, residual: Any, slope: Any, curvature_variance: Any, xp: Any = np
    ) -> Any:
        """ln p of each point; where points share errors, of each where the others are known.

        Source: Bürkner, Gabry and Vehtari, Comput. Stat. 36, 1243 (2021), Eq. 8.
        """
        if not self.shares:
            variance = self.variance(s, slope, curvature_variance)
            return self.noise.log_density(residual, variance, xp) - self.log_unit
        factor = self.factor(s, slope, curvature_variance, xp)
        precision = self.precisions(factor, xp)
        solved = self.solve(factor, residual[..., None], xp)[..., 0]
        return -0.5 * (solved**2 / precision - xp.log(precision) + LN_2PI) - self.log_unit

    def simulate(self, s: Variances, curve: MeasuredCurve, random, count: int) -> np.ndarray:
        """Errors of ε, (count, n)."""
        normal = random.standard_normal((count, len(self)))
        drawn = self.colour(self.factor(s, curve.slope, curve.curvature_variance), normal)
        return self.noise.drawn(drawn, random)

    def select(self, rows: np.ndarray) -> "Errors":
        """Select points, which share no error with the others."""
        group = None if self.group is None else np.unique(self.group[rows], return_inverse=True)[1]
        fastest = np.broadcast_to(self.fastest, len(self))[rows]
        return replace(
            self,
            points=self.points.select(rows),
            group=group,
            labels=None if self.labels is None else self.labels[rows],
            velocity=self.velocity[rows],
            fastest=fastest,
            shift=self.shift[rows],
            log_unit=self.log_unit if np.ndim(self.log_unit) == 0 else self.log_unit[rows],
        )

    # ------------------------------------------------------------------ inside

    def _size(self, s: Variances) -> Any:
        """Factor of the stated errors, or size of the times if their uncertainty is unknown."""
        return broadcast_variance(s.get("timing" if self.points.size_is_unknown else "scale", 1.0))

    @cached_property
    def _u_velocity(self) -> np.ndarray:
        u = self.points.u_velocity
        return np.zeros(len(self)) if u is None else u

    @cached_property
    def _moments(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Variance of each ε, of its v, and their covariance; of times of 1 s where that is unknown."""
        points, sizes = self.points, self.points.sizes_at(1.0)
        to_eps, to_v = points.to_restitution * sizes, points.to_velocity * sizes
        independent = 0.0 if points.u_restitution is None else points.u_restitution**2
        of_velocity = np.sum(to_v**2, axis=1) + self._u_velocity**2
        return np.sum(to_eps**2, axis=1) + independent, of_velocity, np.sum(to_eps * to_v, axis=1)

    @cached_property
    def _of_velocity(self) -> np.ndarray:
        """Standard uncertainty of each v; 0 where it is not stated."""
        if self.points.size_is_unknown:
            return np.zeros(len(self))
        return np.sqrt(self._moments[1])

    @cached_property
    def _pull(self) -> np.ndarray:
        """Mean error of ε over that of v, from the errors that they share."""
        both, u_v = self._moments[2], self._moments[1]
        return both / np.where(u_v > 0, u_v, 1.0)

    @cached_property
    def _launches(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Points joined by input errors, those of one number together.

        Members (b, m), and which input error of the launch each enters, (b, m, 3, e).
        """
        from scipy.sparse import coo_matrix, csgraph

        index, n = self.points.index, len(self)
        used = index >= 0
        at = np.broadcast_to(np.arange(n)[:, None], index.shape)[used]
        size = (n + int(index.max(initial=-1)) + 1,) * 2
        ties = coo_matrix((np.ones(len(at)), (at, n + index[used])), size)
        codes = np.unique(csgraph.connected_components(ties, False)[1][:n], return_inverse=True)[1]
        order = np.argsort(codes, kind="stable")
        every = np.split(order, np.flatnonzero(np.diff(codes[order])) + 1)
        launches = []
        for width in sorted({len(rows) for rows in every}):
            members = np.array([rows for rows in every if len(rows) == width])
            local = np.full((*members.shape, index.shape[1]), -1)
            for b, own in enumerate(index[members]):
                local[b] = np.where(own >= 0, np.searchsorted(np.unique(own[own >= 0]), own), -1)
            incidence = local[..., None] == np.arange(int(local.max()) + 1)
            launches.append((members, incidence.astype(float)))
        return launches

    @cached_property
    def _back(self) -> np.ndarray:
        """Position of each point among the members of the launches."""
        return np.argsort(np.concatenate([members.ravel() for members, _ in self._launches]))

    @cached_property
    def _order(self) -> np.ndarray:
        return np.argsort(self.group, kind="stable")  # type: ignore[arg-type]

    @cached_property
    def _starts(self) -> np.ndarray:
        group = self.group[self._order]  # type: ignore[index]
        return np.unique(group, return_index=True)[1]

    def _factors(self, s: Variances, slope: Any, xp: Any) -> Any:
        """Effect of one standard deviation of each input error on ε, (..., n, 3)."""
        size = xp.sqrt(self._size(s) + xp.zeros(1))
        slope = slope + xp.zeros(len(self))
        f = self.points.to_restitution - slope[..., None] * self.points.to_velocity
        return f * self.points.sizes_at(1.0) * size[..., None]

    def _blocks(self, s: Variances, slope: Any, curvature_variance: Any, xp: Any) -> list[Any]:
        """V of the launches without the groups' part."""
        f = self._factors(s, slope, xp)
        independent = (
            self.variance(s, slope, curvature_variance) + xp.zeros(len(self)) - (f**2).sum(-1)
        )
        blocks = []
        for members, incidence in self._launches:
            spread = xp.einsum("...bik,bike->...bie", f[..., members, :], incidence)
            variance = independent[..., members, None]
            block = spread @ xp.swapaxes(spread, -1, -2)
            blocks.append(block + variance * np.eye(members.shape[1]))
        return blocks

    def _solved(self, lower: Any, x: Any, xp: Any, turned: bool = False) -> Any:
        """L⁻¹ x, or L⁻ᵀ x."""
        if not self.points.shares:
            return x / lower[..., None]
        of_block = lambda a, rows: xp.linalg.solve(xp.swapaxes(a, -1, -2) if turned else a, rows)  # noqa: E731
        return self._by_launch(of_block, lower, x, xp)

    def _applied(self, lower: Any, x: Any, xp: Any, turned: bool = False) -> Any:
        """L x, or Lᵀ x."""
        if not self.points.shares:
            return x * lower[..., None]
        of_block = lambda a, rows: (xp.swapaxes(a, -1, -2) if turned else a) @ rows  # noqa: E731
        return self._by_launch(of_block, lower, x, xp)

    def _by_launch(self, of_block: Any, lower: Any, x: Any, xp: Any) -> Any:
        parts = []
        for factor, (members, _) in zip(lower, self._launches, strict=True):
            rows = of_block(factor, x[..., members, :])
            parts.append(rows.reshape(*rows.shape[:-3], -1, rows.shape[-1]))
        return xp.concatenate(parts, -2)[..., self._back, :]

    def _levelled(self, factor: Factor, white: Any, power: float, xp: Any) -> Any:
        """(1 + τ² l lᵀ)^power x in each group."""
        if factor.level is None:
            return white
        level = factor.level[..., None]
        gain = ((1 + factor.offset * factor.per) ** power - 1) / factor.per
        share = gain[..., None] * self._sums(level * white, xp)
        return white + level * share[..., self.group, :]

    def _sums(self, values: Any, xp: Any) -> Any:
        """Sum over the points of each group, (..., groups, k)."""
        if xp is np:
            return np.add.reduceat(values[..., self._order, :], self._starts, axis=-2)
        import jax

        assert self.group is not None
        rows = xp.moveaxis(values, -2, 0)
        summed = jax.ops.segment_sum(rows, self.group, int(np.max(self.group)) + 1)
        return xp.moveaxis(summed, 0, -2)
