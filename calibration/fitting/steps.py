"""Steps of a search: Levenberg–Marquardt, and L-BFGS and Adam by optax, for batches of fits.

Residuals and Jacobian of each fit are condensed to a triangle. A method proposes a direction for the
fits that need one, and learns which of them have moved (`taken`: by a whole step or a shortened one, and
by how much the cost fell over what the linear model promised) and whose step raised the cost (`refused`:
which of them want another direction, not a shorter step); `stuck` are those that no direction helps. The
loop that tries the steps, `search`, is the same for all."""

from functools import lru_cache, partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from softjax.batching import QUICK, accepted

TINY = 1e-150  # a column so short that its square underflows is none
SEEN = 1e-10  # singular values, columns scaled to one, below which a direction is not seen
SILENT = 1e-9  # a column of the Jacobian so small against the residuals acts on nothing
ROUNDED = 1e-10  # of the strongest element, below which the effect of one is rounding


class Condensed(NamedTuple):
    """J = Q R with the columns of R scaled to one, R = U S Vᵀ, of each fit."""

    cost: Float[np.ndarray, "fits"]  # what is minimised
    gradient: Float[np.ndarray, "fits p"]  # Jᵀ r
    size: Float[np.ndarray, "fits p"]  # lengths of the columns of J, 1 where there is none
    singular: Float[np.ndarray, "fits p"]  # S in falling order, and V (p, p)
    directions: Float[np.ndarray, "fits p p"]
    along: Float[np.ndarray, "fits p"]  # Uᵀ Qᵀ r
    silent: Bool[np.ndarray, "fits p"]  # columns that act on nothing
    finite: Bool[np.ndarray, "fits"]  # whether residuals and Jacobian are numbers

    @property
    def seen(self) -> Bool[np.ndarray, "fits p"]:
        """Directions that the residuals move with."""
        return self.singular > SEEN * np.maximum(self.singular[:, :1], TINY)

    def whitening(self, damping: Float[np.ndarray, "fits"]) -> Float[np.ndarray, "fits p p"]:
        """T with Tᵀ (JᵀJ + damping) T = 1; columns of directions that are not seen are zero."""
        largest = self.singular[:, :1]
        damped = np.sqrt(self.singular**2 + damping[:, None] * largest**2)
        per = np.where(self.seen, 1 / np.where(self.seen, damped, 1.0), 0.0)
        return self.directions * per[:, None, :] / self.size[:, :, None]

    @property
    def newton(self) -> Float[np.ndarray, "fits p"]:
        """The Gauss–Newton step that is left, without the directions that are not seen."""
        part = np.where(self.seen, self.along / np.where(self.seen, self.singular, 1.0), 0.0)
        return -np.einsum("fij,fj->fi", self.directions, part) / self.size

    @property
    def promised(self) -> Float[np.ndarray, "fits"]:
        """Predicted decrease of the sum of squares."""
        return np.sum(np.where(self.seen, self.along, 0.0) ** 2, axis=1)

    def fall(self, step: Float[np.ndarray, "fits p"]) -> Float[np.ndarray, "fits"]:
        """Decrease of the cost if residuals were linear."""
        moved = self.singular * np.einsum("fij,fi->fj", self.directions, self.size * step)
        return -np.einsum("fp,fp->f", self.gradient, step) - 0.5 * np.sum(moved**2, axis=1)

    def replaced(self, fits: Bool[np.ndarray, "fits"], by: "Condensed") -> "Condensed":
        """A copy with some fits taken from `by`."""
        parts = [np.array(a) for a in self]
        for part, new in zip(parts, by, strict=True):
            part[fits] = new
        return Condensed(*parts)


def acts_on_nothing(
    jacobian: Float[np.ndarray, "fits m p"], size: Float[np.ndarray, "fits p"]
) -> Bool[np.ndarray, "fits p"]:
    """Elements whose columns are rounding, for changes of `size`; none where `size` is 0."""
    acts = np.linalg.norm(jacobian, axis=1) * size
    return (size > 0) & (acts <= ROUNDED * np.max(acts, axis=1, keepdims=True, initial=0.0))


def condense(
    residual: Float[np.ndarray, "fits m"],
    jacobian: Float[np.ndarray, "fits m p"],
    held: Bool[np.ndarray, "fits p"] | None = None,
    cost: Float[np.ndarray, "fits"] | None = None,
) -> Condensed:
    """Condense each fit; columns of fixed elements count as zero. Default cost: ½ rᵀ r."""
    finite = np.all(np.isfinite(residual), 1) & np.all(np.isfinite(jacobian), (1, 2))
    residual = np.where(finite[:, None], residual, 0.0)
    jacobian = np.where(finite[:, None, None], jacobian, 0.0)
    if held is not None:
        jacobian = np.where(held[:, None, :], 0.0, jacobian)
    p = jacobian.shape[2]
    length = np.sqrt(np.einsum("fmp,fmp->fp", jacobian, jacobian))
    norm = np.sqrt(np.einsum("fm,fm->f", residual, residual))
    acts = length > TINY
    size = np.where(acts, length, 1.0)
    scaled = np.where(acts[:, None, :], jacobian / size[:, None, :], 0.0)
    joined = np.concatenate([scaled, residual[:, :, None]], axis=2)
    missing = max(p + 1 - joined.shape[1], 0)  # fewer residuals than parameters
    joined = np.pad(joined, ((0, 0), (0, missing), (0, 0)))
    triangle: np.ndarray = np.asarray(np.linalg.qr(joined, mode="r"))
    left, singular, right = np.linalg.svd(triangle[:, :p, :p])
    along = np.einsum("fji,fj->fi", left, triangle[:, :p, p])
    directions = np.swapaxes(right, 1, 2)
    gradient = size * np.einsum("fij,fj->fi", directions, singular * along)
    cost = np.where(finite, 0.5 * norm**2 if cost is None else cost, np.inf)
    silent = length <= SILENT * norm[:, None]
    return Condensed(cost, gradient, size, singular, directions, along, silent, finite)


