"""Degrees of freedom of a covariance, after Satterthwaite.

Where variances s_c of the noise are themselves estimates, a covariance C is as uncertain as they are. With
C_c = s_c ∂C/∂s_c, its part that depends on each of them, and R the covariance of their logarithms, a standard
error √C has the quantiles of Student's t with

    ν = 2 C² / Σ_cd C_c C_d R_cd

degrees of freedom. Two independent means, of variances 4 and 1, from 5 and 10 points: R = diag(2/4, 2/9), and their
difference has Welch's ν = (4 + 1)²/(4²/4 + 1²/9):

>>> parts, relative = np.array([[[4.0]], [[1.0]]]), np.diag([2 / 4, 2 / 9])
>>> dof = DegreesOfFreedom(("difference",), parts, relative, ("a", "b"), ("scatter", "scatter"))
>>> dof.satterthwaite(("difference",), np.ones((1, 1)), np.array([5.0])).round(2)
array([6.08])

Source: Satterthwaite, Biometrics Bulletin 2, 110 (1946); Welch, Biometrika 34, 28 (1947).
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy import special

FEWEST = 1.0  # degrees of freedom: with fewer Student's t has no mean
ALL = "all"
NO_PART = 1e-10  # of a variance: a part below is none
MOST_NUMBERS = 50_000  # that a result keeps of one component; beyond, its least degrees of freedom

Matrix = Float[np.ndarray, "p p"]


@dataclass(frozen=True, eq=False)
class DegreesOfFreedom:
    """Degrees of freedom of a component's covariance: its parts that depend on each estimated variance."""

    labels: tuple[str, ...]  # of its parameters
    parts: Float[np.ndarray, "c p p"]  # C_c, (c, p, p)
    relative: Float[np.ndarray, "c c"]  # R, covariance of the logarithms of these variances, (c, c)
    sets: tuple[str, ...]  # the data set and observable that each belongs to
    # what each is of: "scatter", "group", "timing", "scale" or "repeats"; "all" where one stands
    # for all variances of all sets
    names: tuple[str, ...]

    def satterthwaite(
        self,
        labels: Sequence[str],
        slopes: Float[np.ndarray, "n p"],
        variance: Float[np.ndarray, " n"],
        block: str = "",
        added: Mapping[str, Any] | None = None,
    ) -> Float[np.ndarray, " n"]:
        """ν of a variance; infinite where the noise is known.

        Args:
            labels, slopes: of the parameters that it follows from, and in these.
            variance: itself.
            block, added: the data set (and observable), and what its errors add to the variance, by
                their names.
        """
        place = [self.labels.index(label) for label in labels]
        parts_of = self.parts[:, place][:, :, place]
        parts = np.einsum("np,cpq,nq->nc", slopes, parts_of, slopes)
        for name, value in (added or {}).items():
            acting = [
                (one == block and kind == name) or (kind == ALL and name != "stated")
                for one, kind in zip(self.sets, self.names, strict=True)
            ]
            if any(acting):
                parts[:, acting] += np.reshape(value, (-1, 1)) / sum(acting)
        spread = np.einsum("nc,cd,nd->n", parts, self.relative, parts)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            degrees = np.where(spread > 0, 2 * variance**2 / spread, np.inf)
        return np.maximum(np.where(np.isnan(degrees), np.inf, degrees), FEWEST)

    def physical(
        self,
        slope: Float[np.ndarray, " p"],
        covariance_known_noise: Matrix,
        se_inflation: Float[np.ndarray, " p"],
    ) -> "DegreesOfFreedom":
        """Degrees of freedom in physical parameters, with dθ/dz; `covariance_known_noise` is that in z.

        Each part is the same share of the inflated covariance, which a result has.
        """
        both = np.outer(slope * se_inflation, slope * se_inflation)
        if self.parts.size <= MOST_NUMBERS:
            variance = np.diagonal(self.parts, axis1=1, axis2=2)
            acts = variance > NO_PART * np.abs(np.diagonal(covariance_known_noise))
            parts = np.where(acts[:, :, None] & acts[:, None], self.parts, 0.0)
            return replace(self, parts=parts * both)
        least = np.min(
            self.satterthwaite(
                self.labels,
                np.eye(len(covariance_known_noise)),
                np.diagonal(covariance_known_noise),
            )
        )
        kept = {"parts": (covariance_known_noise * both)[None], "relative": np.array([[2 / least]])}
        return replace(self, **kept, sets=("",), names=(ALL,))


def dof_of(
    components: Sequence[DegreesOfFreedom], dataset: str, labels: Iterable[str]
) -> DegreesOfFreedom:
    """Degrees of freedom of the component that contains a data set.

    Nothing of the set may be free, or nothing of its noise estimated; where both is so, any will do.
    """
    requested = set(labels)
    matching = (f for f in components if requested & {*f.labels} or dataset in f.sets)
    return next(matching, components[0])


def quantile(confidence: float, degrees: float | np.ndarray | None):
    """Two-sided: Student's t, or the normal one where the noise is known (None, or infinite)."""
    at = 0.5 * (1 + confidence)
    if degrees is None:
        return float(special.ndtri(at))
    value = np.where(np.isinf(degrees), special.ndtri(at), special.stdtrit(degrees, at))
    return float(value) if value.ndim == 0 else value
