"""The lowest minimum of a problem: searches from several starts, and from where other minima may be.

1. The three best of the screened starts are searched (`starts`); where ε jumps at yield, from both sides of the jumps
   around the best end too; where losses below yield may have a minimum at another ψ, from four of these.
2. Where the best end misses the points, or was found by one search alone, more starts are screened and searched:
   8 to the power of the number of parameters, then 16, in wider ranges.

Ends are sorted by cost to six digits; of ends that agree to these, one that converged comes first. Costs of 1 and 1 + 1e-8
are one minimum, and so are the ends, unless they are in two places:

>>> to_digits(1 + 1e-8, COST_DIGITS) == 1.0
True
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float
from scipy import special

import softjax as sj
from calibration.fitting.errors import Errors
from calibration.fitting.jumps import beside_jumps
from calibration.fitting.laws import sigma_of
from calibration.fitting.methods import TINY, factorise
from calibration.fitting.neighbourhoods import binned
from calibration.fitting.pools import LEAST_SPREAD
from calibration.fitting.problem import Problem
from calibration.fitting.search import (
    MOST,
    Ends,
    guided_search,
    search,
)
from calibration.fitting.starts import Places, along_valley, screened
from calibration.fitting.warnings import CONFIDENCE, runs
from calibration.options import FitOptions
from calibration.rounding import to_digits

# Measured on seven fits of Zhou's law with a skewed or narrow likelihood; on six of a law with
# many minima (FEWEST, MORE, CHANGED); on three with a free yield strength (OVER_JUMPS). Lower and
# higher are of -2 ln L, 2x is twice the evaluations.

# of the screened starts that are searched; of nine ordinary fits and these, 1 leaves one 0.004
# higher, 8 gets one 0.01 lower and takes 2.5x
REFINED = 3
# where the first starts miss the points: more per element, those searched, and how wide around the
# first
FEWEST = 8  # requested starts: of fewer no more are made; then all six miss
# the first alone: 4 of 6 miss; half as many: 2; no wider: 6; twice as many per element: one less,
# 1.9x
MORE = ((8, 16, 3.0), (16, 32, 10.0))
MOST_SCREENED = 400_000  # impacts
# of these where each is integrated over time: value and gradient take 7 µs there, 0.05 to 0.08 by the energy
# balance, so that this share takes a few times as long
ODE_SHARE = 0.05
QUICKEST = "levenberg-marquardt"
AS_LOW = 1e-6  # share of a cost within which ends may be one minimum; no effect from 1e-8 to 1e-4
# in z, from which on ends are others to a reader; no effect from 1e-4 to 1 on 8 fits of groups,
# extra scatter and the like
MOVED = 1e-2
COST_DIGITS = 6  # of a cost, to which ends are one minimum; with 3 one is 0.02 higher, 10 as 6
# of searches from around the best end, while one is lower; of a free yield strength 3 are as many
ROUNDS = 30
CLOSER = 2  # rounds in which neighbourhoods are brought to the minimum of all points
# ψ from which a search begins where it may have several minima; without them two are 1.1 and 0.02
# higher and one does not converge, with two of them one is 0.02 higher, with seven none is lower,
# 1.2x
EXPONENTS = (0.4, 1.5, 5.0, 15.0)
# of the loss at yield, in parts of a tenth, that another ψ begins with; no effect from 0.01 to 1
LEAST_LOSS = 0.1
OTHERWISE = 1.5  # factor on ψ to count as another; 1.05 takes 1.2x, with 4 one does not converge
CHANGED = 1e-9  # share of a cost by which another is lower; no effect from 1e-12 to 1e-5
# the same of searches that jumps of the cost stop, which end near these; no effect from 1e-8 to
# 1e-3
OVER_JUMPS = 1e-5


def searched(problem: Problem, z, options: FitOptions, ends: list[Ends] | None):
    """Ends of searches from the best of the starts, the best first.

    Also whether one search alone of many ended so low, and misses the points.
    """
    few, single_search = binned(problem), False
    if ends is None:
        starts = screened(few, z, options.starts, options.seed, REFINED)
        if problem.has_velocity_errors and len(problem.active):
            # far from the points a steep curve would explain them by errors of velocities
            pairs = zip(few.errors, few.variances, strict=True)
            level = weighing(few, [errors.diagonal(s) for errors, s in pairs])
            ends = from_starts(level, starts, QUICKEST)
            around = ends[0].select([0, 0])._replace(z=along_valley(level, ends[0].z))
            starts = np.concatenate([_as_starts(level, end) for end in (*ends, around)])
        if problem.jumps:
            starts = np.unique([z, *starts], axis=0)
        ends = from_starts(few, starts, options.optimiser, options.max_steps)
    if problem.jumps:
        ends = over_jumps(problem, ends, options)
    ends = _with_other_exponents(few, ends, options)
    if options.starts >= FEWEST:
        ends, single_search = _from_more_starts(few, z, ends, options)
    if few is not problem:
        ends = sorted((_of_all(problem, end, options) for end in distinct_minima(ends)), key=_rank)
    return ends, single_search


def over_jumps(problem: Problem, ends: list[Ends], options: FitOptions) -> list[Ends]:
    """These and ends of searches from both sides of the jumps around the best of them, until none is lower."""
    assert problem.affects_yield is not None
    active = problem.active
    for _ in range(ROUNDS):
        places = beside_jumps(problem, ends[0].z[0])
        if not len(places):
            break
        still = np.broadcast_to(problem.affects_yield[active], (len(places), len(active)))
        beside = search(problem, places, fixed=still, limit=options.max_steps)
        more = from_starts(problem, beside.z, QUICKEST, options.max_steps)
        is_lower = more[0].cost[0] < ends[0].cost[0] * (1 - OVER_JUMPS)
        ends = distinct_minima(sorted([*ends, *more], key=_rank), OVER_JUMPS, np.inf)
        if not is_lower:
            break
    return ends


def _with_other_exponents(problem: Problem, ends: list[Ends], options: FitOptions) -> list[Ends]:
    """These and ends of searches from other ψ with the same ε_up, until none is lower.

    The losses below yield may have a minimum where they grow evenly, and one where only the points just
    below yield show them. Of each ψ a search begins where a linear step would get lower.
    """
    for _ in range(ROUNDS):
        places = _other_exponents(problem, ends[0].z[0])
        if not len(places):
            break
        linear = problem.linearise(np.array(places))
        at = factorise(linear.residual, linear.jacobian)
        promising = linear.cost - 0.5 * at.promised < ends[0].cost[0] * (1 - AS_LOW)
        if not np.any(promising & at.finite):
            break
        starts = np.array(places)[promising & at.finite]
        more = from_starts(problem, starts, QUICKEST, options.max_steps)
        is_lower = more[0].cost[0] < ends[0].cost[0] * (1 - AS_LOW)
        ends = distinct_minima(sorted([*ends, *more], key=_rank))
        if not is_lower:
            break
    return ends


def _other_exponents(problem: Problem, z: Float[np.ndarray, " elements"]) -> list[np.ndarray]:
    """Places with another ψ of one data set, or of those that share it, and the same ε_up of each."""
    places: list[np.ndarray] = []
    if problem.laws.model.law_type is not sj.Zhou:
        return places
    transform, theta = problem.transform, problem.transform.physical(z)
    for k in (k for k in problem.active if problem.elements[k].name == "psi"):
        psi, here = problem.elements[k], max(float(theta[k]), TINY)
        of_sigma = [
            j
            for j in problem.active
            if problem.elements[j].name == "sigma" and {*problem.elements[j].sets} & {*psi.sets}
        ]
        for there in EXPONENTS:
            is_another = max(there / here, here / there) > OTHERWISE
            if not (is_another and psi.range[0] < there < psi.range[1]):
                continue
            other, place = np.array(theta), np.array(z)
            other[k] = there
            for j in of_sigma:
                contact = problem.datasets[problem.elements[j].sets[0]].contact
                # σ of a loss of a tenth at yield: of none nothing would lead back
                tenth, now = (np.mean(sigma_of(contact, 0.9, power)) for power in (there, here))
                other[j] = float(tenth * max(theta[j] / now, LEAST_LOSS))
            moved = [k, *of_sigma]
            place[moved] = transform.unconstrained(other)[moved]
            places.append(place)
    return places


def tied(problem: Problem, z, options: FitOptions) -> list[Ends]:
    """The best end with the members of each pool as one: where their spread is 0 no other search may get there."""
    if not problem.pools:
        return []
    pools = tuple(pool._replace(spread=LEAST_SPREAD) for pool in problem.pools)
    tied = replace(problem, pools=pools)
    starts = screened(tied, z, options.starts, options.seed, REFINED)
    for pool in pools:
        members = list(pool.members)
        starts[:, members] = np.mean(starts[:, members], axis=1, keepdims=True)
    return from_starts(tied, starts, QUICKEST, options.max_steps)[:1]


def weighing(problem: Problem, variances) -> Problem:
    """The problem with errors of known variance, of each block, that do not move with the curve."""
    pairs = zip(problem.errors, variances, strict=True)
    errors = tuple(Errors.known(block.velocity, variance) for block, variance in pairs)
    return replace(problem, errors=errors, variances=({},) * len(errors))


def _as_starts(problem: Problem, end: Ends) -> Places:
    """The ends of searches as starts; parameters at an end of their range start again from where they began."""
    z, active = np.array(end.z), problem.active
    z[:, active] = np.where(end.bound_side != 0, end.reference_start[:, active], z[:, active])
    return z


def from_starts(problem: Problem, starts, optimiser: str, limit: int = MOST) -> list[Ends]:
    """Ends of searches from each start, as one batch, the best first."""
    return in_order(guided_search(problem, starts, optimiser, limit=limit))


def in_order(ends: Ends) -> list[Ends]:
    """Searches side by side one by one, the best first."""
    return sorted((ends.select(slice(k, k + 1)) for k in range(len(ends.z))), key=_rank)


def _of_all(problem: Problem, end: Ends, options: FitOptions) -> Ends:
    """Search on with all points from where a search of binned points ended."""
    limit = options.max_steps
    for _ in range(CLOSER):
        few = binned(problem, end.z[0])
        end = search(few, end.z, reference_start=end.reference_start, limit=limit, releases=0)
    return search(
        problem,
        end.z,
        options.optimiser,
        reference_start=end.reference_start,
        limit=limit,
        releases=0,
    )


def _from_more_starts(problem: Problem, z, ends: list[Ends], options: FitOptions):
    """Search from more starts while the best one misses the points; return the best and other minima.

    Also whether the best still misses them, and one search alone has found it.
    """
    p, share = len(problem.active), ODE_SHARE if problem.collided_by.by_time else 1.0
    for k, (per_element, most, wide) in enumerate(MORE):
        agree = len(ends) > 1 and all(_as_low(end, ends[0]) for end in ends)
        if not _misses(problem, ends[0]) or (agree and (k > 0 or p <= 2)):
            break
        room = int(share * MOST_SCREENED / problem.count)
        count = min(per_element ** min(p, 4), room)
        if count < options.starts:
            break
        places = screened(problem, z, count, options.seed + k + 1, most, wide)
        more = from_starts(problem, places, QUICKEST)
        if float(more[0].cost[0]) < float(ends[0].cost[0]) * (1 - CHANGED):
            more[0] = search(
                problem, _as_starts(problem, more[0]), options.optimiser, limit=options.max_steps
            )
        ends = sorted([*ends, *more], key=_rank)
    reached = [end for end in ends if _as_low(end, ends[0])]
    single_search = len(ends) > len(reached) == 1 and _misses(problem, ends[0])
    return distinct_minima(ends), single_search


def distinct_minima(ends: list[Ends], share: float = AS_LOW, moved: float = MOVED) -> list[Ends]:
    """One end of each cost, and of each place: two minima may be as low."""
    minima: list[Ends] = []
    for end in ends:
        if not any(_as_low(end, at, share) and _is_near(end, at, moved) for at in minima):
            minima.append(end)
    return minima[: REFINED + 1]


def _as_low(first: Ends, second: Ends, share: float = AS_LOW) -> bool:
    return abs(first.cost[0] - second.cost[0]) <= share * second.cost[0] + 1e-300


def _is_near(first: Ends, second: Ends, moved: float) -> bool:
    """Whether two ends are one place, but for what ran to an end of its range."""
    if np.any(first.bound_side) or np.any(second.bound_side):
        return True
    return bool(np.max(np.abs(first.z - second.z), initial=0.0) <= moved)


def _misses(problem: Problem, end: Ends) -> bool:
    """Whether noise does not explain how far points are off: by its size, else by runs of one sign."""
    weighted = problem.linearise(end.z, slopes=False).residual[0]
    residual_dof = len(weighted) - len(problem.active)
    if residual_dof < 1:
        return False
    if all(
        errors.is_stated and errors.is_fixed and errors.noise.is_least_squares
        for errors in problem.errors
    ):
        return bool(np.sum(weighted**2) > special.chdtri(residual_dof, 1 - CONFIDENCE))
    of_points = weighted[: problem.count]
    return any(runs(problem.points.velocity[span], of_points[span]) for span in problem.spans)


def _rank(end: Ends) -> tuple[float, bool]:
    """Sort by cost to `COST_DIGITS`; of ends that agree to these, one that converged comes first."""
    return to_digits(float(end.cost[0]), COST_DIGITS), not end.converged[0]
