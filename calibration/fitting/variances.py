"""Unknown variances of the errors by restricted maximum likelihood.

    -2 ln L_R = -2 ln p(data | θ, s) + ln det (A₀ + Jᵀ V⁻¹ J) - bᵀ (A₀ + Jᵀ V⁻¹ J)⁻¹ b

with J the slopes of the predictions in θ, A₀ and b₀ what the other data and the priors know of the
parameters, b = b₀ + Jᵀ V⁻¹ r. The parameters that the curve costs are accounted for, so that the variance
of residuals of n points and p parameters is Σ r²/(n - p): of four about their mean

>>> r, nothing = np.array([[0.03, 0.01, -0.03, -0.01]]), np.zeros((1, 4))
>>> free = np.array([[True]])
>>> block = BlockResiduals(r, np.ones((1, 4, 1)), nothing, nothing, np.zeros((1, 1, 1)), None, free)
>>> import calibration as cal
>>> errors = Errors.of(cal.RestitutionData(np.ones(4), [0.84, 0.86, 0.90, 0.88]))
>>> estimated(errors, block)["scatter"].round(6)  # 0.002/3
array([0.000667])
>>> estimated(errors, block, restricted=False)["scatter"].round(6)  # 0.002/4
array([0.0005])

Student's t has information (ν + 1)/(ν + 3) Jᵀ V⁻¹ J, and no b: the residuals are those at the minimum once the
variances have converged. Many fits go side by side, in a damped Newton search of the logarithms.

Source: Patterson and Thompson, Biometrika 58, 545 (1971); Lange, Little and Taylor, J. Am. Stat. Assoc.
84, 881 (1989), of the information of t errors."""

from collections.abc import Callable, Mapping
from copy import copy
from typing import Any

import jax
import numpy as np

from calibration.fitting.errors import Errors
from calibration.fitting.rows import BlockResiduals

# Measured on 8 fits: groups, extra scatter, Student's t, errors of velocities and of times (STEP,
# LONGEST on 21 of these).

# of a variance, over the mean square of the residuals; 1e-12 and 1e-6 move estimates by up to 3e-7
# standard errors
LEAST, MOST = 1e-9, 1e3
NONE = 1e-7  # the same, below which it counts as none; no effect from 1e-8 to 1e-4
# in the logarithm of a variance, of differences of fourth order; 1e-3 and 0.1 move standard errors
# by up to 3e-5
STEP = 1e-2
RIDGE = 1e-12  # of the information, where parameters are not separate; no effect from 1e-15 to 1e-9
LONGEST = 2.0  # step in a logarithm of a variance; 0.5 and 8 end in the same places
ROUNDS, HALVINGS = 60, 25  # Newton's steps, and how often one is halved; 15 and 6 are enough
ARRIVED = 1e-8  # step in a logarithm: it is the last; 1e-5 moves nothing by 1e-10
# points of all fits, up to which the search begins from several places; from one only all ended as
# here
FEW = 20_000

Estimated = dict[str, np.ndarray]


def differences(value: Callable[[np.ndarray], Any], count: int, step: float = STEP):
    """Value, first and second derivatives at 0 along `count` directions, as lists, of any array.

    By differences of fourth order, of second order for the mixed ones.
    """
    unit, here = step * np.eye(count), value(np.zeros(count))
    first, second = [], [[0.0 * here for _ in range(count)] for _ in range(count)]
    for i in range(count):
        far_down, down, up, far_up = (value(n * unit[i]) for n in (-2, -1, 1, 2))
        first.append((8 * (up - down) - (far_up - far_down)) / (12 * step))
        second[i][i] = (16 * (up + down) - (far_up + far_down) - 30 * here) / (12 * step**2)
        for j in range(i):
            along, across = unit[i] + unit[j], unit[i] - unit[j]
            mixed = value(along) + value(-along) - value(across) - value(-across)
            second[i][j] = second[j][i] = mixed / (4 * step**2)
    return here, first, second


