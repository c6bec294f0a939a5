"""Global sensitivities over ranges: Sobol indices, and bounds of them from derivatives.

S_i = Var E[f | θ_i]/Var f is what θ_i explains alone, S_Ti = E Var[f | all but θ_i]/Var f what
it explains with all interactions: means over samples A, B and A with one column of B (A. Saltelli
et al., Comput. Phys. Commun. 181, 259, 2010). For θ_i uniform on [a, b] and f continuous,

    S_Ti <= (b - a)²/(π² Var f) · E[(∂f/∂θ_i)²]

(I. M. Sobol' and S. Kucherenko, Math. Comput. Simul. 79, 3009, 2009); on a logarithmic scale the
same with ln θ_i instead of θ_i. ε jumps by about d/3 where the impact velocity passes v_cr: what
that jump contributes is in the indices and not in the bound.
"""

from collections.abc import Callable, Mapping
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
AT_ONCE = 1 << 13  # samples evaluated together
RESAMPLED = 32  # bootstrap samples drawn together

Model = Callable[[Mapping[str, Array]], Any]
Progress = Callable[[str, int, int], None]


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
        """A dictionary for JSON; undefined numbers (no variance) are None."""
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
        route: the energy balance, or the ODE for a law that needs it, unless stated.
        material: which one of a fit's.
        options: `samples`, `scale`, `seed`, `confidence`, `resamples`, `progress` of
            `model_indices`.

    Raises:
        ValueError: naming the argument, its value and what is accepted; where ε varies nowhere.
    """
    inputs = as_inputs(inputs, material)
    velocity = check_velocity(velocity)
    check_ranges(inputs, ranges)
    fixed = {name: np.asarray(value, float) for name, value in inputs.values.items()}
    found = model_indices(Restitution(fixed, inputs.build, velocity, route), ranges, **options)
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
    points = _drawn(ends, scale, samples, random)
    sets = []
    with jax.enable_x64(True):
        for k, one in enumerate(points):
            value, slope = map(np.asarray, _evaluated(model, names, one, k == 0))
            if k == 0:  # with ln θ instead of θ on a logarithmic scale
                per = one.T[:, None] if scale == "log" else 1.0
                squares = np.mean((slope * per) ** 2, axis=0)
            sets.append(value.T)
            if progress is not None:
                progress("Sobol indices", (k + 1) * samples, len(points) * samples)
    lost = sum(np.sum(~np.isfinite(one)) for one in sets)
    if lost:
        requirement = f"such that {lost} of {sum(map(np.size, sets))} have none"
        raise DataError("ranges", requirement, "such that every sample has a finite output")
    f_a, f_b, f_ab = sets[0], sets[1], np.stack(sets[2:])
    variance, mean = (of([f_a, f_b], axis=(0, 2)) for of in (np.var, np.mean))
    varies = variance > NO_VARIANCE * mean**2
    if not np.any(varies):
        accepted = "wide enough for the output to vary"
        raise DataError("ranges", f"such that it is {mean[0]:.6g} everywhere", accepted)
    drawn = [np.full((1, samples), 1 / samples)]
    for first in range(0, resamples, RESAMPLED):
        rows = range(min(RESAMPLED, resamples - first))
        picked = (random.integers(0, samples, samples) for _ in rows)
        drawn.append(np.array([np.bincount(k, minlength=samples) for k in picked]) / samples)
    tables = np.concatenate([_indices(share, f_a, f_b, f_ab) for share in drawn], axis=2)
    part = [0.5 * (1 - confidence), 0.5 * (1 + confidence)]
    first, total = tables[:, :, 0]
    (first_low, first_high), (total_low, total_high) = np.quantile(
        tables[:, :, 1:], part, axis=2
    ).swapaxes(0, 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        bound = (ends[:, 1] - ends[:, 0]) ** 2 * squares / (np.pi**2 * variance[:, None])
    tables_of = {
        **{"first": first, "first_low": first_low, "first_high": first_high},
        **{"total": total, "total_low": total_low, "total_high": total_high, "bound": bound},
    }
    return SobolIndices(
        names=names,
        ranges=dict(ranges),
        scale=scale,
        **{key: np.where(varies[:, None], table, np.nan) for key, table in tables_of.items()},
        mean=mean,
        variance=variance,
        samples=samples,
        confidence=confidence,
        symbols=names,
        zeros=np.mean(np.equal([f_a, f_b], 0), axis=(0, 2)),
    )


def _check(ranges, samples, scale) -> None:
    if not ranges:
        raise DataError("ranges", "empty", "of one input or more")
    is_whole = isinstance(samples, int | np.integer) and samples >= 2
    if not is_whole or samples & (samples - 1):
        raise DataError("samples", samples, "a power of two")
    if scale not in SCALES:
        raise DataError("scale", scale, "uniform or log")
    for name, both in ranges.items():
        low, high = both_ends(f"ranges[{name!r}]", both)
        if not (np.isfinite([low, high]).all() and low < high and (scale != "log" or low > 0)):
            accepted = "(low, high), finite and ascending" + (", positive" * (scale == "log"))
            raise DataError(f"ranges[{name!r}]", (low, high), accepted)


def _drawn(ends: np.ndarray, scale: str, samples: int, random) -> list[np.ndarray]:
    """Samples A and B, and A with one input of B for each input, (p, n)."""
    from scipy.stats import qmc

    unit = qmc.Sobol(2 * len(ends), rng=random, bits=64).random(samples)
    both = ends[:, :1] + (ends[:, 1:] - ends[:, :1]) * unit.T.reshape(2, len(ends), samples)
    a, b = np.exp(both) if scale == "log" else both
    identity = np.eye(len(ends), dtype=bool)[:, :, None]
    return [a, b, *np.where(identity, b, a)]


@eqx.filter_jit
def _evaluated(model: Model, names: tuple[str, ...], points, with_slopes: bool):
    """Outputs (n, q), and derivatives (n, q, p) where requested."""

    def outputs(x):
        y = jnp.atleast_1d(model(dict(zip(names, x, strict=True))))
        return y, y

    def one(x):
        slope, y = jax.jacfwd(outputs, has_aux=True)(x) if with_slopes else outputs(x)
        return y, slope

    return jax.lax.map(one, points.T, batch_size=AT_ONCE)


def _indices(share: np.ndarray, f_a, f_b, f_ab) -> Float[np.ndarray, "2 q resamples p"]:
    """Saltelli's estimates, first-order and total, by the weight of each sample in each resample.

    Both are ratios of means over the samples, so that a resample is how often each was drawn.
    """
    centre = 0.5 * (np.mean(f_a, axis=1) + np.mean(f_b, axis=1))[:, None]
    a, b, ab = f_a - centre, f_b - centre, f_ab - centre
    variance = 0.5 * (a**2 + b**2) @ share.T - (0.5 * (a + b) @ share.T) ** 2
    with np.errstate(divide="ignore", invalid="ignore"):
        both = [(x @ share.T) / variance for x in (b * (ab - a), 0.5 * (a - ab) ** 2)]
    return np.moveaxis(np.array(both), 1, -1)
