"""The density that is sampled: likelihood and priors, in coordinates in which it is nearly normal.

Priors where none was stated:

    positive θ           ln(θ - lower) ~ N(ln(start - lower), 2²): a factor of 7 each way
    χ̃                    the same with 3: what materials have spans that
    σ, ψ                 ln σ ~ N(0, 2²), ln ψ ~ N(ln 0.5, 0.7²): published ones are 0.14 to 3.0, 0.31 to 0.54
    a property of the contact that is free: with 1, around what was stated of the bodies
    between two bounds   uniform
    the whole line       N(start, (10 max(|start|, 1))²)
    noise, group         half-normal of 0.1 in ε; timing: of as much time, or height, as makes 0.1 in ε
    scale                ln κ^½ ~ N(0, 1)
    pooled               ln θ_g ~ N(ln θ, τ²), θ as above; its spread τ half-normal of 0.5

A start is the `Parameter`'s value, or what the library guesses for its laws.

Each θ is mapped to the whole line, z = ln θ or the like; a pooled z_g is mean + τ q_g with q_g ~ N(0, 1), every other
q is z. What is sampled are coordinates u of these (`coordinates`). Of a constant with unknown noise:

>>> import calibration as cal
>>> data = cal.RestitutionData([1.0, 1.0, 1.0], [0.95, 0.9, 0.85])
>>> density = density_of(cal.problem(data, "constant"))
>>> [f"{prior.label}: {prior.text}" for prior in density.priors]
['restitution: uniform, 0 to 1', 'noise: half-normal, 0.1']
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from calibration.fitting.elements import Element
from calibration.fitting.laws import OF_CONTACT
from calibration.fitting.posterior.coordinates import (
    Linear,
    Path,
    Places,
    Vector,
    coordinates_of,
    lowest,
    of_some,
)
from calibration.fitting.traceable import NamedErrors, Traceable
from calibration.parameters import FROM_ABOVE, LOG, LOGIT, NONE, Transform
from calibration.rounding import number
from softjax.compiling import QUICK, accepted

FACTOR = 2.0  # of a weak prior of what is positive, in its logarithm
# of Zhou's law and Eq. (17): centre, None for the start, and spread
PUBLISHED: dict[str, tuple[float | None, float]] = {
    "chi": (None, 3.0),
    "sigma": (1.0, 2.0),
    "psi": (0.5, 0.7),
}
OF_BODIES = 1.0  # of a property of the contact, in its logarithm
WIDE = 10.0  # of the whole line, in starts
NOISE = 0.1  # of a half-normal prior of the noise, in ε
POSITIVE = (0.0, math.inf)
SPREAD = 0.5  # of pooled parameters, in z
LOGISTIC = math.pi / math.sqrt(3)  # standard deviation of the logit of what is uniform
# standard deviations of the prior that the search for the largest density starts from its centre;
# of seven posteriors all end in the same place from 1 to 8, and six do not arrive without a limit
FARTHEST = 4.0
# points, up to which it takes longer to compile a program in full than to run it: of 1000 points
# 1.6 s longer, for 0.14 ms of 0.48 less an evaluation
FEW = 1000


class Prior(NamedTuple):
    """Prior of one unknown: normal in z = ln θ and the like, or in θ; infinite spread: uniform."""

    label: str
    text: str
    in_z: bool
    centre: float
    spread: float
    unit: str = "-"  # of a noise


class Pool(NamedTuple):
    """Places of pooled members, of their mean and of their spread τ."""

    members: Places
    mean: int
    spread: int


@dataclass(frozen=True, eq=False)
class Density:
    """ln p(data | θ) p(θ) |dθ/du| up to a constant, of all unknowns of a problem.

    Attributes:
        problem: the likelihood.
        priors: of the problem's parameters, its noises, and the means and spreads of its pools.
        transform: from z to θ.
        pools: which z lie around a common mean.
        coordinates: those that are sampled, of unknowns at some places of q; none: q itself.
    """

    problem: Traceable
    priors: tuple[Prior, ...]
    transform: Transform
    pools: tuple[Pool, ...]
    coordinates: tuple[tuple[Places, Linear | Path], ...] = ()

    @property
    def labels(self) -> list[str]:
        """Labels of all unknowns, in the order of z."""
        return [prior.label for prior in self.priors]

    @property
    def _columns(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Whether each prior is in z, its centre and its spread."""
        _, _, in_z, centre, spread, _ = map(np.array, zip(*self.priors, strict=True))
        return in_z, centre, spread

    def at(self, u: Array) -> tuple[dict[str, Array], Array, Array]:
        """θ by label, ln p of q and ln |∂q/∂u|."""
        q, log_jacobian = u, jnp.zeros(())
        for places, part in self.coordinates:
            part_q, slope = part.q(u[places])
            q, log_jacobian = q.at[places].set(part_q), log_jacobian + slope
        z = q
        for pool in self.pools:
            apart = jnp.exp(q[pool.spread]) * q[pool.members]
            z = z.at[pool.members].set(q[pool.mean] + apart)
        theta = self.transform.physical(z, jnp)
        in_z, centre, spread = self._columns
        at = jnp.where(in_z, q, theta)
        slope = jnp.where(in_z, 0.0, self.transform.log_slope(z))
        log_prior = jnp.sum(slope - 0.5 * ((at - centre) / spread) ** 2)
        return dict(zip(self.labels, theta, strict=True)), log_prior, log_jacobian

    def log_density(self, u: Array) -> Array:
        """Log density in the sampled coordinates."""
        theta, log_prior, log_jacobian = self.at(u)
        return self.problem.log_likelihood(theta) + log_prior + log_jacobian

    def jitted(self, function: Callable) -> Any:
        """`jax.jit` of a function of the density; of few points a program that is compiled sooner."""
        few = sum(len(block.errors) for block in self.problem.sets) <= FEW
        return jax.jit(function, compiler_options=accepted(QUICK) if few else None)

    def spread_in_z(self, z: Vector) -> Vector:
        """Standard deviations of the priors in z, about, where z is."""
        in_z, _, spread = self._columns
        within = np.minimum(spread / np.maximum(self.transform.slope(z), 1e-300), LOGISTIC)
        return np.where(in_z | (self.transform.kind == NONE), spread, within)

    def straightened(self, values: Mapping[str, float]) -> "Density":
        """The density in coordinates along its profiles.

        Args:
            values: θ where a fit ended, of some of the unknowns.
        """
        q = self._start(values)
        scale, gradient = self.spread_in_z(q), self.jitted(jax.value_and_grad(self.log_density))

        def slope(q: Vector) -> tuple[float, Vector]:
            value, slopes = gradient(q)
            return -float(value), -np.asarray(slopes)

        q, _ = lowest(slope, q, np.arange(len(q)), scale)
        pooled = {pool.mean for pool in self.pools}  # whose funnel has no profile worth a path
        blocks = []
        for places in self._blocks():
            straight = bool(pooled & {*places.tolist()})
            some = of_some(slope, q, places)
            blocks.append((places, coordinates_of(some, q[places], scale[places], straight)))
        return replace(self, coordinates=tuple(blocks))

    def _start(self, values: Mapping[str, float]) -> Vector:
        """q of the values, and of the priors' centres where there are none, drawn in to the priors."""
        in_z, centre, spread = self._columns
        is_half = (centre == 0) & (self.transform.kind == LOG)
        inside = np.where(is_half, 0.3 * spread, centre)
        centre = np.where(in_z, centre, self.transform.unconstrained(inside))
        centre = np.where(np.isinf(spread), 0.0, centre)  # of uniform ones
        theta = self.transform.physical(centre)
        theta = np.array([values.get(n, x) for n, x in zip(self.labels, theta, strict=True)])
        z, reach = self.transform.unconstrained(theta), FARTHEST * self.spread_in_z(centre)
        for pool in self.pools:
            z[pool.members] = (z[pool.members] - z[pool.mean]) / np.exp(z[pool.spread])
        return np.clip(z, centre - reach, centre + reach)

    def _blocks(self) -> list[Places]:
        """Places of unknowns that belong together: nothing else is correlated."""
        blocks = []
        for component in self.problem.components:
            labels = [e.label for e in component.elements]
            sets = [block for block in self.problem.sets if block.set in component.sets]
            labels += [name for block in sets for name in block.labels.values()]
            for pool in self.problem.pools:
                if self.problem.names[pool.members[0]] in labels:
                    labels += [pool.name, pool.spread_name]
            if labels:
                blocks.append(np.array([self.labels.index(label) for label in labels]))
        return blocks


