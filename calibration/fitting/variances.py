"""Variances that are not stated, of one data set beside others: by restricted maximum likelihood.

    -2 ln L_R = -2 ln p(data | θ, s) + ln det (A₀ + Jᵀ V⁻¹ J) - bᵀ (A₀ + Jᵀ V⁻¹ J)⁻¹ b

with J the slopes of ε in θ, A₀ and b₀ what the other data sets and the priors know of the parameters,
b = b₀ + Jᵀ V⁻¹ r. The parameters that the curve costs are accounted for, so that the variance of
residuals of n points and p parameters is Σ r²/(n - p). Student's t has information (ν + 1)/(ν + 3)
Jᵀ V⁻¹ J, and no b: the residuals are those at the minimum once all has settled.

Many fits go side by side, in a damped Newton search of the logarithms.

Source: Patterson and Thompson, Biometrika 58, 545 (1971); Lange, Little and Taylor, J. Am. Stat. Assoc.
84, 881 (1989), of the information of t errors.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from calibration.fitting.errors import Errors
from calibration.options import DOF

LEAST, MOST = 1e-9, 1e3  # of a variance, over the mean square of the residuals
NONE = 1e-7  # the same, below which it counts as none
STEP = 1e-2  # in the logarithm of a variance, of differences of fourth order
RIDGE = 1e-12  # of the information, where parameters are not told apart
LONGEST = 2.0  # step in a logarithm
ROUNDS, HALVINGS = 60, 25
ARRIVED = 1e-8  # of a step
FEW = 20_000  # points of all fits, up to which the search begins from several places

Estimated = dict[str, np.ndarray]


class Seen(NamedTuple):
    """What a data set's variances are judged by, of fits side by side.

    Attributes:
        off, jacobian: predicted less measured ε, and its slopes; not weighted.
        slope, bend: of the curve, see `Carried`.
        information, gradient: A₀ and b₀; no b₀ where several sets take turns, whose residuals stay.
        kept: 0 for points that are left out, which share no error with others; None: all are there.
    """

    off: Float[np.ndarray, "fits n"]
    jacobian: Float[np.ndarray, "fits n p"]
    slope: Any
    bend: Any
    information: Float[np.ndarray, "fits p p"]
    gradient: Float[np.ndarray, "fits p"] | None
    kept: Any = None

    @property
    def counted(self) -> Any:
        """1 for every point that is there."""
        return np.ones(self.off.shape) if self.kept is None else self.kept


def criterion(errors: Errors, s: Mapping[str, Any], seen: Seen, restricted: bool = True):
    """-2 ln L_R, or with what is not restricted -2 ln L, (fits,)."""
    at = (s, seen.off, seen.slope, seen.bend)
    if seen.kept is None:
        value = errors.deviance(*at)
    else:
        value = -2 * np.sum(seen.kept * errors.by_point(*at), axis=1)
    if not restricted or not seen.jacobian.shape[2]:
        return value
    factor = errors.factor(s, seen.slope, seen.bend)
    columns = np.concatenate([seen.jacobian, seen.off[..., None]], axis=2)
    white = errors.whiten(factor, columns * seen.counted[..., None])
    jacobian, off, nu = white[..., :-1], white[..., -1], errors.nu(s)
    if nu is not None:
        jacobian = jacobian * np.sqrt((nu + 1) / (nu + 3))[..., None]
    information = seen.information + np.swapaxes(jacobian, 1, 2) @ jacobian
    size = np.sqrt(np.maximum(np.diagonal(information, axis1=1, axis2=2), 1e-300))
    scaled = information / (size[:, :, None] * size[:, None]) + RIDGE * np.eye(size.shape[1])
    value = value + np.linalg.slogdet(scaled)[1] + 2 * np.sum(np.log(size), axis=1)
    if nu is not None or seen.gradient is None:
        return value
    b = (seen.gradient + np.einsum("fnp,fn->fp", jacobian, off)) / size
    return value - np.einsum("fp,fp->f", b, np.linalg.solve(scaled, b[..., None])[..., 0])


def estimated(
    errors: Errors, seen: Seen, restricted: bool = True, before: Mapping[str, Any] | None = None
) -> Estimated:
    """The variances of the largest (restricted) likelihood, (fits,) each; searched from `before`."""
    if _is_proportional(errors, seen):
        return _by_squares(errors, seen, restricted)
    search = _Search(errors, seen, restricted)
    known = before is not None and set(errors.unknown) <= set(before)
    starts = [search.place(before)] if known else search.starts()  # type: ignore[arg-type]
    values = [search.value(y) for y in starts]
    if seen.off.size > FEW and len(starts) > 1:
        starts = [starts[int(np.argmin([float(np.sum(v)) for v in values]))]]
    ends = [search.descended(y) for y in starts]
    values = np.array([search.value(y) for y in ends])
    best = np.array(ends)[np.argmin(values, axis=0), np.arange(len(seen.off))]
    return search.variances(best)


def relative_covariance(errors: Errors, s: Mapping[str, Any], seen: Seen):
    """Of the logarithms of the variances, (fits, k, k), from the criterion's curvature; 0 of one that is 0."""
    if _is_proportional(errors, seen):
        return (2 / _left(errors, seen))[:, None, None]
    search = _Search(errors, seen, True)
    curvature = 0.5 * search.expanded(search.place(s))[2]
    inside = np.stack([np.broadcast_to(s[kind], len(seen.off)) > 0 for kind in errors.unknown], 1)
    both = inside[:, :, None] & inside[:, None]
    values, vectors = np.linalg.eigh(np.where(both, curvature, np.eye(len(errors.unknown))))
    # a variance that the data hardly tell: as if from one degree of freedom
    inverse = (vectors / np.maximum(values, 0.5)[:, None]) @ np.swapaxes(vectors, 1, 2)
    return np.where(both, inverse, 0.0)


