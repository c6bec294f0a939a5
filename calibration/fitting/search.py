"""One least-squares search for one fit or a thousand, side by side.

The loop stays on the host; what it asks for of all fits at once are residuals and Jacobians. These are
condensed to a triangle, from which a method proposes a direction: Levenberg–Marquardt, or L-BFGS by optax.

An element that runs to an end of its range (a bound, or beyond every sensible value) is held there
and the others are searched on: an end at a bound with the others at their minimum is a fit. So is one
at an end of where points keep their branches (`Problem.within`), which is no end of its range.
"""

from dataclasses import replace
from functools import lru_cache, partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from calibration.fitting.collisions import TINY_SQUARED
from calibration.fitting.problem import Lanes, Linear, Problem, acts_on_nothing
from calibration.parameters import NONE
from softjax.batching import QUICK, accepted

STEP_TOLERANCE = 1e-9  # of the Gauss–Newton step left, in log units for most elements
COST_TOLERANCE = 1e-15  # of the decrease it promises, relative to the cost
ROUNDING = 1e-13  # of a cost: near its minimum steps are judged by the gradient alone
LARGEST_STEP = 1.5  # in log units
FARTHEST = 25.0  # from the start, in log units: beyond, nothing changes any more
NEARLY = 6.0  # from where on an element that acts on nothing counts as at the end of its range
FALLS = 1e-9  # share of a cost by which it has to fall for an element to be taken back
RELEASES = 2  # how often an element is taken back from the end of its range
MOST = 200
ADAM_STEPS = 200
ARRIVED = ("step below tolerance", "cost at its minimum")
USED_UP = "iterations used up"
STUCK = "no lower cost found"
NO_NUMBERS = "residuals are not finite"
TINY = 1e-150  # a column so short that its square underflows is none
SEEN = 1e-10  # singular values, columns scaled to one, below which a direction is not seen
SILENT = 1e-9  # a column of the Jacobian so small against the residuals acts on nothing
SOONEST = (*QUICK, ("xla_backend_optimization_level", 0))  # a quarter of the time to compile
OPTIMISERS = {
    "l-bfgs": "optax L-BFGS",
    "adam": "optax Adam, then L-BFGS",
    "levenberg-marquardt": "Levenberg–Marquardt",
}

Fits = Bool[np.ndarray, "fits"]
Numbers = Float[np.ndarray, "fits"]
Steps = Float[np.ndarray, "fits p"]


class Found(NamedTuple):
    """End points of searches, each array with a leading axis of fits."""

    z: Float[np.ndarray, "fits elements"]  # all elements
    # -ln of likelihood and priors, up to a constant: half the sum of squares of normal errors
    cost: Numbers
    gradient_norm: Numbers  # of the cost, along the active elements
    converged: Fits  # whether and why it stopped
    reason: np.ndarray  # (fits,) of text
    # for the active elements, +1 or -1 where one is held at an end of its range, else 0
    limits: Int[np.ndarray, "fits p"]
    # from where it was measured whether an element runs to an end
    begun: Float[np.ndarray, "fits elements"]
    iterations: Int[np.ndarray, "fits"]  # steps taken
    evaluations: int  # sets of residuals with their Jacobian, of all fits together

    def some(self, which: Any) -> "Found":
        """Some of the searches side by side."""
        parts: list[Any] = [a[which] for a in self[:-1]]
        return Found._make([*parts, self.evaluations])


