"""One problem: the likelihood of some laws' parameters as rows of residuals, and their exact Jacobian.

With g = Jᵀ r the rows have the gradient of -ln p(data | θ, s) - ln p(θ), and JᵀJ is the information
that the data are expected to have; their cost is that density itself. Where velocities have errors, V
moves with the curve: two more rows a point stand for what ln det V and V⁻¹ add to either.

Several fits of one problem stand side by side along a leading axis: starts, refits without a point,
simulated data sets. Each has its own z, and may have its own restitutions and weights (`Lanes`).
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float, Int

import softjax as sj
from calibration.data import RestitutionData
from calibration.fitting.collisions import (
    Route,
    expand,
    extended_root,
    extended_root_slope,
    root,
    root_slope,
)
from calibration.fitting.errors import Carried, Errors
from calibration.fitting.noise import Normal, StudentT
from calibration.fitting.rows import Laws, Leaves
from calibration.observables import OBSERVABLES, RESTITUTION
from calibration.parameters import Parameter, Transform
from softjax.fields import Declared

Z = Float[np.ndarray, "fits elements"]
NAMES = tuple(OBSERVABLES)
DRAG = "air_drag"  # c, what the drag coefficient of flights in air is off by, in parts
FIRST_SPREAD = 3.0  # of a pool, in z: factors of 20
AT_ONCE = 2_000_000  # impacts that are computed at once: what bounds the memory


@dataclass(frozen=True)
class Element:
    """One parameter of a data set's law; one number that a fit searches, where it is free.

    Attributes:
        name: in full, an entry of a whole parameter as "weights[3]".
        parameter, declared: what was said of it, and what its law says.
        start: where it starts, or what it is fixed at, in physical units; one number, or one an impact.
        range: (lowest, highest).
        stands_in: whether it is fixed at a number that nobody stated and that acts nowhere in the
            data: ψ where ε_up is fitted in its place.
        label: what results call it: "chi", or "chi[name]" where there are several data sets.
        sets: the data sets that it belongs to.
    """

    name: str
    parameter: Parameter
    declared: Declared
    start: Any
    range: tuple[float, float]
    stands_in: bool = False
    label: str = ""
    sets: tuple[int, ...] = ()

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

    velocity: Float[np.ndarray, "points"]  # [m/s]
    value: Float[np.ndarray, "points"]  # as measured, in `unit`
    weight: Float[np.ndarray, "points"]  # 1/√V_ii where V is fixed and diagonal; else 1, or 0
    set: Int[np.ndarray, "points"]  # the data set
    observable: Int[np.ndarray, "points"]  # place in `calibration.observables.OBSERVABLES`; 0 is ε
    # 1 for ε, else `Observed.scale` [SI], so that all values are numbers near one
    unit: Float[np.ndarray, "points"]
    # ∂(expected - measured)/∂c of flights in air, for a drag coefficient of (1 + c) C_d
    by_drag: Float[np.ndarray, "points"]


class Block(NamedTuple):
    """Rows of the points of one observable of one data set."""

    set: int
    observable: str
    own: slice


class Lanes(NamedTuple):
    """Data that differ between the fits of a batch; None: nothing differs."""

    value: Float[np.ndarray, "fits points"] | None = None
    weight: Float[np.ndarray, "fits points"] | None = None
    velocity: Float[np.ndarray, "fits points"] | None = None
    member: Int[np.ndarray, "fits"] | None = None  # which problem of several that are alike
    variances: tuple[Mapping[str, np.ndarray], ...] | None = None  # of each data set, (fits,)
    elastic: Bool[np.ndarray, "fits points"] | None = None  # as `Problem.elastic`
    lower: Z | None = None  # as `Problem.within`
    upper: Z | None = None

    def some(self, which) -> "Lanes":
        """Select fits."""
        return jax.tree.map(lambda one: one[which], self)


class Linear(NamedTuple):
    """Residuals around z."""

    # of the points, of the priors and pools, then of what V adds, (fits, m)
    residual: Float[np.ndarray, "fits m"]
    jacobian: Float[np.ndarray, "fits m p"]  # along the active elements, (fits, m, p)
    # the mean expected at each point, in its unit, (fits, points)
    prediction: Float[np.ndarray, "fits points"]
    status: Int[np.ndarray, "fits points"]  # `softjax.Status` there
    cost: Float[np.ndarray, "fits"]  # -ln p(data | θ, s) - ln p(θ) up to a constant, (fits,)


class Residuals(NamedTuple):
    """Data from which the variances of a block are estimated, for a batch of fits."""

    off: Float[np.ndarray, "fits n"]  # predicted less measured ε, and its slopes; not weighted
    jacobian: Float[np.ndarray, "fits n p"]
    slope: Any  # of the curve, see `Carried`
    bend: Any
    # A₀ and b₀; no b₀ where several sets take turns, whose residuals stay
    information: Float[np.ndarray, "fits p p"]
    gradient: Float[np.ndarray, "fits p"] | None
    # 0 for points that are left out, which share no error with others; None: all are there
    kept: Any = None

    @property
    def counted(self) -> Any:
        """1 for every point that is there."""
        return np.ones(self.off.shape) if self.kept is None else self.kept


@dataclass(frozen=True)
class Problem:
    """Residuals of one stage as functions of its active elements."""

    datasets: tuple[RestitutionData, ...]  # the measurements
    elements: tuple[Element, ...]  # of all stages; `z` has one number for each
    transform: Transform  # of all elements
    laws: Laws  # parameters -> laws of all points
    points: Points  # what is measured
    active: Int[np.ndarray, "p"]  # which elements are searched
    route: Route = None
    errors: tuple[Errors, ...] = ()  # V(s) of each block; none where points weigh as `points` say
    variances: tuple[Mapping[str, Any], ...] = ()  # s of each block
    # points that are held below yield, (points,), while a search moves what yield depends on;
    # None: no law asks for it
    elastic: Bool[np.ndarray, "points"] | None = None
    # lowest and highest z, (elements,) each, between which these points are where the law has
    # them
    within: tuple[np.ndarray, np.ndarray] | None = None
    # whether ε is continued below 0 where nothing rebounds. That guides a search; a fit is judged
    # by the law's own ε
    guided: bool = False
    # whether data sets without stated uncertainties are weighed against each other
    joint: bool = True
    pools: tuple[Pool, ...] = ()  # which elements lie around a common mean

    @property
    def with_prior(self) -> list[int]:
        """Active elements with a prior."""
        return [k for k in self.active if self.elements[k].parameter.prior is not None]

    @property
    def count(self) -> int:
        return len(self.points.velocity)

    @cached_property
    def is_fixed(self) -> bool:
        """Whether V is diagonal and does not move with the parameters: then `points` have it."""
        return all(one.is_fixed for one in self.errors)

    @cached_property
    def moves(self) -> bool:
        """Whether V moves with the parameters: velocities have errors."""
        return any(one.has_slope for one in self.errors)

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
    def own(self) -> tuple[slice, ...]:
        """The points of each block."""
        return tuple(block.own for block in self.blocks)

    def of_restitution(self, place: int) -> slice:
        """The ε of the data set at a place; of another observable where it has none."""
        return next(block.own for block in self.blocks if block.set == place)

    def with_variances(self, variances: Sequence[Mapping[str, Any]]) -> "Problem":
        """The problem with other variances of its data sets."""
        if not self.is_fixed:
            return replace(self, variances=tuple(variances))
        pairs = zip(self.errors, variances, strict=True)
        every = [np.broadcast_to(e.variance(s, 0.0, 0.0), len(e)) for e, s in pairs]
        points = self.points._replace(weight=np.concatenate(every) ** -0.5)
        return replace(self, variances=tuple(variances), points=points)

    def linearise(self, z: Z, lanes: Lanes | None = None, slopes: bool = True) -> Linear:
        """Rows and Jacobian of each fit; without `slopes` the Jacobian has no columns."""
        lanes = lanes or Lanes()
        count = self.count * (5 if self.moves else 1)
        most = max(1, AT_ONCE // max(count, 1))
        rows = [slice(k, k + most) for k in range(0, max(len(z), 1), most)]
        parts = [self._linear(z[some], lanes.some(some), slopes)[0] for some in rows]
        if len(parts) == 1:
            return parts[0]
        return Linear(*(np.concatenate(every) for every in zip(*parts, strict=True)))

    def _linear(self, z: Z, lanes: Lanes, slopes: bool) -> tuple[Linear, Carried, Carried]:
        """Residuals and Jacobian, and the predictions with their derivatives."""
        theta, per_z = self.transform.physical(z), self.transform.slope(z)
        carried, per, status = self._carried(theta, per_z if slopes else per_z[:, :0], lanes)
        off = carried.mean - self._measured(lanes)
        more: list[np.ndarray] = []
        if self.is_fixed:
            residual, jacobian, cost = self._by_weight(off, per.mean, lanes)
        else:
            residual, jacobian, cost, *more = self._by_covariance(off, carried, per, lanes)
        priors, their_slopes = self._held_together(z, *self._priors(theta, per_z))
        rows = [residual, priors, *more[:1]]
        columns = [jacobian, their_slopes[:, :, : jacobian.shape[2]], *more[1:]]
        cost = cost + 0.5 * np.sum(priors**2, axis=1)
        joined = np.concatenate(rows, axis=1), np.concatenate(columns, axis=1)
        return Linear(*joined, carried.mean, status, cost), carried, per

    def _measured(self, lanes: Lanes) -> np.ndarray:
        return self.points.value if lanes.value is None else lanes.value

    def predict(self, z: Z, lanes: Lanes | None = None) -> Float[np.ndarray, "fits points"]:
        """E[ε] at each point."""
        none = np.zeros((len(z), 0))
        return self._carried(self.transform.physical(z), none, lanes or Lanes())[0].mean

    def seen(self, z: Z, lanes: Lanes | None = None) -> list[Residuals]:
        """Data at z from which the variances of each block are estimated."""
        lanes = lanes or Lanes()
        found, carried, per = self._linear(z, lanes, True)
        off, every = carried.mean - self._measured(lanes), np.arange(found.residual.shape[1])
        more = every >= found.residual.shape[1] - (0 if self.is_fixed else self.more)
        parts = []
        for own in self.own:
            others = ~more & ((every < own.start) | (every >= own.stop))
            slopes, rest = found.jacobian[:, others], found.residual[:, others]
            information = np.swapaxes(slopes, 1, 2) @ slopes
            gradient = np.einsum("fmp,fm->fp", slopes, rest)
            if not self.joint:  # each data set is judged by itself
                information, gradient = 0 * information, 0 * gradient
            elif len(self.errors) > 1:
                gradient = None
            slope, bend = (a[:, own] if np.ndim(a) else a for a in (carried.slope, carried.bend))
            parts.append(
                Residuals(off[:, own], per.mean[:, own], slope, bend, information, gradient)
            )
        return parts

    def curve(self, theta, per_z, lanes: Lanes | None = None):
        """The curve itself at the measured velocities, its slopes along the active elements, the status."""
        value, local, status = self._predicted(theta, lanes or Lanes())
        return value, self._by_element(local, per_z), status

    def carried(self, z: Z, lanes: Lanes | None = None) -> list[Carried]:
        """Curve at the points of each block, (fits, n); see `errors`."""
        none = np.zeros((len(z), 0))
        found = self._carried(self.transform.physical(z), none, lanes or Lanes())[0]
        return [Carried(*(a[:, own] if np.ndim(a) else a for a in found)) for own in self.own]

    def deviance(self, z: Z, lanes: Lanes | None = None) -> Float[np.ndarray, "fits"]:
        """-2 ln p(data | θ, s)."""
        lanes = lanes or Lanes()
        variances = self.variances if lanes.variances is None else lanes.variances
        every = zip(self.errors, variances, self.carried(z, lanes), self.own, strict=True)
        measured = np.broadcast_to(self._measured(lanes), (len(z), self.count))
        parts = [
            e.deviance(s, c.mean - measured[:, own], c.slope, c.bend) for e, s, c, own in every
        ]
        return np.sum(parts, axis=0)

    def kept(self, rows: Bool[np.ndarray, "points"]) -> "Problem":
        """The problem of some of its points, which share no error with the others."""
        points = Points(*(a[rows] for a in self.points))
        laws = replace(self.laws, rows=replace(self.laws.rows, row=self.laws.rows.row[rows]))
        left = [k for k, own in enumerate(self.own) if np.any(rows[own])] if self.errors else []
        errors = tuple(self.errors[k].some(np.flatnonzero(rows[self.own[k]])) for k in left)
        variances = tuple(self.variances[k] for k in left)
        elastic = None if self.elastic is None else self.elastic[rows]
        of_errors = replace(self, errors=errors, variances=variances)
        return replace(of_errors, points=points, laws=laws, elastic=elastic)

    def diagonal(self, z: Z, lanes: Lanes | None = None) -> Float[np.ndarray, "fits points"]:
        """V_ii of each point."""
        lanes = lanes or Lanes()
        if not self.errors:
            return np.broadcast_to(self.points.weight**-2.0, (len(z), self.count))
        variances = self.variances if lanes.variances is None else lanes.variances
        every = self.carried(z, lanes)
        parts = [
            e.diagonal(s, c.slope, c.bend) + np.zeros(c.mean.shape)
            for e, s, c in zip(self.errors, variances, every, strict=True)
        ]
        return np.concatenate(parts, axis=1)

    @property
    def more(self) -> int:
        """Rows that stand for what V adds."""
        return 2 * self.count if self.moves else 0

    @cached_property
    def drag(self) -> int | None:
        """Element of c in `Points.by_drag`; None without flights in air."""
        names = [element.name for element in self.elements]
        return names.index(DRAG) if DRAG in names else None

    def _carried(self, theta, per_z, lanes: Lanes) -> tuple[Carried, Carried, np.ndarray]:
        """Predictions at the points, their derivatives in the active elements, and the status."""
        carried, per, status = self._of_curve(theta, per_z, lanes)
        if self.drag is None:
            return carried, per, status
        by_drag = self.points.by_drag
        carried = carried._replace(mean=carried.mean + theta[:, self.drag, None] * by_drag)
        column = np.flatnonzero(self.active == self.drag)
        if per.mean.shape[2] and len(column):
            slope = np.array(per.mean)
            slope[:, :, column[0]] += by_drag * per_z[:, self.drag, None]
            per = per._replace(mean=slope)
        return carried, per, status

    def _of_curve(self, theta, per_z, lanes: Lanes) -> tuple[Carried, Carried, np.ndarray]:
        """The curve at the points, its slopes along the active elements, and the status."""
        if not self.moves:
            value, slope, status = self.curve(theta, per_z, lanes)
            return Carried(value, 0.0, 0.0), Carried(slope, 0.0, 0.0), status
        wide, nodes = self._wide, len(self._wide.points.velocity) // self.count
        elastic = None if lanes.elastic is None else np.tile(lanes.elastic, nodes)
        value, local, status = wide._predicted(theta, lanes._replace(elastic=elastic))
        jacobian = wide._by_element(local, per_z)
        fits, p = len(theta), jacobian.shape[2]
        value = value.reshape(fits, nodes, self.count)
        jacobian = jacobian.reshape(fits, nodes, self.count, p)
        found = []
        for errors, own in zip(self.errors, self.own, strict=True):
            one = errors.carried(value[..., own])
            per = errors.carried_slopes(value[..., own], jacobian[:, :, own], one.slope)
            found.append((one, per))
        joined = [
            np.concatenate(parts, axis=1) for parts in zip(*(c for c, _ in found), strict=True)
        ]
        slopes = [
            np.concatenate(parts, axis=1) for parts in zip(*(s for _, s in found), strict=True)
        ]
        return Carried(*joined), Carried(*slopes), status[:, : self.count]

    @cached_property
    def _wide(self) -> "Problem":
        """The impacts at the nodes around their velocities."""
        nodes = np.concatenate([one.nodes for one in self.errors], axis=1)
        count = len(nodes)
        points = Points(nodes.ravel(), *(np.tile(a, count) for a in self.points[1:]))
        rows = replace(self.laws.rows, row=np.tile(self.laws.rows.row, count))
        elastic = None if self.elastic is None else np.tile(self.elastic, count)
        laws = replace(self.laws, rows=rows)
        return replace(self, points=points, laws=laws, elastic=elastic, errors=())

    def _by_weight(self, off, jacobian, lanes: Lanes):
        """Rows and cost where V is fixed and diagonal."""
        weight = self.points.weight if lanes.weight is None else lanes.weight
        residual, family = off * weight, self._family(lanes)
        share = np.sqrt(family.weight(residual))
        cost = 0.5 * np.sum(family.squares(residual), axis=1)
        return residual * share, jacobian * (weight * share)[:, :, None], cost

    def _family(self, lanes: Lanes) -> Normal:
        """Family of noise, which all points share."""
        if not self.errors or self.errors[0].is_normal:
            return Normal()
        variances = self.variances if lanes.variances is None else lanes.variances
        pairs = zip(self.errors, variances, strict=True)
        dof = [e.family(s).dof + np.zeros((1, len(e))) for e, s in pairs]
        return StudentT(np.concatenate(dof, axis=1))

    def _by_covariance(self, off, carried: Carried, per: Carried, lanes: Lanes):
        """Rows, cost, and the rows that ln det V and V⁻¹ add, where V moves or is not diagonal."""
        weight = self.points.weight if lanes.weight is None else lanes.weight
        weight = np.broadcast_to(weight, off.shape)
        variances = self.variances if lanes.variances is None else lanes.variances
        slopes = per.mean.shape[2] > 0
        rows, columns, more, their = [], [], [], []
        cost = np.zeros(len(off))
        for errors, s, own in zip(self.errors, variances, self.own, strict=True):
            kept, r = weight[:, own], off[:, own] * weight[:, own]
            slope, bend = (a[:, own] if np.ndim(a) else a for a in carried[1:])
            factor, family = errors.factor(s, slope, bend), errors.family(s)
            white = errors.whiten(factor, r[..., None])[..., 0]
            share = np.sqrt(family.weight(white))
            jacobian = per.mean[:, own]
            if slopes:
                jacobian = errors.whiten(factor, jacobian * kept[..., None])
                jacobian = jacobian * share[..., None]
            rows.append(white * share)
            columns.append(jacobian)
            cost += 0.5 * np.sum(family.squares(white), axis=1)
            if not self.moves:
                continue
            variance = errors.variance(s, slope, bend) + np.zeros(r.shape)
            if errors.shares:
                cost += 0.5 * (errors.log_det(factor) - np.sum(np.log(errors.steady(s)), axis=-1))
                by_slope, by_bend = errors.scores(factor, s, slope, r)
            else:
                cost += 0.5 * np.sum(kept * np.log(variance / errors.steady(s)), axis=1)
                changes = errors.changes(s, slope)
                by_slope, by_bend = (a * (1 - (white * share) ** 2) / variance for a in changes)
            for score, change, of_curve in zip(
                (by_slope, by_bend), errors.changes(s, slope), per[1:], strict=True
            ):
                size = np.abs(change) * 2**0.5 / variance
                size = np.maximum(size, 1e-6 * np.abs(score)) + 1e-300
                more.append(kept * score / size)
                their.append(of_curve[:, own] * (size * kept)[..., None])
        found = [np.concatenate(rows, axis=1), np.concatenate(columns, axis=1), cost]
        if not self.moves:
            return found
        # the rows of one data set's g and c stand together
        return [*found, np.concatenate(more, axis=1), np.concatenate(their, axis=1)]

    def yields_at(self, z) -> Float[np.ndarray, "... points"] | None:
        """The velocity below which each impact is elastic at z [m/s]; None for a law without one."""
        rows = self.laws.rows
        if not hasattr(rows.model.law_type, "elastic_velocity"):
            return None
        theta = self.transform.physical(np.atleast_2d(z))
        limits = [
            [float(np.asarray(rows.law(one, k).elastic_velocity())) for k in range(rows.size)]  # type: ignore[attr-defined]
            for one in theta
        ]
        return np.array(limits)[:, rows.row].reshape(*np.shape(z)[:-1], self.count)

    def law_of(self, theta: Float[np.ndarray, "elements"], g: int) -> sj.ContactLaw:
        """The law of a data set; of its first impact where it has several."""
        rows = self.laws.rows
        return rows.law(theta, int(rows.row[np.flatnonzero(self.points.set == g)[0]]))

    def elastic_at(self, z) -> Bool[np.ndarray, "... points"] | None:
        """Points below yield at z, if the law needs fixed branches, else None."""
        return None if self.elastic is None else self.points.velocity <= self.yields_at(z)

    def held(self, elastic, within=None) -> "Problem":
        """The problem with these points treated as below yield."""
        return self if self.elastic is None else replace(self, elastic=elastic, within=within)

    def _leaves(self, theta, lanes: Lanes) -> Leaves:
        """The laws' leaves, (fits, rows, ...)."""
        return self.laws.leaves(theta)

    def _predicted(self, theta, lanes: Lanes):
        """The value at each fit and point, its slopes in the local parameters, and the status."""
        leaves, seen = self._leaves(theta, lanes), np.unique(self.points.observable)
        if len(seen) == 1:
            value, slopes, status = self._of_observable(leaves, slice(None), NAMES[seen[0]], lanes)
            return value, self._local_slopes(slopes, leaves.slopes), status
        fits, parts = len(theta), []
        for code in seen:
            at = np.flatnonzero(self.points.observable == code)
            parts.append((at, *self._of_observable(leaves, at, NAMES[code], lanes)))
        value = np.empty((fits, self.count))
        slopes, status = np.empty((len(parts[0][2]), *value.shape)), np.empty(value.shape, int)
        for at, *found in parts:
            value[:, at], slopes[:, :, at], status[:, at] = found
        return value, self._local_slopes(slopes, leaves.slopes), status

    def _of_observable(self, leaves: Leaves, at, name: str, lanes: Lanes):
        """Predictions at points of one observable, with derivatives in the leaves that are not fixed."""
        row, fits = self.laws.rows.row[at], len(leaves.values[0])
        flat = []
        for k, leaf in enumerate(leaves.values):
            fixed = self.laws.shape.whole[k] and k not in self.laws.moving
            whole = leaf[0, 0] if fixed else leaf[:, row].reshape(-1, *leaf.shape[2:])
            flat.append(np.asarray(whole, float))
        velocity = self.points.velocity if lanes.velocity is None else lanes.velocity
        velocity = np.broadcast_to(velocity, (fits, self.count))[:, at].ravel()
        elastic = self.elastic if lanes.elastic is None else lanes.elastic
        if elastic is not None:
            elastic = np.broadcast_to(elastic, (fits, self.count))[:, at].ravel()
        shape, moving = self.laws.shape, self.laws.moving
        is_eps = name == RESTITUTION
        found = expand(shape, flat, velocity, moving, self.route, elastic if is_eps else None, name)
        value, slopes, status = (a.reshape(*a.shape[:-1], fits, len(row)) for a in found)
        if not is_eps:
            return value / self.points.unit[at], slopes / self.points.unit[at], status
        if self.guided:
            return extended_root(value), slopes * extended_root_slope(value), status
        return root(value), slopes * root_slope(value), status

    def _local_slopes(self, slopes, of_leaves) -> Float[np.ndarray, "free fits points"]:
        """dε/d(local parameter), from the slopes in the leaves."""
        if of_leaves is None:
            return slopes
        at_points = of_leaves[:, self.laws.rows.row]
        return np.einsum("afn,fnaq->qfn", slopes, at_points)

    def _by_element(self, local, per_z) -> Float[np.ndarray, "fits points p"]:
        """dε/dz along the active elements; none where `per_z` is of none."""
        rows = self.laws.rows
        active = self.active if per_z.shape[1] else self.active[:0]
        place = np.full(len(self.elements) + 1, -1)
        place[active] = np.arange(len(active))
        jacobian = np.zeros((len(per_z), self.count, len(active)))
        for k, slope in zip(self.laws.free, local, strict=True):
            first = rows.element[k, 0]
            if np.all(rows.element[k] == first):
                if place[first] >= 0:
                    jacobian[:, :, place[first]] += slope * per_z[:, first, None]
                continue
            element = rows.element[k][rows.row]
            on = np.flatnonzero(place[element] >= 0)
            element = element[on]
            jacobian[:, on, place[element]] += slope[:, on] * per_z[:, element]
        return jacobian

    def _priors(self, theta, per_z):
        """(θ - mean)/sd of the active elements with a prior, and their slopes."""
        elements = self.with_prior
        value = np.zeros((len(theta), len(elements)))
        slope = np.zeros((len(theta), len(elements), len(self.active)))
        for row, k in enumerate(elements):
            mean, deviation = self.elements[k].parameter.prior  # type: ignore[misc]
            value[:, row] = (theta[:, k] - mean) / deviation
            column = int(np.flatnonzero(self.active == k)[0])
            slope[:, row, column] = per_z[:, k] / deviation
        return value, slope

    def _held_together(self, z, value, slope):
        """Residuals with (z - mean of z)/spread of each pool's members, and their derivatives."""
        for pool in self.pools:
            members, count = list(pool.members), len(pool.members)
            off = z[:, members] - np.mean(z[:, members], axis=1, keepdims=True)
            rows = np.zeros((count, len(self.elements)))
            rows[:, members] = (np.eye(count) - 1 / count) / pool.spread
            per = np.broadcast_to(rows[:, self.active], (len(z), count, len(self.active)))
            value = np.concatenate([value, off / pool.spread], axis=1)
            slope = np.concatenate([slope, per], axis=1)
        return value, slope
