"""Each data set's part of a result: estimates, what follows from them, goodness of fit."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

import softjax as sj
from calibration.fitting.checks.collected import of_component, of_set
from calibration.fitting.components import ComponentFit, fitted
from calibration.fitting.degrees_of_freedom import quantile
from calibration.fitting.elements import DRAG
from calibration.fitting.errors import Errors
from calibration.fitting.intervals import estimates
from calibration.fitting.laws import LINE, eps_up_of, several_yields
from calibration.fitting.material import Estimate, Goodness, MaterialFit, Outlier
from calibration.fitting.problem import Problem
from calibration.fitting.profiles import Profile, weighted_deviation
from calibration.fitting.request import Request, blocks_of
from calibration.fitting.stages import run_stage
from calibration.fitting.uncertainty import (
    NULL_SHARE,
    RANK_TOLERANCE,
    leverages,
    uncertainty_of,
)
from calibration.fitting.warnings import in_order
from calibration.observables import RESTITUTION
from calibration.options import FitOptions
from calibration.parameters import NONE

MOST_OUTLIERS = 100  # of one data set
MOST_ROBUST = 20_000  # points of a robust fit
NO_ERRORS = 1e-9  # of ε: residuals below are none
DIFFERENCE = 1e-3  # in z, of fourth-order differences: their error is near 1e-12
PLAIN: dict[str, Any] = {"optimiser": "levenberg-marquardt", "starts": 4}
NOISE = (
    "noise",
    "noise_dof",
    "extra_scatter",
    "scale_uncertainty",
)  # of a fit and its cross-checks


def summarise(
    fit: ComponentFit, curves: dict[str, Profile], options: FitOptions
) -> tuple[list[MaterialFit], dict[str, Estimate]]:
    """Each data set's part, and the error of the drag coefficient."""
    by_element = estimates(fit, curves, options.confidence)
    of_fit = of_component(fit, by_element, curves)
    sets = range(len(fit.component.sets))
    materials = [_material(fit, g, by_element, options, of_fit) for g in sets]
    materials = _with_robust(fit, materials, options)
    elements = enumerate(fit.component.elements)
    drag = {e.label: by_element[k] for k, e in elements if e.name == DRAG}
    return materials, drag


def _with_robust(
    fit: ComponentFit, materials: list[MaterialFit], options: FitOptions
) -> list[MaterialFit]:
    """The outliers that a robust fit leaves first: Student's t with its scale estimated, from where the fit ended.

    Around a curve that one point pulls away most others lie beyond their noise too; where a scatter is
    estimated, it grows by that one, and others hide in it. No such fit is made of many points, nor of errors
    that points share.
    """
    name, problem = fit.component.stages[0]
    plain = all(
        e.noise.robust and not e.shares and {*e.unknown} <= {"scatter", "scale"}
        for e in problem.errors
    )
    is_possible = plain and fit.is_likelihood and fit.converged and problem.count <= MOST_ROBUST
    if not is_possible or not any(part.outliers for part in materials):
        return materials
    errors = [
        replace(e, noise=heavy.family, unknown=("scatter",))
        for e in problem.errors
        if (heavy := e.noise.robust) is not None
    ]
    quick = options.model_copy(update=PLAIN | {"starts": 1})
    stage = run_stage(name, replace(problem, errors=tuple(errors)), fit.z, quick)
    known = uncertainty_of([(stage.problem, stage.bound_side)], stage.z)
    robust = replace(fit, stages=(stage,), z=stage.z, uncertainty=known)
    marked: list[list[Outlier]] = [[] for _ in materials]
    for k, block in enumerate(problem.blocks):
        heavy = problem.errors[k].noise.robust
        assert heavy is not None
        found = _goodness(robust, k, heavy.apart).outliers
        apart = {o.row: heavy.scale * o.residual for o in found}
        marked[block.set] += [
            replace(o, robust=o.row in apart, robust_residual=apart.get(o.row))
            for o in _goodness(fit, k, named=apart).outliers
        ]
    for outliers in marked:
        outliers.sort(key=lambda outlier: not outlier.robust)
    pairs = zip(materials, marked, strict=True)
    return [replace(part, outliers=tuple(outliers)) for part, outliers in pairs]


