"""What makes an entry of the comparison doubtful, in the words of the fit's own doubts."""

from typing import TYPE_CHECKING

import numpy as np

from calibration import doubt
from calibration.compare.candidates import REACH
from calibration.compare.curves import Observed
from calibration.compare.refits import Problem
from calibration.compare.scores import ROUNDING, Certainty
from calibration.data.measurements import RestitutionData
from calibration.doubt import Doubt
from calibration.minima import MOVED, rises_between

if TYPE_CHECKING:
    from calibration.compare.entries import End, Entry


def search_doubts(
    entry: "Entry", end: "End", known: Certainty, observed: Observed
) -> tuple[Doubt, ...]:
    """Of the searches: where they ended, and what the data say of the parameters."""
    if end.found is None:
        return ()
    doubts = [*_ends(end, known), *_silent(entry, known)]
    if not known.full_rank:
        cause = f"{known.rank} of {len(known.errors)} parameters show in these data"
        doubts.append(Doubt("rank-deficient", cause))
        return tuple(doubts)  # a valley without an end has no second minimum
    return (*doubts, *_other_minima(entry, end, observed))


def doubts_of(entry: "Entry", data: RestitutionData, observed: Observed, status) -> list[Doubt]:
    """Of the curve: its residuals, and the law's own flags at the points."""
    left = observed.count - entry.fitted
    found = [doubt.runs(data.velocity, entry.residual, None)]
    if observed.variance is not None and left > 0:
        weighted = observed.weight * entry.residual
        reduced = float(weighted @ weighted) / observed.variance / left
        noise = float(np.sqrt(observed.variance))
        found.append(doubt.misfit(entry.rms, noise, reduced, left, None))
    return [*(one for one in found if one), *doubt.statuses(status, data.velocity, None)]


def separation(entry: "Entry") -> Doubt | None:
    """Whether σ and ψ, the last two of z, are known only together."""
    errors = [np.inf if error is None else error for error in entry.z_errors[-2:]]
    if max(errors) <= doubt.SEPARATE:
        return None
    return Doubt("sigma-psi-not-separate", f"the standard error of ln sigma is {errors[0]:.2g}")


def _ends(end: "End", known: Certainty) -> list[Doubt]:
    doubts = []
    if not known.at_minimum:
        doubts.append(Doubt("not-converged", "no start led to a minimum"))
    failed = int(np.sum(~end.refitted.converged))
    if failed:
        cause = f"{failed} of {len(end.refitted.converged)} fits without a point"
        doubts.append(Doubt("not-converged", cause))
    return doubts


def _silent(entry: "Entry", known: Certainty) -> list[Doubt]:
    names = [name for name, one in zip(entry.parameters, known.silent, strict=True) if one]
    values = (f"{name} = {entry.parameters[name].value:.4g}" for name in names)
    return [Doubt("at-bound", f"{value} is as good as its limit") for value in values]


def _other_minima(entry: "Entry", end: "End", observed: Observed) -> list[Doubt]:
    """Minima that other starts led to, nearly as low at other parameters."""
    problem, best = Problem(entry.candidate, observed, end.units), _within(end.z)
    lowest = problem.cost(best)
    if lowest < observed.count * ROUNDING**2:
        return []
    left = max(observed.count - entry.fitted, 1)
    rise = (end.found.cost - lowest) / (observed.variance or lowest / left)
    moved = np.max(np.abs(_within(end.found.z) - best), axis=1) > MOVED
    near = end.found.converged & moved & (np.abs(rise) < doubt.SEVERAL_DELTA)
    for place in np.flatnonzero(near):
        other = _within(end.found.z[place])
        if rises_between(problem.cost, best, other):
            return [_other_minimum(entry, entry.candidate.physical(other, end.units), rise[place])]
    return []


def _other_minimum(entry: "Entry", theta, rise: float) -> Doubt:
    pairs = zip(entry.parameters, theta, strict=True)
    values = ", ".join(f"{name} = {float(one):.3g}" for name, one in pairs)
    return Doubt("several-minima", f"also at {values}, chi squared {rise:.2g} higher")


def _within(z):
    return np.clip(z, -REACH, REACH)
