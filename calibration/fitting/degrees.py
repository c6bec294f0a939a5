"""How well the noise is known, and what that does to covariances and quantiles.

A variance C that is a sum of parts C_c, each in proportion to a variance that is an estimate, has

    ν = 2 C² / Σ_cd C_c C_d R_cd

degrees of freedom, with R the covariance of the logarithms of the estimates: 2/ν_c for one from ν_c
degrees of freedom of its own.

With V = Σ θ_c V_c the covariance Φ = (Jᵀ V⁻¹ J)⁻¹ takes V for known. As the estimates scatter by
more, it is on the average too small by as much again:

    Φ + 2 Φ [Σ_cd R_cd (Q_cd - P_c Φ P_d)] Φ,
    P_c = xᵀ θ_c V_c x,  Q_cd = (θ_c V_c x)ᵀ V⁻¹ (θ_d V_d x),  x = V⁻¹ J.

Source: Satterthwaite, Biometrics Bulletin 2, 110 (1946); Kenward and Roger, Biometrics 53, 983
(1997), for variances that V is linear in.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from calibration.fitting.noise import Noise, seen_by
from calibration.fitting.problem import Problem
from calibration.fitting.set_errors import SetErrors
from calibration.fitting.variances import relative_covariance

FEWEST = 1.0  # degrees of freedom

Matrix = Float[np.ndarray, "p p"]


@dataclass(frozen=True)
class Parts:
    """A covariance by the estimated variances that it is made of; of fits side by side.

    Attributes:
        whole: the covariance, 0 for what is not determined, (fits, p, p).
        parts: (fits, c, p, p).
        relative: R, (fits, c, c).
        sets: the data set of each part, (c,).
        names: what each part's variance is of.
    """

    whole: Float[np.ndarray, "fits p p"]
    parts: Float[np.ndarray, "fits c p p"]
    relative: Float[np.ndarray, "fits c c"]
    sets: Int[np.ndarray, "c"]
    names: tuple[str, ...]

    def along(self, directions: Float[np.ndarray, "n p"]) -> Float[np.ndarray, "fits n"]:
        """Degrees of freedom of aᵀ C a, infinite where nothing of it is estimated."""
        whole = np.einsum("np,fpq,nq->fn", directions, self.whole, directions)
        parts = np.einsum("np,fcpq,nq->fnc", directions, self.parts, directions)
        return satterthwaite(whole, parts, self.relative)

    def turned(self, order: Int[np.ndarray, "p"]) -> "Parts":
        """With the parameters in another order."""
        whole = self.whole[:, order][:, :, order]
        return replace(self, whole=whole, parts=self.parts[:, :, order][:, :, :, order])


def satterthwaite(
    whole: Float[np.ndarray, "fits n"],
    parts: Float[np.ndarray, "fits n c"],
    relative: Float[np.ndarray, "fits c c"],
) -> Float[np.ndarray, "fits n"]:
    """ν, see above."""
    spread = np.einsum("fnc,fcd,fnd->fn", parts, relative, parts)
    with np.errstate(divide="ignore", invalid="ignore"):
        degrees = np.where(spread > 0, 2 * whole**2 / spread, np.inf)
    return np.maximum(np.where(np.isnan(degrees), np.inf, degrees), FEWEST)


class Shared(NamedTuple):
    """What the points of one data set share, and how well it is known.

    Attributes:
        errors: with the variances that were estimated.
        jacobian: of ε, (n, p).
        relative: R of these variances.
    """

    errors: SetErrors
    jacobian: Float[np.ndarray, "n p"]
    relative: Float[np.ndarray, "c c"]


def shared_of(problem: Problem, z: Float[np.ndarray, "p"]) -> list[Shared]:
    """Of each data set at z of one fit; none where points share no errors."""
    if problem.shared is None:
        return []
    pairs = zip(problem.shared, seen_by(problem, z), strict=True)
    return [Shared(one, seen.jacobian, relative_covariance(one, seen)) for one, seen in pairs]


def inflation(shared: Sequence[Shared], inverse: Float[np.ndarray, "fits p p"]):
    """What is added to Φ = `inverse`; all fits share one V."""
    return 2 * inverse @ sum(missing(*one, inverse[0]) for one in shared) @ inverse


def missing(errors: SetErrors, jacobian, relative, inverse: Matrix) -> Matrix:
    """Σ R_cd (Q_cd - P_c Φ P_d)."""
    solved = errors.solved(jacobian)
    applied = errors.applied(solved, jacobian)
    white = [errors.whiten(part) for part in applied]
    within = [solved.T @ part for part in applied]
    total = np.zeros_like(inverse)
    for c, (one, p_one) in enumerate(zip(white, within, strict=True)):
        for d, (two, p_two) in enumerate(zip(white, within, strict=True)):
            total += relative[c, d] * (one.T @ two - p_one @ inverse @ p_two)
    return total


def noise_parts(problem: Problem, noise: Noise, shared: Sequence[Shared], scores, inverse) -> Parts:
    """Of the covariance of stacked estimating equations.

    Args:
        problem: of the first stage, which the noise is that of.
        shared: `shared_of` the problem, of the first fit for all.
        scores: what an error of one standard deviation in each point adds to each equation.
        inverse: A⁻¹.
    """
    of_set = [scores[:, problem.points.set == g] for g in range(len(problem.datasets))]
    if shared:
        found = [_shared(one, own) for one, own in zip(shared, of_set, strict=True)]
    else:
        found = [_single(problem, noise, g, own) for g, own in enumerate(of_set)]
    fits, size = len(scores), scores.shape[2]
    middles = [np.zeros((fits, 0, size, size))] + [middle for middle, _, _ in found]
    middle = np.concatenate(middles, axis=1)
    relative = np.zeros((fits, middle.shape[1], middle.shape[1]))
    first = 0
    for _, part, _ in found:
        rows = slice(first, first + part.shape[1])
        relative[:, rows, rows], first = part, rows.stop
    sets = np.repeat(np.arange(len(found)), [len(names) for _, _, names in found])
    names = tuple(name for _, _, own in found for name in own)
    carried = lambda m: inverse[:, None] @ m @ np.swapaxes(inverse, 1, 2)[:, None]  # noqa: E731
    whole = inverse @ np.swapaxes(scores, 1, 2) @ scores @ np.swapaxes(inverse, 1, 2)
    return Parts(whole, carried(middle), relative, sets, names)


def _single(problem: Problem, noise: Noise, g: int, own):
    """Points that share nothing: one variance, or where each has its own, as many."""
    plan, data = problem.plans[g], problem.datasets[g]
    if plan.stated and data.degrees is None:
        size = own.shape[2]
        return np.zeros((len(own), 0, size, size)), np.zeros((len(own), 0, 0)), ()
    if plan.separate and plan.stated:
        middle = own[:, :, :, None] * own[:, :, None, :]
        relative = np.broadcast_to(
            np.diag(2 / np.asarray(data.degrees, float)), (len(own), *[len(data)] * 2)
        )
        return middle, relative, ("repeats",) * len(data)
    middle = (np.swapaxes(own, 1, 2) @ own)[:, None]
    left = np.full(len(own), float(data.degrees)) if plan.stated else noise.left[:, g]
    return middle, (2 / left)[:, None, None], (plan.unknown[0] if plan.unknown else "repeats",)


def _shared(shared: Shared, scores):
    """Points that share errors: one part for each unknown variance."""
    errors, names = shared.errors, list(shared.errors.variance)
    middle = []
    for fit in scores:
        parts = errors.contributions(errors.unwhiten(fit))
        middle.append([parts[name] for name in names])
    size = scores.shape[2]
    shape = (len(scores), len(names), size, size)
    many = np.broadcast_to(shared.relative, (len(scores), *shared.relative.shape))
    return np.array(middle).reshape(shape), many, tuple(names)
