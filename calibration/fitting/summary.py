"""One data set's part of a result: estimates, what follows from them, goodness of fit, warnings.

Another end of a search counts as another minimum only if the gradient vanishes there and the cost rises
on the straight way from it to the best. A straight way that rises does not prove that every bent one
does; of a valley so level that the gradient vanishes at two places along it no other minima are reported."""

from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from typing import Any

import numpy as np
from jaxtyping import Float

import softjax as sj
from calibration.data import RestitutionData, plausibility
from calibration.fitting import warnings
from calibration.fitting.curves import modulus_by_times
from calibration.fitting.errors import Carried, Errors
from calibration.fitting.laws import LINE, several_yields
from calibration.fitting.material import Estimate, Goodness, MaterialFit, Outlier
from calibration.fitting.problem import Lanes, Problem
from calibration.fitting.profiles import Profile, estimate_of, weighted_deviation
from calibration.fitting.request import Request, SetSpec, blocks_of
from calibration.fitting.search import Found
from calibration.fitting.stages import ComponentFit, StageFit, fitted
from calibration.fitting.uncertainty import leverages, quantile
from calibration.fitting.warnings import FitWarning
from calibration.observables import OBSERVABLES, RESTITUTION
from calibration.parameters import NONE
from calibration.rounding import with_error

RARE = 0.05  # probability that the farthest of n normal errors is named
MOST_OUTLIERS = 100  # of one data set
NO_ERRORS = 1e-9  # of ε: residuals below are none
DIFFERENCE = 1e-3  # in z, of fourth-order differences: their error is near 1e-12


def _of_block(fit: ComponentFit, k: int) -> Goodness:
    """Goodness of fit for one observable of a data set."""
    problem, first = fit.final.problem, fit.stages[0].problem  # which knows what the points share
    own, errors, s = problem.own[k], first.errors[k], first.variances[k]
    found, one = problem.linearise(fit.z[None]), first.linearise(fit.z[None]).carried(own)
    leverage = leverages(found.jacobian[0])[: problem.count][own]
    left = float(max(len(leverage) - np.sum(leverage), 0.0))
    spread = weighted_deviation(fit, problem)[own]
    allowed = np.sqrt(np.maximum(1 - leverage, 1e-12)) * np.where(spread > 0, spread, 1.0)
    off = found.prediction[0][own] - problem.points.value[own]
    stated = errors.is_stated or errors.unknown == ("scale",)
    reduced = None
    if errors.points.uncertainty is not None and left >= 1 and stated and errors.is_normal:
        factor = errors.factor({**s, "scale": 1.0}, one.slope, one.bend)
        reduced = float(np.sum(errors.whiten(factor, off[None, :, None]) ** 2)) / left
    nu = errors.family(s).dof
    return Goodness(
        float(np.sqrt(np.mean(off**2))),
        reduced,
        _variances(errors, s, one),
        float(s["timing"]) ** 0.5 if "timing" in s else None,
        None if nu is None else float(nu),
        _outliers(first, k, one, off, leverage),
        tuple(map(float, found.residual[0, : problem.count][own] / allowed)),
        tuple(map(float, leverage)),
        left,
    )