class Condensed(NamedTuple):
    """J = Q R with the columns of R scaled to one, R = U S Vᵀ, of each fit."""

    cost: Numbers  # what is minimised
    gradient: Steps  # Jᵀ r
    size: Steps  # lengths of the columns of J, 1 where there is none
    singular: Steps  # S in falling order, and V (p, p)
    directions: Float[np.ndarray, "fits p p"]
    along: Steps  # Uᵀ Qᵀ r
    silent: Bool[np.ndarray, "fits p"]  # columns that act on nothing
    finite: Fits  # whether residuals and Jacobian are numbers

    @property
    def seen(self) -> Bool[np.ndarray, "fits p"]:
        """Directions that the residuals move with."""
        return self.singular > SEEN * np.maximum(self.singular[:, :1], TINY)

    def whitening(self, damping: Numbers) -> Float[np.ndarray, "fits p p"]:
        """T with Tᵀ (JᵀJ + damping) T = 1; columns of directions that are not seen are zero."""
        damped = np.sqrt(self.singular**2 + damping[:, None] * self.singular[:, :1] ** 2)
        per = np.where(self.seen, 1 / np.where(self.seen, damped, 1.0), 0.0)
        return self.directions * per[:, None, :] / self.size[:, :, None]

    @property
    def newton(self) -> Steps:
        """The Gauss–Newton step that is left, without the directions that are not seen."""
        part = np.where(self.seen, self.along / np.where(self.seen, self.singular, 1.0), 0.0)
        return -np.einsum("fij,fj->fi", self.directions, part) / self.size

    @property
    def promised(self) -> Numbers:
        """Predicted decrease of the sum of squares."""
        return np.sum(np.where(self.seen, self.along, 0.0) ** 2, axis=1)

    def fall(self, step: Steps) -> Numbers:
        """Decrease of the cost if residuals were linear."""
        moved = self.singular * np.einsum("fij,fi->fj", self.directions, self.size * step)
        return -np.einsum("fp,fp->f", self.gradient, step) - 0.5 * np.sum(moved**2, axis=1)


def condense(residual, jacobian, held=None, cost: Numbers | None = None) -> Condensed:
    """Condense each fit; columns of fixed elements count as zero. Default cost: ½ rᵀ r."""
    finite = np.all(np.isfinite(residual), 1) & np.all(np.isfinite(jacobian), (1, 2))
    residual = np.where(finite[:, None], residual, 0.0)
    zero = ~finite[:, None] if held is None else held | ~finite[:, None]
    jacobian = np.where(zero[:, None, :], 0.0, jacobian)
    p = jacobian.shape[2]
    length = np.sqrt(np.einsum("fmp,fmp->fp", jacobian, jacobian))
    norm = np.sqrt(np.einsum("fm,fm->f", residual, residual))
    acts = length > TINY
    size = np.where(acts, length, 1.0)
    scaled = np.where(acts[:, None, :], jacobian / size[:, None, :], 0.0)
    joined = np.concatenate([scaled, residual[:, :, None]], axis=2)
    missing = max(p + 1 - joined.shape[1], 0)  # fewer residuals than parameters
    if missing:
        joined = np.pad(joined, ((0, 0), (0, missing), (0, 0)))
    triangle: np.ndarray = np.asarray(np.linalg.qr(joined, mode="r"))
    left, singular, right = np.linalg.svd(triangle[:, :p, :p])
    along = np.einsum("fji,fj->fi", left, triangle[:, :p, p])
    directions = np.swapaxes(right, 1, 2)
    gradient = size * np.einsum("fij,fj->fi", directions, singular * along)
    cost = np.where(finite, 0.5 * norm**2 if cost is None else cost, np.inf)
    silent = length <= SILENT * norm[:, None]
    return Condensed(cost, gradient, size, singular, directions, along, silent, finite)


