"""Whether searches arrived, and at one minimum.

Another end of a search counts as another minimum where a value is outside its interval."""

from collections.abc import Mapping

import numpy as np

from calibration.errors import listed
from calibration.fitting.components import ComponentFit
from calibration.fitting.material import Estimate
from calibration.fitting.minima import MOVED
from calibration.fitting.profiles import weighted_deviation
from calibration.fitting.search import Ends
from calibration.fitting.stages import StageFit
from calibration.fitting.warnings import FitWarning, Found, raised

MOST_NAMED = 3  # data sets
AS_GOOD = 1e-3  # difference of -2 ln L that is none to a reader
SEVERAL_DELTA = 4.0  # Δχ² below which another minimum is nearly as good
LEAST_NOISE = 1e-10  # of ε: less is no noise


def of_stage(
    fit: ComponentFit, stage: StageFit, estimates: Mapping[int, Estimate]
) -> list[FitWarning]:
    """Warnings about the searches of a stage."""
    names = [data.name for data in stage.problem.datasets]
    several = listed(names) if len(names) <= MOST_NAMED else f"{len(names)} data sets"
    what = stage.report.stage + (f" of {several}" if len(names) > 1 else "")
    found = raised(fit.owner(range(len(names))), _of_search(stage, what))
    for rise, values in _other_minima(fit, stage, estimates):
        there, here = (
            ", ".join(f"{fit.component.elements[k].label} = {at[k]:.4g}" for k in values)
            for at in (values, fit.theta)
        )
        far = f"is {abs(rise):.2g} {'higher' if rise >= 0 else 'lower'}"
        far = far if abs(rise) > AS_GOOD else "is the same"
        cause = f"another minimum, where -2 ln L {far}: {there}; intervals are of {here} alone"
        sets = sorted({s for k in values for s in fit.component.elements[k].sets})
        found.append(FitWarning("several-minima", cause, fit.owner(sets)))
    return found


def _of_search(stage: StageFit, what: str) -> Found:
    if not stage.ends.converged[0]:
        yield "not-converged", f"{what}: {stage.report.reason}"
    if stage.single_search:
        yield "several-minima", f"{what}: one search alone ended so low, and it misses the points"


def _other_minima(fit: ComponentFit, stage: StageFit, estimates: Mapping[int, Estimate]):
    """Ends of other searches nearly as good, with a value outside its interval: how much higher -2 ln L is, and values.

    An end where a parameter grows without bound is none: a valley without an end has no second minimum.
    """
    problem = stage.problem
    bounds = problem.transform.part(problem.active)

    def runs_away(end: Ends) -> bool:
        bound_side = end.bound_side[0]
        return bool(np.any((bound_side != 0) & ~np.isfinite(bounds.bound_beyond(bound_side))))

    def is_outside(k: int, value: float) -> bool:
        low, high = estimates[k].low, estimates[k].high
        return (low is not None and value < low) or (high is not None and value > high)

    ends = [end for end in stage.others if end.converged[0] and not runs_away(end)]
    if not ends or runs_away(stage.ends):
        return
    cost = problem.linearise(np.stack([stage.z, *(end.z[0] for end in ends)]), slopes=False).cost
    spread = weighted_deviation(fit, problem, LEAST_NOISE)
    rises = 2 * (cost[1:] - cost[0]) / np.mean(spread**2)
    for end, rise in zip(ends, rises, strict=True):
        theta = problem.transform.physical(end.z[0])
        differs = fit.uncertainty.known & (np.abs(end.z[0] - stage.z) > MOVED)
        moved = {int(k): float(theta[k]) for k in problem.active if differs[k]}
        if rise < SEVERAL_DELTA and any(is_outside(k, value) for k, value in moved.items()):
            yield float(rise), moved
