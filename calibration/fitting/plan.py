"""What of the errors of a data set is stated, and what a fit has to find out."""

from dataclasses import dataclass

import numpy as np

from calibration.data import RestitutionData


@dataclass(frozen=True)
class ErrorPlan:
    """Of one data set.

    Attributes:
        unknown: variances to be estimated: "scale", "timing", "scatter", "group".
        shares: whether points share errors: those of a group, or of a bounce train.
        moves: whether the true velocities are estimated: where they have errors of their own.
        bare: whether no uncertainty is stated at all.
        separate: whether each stated uncertainty comes from a few repeats of its own, and is no
            measure of how much its point should weigh.
    """

    unknown: tuple[str, ...]
    shares: bool
    moves: bool
    bare: bool
    separate: bool

    @property
    def stated(self) -> bool:
        """Whether the uncertainties are stated and used as they are."""
        return not {"scatter", "timing", "scale"} & set(self.unknown)

    @property
    def plain(self) -> bool:
        """Whether the scatter of single points is all that there is."""
        return self.bare and self.unknown == ("scatter",) and not (self.shares or self.moves)


def plan_of(data: RestitutionData, extra_scatter: bool, scale: bool) -> ErrorPlan:
    """What the data tell, and what was asked for.

    Args:
        extra_scatter: scatter beside stated uncertainties.
        scale: stated uncertainties are right up to a factor.
    """
    stated = data.uncertainty is not None
    unknown = []
    if stated and scale:
        unknown.append("scale")
    if data.errors.size_is_unknown:
        unknown.append("timing")
    if not stated or extra_scatter:
        unknown.append("scatter")
    grouped = has_groups(data)
    if grouped:
        unknown.append("group")
    shares = grouped or data.errors.shares
    moves = data.velocity_uncertainty is not None and not data.errors.shares
    separate = stated and np.ndim(data.degrees) > 0
    return ErrorPlan(tuple(unknown), shares, moves, not stated, separate)


def has_groups(data: RestitutionData) -> bool:
    """Whether an offset of each group can be told: several groups, some of several points."""
    return 1 < len(data.groups) < len(data)
