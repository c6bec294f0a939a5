"""Points as rows of residuals: what is measured, what differs from fit to fit, and what an evaluation gives.

Arrays of many fits have the fits as leading axis.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float, Int

from calibration.fitting.errors import Errors, Factor, MeasuredCurve

Z = Float[np.ndarray, "fits elements"]
LEAST_SIZE = (
    1e-6  # of a score, the size of its row: where V has a minimum the row would be infinite
)
ROUNDED = 1e-10  # of the strongest element, below which the effect of one is rounding


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


class Rows(NamedTuple):
    """Rows of residuals, their slopes along the active elements, and what they add to the cost."""

    value: Float[np.ndarray, "fits m"]
    slopes: Float[np.ndarray, "fits m p"]
    cost: Float[np.ndarray, " fits"]


class PointsAt(NamedTuple):
    """The points of one block at z: their errors, and how the curve misses them."""

    errors: Errors
    s: Mapping[str, Any]  # variances
    curve: MeasuredCurve
    per: MeasuredCurve  # slopes of the curve along the active elements
    residual: Float[np.ndarray, "fits n"]  # predicted less measured
    copies: Float[np.ndarray, "fits n"]
    inside: Any  # sum of squares inside points that stand for several

    @property
    def factor(self) -> Factor:
        """The factor of V."""
        return self.errors.factor(self.s, self.curve.slope, self.curve.curvature_variance)

    @property
    def variance(self) -> Float[np.ndarray, "fits n"]:
        """V_ii without the groups' part."""
        variance = self.errors.variance(self.s, self.curve.slope, self.curve.curvature_variance)
        return variance + np.zeros(self.residual.shape)


def rows_of_residuals(at: PointsAt, factor: Factor, variance: np.ndarray) -> Rows:
    """V^(-½) r with the weights of the family; half their squares, or -ln p of heavier tails, is their cost."""
    both = np.concatenate([at.residual[..., None], at.per.mean], axis=2)
    both = at.errors.whiten(factor, both)
    white, of_white = both[..., 0], both[..., 1:]
    share = np.sqrt(at.copies * at.errors.noise.weight(white))
    cost = 0.5 * np.sum(at.copies * at.errors.noise.squares(white), axis=1)
    cost = cost + 0.5 * np.sum(at.inside / variance, axis=1)
    return Rows(white * share, of_white * share[..., None], cost)


def rows_of_variance(at: PointsAt, factor: Factor, variance: np.ndarray, rows: Rows) -> Rows:
    """What ln det V and V⁻¹ add where V changes with the curve: two rows a point.

    Of its slope g and its curvature variance c, with scores f_g = ∂(-ln p)/∂g and sizes w_g = √2 |∂V/∂g|/2V: the
    row is f_g/w_g, its slopes w_g ∂g/∂z. So the gradient is exact, and w_g² is Fisher's information of g.
    """
    errors, s, slope, n = at.errors, at.s, at.curve.slope, at.copies
    changes = errors.changes(s, slope)
    if errors.shares:
        cost = 0.5 * (errors.log_det(factor) - np.sum(np.log(errors.steady(s)), axis=-1))
        scores = errors.scores(factor, s, slope, at.residual)
    else:
        cost = 0.5 * np.sum(n * np.log(variance / errors.steady(s)), axis=1)
        excess = (n - rows.value**2 - at.inside / variance) / variance
        scores = tuple(change * excess for change in changes)
    values, slopes = [], []
    for score, change, of_curve in zip(scores, changes, at.per[1:], strict=True):
        size = np.abs(change) * 2**0.5 / variance
        size = np.maximum(size, LEAST_SIZE * np.abs(score)) + 1e-300
        weight = size * np.sqrt(n)
        values.append(np.where(n > 0, score, 0.0) / np.where(n > 0, weight, 1.0))
        slopes.append(of_curve * weight[..., None])
    return Rows(np.concatenate(values, axis=1), np.concatenate(slopes, axis=1), cost)