def _is_proportional(errors: Errors, seen: Seen) -> bool:
    """Whether V is one unknown number times what is known, and nothing else is known of the parameters."""
    scales = errors.unknown in (("scale",), ("timing",)) or (
        errors.unknown == ("scatter",) and errors.is_plain
    )
    return scales and errors.dof is None and not np.any(seen.information)


def _by_squares(errors: Errors, seen: Seen, restricted: bool) -> Estimated:
    """rᵀ V₁⁻¹ r over the residuals' degrees of freedom, of the residuals at the minimum."""
    kind = errors.unknown[0]
    factor = errors.factor({kind: 1.0}, seen.slope, seen.bend)
    off = errors.whiten(factor, (seen.off * seen.counted)[..., None])[..., 0]
    return {kind: np.maximum(np.sum(off**2, axis=1) / _left(errors, seen, restricted), 1e-300)}


def _left(errors: Errors, seen: Seen, restricted: bool = True) -> np.ndarray:
    """Points less what the parameters cost."""
    left = np.sum(seen.counted, axis=1)
    if restricted and seen.jacobian.shape[2]:
        factor = errors.factor({errors.unknown[0]: 1.0}, seen.slope, seen.bend)
        jacobian = errors.whiten(factor, seen.jacobian * seen.counted[..., None])
        size = np.linalg.norm(jacobian, axis=1, keepdims=True)
        singular = np.linalg.svd(jacobian / np.where(size > 0, size, 1.0), compute_uv=False)
        rank = np.sum(singular > 1e-9 * np.max(singular, axis=1, keepdims=True), axis=1)
        left = np.maximum(left - rank, 1.0)
    return left


