"""The likelihood of a law's parameters as pure JAX functions, for whoever samples or searches.

    problem = cal.problem(data, sj.Thornton)
    problem.log_likelihood({"yield_factor": 1.6, "noise": 0.01})

Everything here is traceable: `jax.jit`, `vmap`, `grad` and `hessian` work through it.

The reference's page `how_to` samples it by NumPyro and BlackJAX; `FitResult.posterior` does the latter
with priors, transforms and diagnostics of its own.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

import softjax as sj
from calibration.data import RestitutionData
from calibration.errors import DataError, listed
from calibration.fitting.collisions import root
from calibration.fitting.elements import Element, Pool, pools_of
from calibration.fitting.errors import CALLED, Errors, MeasuredCurve
from calibration.fitting.noise import LN_2PI
from calibration.fitting.problem import Problem
from calibration.fitting.request import (
    Component,
    Request,
    SetSpec,
    assemble,
    datasets_of,
    transform_of,
)
from calibration.fitting.rows import Block, Points
from calibration.observables import OBSERVABLES, RESTITUTION, predicted
from calibration.options import FitOptions, require_likelihood
from calibration.parameters import Transform

START_SPREAD = 0.3  # of a pool
Theta = Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class NamedErrors:
    """One observable of a data set, and what θ calls each unknown of its errors."""

    problem: Problem  # the likelihood that it is a part of
    block: Block  # where its points stand in that
    errors: Errors
    set: int  # the data set, of all of them
    labels: Mapping[str, str]  # names of the square root of each unknown variance

    @property
    def data(self) -> RestitutionData:
        return self.problem.datasets[self.block.set]

    @property
    def points(self) -> Points:
        """Values as measured, and their units."""
        return Points(*(a[self.block.span] for a in self.problem.points))

    @property
    def per_unit(self) -> float:
        """Root mean square effect on ε of errors of 1 s in all times, or of 1 m in all heights."""
        points = self.errors.points
        factors = points.to_restitution * points.sizes_at(1.0)
        return max(float(np.sqrt(np.mean(np.sum(factors**2, axis=1)))), 1e-300)

    def variances(self, theta: Theta, residual: Any) -> dict[str, Any]:
        """s as θ has it; plain noise that it does not have is put where the likelihood is largest."""
        variances = {}
        for kind, label in self.labels.items():
            if label in theta:
                variances[kind] = jnp.asarray(theta[label]) ** 2
            elif self.errors.is_plain and self.errors.noise.is_least_squares:
                variances[kind] = jnp.mean(residual**2)
            else:
                accepted = "with it: only plain normal noise is profiled"
                raise DataError("theta", f"without {label!r}", accepted)
        return variances

    def predictions(self, theta: Theta, route: Any) -> MeasuredCurve:
        """Predictions at the points, with the effect of the air, in their units."""
        errors, points = self.errors, self.points
        vector = _vector(self.problem, theta)
        velocity = jnp.asarray(errors.nodes if errors.has_velocity_errors else errors.velocity)
        law = self.problem.laws.of_points(vector, self.block.span)
        if OBSERVABLES[self.block.observable].is_signed_square:
            value = root(sj.signed_restitution(law, velocity, route).squared, jnp)
        else:
            hit = sj.restitution(law, velocity, route)
            value = predicted(self.block.observable, hit) / points.unit
        curve = (
            errors.measured_curve(value)
            if errors.has_velocity_errors
            else MeasuredCurve(value, 0.0, 0.0)
        )
        if self.problem.drag is None or not np.any(points.by_drag):
            return curve
        return curve._replace(mean=curve.mean + vector[self.problem.drag] * points.by_drag)


def _vector(problem: Problem, theta: Theta) -> Array:
    """θ in the order of a problem's elements."""
    return jnp.array([jnp.asarray(theta[e.label]) for e in problem.elements], float)