class Marquardt:
    """Levenberg and Marquardt: (JᵀJ + λ) step = -Jᵀr in columns scaled to one.

    λ follows how much of the promised fall was had, so that narrow curved valleys do not refuse every
    other step.

    Source: Nielsen, Damping parameter in Marquardt's method, IMM-REP-1999-05 (1999).
    """

    GROWTH = 3.0  # at most, of 1/λ with a step
    SMALLEST, LARGEST = 1e-12, 1e14  # of 1/λ

    def __init__(self, fits: int, p: int):
        self.size = np.full(fits, 1e3)
        self.fall = np.full(fits, 2.0)  # what 1/λ is divided by where a step is refused
        self.direction = np.zeros((fits, p))

    def propose(self, need: Fits, z: Steps, at: Condensed) -> Steps:
        """A direction for the fits that need one."""
        along = at.along * at.singular / (at.singular**2 + 1 / self.size[:, None])
        step = -np.einsum("fij,fj->fi", at.directions, along) / at.size
        self.direction = np.where(need[:, None], step, self.direction)
        return self.direction

    def taken(self, fits: Fits, whole: Fits, gain: Numbers) -> None:
        """Fits that moved, by a whole step or a shortened one; the fall of the cost over that promised."""
        factor = np.maximum(1 / self.GROWTH, 1 - (2 * np.clip(gain, 0.0, 1.0) - 1) ** 3)
        grown = np.minimum(self.size / factor, self.LARGEST)
        self.size = np.where(fits, grown, self.size)
        self.fall = np.where(fits, 2.0, self.fall)

    def refused(self, fits: Fits) -> Fits:
        """Fits whose step raised the cost; which of them want another direction, not a shorter step."""
        self.size = np.where(fits, self.size / self.fall, self.size)
        self.fall = np.where(fits, 2 * self.fall, self.fall)
        return fits

    def stuck(self) -> Fits:
        """Those that no direction helps."""
        return self.size < self.SMALLEST


class Lbfgs:
    """optax's L-BFGS in variables in which the damped Gauss–Newton matrix is one, renewed at times.

    That makes its first step Levenberg's and leaves what the curvature of the residuals changes to
    L-BFGS's memory. Far from a minimum the damping grows with every step that had to be shortened.
    """

    PERIOD = 6  # steps between two renewals
    FIRST_DAMPING, LARGEST_DAMPING = 1e-2, 1e6  # of the matrix with unit diagonal
    SHORTER = 8  # how often a step is shortened before another direction is taken

    def __init__(self, fits: int, p: int):
        self.damping = np.full(fits, self.FIRST_DAMPING)
        self.age = np.zeros(fits, int)
        self.shortened = np.zeros(fits, int)
        self.exhausted = np.zeros(fits, bool)
        self.direction = np.zeros((fits, p))
        self.basis = self.inverse = np.zeros((fits, p, p))
        self.memory = _lbfgs_tools()[0](np.zeros(_sized(fits, p)))

    def propose(self, need: Fits, z: Steps, at: Condensed) -> Steps:
        renewed = need & (self.age % self.PERIOD == 0)
        if np.any(renewed):
            basis = at.whitening(self.damping)
            self.basis = np.where(renewed[:, None, None], basis, self.basis)
            self.inverse = np.linalg.pinv(self.basis)
        white = np.einsum("fij,fi->fj", self.basis, at.gradient)
        place = np.einsum("fij,fj->fi", self.inverse, z)
        fits, p = z.shape
        sizes = _sized(fits, p)
        padded = [
            np.zeros(sizes),
            np.zeros(sizes),
            np.zeros(sizes[0], bool),
            np.zeros(sizes[0], bool),
        ]
        for array, values in zip(padded, (white, place, need, renewed), strict=True):
            array[tuple(map(slice, values.shape))] = values
        update, self.memory = _lbfgs_tools()[1](self.memory, *padded)
        direction = -np.einsum("fij,fj->fi", self.basis, np.asarray(update)[:fits, :p])
        uphill = np.einsum("fi,fi->f", direction, at.gradient) >= 0
        steepest = -np.einsum("fij,fj->fi", self.basis, white)
        direction = np.where(uphill[:, None], steepest, direction)
        self.direction = np.where(need[:, None], direction, self.direction)
        self.age += need
        self.shortened[need] = 0
        return self.direction

    def taken(self, fits: Fits, whole: Fits, gain: Numbers) -> None:
        self.damping = np.where(fits & whole, self.damping * 0.2, self.damping)
        self._damp(fits & ~whole)

    def refused(self, fits: Fits) -> Fits:
        self.shortened += fits
        over = fits & (self.shortened >= self.SHORTER)
        self.exhausted |= over & (self.damping >= self.LARGEST_DAMPING)
        self._damp(over)
        return over

    def stuck(self) -> Fits:
        return self.exhausted

    def _damp(self, fits: Fits) -> None:
        raised = np.minimum(self.damping * 10, self.LARGEST_DAMPING)
        self.damping = np.where(fits, raised, self.damping)
        self.age = np.where(fits, 0, self.age)


