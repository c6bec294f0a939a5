"""Sensitivities of ε to its inputs: exact derivatives at a point, and Sobol indices over ranges.

S_i = Var E[f | θ_i]/Var f is what θ_i explains alone, S_Ti = E Var[f | all but θ_i]/Var f what
it explains with all interactions: means over samples A, B and A with one column of B (A. Saltelli
et al., Comput. Phys. Commun. 181, 259, 2010).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike, Float, Int

import softjax as sj
from calibration.data.checks import check_whole, checked_confidence
from calibration.data.json_file import plain
from calibration.errors import DataError
from calibration.fitting.result import FitResult
from calibration.studies.inputs import (
    VELOCITY,
    Inputs,
    as_inputs,
    check_ranges,
    check_velocity,
)
from softjax.batching import filled
from softjax.fields import Declared

PADDING = 64  # most batches of velocities share one compilation
SCALES = ("uniform", "log")
NO_ANSWER = int(sj.Status.INVALID_INPUT | sj.Status.SOLVER_FAILED)
NO_VARIANCE = 1e-24  # of the squared mean: rounding
AT_ONCE = 1 << 13  # samples evaluated together
RESAMPLED = 32  # bootstrap samples drawn together


@dataclass(frozen=True, eq=False)
class Sensitivities:
    """θ ∂ε/∂θ of p inputs, the velocity among them, at n velocities.

    Attributes:
        declared: symbol and unit of the inputs by name, (p,); the last is "velocity".
        velocity: v [m/s], (n,).
        coefficient: ε [-], (n,).
        absolute: θ ∂ε/∂θ [-], (n, p): the change of ε for a relative change of θ. Zero where
            θ = 0; for a negative Poisson's ratio it keeps its sign.
        status: flags of each collision, (n,).
    """

    declared: Mapping[str, Declared]
    velocity: Float[np.ndarray, " n"]
    coefficient: Float[np.ndarray, " n"]
    absolute: Float[np.ndarray, "n p"]
    status: Int[np.ndarray, " n"]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the inputs, (p,)."""
        return tuple(self.declared)

    @property
    def logarithmic(self) -> Float[np.ndarray, "n p"]:
        """∂ln ε/∂ln θ [-]; NaN where ε = 0 and θ ∂ε/∂θ alone has a meaning."""
        return self.absolute / np.where(self.coefficient > 0, self.coefficient, np.nan)[:, None]

    def of(self, name: str) -> Float[np.ndarray, " n"]:
        """θ ∂ε/∂θ of one input."""
        return self.absolute[:, self.names.index(name)]

    def rows(self, which: slice) -> "Sensitivities":
        """Select velocities."""
        columns = ("velocity", "coefficient", "absolute", "status")
        return replace(self, **{name: getattr(self, name)[which] for name in columns})

    def ranked(self, velocity: float) -> list[tuple[str, float]]:
        """(name, θ ∂ε/∂θ) at the velocity nearest to the given one, the largest first."""
        row = self.absolute[np.argmin(np.abs(self.velocity - velocity))]
        order = np.argsort(-np.abs(row), kind="stable")
        return [(self.names[i], float(row[i])) for i in order]

    def __repr__(self) -> str:
        shown = ", ".join(declared.symbol for declared in self.declared.values())
        return f"Sensitivities({len(self.velocity)} velocities; θ ∂ε/∂θ of {shown})"


def sensitivity(
    inputs: Inputs | sj.ContactLaw | FitResult,
    velocity: Float[ArrayLike, "..."],
    route: sj.EnergyBalance | sj.ClosedForm | sj.ODE | None = None,
    *,
    material: str | None = None,
) -> Sensitivities:
    """θ ∂ε/∂θ of every input at every velocity, from one forward pass for all of them.

    Args:
        inputs: `Inputs` (e.g. `of_spheres(material, radius, chi=…, sigma=…, psi=…)`, whose E, ν,
            ρ, Y, R are those of the bodies), or a law, or a fit, whose law's stored fields are then
            the inputs.
        velocity: v [m/s], a number or any shape (taken flat).
        route: as `softjax.restitution` takes it: the energy balance where the law can, if not stated.
        material: which one of a fit's.

    Where two bodies have the same yield strength, ε has a kink in each body's own: it is given
    for the body that yields, the second one.

    Raises:
        ValueError: naming the argument, its value and what is accepted.
    """
    inputs = as_inputs(inputs, material)
    velocity = check_velocity(velocity)
    inputs.law()  # refuses values that make no law
    names, values = tuple(inputs.values), np.array(list(inputs.values.values()), float)
    padded = filled(velocity, len(velocity) + -len(velocity) % PADDING)
    with jax.enable_x64(True):
        law, moved = _built(names, values, inputs.build)
        results = _slopes(law, padded, route)
    slopes, coefficient, status = (np.asarray(x)[..., : len(velocity)] for x in results)
    absolute = np.column_stack([slopes[:-1].T @ moved, slopes[-1]]) + 0.0  # no -0
    declared = {name: inputs.declared(name) for name in (*names, VELOCITY)}
    return Sensitivities(declared, velocity, coefficient, absolute, status)


