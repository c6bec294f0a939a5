"""The stages of one component: starts, searches, and the variances of where they end."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy import special

import softjax as sj
from calibration.fitting.errors import Errors
from calibration.fitting.jumps import beside_jumps
from calibration.fitting.laws import OF_CONTACT, SPRINGS, sigma_of
from calibration.fitting.levels import Offsets, offsets_of
from calibration.fitting.methods import TINY, QRFactors, factorise
from calibration.fitting.neighbourhoods import binned
from calibration.fitting.pools import LEAST_SPREAD, estimate_of_pool
from calibration.fitting.problem import Problem
from calibration.fitting.request import Component, Request, assemble
from calibration.fitting.search import (
    LARGEST_STEP,
    MOST,
    OPTIMISERS,
    Ends,
    guided_search,
    search,
)
from calibration.fitting.side_by_side import alike, as_one
from calibration.fitting.uncertainty import Uncertainty, uncertainty_of
from calibration.fitting.variance_updates import (
    first_variances,
    is_single_variance,
    needs_variances,
    update_variances,
    variances_converged,
    with_level,
)
from calibration.fitting.warnings import CONFIDENCE, runs
from calibration.options import FitOptions
from calibration.parameters import LOGIT, NONE
from calibration.rounding import to_digits
from calibration.schema import Real

# how far around the start it is worth looking, in z: three decades to each side of a positive
# parameter, a factor of 30 below and 300 above for χ̃
DECADES = (-3 * np.log(10), 3 * np.log(10))
WIDTHS = {
    "chi": (-3.5, 5.7),
    "sigma": (-3.5, 3.5),
    "psi": (-2.5, 1.5),
    "limit_velocity": (-1.0, 1.0),
    OF_CONTACT + "limit_velocity": (-1.0, 1.0),
}
OF_A_CONTACT = (-0.3, 0.3)  # properties that were measured
LOGIT_SPREAD = 4.0
APART = 1.0  # in z: starts nearer than that would be one search made twice

Places = Float[np.ndarray, "starts elements"]


def screened(
    problem: Problem, z: Float[np.ndarray, " elements"], count: int, seed: int, keep: int, wide=1.0
) -> Places:
    """The `keep` best of `count` places that are `APART`, the best first; each data set ranks its own elements.

    z itself, and points evenly around it along the active elements.

    Args:
        wide: how many times its own size an element of any sign may change.
    """
    active, transform = problem.active, problem.transform.part(problem.active)
    if count <= 1 or not len(active):
        return z[None]
    names = [problem.elements[k].name for k in active]
    usual = [OF_A_CONTACT if name.startswith(OF_CONTACT) else DECADES for name in names]
    below, above = np.transpose([WIDTHS.get(n, u) for n, u in zip(names, usual, strict=True)])
    x, plain = z[active], transform.kind == NONE
    size = wide * (np.abs(x) + 1e-3)
    low = np.where(plain, np.maximum(x - size, transform.lower), x + below)
    high = np.where(plain, np.minimum(x + size, transform.upper), x + above)
    bounded = transform.kind == LOGIT
    low, high = np.where(bounded, -LOGIT_SPREAD, low), np.where(bounded, LOGIT_SPREAD, high)
    # Richtmyer's sequence: SciPy's Sobol points are as even after half a second of imports
    many = range(2, 10 + 20 * len(active))
    primes = [n for n in many if all(n % k for k in range(2, math.isqrt(n) + 1))][: len(active)]
    shift = np.random.default_rng(seed).random(len(active))
    unit = (shift + np.arange(1, count)[:, None] * np.sqrt(primes)) % 1
    places = np.repeat(z[None], count, axis=0)
    places[1:, active] = low + (high - low) * unit
    linear = problem.linearise(places, slopes=False)
    squares = np.nan_to_num(linear.residual, nan=np.inf) ** 2
    begins = np.unique(problem.points.set, return_index=True)[1]
    of_sets = np.add.reduceat(squares[:, : problem.count], begins, axis=1)
    costs = of_sets + squares[:, problem.count :].sum(axis=1)[:, None]
    keep = min(keep, count)
    starts = np.repeat(places[:1], keep, axis=0)
    for sets in {problem.elements[k].sets for k in active}:
        members = [k for k in active if problem.elements[k].sets == sets]
        ranked = costs[:, sets[0]] if len(sets) == 1 else costs.sum(axis=1)
        order, own = np.argsort(ranked, kind="stable").tolist(), places[:, members]
        chosen: list[int] = []
        for i in order:
            if len(chosen) < keep and all(np.ptp(own[[i, j]], 0).max() > APART for j in chosen):
                chosen.append(i)
        chosen += [i for i in order if i not in chosen]  # filled up by neighbours
        starts[:, members] = own[chosen[:keep]]
    return starts


REFINED = 3  # of the screened starts
# where the first starts miss the points: more per element, those refined, and how wide around the first
FEWEST = 8  # requested starts: of fewer no more are made
MORE = ((8, 16, 3.0), (16, 32, 10.0))
MOST_SCREENED = 400_000  # impacts
ODE_SHARE = 0.05  # of these where each is integrated over time
QUICKEST = "levenberg-marquardt"
AS_LOW = 1e-6  # share of a cost within which two ends may be one minimum
MOVED = 1e-2  # in z, from which on ends are others to a reader
COST_DIGITS = (
    6  # of a cost: ends that agree to these are one minimum, found to a search's tolerance
)
DEVIANCE_DIGITS = (
    9  # of -2 ln p: of ends that agree to these the one found first is taken, on any machine
)
ROUNDS = 30
CLOSER = 2  # rounds in which neighbourhoods are brought to the minimum of all points
EXPONENTS = (0.4, 1.5, 5.0, 15.0)  # ψ from which a search begins where it may have several minima
LEAST_LOSS = 0.1  # at yield, of a tenth
OTHERWISE = 1.5  # factor from which on ψ is another
RUN_OUT = 5.0  # in z: an element this far from its start may act on nothing any more
CHANGED = 1e-9  # share of a cost by which another is lower
OVER_JUMPS = 1e-5  # the same of searches that jumps of the cost stop, which end near these
UNSETTLED = "variances keep changing"


@dataclass(frozen=True)
class Stage:
    """Record of a stage, a row of the report; `materials` are its data sets."""

    stage: str
    materials: tuple[str, ...]
    optimiser: str
    route: str
    evaluations: int
    iterations: int
    gradient_norm: float | None
    cost: Real
    converged: bool
    reason: str
    starts: int


@dataclass(frozen=True)
class StageFit:
    """Result of a stage."""

    problem: Problem  # with the variances at its end
    z: np.ndarray  # of the whole component
    ends: Ends  # the search that ended there, of one fit
    others: tuple[Ends, ...]  # where the other starts ended
    report: Stage  # what it took
    single_search: bool  # whether one search alone of many ended so low, and misses the points

    @property
    def bound_side(self) -> np.ndarray:
        """+1 or -1 for active elements that are fixed at an end of their range, else 0."""
        return self.ends.bound_side[0]


def run_stage(
    name: str, problem: Problem, z: np.ndarray, options: FitOptions, ends: list[Ends] | None = None
) -> StageFit:
    """Minimise from the best starts, and estimate the variances there.

    Args:
        ends: of the searches from these starts, where they were made already.
    """
    evaluated = 0 if ends else problem.evaluated[0]
    problem = first_variances(problem, z)
    unsettled = needs_variances(problem)
    ends, single_search = _searched(problem, z, options, ends)
    if (level := with_level(problem)) is not None:
        first, *more = _searched(level, z, options, None)[0]
        ends = [ends[0], first, *ends[1:], *more]
    best, others = ends[0], ends[1:]
    if unsettled:
        candidates = [*_minima(ends), *_tied(problem, z, options)]
        problem, best, *others = _lowest(problem, candidates, options)
        is_scaled = problem.transform.kind != NONE
        if np.any(np.abs(best.z[0] - z)[is_scaled] > RUN_OUT):
            # while variances were large a loss might go to nothing, and is too flat there to come back
            again = search(problem, z[None], options.optimiser, limit=options.max_steps)
            problem, best, higher = _lowest(problem, [best, again], options)
            others.append(higher)
    if unsettled and problem.jumps:
        for _ in range(ROUNDS):  # with the variances as they are now
            lower = _over_jumps(problem, [best], options)[0]
            if lower is best:
                break
            problem, best = estimate_variances(problem, lower, options)
    norm, law = float(best.gradient_norm[0]), problem.laws.model.law_type
    route = law.default_route() if problem.route is None else problem.route
    report = Stage(
        stage=name,
        materials=tuple(data.name for data in problem.datasets),
        optimiser=OPTIMISERS[options.optimiser],
        route="closed form" if issubclass(law, sj.HardSphereLaw) else route.name,
        evaluations=int(problem.evaluated[0] - evaluated),
        iterations=int(best.iterations[0]),
        gradient_norm=norm if np.isfinite(norm) else None,
        cost=float(best.cost[0]),
        converged=bool(best.converged[0]),
        reason=str(best.reason[0]),
        starts=options.starts if len(problem.active) else 1,
    )
    if not unsettled and any(errors.unknown for errors in problem.errors):
        problem, best = _in_units(problem, best)
    return StageFit(
        problem,
        best.z[0],
        best,
        tuple(others),
        report,
        single_search=single_search,
    )


def _searched(problem: Problem, z, options: FitOptions, ends: list[Ends] | None):
    """Ends of searches from the best of the starts, the best first.

    Also whether one search alone of many ended so low, and misses the points.
    """
    few, single_search = binned(problem), False
    if ends is None:
        starts = screened(few, z, options.starts, options.seed, REFINED)
        if problem.has_velocity_errors and len(problem.active):
            # far from the points a steep curve would explain them by errors of velocities
            pairs = zip(few.errors, few.variances, strict=True)
            level = _weighing(few, [errors.diagonal(s) for errors, s in pairs])
            ends = _from_starts(level, starts, QUICKEST)
            around = ends[0].select([0, 0])._replace(z=along_valley(level, ends[0].z))
            starts = np.concatenate([_as_starts(level, end) for end in (*ends, around)])
        if problem.jumps:
            starts = np.unique([z, *starts], axis=0)
        ends = _from_starts(few, starts, options.optimiser, options.max_steps)
    if problem.jumps:
        ends = _over_jumps(problem, ends, options)
    ends = _with_other_exponents(few, ends, options)
    if options.starts >= FEWEST:
        ends, single_search = _from_more_starts(few, z, ends, options)
    if few is not problem:
        ends = sorted((_of_all(problem, end, options) for end in _minima(ends)), key=_rank)
    return ends, single_search


def _over_jumps(problem: Problem, ends: list[Ends], options: FitOptions) -> list[Ends]:
    """These and ends of searches from both sides of the jumps around the best of them, until none is lower."""
    assert problem.affects_yield is not None
    active = problem.active
    for _ in range(ROUNDS):
        places = beside_jumps(problem, ends[0].z[0])
        if not len(places):
            break
        still = np.broadcast_to(problem.affects_yield[active], (len(places), len(active)))
        beside = search(problem, places, fixed=still, limit=options.max_steps)
        more = _from_starts(problem, beside.z, QUICKEST, options.max_steps)
        is_lower = more[0].cost[0] < ends[0].cost[0] * (1 - OVER_JUMPS)
        ends = _minima(sorted([*ends, *more], key=_rank), OVER_JUMPS, np.inf)
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
        more = _from_starts(problem, starts, QUICKEST, options.max_steps)
        is_lower = more[0].cost[0] < ends[0].cost[0] * (1 - AS_LOW)
        ends = _minima(sorted([*ends, *more], key=_rank))
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


def _tied(problem: Problem, z, options: FitOptions) -> list[Ends]:
    """The best end with the members of each pool as one: where their spread is 0 no other search may get there."""
    if not problem.pools:
        return []
    pools = tuple(pool._replace(spread=LEAST_SPREAD) for pool in problem.pools)
    tied = replace(problem, pools=pools)
    starts = screened(tied, z, options.starts, options.seed, REFINED)
    for pool in pools:
        members = list(pool.members)
        starts[:, members] = np.mean(starts[:, members], axis=1, keepdims=True)
    return _from_starts(tied, starts, QUICKEST, options.max_steps)[:1]


def _weighing(problem: Problem, variances) -> Problem:
    """The problem with errors of known variance, of each block, that do not move with the curve."""
    pairs = zip(problem.errors, variances, strict=True)
    errors = tuple(Errors.known(block.velocity, variance) for block, variance in pairs)
    return replace(problem, errors=errors, variances=({},) * len(errors))


def along_valley(problem: Problem, z: Float[np.ndarray, "fits elements"]) -> Places:
    """Two standard errors to both sides of z along what the points leave most open, (2 fits, elements).

    Errors of velocities, whose variance moves with the curve, may give the likelihood several minima there.
    """
    active, transform = problem.active, problem.transform
    jacobian = np.nan_to_num(problem.linearise(z).jacobian)
    _, size, axes = np.linalg.svd(jacobian, full_matrices=False)
    step = 2 * axes[:, -1] / np.maximum(size[:, -1:], TINY)
    unit = np.where(transform.kind[active] == NONE, np.abs(z[:, active]) + TINY, 1.0)
    step /= np.maximum(np.max(np.abs(step) / unit, axis=1, keepdims=True) / LARGEST_STEP, 1.0)
    places = np.concatenate([z, z])
    places[:, active] += np.concatenate([step, -step])
    inside = np.clip(places, transform.lower, transform.upper)
    return np.where(transform.kind == NONE, inside, places)


def _as_starts(problem: Problem, end: Ends) -> Places:
    """The ends of searches as starts; parameters at an end of their range start again from where they began."""
    z, active = np.array(end.z), problem.active
    z[:, active] = np.where(end.bound_side != 0, end.reference_start[:, active], z[:, active])
    return z


def _from_starts(problem: Problem, starts, optimiser: str, limit: int = MOST) -> list[Ends]:
    """Ends of searches from each start, as one batch, the best first."""
    return _in_order(guided_search(problem, starts, optimiser, limit=limit))


def _in_order(ends: Ends) -> list[Ends]:
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
    p, share = len(problem.active), ODE_SHARE if isinstance(problem.route, sj.ODE) else 1.0
    for k, (per_element, most, wide) in enumerate(MORE):
        agree = len(ends) > 1 and all(_as_low(end, ends[0]) for end in ends)
        if not _misses(problem, ends[0]) or (agree and (k > 0 or p <= 2)):
            break
        room = int(share * MOST_SCREENED / problem.count)
        count = min(per_element ** min(p, 4), room)
        if count < options.starts:
            break
        places = screened(problem, z, count, options.seed + k + 1, most, wide)
        more = _from_starts(problem, places, QUICKEST)
        if float(more[0].cost[0]) < float(ends[0].cost[0]) * (1 - CHANGED):
            more[0] = search(
                problem, _as_starts(problem, more[0]), options.optimiser, limit=options.max_steps
            )
        ends = sorted([*ends, *more], key=_rank)
    reached = [end for end in ends if _as_low(end, ends[0])]
    single_search = len(ends) > len(reached) == 1 and _misses(problem, ends[0])
    return _minima(ends), single_search


def _minima(ends: list[Ends], share: float = AS_LOW, moved: float = MOVED) -> list[Ends]:
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


def _in_units(problem: Problem, end: Ends) -> tuple[Problem, Ends]:
    """Problem and search in units of the noise, which was weighed against nothing."""
    problem = update_variances(problem, end.z[0])
    if len(problem.errors) > 1:  # each set weighs as it did
        points = problem.points._replace(copies=problem.diagonal(end.z)[0])
        return replace(problem, points=points), end
    scale = 1 / problem.variances[0]["scatter"]
    norm = scale * end.gradient_norm
    return problem, end._replace(cost=scale * end.cost, gradient_norm=norm)


def _lowest(problem: Problem, ends: list[Ends], options: FitOptions) -> tuple[Any, ...]:
    """The problem and the end of the highest likelihood, each with its own variances; then the others."""
    estimated = [estimate_variances(problem, end, options) for end in ends]
    (problem, best), *others = sorted(estimated, key=lambda each: _minus_two_log(*each))
    return problem, best, *(end for _, end in others)


def _minus_two_log(problem: Problem, end: Ends) -> float:
    """-2 ln p(data | θ, s) p(θ) where a search ended, over all members of pools, to `DEVIANCE_DIGITS`."""
    linear = problem.linearise(end.z, slopes=False)
    priors = linear.residual[:, problem.count : linear.residual.shape[1] - problem.more]
    pools = [(estimate_of_pool(problem, end.z[0], p, end.bound_side[0]), p) for p in problem.pools]
    spreads = sum(estimate.minus_two_log(pool.spread) for estimate, pool in pools)
    total = float(problem.deviance(end.z)[0] + np.sum(priors**2) + spreads)
    return to_digits(total, DEVIANCE_DIGITS)


def estimate_variances(problem: Problem, end: Ends, options: FitOptions, restricted: bool = True):
    """Search again until the variances are those of where the search ends: the problem, and the end."""
    for _ in range(ROUNDS):
        adapted = update_variances(problem, end.z[0], restricted, end.bound_side[0])
        if variances_converged(adapted, problem):
            return problem, end
        problem = adapted
        optimiser, most = options.optimiser, options.max_steps
        # what is at an end of its range stays there: it was looked at when the search arrived
        again = search(
            problem, end.z, optimiser, reference_start=end.reference_start, limit=most, releases=0
        )
        end = again._replace(iterations=end.iterations + again.iterations)
    if not variances_converged(
        update_variances(problem, end.z[0], restricted, end.bound_side[0]), problem
    ):
        end = end._replace(converged=np.array([False]), reason=np.array([UNSETTLED]))
    return problem, end


@dataclass(frozen=True)
class ComponentFit:
    """A fitted component."""

    component: Component  # the request
    stages: tuple[StageFit, ...]  # where each stage ended
    z: np.ndarray  # of all elements
    uncertainty: Uncertainty  # of z; of one fit

    @property
    def final(self) -> StageFit:
        """The stage whose law is the result's."""
        return self.stages[-1]

    @property
    def theta(self) -> np.ndarray:
        """The elements in physical units; those at an end of their range that is a bound, there."""
        transform = self.final.problem.transform
        theta, bound_side = transform.physical(self.z), self.uncertainty.bound_side
        bound = transform.bound_beyond(bound_side)
        theta = np.where((bound_side != 0) & np.isfinite(bound), bound, theta)
        for g, spec in enumerate(self.component.specs):
            places = self.component.places(g)
            if spec.model.law_type is sj.WaltonBraun and {*SPRINGS} <= {*places}:
                first, second = (places[name] for name in SPRINGS)
                theta[second] = max(theta[first], theta[second])
        return theta

    @property
    def slope(self) -> np.ndarray:
        """dθ/dz."""
        return self.final.problem.transform.slope(self.z)

    @cached_property
    def qr_factors(self) -> QRFactors:
        """The last stage at its end."""
        linear = self.final.problem.linearise(self.z[None])
        return factorise(linear.residual, linear.jacobian)

    @property
    def reference_start(self) -> np.ndarray:
        """Starts of elements that are fixed at an end of their range; NaN for the others.

        A search from here then knows them for what they are.
        """
        return np.where(self.uncertainty.bound_side != 0, self.component.start, np.nan)

    @property
    def is_likelihood(self) -> bool:
        """Whether what was minimised is a likelihood: one stage."""
        return len(self.stages) == 1

    @cached_property
    def offsets(self) -> dict[int, Offsets]:
        """Predicted offsets of groups, by the number of the block."""
        first, final = self.stages[0].problem, self.final.problem
        residual = final.linearise(self.z[None]).prediction[0] - final.points.value
        known = self.uncertainty.of_predictions
        parts = {
            k: offsets_of(first, k, self.z, residual[s], known) for k, s in enumerate(first.spans)
        }
        return {k: part for k, part in parts.items() if part is not None}

    def owner(self, sets: Sequence[int]) -> str | None:
        """Name of the data set that something is about; None for several."""
        return self.component.specs[sets[0]].data.name if len(sets) == 1 else None

    @property
    def has_intervals(self) -> bool:
        """Whether intervals hold: of a likelihood, whose law does not miss the level of groups."""
        levels = (part.missed_level for part in self.offsets.values())
        return self.is_likelihood and all(level is None for level in levels)

    @property
    def converged(self) -> bool:
        return all(bool(stage.ends.converged[0]) for stage in self.stages)


