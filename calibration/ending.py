"""When a search has arrived, and what it says when it stops."""

from dataclasses import dataclass

import numpy as np

from calibration.parameters import LOGIT, NONE
from calibration.problem import Problem

STEP_TOLERANCE = 1e-9  # of the Gauss–Newton step left, in log units for most parameters
COST_TOLERANCE = 1e-15  # of the decrease it promises, relative to the cost
SILENT = 1e-9  # a column of the Jacobian so small against the residuals acts on nothing
FARTHEST = 25.0  # from the start, in log units
NEARLY = 6.0  # and where nothing moves any more
TINY = 1e-150  # a column so short that its square underflows is none
ARRIVED = ("step below tolerance", "cost at its minimum")
RAN_AWAY = "a parameter runs away to its limit"
SILENCE = "the residuals do not move with every parameter"


@dataclass(frozen=True)
class Search:
    """Where a search ended and how it got there.

    Attributes:
        z: the searched elements.
        cost: half the sum of squares.
        gradient_norm: of the cost, in z.
        evaluations, iterations: how many it took.
        converged, reason: whether and why it stopped.
        limits: positions (in all of z) of elements held at an end of their range.
    """

    z: np.ndarray
    cost: float
    gradient_norm: float
    evaluations: int
    iterations: int
    converged: bool
    reason: str
    limits: tuple[int, ...] = ()


def ended(problem, z, value, gradient, iterations, reason) -> Search:
    norm = float(np.linalg.norm(gradient))
    cost = 0.5 * float(value @ value)
    evaluations = problem.counter.evaluations
    return Search(z, cost, norm, evaluations, iterations, reason in ARRIVED, reason)


def verdict_of(value, jacobian, gradient, tolerance: float = STEP_TOLERANCE) -> str:
    """Why to stop, or nothing."""
    if not np.all(np.isfinite(jacobian)) or not np.all(np.isfinite(value)):
        return "residuals are not finite"
    basis = whitening(jacobian)
    left = basis.T @ gradient
    small = np.max(np.abs(basis @ left), initial=0.0) <= tolerance
    if not small and left @ left > COST_TOLERANCE * (value @ value):
        return ""
    silent = np.linalg.norm(jacobian, axis=0) <= SILENT * np.linalg.norm(value)
    if np.any(silent):
        return SILENCE
    return "step below tolerance" if small else "cost at its minimum"


def whitening(jacobian, damping: float = 0.0) -> np.ndarray:
    """T with Tᵀ (JᵀJ + damping) T = 1; directions that the data do not see are left out."""
    size = np.linalg.norm(jacobian, axis=0)
    acts = size > TINY
    size = np.where(acts, size, 1.0)
    _, singular, directions = np.linalg.svd(np.where(acts, jacobian, 0) / size, full_matrices=False)
    largest = max(singular[0], 1e-300) if len(singular) else 1.0
    seen = singular > 1e-10 * largest
    damped = np.sqrt(singular**2 + damping * largest**2)
    return (directions[seen].T / damped[seen]) / size[:, None]


def ran_away(problem: Problem, start, z, distance: float = FARTHEST) -> np.ndarray:
    """Which elements on a logarithmic or logit scale left every sensible value behind."""
    scaled = problem.layout.kind[problem.active] != NONE
    return scaled & (np.abs(z - start) > distance)


def at_limit(problem: Problem, start, found: Search) -> np.ndarray:
    """Which elements ended at an end of their range that a fit can be at.

    A bound, zero, or for σ and ψ infinity too: only together they mean something, and where they
    cannot be told apart both may grow. Anything else that grows without bound has no estimate.
    """
    distance = NEARLY if found.reason == SILENCE else FARTHEST
    gone = ran_away(problem, start, found.z, distance)
    bounded = (problem.layout.kind[problem.active] == LOGIT) | (found.z < start)
    return gone & (bounded | np.isin(problem.names, ("sigma", "psi")))
