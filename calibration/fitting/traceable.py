"""The likelihood of a law's parameters as pure JAX functions, for whoever samples or searches.

    problem = cal.problem(data, sj.Thornton)
    problem.log_likelihood({"yield_factor": 1.6, "noise": 0.01})

Everything here is traceable: `jax.jit`, `vmap`, `grad` and `hessian` work through it.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array

import softjax as sj
from calibration.data import RestitutionData
from calibration.errors import DataError
from calibration.fitting.assembly import Component
from calibration.fitting.plan import is_stated
from calibration.fitting.problem import Element
from calibration.fitting.request import Request, datasets_of
from calibration.fitting.root import extended_root
from calibration.fitting.rows import with_trees
from calibration.fitting.specs import SetSpec
from calibration.fitting.transform import Transform

NOISE = "noise"


@dataclass(frozen=True)
class Traceable:
    """A law against data, as functions of {name: value}.

    Attributes:
        names: of the free parameters, as `FitResult.values` has them.
        start: where a search would begin, by name.
        noises: names of the standard deviations of ε of data sets without stated uncertainties:
            "noise", or "noise[name]" where there are several. Where θ has none of them they are
            profiled: put where the likelihood is largest.
    """

    names: tuple[str, ...]
    start: Mapping[str, float]
    noises: tuple[str, ...]
    _components: tuple[Component, ...]
    _route: Any

    def predict(self, theta: Mapping[str, Any]) -> list[Array]:
        """ε at the points of each data set."""
        return [self._curve(theta, component, k) for component, k, _ in self._sets()]

    def residuals(self, theta: Mapping[str, Any]) -> Array:
        """Predicted less measured ε over the standard deviation of each, then those of the priors.

        Without stated uncertainties over θ's noise, or over 1 where it has none.
        """
        parts = []
        for component, k, spec in self._sets():
            left = self._curve(theta, component, k) - spec.data.restitution
            parts.append(left / self._deviation(theta, spec.data, jnp.ones(())))
        return jnp.concatenate([*parts, self._prior_residuals(theta)])

    def log_likelihood(self, theta: Mapping[str, Any]) -> Array:
        """ln p(data | θ), the sum of `point_log_likelihood`."""
        return jnp.sum(self.point_log_likelihood(theta))

    def point_log_likelihood(self, theta: Mapping[str, Any]) -> Array:
        """ln p(ε_i | θ) of every point, in the order of the data sets."""
        parts = []
        for component, k, spec in self._sets():
            left = self._curve(theta, component, k) - spec.data.restitution
            best = jnp.sqrt(jnp.mean(left**2))  # the noise of the largest likelihood
            deviation = self._deviation(theta, spec.data, best)
            parts.append(
                -0.5 * (left / deviation) ** 2 - jnp.log(deviation) - 0.5 * math.log(2 * math.pi)
            )
        return jnp.concatenate(parts)

    def log_prior(self, theta: Mapping[str, Any]) -> Array:
        """ln p(θ) of the priors that were stated; 0 without, -∞ outside the ranges."""
        total = -0.5 * jnp.sum(self._prior_residuals(theta) ** 2)
        for element in self._elements():
            value = jnp.asarray(theta[element.label])
            if element.parameter.prior is not None:
                total -= math.log(element.parameter.prior[1]) + 0.5 * math.log(2 * math.pi)
            low, high = element.range
            total = jnp.where((value < low) | (value > high), -jnp.inf, total)
        for name in self.noises:
            if name in theta:
                total = jnp.where(jnp.asarray(theta[name]) > 0, total, -jnp.inf)
        return total

    @property
    def transform(self) -> Transform:
        """The map from an unconstrained vector, in the order of `names`, to values."""
        elements = self._elements()
        return Transform.of([e.range for e in elements], [e.parameter.transform for e in elements])

    def _elements(self) -> list[Element]:
        return [e for component in self._components for e in component.elements]

    def _sets(self) -> list[tuple[Component, int, SetSpec]]:
        """Every data set, in the order in which they were given."""
        rows = [(g, c, k) for c in self._components for k, g in enumerate(c.sets)]
        return [(c, k, c.specs[k]) for _, c, k in sorted(rows, key=lambda row: row[0])]

    def _curve(self, theta, component: Component, k: int) -> Array:
        spec, g = component.specs[k], component.sets[k]
        labels = {e.name: e.label for e in component.elements if g in e.sets}
        numbers = {
            local.name: jnp.asarray(theta[labels[local.name]])
            if local.name in labels
            else local.start
            for local in spec.local
        }
        law = spec.model.law(spec.data.contact, with_trees(numbers, spec.trees))
        found = sj.signed_restitution(law, spec.data.velocity, self._route)
        return extended_root(found.squared, jnp)

    def _deviation(self, theta, data: RestitutionData, unknown: Array) -> Array:
        if is_stated(data):
            return jnp.asarray(data.uncertainty)
        name = NOISE if len(self.noises) == 1 else f"{NOISE}[{data.name}]"
        return jnp.asarray(theta[name]) if name in theta else unknown

    def _prior_residuals(self, theta) -> Array:
        rows = []
        for e in self._elements():
            if e.parameter.prior is not None:
                mean, deviation = e.parameter.prior
                rows.append((jnp.asarray(theta[e.label]) - mean) / deviation)
        return jnp.stack(rows) if rows else jnp.zeros(0)


def problem(
    data: RestitutionData | Sequence[RestitutionData],
    law: str | type | Callable[..., sj.ContactLaw] | None = None,
    parameters: Mapping[str, Any] | Sequence[Mapping[str, Any]] | None = None,
    *,
    route: sj.EnergyBalance | sj.ODE | None = None,
) -> Traceable:
    """A law against data as JAX-traceable functions: residuals, likelihood, prior.

    Args:
        data, law, parameters: as `fit` takes them.
        route: what suits the law where left out.

    Returns:
        A `Traceable`, whose θ are mappings {name: value} in physical units.

    Raises:
        ValueError: naming the argument, its value and what is accepted.
    """
    request = Request(datasets_of(data), law, parameters, route=route)
    with jax.enable_x64(True):
        specs = request.specs()
        if any(spec.objective != "model" for spec in specs):
            raise DataError("objective", "two-step", "model, which has a likelihood")
        components = request.components()
    unstated = [d.name for d in request.datasets if not is_stated(d)]
    noises = [NOISE] if len(unstated) == 1 else [f"{NOISE}[{name}]" for name in unstated]
    elements = [e for component in components for e in component.elements]
    start = {e.label: e.start for e in elements}
    return Traceable(tuple(start), start, tuple(noises), tuple(components), route)