def _outliers(first: Problem, k: int, one: Carried, off, leverage) -> tuple[Outlier, ...]:
    """Points beyond `RARE`: the one of n points that noise sends so far once in twenty data sets."""
    from scipy import special

    errors, s, (place, observable, own) = first.errors[k], first.variances[k], first.blocks[k]
    spread = np.sqrt(errors.diagonal(s, one.slope, one.bend) + np.zeros(len(off))).reshape(-1)
    residual = -off / spread
    if errors.shares:  # without the information of the others of its group
        factor = errors.factor(s, one.slope, one.bend)
        solved = errors.solve(factor, off[None, :, None])[0, :, 0]
        residual = -solved / np.sqrt(errors.precisions(factor).reshape(-1))
    size = np.abs(residual) / np.sqrt(np.maximum(1 - leverage, 1e-3))
    # noise of no more than rounding, of data without scatter, explains nothing and names nothing
    size = np.where((spread > NO_ERRORS) & (np.max(np.abs(off)) > NO_ERRORS), size, 0.0)
    limit, family = special.ndtri(1 - 0.5 * RARE / len(off)), errors.family(s)
    weight = family.weight(residual) / family.weight(0 * residual)
    found = [i for i in np.argsort(-size, kind="stable") if size[i] > limit]
    data = first.datasets[place]
    rows = next(rows for name, rows, *_ in blocks_of(data) if name == observable)
    lines = () if data.origin is None else data.origin.lines
    values = (first.points.value * first.points.unit)[own]
    return tuple(
        Outlier(
            int(rows[i]) + 1,
            int(lines[rows[i]]) if rows[i] < len(lines) else None,
            float(first.points.velocity[own][i]),
            float(values[i]),
            float(np.copysign(size[i], residual[i])),
            float(weight[i]),
            observable,
        )
        for i in found[:MOST_OUTLIERS]
    )


def _variances(errors: Errors, s: Mapping[str, float], one: Carried) -> dict[str, float]:
    """Mean variances of a point, by where they come from."""
    found = {kind: float(s[kind]) for kind in ("scatter", "group") if kind in s}
    bare = {kind: value for kind, value in s.items() if kind not in found}
    rest = float(np.mean(errors.variance(bare, one.slope, one.bend)))
    if rest <= 0:
        return found
    stated = "stated" if errors.degrees is None else "repeats"
    return {next((kind for kind in ("scale", "timing") if kind in s), stated): rest} | found


def critical_velocity_of(law: sj.Zhou) -> float:
    return float(np.mean(np.asarray(law.contact.critical_velocity)))


def eps_up_of(law: sj.Zhou) -> float:
    """ε_17(v_cr), Eq. (16)."""
    limit = float(np.mean(np.asarray(law.contact.limit_velocity)))
    critical = critical_velocity_of(law)
    if critical >= limit:
        return 0.0
    return float(np.exp(-float(law.sigma) * (critical / (limit - critical)) ** float(law.psi)))


def chi_of(law: sj.Zhou) -> float:
    return float(law.chi)


def derived_of(fit: ComponentFit, spec: SetSpec, g: int, confidence: float) -> dict[str, Estimate]:
    """Quantities derived from Zhou's law of one data set; empty for other laws.

    Of bodies that differ from impact to impact v_cr is the highest, and ε_up none.
    """
    if spec.model.law_type is not sj.Zhou:
        return {}
    problem = fit.final.problem
    critical = np.asarray(problem.yields_at(fit.z))[
        problem.points.set == fit.component.sets.index(g)
    ]
    found = {"critical_velocity": Estimate(float(np.max(critical)), method="derived")}
    names = spec.model.parameters
    if not (spec.by_eps_up or several_yields(spec.data.contact)):
        found["eps_up"] = _carried(fit, g, eps_up_of, confidence, (0.0, 1.0))
    if "chi" not in names:
        found["chi"] = _carried(fit, g, chi_of, confidence, (0.0, np.inf))
    return found


def _law_at(fit: ComponentFit, z: np.ndarray, g: int) -> sj.Zhou:
    problem, place = fit.final.problem, fit.component.sets.index(g)
    return problem.law_of(problem.transform.physical(z), place)  # type: ignore[return-value]


