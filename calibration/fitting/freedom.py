"""How well a fit's covariance is known, as a result keeps it: for quantiles of what follows from it."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from calibration.fitting.uncertainty import Parts, satterthwaite

ALL = "all"
ROUNDING = 1e-10  # of a variance: a part below is none
MOST = 50_000  # numbers that a result keeps of one component; beyond, its least degrees of freedom


@dataclass(frozen=True, eq=False)
class Freedom:
    """The parts of a component's covariance, in physical units.

    Attributes:
        labels: of its parameters.
        parts: (c, p, p), one for each variance that is an estimate.
        relative: covariance of the logarithms of these variances, (c, c).
        sets: names of the data sets that they belong to.
        names: what each is of: "scatter", "group", "timing", "scale" or "repeats"; "all" where one
            stands for all variances of all sets.
    """

    labels: tuple[str, ...]
    parts: Float[np.ndarray, "c p p"]
    relative: Float[np.ndarray, "c c"]
    sets: tuple[str, ...]
    names: tuple[str, ...]

    @classmethod
    def of(
        cls, parts: Parts, slope, labels: tuple[str, ...], datasets: tuple[str, ...]
    ) -> "Freedom":
        """Of a fit's parts in z, with dθ/dz."""
        both = np.outer(slope, slope)
        sets = tuple(datasets[g] for g in parts.sets)
        if parts.parts[0].size <= MOST:
            own = np.diagonal(parts.parts[0], axis1=1, axis2=2)
            acts = own > ROUNDING * np.abs(np.diagonal(parts.whole[0]))
            found = np.where(acts[:, :, None] & acts[:, None], parts.parts[0], 0.0)
            return cls(labels, found * both, parts.relative[0], sets, parts.names)
        least = np.min(parts.along(np.eye(len(labels))))
        whole = (parts.whole[0] * both)[None]
        return cls(labels, whole, np.array([[2 / least]]), ("",), (ALL,))

    def degrees(
        self,
        labels: tuple[str, ...],
        slopes: Float[np.ndarray, "n p"],
        variance: Float[np.ndarray, "n"],
        material: str,
        added: Mapping[str, Any] | None = None,
    ) -> Float[np.ndarray, "n"]:
        """Degrees of freedom of a variance, infinite where the noise is known.

        Args:
            labels, slopes: of the parameters that it follows from, and in these.
            variance: itself.
            material, added: the data set, and what its errors add to the variance, by their names.
        """
        if not len(self.names):
            return np.full(len(variance), np.inf)
        place = [self.labels.index(label) for label in labels]
        parts = np.einsum("np,cpq,nq->nc", slopes, self.parts[:, place][:, :, place], slopes)
        for name, value in (added or {}).items():
            own = [
                (m == material and k == name) or (k == ALL and name != "stated")
                for m, k in zip(self.sets, self.names, strict=True)
            ]
            if any(own):
                parts[:, own] += np.reshape(value, (-1, 1)) / sum(own)
        return satterthwaite(variance[None], parts[None], self.relative[None])[0]

    @classmethod
    def from_dict(cls, table: dict[str, Any]) -> "Freedom":
        size, count = len(table["labels"]), len(table["names"])
        return cls(
            tuple(table["labels"]),
            np.array(table["parts"], float).reshape(count, size, size),
            np.array(table["relative"], float).reshape(count, count),
            tuple(table["sets"]),
            tuple(table["names"]),
        )


def freedom_of(freedoms: Sequence[Freedom], dataset: str, labels: Iterable[str]) -> Freedom:
    """That of the component which a data set belongs to.

    Nothing of the set may be free, or nothing of its noise estimated; where both is so, any will do.
    """
    own = set(labels)
    told = (one for one in freedoms if own & set(one.labels) or dataset in one.sets)
    return next(told, freedoms[0])
