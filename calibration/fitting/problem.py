"""One problem: the likelihood of some laws' parameters as rows of residuals, and their exact Jacobian.

With g = Jᵀ r the rows have the gradient of

    cost(z) = -ln p(data | θ, s) - ln p(θ)

and JᵀJ is the information that the data are expected to have. A row of a point is its residual over its standard
deviation. Where velocities have errors, V changes with the curve: two more rows a point stand for what ln det V and
V⁻¹ add to either. Two measurements 0.95 and 0.85, each ± 0.05, of a constant ε in (0, 1), z = logit ε, at 0.9:

>>> import calibration as cal
>>> from calibration.fitting.request import Request, assemble
>>> from calibration.fitting.variance_updates import first_variances
>>> data = cal.RestitutionData([1.0, 1.0], [0.95, 0.85], uncertainty=[0.05, 0.05])
>>> (component,) = assemble(Request((data,)).with_options(law="constant"))
>>> problem = first_variances(component.stages[0][1], component.start)  # none here
>>> linear = problem.linearise(problem.transform.unconstrained(np.array([[0.9]])))
>>> linear.residual.round(6), float(linear.cost[0].round(6))  # half the sum of squares
(array([[-1.,  1.]]), 1.0)
>>> linear.jacobian[0].round(6).T  # dε/dz = ε (1 - ε), over 0.05
array([[1.8, 1.8]])

Several fits of one problem stand side by side along a leading axis: starts, refits without a point,
simulated data sets. Each has its own z, and may have its own values and counts (`Batch`).
"""

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

import softjax as sj
from calibration.data import RestitutionData
from calibration.fitting.collisions import Laws, Route, expand, extended_root, root, root_slope
from calibration.fitting.elements import DRAG, Element, Pool
from calibration.fitting.errors import NODES, Errors, MeasuredCurve
from calibration.fitting.rows import (
    Batch,
    Block,
    BlockResiduals,
    Linear,
    Points,
    PointsAt,
    Rows,
    Z,
    acts_on_nothing,
    rows_of_residuals,
    rows_of_variance,
)
from calibration.observables import OBSERVABLES, RESTITUTION
from calibration.parameters import NONE, Transform

NAMES = tuple(OBSERVABLES)
AT_ONCE = 2_000_000  # impacts that are computed at once: 16 MB a number of each
# slope, as `acts_on_nothing` measures it, below which an element far out acts on nothing; no effect
# from 1e-9 to 1e-5 on 8 fits of groups, extra scatter and the like
WEAK = 1e-7
SHIFT = (
    1e-4  # slope of the row of `Problem.gradient_shift`, in units of that: its square is not seen
)


def block_name(name: str, observable: str) -> str:
    """Name of an observable of a data set."""
    return name if observable == RESTITUTION else f"{name}: {observable}"