def _material(fit: ComponentFit, g: int, by_element, options, of_fit) -> MaterialFit:
    spec, problem = fit.component.specs[g], fit.final.problem
    blocks = [(k, block) for k, block in enumerate(problem.blocks) if block.set == g]
    goodness = {block.observable: _goodness(fit, k) for k, block in blocks}
    of_eps = goodness.get(RESTITUTION) or next(iter(goodness.values()))
    outliers = tuple(outlier for of_one in goodness.values() for outlier in of_one.outliers)
    at = problem.linearise(fit.z[None], slopes=False)
    first = problem.of_restitution(g)
    known_from, known_to = _determined_between(fit, g)
    parameters, values, labels = _parameters(fit, g, by_element, known_to)
    plain = PLAIN | {name: getattr(options, name) for name in NOISE}
    rms_empirical, empirical = _eq_17(fit, g, plain)
    part = MaterialFit(
        **(vars(of_eps) | {"outliers": outliers}),
        data=spec.data,
        objective=spec.objective,
        model=spec.model,
        parameters=parameters,
        derived=derived_of(fit, g, options.confidence),
        values=values,
        labels=labels,
        rms_empirical=rms_empirical,
        empirical=empirical,
        converged=fit.converged,
        status=tuple(map(int, at.status[0][first])),
        known_from=known_from,
        known_to=known_to,
        observed={name: of_one for name, of_one in goodness.items() if name != RESTITUTION},
    )
    found = [warning for warning in of_fit if warning.material in (None, part.name)]
    residual = at.prediction[0][first] - problem.points.value[first]
    found += of_set(fit, part, residual, dict(zip(goodness, spec.errors, strict=True)))
    return replace(part, warnings=in_order(found))


def _parameters(fit: ComponentFit, g: int, by_element, known_to: float):
    """Estimates of what was free and what was held, without the numbers of arrays; all that
    makes the law; and what the covariance calls what was free."""
    parameters, values, labels = {}, {}, {}
    places = fit.component.places(g)
    for local in fit.component.specs[g].local:
        name, place, shown = local.name, places.get(local.name), "[" not in local.name
        if place is not None:
            values[name] = float(fit.theta[place])
            labels[name] = fit.component.elements[place].label
            parameters |= {name: by_element[place]} if shown else {}
            continue
        values[name] = local.start
        if shown and not local.stands_in:
            acts = np.isinf(known_to) or name not in ("chi", *LINE)
            value = float(np.mean(np.asarray(local.start))) if acts else None
            parameters[name] = Estimate(value, method="fixed")
    return parameters, values, labels


def _determined_between(fit: ComponentFit, g: int) -> tuple[float, float]:
    """Between which velocities the fit knows anything of the curve.

    By `model` σ and ψ are known from points below yield, or from pairs that yield at several
    velocities, χ̃ from points above: else only where they were given. Of bodies that differ from impact
    to impact the ends are those that hold for all.
    """
    spec, problem = fit.component.specs[g], fit.final.problem
    if spec.model.law_type is not sj.Zhou or spec.objective != "model":
        return 0.0, np.inf
    of_set = problem.points.set == g
    critical = np.asarray(problem.yields_at(fit.z, of_set))
    below = problem.points.velocity[of_set] <= critical
    free = {e.name for e in fit.component.elements if g in e.sets}
    with_prior = {e.name for e in fit.component.elements if e.parameter.prior is not None}
    needs_below = spec.by_eps_up or ({"sigma", "psi"} & free) - with_prior
    above_is_open = {"chi", *LINE} & {e.name for e in spec.local if e.parameter.value is None}
    several = not spec.by_eps_up and several_yields(spec.data.contact)
    knows_below = bool(np.any(below)) or not needs_below or several
    chi_told = not np.all(below) or not ({"chi", "c1", "c2"} & free or above_is_open)
    known_from = 0.0 if knows_below else float(np.max(critical))
    return known_from, (np.inf if chi_told else float(np.min(critical)))


