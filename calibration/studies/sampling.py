"""A model at many samples, in memory that their number hardly changes; Saltelli's estimates of it."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

LARGEST_BLOCK = 1 << 13  # samples evaluated at once
RESAMPLED = 32  # bootstrap samples drawn at once

Model = Callable[[Mapping[str, Array]], Any]
Progress = Callable[[str, int, int], None]
Outputs = Float[np.ndarray, "q n"]


@dataclass
class Sampled:
    """A model over many samples, in blocks of one shape."""

    model: Model
    names: tuple[str, ...]
    scale: str
    total: int
    progress: Progress | None
    done: int = 0

    def values(self, points: Float[np.ndarray, "p n"]) -> Outputs:
        return np.concatenate([np.asarray(_outputs(*a)) for a in self._blocks(points)], axis=1)

    def with_slopes(self, points: Float[np.ndarray, "p n"]) -> tuple[Outputs, np.ndarray]:
        """Outputs, and E[(∂f/∂θ)²] (q, p), or with ln θ on a logarithmic scale."""
        outputs, squares = [], 0.0
        for block in self._blocks(points):
            output, slopes = map(np.asarray, _slopes(*block))
            per = block[-1].T if self.scale == "log" else 1.0
            outputs.append(output)
            squares = squares + np.sum((slopes * per) ** 2, axis=1)
        return np.concatenate(outputs, axis=1), squares / points.shape[1]

    def _blocks(self, points) -> Iterator[tuple[Any, ...]]:
        for first in range(0, points.shape[1], LARGEST_BLOCK):
            block = points[:, first : first + LARGEST_BLOCK]
            yield self.model, self.names, block
            self.done += block.shape[1]
            if self.progress is not None:
                self.progress("Sobol indices", self.done, self.total)


@eqx.filter_jit
def _outputs(model: Model, names: tuple[str, ...], points):
    """(q, n)."""
    one = lambda x: jnp.atleast_1d(model(dict(zip(names, x, strict=True))))  # noqa: E731
    return jax.vmap(one, in_axes=1, out_axes=1)(points)


@eqx.filter_jit
def _slopes(model: Model, names: tuple[str, ...], points):
    """Outputs (q, n) and derivatives (q, n, p)."""

    def one(x):
        def outputs(x):
            y = jnp.atleast_1d(model(dict(zip(names, x, strict=True))))
            return y, y

        slope, y = jax.jacfwd(outputs, has_aux=True)(x)
        return y, slope

    return jax.vmap(one, in_axes=1, out_axes=1)(points)


def percentiles(f_a, f_b, f_ab, confidence: float, resamples: int, random) -> list[np.ndarray]:
    """Bootstrap limits of both indices, (q, p) each: low and high of the first, then of the total.

    Both are ratios of means over the samples, so that a resample is no more than how often each
    sample is drawn.
    """
    n, p = f_a.shape[1], len(f_ab)
    drawn = []
    for first in range(0, resamples, RESAMPLED):
        rows = min(RESAMPLED, resamples - first)
        counts = [np.bincount(random.integers(0, n, n), minlength=n) for _ in range(rows)]
        drawn.append(indices(np.array(counts, float) / n, f_a, f_b, f_ab))
    part = [0.5 * (1 - confidence), 0.5 * (1 + confidence)]
    low, high = np.quantile(np.concatenate(drawn, axis=1), part, axis=1)
    return [low[:, :p], high[:, :p], low[:, p:], high[:, p:]]


def indices(share: np.ndarray, f_a, f_b, f_ab) -> Float[np.ndarray, "q resamples both"]:
    """Saltelli's estimates of first-order and total indices by the weight of each sample."""
    return np.stack(
        [_of_output(share, *one) for one in zip(f_a, f_b, np.swapaxes(f_ab, 0, 1), strict=True)]
    )


def _of_output(share: np.ndarray, a: np.ndarray, b: np.ndarray, ab: np.ndarray) -> np.ndarray:
    centre = 0.5 * (np.mean(a) + np.mean(b))
    a, b, ab = a - centre, b - centre, ab - centre
    variance = 0.5 * share @ (a**2 + b**2) - (0.5 * share @ (a + b)) ** 2
    both = np.concatenate([b * (ab - a), 0.5 * (a - ab) ** 2])
    with np.errstate(divide="ignore", invalid="ignore"):
        return share @ both.T / variance[:, None]
