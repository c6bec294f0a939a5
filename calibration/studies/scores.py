"""Scores of contact laws on one data set: expected log predictive densities, their differences, stacking weights.

    elpd = Σ_i ln p(ε_i | all data but point i)        expected log predictive density

Differences between laws come with their standard error over the points; two laws are a tie where the
difference is below twice that error and below 4: where few points make the difference, their error is as
large and says nothing. Stacking weights are those with which a mixture of the laws predicts best.

Source: Vehtari, Gelman and Gabry, Stat. Comput. 27, 1413 (2017); stacking: Yao, Vehtari, Simpson
and Gelman, Bayesian Anal. 13, 917 (2018); small differences: Sivula, Magnusson, Matamoros and Vehtari,
arXiv:2008.10296 (2020).
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from calibration.fitting.estimates import FitEstimates
from calibration.fitting.left_out import LeaveOneOut
from calibration.fitting.warnings import FitWarning

TIE = 2.0  # standard errors of a difference
NEAR = 4.0  # elpd
ROUNDING = 1e-6  # of a difference between laws with the same curve
SAME_CURVE = 1e-6  # of ε at every point
STACKING_ROUNDS = 5000
SETTLED = 1e-10  # of a weight, between two rounds


class Difference(NamedTuple):
    """A difference of elpd, and its standard error."""

    value: float
    standard_error: float

    @property
    def is_tie(self) -> bool:
        """Whether it is below `NEAR`, or below `TIE` standard errors."""
        return abs(self.value) < max(TIE * self.standard_error + ROUNDING, NEAR)


@dataclass(frozen=True, eq=False)
class Entry:
    """One law of a comparison with its fit and its score.

    Attributes:
        key: its name in files: that of `LAWS`, "thornton-fixed", or its class's or function's.
        label: what tables and pictures call it.
        remark: what a reader should know of it.
        result: its fit.
        leave_one_out: each point predicted by the fit without it.
        delta_elpd: elpd less that of the best law; None for a law that follows the data exactly,
            which has no score.
        weight: in the mixture that predicts best; None as well.
        same_as: the label of a law before it that has the same curve, or None.
    """

    key: str
    label: str
    remark: str
    result: FitEstimates
    leave_one_out: LeaveOneOut
    delta_elpd: Difference | None = None
    weight: float | None = None
    same_as: str | None = None

    @property
    def converged(self) -> bool:
        """Whether the fit, and every fit without a point, ended at a minimum."""
        return self.result.converged and self.leave_one_out.converged

    @property
    def is_exact(self) -> bool:
        """Whether its residuals are rounding: data without noise, made by this very law."""
        return self.result.log_likelihood is None

    @property
    def fitted(self) -> int:
        """Number of fitted parameters, unknown variances among them."""
        errors = [
            e for fit in self.result.searched("a comparison") for e in fit.final.problem.errors
        ]
        return len(self.result.covariance_names) + sum(len(e.unknown) for e in errors)

    @property
    def warnings(self) -> tuple[FitWarning, ...]:
        """Warnings of the fit, and of the fits without a point."""
        why = FitWarning("not-converged", "not every fit without a point ended at a minimum")
        return (*self.result.warnings, *([] if self.leave_one_out.converged else [why]))

    def ahead_of(self, other: "Entry") -> tuple[Difference, Float[np.ndarray, " n"]]:
        """elpd less that of another law, in all and of each point."""
        first, second = self.leave_one_out, other.leave_one_out
        differences = first.log_density - second.log_density
        return Difference(float(np.sum(differences)), first.error_of_sum(differences)), differences


def ranked(entries: list[Entry]) -> tuple[Entry, ...]:
    """Entries sorted by falling elpd, with difference to the best and weight; exact ones first."""
    exact = tuple(entry for entry in entries if entry.is_exact)
    others: list[Entry] = []
    for entry in (entry for entry in entries if not entry.is_exact):
        first = (other for other in others if other.same_as is None)
        gaps = {o.label: entry.leave_one_out.predicted - o.leave_one_out.predicted for o in first}
        equals = (label for label, gap in gaps.items() if np.max(np.abs(gap)) < SAME_CURVE)
        others.append(replace(entry, same_as=next(equals, None)))
    if not others:
        return exact
    scores = {entry.label: entry.leave_one_out.elpd for entry in others}
    # laws of one curve differ by rounding, and stay in the order in which they were requested
    order = sorted(others, key=lambda entry: -scores[entry.same_as or entry.label])
    weights = stacking_weights(np.stack([entry.leave_one_out.log_density for entry in order]))
    pairs = zip(order, weights.tolist(), strict=True)
    return exact + tuple(
        replace(entry, delta_elpd=entry.ahead_of(order[0])[0], weight=w) for entry, w in pairs
    )


def stacking_weights(log_density: Float[np.ndarray, "laws n"]) -> Float[np.ndarray, " laws"]:
    """w >= 0, Σw = 1, that make Σ_i ln Σ_k w_k p_k(ε_i) largest, by expectation–maximisation.

    Laws with the same curve share its weight equally.
    """
    ratio = np.exp(log_density - np.max(log_density, axis=0))
    weights = np.full(len(log_density), 1 / len(log_density))
    for _ in range(STACKING_ROUNDS):
        shares = weights[:, None] * ratio
        moved = np.mean(shares / np.sum(shares, axis=0), axis=1)
        if np.max(np.abs(moved - weights)) < SETTLED:
            return moved
        weights = moved
    return weights