def _goodness(
    fit: ComponentFit,
    k: int,
    limit_of: Callable[[int, float], float] | None = None,
    named: Collection[int] = (),
) -> Goodness:
    """Goodness of fit for one observable of a data set.

    Args:
        limit_of: of so many points and residual degrees of freedom the size of a residual that makes an
            outlier; that of the noise where left out.
        named: rows that are listed as outliers, too.
    """
    problem, first = fit.final.problem, fit.stages[0].problem  # which knows what the points share
    (place, observable, span), errors, s = first.blocks[k], first.errors[k], first.variances[k]
    data = first.datasets[place]
    rows = next(rows for _, name, rows, *_ in blocks_of(data) if name == observable)
    linear, at = (
        problem.linearise(fit.z[None]),
        first.linearise(fit.z[None]).measured_curve(span)[1:],
    )
    is_free = fit.uncertainty.bound_side[problem.active] == 0  # the others cannot follow a point
    leverage = leverages(np.where(is_free, linear.jacobian[0], 0.0))[: problem.count][span]
    residual_dof = float(max(len(leverage) - np.sum(leverage), 0.0))
    spread = weighted_deviation(fit, problem)[span]
    allowed = np.sqrt(np.maximum(1 - leverage, 1e-12)) * np.where(spread > 0, spread, 1.0)
    residual, factor = (
        linear.prediction[0][span] - problem.points.value[span],
        errors.factor(s, *at),
    )
    solved = errors.solve(factor, residual[None, :, None])[0, :, 0]
    reduced, family = None, errors.noise
    stated = errors.is_stated or errors.unknown == ("scale",)
    if (
        errors.points.uncertainty is not None
        and residual_dof >= 1
        and stated
        and errors.noise.is_least_squares
    ):
        reduced = float(residual @ solved) * float(s.get("scale", 1.0)) / residual_dof
    # of each point where the others of its group are known
    deviation = 1 / np.sqrt(errors.precisions(factor).reshape(-1) + 0 * residual)
    conditional = -solved * deviation
    size = np.abs(conditional) / np.sqrt(np.maximum(1 - leverage, 1e-3))
    # noise of no more than rounding, of data without scatter, explains nothing and names nothing
    size = np.where((deviation > NO_ERRORS) & (np.max(np.abs(residual)) > NO_ERRORS), size, 0.0)
    count = len(residual)
    limit = family.farthest(count) if limit_of is None else limit_of(count, residual_dof)
    weighted, share = (
        linear.residual[0, : problem.count][span] / allowed,
        family.weight(conditional),
    )
    standardised, weight = weighted / np.sqrt(share), share / family.weight(0 * conditional)
    lines = () if data.origin is None else data.origin.lines
    is_named = np.isin(rows + 1, [*named])
    farthest = np.lexsort((-size, ~is_named))
    farthest = farthest[((size > limit) | is_named)[farthest]][:MOST_OUTLIERS]
    outliers = (
        Outlier(
            row=int(rows[i]) + 1,
            line=int(lines[rows[i]]) if rows[i] < len(lines) else None,
            velocity=float(errors.velocity[i]),
            value=float((first.points.value * first.points.unit)[span][i]),
            residual=float(np.copysign(size[i], conditional[i])),
            weight=float(weight[i]),
            observable=observable,
        )
        for i in farthest
    )
    offsets: dict[str, tuple[float, float | None]] = {}
    if (predicted := fit.offsets.get(k)) is not None:
        assert data.group_index is not None
        labels = np.array(data.groups, dtype=object)[np.unique(data.group_index[rows])]
        has_errors = fit.has_intervals
        pairs = zip(predicted.value.tolist(), predicted.error.tolist(), strict=True)
        known = [(value, error if has_errors else None) for value, error in pairs]
        order = np.argsort(-np.abs(predicted.value), kind="stable")
        offsets = {str(labels[i]): known[i] for i in order}
    dof = vars(family).get("dof")
    return Goodness(
        rms=float(np.sqrt(np.mean(residual**2))),
        reduced_chi_squared=reduced,
        variances=_variances(errors, s, at),
        timing=float(s["timing"]) ** 0.5 if "timing" in s else None,
        noise_family=errors.noise.name,
        noise_dof=None if dof is None else float(dof),
        outliers=tuple(outliers),
        standardised=tuple(map(float, standardised)),
        deviations=tuple(map(float, deviation)),
        weights=() if errors.noise.is_least_squares else tuple(map(float, weight)),
        residuals=tuple(map(float, residual)),
        residual_degrees=residual_dof,
        group_offsets=offsets,
    )


def _variances(errors: Errors, s: Mapping[str, float], at: tuple[Any, Any]) -> dict[str, float]:
    """Mean variances of a point, by where they come from; `at` is the slope and the curvature variance of the curve."""
    estimated = {kind: float(s[kind]) for kind in ("scatter", "group") if kind in s}
    bare = {kind: value for kind, value in s.items() if kind not in estimated}
    rest = float(np.mean(errors.variance(bare, *at)))
    if rest <= 0:
        return estimated
    stated = "stated" if errors.degrees is None else "repeats"
    return {next((kind for kind in ("scale", "timing") if kind in s), stated): rest} | estimated


def critical_velocity_of(law: sj.Zhou) -> float:
    return float(np.mean(np.asarray(law.contact.critical_velocity)))


def chi_of(law: sj.Zhou) -> float:
    return float(law.chi)


def derived_of(fit: ComponentFit, g: int, confidence: float) -> dict[str, Estimate]:
    """Quantities derived from Zhou's law of one data set; empty for other laws.

    Of bodies that differ from impact to impact v_cr is the highest, and ε_up none.
    """
    spec, problem = fit.component.specs[g], fit.final.problem
    if spec.model.law_type is not sj.Zhou:
        return {}
    critical = np.asarray(problem.yields_at(fit.z, problem.points.set == g))
    derived = {"critical_velocity": Estimate(float(np.max(critical)), method="derived")}
    if not (spec.by_eps_up or several_yields(spec.data.contact)):
        derived["eps_up"] = _carried(fit, g, eps_up_of, confidence, 1.0)
    if "chi" not in spec.model.parameters:
        derived["chi"] = Estimate(None, method="derived")
        if np.isinf(_determined_between(fit, g)[1]):
            derived["chi"] = _carried(fit, g, chi_of, confidence, np.inf)
    return derived


