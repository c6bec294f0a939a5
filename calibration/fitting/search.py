"""One least-squares search for one fit or a thousand, side by side.

The loop stays on the host; what it needs of all fits at once are residuals and Jacobians. These are factorised (J = Q R),
and from R a method proposes a direction: Levenberg–Marquardt, or L-BFGS by optax. Two measurements 0.95 and 0.85, each
± 0.05, of a constant ε: from 0.5 and from 0.99 to their mean, where the cost is half of 1² + 1²:

>>> import calibration as cal
>>> from calibration.fitting.request import Request, assemble
>>> from calibration.fitting.variance_updates import first_variances
>>> data = cal.RestitutionData([1.0, 1.0], [0.95, 0.85], uncertainty=[0.05, 0.05])
>>> (component,) = assemble(Request((data,)).with_options(law="constant"))
>>> problem = first_variances(component.stages[0][1], component.start)
>>> ends = search(problem, problem.transform.unconstrained(np.array([[0.5], [0.99]])))
>>> problem.transform.physical(ends.z).round(9).T, ends.cost.round(9)
(array([[0.9, 0.9]]), array([1., 1.]))

An element that runs to an end of its range (a bound, or beyond every sensible value) is held there
and the others are searched on: an end at a bound with the others at their minimum is a fit.

Where the cost jumps (`Problem.jumps`) each evaluation takes each point where the law has it, and a step is
taken only if the cost falls. What jumps stop is searched on with yield where it is, and with all again: a
search whose cost falls no more by any step has converged.
"""

from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from calibration.fitting.collisions import TINY_SQUARED
from calibration.fitting.elements import FARTHEST
from calibration.fitting.methods import (
    TINY,
    Fits,
    Lbfgs,
    Marquardt,
    Numbers,
    QRFactors,
    factorise,
)
from calibration.fitting.problem import Problem
from calibration.fitting.rows import Batch, Linear, acts_on_nothing
from calibration.parameters import NONE

# Measured on nine ordinary fits of Zhou's law, and on seven with a skewed or narrow likelihood; on
# 12 of data without noise that start a factor of ten off; on 8 of groups, extra scatter and the
# like (MOST_LEVEL); on three with a free yield strength (MUCH to AROUND_JUMPS). 2x is twice the
# evaluations.

# of the Gauss–Newton step left, in log units for most elements; 1e-6 and 1e-12 move estimates by
# up to 1e-6 standard errors, but of data without noise 1e-6 seems to miss the points, and takes
# 17x
STEP_TOLERANCE = 1e-9
# of the decrease it promises, relative to the cost; 1e-12 moves standard errors by up to 8e-4 of
# them, 1e-18 by 4e-6
COST_TOLERANCE = 1e-15
# of a cost: near its minimum steps are judged by the gradient alone; no effect from 1e-15 to 1e-11
ROUNDING = 1e-13
# steps in a row that change the cost by no more: the gradient is rounding, too; 4 and 100 end in
# the same places
MOST_LEVEL = 20
LARGEST_STEP = 1.5  # in log units: a factor of 4.5; 0.5 takes 1.1x, 4.5 takes 1.2x on the 12
# the same in parts of where an element is that may go farther than others; 0.01 and 1 take as many
LONG_WAY = 0.1
# from where on an element that acts on nothing counts as at the end of its range; no effect from 1
# to 24
NEARLY = 6.0
# share of a cost by which it has to fall for an element to be taken back; no effect from 1e-12 to
# 1e-6
FALLS = 1e-9
# how often an element is taken back from the end of its range; 0 (0.9x) and 8 end in the same
# places
RELEASES = 2
MOST = 200  # steps of a search, if no limit is given
ARRIVED = ("step below tolerance", "cost at its minimum")
USED_UP = "iterations used up"
STUCK = "no lower cost found"
AT_JUMP = "cost at its minimum beside a jump at yield"
# share of a cost that a step towards a jump, or another search, has to save; no effect from 1e-9,
# 1e-3 takes 1.1x
MUCH = 1e-6
MOST_CREEPS = 4  # steps in a row that save less, where the cost jumps; 1 takes 1.3x, 16 as many
# rounds in which all but yield, and then all, are searched on; with none 1 of 3 does not converge,
# 10 are as 3
AROUND_JUMPS = 3
NO_NUMBERS = "residuals are not finite"
OPTIMISERS = {
    "l-bfgs": "optax L-BFGS",
    "levenberg-marquardt": "Levenberg–Marquardt",
}