TOGETHER = 32  # components that begin side by side


def fitted(request: Request, tell: Callable[..., None] = lambda *_: None) -> list[ComponentFit]:
    """All components; `tell` hears how many are done, of how many."""
    components, fits = assemble(request), dict[int, ComponentFit]()
    for members in alike([component.stages[0][1] for component in components]):
        for k in range(0, len(members), TOGETHER):
            tell(len(fits), len(components))
            some = members[k : k + TOGETHER]
            every = _first_ends([components[i] for i in some], request.options)
            for i, ends in zip(some, every, strict=True):
                tell(len(fits), len(components))
                fits[i] = fit_component(components[i], request.options, ends)
    tell(len(fits), len(components))
    return [fits[i] for i in range(len(components))]


def _first_ends(components: list[Component], options: FitOptions) -> list[list[Ends] | None]:
    """Ends of the searches from each one's first starts, made side by side; None for one alone."""
    if len(components) == 1:
        return [None]
    problems = [
        first_variances(component.stages[0][1], component.start) for component in components
    ]
    starts = [
        screened(problem, component.start, options.starts, options.seed, REFINED)
        for problem, component in zip(problems, components, strict=True)
    ]
    problem, batch = as_one(problems)
    of = np.repeat(np.arange(len(problems)), list(map(len, starts)))
    places, beside, limit = np.concatenate(starts), batch.select(of), options.max_steps
    ends = guided_search(problem, places, options.optimiser, batch=beside, limit=limit)
    for own, count in zip(problems, problem.evaluated, strict=True):
        own.evaluated[0] += count
    return [_in_order(ends.select(of == k)) for k in range(len(problems))]


