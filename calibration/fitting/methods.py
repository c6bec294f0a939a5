"""Least squares by QR factors, and what proposes a direction from them: Levenberg–Marquardt, or optax's methods.

The Jacobian of each fit is factorised once; a method sees nothing else of a problem.
"""

import math
from functools import lru_cache, partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from softjax.compiling import SOONEST, accepted

TINY = 1e-150  # a column so short that its square underflows is none
SEEN = 1e-10  # singular values, columns scaled to one, below which a direction is not seen
SILENT = 1e-9  # a column of the Jacobian so small against the residuals acts on nothing

Fits = Bool[np.ndarray, "fits"]
Numbers = Float[np.ndarray, "fits"]
Steps = Float[np.ndarray, "fits p"]


class QRFactors(NamedTuple):
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
        per = self.seen / np.where(self.seen, damped, 1.0)
        return self.directions * per[:, None, :] / self.size[:, :, None]

    @property
    def newton(self) -> Steps:
        """The Gauss–Newton step that is left, without the directions that are not seen."""
        part = self.along * self.seen / np.where(self.seen, self.singular, 1.0)
        return -np.einsum("fij,fj->fi", self.directions, part) / self.size

    @property
    def promised(self) -> Numbers:
        """Predicted decrease of the sum of squares."""
        return np.sum(np.where(self.seen, self.along, 0.0) ** 2, axis=1)

    def fall(self, step: Steps) -> Numbers:
        """Decrease of the cost if residuals were linear."""
        moved = self.singular * np.einsum("fij,fi->fj", self.directions, self.size * step)
        return -np.einsum("fp,fp->f", self.gradient, step) - 0.5 * np.sum(moved**2, axis=1)


def factorise(residual, jacobian, fixed=None, cost: Numbers | None = None) -> QRFactors:
    """Factorise the Jacobian of each fit; columns of fixed elements count as zero. Default cost: ½ rᵀ r."""
    finite = np.all(np.isfinite(residual), 1) & np.all(np.isfinite(jacobian), (1, 2))
    residual = np.where(finite[:, None], residual, 0.0)
    zero = ~finite[:, None] if fixed is None else fixed | ~finite[:, None]
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
    return QRFactors(cost, gradient, size, singular, directions, along, silent, finite)


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

    def propose(self, need: Fits, z: Steps, at: QRFactors) -> Steps:
        """A direction for the fits that need one."""
        along = at.along * at.singular / (at.singular**2 + 1 / self.size[:, None])
        step = -np.einsum("fij,fj->fi", at.directions, along) / at.size
        self.direction = np.where(need[:, None], step, self.direction)
        return self.direction

    def taken(self, fits: Fits, full_step: Fits, gain: Numbers) -> None:
        """Fits that moved, by a full step or a shortened one; the fall of the cost over that promised."""
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
        """Fits that no direction helps."""
        return self.size < self.SMALLEST


class Lbfgs:
    """optax's L-BFGS in variables in which the damped Gauss–Newton matrix is one, restarted at times.

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

    def propose(self, need: Fits, z: Steps, at: QRFactors) -> Steps:
        restarted = need & (self.age % self.PERIOD == 0)
        if np.any(restarted):
            basis = at.whitening(self.damping)
            self.basis = np.where(restarted[:, None, None], basis, self.basis)
            self.inverse = np.linalg.pinv(self.basis)
        white = np.einsum("fij,fi->fj", self.basis, at.gradient)
        place = np.einsum("fij,fj->fi", self.inverse, z)
        fits, p = z.shape
        sizes = _sized(fits, p)
        padded = []
        for values in (white, place, need, restarted):
            padded.append(np.zeros(sizes[: values.ndim], values.dtype))
            padded[-1][tuple(map(slice, values.shape))] = values
        update, self.memory = _lbfgs_tools()[1](self.memory, *padded)
        direction = -np.einsum("fij,fj->fi", self.basis, np.asarray(update)[:fits, :p])
        uphill = np.einsum("fi,fi->f", direction, at.gradient) >= 0
        steepest = -np.einsum("fij,fj->fi", self.basis, white)
        direction = np.where(uphill[:, None], steepest, direction)
        self.direction = np.where(need[:, None], direction, self.direction)
        self.age += need
        self.shortened[need] = 0
        return self.direction

    def taken(self, fits: Fits, full_step: Fits, gain: Numbers) -> None:
        self.damping = np.where(fits & full_step, self.damping * 0.2, self.damping)
        self._damp(fits & ~full_step)

    def refused(self, fits: Fits) -> Fits:
        self.shortened += fits
        exhausted = fits & (self.shortened >= self.SHORTER)
        self.exhausted |= exhausted & (self.damping >= self.LARGEST_DAMPING)
        self._damp(exhausted)
        return exhausted

    def stuck(self) -> Fits:
        return self.exhausted

    def _damp(self, fits: Fits) -> None:
        raised = np.minimum(self.damping * 10, self.LARGEST_DAMPING)
        self.damping = np.where(fits, raised, self.damping)
        self.age = np.where(fits, 0, self.age)


def _sized(fits: int, p: int) -> tuple[int, int]:
    """Sizes rounded up to powers of four and two, so that few of them are compiled."""
    return max(16, 4 ** math.ceil(math.log(fits, 4) - 1e-9)), max(8, 2 ** (p - 1).bit_length())


@lru_cache
def _lbfgs_tools():
    import optax

    tool = optax.scale_by_lbfgs(memory_size=10, scale_init_precond=False)

    def where(fits, yes, no):
        pick = lambda a, b: jnp.where(fits.reshape(-1, *(1,) * (a.ndim - 1)), a, b)  # noqa: E731
        return jax.tree.map(pick, yes, no)

    @partial(jax.jit, compiler_options=accepted(SOONEST))
    def update(memory, gradient, place, need, restarted):
        empty = jax.vmap(tool.init)(jnp.zeros_like(gradient))
        chosen = where(restarted, empty, memory)
        step, after = jax.vmap(tool.update)(gradient, chosen, place)
        return step, where(need, after, chosen)

    return jax.jit(jax.vmap(tool.init)), update