def _sized(fits: int, p: int) -> tuple[int, int]:
    """Sizes rounded up to powers of eight and two, so that few of them are compiled."""
    return 8 ** max(1, int(np.ceil(np.log(fits) / np.log(8) - 1e-9))), 2 ** max(
        3, int(np.ceil(np.log2(max(p, 1))))
    )


@lru_cache
def _lbfgs_tools():
    import optax

    tool = optax.scale_by_lbfgs(memory_size=10, scale_init_precond=False)

    def where(fits, yes, no):
        pick = lambda a, b: jnp.where(fits.reshape(-1, *(1,) * (a.ndim - 1)), a, b)  # noqa: E731
        return jax.tree.map(pick, yes, no)

    @partial(jax.jit, compiler_options=accepted(SOONEST))
    def update(memory, gradient, place, need, renewed):
        empty = jax.vmap(tool.init)(jnp.zeros_like(gradient))
        chosen = where(renewed, empty, memory)
        step, after = jax.vmap(tool.update)(gradient, chosen, place)
        return step, where(need, after, chosen)

    return jax.jit(jax.vmap(tool.init)), update


@lru_cache
def _adam():
    """optax's Adam with a cosine schedule: what starts it, and what steps."""
    import optax

    tool = optax.adam(optax.cosine_decay_schedule(0.1, ADAM_STEPS))
    return tool.init, jax.jit(tool.update)


