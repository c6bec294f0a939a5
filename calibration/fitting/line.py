"""Eq. (18), χ̃ = c1 + c2 E/Y: one line for several materials of Zhou's law."""

from dataclasses import replace

import numpy as np

from calibration.fitting.estimate import Estimate
from calibration.fitting.laws import LINE, several_yields
from calibration.fitting.layout import SetSpec
from calibration.fitting.profiles import estimate_of
from calibration.fitting.request import Request
from calibration.fitting.stages import ComponentFit, StageFit
from calibration.fitting.summary import derived_of, eps_up_of
from calibration.fitting.uncertainty import quantile
from calibration.fitting.unloading_line import Line, LineMaterial
from calibration.parameters import Parameter

ROUNDING = 1e-10  # standard errors of χ̃, as a share of it, that tell nothing


def fit_line(request: Request, fits: list[ComponentFit]) -> tuple[Line, StageFit | None] | None:
    """The line through all materials with a χ̃ of their own; None where there are fewer than two.

    Fitted to all curves at once, with what else was free; or through the fitted χ̃ with their
    weights.
    """
    own = _with_chi(fits)
    if request.options.unloading_line is None or len(own) < 2:
        return None
    through, normal = _through_chi(own, request.options.confidence)
    joint = _joint(request, [spec for _, spec, _ in own], through)
    if request.options.unloading_line == "weighted":
        return _with_materials(_weighted(joint, own, through), own, normal, request), None
    names = [e.name for e in joint.component.elements]
    c1, c2 = (
        estimate_of(joint, names.index(name), None, request.options.confidence) for name in LINE
    )
    sets = zip(joint.component.sets, joint.component.specs, strict=True)
    chi = {s.data.name: derived_of(joint, s, g, request.options.confidence)["chi"] for g, s in sets}
    line = Line(c1, c2, _rms(joint, joint.z), chi, through, bool(joint.final.found.converged[0]))
    places = [names.index(name) for name in LINE]
    slope = joint.final.problem.transform.slope(joint.z)[places]
    covariance = joint.uncertainty.covariance[np.ix_(places, places)] * np.outer(slope, slope)
    return _with_materials(line, own, covariance, request), joint.final


def _with_materials(line: Line, own, covariance: np.ndarray | None, request: Request) -> Line:
    """The same with what a further material's prediction needs."""
    materials = []
    for fit, spec, k in own:
        place = next(i for i, one in enumerate(fit.component.specs) if one is spec)
        law = fit.final.problem.law_of(fit.theta, place)
        variance = _variance(fit, k)
        separate = not spec.by_eps_up and not several_yields(spec.data.contact)
        materials.append(
            LineMaterial(
                spec.data.name,
                _ratio(spec),
                float(fit.theta[k]),
                variance**0.5 if np.isfinite(variance) else None,
                eps_up_of(law),
                float(law.sigma) if separate else None,
                float(law.psi) if separate else None,
            )
        )
    noisy = covariance is not None and np.all(np.isfinite(covariance)) and np.any(covariance)
    told = None
    if noisy and covariance is not None:
        (a, b), (_, d) = covariance.tolist()
        told = ((a, b), (b, d))
    return replace(
        line,
        covariance=told,
        materials=tuple(materials),
        options=dict(own[0][1].model.options),
        area=own[0][1].data.contact.area,
        confidence=request.options.confidence,
    )


def _with_chi(fits: list[ComponentFit]) -> list[tuple[ComponentFit, SetSpec, int]]:
    """Data sets of Zhou's law with a χ̃ of their own: the fit, what was asked, its element."""
    found = {}
    for fit in fits:
        for g, spec in zip(fit.component.sets, fit.component.specs, strict=True):
            for k, e in enumerate(fit.component.elements):
                if e.name == "chi" and e.sets == (g,) and spec.model.key == "zhou":
                    found[g] = fit, spec, k
    return [found[g] for g in sorted(found)]


def _joint(request: Request, specs: list[SetSpec], through: dict[str, Estimate]) -> ComponentFit:
    """All curves with every χ̃ on one line; everything else as it was asked for."""
    names = {spec.data.name for spec in specs}
    datasets = tuple(data for data in request.datasets if data.name in names)
    said = [_said(spec, through) for spec in specs]
    asked = replace(request, datasets=datasets, parameters=said)
    return asked.with_options(law="zhou", starts=1).fitted()[0]


def _said(spec: SetSpec, through: dict[str, Estimate]) -> dict:
    """What was said of a data set's parameters, with the line in place of χ̃."""
    kept = {
        local.name: local.parameter
        for local in spec.local
        if local.name != "chi" and (local.parameter.free or local.parameter.value is not None)
    }
    values = {name: Parameter(through[name].value) for name in LINE}
    return kept | values | dict(spec.model.options)


def _through_chi(own, confidence: float) -> tuple[dict[str, Estimate], np.ndarray | None]:
    """Weighted least squares through the fitted χ̃, and the covariance; equal weights without errors."""
    ratio = np.array([_ratio(spec) for _, spec, _ in own])
    chi = np.array([fit.theta[k] for fit, _, k in own])
    variance = np.array([_variance(fit, k) for fit, _, k in own])
    # of data without scatter an error is what rounding left: no weight
    usable = np.all(variance > (ROUNDING * chi) ** 2) and np.all(np.isfinite(variance))
    weight = 1 / variance if usable else np.ones(len(chi))
    design = np.stack([np.ones_like(ratio), ratio], axis=1)
    normal = np.linalg.pinv(design.T @ (design * weight[:, None]))
    c = normal @ (design.T @ (weight * chi))
    degrees = min(float(fit.uncertainty.degrees[k]) for fit, _, k in own)
    reach = quantile(confidence, degrees)
    table = {}
    for i, name in enumerate(LINE):
        error = float(np.sqrt(normal[i, i])) if usable else None
        ends = (None, None) if error is None else (c[i] - reach * error, c[i] + reach * error)
        low, high = (None if end is None else float(end) for end in ends)
        table[name] = Estimate(float(c[i]), error, low, high, "wald", True)
    return table, normal if usable else None


def _variance(fit: ComponentFit, k: int) -> float:
    """Of an element in physical units."""
    slope = fit.final.problem.transform.slope(fit.z)[k]
    return float(fit.uncertainty.covariance[k, k] * slope**2)


def _ratio(spec: SetSpec) -> float:
    """E/Y of a data set."""
    assert spec.data.contact is not None
    return float(np.mean(np.asarray(spec.data.contact.yield_ratio)))


def _weighted(joint: ComponentFit, own, through: dict[str, Estimate]) -> Line:
    """The line through the fitted χ̃, and how the curves follow it."""
    z, elements = np.array(joint.z), joint.component.elements
    for k, e in enumerate(elements):
        if e.name in LINE:
            z[k] = through[e.name].value
    c1, c2 = (through[name] for name in LINE)
    assert c1.value is not None
    assert c2.value is not None
    on_line = {s.data.name: Estimate(c1.value + c2.value * _ratio(s)) for _, s, _ in own}
    return Line(c1, c2, _rms(joint, z), on_line, through, True, "weighted")


def _rms(joint: ComponentFit, z: np.ndarray) -> dict[str, float]:
    """Of each material's curve with χ̃ from the line."""
    problem = joint.final.problem
    residual = problem.predict(z[None])[0] - problem.points.value
    return {
        data.name: float(np.sqrt(np.mean(residual[problem.of_restitution(g)] ** 2)))
        for g, data in enumerate(problem.datasets)
    }
