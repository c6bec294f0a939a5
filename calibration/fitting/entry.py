"""Fit a law's parameters to measured restitutions: `fit` is the entry to everything here."""

import importlib.metadata
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from typing import Any

import jax
import numpy as np

import softjax as sj
from calibration.console import progress_of
from calibration.data import RestitutionData
from calibration.errors import DataError
from calibration.fitting.laws import law_name
from calibration.fitting.layout import assemble
from calibration.fitting.line import fit_line
from calibration.fitting.material import Estimate, MaterialFit
from calibration.fitting.problem import DRAG
from calibration.fitting.profiles import Profile, estimates, profiles_of
from calibration.fitting.request import Progress, Request, datasets_of
from calibration.fitting.result import FitResult
from calibration.fitting.search import OPTIMISERS
from calibration.fitting.stages import ComponentFit, fit_component, likelihood_of
from calibration.fitting.summary import component_warnings, summarise_material
from calibration.fitting.variances import pooled_estimates
from calibration.fitting.warnings import FitWarning
from calibration.options import FitOptions, documented

PACKAGES = ("softjax-contact", "jax", "diffrax", "optax", "optimistix", "numpy", "scipy")


@documented
def fit(
    data: RestitutionData | Sequence[RestitutionData],
    law: str | type | Callable[..., sj.ContactLaw] | None = None,
    parameters: Mapping[str, Any] | Sequence[Mapping[str, Any]] | None = None,
    *,
    progress: Progress | bool | None = None,
    **options: Any,
) -> FitResult:
    """Fit a contact law to one data set or several.

    Args:
        data: one `RestitutionData`, or a list of them with different names.
        law: Zhou's where left out (for data without a contact Eq. (17), or a constant); a name of
            `LAWS`, a class of contact laws, or any function that builds one: law(contact, c1, c2).
        parameters: the parameters of the law: {"chi": ...} for all data sets,
            {"chi[name]": ...} for one; a `Parameter`, a number that fixes it, or a text for an
            option such as {"form": "full"}; or a list of such mappings, one a data set. Those of
            the contact are "contact.yield_strength" and so on. All of a law's own are free, except
            what ε does not determine.
        progress: True shows it, a bar on a terminal and else a line a stage; or a function that is
            called as progress(stage, done, total).
        OPTIONS

    Returns:
        A `FitResult`. A fit that did not converge is marked so, not raised.

    Data sets that share no parameter are fitted each by itself. All is computed in float64, whatever
    JAX is set to.

    Raises:
        ValueError: naming the argument, its value and what is accepted.

    Example:
        >>> import calibration as cal
        >>> steel = cal.paper_materials()[0]
        >>> result = cal.fit(steel, objective="two-step")
        >>> round(result.values["chi"], 4)
        1.7944
    """
    begun = time.perf_counter()
    with progress_of(progress) as shown, jax.enable_x64(True):
        options_of_fit = FitOptions.of(law=law, **options)
        if not (shown is None or callable(shown)):
            accepted = "True, or called as progress(stage, done, total)"
            raise DataError("progress", shown, accepted)
        request = Request(datasets_of(data), parameters, options_of_fit, shown)
        result = _fitted(request)
    result.times["total"] = time.perf_counter() - begun
    return replace(result, request=replace(request, progress=None))


