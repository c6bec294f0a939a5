"""A covariance of points that share errors with their neighbours: a narrow band, O(n) of all."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from calibration.errors import DataError

WIDTH = 2  # how far apart points are that share an error: T_n+2 is a time of points n, n+1 and n+2

Order = Int[np.ndarray, " n"]
Factors = Float[np.ndarray, "n k"]


@dataclass(frozen=True, eq=False)
class Covariance:
    """A symmetric n × n matrix C that is banded once its points are put in order.

    Attributes:
        order: (n,), the points in the order of the band (by their first input error).
        bands: (3, n), `bands[d, i]` = C[order[i], order[i + d]], 0 at the end of rows 1 and 2
            (SciPy's lower form).
    """

    order: Order
    bands: Float[np.ndarray, "3 n"]

    @classmethod
    def of(cls, index: Int[np.ndarray, "n k"], factors: Factors, variance) -> "Covariance":
        """C_ij = Σ_k f_ik f_jk over the errors of `index` that both have, + variance_i on the diagonal."""
        order = band_order(index)
        index, factors = index[order], factors[order]
        bands = np.zeros((1 + WIDTH, len(order)))
        bands[0] = np.sum(factors**2, axis=1) + variance[order]
        for distance in range(1, 1 + WIDTH):
            both = _shared(index, distance)
            products = factors[:-distance, :, None] * factors[distance:, None, :]
            count = max(len(order) - distance, 0)
            bands[distance, :count] = np.sum(np.where(both, products, 0.0), axis=(1, 2))
        return cls(order, bands)

    @property
    def diagonal(self) -> Float[np.ndarray, " n"]:
        """The variances, in the order of the points."""
        diagonal = np.empty(len(self.order))
        diagonal[self.order] = self.bands[0]
        return diagonal

    def dense(self) -> Float[np.ndarray, "n n"]:
        """The full matrix, in the order of the points; for few points."""
        matrix = np.diag(self.diagonal)
        for distance in range(1, 1 + WIDTH):
            one, other = self.order[:-distance], self.order[distance:]
            matrix[one, other] = matrix[other, one] = self.bands[distance, :-distance]
        return matrix

    def whiten(self, values: np.ndarray) -> np.ndarray:
        """L⁻¹ x with C = L Lᵀ, for x of shape (n,) or (n, p): independent, of variance 1.

        Rows of the result are in the order of the band. Σ whiten(r)² = rᵀ C⁻¹ r.

        Raises:
            DataError: where C is not positive definite.
        """
        from scipy.linalg import lapack

        columns = np.asarray(values, float)[self.order].reshape(len(self.order), -1)
        solved, info = lapack.dtbtrs(self._cholesky, columns, uplo="L")
        if info:
            raise _not_definite()
        return solved.reshape(np.shape(values))

    @property
    def log_determinant(self) -> float:
        """ln det C."""
        return float(2 * np.sum(np.log(self._cholesky[0])))

    @cached_property
    def _cholesky(self) -> Float[np.ndarray, "3 n"]:
        from scipy.linalg import LinAlgError, cholesky_banded

        try:
            return cholesky_banded(self.bands, lower=True)
        except (LinAlgError, ValueError):  # ValueError: what is not finite
            raise _not_definite() from None


def band_order(index: Int[np.ndarray, "n k"]) -> Order:
    """The points sorted by their first input error; those without any stand last.

    Raises:
        DataError: for an error that enters points further apart than `WIDTH` in that order.
    """
    count = int(np.max(index, initial=-1)) + 1
    order = np.argsort(np.min(np.where(index < 0, count, index), axis=1), kind="stable")
    place = np.broadcast_to(np.arange(len(order))[:, None], index.shape)
    used = index[order] >= 0
    errors, places = index[order][used], place[used]
    low, high = np.full(count, len(order)), np.full(count, -1)
    np.minimum.at(low, errors, places)
    np.maximum.at(high, errors, places)
    if np.any(high - low > WIDTH):
        accepted = f"of {1 + WIDTH} points that follow each other at most"
        raise DataError("index", f"an error of points {np.max(high - low)} apart", accepted)
    return order


def _shared(index: Int[np.ndarray, "n k"], distance: int) -> np.ndarray:
    """Equality of the errors of each point and of the point `distance` rows later, (n - d, k, k)."""
    one, other = index[:-distance, :, None], index[distance:, None, :]
    return (one == other) & (one >= 0)


def _not_definite() -> DataError:
    value = "singular: a point has only errors that it shares with others"
    return DataError("covariance", value, "positive definite")
