"""From the stages of a fit to the result a user sees."""

import importlib.metadata
from functools import cache

import numpy as np

import softjax as sj
from calibration.doubt import Doubt
from calibration.intervals import estimate_of, physical_covariance, profiles_of
from calibration.material_summary import summarise_material
from calibration.result import FitResult
from calibration.search import OPTIMISERS
from calibration.suspicions import shared_doubts

PACKAGES = ("softjax-contact", "jax", "diffrax", "optax", "optimistix", "numpy", "scipy")


def summarise(fitted, model, options, line, beside, confidence, with_profiles) -> FitResult:
    """Everything that is told about a fit; `fitted` is a `fitting.Fitted`."""
    setup = fitted.setup
    curves = profiles_of(fitted, options, confidence) if with_profiles else {}
    estimates = {
        e.position: estimate_of(fitted, e, curves.get(e.label), confidence) for e in setup.elements
    }
    shared = shared_doubts(fitted, estimates, curves)
    materials = tuple(
        summarise_material(fitted, model, g, estimates, confidence, shared)
        for g in range(len(setup.counts))
    )
    names, covariance = physical_covariance(fitted)
    reports = [s.report for s in fitted.stages] + (
        [line.stage.report] if line and line.stage else []
    )
    known = fitted.uncertainty
    return FitResult(
        materials=materials,
        unloading_line=line.line if line else None,
        covariance_names=names,
        covariance=covariance,
        rank=known.rank,
        condition_number=known.condition_number if np.isfinite(known.condition_number) else None,
        confidence=confidence,
        warnings=_all_warnings(materials, shared, line),
        optimiser_report=tuple(reports),
        beside={k: v for k, v in beside.items() if k != "seconds"} if beside else None,
        profiles=curves,
        degrees=known.degrees,
        settings=_settings(setup, model, options),
        versions=dict(_versions()),
        times=_times(fitted, line, beside),
    )


@cache
def _versions() -> dict[str, str]:
    return {name: importlib.metadata.version(name) for name in PACKAGES}


def _times(fitted, line, beside) -> dict[str, float]:
    times = {stage.report.stage: stage.seconds for stage in fitted.stages}
    if line and line.stage:
        times[line.stage.report.stage] = line.stage.seconds
    if beside:
        times["beside"] = beside["seconds"]
    return times


def _settings(setup, model, options) -> dict:
    plans = sorted(set(setup.plans))
    route = model.route
    table = {
        "objective": plans[0] if len(plans) == 1 else ", ".join(plans),
        "route": route.name,
        "optimiser": OPTIMISERS[options.optimiser],
        "area": setup.area,
        "form": model.form,
        "kappa": model.kappa,
        "x64": True,
        "loss": options.loss,
        "starts": options.starts,
        "seed": options.seed,
        "max_steps": options.max_steps,
    }
    if options.loss != "squared":
        table["loss_scale"] = options.loss_scale
    if isinstance(route, sj.ODE):
        steps = {"rtol": route.tolerance} if route.steps is None else {"steps": route.steps}
        table |= {"solver": route.solver, **steps}
    groups = {
        e.label: [setup.datasets[g].name for g in e.sets] for e in setup.elements if len(e.sets) > 1
    }
    return table | ({"shared": groups} if groups else {})


def _all_warnings(materials, shared, line) -> tuple[Doubt, ...]:
    """Each doubt once: the common ones, then those of each data set."""
    everything = [d for d in shared if d.material is None]
    for material in materials:
        everything += material.warnings
    if line is not None and not line.line.converged:
        everything.append(Doubt("not-converged", f"Eq. (18): {line.stage.search.reason}"))
    return tuple(dict.fromkeys(everything))
