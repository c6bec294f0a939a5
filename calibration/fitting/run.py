"""A request fitted: searches, profiles, warnings and what uncertain inputs add, as one record of estimates."""

import importlib.metadata
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache, partial
from typing import Any, TypeVar

import numpy as np
from scipy.linalg import block_diag

from calibration.data.inputs import stated_inputs
from calibration.fitting.budget import (
    Budget,
    budget_of,
    effects_of_one_per_cent,
    with_input_uncertainty,
)
from calibration.fitting.components import ComponentFit, fitted, likelihood_of
from calibration.fitting.estimates import FitEstimates
from calibration.fitting.line import fit_line, with_inputs
from calibration.fitting.material import Estimate, MaterialFit
from calibration.fitting.pools import pooled_estimates
from calibration.fitting.profiles import Profile, profiles_of
from calibration.fitting.request import Request
from calibration.fitting.search import OPTIMISERS, one_thread
from calibration.fitting.summary import results_at, summarise
from calibration.fitting.warnings import FitWarning, in_order
from calibration.options import idle

Progress = Callable[..., None]  # called as progress(stage, done, total)
PACKAGES = ("softjax-contact", "jax", "diffrax", "optax", "optimistix", "numpy", "scipy")
FEW_SETS = 3  # data sets up to which a fit looks at what its exact inputs move
_version = cache(importlib.metadata.version)
Result = TypeVar("Result", bound=FitEstimates)


def run(
    request: Request, stated: Mapping[str, Any] | None, tell: Progress, kind: type[Result]
) -> Result:
    """Fit all components of a request.

    Args:
        stated: standard uncertainties of inputs in addition to those of the data, as of `fit`.
        tell: called as tell(stage, done, total).
        kind: the class of the record that is made.
    """
    with one_thread():
        return _run(request, stated, tell, kind)


def _run(
    request: Request, stated: Mapping[str, Any] | None, tell: Progress, kind: type[Result]
) -> Result:
    options, started = request.options, time.perf_counter()
    names = [data.name for data in request.datasets]
    pairs = zip(request.datasets, stated_inputs(stated, names), strict=True)
    inputs = [data.uncertain_inputs(own) for data, own in pairs]
    fits = fitted(request, lambda done, count: tell("fit", done, count))
    line = fit_line(request, fits)
    seconds = time.perf_counter() - started
    curves: list[dict[str, Profile]] = [{} for _ in fits]
    if options.profiles:
        done = lambda count: tell("profiles", count, len(fits))  # noqa: E731
        curves = profiles_of(fits, options.confidence, done)
        done(len(fits))
    materials: dict[int, MaterialFit] = {}
    pooled = pooled_estimates(fits, options.confidence)
    for fit, profiles in zip(fits, curves, strict=True):
        parts, drag = summarise(fit, profiles, options)
        materials |= dict(zip(fit.component.sets, parts, strict=True))
        pooled |= drag
    ordered = tuple(materials[g] for g in sorted(materials))
    found = [warning for material in ordered for warning in material.warnings]
    stages = [stage for fit in fits for stage in fit.stages]
    if line is not None:
        stage = replace(line.fit.final, report=replace(line.fit.final.report, stage="Eq. (18)"))
        stages.append(stage)
        if not stage.ends.converged[0]:
            found.append(FitWarning("not-converged", f"Eq. (18): {stage.report.reason}"))
    condition = max(float(fit.uncertainty.condition_number) for fit in fits)
    names, covariance, of_predictions = _covariances(fits)
    result = kind(
        request=request,
        materials=ordered,
        unloading_line=None if line is None else line.line,
        covariance_names=names,
        covariance=covariance,
        of_predictions=of_predictions,
        rank=sum(int(fit.uncertainty.rank) for fit in fits),
        condition_number=condition if np.isfinite(condition) else None,
        likelihood=likelihood_of(fits, options),
        warnings=in_order(found),
        optimiser_report=tuple(stage.report for stage in stages),
        profiles={label: curve for profiles in curves for label, curve in profiles.items()},
        dof_by_component=tuple(
            f.uncertainty.dof.physical(
                f.slope, f.uncertainty.covariance_known_noise, f.uncertainty.se_inflation
            )
            for f in fits
        ),
        settings=_settings(request, fits),
        versions={name: _version(name) for name in PACKAGES},
        times={"searches": seconds},
        pooled=pooled,
        fits=tuple(fits),
    )
    if not all(fit.is_likelihood for fit in fits):
        return result
    results = partial(results_at, len(ordered))
    if not any(inputs):
        if len(ordered) > FEW_SETS:
            return result
        return replace(result, of_one_per_cent=effects_of_one_per_cent(request, fits, results))
    tell("inputs", 0, 1)
    curvature = dict(zip(names, np.sqrt(np.diag(covariance)).tolist(), strict=True))
    budget = budget_of(request, fits, inputs, result.estimates, curvature, results)
    if budget is None:
        return result
    if line is not None:
        named = dict(zip((data.name for data in request.datasets), inputs, strict=True))
        by_name = {material.name: material for material in ordered}
        result = replace(result, unloading_line=with_inputs(line, named, budget, by_name))
    return _with_inputs(result, budget)


