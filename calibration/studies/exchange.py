"""The search for a design: shots exchanged over a grid of velocities, one at a time.

What an impact adds to the estimating equations depends on its velocity alone, so it is tabulated
over a grid once, and any design's covariance is a sum of table rows:

    C = A⁻¹ (M) A⁻ᵀ,    A = A₀ + Σ_i A(v_i),    M = M₀ + Σ_i G(v_i) G(v_i)ᵀ

Several laws, or sets of parameters, stand side by side; the criterion's logarithm is averaged.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

ALMOST_NOTHING = 1e-6  # prior information on each ln θ: known to a factor e^1000 beforehand
SHARPNESS = (np.inf, 1e3, 100.0, 30.0, 10.0, 3.0)  # of the weights among nearly equal directions
MOVES = 500  # of a design's weights
BETTER = 1e-10  # least decrease of a log criterion that is worth an exchange
CRITERIA = ("c", "D", "A", "E", "I")

Places = Int[np.ndarray, "shots"]


class Table(NamedTuple):
    """What a shot at each of k velocities adds to the estimating equations, in relative changes of θ.

    Attributes:
        slope, score: to A, (k, p, p), and G, (k, p), so that it adds G Gᵀ to the middle matrix.
        slope_before, middle_before: what measured impacts and priors make of A and of M, (p, p).
        curve: slopes of ε itself, (k, p).

    Of several laws side by side all have one more axis, the first.
    """

    slope: Float[np.ndarray, "*laws k p p"]
    score: Float[np.ndarray, "*laws k p"]
    slope_before: Float[np.ndarray, "*laws p p"]
    middle_before: Float[np.ndarray, "*laws p p"]
    curve: Float[np.ndarray, "*laws k p"]

    def sums(self, shots: Places):
        """A and M of a design."""
        chosen = self.score[:, shots]
        middle = self.middle_before + np.swapaxes(chosen, 1, 2) @ chosen
        return self.slope_before + np.sum(self.slope[:, shots], axis=1), middle

    def covariance(self, shots: Places) -> Float[np.ndarray, "laws p p"]:
        """Of ln θ."""
        return covariance(*self.sums(shots))


def covariance(slope: np.ndarray, middle: np.ndarray) -> np.ndarray:
    """A⁻¹ M A⁻ᵀ, kept finite by next to no prior information where the data tell nothing."""
    little = ALMOST_NOTHING * np.eye(slope.shape[-1])
    inverse = np.linalg.inv(slope + little)
    return inverse @ (middle + little) @ np.swapaxes(inverse, -1, -2)


@dataclass(frozen=True, eq=False)
class Criterion:
    """What is made small: the logarithm of a variance.

    Attributes:
        name: c, A and I are a mean variance tr(L C), D the geometric mean of the variances with
            correlations counted, E the largest variance of any direction.
        weight: L of c, A and I, (laws, p, p).
        blocks: parameters of each stage, whose determinants are taken one by one by D.
    """

    name: str
    weight: Float[np.ndarray, "laws p p"]
    blocks: Sequence[np.ndarray]

    def value(self, covariance: Float[np.ndarray, "laws ... p p"]) -> Float[np.ndarray, "..."]:
        """Its logarithm, averaged over the laws."""
        if self.name == "D":
            parts = [np.linalg.slogdet(covariance[..., b[:, None], b])[1] for b in self.blocks]
            return np.mean(sum(parts) / covariance.shape[-1], axis=0)
        if self.name == "E":
            return np.mean(np.log(np.linalg.eigvalsh(covariance)[..., -1]), axis=0)
        return np.mean(np.log(np.einsum("lij,l...ij->l...", self.weight, covariance)), axis=0)

    def least(self, table: Table, count: int) -> float:
        """A value that no design of `count` shots at the table's velocities is below.

        With W = C L C / tr(L C) (D: C/p, E: weights on the worst known directions), 1/tr(L C)
        and its like are concave in M. So whatever the weights w of a design without whole numbers,
        M = M₀ + n Σ w_k G_k G_kᵀ, no design is better than this one by more than the factor
        max_k tr(W (M₀ + n G_k G_kᵀ)); the weights are moved to where that is nearly one.

        Source: Kiefer and Wolfowitz, Can. J. Math. 12, 363 (1960); Pukelsheim, Optimal Design of
        Experiments (2006), chapter 5.
        """
        before = table.middle_before + ALMOST_NOTHING * np.eye(table.score.shape[-1])
        places = table.score.shape[1]
        share = np.full(places, 1 / places)
        least = -np.inf
        for _ in range(MOVES):
            scaled = table.score * share[:, None]
            there = np.linalg.inv(before + count * np.swapaxes(scaled, 1, 2) @ table.score)
            level = float(self.value(there))
            bounds = []
            for weight in self._gradients(there):
                added = np.einsum("lki,lij,lkj->lk", table.score, weight, table.score)
                first = np.einsum("lij,lij->l", weight, before)
                bounds.append(np.mean(first[:, None] + count * added, axis=0))
            factor = min(bounds, key=np.max)
            least = max(least, level - float(np.log(np.max(factor))))
            share = share * (factor if self.name == "D" else np.sqrt(factor))
            share = share / np.sum(share)
        return least

    def _gradients(self, there: np.ndarray) -> list[np.ndarray]:
        """W of each law; several valid ones for E."""
        if self.name == "D":
            return [there / there.shape[-1]]
        if self.name == "E":
            size, direction = np.linalg.eigh(there)
            worst = size[:, -1:]
            found = []
            for sharp in SHARPNESS:
                share = np.where(size == worst, 1.0, (size / worst) ** sharp)
                share = share / np.sum(share, axis=1, keepdims=True)
                scaled = direction * (share * worst)[:, None, :]
                found.append(scaled @ np.swapaxes(direction, 1, 2))
            return found
        level = np.einsum("lij,lij->l", self.weight, there)
        return [there @ self.weight @ there / level[:, None, None]]


def exchanged(table: Table, criterion: Criterion, shots: Places) -> tuple[Places, float]:
    """The design after each shot has been moved to its best place until none moves any more."""
    shots = np.array(shots)
    gram = table.score[..., :, None] * table.score[..., None, :]
    best = float(criterion.value(table.covariance(shots)))
    while True:
        before = best
        for i in range(len(shots)):
            slope, middle = table.sums(np.delete(shots, i))
            every = covariance(slope[:, None] + table.slope, middle[:, None] + gram)
            values = criterion.value(every)
            k = int(np.argmin(values))
            if values[k] < best - BETTER:
                shots[i], best = k, float(values[k])
        if best >= before - BETTER:
            return np.sort(shots), best
