"""One problem: the likelihood of some laws' parameters as rows of residuals, and their exact Jacobian.

With g = Jᵀ r the rows have the gradient of -ln p(data | θ, s) - ln p(θ), and JᵀJ is the information
that the data are expected to have; their cost is that density itself. Where velocities have errors, V
moves with the curve: two more rows a point stand for what ln det V and V⁻¹ add to either.

Several fits of one problem stand side by side along a leading axis: starts, refits without a point,
simulated data sets. Each has its own z, and may have its own values and counts (`Batch`).
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float, Int

import softjax as sj
from calibration.data import RestitutionData
from calibration.fitting.collisions import Laws, Route, expand, extended_root, root, root_slope
from calibration.fitting.errors import Errors, MeasuredCurve
from calibration.observables import OBSERVABLES, RESTITUTION
from calibration.parameters import NONE, Parameter, Transform
from softjax.fields import Declared

Z = Float[np.ndarray, "fits elements"]
FARTHEST = 25.0  # from the start of a search, in log units: beyond, nothing changes any more
NAMES = tuple(OBSERVABLES)
DRAG = "air_drag"  # c, what the drag coefficient of flights in air is off by, in parts
FIRST_SPREAD = 3.0  # of a pool, in z: factors of 20
AT_ONCE = 2_000_000  # impacts that are computed at once: what bounds the memory
ROUNDED = 1e-10  # of the strongest element, below which the effect of one is rounding
WEAK = 1e-7  # the same of an element far out at an end of its range
PULL = 1e-4  # slope of the row of `Problem.pull`, in units of that: its square is not seen


@dataclass(frozen=True)
class Element:
    """One parameter of a data set's law; one number that a fit searches, where it is free.

    Attributes:
        name: in full, an entry of an array as "weights[3]".
        parameter, declared: what was said of it, and what its law says.
        start: where it starts, or what it is fixed at, in physical units; one number, or one an impact.
        range: (lowest, highest).
        stands_in: whether it is fixed at a number that nobody stated and that acts nowhere in the
            data: ψ where ε_up is fitted in its place.
        label: what results call it: "chi", or "chi[name]" where there are several data sets.
        sets: the data sets that it belongs to, of those of its component.
        end: where a search upwards ends if no highest is stated.
        reach: how far up from its start a search may go, in log units.
    """

    name: str
    parameter: Parameter
    declared: Declared
    start: Any
    range: tuple[float, float]
    stands_in: bool = False
    label: str = ""
    sets: tuple[int, ...] = ()
    end: float = np.inf
    reach: float = FARTHEST

    @property
    def group(self) -> str | None:
        """The group of data sets that it is shared in: "" for all of them, None for none."""
        shared = self.parameter.shared
        if self.parameter.pooled:
            return None
        return ("" if shared else None) if isinstance(shared, bool) else shared


class Pool(NamedTuple):
    """Elements of several data sets that lie around a common mean, on the scale that is searched."""

    name: str  # of the parameter
    members: tuple[int, ...]  # places of the elements
    spread: float  # standard deviation of the members in z

    @property
    def spread_name(self) -> str:
        """Name of the spread in results; the mean has the name of the parameter."""
        return f"{self.name}_spread"


def block_name(name: str, observable: str) -> str:
    """Name of an observable of a data set."""
    return name if observable == RESTITUTION else f"{name}: {observable}"


def pools_of(elements: Sequence[Element]) -> tuple[Pool, ...]:
    """The pools among some elements, to begin with hardly held together."""
    members: dict[str, list[int]] = {}
    for k, element in enumerate(elements):
        if element.parameter.pooled:
            members.setdefault(element.name, []).append(k)
    return tuple(Pool(name, tuple(places), FIRST_SPREAD) for name, places in members.items())


class Points(NamedTuple):
    """All points of a problem in a row, each (points,): (velocity, observable, value).

    Those of one data set and observable, a block, are neighbours.
    """

    velocity: Float[np.ndarray, " points"]  # [m/s]
    value: Float[np.ndarray, " points"]  # as measured, in `unit`
    copies: Float[np.ndarray, " points"]  # for how many such points it stands
    set: Int[np.ndarray, " points"]  # the data set
    observable: Int[np.ndarray, " points"]  # place in `calibration.observables.OBSERVABLES`; 0 is ε
    # 1 for ε, else `Observed.scale` [SI], so that all values are numbers near one
    unit: Float[np.ndarray, " points"]
    # ∂(expected - measured)/∂c of flights in air, for a drag coefficient of (1 + c) C_d
    by_drag: Float[np.ndarray, " points"]


class Block(NamedTuple):
    """Rows of the points of one observable of one data set."""

    set: int
    observable: str
    span: slice


class Batch(NamedTuple):
    """Fits side by side: what differs between them; None: nothing does."""

    value: Float[np.ndarray, "fits points"] | None = None
    copies: Float[np.ndarray, "fits points"] | None = None
    variances: tuple[Mapping[str, np.ndarray], ...] | None = None  # of each block, (fits,)
    # θ that priors, and z that pools are centred on; None: the priors' means, and 0
    centre: Z | None = None
    # of fits of different data: whose each is, and as in `Points`, and for `Laws.leaves`
    of: Int[np.ndarray, " fits"] | None = None
    velocity: Float[np.ndarray, "fits points"] | None = None
    contact: Mapping[str, np.ndarray] | None = None
    fixed: Float[np.ndarray, "fits q rows"] | None = None

    def select(self, which) -> "Batch":
        """Select fits."""
        return jax.tree.map(lambda leaf: leaf[which], self)


class Linear(NamedTuple):
    """A problem around z, of each fit."""

    # of the points, of the priors and pools, then of what V adds
    residual: Float[np.ndarray, "fits m"]
    jacobian: Float[np.ndarray, "fits m p"]  # along the active elements
    cost: Float[np.ndarray, " fits"]  # -ln p(data | θ, s) - ln p(θ) up to a constant
    # the mean expected at each point, in its unit, and its slopes along the active elements
    prediction: Float[np.ndarray, "fits points"]
    per: Float[np.ndarray, "fits points p"]
    slope: Float[np.ndarray, "fits points"]  # of the curve, see `MeasuredCurve`
    curvature_variance: Float[np.ndarray, "fits points"]
    status: Int[np.ndarray, "fits points"]  # `softjax.Status`

    def measured_curve(self, span: slice) -> MeasuredCurve:
        """Select the points of the curve."""
        return MeasuredCurve(
            self.prediction[:, span], self.slope[:, span], self.curvature_variance[:, span]
        )

    @property
    def gradient(self) -> Float[np.ndarray, "fits p"]:
        """Gradient of the cost."""
        return np.einsum("fmp,fm->fp", self.jacobian, self.residual)


def acts_on_nothing(
    jacobian: Float[np.ndarray, "fits m p"], size: Float[np.ndarray, "fits p"], share=ROUNDED
) -> Bool[np.ndarray, "fits p"]:
    """Elements whose columns are rounding, for changes of `size`; none where `size` is 0."""
    acts = np.linalg.norm(jacobian, axis=1) * size
    return (size > 0) & (acts <= share * np.max(acts, axis=1, keepdims=True, initial=0.0))


class BlockResiduals(NamedTuple):
    """Data from which the variances of a block are estimated, for a batch of fits."""

    residual: Float[np.ndarray, "fits n"]  # predicted less measured ε, and its slopes; not weighted
    jacobian: Float[np.ndarray, "fits n p"]
    slope: Float[np.ndarray, "fits n"]  # of the curve, see `MeasuredCurve`
    curvature_variance: Float[np.ndarray, "fits n"]
    # A₀ and b₀; no b₀ where several sets take turns, whose residuals stay
    information: Float[np.ndarray, "fits p p"]
    gradient: Float[np.ndarray, "fits p"] | None
    free: Bool[np.ndarray, "fits p"]  # elements that are not at an end of their range
    # 1 for points that count, 0 for those without, which share no error with others; None: all count
    included: Any = None

    @property
    def weight(self) -> Any:
        """1 for each point that counts, else 0."""
        return np.ones(self.residual.shape) if self.included is None else self.included

    @property
    def square(self) -> Float[np.ndarray, " fits"]:
        """Mean square of the residuals."""
        squares = np.sum(self.weight * self.residual**2, axis=1) / np.sum(self.weight, axis=1)
        return np.maximum(squares, 1e-30)

    @property
    def sizes(self) -> Float[np.ndarray, "fits p"]:
        """√ of what is known of each parameter, with errors as large as the residuals."""
        points = np.sum(self.weight[..., None] * self.jacobian**2, axis=1) / self.square[:, None]
        known = np.diagonal(self.information, axis1=1, axis2=2) + points
        return np.sqrt(np.maximum(known, 1e-300))


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
    pull: tuple[np.ndarray, np.ndarray] | None = None
    # how many Jacobians were computed, of this and of all problems that are made of it; of each of
    # those side by side
    evaluated: np.ndarray = field(default_factory=lambda: np.zeros(1, int))

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
        most = max(1, AT_ONCE // max(self.count * (5 if self.has_velocity_errors else 1), 1))
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
        copies = np.broadcast_to(
            self.points.copies if batch.copies is None else batch.copies, residual.shape
        )
        rows, columns, more, their = [residual[:, :0]], [per.mean[:, :0]], [], []
        cost = np.zeros(len(residual))
        variances = self.variances if batch.variances is None else batch.variances
        blocks = self.spans if self.errors else ()
        for errors, s, span in zip(self.errors, variances, blocks, strict=True):
            slope, curvature_variance, n, r = (
                a[:, span] for a in (curve.slope, curve.curvature_variance, copies, residual)
            )
            factor, family = errors.factor(s, slope, curvature_variance), errors.noise
            both = np.concatenate([r[..., None], per.mean[:, span]], axis=2)
            both = errors.whiten(factor, both)
            white, of_white = both[..., 0], both[..., 1:]
            share = np.sqrt(n * family.weight(white))
            rows.append(white * share)
            columns.append(of_white * share[..., None])
            cost += 0.5 * np.sum(n * family.squares(white), axis=1)
            variance = errors.variance(s, slope, curvature_variance) + np.zeros(r.shape)
            beyond = np.broadcast_to(self.inside, self.count)[span] / variance
            cost += 0.5 * np.sum(beyond, axis=1)
            if not self.has_velocity_errors:
                continue
            changes = errors.changes(s, slope)
            if errors.shares:
                cost += 0.5 * (errors.log_det(factor) - np.sum(np.log(errors.steady(s)), axis=-1))
                scores = errors.scores(factor, s, slope, r)
            else:
                cost += 0.5 * np.sum(n * np.log(variance / errors.steady(s)), axis=1)
                excess = (n - (white * share) ** 2 - beyond) / variance
                scores = tuple(a * excess for a in changes)
            root = np.sqrt(n)
            for score, change, of_curve in zip(scores, changes, per[1:], strict=True):
                size = np.abs(change) * 2**0.5 / variance
                size = np.maximum(size, 1e-6 * np.abs(score)) + 1e-300
                weight = size * root
                more.append(np.where(n > 0, score, 0.0) / np.where(n > 0, weight, 1.0))
                their.append(of_curve[:, span] * weight[..., None])
        for value, column in self._priors(z, theta, per_z, batch.centre):
            rows.append(value)
            columns.append(column[:, :, : len(active)])
            cost += 0.5 * np.sum(value**2, axis=1)
        if self.pull is not None:
            # a row of a slope so small that it is not seen in JᵀJ
            along = (z - self.pull[0])[:, self.active] @ self.pull[1]
            rows.append(np.full((len(z), 1), 1 / PULL))
            columns.append(
                np.broadcast_to(PULL * self.pull[1][: len(active)], (len(z), 1, len(active)))
            )
            cost += along
        all_rows = np.concatenate([*rows, *more], axis=1)
        all_columns = np.concatenate([*columns, *their], axis=1)
        return Linear(
            all_rows,
            all_columns,
            cost,
            curve.mean,
            per.mean,
            curve.slope,
            curve.curvature_variance,
            status,
        )

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
        if not OBSERVABLES[name].has_losses:
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

    def _priors(self, z, theta, per_z, centre):
        """Rows of the priors, (θ - mean)/sd, and of each pool, (z - mean of z)/spread, and their slopes."""
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
