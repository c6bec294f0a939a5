"""Global sensitivities over ranges: Sobol indices, and bounds of them from derivatives.

S_i = Var E[f | θ_i]/Var f is what θ_i explains by itself, S_Ti = E Var[f | all but θ_i]/Var f what
it explains with all interactions: means over samples A, B and A with one column of B (A. Saltelli
et al., Comput. Phys. Commun. 181, 259, 2010). For θ_i uniform on [a, b] and f continuous,

    S_Ti <= (b - a)²/(π² Var f) · E[(∂f/∂θ_i)²]

(I. M. Sobol' and S. Kucherenko, Math. Comput. Simul. 79, 3009, 2009); on a logarithmic scale the
same with ln θ_i in place of θ_i. ε jumps by about d/3 where the impact velocity passes v_cr: what
that jump contributes is in the indices and not in the bound.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

import softjax as sj
from calibration.errors import DataError
from calibration.fitting.result import FitResult
from calibration.fitting.result_json import plain
from calibration.studies.inputs import Inputs, as_inputs, check_velocity

SCALES = ("uniform", "log")
LARGEST_BLOCK = 1 << 13  # samples evaluated at once
RESAMPLED = 32  # bootstrap samples drawn at once
NO_VARIANCE = 1e-24  # of the squared mean: rounding

Model = Callable[[Mapping[str, Array]], Any]
Progress = Callable[[str, int, int], None]
Outputs = Float[np.ndarray, "q n"]


@dataclass(frozen=True, eq=False)
class SobolIndices:
    """Indices of p inputs for q outputs; NaN for an output that does not vary.

    Attributes:
        names: of the inputs, (p,).
        ranges: (low, high) of each.
        scale: "uniform" or "log", how each is spread over its range.
        first, total: S_i and S_Ti, (q, p).
        first_low, first_high, total_low, total_high: bootstrap percentiles, (q, p).
        bound: of S_Ti, from derivatives, (q, p).
        mean, variance: of the outputs, (q,).
        samples: n; the model was evaluated n (p + 2) times, n of them with derivatives.
        confidence: of the limits.
        velocity: v [m/s] that the outputs belong to, (q,); None for another model.
        symbols: of the inputs; their names for another model.
    """

    names: tuple[str, ...]
    ranges: Mapping[str, tuple[float, float]]
    scale: str
    first: Float[np.ndarray, "q p"]
    total: Float[np.ndarray, "q p"]
    first_low: Float[np.ndarray, "q p"]
    first_high: Float[np.ndarray, "q p"]
    total_low: Float[np.ndarray, "q p"]
    total_high: Float[np.ndarray, "q p"]
    bound: Float[np.ndarray, "q p"]
    mean: Float[np.ndarray, "q"]
    variance: Float[np.ndarray, "q"]
    samples: int
    confidence: float
    velocity: Float[np.ndarray, "q"] | None = None
    symbols: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """For JSON; what is undefined (no variance) is None."""
        table = {"inputs": self.names, **vars(self)}
        return plain(
            {name: value for name, value in table.items() if name not in ("names", "symbols")}
        )


def sobol_indices(
    inputs: Inputs | sj.ContactLaw | FitResult,
    ranges: Mapping[str, tuple[float, float]],
    velocity: ArrayLike,
    *,
    route: sj.EnergyBalance | sj.ODE | None = None,
    material: str | None = None,
    **options: Any,
) -> SobolIndices:
    """Sobol indices of ε at each velocity, its inputs spread over ranges.

    Args:
        inputs: as `sensitivity` takes them; those without a range keep their value.
        ranges: name -> (low, high); "velocity" is no input here.
        velocity: v [m/s], (q,).
        route: the energy balance, or the ODE for a law that needs it, unless told.
        material: which one of a fit's.
        options: `samples`, `scale`, `seed`, `confidence`, `resamples`, `progress` of
            `model_indices`.

    Raises:
        ValueError: naming the argument, its value and what is accepted; where ε varies nowhere.
    """
    inputs = as_inputs(inputs, material)
    velocity = check_velocity(velocity)
    for name in ranges:
        if name not in inputs.values:
            raise DataError("ranges", name, f"of {', '.join(inputs.values)}")
    inputs.law()  # refuses values that make no law
    held = {name: np.asarray(value, float) for name, value in inputs.values.items()}
    found = model_indices(Restitution(held, inputs.build, velocity, route), ranges, **options)
    symbols = tuple(inputs.declared(name).symbol for name in ranges)
    return replace(found, velocity=velocity, symbols=symbols)


class Restitution(eqx.Module):
    """ε at some velocities as a function of inputs: a model for `model_indices`."""

    values: Mapping[str, Any]
    build: Any
    velocity: Any
    route: Any

    def __call__(self, sample: Mapping[str, Array]) -> Array:
        law = self.build({**self.values, **sample})
        return sj.restitution(law, self.velocity, route=self.route).coefficient


def model_indices(
    model: Model,
    ranges: Mapping[str, tuple[float, float]],
    *,
    samples: int = 4096,
    scale: str = "uniform",
    seed: int = 0,
    confidence: float = 0.95,
    resamples: int = 999,
    progress: Progress | None = None,
) -> SobolIndices:
    """Sobol indices of any model that JAX can trace, in memory that the samples hardly change.

    Args:
        model: mapping of inputs -> output, a number or (q,).
        ranges: name -> (low, high), independent of each other.
        samples: n, a power of two.
        scale: "uniform", or "log": uniform in the logarithm.
        seed: of samples and bootstrap.
        confidence, resamples: of the bootstrap.
        progress: called as progress(stage, done, total).

    Raises:
        ValueError: naming the argument, its value and what is accepted; for a model that varies
            nowhere.
    """
    from scipy.stats import qmc

    _check(ranges, samples, scale)
    names, (low, high) = tuple(ranges), np.array(list(ranges.values()), float).T
    random = np.random.default_rng(seed)
    unit = qmc.Sobol(2 * len(names), rng=random).random(samples).T
    if scale == "log":
        points = low[:, None] * (high / low)[:, None] ** unit.reshape(2, len(names), -1)
    else:
        points = low[:, None] + (high - low)[:, None] * unit.reshape(2, len(names), -1)
    sampled = _Sampled(model, names, scale, samples * (len(names) + 2), progress)
    with jax.enable_x64(True):
        f_a, squares = sampled.with_slopes(points[0])
        f_b = sampled.values(points[1])
        f_ab = np.stack([sampled.values(_mixed(*points, i)) for i in range(len(names))])
    variance = np.var([f_a, f_b], axis=(0, 2))
    mean = np.mean([f_a, f_b], axis=(0, 2))
    varies = variance > NO_VARIANCE * mean**2
    if not np.any(varies):
        accepted = "wide enough for the output to vary"
        raise DataError("ranges", f"such that it is {mean[0]:.6g} everywhere", accepted)
    all_once = np.full((1, samples), 1 / samples)
    both = _indices(all_once, f_a, f_b, f_ab)[:, 0]
    tables = np.split(both, 2, axis=1)
    tables += _percentiles(f_a, f_b, f_ab, confidence, resamples, random)
    width = np.log(high / low) if scale == "log" else high - low
    with np.errstate(divide="ignore", invalid="ignore"):
        tables.append(width**2 * squares / (np.pi**2 * variance[:, None]))
    told = [np.where(varies[:, None], table, np.nan) for table in tables]
    return SobolIndices(
        names, dict(ranges), scale, *told, mean, variance, samples, confidence, None, names
    )


@dataclass
class _Sampled:
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
            output, slopes = _slopes(*block, self.scale)
            outputs.append(np.asarray(output))
            squares = squares + np.sum(np.asarray(slopes) ** 2, axis=1)
        return np.concatenate(outputs, axis=1), squares / points.shape[1]

    def _blocks(self, points) -> Iterator[tuple[Any, ...]]:
        for first in range(0, points.shape[1], LARGEST_BLOCK):
            block = points[:, first : first + LARGEST_BLOCK]
            yield self.model, self.names, block
            self.done += block.shape[1]
            if self.progress is not None:
                self.progress("Sobol indices", self.done, self.total)


def _mixed(a: np.ndarray, b: np.ndarray, i: int) -> np.ndarray:
    """A with one input of B."""
    mixed = np.array(a)
    mixed[i] = b[i]
    return mixed


@eqx.filter_jit
def _outputs(model: Model, names: tuple[str, ...], points):
    """(q, n)."""
    one = lambda x: jnp.atleast_1d(model(dict(zip(names, x, strict=True))))  # noqa: E731
    return jax.vmap(one, in_axes=1, out_axes=1)(points)


@eqx.filter_jit
def _slopes(model: Model, names: tuple[str, ...], points, scale: str):
    """Outputs (q, n) and derivatives (q, n, p)."""

    def one(x):
        def outputs(x):
            y = jnp.atleast_1d(model(dict(zip(names, x, strict=True))))
            return y, y

        slope, y = jax.jacfwd(outputs, has_aux=True)(x)
        return y, slope * x if scale == "log" else slope

    return jax.vmap(one, in_axes=1, out_axes=1)(points)


def _percentiles(f_a, f_b, f_ab, confidence: float, resamples: int, random) -> list[np.ndarray]:
    """Bootstrap limits of both indices, (q, p) each: low and high of the first, then of the total.

    Both are ratios of means over the samples, so that a resample is no more than how often each
    sample is drawn.
    """
    n, p = f_a.shape[1], len(f_ab)
    drawn = []
    for first in range(0, resamples, RESAMPLED):
        rows = min(RESAMPLED, resamples - first)
        counts = [np.bincount(random.integers(0, n, n), minlength=n) for _ in range(rows)]
        drawn.append(_indices(np.array(counts, float) / n, f_a, f_b, f_ab))
    part = [0.5 * (1 - confidence), 0.5 * (1 + confidence)]
    low, high = np.quantile(np.concatenate(drawn, axis=1), part, axis=1)
    return [low[:, :p], high[:, :p], low[:, p:], high[:, p:]]


def _indices(share: np.ndarray, f_a, f_b, f_ab) -> Float[np.ndarray, "q resamples both"]:
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


def _check(ranges, samples, scale) -> None:
    if not ranges:
        raise DataError("ranges", "empty", "of one input or more")
    is_power = (
        isinstance(samples, int | np.integer) and samples >= 2 and not samples & (samples - 1)
    )
    if not is_power:
        raise DataError("samples", samples, "a power of two")
    if scale not in SCALES:
        raise DataError("scale", scale, "uniform or log")
    for name, (low, high) in ranges.items():
        if not (np.isfinite([low, high]).all() and low < high and (scale != "log" or low > 0)):
            accepted = "(low, high), finite and ascending" + (", positive" * (scale == "log"))
            raise DataError(f"ranges[{name!r}]", (low, high), accepted)