@eqx.filter_jit
def _built(names: tuple[str, ...], values, build: Any) -> Any:
    """The law, and ∂x/∂s of its m numbers at s = 0 with θ (1 + s): θ ∂x/∂θ, whatever θ's sign, (m, p)."""

    def numbers(s):
        law = build(dict(zip(names, values * (1 + s), strict=True)))
        single, shared = _single(law)
        x = jnp.stack(jax.tree.leaves(single))  # of one type, whatever they are built of
        return x, eqx.combine(jax.tree.unflatten(jax.tree.structure(single), list(x)), shared)

    moved, law = jax.jacfwd(numbers, has_aux=True)(jnp.zeros(len(values)))
    return law, moved


@eqx.filter_jit
def _slopes(law: sj.ContactLaw, velocity, route: Any) -> Any:
    """∂ε/∂x of the law's numbers and v ∂ε/∂v, (m + 1, n), ε and the status: one program, whatever the inputs."""
    single, shared = _single(law)
    numbers, structure = jax.tree.flatten(single)

    def coefficient(x):
        law = eqx.combine(jax.tree.unflatten(structure, x[:-1]), shared)
        hit = sj.restitution(law, velocity * x[-1], route=route)
        return hit.coefficient, (hit.coefficient, hit.status)

    # jacfwd maps all unit tangents through one linearised pass over the whole batch
    slopes, others = jax.jacfwd(coefficient, has_aux=True)(jnp.stack([*numbers, 1.0]))
    return slopes.T, *others


def _single(law: sj.ContactLaw) -> Any:
    """The law's single numbers, and its fields that impacts share."""
    return eqx.partition(law, lambda leaf: jnp.ndim(leaf) == 0)