def _with_inputs(result: Result, budget: Budget) -> Result:
    """The result with what uncertain inputs add to its errors and intervals."""

    def of(estimates: Mapping[str, Estimate], labels: Mapping[str, str]) -> dict[str, Estimate]:
        return {
            name: with_input_uncertainty(
                estimate, budget, labels.get(name, name), result.confidence
            )
            for name, estimate in estimates.items()
        }

    is_single = len(result.materials) == 1
    materials = []
    for material in result.materials:
        derived = {n: n if is_single else f"{n}[{material.name}]" for n in material.derived}
        parameters = of(material.parameters, material.labels)
        derived_too = of(material.derived, derived)
        materials.append(replace(material, parameters=parameters, derived=derived_too))
    return replace(
        result,
        materials=tuple(materials),
        pooled=of(result.pooled, {}),
        covariance=result.covariance + budget.covariance(result.covariance_names),
        statistical_covariance=result.covariance,
        budget=budget,
    )


def _covariances(fits: list[ComponentFit]):
    """Covariance of all free parameters in physical units, D C D with D = ∂θ/∂z; zero between components."""
    names = tuple(e.label for fit in fits for e in fit.component.elements)
    both = block_diag(*(np.outer(fit.slope, fit.slope) for fit in fits))
    known = np.concatenate([fit.uncertainty.known & fit.has_intervals for fit in fits])
    covariance = both * block_diag(*(np.nan_to_num(fit.uncertainty.covariance) for fit in fits))
    covariance[~known], covariance[:, ~known] = np.nan, np.nan
    parts = (f.uncertainty.of_predictions * (1.0 if f.has_intervals else np.nan) for f in fits)
    return names, covariance, both * block_diag(*parts)


def _settings(request: Request, fits: list[ComponentFit]) -> dict[str, Any]:
    specs = [spec for fit in fits for spec in fit.component.specs]
    contacts = [spec.data.contact for spec in specs if spec.data.contact is not None]
    options = request.options
    without_effect = idle(dict(options))
    names = ("noise", "noise_dof", "starts", "seed", "max_steps")
    table: dict[str, Any] = {
        "objective": ", ".join(sorted({spec.objective for spec in specs})),
        "law": ", ".join(dict.fromkeys(spec.model.key for spec in specs)),
        "route": fits[0].final.report.route,
        "optimiser": OPTIMISERS[options.optimiser],
        "area": contacts[0].area if contacts else None,
        **{name: value for spec in specs for name, value in spec.model.options.items()},
        "x64": True,
        **{name: getattr(options, name) for name in names if name not in without_effect},
    }
    for name, value in fits[0].final.problem.collided_by.settings.items():
        table[f"{name} of the route" if name in table else name] = value
    groups = {
        e.label: [fit.component.specs[g].data.name for g in e.sets]
        for fit in fits
        for e in fit.component.elements
        if len(e.sets) > 1
    }
    return table | ({"shared": groups} if groups else {})
