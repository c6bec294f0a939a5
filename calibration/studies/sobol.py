"""Global sensitivities over ranges: Sobol indices, and bounds of them from derivatives.

S_i = Var E[f | θ_i]/Var f is what θ_i explains by itself, S_Ti = E Var[f | all but θ_i]/Var f what
it explains with all interactions: means over samples A, B and A with one column of B (A. Saltelli
et al., Comput. Phys. Commun. 181, 259, 2010). For θ_i uniform on [a, b] and f continuous,

    S_Ti <= (b - a)²/(π² Var f) · E[(∂f/∂θ_i)²]

(I. M. Sobol' and S. Kucherenko, Math. Comput. Simul. 79, 3009, 2009); on a logarithmic scale the
same with ln θ_i in place of θ_i. ε jumps by about d/3 where the impact velocity passes v_cr: what
that jump contributes is in the indices and not in the bound.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

import softjax as sj
from calibration.data.checks import check_whole, checked_confidence
from calibration.data.json_file import plain
from calibration.errors import DataError
from calibration.fitting.result import FitResult
from calibration.studies.inputs import Inputs, as_inputs, both_ends, check_ranges, check_velocity

SCALES = ("uniform", "log")
NO_ANSWER = sj.Status.INVALID_INPUT | sj.Status.SOLVER_FAILED
NO_VARIANCE = 1e-24  # of the squared mean: rounding
LARGEST_BLOCK = 1 << 13  # samples evaluated at once
RESAMPLED = 32  # bootstrap samples drawn at once

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
        zeros: the share of the samples with an output of 0, (q,): of ε those without a rebound.
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
    zeros: Float[np.ndarray, "q"] | None = None

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
    route: sj.EnergyBalance | sj.ClosedForm | sj.ODE | None = None,
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
    check_ranges(inputs, ranges)
    held = {name: np.asarray(value, float) for name, value in inputs.values.items()}
    found = model_indices(Restitution(held, inputs.build, velocity, route), ranges, **options)
    symbols = tuple(inputs.declared(name).symbol for name in ranges)
    return replace(found, velocity=velocity, symbols=symbols)


class Restitution(eqx.Module):
    """ε at some velocities as a function of inputs: a model for `model_indices`; NaN for none."""

    values: Mapping[str, Any]
    build: Any
    velocity: Any
    route: Any

    def __call__(self, sample: Mapping[str, Array]) -> Array:
        law = self.build({**self.values, **sample})
        hit = sj.restitution(law, self.velocity, route=self.route)
        return jnp.where(hit.status & int(NO_ANSWER) == 0, hit.coefficient, jnp.nan)


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
    _check(ranges, samples, scale)
    checked_confidence(confidence)
    check_whole("seed", seed, 0)
    check_whole("resamples", resamples, 1)
    names, ends = tuple(ranges), np.array(list(ranges.values()), float)
    ends = np.log(ends) if scale == "log" else ends
    random = np.random.default_rng(seed)
    a, b = _drawn(ends, scale, samples, random)
    points = [a, b, *(_mixed(a, b, i) for i in range(len(names)))]
    with jax.enable_x64(True):
        sets, squares = _sampled(model, names, scale, points, progress)
    lost, (f_a, f_b, *mixed) = sum(np.sum(~np.isfinite(one)) for one in sets), sets
    if lost:
        accepted = "such that every sample has a finite output"
        raise DataError(
            "ranges", f"such that {lost} of {sum(map(np.size, sets))} have none", accepted
        )
    f_ab = np.stack(mixed)
    variance = np.var([f_a, f_b], axis=(0, 2))
    mean = np.mean([f_a, f_b], axis=(0, 2))
    varies = variance > NO_VARIANCE * mean**2
    if not np.any(varies):
        accepted = "wide enough for the output to vary"
        raise DataError("ranges", f"such that it is {mean[0]:.6g} everywhere", accepted)
    all_once = np.full((1, samples), 1 / samples)
    both = indices(all_once, f_a, f_b, f_ab)[:, 0]
    tables = np.split(both, 2, axis=1)
    tables += percentiles(f_a, f_b, f_ab, confidence, resamples, random)
    width = ends[:, 1] - ends[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        tables.append(width**2 * squares / (np.pi**2 * variance[:, None]))
    keys = ("first", "total", "first_low", "first_high", "total_low", "total_high", "bound")
    told = [np.where(varies[:, None], table, np.nan) for table in tables]
    return SobolIndices(
        names=names,
        ranges=dict(ranges),
        scale=scale,
        **dict(zip(keys, told, strict=True)),
        mean=mean,
        variance=variance,
        samples=samples,
        confidence=confidence,
        symbols=names,
        zeros=np.mean(np.equal([f_a, f_b], 0), axis=(0, 2)),
    )


def _drawn(ends: np.ndarray, scale: str, samples: int, random) -> np.ndarray:
    """Two independent sets of samples, (2, p, n)."""
    from scipy.stats import qmc

    sequence = qmc.Sobol(2 * len(ends), rng=random, bits=64).random(samples)
    unit = sequence.T.reshape(2, len(ends), samples)
    points = ends[:, :1] + (ends[:, 1:] - ends[:, :1]) * unit
    return np.exp(points) if scale == "log" else points


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
    for name, both in ranges.items():
        low, high = both_ends(f"ranges[{name!r}]", both)
        if not (np.isfinite([low, high]).all() and low < high and (scale != "log" or low > 0)):
            accepted = "(low, high), finite and ascending" + (", positive" * (scale == "log"))
            raise DataError(f"ranges[{name!r}]", (low, high), accepted)


def _sampled(
    model: Model,
    names: tuple[str, ...],
    scale: str,
    points: Sequence[Float[np.ndarray, "p n"]],
    progress: Progress | None,
) -> tuple[list[Outputs], np.ndarray]:
    """Outputs at each set of points, and E[(∂f/∂θ)²] (q, p) over the first of them.

    In blocks of one shape. On a logarithmic scale with ln θ in place of θ.
    """
    count = points[0].shape[1]
    sets, squares = [], np.zeros(())
    for which, every in enumerate(points):
        found = []
        for first in range(0, count, LARGEST_BLOCK):
            block = every[:, first : first + LARGEST_BLOCK]
            outputs, slope = map(np.asarray, _evaluated(model, names, block, which == 0))
            found.append(outputs)
            if which == 0:
                per = block.T if scale == "log" else 1.0
                squares = squares + np.sum((slope * per) ** 2, axis=1)
            if progress is not None:
                done = which * count + first + block.shape[1]
                progress("Sobol indices", done, count * len(points))
        sets.append(np.concatenate(found, axis=1))
    return sets, squares / count


@eqx.filter_jit
def _evaluated(model: Model, names: tuple[str, ...], points, with_slopes: bool):
    """Outputs (q, n), and derivatives (q, n, p) where asked for."""

    def outputs(x):
        y = jnp.atleast_1d(model(dict(zip(names, x, strict=True))))
        return y, y

    def one(x):
        slope, y = jax.jacfwd(outputs, has_aux=True)(x) if with_slopes else outputs(x)
        return y, slope

    return jax.vmap(one, in_axes=1, out_axes=1)(points)


def _mixed(a: np.ndarray, b: np.ndarray, i: int) -> np.ndarray:
    """A with one input of B."""
    mixed = np.array(a)
    mixed[i] = b[i]
    return mixed


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
