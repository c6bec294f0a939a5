"""Residuals and Jacobian of each fit condensed to what a step needs: a triangle, decomposed."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

TINY = 1e-150  # a column so short that its square underflows is none
SEEN = 1e-10  # singular values, columns scaled to one, below which a direction is not seen
SILENT = 1e-9  # a column of the Jacobian so small against the residuals acts on nothing


class Condensed(NamedTuple):
    """J = Q R with the columns of R scaled to one, R = U S Vᵀ, of each fit.

    Attributes:
        cost: what is minimised.
        gradient: Jᵀ r.
        size: lengths of the columns of J, 1 where there is none.
        singular, directions: S in falling order, and V (p, p).
        along: Uᵀ Qᵀ r.
        silent: columns that act on nothing.
        finite: whether residuals and Jacobian are numbers.
    """

    cost: Float[np.ndarray, "fits"]
    gradient: Float[np.ndarray, "fits p"]
    size: Float[np.ndarray, "fits p"]
    singular: Float[np.ndarray, "fits p"]
    directions: Float[np.ndarray, "fits p p"]
    along: Float[np.ndarray, "fits p"]
    silent: Bool[np.ndarray, "fits p"]
    finite: Bool[np.ndarray, "fits"]

    @property
    def seen(self) -> Bool[np.ndarray, "fits p"]:
        """Directions that the residuals move with."""
        return self.singular > SEEN * np.maximum(self.singular[:, :1], TINY)

    def whitening(self, damping: Float[np.ndarray, "fits"]) -> Float[np.ndarray, "fits p p"]:
        """T with Tᵀ (JᵀJ + damping) T = 1; columns of directions that are not seen are zero."""
        largest = self.singular[:, :1]
        damped = np.sqrt(self.singular**2 + damping[:, None] * largest**2)
        per = np.where(self.seen, 1 / np.where(self.seen, damped, 1.0), 0.0)
        return self.directions * per[:, None, :] / self.size[:, :, None]

    @property
    def newton(self) -> Float[np.ndarray, "fits p"]:
        """The Gauss–Newton step that is left, without the directions that are not seen."""
        part = np.where(self.seen, self.along / np.where(self.seen, self.singular, 1.0), 0.0)
        return -np.einsum("fij,fj->fi", self.directions, part) / self.size

    @property
    def promised(self) -> Float[np.ndarray, "fits"]:
        """By how much that step would lower the sum of squares."""
        return np.sum(np.where(self.seen, self.along, 0.0) ** 2, axis=1)

    def fall(self, step: Float[np.ndarray, "fits p"]) -> Float[np.ndarray, "fits"]:
        """By how much such a step would lower the cost were residuals straight lines."""
        moved = self.singular * np.einsum("fij,fi->fj", self.directions, self.size * step)
        return -np.einsum("fp,fp->f", self.gradient, step) - 0.5 * np.sum(moved**2, axis=1)

    def replaced(self, fits: Bool[np.ndarray, "fits"], by: "Condensed") -> "Condensed":
        """The same with some fits' as `by` has them."""
        parts = [np.array(a) for a in self]
        for part, new in zip(parts, by, strict=True):
            part[fits] = new
        return Condensed(*parts)


def condense(
    residual: Float[np.ndarray, "fits m"],
    jacobian: Float[np.ndarray, "fits m p"],
    held: Bool[np.ndarray, "fits p"] | None = None,
    cost: Float[np.ndarray, "fits"] | None = None,
) -> Condensed:
    """Of each fit; columns that are held count as none. The cost, where not given, is ½ rᵀ r."""
    finite = np.all(np.isfinite(residual), 1) & np.all(np.isfinite(jacobian), (1, 2))
    residual = np.where(finite[:, None], residual, 0.0)
    jacobian = np.where(finite[:, None, None], jacobian, 0.0)
    if held is not None:
        jacobian = np.where(held[:, None, :], 0.0, jacobian)
    p = jacobian.shape[2]
    length = np.sqrt(np.einsum("fmp,fmp->fp", jacobian, jacobian))
    norm = np.sqrt(np.einsum("fm,fm->f", residual, residual))
    acts = length > TINY
    size = np.where(acts, length, 1.0)
    scaled = np.where(acts[:, None, :], jacobian / size[:, None, :], 0.0)
    joined = np.concatenate([scaled, residual[:, :, None]], axis=2)
    missing = max(p + 1 - joined.shape[1], 0)  # fewer residuals than parameters
    joined = np.pad(joined, ((0, 0), (0, missing), (0, 0)))
    triangle: np.ndarray = np.asarray(np.linalg.qr(joined, mode="r"))
    left, singular, right = np.linalg.svd(triangle[:, :p, :p])
    along = np.einsum("fji,fj->fi", left, triangle[:, :p, p])
    directions = np.swapaxes(right, 1, 2)
    gradient = size * np.einsum("fij,fj->fi", directions, singular * along)
    cost = np.where(finite, 0.5 * norm**2 if cost is None else cost, np.inf)
    silent = length <= SILENT * norm[:, None]
    return Condensed(cost, gradient, size, singular, directions, along, silent, finite)