def density_of(problem: Traceable) -> Density:
    """The density of a problem's unknowns, in q."""
    means = [problem.elements[pool.members[0]] for pool in problem.pools]
    every, first = [*problem.elements, *means], len(problem.elements)
    noises = [
        _of_noise(errors, kind, label)
        for errors in problem.sets
        for kind, label in errors.labels.items()
    ]
    text = f"half-normal, {number(SPREAD)}"
    spreads = [Prior(pool.spread_name, text, False, 0.0, SPREAD) for pool in problem.pools]
    ranges = [e.range for e in every] + [POSITIVE] * (len(noises) + len(spreads))
    transform = Transform.of(ranges, [None] * len(ranges))  # bounded where the range is
    of_law = [_of_element(e, int(k)) for e, k in zip(every, transform.kind, strict=False)]
    pools = []
    for i, pool in enumerate(problem.pools):
        of_law[first + i] = of_law[first + i]._replace(label=pool.name)
        text = f"around {pool.name}, with {pool.spread_name}"
        for place in pool.members:
            of_law[place] = Prior(problem.elements[place].label, text, True, 0.0, 1.0)
        pools.append(Pool(np.array(pool.members), first + i, len(every) + len(noises) + i))
    return Density(problem, (*of_law, *noises, *spreads), transform, tuple(pools))