def _carried(fit: ComponentFit, g: int, what: Callable, confidence, ends) -> Estimate:
    """A number with the error that the covariance gives it."""
    value = what(_law_at(fit, fit.z, g))
    gradient = np.zeros(len(fit.z))
    for k, element in enumerate(fit.component.elements):
        if g in element.sets:
            gradient[k] = _slope_of(fit, k, g, what)
    acting = (gradient != 0) & (fit.uncertainty.limits == 0)
    covariance = fit.uncertainty.covariance[np.ix_(acting, acting)]
    variance = float(gradient[acting] @ covariance @ gradient[acting]) if np.any(acting) else np.nan
    if not (np.isfinite(variance) and variance >= 0):
        return Estimate(value, method="derived")
    error = variance**0.5
    direction = np.where(acting, gradient, 0.0)
    degrees = fit.uncertainty.along(direction[None])[0]
    reach = quantile(confidence, degrees) * error
    low, high = float(max(value - reach, ends[0])), float(min(value + reach, ends[1]))
    return Estimate(value, error, low, high, "derived")


def _slope_of(fit: ComponentFit, k: int, g: int, what: Callable) -> float:
    def at(step: float) -> float:
        z = np.array(fit.z)
        z[k] += step
        return what(_law_at(fit, z, g))

    scaled = fit.final.problem.transform.kind[k] != NONE
    h = DIFFERENCE * (1.0 if scaled else max(abs(float(fit.z[k])), 1e-6))
    return (8 * (at(h) - at(-h)) - (at(2 * h) - at(-2 * h))) / (12 * h)


PLAIN: dict[str, Any] = {"optimiser": "levenberg-marquardt", "starts": 4}
MODULUS_OFF = 2.0  # errors by which the modulus of the contact times is off
NOISELESS = 1e-9  # rms of ε about Eq. (17) below which data are a curve and no measurement


def eq_17_alone(data: RestitutionData) -> ComponentFit | None:
    """Eq. (17) against all points; None without a limit velocity."""
    if data.limit_velocity is None or np.sum(np.isfinite(data.restitution)) <= 2:
        return None
    plain = replace(data.of_restitution(), contact=None)
    return fitted(Request((plain,)).with_options(law="eq-17", **PLAIN))[0]


def eq_17_of(fit: ComponentFit, g: int) -> tuple[float, dict[str, float]]:
    """Root mean square of ε about the first stage's Eq. (17), and its coefficients."""
    problem, place = fit.stages[0].problem, fit.component.sets.index(g)
    residual = problem.linearise(fit.z[None]).prediction[0] - problem.points.value
    law = problem.law_of(fit.theta, place)
    names = ("limit_velocity", "sigma", "psi")
    values = {name: float(getattr(law, name)) for name in names}
    return float(np.sqrt(np.mean(residual[problem.of_restitution(place)] ** 2))), values


def disagreements(two: ComponentFit, g: int, parameters: dict[str, Estimate]) -> list[FitWarning]:
    """Warnings where a fit by `model` has another ε_up or χ̃, by more than their errors.

    Args:
        two: the fit by `two-step`, of data with noise; of a curve without any nothing is compared.
        g: the data set.
        parameters: what that fit found, derived numbers included.
    """
    component = two.component
    free = {e.name: e.parameter.prior for e in component.elements}
    plainly_free = set(free) == {"chi", "sigma", "psi"} and not any(free.values())
    if len(component.sets) > 1 or not plainly_free or eq_17_of(two, g)[0] < NOISELESS:
        return []
    spec = component.specs[0]
    plain = Request((spec.data,), spec.model.options).with_options(law="zhou", **PLAIN)
    fit = fitted(plain)[0]
    others = derived_of(fit, fit.component.specs[0], 0, 0.95)
    for k, element in enumerate(fit.component.elements):
        others[element.name] = estimate_of(fit, k, None, 0.95)
    found = []
    for name in ("eps_up", "chi"):
        one, other = others.get(name), parameters.get(name)
        if one is None or other is None:
            continue
        first, second = ((e.value, e.standard_error) for e in (one, other))
        if None not in first and None not in second:
            found.append(warnings.disagreement(name, first, second, spec.data.name))
    return [one for one in found if one is not None]