def criterion(errors: Errors, s: Mapping[str, Any], block: BlockResiduals, restricted: bool = True):
    """-2 ln L_R, or with what is not restricted -2 ln L, (fits,)."""
    at = (s, block.residual, block.slope, block.curvature_variance)
    if block.included is None:
        value = errors.deviance(*at)
    else:
        value = -2 * np.sum(block.included * errors.by_point(*at), axis=1)
    if not restricted or not block.jacobian.shape[2]:
        return value
    factor = errors.factor(s, block.slope, block.curvature_variance)
    columns = np.concatenate([block.jacobian, block.residual[..., None]], axis=2)
    white = errors.whiten(factor, columns * block.weight[..., None])
    residual, shares = white[..., -1], np.sqrt(errors.noise.information)
    jacobian = white[..., :-1] * np.asarray(shares)[..., None]
    information = block.information + np.swapaxes(jacobian, 1, 2) @ jacobian
    # in units that s does not move: a direction that does not show is a constant, and costs no point
    size, free = block.sizes, block.free
    information = np.where(free[:, :, None] & free[:, None], information, 0.0)
    values, vectors = np.linalg.eigh(information / (size[:, :, None] * size[:, None]))
    values = np.where(values > RIDGE * np.max(values, axis=1, keepdims=True), values, RIDGE)
    value = value + np.sum(np.log(values), axis=1) + 2 * np.sum(np.log(size), axis=1)
    if not errors.noise.is_least_squares or block.gradient is None:
        return value
    b = (block.gradient + np.einsum("fnp,fn->fp", jacobian, residual)) * block.free / size
    return value - np.sum(np.einsum("fpq,fp->fq", vectors, b) ** 2 / values, axis=1)


def estimated(
    errors: Errors,
    block: BlockResiduals,
    restricted: bool = True,
    before: Mapping[str, Any] | None = None,
) -> Estimated:
    """The variances of the largest (restricted) likelihood, (fits,) each; searched from `before`."""
    if errors.is_plain and errors.noise.is_least_squares and block.gradient is None:
        return {"scatter": _scatter(_with_own_parameters(block), restricted)}
    search = _Search(errors, block, restricted)
    known = before is not None and set(errors.unknown) <= set(before)
    starts = [search.place(before, most=0.0)] if known else search.starts()
    values = [search.value(y) for y in starts]
    if block.residual.size > FEW and len(starts) > 1:
        starts = [starts[int(np.argmin([float(np.sum(v)) for v in values]))]]
    ends = [search.descended(y) for y in starts]
    values = np.array([search.value(y) for y in ends])
    best = np.array(ends)[np.argmin(values, axis=0), np.arange(len(block.residual))]
    return search.variances(best)


def _scatter(block: BlockResiduals, restricted: bool) -> np.ndarray:
    """s of the largest (restricted) likelihood where V = s 1, (fits,).

    In directions that are orthonormal to A₀ + JᵀJ/s₀, of which the points have the share e, with x = s₀/s,

        d(-2 ln L_R)/d(ln s) = n - x Σ r²/s₀ - Σ e x/(1 - e + e x),

    which falls with x and bends upwards: Newton's steps from the left never pass its zero.
    """
    weight, square = block.weight, block.square
    count = np.sum(weight, axis=1)
    squares = np.sum(weight * block.residual**2, axis=1) / square
    shares = np.zeros((len(square), 0))
    if restricted and block.jacobian.shape[2]:
        size, free = block.sizes, block.free
        jacobian = block.jacobian * (weight[..., None] / np.sqrt(square)[:, None, None])
        of_points = np.swapaxes(jacobian, 1, 2) @ jacobian
        both = size[:, :, None] * size[:, None]
        where = free[:, :, None] & free[:, None]
        of_points, of_all = (
            np.where(where, a / both, 0.0) for a in (of_points, block.information + of_points)
        )
        values, vectors = np.linalg.eigh(of_all)
        seen = values > RIDGE * np.max(values, axis=1, keepdims=True)
        scale = np.where(seen, 1 / np.sqrt(np.where(seen, values, 1.0)), 0.0)
        root = vectors * scale[:, None]
        inner = np.swapaxes(root, 1, 2) @ of_points @ root
        shares = np.clip(np.linalg.eigvalsh(inner), 0.0, 1.0)
    ends = 1 / MOST, 1 / LEAST
    x = np.clip((count - np.sum(shares, axis=1)) / np.maximum(squares, 1e-300), ends[0], 1.0)
    for _ in range(ROUNDS):
        left = 1 - shares + shares * x[:, None]
        value = count - squares * x - np.sum(shares * x[:, None] / left, axis=1)
        slope = -squares - np.sum(shares * (1 - shares) / left**2, axis=1)
        step = np.clip(x - value / np.minimum(slope, -1e-300), *ends) - x
        x = x + step
        if np.all(np.abs(step) <= 1e-14 * x):
            break
    return square / x