class _Search:
    """The criterion over y = ln of the variances, in units of the residuals' mean square."""

    def __init__(self, errors: Errors, seen: Seen, restricted: bool):
        self.errors, self.seen, self.restricted = errors, seen, restricted
        counted = seen.counted
        squares = np.sum(counted * seen.off**2, axis=1) / np.sum(counted, axis=1)
        self.square = np.maximum(squares, 1e-30)
        self.unit = np.stack([self._unit(kind) for kind in errors.unknown], axis=1)
        is_dof = np.array([kind == "dof" for kind in errors.unknown])
        self.lower = np.where(is_dof, np.log(DOF[0]), np.log(LEAST))
        self.upper = np.where(is_dof, np.log(DOF[1]), np.log(MOST))
        self.is_dof = is_dof

    def _unit(self, kind: str) -> np.ndarray:
        """What makes ε as uncertain as the residuals are."""
        if kind == "dof":
            return np.ones(len(self.square))
        if kind in ("scatter", "group"):
            return self.square
        one = self.errors.variance({kind: 1.0}, self.seen.slope, self.seen.bend)
        return self.square / np.maximum(np.mean(one + 0 * self.seen.off, axis=1), 1e-300)

    def as_variances(self, y: np.ndarray) -> Estimated:
        values = np.exp(y) * self.unit
        return {kind: values[:, k] for k, kind in enumerate(self.errors.unknown)}

    def variances(self, y: np.ndarray) -> Estimated:
        """0 where it is none; but something has to be left."""
        found = self.as_variances(y)
        none = (np.exp(y) <= NONE) & ~self.is_dof
        bare = {kind: np.zeros(len(y)) for kind in found} | (
            {"dof": found["dof"]} if "dof" in found else {}
        )
        with np.errstate(invalid="ignore"):
            least = np.min(
                self.errors.variance(bare, self.seen.slope, self.seen.bend) + 0 * self.seen.off,
                axis=1,
            )
        indefinite = np.all(none | self.is_dof, axis=1) & ~(least > NONE * self.square)
        none[indefinite, 0] = False
        return {
            kind: np.where(none[:, k], 0.0, found[kind])
            for k, kind in enumerate(self.errors.unknown)
        }

    def place(self, s: Mapping[str, Any]) -> np.ndarray:
        values = np.stack(
            [np.broadcast_to(s[kind], len(self.square)) for kind in self.errors.unknown], axis=1
        )
        return np.clip(np.log(np.maximum(values / self.unit, 1e-300)), self.lower, self.upper)

    def starts(self) -> list[np.ndarray]:
        """Equal shares, and most in each of the variances."""
        k = len(self.unit[0])
        shares = [np.full(k, 0.5 / k), *(np.where(np.arange(k) == j, 0.9, 0.05) for j in range(k))]
        logs = [np.where(self.is_dof, np.log(6.0), np.log(one)) for one in shares[: k + (k > 1)]]
        return [np.repeat(one[None], len(self.unit), axis=0) for one in logs]

    def value(self, y: np.ndarray) -> np.ndarray:
        found = criterion(self.errors, self.as_variances(y), self.seen, self.restricted)
        return np.where(np.isfinite(found), found, np.inf)

    def expanded(self, y: np.ndarray):
        """Value, gradient and curvature."""
        k, h, here = y.shape[1], STEP, self.value(y)
        gradient, curvature = np.zeros(y.shape), np.zeros((*y.shape, k))
        unit = np.eye(k)
        for i in range(k):
            far_down, down, up, far_up = (self.value(y + n * h * unit[i]) for n in (-2, -1, 1, 2))
            gradient[:, i] = (8 * (up - down) - (far_up - far_down)) / (12 * h)
            second = 16 * (up + down) - (far_up + far_down) - 30 * here
            curvature[:, i, i] = second / (12 * h**2)
            for j in range(i):
                a, b = h * unit[i], h * unit[j]
                mixed = self.value(y + a + b) - self.value(y + a - b)
                mixed += self.value(y - a - b) - self.value(y - a + b)
                curvature[:, i, j] = curvature[:, j, i] = mixed / (4 * h**2)
        return here, gradient, curvature

    def descended(self, y: np.ndarray) -> np.ndarray:
        """The nearest minimum of each fit; a variance that is none ends at its lower bound."""
        y, going = np.array(y), np.ones(len(y), bool)
        for _ in range(ROUNDS):
            here, gradient, curvature = self.expanded(y)
            at_end = (y <= self.lower) & (gradient > 0) | (y >= self.upper) & (gradient < 0)
            gradient = np.where(at_end, 0.0, gradient)
            free = ~(at_end[:, :, None] | at_end[:, None])
            values, vectors = np.linalg.eigh(np.where(free, curvature, np.eye(y.shape[1])))
            size = np.abs(values)
            size = np.maximum(size, np.maximum(1e-14 * np.max(size, axis=1, keepdims=True), 1e-14))
            along = np.einsum("fij,fi->fj", vectors, gradient) / size
            step = np.clip(-np.einsum("fij,fj->fi", vectors, along), -LONGEST, LONGEST)
            going &= np.max(np.abs(step), axis=1) > ARRIVED
            if not np.any(going):
                break
            share, moved = np.where(going, 1.0, 0.0), ~going
            for _ in range(HALVINGS):
                trial = np.clip(y + share[:, None] * step, self.lower, self.upper)
                moved |= self.value(trial) <= here + 1e-13 * np.abs(here)
                if np.all(moved):
                    break
                share = np.where(moved, share, 0.5 * share)
            going &= moved & np.any(trial != y, axis=1)
            y = np.where(moved[:, None], trial, y)
        return y