def _of_element(element: Element, kind: int) -> Prior:
    label, (low, high), start = element.label, element.range, element.start
    if element.parameter.prior is not None or kind == NONE:
        wide = start, WIDE * max(abs(start), 1.0)
        mean, deviation = element.parameter.prior or wide
        stated = "" if element.parameter.prior is None else ", stated"
        text = f"normal, {number(mean)} ± {number(deviation)}{stated}"
        return Prior(label, text, False, mean, deviation)
    if kind == LOGIT:
        return Prior(label, f"uniform, {number(low)} to {number(high)}", False, 0.0, math.inf)
    weak = OF_BODIES if element.name.startswith(OF_CONTACT) else FACTOR
    usual, spread = PUBLISHED.get(element.name, (None, weak))
    is_start = usual is None or element.parameter.value is not None or not low < usual < high
    median = start if is_start or usual is None else usual
    size = max(median - low if kind == LOG else high - median, 1e-12)
    centre = math.log(size) * (-1 if kind == FROM_ABOVE else 1)
    # θ = low + e^z, or high - e^-z
    sign, end = (-1, high) if kind == FROM_ABOVE else (1, low)
    text = _log_normal(median, *(end + sign * size * math.exp(z) for z in (-spread, spread)))
    return Prior(label, text, True, centre, spread)


def _log_normal(median: float, *ends: float) -> str:
    low, high = (number(end, 2) for end in sorted(ends))
    return f"log-normal, median {number(median)}, with 68 % from {low} to {high}"


def _of_noise(errors: NamedErrors, kind: str, label: str) -> Prior:
    if kind == "scale":
        return Prior(label, _log_normal(1.0, *(math.exp(z) for z in (-1, 1))), True, 0.0, 1.0)
    if kind != "timing":
        return Prior(label, f"half-normal, {number(NOISE, 1)}", False, 0.0, NOISE)
    size, (_, unit) = NOISE / errors.per_unit, errors.errors.points.measured_by.reading
    return Prior(label, f"half-normal, {number(size, 1)} {unit}", False, 0.0, size, unit)