@dataclass(frozen=True)
class Traceable:
    """A law against data, as functions of {name: value}.

    Attributes:
        names: of the free parameters, as `FitResult.values` has them; of pooled ones those of each
            data set, and behind all the mean and the spread of each pool, "chi" and "chi_spread".
        start: where a search would begin, by name.
        noises: names of what is not stated of the errors: "noise", the standard deviation of ε;
            "group", that of the groups' offsets in ε; "timing" [s], that of times of bounces;
            "scale", the factor on stated uncertainties. "noise[name]" where there are several sets; "contact_time_noise" and so on, relative, of other observables. Plain
            normal noise that θ does not have is profiled: put where the likelihood is largest.
        sets: the errors of each data set and observable, in their order.
        components: parameters and laws.
        pools: which of the parameters lie around a common mean.
        route: from a law to ε.
    """

    names: tuple[str, ...]
    start: Mapping[str, float]
    noises: tuple[str, ...]
    sets: tuple[NamedErrors, ...]
    components: tuple[Component, ...]
    pools: tuple[Pool, ...]
    route: Any

    def predict(self, theta: Theta) -> list[Array]:
        """E[ε] at the points of each data set, or another observable in SI; see `calibration.fitting.errors`."""
        return [curve.mean * block.points.unit for block, _, curve in self._at(theta)]

    def residuals(self, theta: Theta) -> Array:
        """Predicted less measured ε over the standard deviation of each, then those of the priors.

        Where points share errors, without what they share. Over 1 where θ has no noise.
        """
        parts = []
        for block, residual, curve in self._at(theta):
            if block.errors.is_plain and not set(block.labels.values()) <= set(theta):
                parts.append(residual)
                continue
            s = block.variances(theta, residual)
            factor = block.errors.factor(s, curve.slope, curve.curvature_variance, jnp)
            parts.append(block.errors.whiten(factor, residual[:, None], jnp)[:, 0])
        return jnp.concatenate([*parts, self._priors(theta)[0]])

    def log_likelihood(self, theta: Theta, measured: Array | None = None) -> Array:
        """ln p(data | θ).

        Args:
            measured: values in place of the measured ones, of all `sets` in a row, in their units.
        """
        parts = [
            block.errors.deviance(
                block.variances(theta, residual), residual, c.slope, c.curvature_variance, jnp
            )
            for block, residual, c in self._at(theta, measured)
        ]
        return -0.5 * jnp.sum(jnp.stack(parts))

    def point_log_likelihood(self, theta: Theta) -> Array:
        """ln p(ε_i | θ) of every point, in the order of the data sets.

        Where points share errors, of each where the others are known; see `Errors.by_point`.
        """
        parts = [
            block.errors.by_point(
                block.variances(theta, residual), residual, c.slope, c.curvature_variance, jnp
            )
            + 0 * residual
            for block, residual, c in self._at(theta)
        ]
        return jnp.concatenate(parts)

    def simulated(self, theta: Theta, normal: Array) -> Array:
        """Measurements as the law and its errors make them, from standard normal numbers, one a point."""
        parts = []
        for (block, residual, curve), some in zip(
            self._at(theta), self._split(normal), strict=True
        ):
            s = block.variances(theta, residual)
            factor = block.errors.factor(s, curve.slope, curve.curvature_variance, jnp)
            heavy = block.errors.noise.from_normal(some, jnp)
            parts.append(curve.mean + block.errors.colour(factor, heavy, jnp))
        return jnp.concatenate(parts)

    def log_prior(self, theta: Theta) -> Array:
        """ln p(θ) of the priors that were stated and of pools; 0 without, -∞ outside the ranges."""
        self._check_names(theta)
        residuals, log_sizes = self._priors(theta)
        total = -jnp.sum(0.5 * (residuals**2 + LN_2PI) + log_sizes)
        ranges = {e.label: e.range for e in self.elements}
        outside = [(theta[n] < low) | (theta[n] > high) for n, (low, high) in ranges.items()]
        sizes = (*self.noises, *(pool.spread_name for pool in self.pools))
        outside += [~(jnp.asarray(theta[name]) > 0) for name in sizes if name in theta]
        return jnp.where(jnp.any(jnp.array(outside, bool)), -jnp.inf, total)

    @property
    def transform(self) -> Transform:
        """The map from an unconstrained vector, in the order of `elements`, to values."""
        return transform_of(self.elements)

    @property
    def elements(self) -> list[Element]:
        """The free parameters, in the order of `names`."""
        return [e for component in self.components for e in component.elements]

    @property
    def specs(self) -> list[SetSpec]:
        """Law, parameters and errors of each data set, in their order."""
        by_set = {g: s for c in self.components for g, s in zip(c.sets, c.specs, strict=True)}
        return [by_set[g] for g in sorted(by_set)]

    def law(self, theta: Theta, g: int) -> sj.ContactLaw:
        """The law of a data set, of all its impacts where they differ."""
        component = next(c for c in self.components if g in c.sets)
        problem = component.stages[0][1]
        points = np.flatnonzero(problem.points.set == component.sets.index(g))
        return problem.laws.of_points(_vector(problem, theta), points)

    def _split(self, values: Array) -> list[Array]:
        """Values of all points by data set."""
        return jnp.split(values, np.cumsum([len(block.errors) for block in self.sets])[:-1])

    def _check_names(self, theta: Theta) -> None:
        names = [element.label for element in self.elements]
        missing = [name for name in names if name not in theta]
        if missing:
            raise DataError("theta", f"without {missing[0]!r}", f"with {listed(names)}")

    def _at(self, theta: Theta, measured=None) -> list[tuple[NamedErrors, Array, MeasuredCurve]]:
        """Errors of each data set, predicted minus measured ε, and the curve."""
        if measured is None:
            measured = jnp.concatenate([jnp.asarray(block.points.value) for block in self.sets])
        self._check_names(theta)
        curves = [block.predictions(theta, self.route) for block in self.sets]
        every = zip(self.sets, curves, self._split(measured), strict=True)
        return [(block, curve.mean - part, curve) for block, curve, part in every]

    def _priors(self, theta: Theta) -> tuple[Array, Array]:
        """Residuals of the priors and of members of pools, and logarithms of their standard deviations in θ."""
        residuals, log_sizes = [], []
        for e in self.elements:
            if e.parameter.prior is not None:
                mean, deviation = e.parameter.prior
                residuals.append((theta[e.label] - mean) / deviation)
                log_sizes.append(math.log(deviation))
        for pool in self.pools:  # normal on the scale that is searched
            values, spread = [theta[self.names[k]] for k in pool.members], theta[pool.spread_name]
            of_members, of_mean = (
                self.transform.part([*k]) for k in (pool.members, pool.members[:1])
            )
            z = of_members.unconstrained(jnp.array(values, float), jnp)
            mean = of_mean.unconstrained(jnp.array([theta[pool.name]], float), jnp)
            residuals.extend((z - mean) / spread)
            log_sizes.extend(jnp.log(spread) + of_members.log_slope(z))
        return jnp.array(residuals, float), jnp.array(log_sizes, float)


