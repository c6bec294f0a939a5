"""Numbers that tell how well a curve follows data, and how well its parameters are known."""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

Column = Float[np.ndarray, "..."]
RANK_CUT = 1e-10  # singular values of the Jacobian with unit columns
SILENT = 1e-4  # a column of the Jacobian so small against the residuals acts on nothing
STEEP = 1e-8  # share of the cost that a step may still promise at a minimum
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
        return self.promised <= STEEP


def certainty(weighted: Column, jacobian: Float[np.ndarray, "points p"], variance) -> Certainty:
    """From weighted residuals and their Jacobian in z.

    Args:
        variance: of a weighted residual; None: estimated from them with n - p degrees of freedom.
    """
    size = np.linalg.norm(jacobian, axis=0)
    squares = float(weighted @ weighted)
    silent = size <= max(SILENT * math.sqrt(squares), 1e-14)
    acting = jacobian[:, ~silent] / size[~silent]
    left, singular, right = np.linalg.svd(acting, full_matrices=False)
    seen = singular > RANK_CUT * max(singular, default=1.0)
    # less than rounding of each residual is nothing
    promised = float(np.sum((left[:, seen].T @ weighted) ** 2))
    promised /= squares + len(weighted) * (ROUNDING**2 / STEEP)
    known = _variance(weighted, jacobian.shape[1], variance)
    errors: list[float | None] = [None] * len(silent)
    if known is not None and np.all(seen):
        spread = np.sqrt(np.sum((right.T / singular) ** 2, axis=1) * known) / size[~silent]
        for place, error in zip(np.flatnonzero(~silent), spread, strict=True):
            errors[place] = float(error)
    return Certainty(errors, list(silent), int(np.sum(seen)), promised)


def _variance(weighted: Column, fitted: int, stated: float | None) -> float | None:
    left = len(weighted) - fitted
    if stated is not None:
        return stated
    return float(weighted @ weighted) / left if left > 0 else None