MOVED = 1e-2  # in z, from which on values are others to a reader
STATIONS = 32
# Share of the cost that the next step may still promise where the gradient counts as vanished. A
# rise no larger than that may be made of what the two searches left undone.
LEFT_UNDONE = 1e-8
LEAST_NOISE = 1e-10  # of ε: less is no noise


def other_minima(fit: ComponentFit, stage: StageFit, least: float) -> list[tuple[int, float]]:
    """Elements with another value at another minimum, and how much higher χ² is there.

    Only where χ² is less than `least` above that of the best.
    """
    found: dict[int, float] = {}
    for other in stage.others:
        moved = _moved_elements(fit, stage, other)
        if not moved:
            continue
        rise = _rise(fit, stage, other.z[0])
        if rise < least and rises_between(stage.problem, stage.z, other.z[0]):
            for k in moved:
                found.setdefault(k, rise)
    return list(found.items())


def _moved_elements(fit: ComponentFit, stage: StageFit, other: Found) -> list[int]:
    """Elements that are determined and elsewhere.

    None where an element is at an end of its range: a valley without an end has no second minimum.
    """
    if not other.converged[0] or np.any(stage.limits) or np.any(other.limits):
        return []
    apart = np.abs(other.z[0] - stage.z) > MOVED
    return [int(k) for k in stage.problem.active if apart[k] and fit.uncertainty.known[k]]


def _rise(fit: ComponentFit, stage: StageFit, z) -> float:
    """χ² there less χ² at the best: twice the difference of -ln p."""
    problem = stage.problem
    deviation = weighted_deviation(fit, problem, LEAST_NOISE)
    return 2 * (_cost_at(problem, z) - _cost_at(problem, stage.z)) / float(np.mean(deviation**2))


def _cost_at(problem: Problem, z) -> float:
    """Cost of the points, each on its branch at z, and of the priors."""
    held = problem.held(problem.elastic_at(z))
    return float(held.linearise(z[None], slopes=False).cost[0])


def rises_between(
    problem: Problem, first: Float[np.ndarray, "elements"], second: Float[np.ndarray, "elements"]
) -> bool:
    """Whether the cost rises above both ends on the straight way from one to the other.

    Looked at the more closely the nearer to an end: the rise around a shallow minimum is there.
    """
    shares = np.sin(np.linspace(0, np.pi / 2, STATIONS + 2)) ** 2
    places = first + shares[:, None] * (second - first)
    lanes = Lanes(elastic=problem.elastic_at(places))
    cost = problem.linearise(places, lanes, slopes=False).cost
    allowed = max(cost[0], cost[-1]) * (1 + LEFT_UNDONE)
    return bool(np.any(cost[1:-1] > allowed))


NO_RESIDUAL = 1e-12  # of ε
AT_ONE = (
    "The data show no loss but the plastic one: eps_up cannot exceed 1; its interval is one-sided."
)


def component_warnings(
    fit: ComponentFit, estimates: dict[int, Estimate], curves: dict[str, Profile]
) -> list[FitWarning]:
    """Warnings about a component's parameters and searches."""
    found: list[FitWarning] = []
    for k, element in enumerate(fit.component.elements):
        found += _of_estimate(element.name, estimates[k], _owner(fit, element.sets))
    separation = _separation(fit, curves)
    found += _skewed(fit, estimates) + _collinear(fit, separation)
    for stage in fit.stages:
        names = [data.name for data in stage.problem.datasets]
        if not stage.found.converged[0]:
            cause = f"{stage.report.stage}: {stage.report.reason}"
            found += [FitWarning("not-converged", cause, name) for name in names]
        if stage.crossings:
            cause = f"{stage.crossings} points changed between elastic and plastic on the way"
            found += [FitWarning("branch-change", cause, name) for name in names]
        if stage.alone:
            cause = f"{stage.report.stage}: one search alone ended so low, and it misses the points"
            found += [FitWarning("several-minima", cause, name) for name in names]
        for k, rise in other_minima(fit, stage, warnings.SEVERAL_DELTA):
            element = fit.component.elements[k]
            told = f"only {rise:.2g} higher" if rise >= 0 else f"{-rise:.2g} lower"
            cause = f"another minimum for {element.name} has a chi squared {told}"
            found.append(FitWarning("several-minima", cause, _owner(fit, element.sets)))
    condition = float(fit.uncertainty.condition_number)
    if condition > warnings.CONDITION_LIMIT and not _has_whole(fit):
        cause = f"the Jacobian's condition number is {condition:.2g}"
        found.append(FitWarning("ill-conditioned", cause, _owner(fit, fit.component.sets)))
    return found + separation


