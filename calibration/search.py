"""The optimisers: optax L-BFGS and Adam, optimistix Levenberg–Marquardt, one result for all."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import jax
import jax.numpy as jnp
import numpy as np

from calibration import objective
from calibration.objective import KINDS
from calibration.parameters import NONE
from calibration.problem import Problem

OPTIMISERS = {
    "l-bfgs": "optax L-BFGS",
    "adam": "optax Adam, then L-BFGS",
    "levenberg-marquardt": "optimistix Levenberg–Marquardt",
}
MAX_ITERATIONS = 200
ADAM_STEPS = 200
STEP_TOLERANCE = 1e-9  # of the Gauss–Newton step left, in log units for most parameters
COST_TOLERANCE = 1e-15  # of the decrease it promises, relative to the cost
LARGEST_STEP = 1.5  # in log units
PERIOD = 6  # steps between two preconditionings
SILENT = 1e-9  # a column of the Jacobian so small against the residuals acts on nothing
FIRST_DAMPING, LARGEST_DAMPING = 1e-2, 1e6  # of the Gauss–Newton matrix with unit diagonal
FARTHEST = 25.0  # from the start, in log units
ROUNDING = 1e-13  # of a cost: near its minimum steps are judged by the gradient alone
BRANCH_ROUNDS = 10


@dataclass(frozen=True)
class Search:
    """Where a search ended and how it got there; z: the searched elements."""

    z: np.ndarray
    cost: float  # half the sum of squares
    gradient_norm: float  # of the cost, in z
    evaluations: int
    iterations: int
    converged: bool
    reason: str


def search(
    problem: Problem,
    z,
    optimiser: str = "l-bfgs",
    step: Callable | None = None,
    limit: int = MAX_ITERATIONS,
) -> Search:
    """Minimise from z; `step(cost)` is called after every iteration."""
    problem.counter.evaluations = 0
    if optimiser == "levenberg-marquardt":
        return _levenberg_marquardt(problem, z, limit)
    if optimiser == "adam":
        z = _adam(problem, z, step)
    found = _lbfgs(problem, z, step, limit)
    extra = ADAM_STEPS if optimiser == "adam" else 0
    return replace(found, iterations=found.iterations + extra)


def search_with_branches(problem: Problem, z, optimiser: str, step=None, limit=MAX_ITERATIONS):
    """As `search`, with the elastic points held during a search and looked at again after it.

    A yield strength or modulus that is free moves points across y = 1, where the cost jumps.
    Returns the search, its problem, and how many points changed branch since the start.
    """
    first = problem.obs.elastic
    total = 0
    for _ in range(BRANCH_ROUNDS):
        found = search(problem, z, optimiser, step, limit)
        total += found.evaluations
        z = found.z
        elastic = problem.elastic_at(problem.full(z))
        if problem.kind != "model" or np.array_equal(elastic, problem.obs.elastic):
            changed = int(np.sum((elastic != first) & (problem.obs.weight > 0)))
            return replace(found, evaluations=total), problem, changed
        problem = problem.with_elastic(elastic)
    changed = int(np.sum((elastic != first) & (problem.obs.weight > 0)))
    stuck = "points keep crossing the critical velocity"
    return replace(found, evaluations=total, converged=False, reason=stuck), problem, changed


def _lbfgs(problem: Problem, z, step, limit) -> Search:
    """L-BFGS in variables in which the damped Gauss–Newton matrix is one, renewed now and then.

    That makes its first step Levenberg's and leaves what the curvature of the residuals changes to
    L-BFGS's memory. Far from a minimum the damping grows with every step that had to be shortened.
    """
    start = z = np.array(z, float)
    value, jacobian = problem.linearise(z)
    damping, age = FIRST_DAMPING, 0
    for iteration in range(limit):
        gradient = jacobian.T @ value
        verdict = _verdict(value, jacobian, gradient) or _ran_away(z, start, problem)
        if verdict:
            return _ended(problem, z, value, gradient, iteration, verdict)
        if age % PERIOD == 0:
            basis = _whitening(jacobian, damping)
            memory = _lbfgs_memory(_padded(basis.shape[1]))
        direction, memory = _lbfgs_direction(basis.T @ gradient, memory, basis, z)
        if gradient @ direction >= 0:
            direction = -basis @ (basis.T @ gradient)
        moved, length = _backtrack(problem, z, value, gradient, direction)
        age += 1
        if length < 1:
            damping, age = min(damping * 10, LARGEST_DAMPING), 0
        else:
            damping *= 0.2
        if moved is not None:
            z, value, jacobian = moved
        elif damping >= LARGEST_DAMPING:
            return _ended(problem, z, value, gradient, iteration, "no lower cost found")
        if step:
            step(0.5 * float(value @ value))
    gradient = jacobian.T @ value
    return _ended(problem, z, value, gradient, limit, "iterations used up")


def _ran_away(z, start, problem) -> str:
    """A parameter on a logarithmic or logit scale that left every sensible value behind."""
    scaled = problem.layout.kind[problem.active] != NONE
    far = scaled & (np.abs(z - start) > FARTHEST)
    return "a parameter runs away to its limit" if np.any(far) else ""


def _ended(problem, z, value, gradient, iterations, reason) -> Search:
    converged = reason in ("step below tolerance", "cost at its minimum")
    norm = float(np.linalg.norm(gradient))
    cost = 0.5 * float(value @ value)
    evaluations = problem.counter.evaluations
    return Search(z, cost, norm, evaluations, iterations, converged, reason)


def _verdict(value, jacobian, gradient, tolerance: float = STEP_TOLERANCE) -> str:
    """Why to stop, or nothing."""
    if not np.all(np.isfinite(jacobian)) or not np.all(np.isfinite(value)):
        return "residuals are not finite"
    basis = _whitening(jacobian)
    left = basis.T @ gradient
    small = np.max(np.abs(basis @ left), initial=0.0) <= tolerance
    if not small and left @ left > COST_TOLERANCE * (value @ value):
        return ""
    silent = np.linalg.norm(jacobian, axis=0) <= SILENT * np.linalg.norm(value)
    if np.any(silent):
        return "the residuals do not move with every parameter"
    return "step below tolerance" if small else "cost at its minimum"


def _whitening(jacobian, damping: float = 0.0) -> np.ndarray:
    """T with Tᵀ (JᵀJ + damping) T = 1; directions that the data do not see are left out."""
    size = np.linalg.norm(jacobian, axis=0)
    size = np.where(size > 0, size, 1.0)
    _, singular, directions = np.linalg.svd(jacobian / size, full_matrices=False)
    largest = max(singular[0], 1e-300) if len(singular) else 1.0
    seen = singular > 1e-10 * largest
    damped = np.sqrt(singular**2 + damping * largest**2)
    return (directions[seen].T / damped[seen]) / size[:, None]


def _backtrack(problem, z, value, gradient, direction):
    """The first of ever shorter steps that lowers the cost enough (Armijo), and its length.

    None, 0 where there is none.
    """
    cost = 0.5 * float(value @ value)
    plain = problem.layout.kind[problem.active] == NONE
    unit = np.where(plain, np.maximum(np.abs(z), 1.0), 1.0)
    longest = np.max(np.abs(direction) / unit, initial=0.0)
    length = min(1.0, LARGEST_STEP / max(longest, 1e-300))
    for _ in range(8):
        trial = z + length * direction
        new_value, new_jacobian = problem.linearise(trial)
        new_cost = 0.5 * float(new_value @ new_value)
        if new_cost <= cost * (1 + ROUNDING) + 1e-4 * length * float(gradient @ direction):
            return (trial, new_value, new_jacobian), length
        length *= 0.25
    return None, 0.0


def _padded(count: int) -> int:
    """Sizes are rounded up, so that few of them are compiled."""
    return 8 * -(-count // 8)


@lru_cache
def _lbfgs_tools():
    import optax

    tool = optax.scale_by_lbfgs(memory_size=10, scale_init_precond=False)
    return tool, jax.jit(tool.update)


def _lbfgs_memory(size: int):
    return _lbfgs_tools()[0].init(jnp.zeros(size))


def _lbfgs_direction(gradient, memory, basis, z):
    """The step in z, from the gradient in the whitened variables u, z = z_0 + basis u."""
    size = _padded(len(gradient))
    pad = lambda a: np.concatenate([a, np.zeros(size - len(a))])  # noqa: E731
    place = pad(np.linalg.lstsq(basis, z, rcond=None)[0])
    update, memory = _lbfgs_tools()[1](pad(gradient), memory, place)
    return -basis @ np.asarray(update)[: len(gradient)], memory


@lru_cache
def _adam_tools():
    import optax

    schedule = optax.cosine_decay_schedule(0.1, ADAM_STEPS)
    tool = optax.adam(schedule)
    return tool, jax.jit(tool.update)


def _adam(problem: Problem, z, step) -> np.ndarray:
    """Adam with a cosine schedule, in units of each parameter's own size."""
    tool, update = _adam_tools()
    z = np.array(z, float)
    size = np.where(problem.layout.kind[problem.active] == 2, np.abs(z) + 1e-3, 1.0)
    padded = _padded(len(z))
    state = tool.init(jnp.zeros(padded))
    best, lowest = z, np.inf
    for _ in range(ADAM_STEPS):
        value, jacobian = problem.linearise(z)
        cost = 0.5 * float(value @ value)
        best, lowest = (z, cost) if cost < lowest else (best, lowest)
        gradient = np.concatenate([size * (jacobian.T @ value), np.zeros(padded - len(z))])
        change, state = update(gradient, state)
        z = z + size * np.asarray(change)[: len(z)]
        if step:
            step(cost)
    return best


