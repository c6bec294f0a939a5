"""Priors of what is sampled: those that were stated, and weak ones where nothing was said.

    positive θ           ln(θ - lower) ~ N(ln(start - lower), 2²): a factor of 7 each way
    χ̃                    the same with 3: what materials have spans that
    σ, ψ                 ln σ ~ N(0, 2²), ln ψ ~ N(ln 0.5, 0.7²): published ones are 0.14 to 3.0, 0.31 to 0.54
    a property of the contact that is free: with 1, around what was stated of the bodies
    between two bounds   uniform
    the whole line       N(start, (10 max(|start|, 1))²)
    noise, group         half-normal of 0.1 in ε; timing: of as much time as makes 0.1 in ε
    scale                ln κ^½ ~ N(0, 1)
    pooled               ln θ_g ~ N(ln θ, τ²), θ as above; its spread τ half-normal of 0.5

A start is the `Parameter`'s value, or what the library guesses for its laws.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import jax.numpy as jnp
import numpy as np

from calibration.fitting.law_model import OF_CONTACT
from calibration.fitting.problem import Element, Pool
from calibration.fitting.set_likelihood import SetLikelihood
from calibration.fitting.traceable import Traceable
from calibration.fitting.transform import FROM_ABOVE, LOG, LOGIT, NONE, Transform
from calibration.rounding import number

FACTOR = 2.0  # of a weak prior of what is positive, in its logarithm
# of Zhou's law and Eq. (17): centre, None for the start, and spread
PUBLISHED: dict[str, tuple[float | None, float]] = {
    "chi": (None, 3.0),
    "sigma": (1.0, 2.0),
    "psi": (0.5, 0.7),
}
OF_BODIES = 1.0
WIDE = 10.0
NOISE = 0.1  # of ε
SPREAD = 0.5  # of pooled parameters, in z
LOGISTIC = math.pi / math.sqrt(3)  # standard deviation of the logit of what is uniform


@dataclass(frozen=True)
class Prior:
    """Of one unknown.

    Attributes:
        label: of the unknown.
        told: in words.
        in_z: whether it is normal in z = ln θ and the like, else in θ.
        centre, spread: of the normal distribution; infinite spread: uniform.
        stated: whether the user stated it.
    """

    label: str
    told: str
    in_z: bool
    centre: float
    spread: float
    stated: bool = False


@dataclass(frozen=True, eq=False)
class Around:
    """z of some members ~ N(z of their mean, τ²), τ = e^z of the spread: places in z."""

    members: np.ndarray
    mean: int
    spread: int

    def log_density(self, z: Any) -> Any:
        off = (z[self.members] - z[self.mean]) * jnp.exp(-z[self.spread])
        return -0.5 * jnp.sum(off**2) - len(self.members) * z[self.spread]


@dataclass(frozen=True, eq=False)
class Priors:
    """Of all unknowns, with the map from z to them."""

    each: tuple[Prior, ...]
    transform: Transform
    pools: tuple[Around, ...] = ()

    def log_density(self, z: Any) -> Any:
        """ln p(z) up to a constant: ln p(θ) + ln |dθ/dz| where the prior is one of θ."""
        in_z = np.array([one.in_z for one in self.each])
        centre = np.array([one.centre for one in self.each])
        spread = np.array([one.spread for one in self.each])
        at = jnp.where(in_z, z, self.transform.physical(z, jnp))
        slope = jnp.where(in_z, 0.0, self.transform.log_slope(z))
        alone = jnp.sum(slope - 0.5 * ((at - centre) / spread) ** 2)
        return alone + sum(pool.log_density(z) for pool in self.pools)

    def spread_in_z(self, z: np.ndarray) -> np.ndarray:
        """Standard deviations in z, about, where z is."""
        spread = np.array([one.spread for one in self.each])
        in_z = np.array([one.in_z for one in self.each])
        slope = np.maximum(self.transform.slope(z), 1e-300)
        in_theta = np.minimum(spread / slope, LOGISTIC)
        in_theta = np.where(self.transform.kind == NONE, spread, in_theta)
        return np.where(in_z, spread, in_theta)


def priors_of(problem: Traceable) -> Priors:
    """Of a problem's parameters, then of its noises."""
    every = [*problem.elements, *(problem.elements[p.members[0]] for p in problem.pools)]
    noises = [one for errors in problem.sets for one in _of_errors(errors)]
    spreads = [_of_spread(pool) for pool in problem.pools]
    ranges = [e.range for e in every] + [(0.0, math.inf)] * len([*noises, *spreads])
    transform = Transform.of(ranges, [None] * len(ranges))  # bounded where the range is
    of_law = [_of_element(e, int(k)) for e, k in zip(every, transform.kind, strict=False)]
    for pool, k in zip(problem.pools, range(len(problem.elements), len(every)), strict=True):
        of_law[k] = replace(of_law[k], label=pool.name)
        for member in pool.members:
            of_law[member] = _of_member(problem.elements[member], pool)
    pools = tuple(
        Around(np.array(pool.members), len(problem.elements) + i, len(every) + len(noises) + i)
        for i, pool in enumerate(problem.pools)
    )
    return Priors((*of_law, *noises, *spreads), transform, pools)


def _of_member(element: Element, pool: Pool) -> Prior:
    told = f"around {pool.name}, with {pool.spread_name}"
    return Prior(element.label, told, True, 0.0, math.inf)


def _of_spread(pool: Pool) -> Prior:
    return Prior(pool.spread_name, f"half-normal, {number(SPREAD)}", False, 0.0, SPREAD)


def _of_element(element: Element, kind: int) -> Prior:
    label, (low, high) = element.label, element.range
    if element.parameter.prior is not None:
        mean, deviation = element.parameter.prior
        told = f"normal, {number(mean)} ± {number(deviation)}"
        return Prior(label, told, False, mean, deviation, stated=True)
    if kind == LOGIT:
        return Prior(label, f"uniform, {number(low)} to {number(high)}", False, 0.0, math.inf)
    if kind == NONE:
        spread = WIDE * max(abs(element.start), 1.0)
        told = f"normal, {number(element.start)} ± {number(spread)}"
        return Prior(label, told, False, element.start, spread)
    return _log_normal(element, kind)


def _log_normal(element: Element, kind: int) -> Prior:
    low, high = element.range
    weak = OF_BODIES if element.name.startswith(OF_CONTACT) else FACTOR
    usual, spread = PUBLISHED.get(element.name, (None, weak))
    is_start = usual is None or element.parameter.value is not None or not low < usual < high
    median = element.start if is_start or usual is None else usual
    size = max(median - low if kind == LOG else high - median, 1e-12)
    centre = math.log(size) * (-1 if kind == FROM_ABOVE else 1)
    told = f"log-normal, median {number(median)}, a factor of {math.exp(spread):.2g} each way"
    return Prior(element.label, told, True, centre, spread)


def _of_errors(errors: SetLikelihood) -> Sequence[Prior]:
    return [_of_noise(kind, label, errors) for kind, label in errors.labels.items()]


def _of_noise(kind: str, label: str, errors: SetLikelihood) -> Prior:
    if kind == "scale":
        return Prior(label, "log-normal, median 1, a factor of 2.7 each way", True, 0.0, 1.0)
    size = NOISE / errors.per_second if kind == "timing" else NOISE
    unit = " s" if kind == "timing" else ""
    return Prior(label, f"half-normal, {number(size, 1)}{unit}", False, 0.0, size)