Fits = Bool[np.ndarray, "fits"]
Numbers = Float[np.ndarray, "fits"]
Steps = Float[np.ndarray, "fits p"]
SOONEST = (*QUICK, ("xla_backend_optimization_level", 0))  # a quarter of the time to compile
OPTIMISERS = {
    "l-bfgs": "optax L-BFGS",
    "adam": "optax Adam, then L-BFGS",
    "levenberg-marquardt": "Levenberg–Marquardt",
}


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
        along = at.along * at.singular / (at.singular**2 + 1 / self.size[:, None])
        step = -np.einsum("fij,fj->fi", at.directions, along) / at.size
        self.direction = np.where(need[:, None], step, self.direction)
        return self.direction

    def taken(self, fits: Fits, whole: Fits, gain: Numbers) -> None:
        factor = np.maximum(1 / self.GROWTH, 1 - (2 * np.clip(gain, 0.0, 1.0) - 1) ** 3)
        grown = np.minimum(self.size / factor, self.LARGEST)
        self.size = np.where(fits, grown, self.size)
        self.fall = np.where(fits, 2.0, self.fall)

    def refused(self, fits: Fits) -> Fits:
        self.size = np.where(fits, self.size / self.fall, self.size)
        self.fall = np.where(fits, 2 * self.fall, self.fall)
        return fits

    def stuck(self) -> Fits:
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
        self.memory = _lbfgs_tools()[0](np.zeros((_many(fits), _sized(p, 8))))

    def propose(self, need: Fits, z: Steps, at: Condensed) -> Steps:
        renewed = need & (self.age % self.PERIOD == 0)
        if np.any(renewed):
            basis = at.whitening(self.damping)
            self.basis = np.where(renewed[:, None, None], basis, self.basis)
            self.inverse = np.linalg.pinv(self.basis)
        white = np.einsum("fij,fi->fj", self.basis, at.gradient)
        place = np.einsum("fij,fj->fi", self.inverse, z)
        update, self.memory = _lbfgs(self.memory, white, place, need, renewed)
        direction = -np.einsum("fij,fj->fi", self.basis, update)
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


def _sized(count: int, least: int, ratio: int = 2) -> int:
    """Sizes are rounded up to powers of some ratio, so that few of them are compiled."""
    while least < count:
        least *= ratio
    return least


def _many(fits: int) -> int:
    """Fits side by side cost little: still fewer sizes."""
    return _sized(fits, 8, 8)


def _filled(array: np.ndarray, *sizes: int) -> np.ndarray:
    widths = [(0, size - n) for size, n in zip(sizes, array.shape, strict=False)]
    return np.pad(array, widths + [(0, 0)] * (array.ndim - len(widths)))


@lru_cache
def _lbfgs_tools():
    import optax

    tool = optax.scale_by_lbfgs(memory_size=10, scale_init_precond=False)

    @partial(jax.jit, compiler_options=accepted(SOONEST))
    def update(memory, gradient, place, need, renewed):
        empty = jax.vmap(tool.init)(jnp.zeros_like(gradient))
        chosen = _where(renewed, empty, memory)
        step, after = jax.vmap(tool.update)(gradient, chosen, place)
        return step, _where(need, after, chosen)

    return jax.jit(jax.vmap(tool.init)), update


def _where(fits, yes, no):
    """One tree or the other, fit by fit."""
    pick = lambda a, b: jnp.where(fits.reshape(-1, *(1,) * (a.ndim - 1)), a, b)  # noqa: E731
    return jax.tree.map(pick, yes, no)


def _lbfgs(memory, gradient, place, need, renewed):
    fits, p = gradient.shape
    sizes = _many(fits), _sized(p, 8)
    flags = (_filled(a, sizes[0]) for a in (need, renewed))
    arrays = (_filled(a, *sizes) for a in (gradient, place))
    step, memory = _lbfgs_tools()[1](memory, *arrays, *flags)
    return np.asarray(step)[:fits, :p], memory


ADAM_STEPS = 200


@lru_cache
def adam():
    """optax's Adam with a cosine schedule: what starts it, and what steps."""
    import optax

    tool = optax.adam(optax.cosine_decay_schedule(0.1, ADAM_STEPS))
    return tool.init, jax.jit(tool.update)