class Ends(NamedTuple):
    """End points of searches, each array with a leading axis of fits."""

    z: Float[np.ndarray, "fits elements"]  # all elements
    # -ln of likelihood and priors, up to a constant: half the sum of squares of normal errors
    cost: Numbers
    gradient_norm: Numbers  # of the cost, along the active elements
    converged: Fits  # whether and why it stopped
    reason: np.ndarray  # (fits,) of text
    # for the active elements, +1 or -1 where one is held at an end of its range, else 0
    bound_side: Int[np.ndarray, "fits p"]
    # from where it was measured whether an element runs to an end
    reference_start: Float[np.ndarray, "fits elements"]
    iterations: Int[np.ndarray, " fits"]  # steps taken

    def select(self, which: Any) -> "Ends":
        """Select searches."""
        return Ends._make(a[which] for a in self)


class _Search:
    """The state of one call of `search`."""

    def __init__(
        self, problem: Problem, z, reference_start, fixed, batch: Batch, limit, releases, enough
    ):
        self.problem, self.batch, self.limit = problem, batch, limit
        self.releases, self.enough = releases, enough
        self.z = np.array(z)
        fits, p = len(z), len(problem.active)
        self.reference_start = np.where(np.isnan(reference_start), z, reference_start)
        self.start = self.reference_start[:, problem.active]
        sets = [problem.elements[k].sets for k in problem.active]
        self.owner = np.array([sets.index(own_sets) for own_sets in sets], int)
        self.fixed = np.broadcast_to(False if fixed is None else fixed, (fits, p))
        self.bound_side = np.zeros((fits, p), int)
        self.released = np.zeros(fits, int)
        self.reason = np.full(fits, "", dtype=object)
        self.iterations, self.level, self.creeps = np.zeros((3, fits), int)
        self.scaled = problem.transform.kind[problem.active] != NONE
        reach = np.array([problem.elements[k].reach for k in problem.active])
        self.lowest, self.highest = self.start - FARTHEST, self.start + reach
        self.longer = LONG_WAY / LARGEST_STEP * (reach > FARTHEST)
        self.lower, self.upper = self._ends()
        self.z[:, problem.active] = np.minimum(self.x, self.upper)
        all_fits = np.ones(fits, bool)
        linear = self._at(self.z, all_fits)
        self.value, self.jacobian, self.cost = map(
            np.array, (linear.residual, linear.jacobian, linear.cost)
        )
        self.at: QRFactors
        self._factorise(all_fits)

    def _ends(self) -> list[np.ndarray]:
        """Bounds of the active elements of each fit, in z."""
        transform, zeros = self.problem.transform.part(self.problem.active), 0.0 * self.start
        lower = np.where(self.scaled, -np.inf, transform.lower) + zeros
        return [lower, transform.highest() + zeros]

    @property
    def x(self) -> np.ndarray:
        """The active elements."""
        return self.z[:, self.problem.active]

    @property
    def _size(self) -> np.ndarray:
        """Size of a unit step: a factor of e, or the element's size; 0 where that is 0."""
        return np.where(self.scaled, 1.0, np.maximum(np.abs(self.x), np.abs(self.start)))

    @property
    def unit(self) -> np.ndarray:
        return np.where(self._size > 0, self._size, 1.0)

    @property
    def going(self) -> np.ndarray:
        return self.reason == ""

    def run(self, method: Marquardt | Lbfgs) -> None:
        """Step until every fit has arrived, or cannot."""
        fits = len(self.z)
        length = np.ones(fits)
        need = np.ones(fits, bool)
        self._judge(np.ones(fits, bool))
        while np.any(self.going):
            direction = method.propose(need & self.going, self.x, self.at)
            direction = direction * ~self._frozen
            share, longest = self._limited(direction)
            direction, length = direction * share, np.where(need, longest, length)
            moved, gain = self._try(length[:, None] * direction)
            refused = self.going & ~moved
            need = method.refused(refused) | moved
            length = np.where(refused, 0.25 * length, length)
            method.taken(moved, length == 1.0, gain)
            self._judge(moved)
            self._stop(method.stuck() & refused, STUCK)
            self._stop(self.level >= MOST_LEVEL, ARRIVED[1])
            self._stop(self.problem.jumps & (self.creeps >= MOST_CREEPS), STUCK)
            self._stop(self.iterations >= self.limit, USED_UP)

    def _limited(self, direction) -> tuple[np.ndarray, np.ndarray]:
        """Factors that limit a step: for each element, and for the step as a whole.

        Each data set's elements are limited by themselves: those of one may run to their ends while
        the others' arrive.
        """
        ways = np.zeros((len(direction), self.owner.max(initial=0) + 1))
        unit = np.maximum(self.unit, self.longer * np.abs(self.x))
        np.maximum.at(ways, (slice(None), self.owner), np.abs(direction) / unit)
        part = np.minimum(1.0, LARGEST_STEP / np.maximum(ways, 1e-300))
        longest_part = np.max(np.where(ways > 0, part, 0.0), axis=1, keepdims=True)
        share = (part / np.where(longest_part > 0, longest_part, 1.0))[:, self.owner]
        uphill = np.einsum("fp,fp->f", self.at.gradient, direction * share) >= 0
        least = np.min(part, axis=1)
        share[uphill] = 1.0
        return share, np.where(uphill, least, np.where(longest_part > 0, longest_part, 1.0)[:, 0])

    @property
    def _frozen(self) -> np.ndarray:
        return self.fixed | (self.bound_side != 0)

    def _at(self, z, fits) -> Linear:
        return self.problem.linearise(z[fits], self.batch.select(fits))

    def _put(self, fits, linear: Linear, which: Any = slice(None)) -> None:
        self.value[fits], self.jacobian[fits] = linear.residual[which], linear.jacobian[which]
        self.cost[fits] = linear.cost[which]

    def _factorise(self, fits: np.ndarray) -> None:
        """Factorise the Jacobians of some fits anew."""
        none = acts_on_nothing(self.jacobian[fits], self._size[fits])
        rows = self.value[fits], self.jacobian[fits], self._frozen[fits] | none
        factors = factorise(*rows, self.cost[fits])
        if np.all(fits):
            self.at = factors
            return
        parts = [np.array(a) for a in self.at]
        for part, new in zip(parts, factors, strict=True):
            part[fits] = new
        self.at = QRFactors(*parts)

    def _try(self, step) -> tuple[np.ndarray, np.ndarray]:
        """Fits whose cost fell enough (Armijo) and that moved, and the decrease over that promised."""
        fits = self.going
        trial = np.array(self.z)
        inside = np.clip(self.x + step, self.lower, self.upper)
        step, trial[:, self.problem.active] = inside - self.x, inside
        linear = self._at(trial, fits)
        cost = np.full(len(fits), np.inf)
        cost[fits] = np.where(np.isfinite(linear.cost), linear.cost, np.inf)
        slope = np.einsum("fp,fp->f", self.at.gradient, step)
        allowed = self.at.cost + ROUNDING * np.abs(self.at.cost) + 1e-4 * np.minimum(slope, 0.0)
        moved = fits & (cost <= allowed)
        before = self.at
        self.z[moved] = trial[moved]
        self._put(moved, linear, moved[fits])
        self.iterations += moved
        self._factorise(moved)
        change, size = np.abs(before.cost - self.at.cost), np.abs(self.at.cost)
        self.level = np.where(moved & (change > ROUNDING * size), 0, self.level + moved)
        self.creeps = np.where(moved & (change > MUCH * size), 0, self.creeps + moved)
        with np.errstate(over="ignore", invalid="ignore"):
            return moved, (before.cost - self.at.cost) / np.maximum(before.fall(step), TINY)

    def _judge(self, moved) -> None:
        """Hold what is at an end of its range, and see which fits have arrived."""
        outward = -self.at.gradient  # a step goes down the gradient
        ends = (self.x <= self.lower) & (outward < 0) | (self.x >= self.upper) & (outward > 0)
        far = (self.x < self.lowest + 1e-9) | (self.x > self.highest - 1e-9)
        at_end = (ends | self.scaled & far) & moved[:, None] & ~self._frozen
        if np.any(at_end):
            self._hold(at_end)
        self._stop(moved & ~self.at.finite, NO_NUMBERS)
        # the longest element of the Gauss–Newton step that is left
        step_left = np.max(np.abs(self.at.newton) / self.unit, axis=1, initial=0.0)
        lowest = self.at.promised <= COST_TOLERANCE * 2 * np.abs(self.at.cost) + self.enough
        arrived = moved & self.going & ((step_left <= STEP_TOLERANCE) | lowest)
        silent = arrived & np.any(self.at.silent & ~self._frozen, axis=1)
        far = silent[:, None] & self.at.silent & (self._way > NEARLY) & ~self._frozen
        if np.any(far):
            self._hold(far)
            arrived &= ~np.any(far, axis=1)
            self._judge(np.any(far, axis=1))
        arrived &= ~(
            self._let_go(arrived) | self._release(arrived & (self.released < self.releases))
        )
        step_left = np.max(np.abs(self.at.newton) / self.unit, axis=1, initial=0.0)
        self._stop(arrived & (step_left <= STEP_TOLERANCE), ARRIVED[0])
        self._stop(arrived, ARRIVED[1])

    @property
    def _way(self) -> np.ndarray:
        """Distance of each element on a logarithmic scale from its start."""
        return np.where(self.scaled, np.abs(self.x - self.start), 0.0)

    def _hold(self, which) -> None:
        sign = np.where(self.scaled, np.sign(self.x - self.start), -np.sign(self.at.gradient))
        sign = np.where(self.x >= self.upper, 1.0, sign)
        self.bound_side = np.where(which, sign.astype(int), self.bound_side)
        inside = np.clip(self.x, self.lowest, np.minimum(self.highest, self.upper))
        ends = np.where(which & self.scaled, inside, self.x)
        fits = np.any(ends != self.x, axis=1) & self.going
        self.z[:, self.problem.active] = ends
        if np.any(fits):
            self._put(fits, self._at(self.z, fits))
        self._factorise(np.any(which, axis=1))

    def _let_go(self, arrived) -> np.ndarray:
        """Let go of elements at a bound from which the cost now falls inwards."""
        gradient = np.einsum("fmp,fm->fp", self.jacobian, self.value)
        curvature = np.maximum(np.sum(self.jacobian**2, axis=1), TINY)
        at_end = (self.x <= self.lower) | (self.x >= self.upper)
        inward = arrived[:, None] & at_end & (gradient * self.bound_side > 0) & ~self.fixed
        inward &= 0.5 * gradient**2 / curvature > FALLS * self.at.cost[:, None]
        back = np.any(inward, axis=1)
        if np.any(back):
            self.bound_side[inward] = 0
            self._factorise(back)
        return back

    def _release(self, arrived) -> np.ndarray:
        """Take back elements whose cost falls inwards now that the others have moved."""
        active, back = self.problem.active, np.zeros(len(arrived), bool)
        for f in np.flatnonzero(arrived & np.any(self.bound_side != 0, axis=1)):
            places = []
            for k in np.flatnonzero(self.bound_side[f]):
                for part in (0.0, 0.5, 0.8):
                    inner = self.start[f, k] + part * (self.x[f, k] - self.start[f, k])
                    places.append(np.array(self.z[f]))
                    places[-1][active[k]] = np.clip(inner, self.lower[f, k], self.upper[f, k])
            batch = self.batch.select(np.full(len(places), f))
            cost = self.problem.linearise(np.array(places), batch, slopes=False).cost
            best = int(np.argmin(cost))
            if cost[best] < self.at.cost[f] * (1 - FALLS):
                self.z[f], back[f], self.bound_side[f] = places[best], True, 0
                self.released[f] += 1
        if np.any(back):
            self._put(back, self._at(self.z, back))
            self._factorise(back)
        return back

    def _stop(self, fits, reason: str) -> None:
        self.reason[fits & self.going] = reason

    def result(self) -> Ends:
        return Ends(
            z=self.z,
            cost=self.at.cost,
            gradient_norm=np.linalg.norm(self.at.gradient, axis=1),
            converged=np.isin(self.reason, ARRIVED),
            reason=self.reason,
            bound_side=self.bound_side,
            reference_start=self.reference_start,
            iterations=self.iterations,
        )