class _Search:
    """The state of one call of `search`."""

    def __init__(self, problem: Problem, z, begun, held, lanes: Lanes, limit: int, releases: int):
        self.problem, self.lanes, self.limit = problem, lanes, limit
        self.releases = releases
        self.z = np.array(z)
        fits, p = len(z), len(problem.active)
        self.begun = np.where(np.isnan(begun), z, begun)
        self.start = self.begun[:, problem.active]
        sets = [problem.elements[k].sets for k in problem.active]
        self.owner = np.array([sets.index(one) for one in sets], int)
        self.held = np.zeros((fits, p), bool) if held is None else np.broadcast_to(held, (fits, p))
        self.limits = np.zeros((fits, p), int)
        self.released = np.zeros(fits, int)
        self.reason = np.full(fits, "", dtype=object)
        self.iterations = np.zeros(fits, int)
        self.evaluations = 0
        self.scaled = problem.transform.kind[problem.active] != NONE
        self.lower, self.upper = self._ends()
        self.edge = np.zeros((fits, p), bool)
        every = np.ones(fits, bool)
        found = self._at(self.z, every)
        self.value, self.jacobian, self.cost = map(
            np.array, (found.residual, found.jacobian, found.cost)
        )
        self.at: Condensed
        self._condense(every)

    def _ends(self) -> list[np.ndarray]:
        """Lowest and highest of the active elements of each fit: their bounds, and their branches'."""
        problem, lanes = self.problem, self.lanes
        transform = problem.transform.part(problem.active)
        ends = [np.where(self.scaled, -np.inf, transform.lower) + np.zeros(self.start.shape)]
        ends += [np.where(self.scaled, np.inf, transform.upper) + np.zeros(self.start.shape)]
        within = problem.within if lanes.lower is None else (lanes.lower, lanes.upper)
        if within is None:
            return ends
        low, high = (np.asarray(end)[..., problem.active] for end in within)
        return [np.maximum(ends[0], low), np.minimum(ends[1], high)]

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
            direction = np.where(self._frozen, 0.0, direction)
            share, longest = self._limited(direction)
            direction, length = direction * share, np.where(need, longest, length)
            moved, gain = self._try(length[:, None] * direction)
            refused = self.going & ~moved
            need = method.refused(refused) | moved
            length = np.where(refused, 0.25 * length, length)
            method.taken(moved, length == 1.0, gain)
            self._judge(moved)
            self._stop(method.stuck() & refused, STUCK)
            self._stop(self.iterations >= self.limit, USED_UP)

    def _limited(self, direction) -> tuple[np.ndarray, np.ndarray]:
        """Factors that limit a step: for each element, and for the step as a whole.

        Each data set's elements are limited by themselves: those of one may run to their ends while
        the others' arrive.
        """
        ways = np.zeros((len(direction), self.owner.max(initial=0) + 1))
        np.maximum.at(ways, (slice(None), self.owner), np.abs(direction) / self.unit)
        part = np.minimum(1.0, LARGEST_STEP / np.maximum(ways, 1e-300))
        whole = np.max(np.where(ways > 0, part, 0.0), axis=1, keepdims=True)
        share = (part / np.where(whole > 0, whole, 1.0))[:, self.owner]
        uphill = np.einsum("fp,fp->f", self.at.gradient, direction * share) >= 0
        least = np.min(part, axis=1)
        share[uphill] = 1.0
        return share, np.where(uphill, least, np.where(whole > 0, whole, 1.0)[:, 0])

    @property
    def _frozen(self) -> np.ndarray:
        return self.held | (self.limits != 0)

    def _at(self, z, fits) -> Linear:
        self.evaluations += int(np.sum(fits))
        return self.problem.linearise(z[fits], self.lanes.some(fits))

    def _put(self, fits, found: Linear, which: Any = slice(None)) -> None:
        self.value[fits], self.jacobian[fits] = found.residual[which], found.jacobian[which]
        self.cost[fits] = found.cost[which]

    def _condense(self, fits: np.ndarray) -> None:
        """Anew, where something has changed."""
        none = acts_on_nothing(self.jacobian[fits], self._size[fits])
        rows = self.value[fits], self.jacobian[fits], self._frozen[fits] | none
        found = condense(*rows, self.cost[fits])
        if np.all(fits):
            self.at = found
            return
        parts = [np.array(a) for a in self.at]
        for part, new in zip(parts, found, strict=True):
            part[fits] = new
        self.at = Condensed(*parts)

    def _try(self, step) -> tuple[np.ndarray, np.ndarray]:
        """Fits whose cost fell enough (Armijo) and that moved, and the decrease over that promised."""
        fits = self.going
        trial = np.array(self.z)
        inside = np.clip(self.x + step, self.lower, self.upper)
        step, trial[:, self.problem.active] = inside - self.x, inside
        found = self._at(trial, fits)
        cost = np.full(len(fits), np.inf)
        cost[fits] = np.where(np.isfinite(found.cost), found.cost, np.inf)
        slope = np.einsum("fp,fp->f", self.at.gradient, step)
        allowed = self.at.cost + ROUNDING * np.abs(self.at.cost) + 1e-4 * np.minimum(slope, 0.0)
        moved = fits & (cost <= allowed)
        before = self.at
        self.z[moved] = trial[moved]
        self._put(moved, found, moved[fits])
        self.iterations += moved
        self._condense(moved)
        with np.errstate(over="ignore", invalid="ignore"):
            return moved, (before.cost - self.at.cost) / np.maximum(before.fall(step), TINY)

    def _judge(self, moved) -> None:
        """Hold what is at an end of its range, and see which fits have arrived."""
        outward = -self.at.gradient  # a step goes down the gradient
        ends = (self.x <= self.lower) & (outward < 0) | (self.x >= self.upper) & (outward > 0)
        held = (ends | (self._way > FARTHEST - 1e-9)) & moved[:, None] & ~self._frozen
        if np.any(held):
            self._hold(held)
        self._stop(moved & ~self.at.finite, NO_NUMBERS)
        # the longest element of the Gauss–Newton step that is left
        left = np.max(np.abs(self.at.newton) / self.unit, axis=1, initial=0.0)
        lowest = self.at.promised <= COST_TOLERANCE * 2 * np.abs(self.at.cost)
        arrived = moved & self.going & ((left <= STEP_TOLERANCE) | lowest)
        silent = arrived & np.any(self.at.silent & ~self._frozen, axis=1)
        far = silent[:, None] & self.at.silent & (self._way > NEARLY) & ~self._frozen
        if np.any(far):
            self._hold(far)
            arrived &= ~np.any(far, axis=1)
            self._judge(np.any(far, axis=1))
        arrived &= ~(
            self._let_go(arrived) | self._release(arrived & (self.released < self.releases))
        )
        left = np.max(np.abs(self.at.newton) / self.unit, axis=1, initial=0.0)
        self._stop(arrived & (left <= STEP_TOLERANCE), ARRIVED[0])
        self._stop(arrived, ARRIVED[1])

    @property
    def _way(self) -> np.ndarray:
        """Distance of each element on a logarithmic scale from its start."""
        return np.where(self.scaled, np.abs(self.x - self.start), 0.0)

    def _hold(self, which) -> None:
        edge = self.scaled & ((self.x <= self.lower) | (self.x >= self.upper))
        self.edge = np.where(which, edge, self.edge)
        by_way = self.scaled & ~edge
        sign = np.where(by_way, np.sign(self.x - self.start), -np.sign(self.at.gradient))
        self.limits = np.where(which, sign.astype(int), self.limits)
        inside = np.clip(self.x, self.start - FARTHEST, self.start + FARTHEST)
        self.z[:, self.problem.active] = np.where(which & by_way, inside, self.x)
        fits = np.any(which, axis=1) & self.going
        if np.any(fits):
            self._put(fits, self._at(self.z, fits))
        self._condense(np.any(which, axis=1))

    def _let_go(self, arrived) -> np.ndarray:
        """Let go of elements at a bound from which the cost now falls inwards."""
        gradient = np.einsum("fmp,fm->fp", self.jacobian, self.value)
        curvature = np.maximum(np.sum(self.jacobian**2, axis=1), TINY)
        at_end = (self.x <= self.lower) | (self.x >= self.upper)
        inward = arrived[:, None] & at_end & (gradient * self.limits > 0) & ~self.held
        inward &= 0.5 * gradient**2 / curvature > FALLS * self.at.cost[:, None]
        back = np.any(inward, axis=1)
        if np.any(back):
            self.limits[inward] = 0
            self._condense(back)
        return back

    def _release(self, arrived) -> np.ndarray:
        """Take back elements whose cost falls inwards now that the others have moved."""
        active, back = self.problem.active, np.zeros(len(arrived), bool)
        for f in np.flatnonzero(arrived & np.any(self.limits != 0, axis=1)):
            places = []
            for k in np.flatnonzero(self.limits[f]):
                for part in (0.0, 0.5, 0.8):
                    inner = self.start[f, k] + part * (self.x[f, k] - self.start[f, k])
                    places.append(np.array(self.z[f]))
                    places[-1][active[k]] = np.clip(inner, self.lower[f, k], self.upper[f, k])
            self.evaluations += len(places)
            lanes = self.lanes.some(np.full(len(places), f))
            cost = self.problem.linearise(np.array(places), lanes, slopes=False).cost
            best = int(np.argmin(cost))
            if cost[best] < self.at.cost[f] * (1 - FALLS):
                self.z[f], back[f], self.limits[f] = places[best], True, 0
                self.released[f] += 1
        if np.any(back):
            self._put(back, self._at(self.z, back))
            self._condense(back)
        return back

    def _stop(self, fits, reason: str) -> None:
        self.reason[fits & self.going] = reason

    def result(self) -> Found:
        return Found(
            z=self.z,
            cost=self.at.cost,
            gradient_norm=np.linalg.norm(self.at.gradient, axis=1),
            converged=np.isin(self.reason, ARRIVED),
            reason=self.reason,
            limits=np.where(self.edge, 0, self.limits),
            begun=self.begun,
            iterations=self.iterations,
            evaluations=self.evaluations,
        )