def _fitted(request: Request) -> FitResult:
    fits = []
    components = assemble(request)
    for k, component in enumerate(components):
        request.tell("fit", k, len(components))
        fits.append(fit_component(component, request.options))
    request.tell("fit", len(components), len(components))
    line = fit_line(request, fits)
    curves: list[dict[str, Profile]] = [{} for _ in fits]
    if request.options.profiles:
        tell = partial(request.tell, "profiles", total=len(fits))
        curves = profiles_of(fits, request.options.confidence, tell)
        tell(len(fits))
    found_warnings: list[FitWarning] = []
    materials: dict[int, MaterialFit] = {}
    of_drag: dict[str, Estimate] = {}
    for fit_, own in zip(fits, curves, strict=True):
        found = estimates(fit_, own, request.options.confidence)
        shared = component_warnings(fit_, found, own)
        elements = enumerate(fit_.component.elements)
        of_drag |= {e.label: found[k] for k, e in elements if e.name == DRAG}
        found_warnings += [d for d in shared if d.material is None]
        for g in fit_.component.sets:
            materials[g] = summarise_material(fit_, g, found, request.options.confidence, shared)
    ordered = tuple(materials[g] for g in sorted(materials))
    stages = [stage for one in fits for stage in one.stages]
    stage = None if line is None else line[1]
    if stage is not None:
        stages.append(replace(stage, report=replace(stage.report, stage="Eq. (18)")))
    for material in ordered:
        found_warnings += material.warnings
    if stage is not None and not stage.found.converged[0]:
        found_warnings.append(FitWarning("not-converged", f"Eq. (18): {stage.report.reason}"))
    names, covariance, of_predictions = _covariances(fits)
    condition = max(float(f.uncertainty.condition_number) for f in fits)
    found_warnings.sort(key=lambda one: one.code != "plausibility")  # whose numbers are all wrong
    return FitResult(
        request=request,
        materials=ordered,
        unloading_line=None if line is None else line[0],
        covariance_names=names,
        covariance=covariance,
        of_predictions=of_predictions,
        rank=sum(int(f.uncertainty.rank) for f in fits),
        condition_number=condition if np.isfinite(condition) else None,
        likelihood=likelihood_of(fits, request.options),
        warnings=tuple(dict.fromkeys(found_warnings)),
        optimiser_report=tuple(one.report for one in stages),
        profiles={label: curve for own in curves for label, curve in own.items()},
        freedoms=tuple(f.uncertainty.freedom.physical(f.slope, f.uncertainty.whole) for f in fits),
        settings=_settings(request, fits),
        versions={name: _version(name) for name in PACKAGES},
        times={stage.report.label: stage.seconds for stage in stages},
        pooled=pooled_estimates(fits, request.options.confidence) | of_drag,
        fits=tuple(fits),
    )


def _covariances(fits: list[ComponentFit]):
    """Covariance of all free parameters in physical units, D C D with D = ∂θ/∂z; zero between components."""
    from scipy.linalg import block_diag

    names = tuple(e.label for one in fits for e in one.component.elements)
    both = block_diag(*(np.outer(one.slope, one.slope) for one in fits))
    known = np.concatenate([one.uncertainty.known for one in fits])
    covariance = both * block_diag(*(np.nan_to_num(one.uncertainty.covariance) for one in fits))
    covariance[~known], covariance[:, ~known] = np.nan, np.nan
    return names, covariance, both * block_diag(*(one.uncertainty.of_predictions for one in fits))


@cache
def _version(package: str) -> str:
    return importlib.metadata.version(package)


def _settings(request: Request, fits: list[ComponentFit]) -> dict[str, Any]:
    specs = [spec for one in fits for spec in one.component.specs]
    contacts = [spec.data.contact for spec in specs if spec.data.contact is not None]
    options, integrated = request.options, fits[0].final.problem.route
    asked = ["noise", "starts", "seed", "max_steps"]
    asked += ["noise_dof"] * (options.noise == "student-t")
    table: dict[str, Any] = {
        "objective": ", ".join(sorted({spec.objective for spec in specs})),
        "law": ", ".join(dict.fromkeys(spec.model.key for spec in specs)),
        "route": fits[0].final.report.route,
        "optimiser": OPTIMISERS[options.optimiser],
        "area": contacts[0].area if contacts else None,
        **{name: value for spec in specs for name, value in spec.model.options.items()},
        "x64": True,
        **{name: getattr(options, name) for name in asked},
        "given_law": law_name(options.law),
    }
    if isinstance(integrated, sj.ODE):
        steps = integrated.steps
        how = {"rtol": integrated.tolerance} if steps is None else {"steps": steps}
        table |= {"solver": integrated.solver, **how}
    elements = [e for one in fits for e in one.component.elements if len(e.sets) > 1]
    groups = {e.label: [request.datasets[g].name for g in e.sets] for e in elements}
    return table | ({"shared": groups} if groups else {})
