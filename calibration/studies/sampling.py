"""A model at many samples, in memory that their number hardly changes; Saltelli's estimates of it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from calibration.parts import Arrays, Parts, Whole, blocks, joined

LARGEST_BLOCK = 1 << 13  # samples evaluated at once
RESAMPLED = 32  # bootstrap samples drawn at once

Model = Callable[[Mapping[str, Array]], Any]
Progress = Callable[[str, int, int], None]
Outputs = Float[np.ndarray, "q n"]


@dataclass
class Sampled:
    """A model over many samples, in blocks of one shape, which several processes may share.

    Attributes:
        settings: what tells this model, and how it is sampled, from others.
    """

    model: Model
    names: tuple[str, ...]
    scale: str
    settings: Any
    parts: Parts | Whole
    progress: Progress | None

    def all(self, points: Sequence[Float[np.ndarray, "p n"]]) -> tuple[list[Outputs], np.ndarray]:
        """Outputs at each set of points, and E[(∂f/∂θ)²] (q, p) over the first of them.

        On a logarithmic scale with ln θ in place of θ.
        """
        count = points[0].shape[1]
        rows = blocks(count, LARGEST_BLOCK)
        total = count * len(points)

        def make(k: int) -> Arrays:
            which, block = divmod(k, len(rows))
            part = self._part(points[which][:, rows[block]], slopes=which == 0)
            if self.progress is not None:
                self.progress("Sobol indices", which * count + rows[block].stop, total)
            return part

        made = self.parts.arrays(self.settings, len(rows) * len(points), make)
        sets = [made[k : k + len(rows)] for k in range(0, len(made), len(rows))]
        squares = sum(part["squares"] for part in sets[0])
        return [joined(one, "outputs", axis=1) for one in sets], squares / count

    def _part(self, block: Float[np.ndarray, "p n"], slopes: bool) -> Arrays:
        if not slopes:
            return {"outputs": np.asarray(_outputs(self.model, self.names, block))}
        outputs, slope = map(np.asarray, _slopes(self.model, self.names, block))
        per = block.T if self.scale == "log" else 1.0
        return {"outputs": outputs, "squares": np.sum((slope * per) ** 2, axis=1)}


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
