"""Global sensitivities over ranges: Sobol indices by SciPy, and bounds from derivatives.

S_i = Var E[f | θ_i]/Var f is what θ_i explains by itself, S_Ti = E Var[f | all but θ_i]/Var f what
it explains with all interactions. For θ_i uniform on [a, b] and f continuous,

    S_Ti <= (b - a)²/(π² Var f) · E[(∂f/∂θ_i)²]

(I. M. Sobol' and S. Kucherenko, Math. Comput. Simul. 79, 3009, 2009); on a logarithmic scale the
same with ln θ_i in place of θ_i. ε jumps by about d/3 where the impact velocity passes v_cr: what
that jump contributes is in the indices and not in the bound.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

import softjax as sj
from calibration.sensitivities.inputs import Inputs, as_inputs, check_velocity

SCALES = ("uniform", "log")
LARGEST_BLOCK = 1 << 13  # samples evaluated at once


@dataclass(frozen=True, eq=False)
class SobolIndices:
    """Indices of p inputs for q outputs.

    Attributes:
        names: of the inputs, (p,).
        ranges: (low, high) of each.
        scale: "uniform" or "log", how each is spread over its range.
        first, total: S_i and S_Ti, (q, p).
        first_low, first_high, total_low, total_high: bootstrap limits, (q, p).
        bound: of S_Ti, from derivatives, (q, p).
        mean, variance: of the outputs, (q,).
        samples: SciPy's n; the model was evaluated n (p + 2) times, and n times with derivatives.
        confidence: of the limits.
        velocity: v [m/s] that the outputs belong to, (q,); None for another model.
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
    mean: Float[np.ndarray, " q"]
    variance: Float[np.ndarray, " q"]
    samples: int
    confidence: float
    velocity: Float[np.ndarray, " q"] | None = None

    def to_dict(self) -> dict[str, Any]:
        """For JSON; what is undefined (no variance) is None."""
        tables = ("first", "first_low", "first_high", "total", "total_low", "total_high", "bound")
        return {
            "inputs": list(self.names),
            "ranges": {name: list(self.ranges[name]) for name in self.names},
            "scale": self.scale,
            "samples": self.samples,
            "confidence": self.confidence,
            "velocity": None if self.velocity is None else self.velocity.tolist(),
            "mean": self.mean.tolist(),
            "variance": self.variance.tolist(),
        } | {name: _without_nan(getattr(self, name)) for name in tables}


def sobol_indices(
    inputs: Inputs | sj.ContactLaw,
    ranges: Mapping[str, tuple[float, float]],
    velocity: Float[ArrayLike, " q"],
    *,
    route: sj.EnergyBalance | sj.ODE | None = None,
    **options: Any,
) -> SobolIndices:
    """Sobol indices of ε at each velocity, its inputs spread over ranges.

    Args:
        inputs: as `sensitivity` takes them; those without a range keep their value.
        ranges: name -> (low, high); "velocity" is no input here.
        velocity: v [m/s], (q,).
        route: the energy balance, or the ODE for a law that needs it, unless told.
        options: `samples`, `scale`, `seed`, `confidence`, `resamples`, `progress` of
            `model_indices`.

    Raises:
        ValueError: naming the argument, its value and what is accepted.
    """
    inputs = as_inputs(inputs)
    velocity = check_velocity(velocity)
    for name in ranges:
        if name not in inputs.values:
            known = ", ".join(inputs.values)
            raise ValueError(f"`ranges` must be of {known}, but names {name!r}")
    inputs.law()  # refuses values that make no law
    model = Restitution(
        tuple(inputs.values.items()),
        inputs.build,
        tuple(velocity.tolist()),
        route,
    )
    found = model_indices(model, ranges, **options)
    return SobolIndices(**(vars(found) | {"velocity": velocity}))


@dataclass(frozen=True)
class Restitution:
    """ε at some velocities as a function of inputs: a model for `model_indices`."""

    values: tuple[tuple[str, float], ...]
    build: Any
    velocity: tuple[float, ...]
    route: sj.EnergyBalance | sj.ODE | None

    def __call__(self, sample: Mapping[str, Array]) -> Array:
        """(q,) for one sample."""
        law = self.build(dict(self.values) | dict(sample))
        return sj.restitution(law, jnp.asarray(self.velocity), route=self.route).coefficient