def search(
    problem: Problem,
    z: Float[np.ndarray, "fits elements"],
    optimiser: str = "levenberg-marquardt",
    *,
    begun: Float[np.ndarray, "... elements"] | None = None,
    held: Bool[np.ndarray, "fits p"] | None = None,
    lanes: Lanes | None = None,
    limit: int = MOST,
    releases: int = RELEASES,
) -> Found:
    """Minimise from each z.

    Args:
        optimiser: of `OPTIMISERS`.
        begun: from where it is measured whether an element runs to an end of its range, NaN: from
            its z. What is there already when the search starts is held there.
        held: active elements that stay as they are, fit by fit.
        lanes: what differs between fits.
        limit: of the steps.
        releases: how often an element is taken back from the end of its range.
    """
    z = np.array(np.atleast_2d(z), float)
    lanes = lanes or Lanes()
    if optimiser == "adam":
        z = _by_adam(problem, z, lanes)
    state = _Search(problem, z, np.nan if begun is None else begun, held, lanes, limit, releases)
    state.evaluations += len(z) * ADAM_STEPS * (optimiser == "adam")
    if len(problem.active):
        fits, p = state.start.shape
        state.run(Marquardt(fits, p) if optimiser == "levenberg-marquardt" else Lbfgs(fits, p))
    else:
        state._stop(np.ones(len(z), bool), ARRIVED[0])
    return state.result()