@cache
def _blas() -> Any:
    """The libraries of linear algebra."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController().select(user_api="blas")


def one_thread() -> Any:
    """A context in which linear algebra keeps to one thread: more take twenty times the processor time of small matrices."""
    return _blas().limit(limits=1)


def search(
    problem: Problem,
    z: Float[np.ndarray, "fits elements"],
    optimiser: str = "levenberg-marquardt",
    *,
    reference_start: Float[np.ndarray, "... elements"] | None = None,
    fixed: Bool[np.ndarray, "fits p"] | None = None,
    batch: Batch | None = None,
    limit: int = MOST,
    releases: int = RELEASES,
    enough: float | np.ndarray = 0.0,
) -> Ends:
    """Minimise from each z.

    Args:
        optimiser: of `OPTIMISERS`.
        reference_start: from where it is measured whether an element runs to an end of its range,
            NaN: from its z. What is there already when the search starts is held there.
        fixed: active elements that stay as they are, fit by fit.
        batch: what differs between fits.
        limit: of the steps.
        releases: how often an element is taken back from the end of its range.
        enough: how far above its minimum a cost may end, fit by fit.
    """
    z = np.array(np.atleast_2d(z), float)
    batch, active = batch or Batch(), problem.active
    method = Marquardt if optimiser == "levenberg-marquardt" else Lbfgs

    def run(z, reference_start, fixed, batch: Batch, enough) -> Ends:
        state = _Search(problem, z, reference_start, fixed, batch, limit, releases, enough)
        if len(active):
            with one_thread():
                state.run(method(*state.start.shape))
        else:
            state._stop(np.ones(len(z), bool), ARRIVED[0])
        return state.result()

    fixed = np.broadcast_to(False if fixed is None else fixed, (len(z), len(active)))
    near = np.broadcast_to(enough, len(z))
    ends = run(z, np.nan if reference_start is None else reference_start, fixed, batch, near)
    if problem.affects_yield is None:
        return ends
    for _ in range(AROUND_JUMPS):
        stuck = np.flatnonzero(ends.reason == STUCK)
        if not len(stuck):
            break
        some, still, beside = ends.select(stuck), fixed[stuck], batch.select(stuck)
        with_yields = still | problem.affects_yield[active]
        others = run(some.z, some.reference_start, with_yields, beside, near[stuck])
        others.reason[others.converged] = AT_JUMP
        again = run(others.z, others.reference_start, still, beside, near[stuck])
        better = again.cost < others.cost * (1 - MUCH)
        better |= again.converged & (again.cost <= others.cost)
        for part, old, new in zip(ends, others, again, strict=True):
            part[stuck] = np.where(better.reshape(-1, *(1,) * (old.ndim - 1)), new, old)
        ends.iterations[stuck] += some.iterations
    return ends


def guided_search(
    problem: Problem,
    z: Float[np.ndarray, "fits elements"],
    optimiser: str,
    *,
    batch: Batch | None = None,
    limit: int = MOST,
) -> Ends:
    """A search with ε continued to where nothing rebounds, which leads back from there.

    Where some points do not rebound the law's own ε is then searched, from the ends and from the
    starts: the cost that is found is always that of the law's own ε.
    """
    batch = batch or Batch()
    guided = search(replace(problem, guided=True), z, optimiser, batch=batch, limit=limit)
    places = np.concatenate([guided.z, z])
    twice = batch.select(np.tile(np.arange(len(z)), 2))
    least = np.min(problem.linearise(places, twice, slopes=False).prediction, axis=1, initial=1.0)
    some = np.flatnonzero(np.min(least.reshape(2, -1), axis=0) <= TINY_SQUARED**0.5)
    if not len(some):
        return guided
    # √ bends sharply where a point hardly rebounds: damped steps find their way there
    reference_start, beside = (
        np.concatenate([guided.reference_start[some], z[some]]),
        batch.select(np.tile(some, 2)),
    )
    places = np.concatenate([guided.z[some], z[some]])
    again = search(problem, places, reference_start=reference_start, batch=beside, limit=3 * limit)
    lower = again.cost[: len(some)] <= again.cost[len(some) :]
    lowest = again.select(np.where(lower, 0, len(some)) + np.arange(len(some)))
    for part, new in zip(guided, lowest, strict=True):
        part[some] = new
    return guided