@dataclass(frozen=True)
class Problem:
    """Residuals of one stage as functions of its active elements."""

    datasets: tuple[RestitutionData, ...]  # the measurements
    elements: tuple[Element, ...]  # of all stages; `z` has one number for each
    transform: Transform  # of all elements
    laws: Laws  # parameters -> laws of all points
    points: Points  # what is measured
    active: Int[np.ndarray, " p"]  # which elements are searched
    route: Route = None
    errors: tuple[Errors, ...] = ()  # V(s) of each block; none where only the curve is needed
    variances: tuple[Mapping[str, Any], ...] = ()  # s of each block
    # elements that the critical velocity depends on, where ε jumps there: the cost jumps where it
    # passes the velocity of a point. None: there are none
    affects_yield: Bool[np.ndarray, " elements"] | None = None
    # whether ε is continued below 0 where nothing rebounds. That guides a search; a fit is judged
    # by the law's own ε
    guided: bool = False
    # whether data sets without stated uncertainties are weighed against each other
    joint: bool = True
    pools: tuple[Pool, ...] = ()  # which elements lie around a common mean
    # of points that stand for several: the sum of squares of these about their mean
    inside: Any = 0.0
    # z₀ and c of a term c · (z - z₀) of the cost, along the active elements
    gradient_shift: tuple[np.ndarray, np.ndarray] | None = None
    # how many Jacobians were computed, of this and of all problems that are made of it; of each of
    # those side by side
    evaluated: np.ndarray = field(default_factory=lambda: np.zeros(1, int))

    @property
    def collided_by(self) -> sj.AbstractRoute:
        """The route that is stated, else what suits the law."""
        return self.laws.shape.route if self.route is None else self.route

    @property
    def with_prior(self) -> list[int]:
        """Active elements with a prior."""
        return [k for k in self.active if self.elements[k].parameter.prior is not None]

    @property
    def count(self) -> int:
        return len(self.points.velocity)

    @cached_property
    def is_fixed(self) -> bool:
        """Whether V is diagonal and does not move with the parameters."""
        return all(errors.is_fixed for errors in self.errors)

    @cached_property
    def has_velocity_errors(self) -> bool:
        """Whether V moves with the parameters: velocities have errors."""
        return any(errors.has_velocity_errors for errors in self.errors)

    @cached_property
    def blocks(self) -> tuple[Block, ...]:
        """The data sets' observables, in the order of the points."""
        code = self.points.set * len(NAMES) + self.points.observable
        ends = [*np.flatnonzero(np.diff(code, prepend=-1)), len(code)]
        return tuple(
            Block(int(code[a]) // len(NAMES), NAMES[code[a] % len(NAMES)], slice(int(a), int(b)))
            for a, b in itertools.pairwise(ends)
        )

    @property
    def block_names(self) -> list[str]:
        """Names of the blocks, all different."""
        return [block_name(self.datasets[b.set].name, b.observable) for b in self.blocks]

    @property
    def spans(self) -> tuple[slice, ...]:
        """The points of each block."""
        return tuple(block.span for block in self.blocks)

    def of_restitution(self, place: int) -> slice:
        """The ε of the data set at a place; of another observable where it has none."""
        return next(block.span for block in self.blocks if block.set == place)

    # ------------------------------------------------------------------ evaluated at z

    def linearise(self, z: Z, batch: Batch | None = None, slopes: bool = True) -> Linear:
        """Rows and Jacobian of each fit; without `slopes` the Jacobian has no columns."""
        if batch is None and len(z) == 1:  # many things are needed at one place
            for known in (True, slopes):
                if self._last.get(known, (None,))[0] == z.tobytes():
                    return self._last[known][1]
            linear = self._linearised(z, Batch(), slopes)
            self._last.clear()
            self._last[slopes] = z.tobytes(), linear
            return linear
        batch = batch or Batch()
        most = max(
            1, AT_ONCE // max(self.count * (len(NODES) if self.has_velocity_errors else 1), 1)
        )
        rows = [slice(k, k + most) for k in range(0, max(len(z), 1), most)]
        parts = [self._linearised(z[some], batch.select(some), slopes) for some in rows]
        return Linear(*(np.concatenate(a) if a[1:] else a[0] for a in zip(*parts, strict=True)))

    def residuals_at(self, z: Z, batch: Batch | None = None) -> list[BlockResiduals]:
        """Data at z from which the variances of each block are estimated."""
        linear = self.linearise(z, batch)
        residual = linear.prediction - self._measured(batch)
        transform, x = self.transform.part(self.active), z[:, self.active]
        plain = transform.kind == NONE
        at_bound = plain & ((x <= transform.lower) | (x >= transform.upper))
        free = ~(at_bound | acts_on_nothing(linear.jacobian, np.where(plain, np.abs(x), 1.0), WEAK))

        def normal(rows: slice) -> tuple[np.ndarray, np.ndarray]:
            slopes, rest = linear.jacobian[:, rows], linear.residual[:, rows]
            return np.swapaxes(slopes, 1, 2) @ slopes, np.einsum("fmp,fm->fp", slopes, rest)

        all_rows, parts = normal(slice(linear.residual.shape[1] - self.more)), []
        for span in self.spans:
            others: list[Any] = [a - b for a, b in zip(all_rows, normal(span), strict=True)]
            if not self.joint:  # each data set is judged by itself
                others = [0 * a for a in others]
            elif len(self.errors) > 1:
                others[1] = None
            _, slope, curvature_variance = linear.measured_curve(span)
            at = (residual[:, span], linear.per[:, span], slope, curvature_variance)
            parts.append(BlockResiduals(*at, others[0], others[1], free))
        return parts

    def deviance(self, z: Z) -> Float[np.ndarray, " fits"]:
        """-2 ln p(data | θ, s)."""
        linear = self.linearise(z, slopes=False)
        total = np.zeros(len(z))
        for errors, s, span in zip(self.errors, self.variances, self.spans, strict=True):
            mean, slope, curvature_variance = linear.measured_curve(span)
            total += errors.deviance(s, mean - self.points.value[span], slope, curvature_variance)
        return total

    def diagonal(self, z: Z) -> Float[np.ndarray, "fits points"]:
        """V_ii of each point."""
        linear, parts = self.linearise(z, slopes=False), []
        for errors, s, span in zip(self.errors, self.variances, self.spans, strict=True):
            mean, slope, curvature_variance = linear.measured_curve(span)
            parts.append(errors.diagonal(s, slope, curvature_variance) + np.zeros(mean.shape))
        return np.concatenate(parts, axis=1)

    def select_points(self, rows: Any) -> "Problem":
        """Select points, a mask or places, which share no error with the others."""
        rows = np.flatnonzero(rows) if np.asarray(rows).dtype == bool else np.asarray(rows)
        points = Points(*(a[rows] for a in self.points))
        rows_of_blocks = [rows[(rows >= s.start) & (rows < s.stop)] - s.start for s in self.spans]
        remaining = [k for k, some in enumerate(rows_of_blocks) if len(some)] if self.errors else []
        return replace(
            self,
            points=points,
            laws=replace(self.laws, row=self.laws.row[rows]),
            errors=tuple(self.errors[k].select(rows_of_blocks[k]) for k in remaining),
            variances=tuple(self.variances[k] for k in remaining),
        )

    @property
    def more(self) -> int:
        """Rows that stand for what V adds."""
        return 2 * self.count if self.has_velocity_errors else 0

    @cached_property
    def drag(self) -> int | None:
        """Element of c in `Points.by_drag`; None without flights in air."""
        names = [element.name for element in self.elements]
        return names.index(DRAG) if DRAG in names else None

    @property
    def bare(self) -> "Problem":
        """The curve alone: without errors, and without the effect of the air."""
        points = self.points._replace(by_drag=0 * self.points.by_drag)
        return replace(self, errors=(), variances=(), points=points)

    def yields_at(self, z, points: Any = slice(None)) -> Float[np.ndarray, "... points"] | None:
        """The velocity below which impacts are elastic at z [m/s]; None for a law without one."""
        laws = self.laws
        if not hasattr(laws.model.law_type, "elastic_velocity"):
            return None
        theta = self.transform.physical(np.atleast_2d(z))
        rows, back = np.unique(laws.row[points], return_inverse=True)
        by_row = [
            [float(np.asarray(laws.law(values, k).elastic_velocity())) for k in rows]  # type: ignore[attr-defined]
            for values in theta
        ]
        return np.array(by_row)[:, back].reshape(*np.shape(z)[:-1], len(back))

    def law_of(self, theta: Float[np.ndarray, " elements"], g: int) -> sj.ContactLaw:
        """The law of a data set; of its first impact where it has several."""
        return self.laws.law(theta, int(self.laws.row[np.flatnonzero(self.points.set == g)[0]]))

    @property
    def jumps(self) -> bool:
        """Whether the cost jumps where the critical velocity passes the velocity of a point."""
        return self.affects_yield is not None

    def is_elastic_at(self, z: Z) -> Bool[np.ndarray, "fits points"]:
        """Which impacts are below yield; with errors of velocities, of the nodes around each point."""
        impacts = self._wide if self.has_velocity_errors else self
        return impacts.points.velocity <= impacts.yields_at(z)

    # ------------------------------------------------------------------ inside

    @cached_property
    def _last(self) -> dict[bool, tuple[bytes, Linear]]:
        """The last place, with or without slopes."""
        return {}

    def _measured(self, batch: Batch | None) -> np.ndarray:
        return self.points.value if batch is None or batch.value is None else batch.value

    def _linearised(self, z: Z, batch: Batch, slopes: bool) -> Linear:
        theta, per_z = self.transform.physical(z), self.transform.slope(z)
        active = self.active if slopes else self.active[:0]
        np.add.at(self.evaluated, np.zeros(len(z), int) if batch.of is None else batch.of, slopes)
        curve, per, status = self._curve(theta, per_z, active, batch)
        residual = curve.mean - self._measured(batch)
        rows, last = [Rows(residual[:, :0], per.mean[:, :0], np.zeros(len(z)))], []
        for at in self._blocks_at(curve, per, residual, batch):
            factor, variance = at.factor, at.variance
            rows.append(rows_of_residuals(at, factor, variance))
            if self.has_velocity_errors:
                last.append(rows_of_variance(at, factor, variance, rows[-1]))
        rows += self._rows_of_priors(z, theta, per_z, active, batch.centre)
        if self.gradient_shift is not None:
            rows.append(self._row_of_shift(z, active, *self.gradient_shift))
        value, columns, cost = zip(*rows, *last, strict=True)
        jacobian = np.concatenate(columns, axis=1)
        at_points = curve.mean, per.mean, curve.slope, curve.curvature_variance, status
        total = np.sum(cost, axis=0)
        return Linear(np.concatenate(value, axis=1), jacobian, total, *at_points)

    def _blocks_at(
        self, curve: MeasuredCurve, per: MeasuredCurve, residual: np.ndarray, batch: Batch
    ) -> Iterator[PointsAt]:
        """The points of each block at z; none where only the curve is needed."""
        copies = self.points.copies if batch.copies is None else batch.copies
        copies = np.broadcast_to(copies, residual.shape)
        inside = np.broadcast_to(self.inside, self.count)
        variances = self.variances if batch.variances is None else batch.variances
        blocks = self.spans if self.errors else ()
        for errors, s, span in zip(self.errors, variances, blocks, strict=True):
            mean, slopes = (MeasuredCurve(*(a[:, span] for a in some)) for some in (curve, per))
            counts, squares = copies[:, span], inside[span]
            yield PointsAt(errors, s, mean, slopes, residual[:, span], counts, squares)

    def _row_of_shift(self, z, active, centre: np.ndarray, slope: np.ndarray) -> Rows:
        """A row of the cost c · (z - z₀): of a slope so small that it is not seen in JᵀJ."""
        along = (z - centre)[:, self.active] @ slope
        columns = np.broadcast_to(SHIFT * slope[: len(active)], (len(z), 1, len(active)))
        return Rows(np.full((len(z), 1), 1 / SHIFT), columns, along)

    def _curve(
        self, theta, per_z, active, batch: Batch
    ) -> tuple[MeasuredCurve, MeasuredCurve, np.ndarray]:
        """The curve at the points, its slopes along some elements, and the status."""
        fits, p = len(theta), len(active)
        if not self.has_velocity_errors:
            value, local, status = self._predicted(theta, batch)
            none = np.broadcast_to(0.0, value.shape)
            mean, slopes = value, self._by_element(local, per_z, active)
            curve, per = MeasuredCurve(mean, none, none), MeasuredCurve(slopes, none, none)
        else:
            wide, nodes = self._wide, len(self._wide.points.velocity) // self.count
            value, local, status = wide._predicted(theta, batch)
            jacobian = wide._by_element(local, per_z, active)
            value = value.reshape(fits, nodes, self.count)
            jacobian = jacobian.reshape(fits, nodes, self.count, p)
            parts, of_parts = [], []
            for errors, span in zip(self.errors, self.spans, strict=True):
                parts.append(errors.measured_curve(value[..., span]))
                of_parts.append(
                    errors.measured_curve_slopes(
                        value[..., span], jacobian[:, :, span], parts[-1].slope
                    )
                )
            curve, per = (
                MeasuredCurve(*(np.concatenate(a, axis=1) for a in zip(*some, strict=True)))
                for some in (parts, of_parts)
            )
        if self.drag is None:
            return curve, per, status[:, : self.count]
        by_drag = self.points.by_drag
        curve = curve._replace(mean=curve.mean + theta[:, self.drag, None] * by_drag)
        column = np.flatnonzero(active == self.drag)
        if len(column):
            per.mean[:, :, column[0]] += by_drag * per_z[:, self.drag, None]
        return curve, per, status[:, : self.count]

    @cached_property
    def _wide(self) -> "Problem":
        """The impacts at the nodes around their velocities."""
        nodes = np.concatenate([errors.nodes for errors in self.errors], axis=1)
        count = len(nodes)
        points = Points(nodes.ravel(), *(np.tile(a, count) for a in self.points[1:]))
        laws = replace(self.laws, row=np.tile(self.laws.row, count))
        return replace(self, points=points, laws=laws, errors=())

    def _predicted(self, theta, batch: Batch):
        """The value at each fit and point, its slopes in the local parameters, and the status."""
        leaves, of_leaves = self.laws.leaves(theta, batch.contact, batch.fixed)
        value = np.empty((len(theta), self.count))
        status, slopes = np.empty(value.shape, int), None
        for code in np.unique(self.points.observable):
            some = np.flatnonzero(self.points.observable == code)
            at: Any = slice(None) if len(some) == self.count else some
            value[:, at], per, status[:, at] = self._of_observable(leaves, at, NAMES[code], batch)
            slopes = np.empty((len(per), *value.shape)) if slopes is None else slopes
            slopes[:, :, at] = per
        if of_leaves is not None:  # from the slopes in the leaves
            slopes = np.einsum("afn,fnaq->qfn", slopes, of_leaves[:, self.laws.row])
        return value, slopes, status

    def _of_observable(self, leaves, at, name: str, batch: Batch):
        """Predictions at points of one observable, with derivatives in the leaves that are not fixed."""
        laws, row, fits = self.laws, self.laws.row[at], len(leaves[0])
        flat = []
        for k, leaf in enumerate(leaves):
            fixed = laws.shape.shared[k] and k not in laws.moving
            values = leaf[0, 0] if fixed else leaf[:, row].reshape(-1, *leaf.shape[2:])
            flat.append(np.asarray(values, float))
        velocity = self.points.velocity if batch.velocity is None else batch.velocity
        velocity = np.broadcast_to(velocity, (fits, self.count))[:, at].ravel()
        expanded = expand(laws.shape, flat, velocity, laws.moving, self.route, name)
        value, slopes, status = (a.reshape(*a.shape[:-1], fits, len(row)) for a in expanded)
        if not OBSERVABLES[name].is_signed_square:
            return value / self.points.unit[at], slopes / self.points.unit[at], status
        eps, per = extended_root(value) if self.guided else (root(value), root_slope(value))
        return eps, slopes * per, status

    def _by_element(self, local, per_z, active) -> Float[np.ndarray, "fits points p"]:
        """dε/dz along some elements."""
        laws = self.laws
        place = np.full(len(self.elements) + 1, -1)
        place[active] = np.arange(len(active))
        jacobian = np.zeros((len(per_z), self.count, len(active)))
        for k, slope in zip(laws.free if len(active) else (), local, strict=False):
            first = laws.element[k, 0]
            if np.all(laws.element[k] == first):
                if place[first] >= 0:
                    jacobian[:, :, place[first]] += slope * per_z[:, first, None]
                continue
            element = laws.element[k][laws.row]
            on = np.flatnonzero(place[element] >= 0)
            element = element[on]
            jacobian[:, on, place[element]] += slope[:, on] * per_z[:, element]
        return jacobian

    def _rows_of_priors(self, z, theta, per_z, active, centre) -> Iterator[Rows]:
        """Rows of the priors, (θ - mean)/sd, and of each pool, (z - mean of z)/spread."""
        for value, slopes in self._priors(z, theta, per_z, centre):
            yield Rows(value, slopes[:, :, : len(active)], 0.5 * np.sum(value**2, axis=1))

    def _priors(self, z, theta, per_z, centre):
        elements, fits = self.with_prior, len(z)
        if elements:
            mean, deviation = np.transpose([self.elements[k].parameter.prior for k in elements])
            mean = mean if centre is None else centre[:, elements]
            rows = (self.active == np.array(elements)[:, None]) / deviation[:, None]
            yield (theta[:, elements] - mean) / deviation, rows * per_z[:, elements, None]
        for pool in self.pools:
            members, count = list(pool.members), len(pool.members)
            per = np.zeros((count, len(self.elements)))
            per[:, members] = (np.eye(count) - 1 / count) / pool.spread
            deviation = z[:, members] - (0.0 if centre is None else centre[:, members])
            deviation = deviation - np.mean(deviation, axis=1, keepdims=True)
            slopes = np.broadcast_to(per[:, self.active], (fits, count, len(self.active)))
            yield deviation / pool.spread, slopes