def relative_covariance(errors: Errors, s: Mapping[str, Any], block: BlockResiduals):
    """Covariance of the logarithms of the variances, (fits, k, k), from the curvature of the criterion."""
    search = _Search(errors, block, True)
    curvature = 0.5 * search.expanded(search.place(s))[2]
    inside = np.stack([np.broadcast_to(s[k], len(block.residual)) > 0 for k in errors.unknown], 1)
    both = inside[:, :, None] & inside[:, None]
    values, vectors = np.linalg.eigh(np.where(both, curvature, np.eye(len(errors.unknown))))
    # a variance that the data hardly determine: as if from one degree of freedom
    inverse = (vectors / np.maximum(values, 0.5)[:, None]) @ np.swapaxes(vectors, 1, 2)
    return np.where(both, inverse, 0.0)


def _with_own_parameters(block: BlockResiduals) -> BlockResiduals:
    """Select the parameters that the block depends on; the others are at their best for these.

    That changes the criterion by a constant. Each of many sets depends on a few parameters only.
    """
    active = np.any(block.jacobian != 0, axis=(0, 1))
    if np.all(active) or block.gradient is not None:
        return block
    free = block.free[:, :, None] & block.free[:, None]  # what is at an end follows nothing
    information = np.where(free, block.information, 0.0)
    others = information[:, ~active][:, :, ~active]
    size = np.sqrt(np.diagonal(others, axis1=1, axis2=2))
    size = np.where(size > 0, size, 1.0)
    across = information[:, active][:, :, ~active] / size[:, None]
    others = others / (size[:, :, None] * size[:, None]) + RIDGE * np.eye(size.shape[1])
    return block._replace(
        jacobian=block.jacobian[:, :, active],
        information=information[:, active][:, :, active]
        - across @ np.linalg.solve(others, np.swapaxes(across, 1, 2)),
        free=block.free[:, active],
    )


