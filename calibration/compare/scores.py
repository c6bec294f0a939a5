"""Numbers that tell how well a curve follows data, and how well its parameters are known."""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from calibration.minima import LEFT_UNDONE

Column = Float[np.ndarray, "..."]
RANK_CUT = 1e-10  # singular values of the Jacobian with unit columns
SILENT = 1e-4  # a column of the Jacobian so small against the residuals acts on nothing
ROUNDING = 1e-10  # residuals that are zero


def root_mean_square(residual: Column) -> float:
    """rms [-]; NaN for residuals that are none."""
    return float(np.sqrt(np.mean(residual**2)))


def aicc(weighted: Column, fitted: int) -> float | None:
    """Akaike's criterion for small samples, n ln(S/n) + 2K + 2K(K + 1)/(n - K - 1).

    S is the sum of squares of the weighted residuals and K = `fitted` + 1: the variance is
    estimated too, stated uncertainties serve as weights only. None where n <= K + 1, or where the
    residuals are rounding.

    Source: C. M. Hurvich and C.-L. Tsai, Biometrika 76, 297 (1989).
    """
    n, k = len(weighted), fitted + 1
    squares = float(np.sum(weighted**2))
    if n - k - 1 <= 0 or not squares > n * ROUNDING**2:
        return None
    return n * math.log(squares / n) + 2 * k + 2 * k * (k + 1) / (n - k - 1)


class Certainty(NamedTuple):
    """How well z is known.

    Attributes:
        errors: standard error of each z; None where it is not determined.
        silent: parameters that act on nothing any more.
        rank: of the Jacobian, silent columns left out.
        promised: share of the cost that the next Gauss–Newton step would remove.
    """

    errors: list[float | None]
    silent: list[bool]
    rank: int
    promised: float

    @property
    def full_rank(self) -> bool:
        return self.rank == self.silent.count(False)

    @property
    def at_minimum(self) -> bool:
        return self.promised <= LEFT_UNDONE


def certainty(weighted: Column, jacobian: Float[np.ndarray, "points p"], variance) -> Certainty:
    """From weighted residuals and their Jacobian in z.

    Args:
        variance: of a weighted residual; None: estimated from them with n - p degrees of freedom.
    """
    seen = _seen(weighted, jacobian)
    known = _variance(weighted, jacobian.shape[1], variance)
    errors: list[float | None] = [None] * len(seen.silent)
    if known is not None and seen.rank == len(seen.size):
        spread = np.sqrt(np.sum((seen.right.T / seen.singular) ** 2, axis=1) * known) / seen.size
        for place, error in zip(np.flatnonzero(~seen.silent), spread, strict=True):
            errors[place] = float(error)
    return Certainty(errors, list(seen.silent), seen.rank, seen.promised(weighted))


def promised(weighted: Column, jacobian: Float[np.ndarray, "points p"]) -> float:
    """Share of the cost that the next Gauss–Newton step would remove; 0 at a minimum."""
    if not np.all(np.isfinite(jacobian)):
        return math.inf
    return _seen(weighted, jacobian).promised(weighted)


class _Seen(NamedTuple):
    """A Jacobian without silent columns, their length `size` taken out, as left · singular · right.

    Of its singular values only those above rounding.
    """

    silent: np.ndarray
    size: np.ndarray
    left: np.ndarray
    singular: np.ndarray
    right: np.ndarray

    @property
    def rank(self) -> int:
        return len(self.singular)

    def promised(self, weighted: Column) -> float:
        # less than rounding of each residual is nothing
        nothing = len(weighted) * (ROUNDING**2 / LEFT_UNDONE)
        return float(np.sum((self.left.T @ weighted) ** 2) / (weighted @ weighted + nothing))


def _seen(weighted: Column, jacobian) -> _Seen:
    size = np.linalg.norm(jacobian, axis=0)
    silent = size <= max(SILENT * float(np.linalg.norm(weighted)), 1e-14)
    size = size[~silent]
    left, singular, right = np.linalg.svd(jacobian[:, ~silent] / size, full_matrices=False)
    kept = singular > RANK_CUT * max(singular, default=1.0)
    return _Seen(silent, size, left[:, kept], singular[kept], right[kept])


def _variance(weighted: Column, fitted: int, stated: float | None) -> float | None:
    left = len(weighted) - fitted
    if stated is not None:
        return stated
    return float(weighted @ weighted) / left if left > 0 else None