def problem(
    data: RestitutionData | Sequence[RestitutionData],
    law: str | type | Callable[..., sj.ContactLaw] | None = None,
    parameters: Mapping[str, Any] | Sequence[Mapping[str, Any]] | None = None,
    *,
    route: sj.AbstractRoute | None = None,
    extra_scatter: bool | None = None,
    scale_uncertainty: bool = False,
    noise: str = "normal",
    noise_dof: float = 4.0,
) -> Traceable:
    """A law against data as JAX-traceable functions: residuals, likelihood, prior.

    Args:
        data, law, parameters, extra_scatter, scale_uncertainty, noise, noise_dof: as `fit` takes
            them.
        route: what suits the law where left out.

    Returns:
        A `Traceable`, whose θ are mappings {name: value} in physical units.

    Raises:
        ValueError: naming the argument, its value and what is accepted.
    """
    keywords = {"law": law, "route": route, "noise": noise, "noise_dof": noise_dof}
    more = {"extra_scatter": extra_scatter, "scale_uncertainty": scale_uncertainty}
    options = FitOptions.of(**keywords, **more)
    return traceable(Request(datasets_of(data), parameters, options))


def traceable(request: Request) -> Traceable:
    """The traceable problem of a fit's request."""
    with jax.enable_x64(True):
        components = assemble(request)
    for component in components:
        for spec in component.specs:
            require_likelihood(spec.objective)
    sets = _named(components)
    noises = tuple(label for block in sets for label in block.labels.values())
    elements = [e for component in components for e in component.elements]
    start, pools = {e.label: e.start for e in elements}, pools_of(elements)
    for pool in pools:
        start |= {pool.name: elements[pool.members[0]].start, pool.spread_name: START_SPREAD}
    taken = next((name for name in start if name in noises), None)
    if taken is not None:
        accepted = f"named otherwise: theta[{taken!r}] is an error of the data here"
        raise DataError("parameter", taken, accepted)
    return Traceable(tuple(start), start, noises, sets, tuple(components), pools, request.route)


def _named(components: Sequence[Component]) -> tuple[NamedErrors, ...]:
    """Names of the unknown sizes of the errors, with the data set if several have one."""
    named = []
    for component in components:
        problem = component.stages[0][1]
        for block, errors in zip(problem.blocks, problem.errors, strict=True):
            named.append(NamedErrors(problem, block, errors, component.sets[block.set], {}))
    named.sort(key=lambda errors: errors.set)
    names = [(errors.block.observable, kind) for errors in named for kind in errors.errors.unknown]

    def label(errors: NamedErrors, kind: str) -> str:
        name = errors.block.observable
        text = "" if name == RESTITUTION else f"{name}_"
        text += CALLED.get(kind, kind)
        return f"{text}[{errors.data.name}]" if names.count((name, kind)) > 1 else text

    return tuple(replace(e, labels={k: label(e, k) for k in e.errors.unknown}) for e in named)