def _of_estimate(name: str, estimate: Estimate, owner: str | None) -> list[FitWarning]:
    if "[" in name:  # a number of a network is no parameter that anybody reads
        return []
    if estimate.at_bound and estimate.value is not None:
        # no bound that somebody gave: ε_17 is 1 at most
        advice = AT_ONE if name == "eps_up" and estimate.value == 1 else ""
        return [
            FitWarning("at-bound", f"{name} is at its bound {estimate.value:.4g}", owner, advice)
        ]
    if estimate.value is None:
        # the cost falls, ever less, however large the parameter gets
        return [
            FitWarning("at-bound", f"{name} grows without bound: any large value is as good", owner)
        ]
    if estimate.method == "undetermined":
        cause = f"{name} does not show in these data, or only together with another"
        return [FitWarning("rank-deficient", cause, owner)]
    return []


def _skewed(fit: ComponentFit, estimates: dict[int, Estimate]) -> list[FitWarning]:
    """One for all parameters of a data set whose standard errors describe no interval."""
    names: dict[str | None, list[str]] = {}
    for k, element in enumerate(fit.component.elements):
        if estimates[k].skewed and "[" not in element.name:
            names.setdefault(_owner(fit, element.sets), []).append(element.name)
    return [
        FitWarning("skewed", f"the likelihood is skewed in {' and '.join(own)}", owner)
        for owner, own in names.items()
    ]


def _collinear(fit: ComponentFit, separation: list[FitWarning]) -> list[FitWarning]:
    """Two parameters of a likelihood that are determined together only, and what of them is known."""
    if not fit.is_likelihood or _has_whole(fit):
        return []
    known, problem, elements = fit.uncertainty, fit.final.problem, fit.component.elements
    apart = {warning.material for warning in separation if warning.code == "sigma-psi-not-separate"}
    covariance = np.where(known.known[:, None] & known.known, known.covariance, 0.0)
    size = np.sqrt(np.where(np.diag(covariance) > 0, np.diag(covariance), np.inf))
    correlation = np.triu(covariance / np.outer(size, size), 1)
    found: list[FitWarning] = []
    for i, j in np.argwhere(np.abs(correlation) > warnings.COLLINEAR):
        one, other = elements[i], elements[j]
        shared = set(one.sets) & set(other.sets)
        owner = _owner(fit, tuple(sorted(shared))) if shared else None
        if not shared or (owner in apart and {one.name, other.name} == {"sigma", "psi"}):
            continue
        if any(warning.material == owner for warning in found):
            continue  # one is enough of a data set
        place = fit.component.sets.index(min(shared))
        points = np.flatnonzero((problem.points.set == place) & (problem.points.observable == 0))
        told = ""
        if len(points):
            told = f"; the data determine ε in their middle, {_in_the_middle(fit, points)}"
        names = f"{one.name} and {other.name}"
        cause = f"{names} are correlated by {correlation[i, j]:.5f}{told}"
        found.append(FitWarning("collinear", cause, owner))
    return found