@dataclass(frozen=True, eq=False)
class SobolIndices:
    """Indices of p inputs for ε at q velocities; NaN where it does not vary.

    Attributes:
        names: of the inputs, (p,).
        ranges: (low, high) of each.
        scale: "uniform" or "log", how each is spread over its range.
        first, total: S_i and S_Ti, (q, p).
        first_low, first_high, total_low, total_high: bootstrap percentiles, (q, p).
        mean, variance: of ε, (q,).
        samples: n; the law was evaluated n (p + 2) times.
        confidence: of the limits.
        zeros: the share of the samples without a rebound, (q,).
        velocity: v [m/s] that the outputs belong to, (q,).
        symbols: of the inputs.
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
    mean: Float[np.ndarray, " q"]
    variance: Float[np.ndarray, " q"]
    samples: int
    confidence: float
    zeros: Float[np.ndarray, " q"]
    velocity: Float[np.ndarray, " q"]
    symbols: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """A dictionary for JSON; undefined numbers (no variance) are None."""
        table = {"inputs": self.names, **vars(self)}
        return plain({n: value for n, value in table.items() if n not in ("names", "symbols")})


def sobol_indices(
    inputs: Inputs | sj.ContactLaw | FitResult,
    ranges: Mapping[str, tuple[float, float]],
    velocity: ArrayLike,
    *,
    route: sj.EnergyBalance | sj.ClosedForm | sj.ODE | None = None,
    material: str | None = None,
    samples: int = 4096,
    scale: str = "uniform",
    seed: int = 0,
    confidence: float = 0.95,
    resamples: int = 999,
    progress: Callable[[str, int, int], None] | None = None,
) -> SobolIndices:
    """Sobol indices of ε at each velocity, in memory that the samples hardly change.

    Args:
        inputs: as `sensitivity` takes them; those without a range keep their value.
        ranges: name -> (low, high), independent of each other; "velocity" is no input here.
        velocity: v [m/s], (q,).
        route: the energy balance, or the ODE for a law that needs it, unless stated.
        material: which one of a fit's.
        samples: n, a power of two.
        scale: how inputs are spread over their ranges: "uniform", or "log": uniform in the logarithm.
        seed: of samples and bootstrap.
        confidence, resamples: of the bootstrap.
        progress: called as progress(stage, done, total).

    Raises:
        ValueError: naming the argument, its value and what is accepted; where ε varies nowhere.
    """
    from scipy.stats import qmc

    inputs = as_inputs(inputs, material)
    velocity = check_velocity(velocity)
    check_ranges(inputs, ranges)
    if not ranges:
        raise DataError("ranges", "empty", "of one input or more")
    check_whole("samples", samples, 2)
    if samples & (samples - 1):
        raise DataError("samples", samples, "a power of two")
    if scale not in SCALES:
        raise DataError("scale", scale, "uniform or log")
    for name, both in ranges.items():
        if scale == "log" and not min(both) > 0:
            raise DataError(f"ranges[{name!r}]", both, "(low, high), positive")
    checked_confidence(confidence)
    check_whole("seed", seed, 0)
    check_whole("resamples", resamples, 1)
    fixed = {name: np.asarray(value, float) for name, value in inputs.values.items()}
    names, ends = tuple(ranges), np.array(list(ranges.values()), float)[:, :, None]
    low, high = np.swapaxes(np.log(ends) if scale == "log" else ends, 0, 1)
    random = np.random.default_rng(seed)
    unit = qmc.Sobol(2 * len(names), rng=random, bits=64).random(samples)
    both = low + (high - low) * unit.T.reshape(2, len(names), samples)
    a, b = np.exp(both) if scale == "log" else both
    # A, B, and A with one input of B for each input
    points = [a, b, *np.where(np.eye(len(names), dtype=bool)[:, :, None], b, a)]
    f = np.empty((len(points), len(velocity), samples))
    with jax.enable_x64(True):
        for k, x in enumerate(points):
            f[k] = np.asarray(_sampled(fixed, inputs.build, velocity, route, names, x)).T
            if progress is not None:
                progress("Sobol indices", (k + 1) * samples, len(points) * samples)
    if lost := np.sum(~np.isfinite(f)):
        requirement = f"such that {lost} of {f.size} have none"
        raise DataError("ranges", requirement, "such that every sample has a finite output")
    variance, mean = np.var(f[:2], axis=(0, 2)), np.mean(f[:2], axis=(0, 2))
    varies = variance > NO_VARIANCE * mean**2
    if not np.any(varies):
        accepted = "wide enough for the output to vary"
        raise DataError("ranges", f"such that it is {mean[0]:.6g} everywhere", accepted)
    found = [_indices(np.full((1, samples), 1 / samples), f)]
    for begun in range(0, resamples, RESAMPLED):
        rows = range(min(RESAMPLED, resamples - begun))
        picked = (random.integers(samples, size=samples) for _ in rows)
        share = np.array([np.bincount(k, minlength=samples) for k in picked]) / samples
        found.append(_indices(share, f))
    indices = np.where(varies[:, None, None], np.concatenate(found, axis=2), np.nan)
    part = [0.5 * (1 - confidence), 0.5 * (1 + confidence)]
    (first, total), limits = indices[:, :, 0], np.quantile(indices[:, :, 1:], part, axis=2)
    return SobolIndices(
        names=names,
        ranges=dict(ranges),
        scale=scale,
        first=first,
        total=total,
        first_low=limits[0, 0],
        first_high=limits[1, 0],
        total_low=limits[0, 1],
        total_high=limits[1, 1],
        mean=mean,
        variance=variance,
        samples=samples,
        confidence=confidence,
        zeros=np.mean(f[:2] == 0, axis=(0, 2)),
        velocity=velocity,
        symbols=tuple(inputs.declared(name).symbol for name in names),
    )


@eqx.filter_jit
def _sampled(fixed: Any, build: Any, velocity: Any, route: Any, names: tuple[str, ...], points):
    """ε at each sample, (n, q); NaN where there is no answer."""

    def restitution_at(x):
        law = build({**fixed, **dict(zip(names, x, strict=True))})
        hit = sj.restitution(law, velocity, route=route)
        return jnp.where(hit.status & NO_ANSWER == 0, hit.coefficient, jnp.nan)

    return jax.lax.map(restitution_at, points.T, batch_size=AT_ONCE)


def _indices(share: np.ndarray, f: np.ndarray) -> Float[np.ndarray, "2 q resamples p"]:
    """Saltelli's estimates, first-order and total, by the weight of each sample in each resample.

    Both are ratios of means over the samples, so that a resample is how often each was drawn.
    """
    a, b, *ab = f - np.mean(f[:2], axis=(0, 2))[:, None]
    variance = 0.5 * (a**2 + b**2) @ share.T - (0.5 * (a + b) @ share.T) ** 2
    products = [[b * (x - a), 0.5 * (a - x) ** 2] for x in ab]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.moveaxis(products @ share.T / variance, 0, -1)