def fit_component(
    component: Component, options: FitOptions, ends: list[Ends] | None = None
) -> ComponentFit:
    """Run the stages, each from where the one before it ended; `ends` as of `run_stage`."""
    z, fits = component.start, list[StageFit]()
    for name, problem in component.stages:
        if fits:
            problem, ends = _after(fits[0], problem), None
        fits.append(run_stage(name, problem, z, options, ends))
        z = fits[-1].z
    ends_of = [(stage.problem, stage.bound_side) for stage in fits]
    return ComponentFit(component, tuple(fits), z, uncertainty_of(ends_of, z))


def _after(first: StageFit, problem: Problem) -> Problem:
    """A later stage's problem: each point weighs by its own variance, as the first stage found it.

    The law's misfit, which the first stage has none of, would enter whitened residuals with the sizes
    of what points share.
    """
    of_first = first.problem
    variance = of_first.diagonal(first.z[None])[0]
    if all(is_single_variance(of_first, g) for g in range(len(of_first.errors))):
        variance = np.ones(of_first.count)  # all points weigh alike
    return _weighing(problem, [variance[span] for span in of_first.spans])


NO_NOISE = 1e-10  # rms of ε below which there is no noise to speak of


@dataclass(frozen=True)
class Likelihood:
    """ln L at its maximum, and what follows from it.

    Attributes:
        log: ln L, parameters and unknown variances where it is largest.
        fitted: how many numbers were fitted, those variances among them.
        points: how many points.
        aic, bic: Akaike's and Schwarz's criteria.
    """

    log: float
    fitted: int
    points: int
    aic: float
    bic: float


def likelihood_of(fits: list[ComponentFit], options: FitOptions) -> Likelihood | None:
    """Log-likelihood of all components; None if the objective is no likelihood, or the data have no noise.

    None where parameters are pooled, too: how many numbers were fitted is then no whole number.
    """
    log, fitted, points = 0.0, 0, 0
    for fit in fits:
        if not fit.is_likelihood or fit.final.problem.pools:
            return None
        problem, end = fit.final.problem, fit.final.ends
        if needs_variances(problem) and end.converged[0]:
            problem, end = estimate_variances(problem, end, options, restricted=False)
        else:
            problem = update_variances(problem, fit.z, restricted=False)
        unknown = sum(len(errors.unknown) for errors in problem.errors)
        if unknown and np.min(problem.diagonal(end.z)) <= NO_NOISE**2:
            return None
        log -= 0.5 * float(problem.deviance(end.z)[0])
        fitted, points = fitted + len(fit.z) + unknown, points + problem.count
    aic, bic = 2 * fitted - 2 * log, fitted * math.log(points) - 2 * log
    return Likelihood(log, fitted, points, aic, bic)