def _levenberg_marquardt(problem: Problem, z, limit) -> Search:
    """The whole search compiled at once, collisions included."""
    searched = np.zeros(len(problem.base))
    searched[problem.active] = 1.0
    found, solved, steps = _compiled_marquardt(
        problem.full(z),
        searched,
        problem.layout,
        problem.obs,
        problem.noise,
        limit,
        KINDS.index(problem.kind),
        free=problem.free or ("chi",),  # all stages of a plain fit are one compilation
        model=problem.model,
        loss=problem.loss,
    )
    z = np.asarray(found)[problem.active]
    value, jacobian = problem.linearise(z)
    gradient = jacobian.T @ value
    reason = _verdict(value, jacobian, gradient, 1e-7) or (
        "stopped short of a minimum" if bool(solved) else "iterations used up"
    )
    ended = _ended(problem, z, value, gradient, int(steps), reason)
    return replace(ended, evaluations=int(steps) + 1)


@partial(jax.jit, static_argnames=("limit", "free", "model", "loss"))
def _compiled_marquardt(start, searched, layout, obs, noise, limit, kind, free, model, loss):
    """From `start`, along the elements that are `searched` (1 or 0; the damping bears the rest)."""
    import optimistix as optx

    def plastic(columns):
        return objective.plastic_squared(objective.only_free(columns, free), obs, model)

    def f(z, _):
        z = start + searched * (z - start)
        return objective.residuals(z, layout, obs, noise, plastic, model, kind, loss)[0]

    solver = optx.LevenbergMarquardt(rtol=1e-11, atol=1e-14)
    result = optx.least_squares(f, solver, start, max_steps=limit, throw=False)
    solved = result.result == optx.RESULTS.successful
    return result.value, solved, result.stats["num_steps"]