def results_at(sets: int, fit: ComponentFit, problem: Problem, z: np.ndarray) -> dict[str, float]:
    """Values of a component's free parameters and of what is derived, by their names in results.

    Args:
        sets: how many data sets all components have.
        problem: of the component, of these data or of others.
        z: of all elements.
    """
    theta = problem.transform.physical(z)
    results = {e.label: float(x) for e, x in zip(fit.component.elements, theta, strict=True)}
    for g, spec in enumerate(fit.component.specs):
        if spec.model.law_type is not sj.Zhou:
            continue
        law: Any = problem.law_of(theta, g)
        derived = {"critical_velocity": float(np.max(np.asarray(law.contact.critical_velocity)))}
        if not (spec.by_eps_up or several_yields(spec.data.contact)):
            derived["eps_up"] = float(eps_up_of(law))
        if "chi" not in spec.model.parameters:
            derived["chi"] = chi_of(law)
        owner = "" if sets == 1 else f"[{spec.data.name}]"
        results |= {f"{name}{owner}": value for name, value in derived.items()}
    return results


def _carried(fit: ComponentFit, g: int, what: Callable, confidence: float, most: float) -> Estimate:
    """A number from 0 to `most` with the error that the covariance gives it."""
    transform = fit.final.problem.transform

    def at(*moved: float) -> float:
        z = np.array(fit.z)
        if moved:
            z[int(moved[0])] += moved[1]
        return what(fit.final.problem.law_of(transform.physical(z), g))

    value, gradient = at(), np.zeros(len(fit.z))
    for k, element in enumerate(fit.component.elements):
        if g in element.sets:
            scale = max(abs(float(fit.z[k])), 1e-6) if transform.kind[k] == NONE else 1.0
            far_down, down, up, far_up = (at(k, n * DIFFERENCE * scale) for n in (-2, -1, 1, 2))
            gradient[k] = (8 * (up - down) - (far_up - far_down)) / (12 * DIFFERENCE * scale)
    acting = (gradient != 0) & (fit.uncertainty.bound_side == 0)
    covariance = fit.uncertainty.covariance
    at_end, active = fit.qr_factors, fit.final.problem.active
    singular, way = at_end.singular[0], gradient[active] / at_end.size[0]
    seen = at_end.directions[0][:, singular > RANK_TOLERANCE * np.max(singular, initial=0.0)]
    hidden = np.linalg.norm(way - seen @ (seen.T @ way))
    if hidden <= NULL_SHARE * np.linalg.norm(way):  # along no null direction
        covariance = fit.uncertainty.of_predictions
    covariance = covariance[np.ix_(acting, acting)]
    variance = float(gradient[acting] @ covariance @ gradient[acting]) if np.any(acting) else np.nan
    if not (np.isfinite(variance) and variance >= 0):
        return Estimate(value, method="derived")
    error = variance**0.5
    degrees = fit.uncertainty.dof_along(np.where(acting, gradient, 0.0)[None])[0]
    reach = quantile(confidence, degrees) * error
    low, high = float(max(value - reach, 0.0)), float(min(value + reach, most))
    return Estimate(value, error, low, high, "derived")


def _eq_17(
    fit: ComponentFit, g: int, plain: Mapping[str, Any]
) -> tuple[float | None, Mapping[str, float] | None]:
    """Rms and coefficients of Eq. (17) against all points; None for other laws, and without a limit velocity."""
    spec = fit.component.specs[g]
    if spec.model.law_type is sj.Zhou and spec.objective == "model":
        data = spec.data
        if data.limit_velocity is None or np.sum(np.isfinite(data.restitution)) <= 2:
            return None, None
        request = Request((data.of_restitution(),)).with_options(law="eq-17", **plain)
        (fit,), g = fitted(request), 0
    elif spec.model.law_type not in (sj.Zhou, sj.EmpiricalRestitution):
        return None, None
    problem = fit.stages[0].problem
    residual = problem.linearise(fit.z[None]).prediction[0] - problem.points.value
    law = problem.law_of(fit.theta, g)
    values = {name: float(getattr(law, name)) for name in ("limit_velocity", "sigma", "psi")}
    return float(np.sqrt(np.mean(residual[problem.of_restitution(g)] ** 2))), values
