"""One candidate against one data set: fitted, refitted without each point, scored, doubted."""

from dataclasses import dataclass, replace

import numpy as np

from calibration.compare import scores
from calibration.compare.candidates import Candidate
from calibration.compare.curves import Column, Observed, curve_of, expand
from calibration.compare.doubts import doubts_of, search_doubts
from calibration.compare.refits import (
    Problem,
    Refits,
    from_starts,
    starts_of,
    without_each,
)
from calibration.data.measurements import RestitutionData
from calibration.doubt import Doubt


@dataclass(frozen=True)
class Value:
    """One number of a law; `standard_error` is None where there is none."""

    value: float | None
    standard_error: float | None = None
    unit: str = ""


@dataclass(frozen=True)
class End:
    """Where the searches of a candidate ended.

    Attributes:
        z: the best.
        units: of its parameters.
        found: where all starts ended.
        refitted: the fits without each point.
    """

    z: np.ndarray
    units: np.ndarray
    found: Refits | None = None
    refitted: Refits | None = None


@dataclass(frozen=True)
class Entry:
    """What became of one candidate.

    Attributes:
        parameters: {name: Value} in physical units.
        fitted: how many of them were fitted; for a law with the curve of another, the other's.
        z: where the search ended; None for the constant ε, which needs none.
        residual: fitted less measured ε at each point, (n,).
        residual_without: the same with each point predicted by the fit without it, (n,).
        z_errors: standard errors of z.
        rms, rms_leave_one_out: of these [-]; the points weigh alike.
        aicc: see `scores.aicc`; None where it is not defined.
        converged: whether the fit, and every fit without a point, ended at a minimum.
    """

    candidate: Candidate
    parameters: dict[str, Value]
    fitted: int
    z: np.ndarray | None
    residual: Column
    residual_without: Column
    aicc: float | None
    converged: bool
    doubts: tuple[Doubt, ...] = ()
    z_errors: tuple[float | None, ...] = ()

    @property
    def rms(self) -> float:
        return scores.root_mean_square(self.residual)

    @property
    def rms_leave_one_out(self) -> float:
        return scores.root_mean_square(self.residual_without)

    def curve(self, data: RestitutionData, velocity: np.ndarray) -> np.ndarray:
        """ε over velocities for the data's bodies, NaN where the law has no value."""
        if self.z is None:
            return np.full(len(velocity), self.parameters["restitution"].value)
        return curve_of(self.candidate, self.z, data, velocity)


def constant_entry(candidate: Candidate, data: RestitutionData, observed: Observed) -> Entry:
    """The constant ε: the (weighted) mean, at most 1, in closed form."""
    measured, weight = observed.restitution, observed.weight
    squared = weight**2
    mean = min(float(np.average(measured, weights=squared)), 1.0)
    others = (np.sum(squared * measured) - squared * measured) / (np.sum(squared) - squared)
    residual = mean - measured
    known = scores.certainty(weight * residual, weight[:, None], observed.variance)
    entry = Entry(
        candidate,
        {"restitution": Value(mean, known.errors[0])},
        1,
        None,
        residual,
        np.minimum(others, 1.0) - measured,
        scores.aicc(weight * residual, 1),
        True,
    )
    return replace(
        entry, doubts=tuple(doubts_of(entry, data, observed, np.zeros(observed.count, int)))
    )


def alike(candidate: Candidate, constant: Entry) -> Entry:
    """A law with the same curve, told in its own inputs."""
    assert candidate.own is not None
    mean = constant.parameters["restitution"].value
    own = {name: Value(value) for name, value in candidate.own(mean).items()}
    return replace(constant, candidate=candidate, parameters=own)


def fitted_entry(candidate: Candidate, data: RestitutionData, observed: Observed) -> Entry:
    """A candidate fitted from several starts, and without each point from there."""
    units = candidate.units(data)
    if not candidate.parameters:
        return _entry(candidate, data, observed, End(np.zeros(0), units))
    problem = Problem(candidate, observed, units)
    found = from_starts(problem, starts_of(candidate, data))
    place = best_of(found.cost, found.converged)
    z = found.z[place]
    return _entry(candidate, data, observed, End(z, units, found, without_each(problem, z)))


def best_of(costs: np.ndarray, converged: np.ndarray) -> int:
    """The lowest cost; among those as low, one that converged."""
    low = costs <= np.min(costs) * (1 + 1e-6)
    return int(np.flatnonzero(low & converged if np.any(low & converged) else low)[0])


def _entry(candidate: Candidate, data, observed: Observed, end: End) -> Entry:
    weight, measured = observed.weight, observed.restitution
    at = expand(candidate, end.z, end.units, observed.points)
    value, slope, status = at.first(observed.count)
    residual = value - measured
    known = scores.certainty(weight * residual, weight[:, None] * slope, observed.variance)
    entry = Entry(
        candidate,
        _values(candidate, end, known),
        len(candidate.parameters),
        end.z,
        residual,
        residual if end.refitted is None else _predicted(candidate, observed, end) - measured,
        scores.aicc(weight * residual, len(candidate.parameters)),
        known.at_minimum and (end.refitted is None or bool(np.all(end.refitted.converged))),
        z_errors=tuple(known.errors),
    )
    own = search_doubts(entry, end, known, observed)
    return replace(entry, doubts=(*own, *doubts_of(entry, data, observed, status)))


def _predicted(candidate, observed: Observed, end: End) -> np.ndarray:
    """ε at each point by the fit without it."""
    assert end.refitted is not None
    z, n = end.refitted.z, observed.count
    more = len(observed.points.velocity) - n
    z = np.concatenate([z, np.tile(z[:1], (more, 1))])
    return expand(candidate, z, end.units, observed.points).value[:n]


def _values(candidate: Candidate, end: End, known: scores.Certainty) -> dict[str, Value]:
    values = {}
    theta = candidate.physical(end.z, end.units)
    for free, one, error in zip(candidate.parameters, theta, known.errors, strict=True):
        own = None if error is None else abs(free.slope(float(one))) * error
        values[free.name] = Value(float(one), own, free.unit)
    return values