def _in_the_middle(fit: ComponentFit, points: np.ndarray) -> str:
    """ε of the curve at the middle of some points, with its standard error."""
    problem, known = fit.final.problem, fit.uncertainty
    velocity = problem.points.velocity[points]
    middle = points[np.argmin(np.abs(np.log(velocity / np.median(velocity))))]
    found = problem.bare.linearise(fit.z[None])
    value, slope = found.prediction, found.per
    own = known.of_predictions[np.ix_(problem.active, problem.active)]
    error = float(np.sqrt(max(slope[0, middle] @ own @ slope[0, middle], 0.0)))
    told = with_error(float(value[0, middle]), error)
    return f"{told} at {problem.points.velocity[middle]:.3g} m/s"


def _has_whole(fit: ComponentFit) -> bool:
    return any(spec.model.trees for spec in fit.component.specs)


def _owner(fit: ComponentFit, sets: tuple[int, ...]) -> str | None:
    """The data set that something is about; None for several."""
    if len(sets) != 1:
        return None
    return fit.component.specs[fit.component.sets.index(sets[0])].data.name


def _separation(fit: ComponentFit, curves: dict[str, Profile]) -> list[FitWarning]:
    """σ and ψ of Zhou's law that only their combination ε_up is known of; ε_up in their place."""
    found = []
    for g, spec in zip(fit.component.sets, fit.component.specs, strict=True):
        if spec.model.law_type is not sj.Zhou or spec.objective != "model":
            continue
        if spec.by_eps_up:
            cause = "no points below the critical velocity: sigma and psi act through eps_up alone"
            found.append(FitWarning("eps-up-only", cause, spec.data.name))
        places = fit.component.places(g)
        pair = [places[name] for name in ("sigma", "psi") if name in places]
        if len(pair) == 2:
            errors = fit.uncertainty.errors[pair]
            labels = [fit.component.elements[k].label for k in pair]
            wide = [warnings.is_wide(curves[label]) for label in labels if label in curves]
            if not np.max(errors) <= warnings.SEPARATE or any(wide):
                cause = (
                    f"the standard error of ln sigma is {errors[0]:.2g}"
                    if np.isfinite(errors[0])
                    else "only one combination of sigma and psi shows"
                )
                found.append(FitWarning("sigma-psi-not-separate", cause, spec.data.name))
    return found


def _implausible(part: MaterialFit) -> list[FitWarning | None]:
    """Likely mistakes in the data; those about yield only if the law yields."""
    found = plausibility(part.data)
    if not _yields(part.law):
        found = tuple(one for one in found if one.code != "yield-beyond-limit")
    return [
        FitWarning(
            "groups" if one.code == "groups" else "plausibility", one.cause, part.name, one.advice
        )
        for one in found
    ]


def _yields(law: sj.ContactLaw) -> bool:
    """Whether there is a velocity from which on something yields."""
    if not isinstance(law, sj.RateIndependentLaw):
        return False
    velocity = np.asarray(law.elastic_velocity())
    return bool(np.any((velocity > 0) & (velocity < np.inf)))