def guided_search(
    problem: Problem,
    z: Float[np.ndarray, "fits elements"],
    optimiser: str,
    *,
    lanes: Lanes | None = None,
    limit: int = MOST,
) -> Found:
    """A search with ε continued to where nothing rebounds, which leads back from there.

    Where some points do not rebound the law's own ε is then searched, from the ends and from the
    starts: the cost that is found is always that of the law's own ε.
    """
    lanes = lanes or Lanes()
    found = search(replace(problem, guided=True), z, optimiser, lanes=lanes, limit=limit)
    twice = lanes.some(np.tile(np.arange(len(z)), 2))
    places = np.concatenate([found.z, z])
    least = np.min(problem.linearise(places, twice, slopes=False).prediction, initial=1.0)
    if least > TINY_SQUARED**0.5:
        return found
    # √ bends sharply where a point hardly rebounds: damped steps find their way there
    begun = np.concatenate([found.begun, z])
    again = search(problem, places, begun=begun, lanes=twice, limit=3 * limit)
    lower = again.cost[: len(z)] <= again.cost[len(z) :]
    best = again.some(np.where(lower, 0, len(z)) + np.arange(len(z)))
    return best._replace(evaluations=found.evaluations + again.evaluations)


def _by_adam(problem: Problem, z, lanes: Lanes) -> np.ndarray:
    """The best that Adam meets, in units of each element's own size."""
    x = z[:, problem.active]
    plain = problem.transform.kind[problem.active] == NONE
    unit = np.where(plain, np.abs(x) + 1e-3, 1.0)
    begin, update = _adam()
    state = begin(x)
    best, lowest = np.array(z), np.full(len(z), np.inf)
    for _ in range(ADAM_STEPS):
        found = problem.linearise(z, lanes)
        better = found.cost < lowest
        best[better], lowest[better] = z[better], found.cost[better]
        change, state = update(unit * found.gradient, state)
        z = np.array(z)
        z[:, problem.active] += unit * np.asarray(change)
    return best