class _Search:
    """The criterion over y = ln of the variances, in units of the residuals' mean square."""

    def __init__(self, errors: Errors, block: BlockResiduals, restricted: bool):
        block = _with_own_parameters(block)
        self.errors, self.block, self.restricted = errors, block, restricted
        self.square = block.square
        self.unit = np.stack([self._unit(kind) for kind in errors.unknown], axis=1)
        self.lower, self.upper = np.log([LEAST, MOST])

    def select(self, fits: np.ndarray) -> "_Search":
        """Select fits."""
        part = copy(self)
        part.block = jax.tree.map(lambda leaf: leaf[fits], self.block)
        part.square, part.unit = self.square[fits], self.unit[fits]
        return part

    def _unit(self, kind: str) -> np.ndarray:
        """Variance that makes ε as uncertain as the residuals are."""
        if kind in ("scatter", "group"):
            return self.square
        unit = self.errors.variance({kind: 1.0}, self.block.slope, self.block.curvature_variance)
        return self.square / np.maximum(np.mean(unit + 0 * self.block.residual, axis=1), 1e-300)

    def as_variances(self, y: np.ndarray) -> Estimated:
        values = np.exp(y) * self.unit
        return {kind: values[:, k] for k, kind in enumerate(self.errors.unknown)}

    def variances(self, y: np.ndarray) -> Estimated:
        """0 where it is none; but something has to be left."""
        variances = self.as_variances(y)
        none = np.exp(y) <= NONE
        bare = dict.fromkeys(variances, 0.0)
        with np.errstate(invalid="ignore"):
            rest = (
                self.errors.variance(bare, self.block.slope, self.block.curvature_variance)
                + 0 * self.block.residual
            )
        # offsets alone leave no error between the points of a group
        apart = np.array(self.errors.unknown) != "group"
        indefinite = np.all(none | ~apart, axis=1)
        indefinite &= ~(np.min(rest, axis=1) > NONE * self.square)
        none[indefinite, 0] = False
        kinds = enumerate(self.errors.unknown)
        return {kind: np.where(none[:, k], 0.0, variances[kind]) for k, kind in kinds}

    def place(self, s: Any, most: float = np.inf) -> np.ndarray:
        every = [np.broadcast_to(s[kind], len(self.square)) for kind in self.errors.unknown]
        logs = np.log(np.maximum(np.stack(every, axis=1) / self.unit, 1e-300))
        return np.clip(logs, self.lower, min(self.upper, most))

    def starts(self) -> list[np.ndarray]:
        """Equal shares, and most in each of the variances."""
        k = len(self.unit[0])
        shares = [np.full(k, 0.5 / k), *(np.where(np.arange(k) == j, 0.9, 0.05) for j in range(k))]
        return [np.repeat(np.log(x)[None], len(self.unit), 0) for x in shares[: k + (k > 1)]]

    def value(self, y: np.ndarray) -> np.ndarray:
        result = criterion(self.errors, self.as_variances(y), self.block, self.restricted)
        return np.where(np.isfinite(result), result, np.inf)

    def expanded(self, y: np.ndarray):
        """Value, gradient and curvature."""
        here, first, second = differences(lambda step: self.value(y + step), y.shape[1])
        return here, np.stack(first, axis=1), np.moveaxis(np.array(second), 2, 0)

    def descended(self, y: np.ndarray) -> np.ndarray:
        """The nearest minimum of each fit; a variance that is none ends at its lower bound."""
        y, going, search = np.array(y), np.arange(len(y)), self
        for _ in range(ROUNDS):
            here, gradient, curvature = search.expanded(at := y[going])
            at_end = (at <= self.lower) & (gradient > 0) | (at >= self.upper) & (gradient < 0)
            gradient = np.where(at_end, 0.0, gradient)
            free = ~(at_end[:, :, None] | at_end[:, None])
            values, vectors = np.linalg.eigh(np.where(free, curvature, np.eye(y.shape[1])))
            size = np.abs(values)
            size = np.maximum(size, np.maximum(1e-14 * np.max(size, axis=1, keepdims=True), 1e-14))
            along = np.einsum("fij,fi->fj", vectors, gradient) / size
            # not cut element by element: along such a step the value may rise
            along = np.clip(along, -LONGEST, LONGEST)
            step = -np.einsum("fij,fj->fi", vectors, along)
            last = np.max(np.abs(step), axis=1) <= ARRIVED
            share, moved = np.ones(len(at)), np.array(last)
            trial = np.clip(at + share[:, None] * step, self.lower, self.upper)
            for _ in range(HALVINGS):
                if np.all(moved):
                    break
                moved |= search.value(trial) <= here + 1e-13 * np.abs(here)
                share = np.where(moved, share, 0.5 * share)
                trial = np.clip(at + share[:, None] * step, self.lower, self.upper)
            y[going] = np.where(moved[:, None], trial, at)
            further = moved & ~last & np.any(trial != at, axis=1)
            if not np.any(further):
                break
            going, search = going[further], search.select(further)
        return y
