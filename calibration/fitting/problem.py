"""One least-squares problem: weighted residuals of some laws, and their exact Jacobian.

Several fits of one problem stand side by side along a leading axis: starts, refits without a point,
simulated data sets. Each has its own z, and may have its own restitutions and weights (`Lanes`).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

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
from calibration.fitting.latent import Latent
from calibration.fitting.losses import transformed
from calibration.fitting.plan import ErrorPlan
from calibration.fitting.rows import Laws, Leaves
from calibration.fitting.set_errors import SetErrors
from calibration.fitting.transform import Transform
from calibration.parameters import Parameter
from softjax.fields import Declared

Z = Float[np.ndarray, "fits elements"]
FIRST_SPREAD = 3.0  # of a pool, in z: factors of 20
AT_ONCE = 2_000_000  # impacts that are computed at once: what bounds the memory


@dataclass(frozen=True)
class Element:
    """One number that a fit searches.

    Attributes:
        label: what results call it: "chi", or "chi[name]" where there are several data sets.
        name: the parameter it is, or is an entry of.
        sets: the data sets that it belongs to.
        parameter, declared: what was said of it, and what its law says.
        start: in physical units.
        range: (lowest, highest).
    """

    label: str
    name: str
    sets: tuple[int, ...]
    parameter: Parameter
    declared: Declared
    start: float
    range: tuple[float, float]


class Pool(NamedTuple):
    """Elements of several data sets that lie around a common mean, on the scale that is searched.

    Attributes:
        name: of the parameter.
        members: places of the elements.
        spread: standard deviation of the members in z.
    """

    name: str
    members: tuple[int, ...]
    spread: float

    @property
    def spread_name(self) -> str:
        """What results call the spread; the mean has the name of the parameter."""
        return f"{self.name}_spread"


def pools_of(elements: Sequence[Element]) -> tuple[Pool, ...]:
    """The pools among some elements, to begin with hardly held together."""
    members: dict[str, list[int]] = {}
    for k, element in enumerate(elements):
        if element.parameter.pooled:
            members.setdefault(element.name, []).append(k)
    return tuple(Pool(name, tuple(places), FIRST_SPREAD) for name, places in members.items())


class Points(NamedTuple):
    """All points of a problem in a row, each (points,)."""

    velocity: Float[np.ndarray, "points"]
    restitution: Float[np.ndarray, "points"]
    weight: Float[np.ndarray, "points"]  # 1/uncertainty, or what stands for it
    set: Int[np.ndarray, "points"]


class Lanes(NamedTuple):
    """What differs between fits side by side; None: nothing."""

    restitution: Float[np.ndarray, "fits points"] | None = None
    weight: Float[np.ndarray, "fits points"] | None = None
    velocity: Float[np.ndarray, "fits points"] | None = None
    member: Int[np.ndarray, "fits"] | None = None  # which problem of several that are alike
    elastic: Bool[np.ndarray, "fits points"] | None = None  # as `Problem.elastic`
    lower: Z | None = None  # as `Problem.within`
    upper: Z | None = None

    def some(self, which) -> "Lanes":
        return Lanes(*(None if a is None else a[which] for a in self))


class Linear(NamedTuple):
    """Residuals around z.

    Attributes:
        residual: weighted, through the loss, then those of the priors, (fits, m).
        jacobian: along the active elements, (fits, m, p).
        prediction: ε at each point, (fits, points).
        status: `softjax.Status` there.
    """

    residual: Float[np.ndarray, "fits m"]
    jacobian: Float[np.ndarray, "fits m p"]
    prediction: Float[np.ndarray, "fits points"]
    status: Int[np.ndarray, "fits points"]


@dataclass(frozen=True)
class Problem:
    """Residuals of one stage as functions of its active elements.

    Attributes:
        datasets: the measurements.
        elements: of all stages; `z` has one number for each.
        transform: of all elements.
        laws: parameters -> laws of all points.
        points: what is measured.
        active: which elements are searched.
        plans: what of the errors of each data set is stated.
        loss, scale: see `losses`; the scale at each point.
        elastic: points that are held below yield, (points,), while a search moves what yield
            depends on; None: no law asks for it.
        within: lowest and highest z, (elements,) each, between which these points are where the law
            has them.
        guided: whether ε is continued below 0 where nothing rebounds. That guides a search; a fit is
            judged by the law's own ε.
        reweighed: whether the weights depend on where the fit is.
        joint: whether data sets without stated uncertainties are weighed against each other.
        shared: the errors of each data set, where points share some: residuals are whitened then.
        latent: where points are taken to be, where velocities have errors.
        pools: which elements lie around a common mean.
    """

    datasets: tuple[RestitutionData, ...]
    elements: tuple[Element, ...]
    transform: Transform
    laws: Laws
    points: Points
    active: Int[np.ndarray, "p"]
    plans: tuple[ErrorPlan, ...]
    route: Route = None
    loss: str = "squared"
    scale: np.ndarray | None = None
    elastic: Bool[np.ndarray, "points"] | None = None
    within: tuple[np.ndarray, np.ndarray] | None = None
    guided: bool = False
    reweighed: bool = False
    joint: bool = True
    shared: tuple[SetErrors, ...] | None = None
    latent: tuple[Latent, ...] | None = None
    pools: tuple[Pool, ...] = ()

    @property
    def with_prior(self) -> list[int]:
        """Active elements with a prior."""
        return [k for k in self.active if self.elements[k].parameter.prior is not None]

    @property
    def count(self) -> int:
        return len(self.points.velocity)

    def linearise(self, z: Z, lanes: Lanes | None = None, slopes: bool = True) -> Linear:
        """Residuals and Jacobian of each fit; without `slopes` the Jacobian has no columns."""
        most = max(1, AT_ONCE // max(self.count, 1))
        if len(z) > most:
            return self._in_parts(z, lanes or Lanes(), slopes, most)
        lanes = lanes or Lanes()
        theta, per_z = self.transform.physical(z), self.transform.slope(z)
        prediction, local, status = self._predicted(theta, lanes)
        jacobian = self._by_element(local, per_z if slopes else per_z[:, :0])
        measured = self.points.restitution if lanes.restitution is None else lanes.restitution
        weight = self.points.weight if lanes.weight is None else lanes.weight
        weight = np.broadcast_to(weight, prediction.shape)
        residual = prediction - measured
        if self.shared is not None:
            residual = self.whitened(residual)
            jacobian = self.whitened(jacobian) if slopes else jacobian
        residual, per_raw = transformed(residual * weight, self.scale, self.loss)
        jacobian *= (weight * per_raw)[:, :, None]
        priors, their_slopes = self._held_together(z, *self._priors(theta, per_z))
        if not priors.shape[1]:
            return Linear(residual, jacobian, prediction, status)
        return Linear(
            np.concatenate([residual, priors], axis=1),
            np.concatenate([jacobian, their_slopes[:, :, : jacobian.shape[2]]], axis=1),
            prediction,
            status,
        )

    def predict(self, z: Z) -> Float[np.ndarray, "fits points"]:
        """ε at each point."""
        return self._predicted(self.transform.physical(z), Lanes())[0]

    def raw_residuals(self, z: Z, lanes: Lanes | None = None) -> Float[np.ndarray, "fits points"]:
        """Weighted residuals before the loss."""
        own = None if lanes is None else lanes.restitution
        measured = self.points.restitution if own is None else own
        return (self.predict(z) - measured) * self.points.weight

    def whitened(self, values: np.ndarray) -> np.ndarray:
        """(fits, points, ...) in units of the errors, without what points share of these."""
        return self._by_set(lambda errors, part: errors.whiten(part), values)

    def coloured(self, values: np.ndarray) -> np.ndarray:
        """What each of the errors that `whitened` takes apart makes in sums over (fits, points, ...)."""
        return self._by_set(lambda errors, part: errors.coloured(part), values)

    def _by_set(self, of: Callable[[SetErrors, np.ndarray], np.ndarray], values) -> np.ndarray:
        assert self.shared is not None
        rows = np.moveaxis(values, 1, 0)
        flat = rows.reshape(len(rows), -1)
        ends = np.cumsum([len(data) for data in self.datasets])[:-1]
        parts = zip(self.shared, np.split(flat, ends), strict=True)
        found = np.concatenate([of(errors, part) for errors, part in parts])
        return np.moveaxis(found.reshape(rows.shape), 0, 1)

    def yields_at(self, z) -> Float[np.ndarray, "... points"] | None:
        """The velocity below which each impact is elastic at z [m/s]; None for a law without one."""
        rows = self.laws.rows
        if not hasattr(rows.model.law_type, "elastic_velocity"):
            return None
        theta = self.transform.physical(np.atleast_2d(z))
        limits = [[_yields_at(rows.law(one, k)) for k in range(rows.size)] for one in theta]
        return np.array(limits)[:, rows.row].reshape(*np.shape(z)[:-1], self.count)

    def law_of(self, theta: Float[np.ndarray, "elements"], g: int) -> sj.ContactLaw:
        """The law of a data set; of its first impact where it has several."""
        rows = self.laws.rows
        return rows.law(theta, int(rows.row[np.flatnonzero(self.points.set == g)[0]]))

    def elastic_at(self, z) -> Bool[np.ndarray, "... points"] | None:
        """Which points are below yield at z, where the law asks to be held; else None."""
        return None if self.elastic is None else self.points.velocity <= self.yields_at(z)

    def held(self, elastic, within=None) -> "Problem":
        """The same with these points held below yield."""
        return self if self.elastic is None else replace(self, elastic=elastic, within=within)

    def weighed(self, weight: Float[np.ndarray, "points"]) -> "Problem":
        """The same with other weights."""
        return replace(self, points=self.points._replace(weight=weight))

    def as_measured(self) -> "Problem":
        """The same impacts at the velocities that were measured."""
        if self.latent is None:
            return self
        velocity = np.concatenate([data.velocity for data in self.datasets])
        restitution = np.concatenate([data.restitution for data in self.datasets])
        points = self.points._replace(velocity=velocity, restitution=restitution)
        return replace(self, points=points)

    def at_velocity(self, velocity: Float[np.ndarray, "points"]) -> "Problem":
        """The same impacts at other velocities."""
        return replace(self, points=self.points._replace(velocity=velocity))

    def _in_parts(self, z, lanes: Lanes, slopes: bool, most: int) -> Linear:
        rows = [slice(k, k + most) for k in range(0, len(z), most)]
        parts = [self.linearise(z[some], lanes.some(some), slopes) for some in rows]
        return Linear(*(np.concatenate(every) for every in zip(*parts, strict=True)))

    def _leaves(self, theta, lanes: Lanes) -> Leaves:
        """The laws' leaves, (fits, rows, ...)."""
        return self.laws.leaves(theta)

    def _predicted(self, theta, lanes: Lanes):
        """ε of each fit and point, its slopes in the local parameters, and the status."""
        fits = len(theta)
        rows, leaves = self.laws.rows, self._leaves(theta, lanes)
        flat = []
        for k, leaf in enumerate(leaves.values):
            fixed = self.laws.shape.whole[k] and k not in self.laws.moving
            at_points = leaf[:, rows.row]
            whole = leaf[0, 0] if fixed else at_points.reshape(-1, *leaf.shape[2:])
            flat.append(np.asarray(whole, float))
        velocity = self.points.velocity if lanes.velocity is None else lanes.velocity
        velocity = np.broadcast_to(velocity, (fits, self.count)).ravel()
        elastic = self.elastic if lanes.elastic is None else lanes.elastic
        if elastic is not None:
            elastic = np.broadcast_to(elastic, (fits, self.count)).ravel()
        found = expand(self.laws.shape, flat, velocity, self.laws.moving, self.route, elastic)
        squared, slopes, status = (a.reshape(*a.shape[:-1], fits, self.count) for a in found)
        if self.guided:
            value, slope = extended_root(squared), extended_root_slope(squared)
        else:
            value, slope = root(squared), root_slope(squared)
        return value, self._local_slopes(slopes * slope, leaves.slopes), status

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
        """The same with (z - mean of z)/spread of each pool's members, and their slopes."""
        for pool in self.pools:
            members, count = list(pool.members), len(pool.members)
            off = z[:, members] - np.mean(z[:, members], axis=1, keepdims=True)
            rows = np.zeros((count, len(self.elements)))
            rows[:, members] = (np.eye(count) - 1 / count) / pool.spread
            per = np.broadcast_to(rows[:, self.active], (len(z), count, len(self.active)))
            value = np.concatenate([value, off / pool.spread], axis=1)
            slope = np.concatenate([slope, per], axis=1)
        return value, slope


def _yields_at(law: sj.ContactLaw) -> float:
    return float(np.asarray(law.elastic_velocity()))  # type: ignore[attr-defined]