def model_indices(
    model: Callable[[Mapping[str, Array]], Array],
    ranges: Mapping[str, tuple[float, float]],
    *,
    samples: int = 4096,
    scale: str = "uniform",
    seed: int = 0,
    confidence: float = 0.95,
    resamples: int = 200,
    progress: Callable[[str, int, int], None] | None = None,
) -> SobolIndices:
    """Sobol indices of any model that JAX can trace.

    Args:
        model: of one sample, name -> number, to outputs (q,); hashable, so that it compiles once.
        ranges: name -> (low, high).
        samples: a power of two.
        scale: "uniform", or "log" for inputs spread evenly in their logarithm.
        seed: of the Sobol sequence and the bootstrap.
        confidence: of the bootstrap limits.
        resamples: of the bootstrap.
        progress: called as progress(stage, done, total), in evaluations of the model.

    Raises:
        ValueError: naming the argument, its value and what is accepted.
    """
    _check(ranges, samples, scale)
    from scipy import stats

    names = tuple(ranges)
    spread = stats.uniform if scale == "uniform" else stats.loguniform
    ends = [ranges[name] for name in names]
    dists = [spread(a, b - a) if scale == "uniform" else spread(a, b) for a, b in ends]
    rng = np.random.default_rng(seed)
    # every call of SciPy's is for a multiple of `samples`, so one shape is compiled
    block = min(samples, LARGEST_BLOCK)
    batch = Batch(model, names, block, samples * (len(names) + 3), progress)
    result = stats.sobol_indices(func=batch.values, n=samples, dists=dists, rng=rng)
    first, total = (np.atleast_2d(x) for x in (result.first_order, result.total_order))
    limits = result.bootstrap(confidence_level=confidence, n_resamples=resamples)
    unit = stats.qmc.Sobol(len(names), rng=rng).random(samples)
    points = np.stack([dist.ppf(column) for dist, column in zip(dists, unit.T, strict=True)])
    outputs, squares = batch.mean_squares(points, scale)
    variance = np.var(outputs, axis=1)
    width = np.array([b - a if scale == "uniform" else np.log(b / a) for a, b in ends])
    with np.errstate(divide="ignore", invalid="ignore"):
        bound = width**2 * squares / (np.pi**2 * variance[:, None])
    low_high = [np.atleast_2d(x) for x in _limits(limits)]
    return SobolIndices(  # type: ignore[call-arg]  # four limits, unpacked
        names,
        dict(ranges),
        scale,
        first,
        total,
        *low_high,
        bound,
        np.mean(outputs, axis=1),
        variance,
        samples,
        confidence,
    )


@dataclass
class Batch:
    """The model over many samples, in blocks of one shape."""

    model: Callable[[Mapping[str, Array]], Array]
    names: tuple[str, ...]
    block: int
    total: int
    progress: Callable[[str, int, int], None] | None = None
    done: int = 0

    def values(self, points: Float[np.ndarray, "p m"]) -> Float[np.ndarray, "q m"]:
        """Outputs at m points, as SciPy asks for them."""
        # SciPy's third call stacks p matrices
        flat = points.reshape(points.shape[0], -1)
        values = np.concatenate([np.asarray(y) for y in self._blocks(_outputs, flat)], axis=1)
        return values.reshape(-1, *points.shape[1:])

    def mean_squares(self, points, scale: str):
        """Outputs (q, m), and E[(∂f/∂θ)²] (q, p), or with ln θ on a logarithmic scale."""
        outputs, squares = [], 0.0
        for y, slope in self._blocks(partial(_slopes, scale=scale), points):
            outputs.append(np.asarray(y))
            squares = squares + np.sum(np.asarray(slope) ** 2, axis=1)
        return np.concatenate(outputs, axis=1), squares / points.shape[1]

    def _blocks(self, function, points):
        for first in range(0, points.shape[1], self.block):
            block = points[:, first : first + self.block]
            yield function(self.model, self.names, block)
            self.done += block.shape[1]
            if self.progress is not None:
                self.progress("Sobol indices", self.done, self.total)


@partial(jax.jit, static_argnames=("model", "names"))
def _outputs(model, names, points):
    """(q, m)."""
    one = lambda x: jnp.atleast_1d(model(dict(zip(names, x, strict=True))))  # noqa: E731
    return jax.vmap(one, in_axes=1, out_axes=1)(points)


@partial(jax.jit, static_argnames=("model", "names", "scale"))
def _slopes(model, names, points, scale):
    """Outputs (q, m) and derivatives (q, m, p)."""

    def one(x):
        def outputs(x):
            y = jnp.atleast_1d(model(dict(zip(names, x, strict=True))))
            return y, y

        slope, y = jax.jacfwd(outputs, has_aux=True)(x)
        return y, slope * x if scale == "log" else slope

    return jax.vmap(one, in_axes=1, out_axes=1)(points)


def _limits(bootstrap):
    first, total = bootstrap.first_order, bootstrap.total_order
    intervals = first.confidence_interval, total.confidence_interval
    return [limit for interval in intervals for limit in (interval.low, interval.high)]


def _check(ranges, samples, scale) -> None:
    if not ranges:
        raise ValueError("`ranges` must name one input or more, but is empty")
    if not (
        isinstance(samples, int | np.integer) and samples >= 2 and samples & (samples - 1) == 0
    ):
        raise ValueError(f"`samples` must be a power of two, but is {samples!r}")
    if scale not in SCALES:
        raise ValueError(f"`scale` must be 'uniform' or 'log', but is {scale!r}")
    for name, (low, high) in ranges.items():
        if not (np.isfinite([low, high]).all() and low < high and (scale != "log" or low > 0)):
            accepted = "(low, high), finite and ascending" + (", positive" * (scale == "log"))
            raise ValueError(f"`ranges` of {name} must be {accepted}, but is {(low, high)}")


def _without_nan(table: np.ndarray) -> list:
    return [[x if np.isfinite(x) else None for x in row] for row in table.tolist()]