def restitution_warnings(part: MaterialFit, residual, errors: Errors) -> list[FitWarning]:
    """Warnings about one data set's curve.

    Args:
        residual: fitted less measured ε.
        errors: those of its points.
    """
    data, name, left = part.data, part.name, part.residual_degrees
    velocity, restitution = errors.velocity, data.restitution[np.isfinite(data.restitution)]
    found: list[FitWarning | None] = [
        FitWarning("data", note, name) for note in data.notes if "above 1" in note
    ]
    found += _implausible(part)
    if errors.is_stated and part.reduced_chi_squared is not None:
        of_noise = None if data.degrees is None else float(np.mean(data.degrees))
        reduced = part.reduced_chi_squared
        found.append(warnings.misfit(reduced, left, of_noise, name))
    elif part.objective == "two-step" and part.rms_empirical is not None:
        n = part.n
        scatter = part.rms_empirical * np.sqrt(n / max(n - 2, 1))
        rms = part.rms * np.sqrt(n / max(left, 1))
        found.append(
            warnings.misfit_against_scatter(rms, scatter, max(left, 1), max(n - 2, 1), name)
        )
    standardised = np.array(part.standardised)
    found.append(
        warnings.runs(velocity, np.where(np.abs(residual) < NO_RESIDUAL, 0.0, standardised), name)
    )
    if np.max(np.abs(residual)) > NO_RESIDUAL and not any(found):
        # where the curve misses the points neither says anything of the errors
        found.append(warnings.unequal_scatter(velocity, restitution + residual, standardised, name))
        if not errors.shares:
            found.append(warnings.alike_neighbours(velocity, standardised, name))
    stated = errors.points.uncertainty if errors.is_stated else None
    found.append(warnings.no_velocity_dependence(velocity, restitution, stated, name))
    yields = part.law.elastic_velocity() if _yields(part.law) else np.nan
    uncertain = data.velocity_uncertainty
    found.append(warnings.velocity_errors(data.velocity, uncertain, np.asarray(yields), name))
    found += warnings.statuses(part.status, velocity, name)
    if part.known_to < np.inf:
        cause = "all velocities are below the critical velocity"
        found.append(FitWarning("all-below-yield", cause, name))
    return [one for one in found if one is not None]


def observable_warnings(
    part: MaterialFit, observable: str, one: Goodness, errors: Errors
) -> list[FitWarning]:
    """Whether the curve misses what else than ε was measured."""
    found: list[FitWarning | None] = []
    if errors.is_stated and one.reduced_chi_squared is not None:
        found.append(
            warnings.misfit(one.reduced_chi_squared, one.residual_degrees, None, part.name)
        )
    found.append(warnings.runs(errors.velocity, np.array(one.standardised), part.name))
    if one.rms > MOST_OFF:  # an estimated scatter takes a wrong unit or size as it is
        cause = f"the law misses the values by {100 * one.rms:.3g} % (rms)"
        advice = "Check the unit and the bodies; of dents, which diameter was measured (`dent`)."
        found.append(FitWarning("plausibility", cause, part.name, advice))
    words = OBSERVABLES[observable].words
    return [
        replace(warning, cause=f"{words}: {warning.cause}")
        for warning in found
        if warning is not None
    ]


MOST_OFF = 0.5  # rms of an observable other than ε, in parts of its values
OF_RESTITUTION = [one.name for one in fields(Goodness)]


def summarise_material(
    fit: ComponentFit,
    g: int,
    estimates: dict[int, Estimate],
    confidence: float,
    shared: list[FitWarning],
) -> MaterialFit:
    """One data set's part of the result."""
    place = fit.component.sets.index(g)
    spec, problem = fit.component.specs[place], fit.final.problem
    found = problem.linearise(fit.z[None], slopes=False)
    blocks = [(k, b) for k, b in enumerate(problem.blocks) if b.set == place]
    goodness = {b.observable: _of_block(fit, k) for k, b in blocks}
    first = problem.of_restitution(place)
    residual = found.prediction[0][first] - problem.points.value[first]
    of_eps = goodness.get(RESTITUTION) or next(iter(goodness.values()))
    every = {name: getattr(of_eps, name) for name in OF_RESTITUTION}
    every["outliers"] = tuple(one for own in goodness.values() for one in own.outliers)
    known_from, known_to = _determined_between(fit, spec, g)
    parameters, values, labels = _parameters(fit, spec, g, estimates, known_to)
    part = MaterialFit(
        data=spec.data,
        objective=spec.objective,
        model=spec.model,
        parameters=parameters,
        derived=derived_of(fit, spec, g, confidence),
        values=values,
        labels=labels,
        rms_empirical=None,
        empirical=None,
        converged=fit.converged,
        status=tuple(map(int, found.status[0][first])),
        known_from=known_from,
        known_to=known_to,
        observed={name: one for name, one in goodness.items() if name != RESTITUTION},
        **every,
    )
    rms_empirical, empirical, apart = _beside_eq_17(fit, spec, part, g)
    part = replace(part, rms_empirical=rms_empirical, empirical=empirical)
    own = [d for d in shared if d.material == spec.data.name] + apart
    errors = dict(zip(goodness, spec.errors, strict=True))
    if RESTITUTION in errors:
        own += restitution_warnings(part, residual, errors[RESTITUTION])
    for name, one in part.observed.items():
        own += observable_warnings(part, name, one, errors[name])
    modulus = modulus_by_times(part)
    if modulus is not None and abs(modulus.off) > MODULUS_OFF * modulus.error:
        cause = (
            f"the contact times are those of {np.exp(modulus.off):.3g} times the stated modulus E, "
            f"which they determine to {100 * modulus.error:.2g} %"
        )
        own.append(FitWarning("modulus", cause, part.name))
    return replace(part, warnings=tuple(own))


def _parameters(fit: ComponentFit, spec: SetSpec, g: int, estimates, known_to: float):
    """Estimates of what was free and what was held, without the numbers of whole parameters; all that
    makes the law; and what the covariance calls what was free."""
    parameters, values, labels = {}, {}, {}
    places = fit.component.places(g)
    for local in spec.local:
        name, place, shown = local.name, places.get(local.name), "[" not in local.name
        if place is not None:
            values[name] = float(fit.theta[place])
            labels[name] = fit.component.elements[place].label
            parameters |= {name: estimates[place]} if shown else {}
            continue
        values[name] = local.start
        if shown and not local.stands_in:
            acts = np.isinf(known_to) or name not in ("chi", *LINE)
            value = float(np.mean(np.asarray(local.start))) if acts else None
            parameters[name] = Estimate(value, method="fixed")
    return parameters, values, labels


def _determined_between(fit: ComponentFit, spec: SetSpec, g: int) -> tuple[float, float]:
    """Between which velocities the fit knows anything of the curve.

    By `model` σ and ψ are known from points below yield, or from pairs that yield at several
    velocities, χ̃ from points above: else only where they were given. Of bodies that differ from impact
    to impact the ends are those that hold for all.
    """
    if spec.model.law_type is not sj.Zhou or spec.objective != "model":
        return 0.0, np.inf
    problem, place = fit.final.problem, fit.component.sets.index(g)
    own = problem.points.set == place
    critical = np.asarray(problem.yields_at(fit.z))[own]
    below = problem.points.velocity[own] <= critical
    free = {e.name for e in fit.component.elements if g in e.sets}
    told = {e.name for e in fit.component.elements if e.parameter.prior is not None}
    needs_below = spec.by_eps_up or ({"sigma", "psi"} & free) - told
    above_is_open = "chi" in {local.name for local in spec.local if local.parameter.value is None}
    several = not spec.by_eps_up and several_yields(spec.data.contact)
    knows_below = bool(np.any(below)) or not needs_below or several
    chi_told = not np.all(below) or not ({"chi", "c1", "c2"} & free or above_is_open)
    known_from = 0.0 if knows_below else float(np.max(critical))
    return known_from, (np.inf if chi_told else float(np.min(critical)))


def _beside_eq_17(fit: ComponentFit, spec: SetSpec, part: MaterialFit, g: int):
    """Eq. (17) next to Zhou's law: its rms and coefficients, and whether `model` disagrees with `two-step`."""
    if spec.model.law_type is sj.EmpiricalRestitution:
        return part.rms, part.values, []
    if spec.model.law_type is not sj.Zhou:
        return None, None, []
    if spec.objective == "two-step":
        return *eq_17_of(fit, g), disagreements(fit, g, {**part.derived, **part.parameters})
    alone = eq_17_alone(spec.data)
    return (None, None, []) if alone is None else (*eq_17_of(alone, 0), [])
