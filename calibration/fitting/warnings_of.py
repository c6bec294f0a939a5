"""Which warnings a fit raises, where `calibration.fitting.warnings` has the tests and the advice.

Another end of a search counts as another minimum only if the gradient vanishes there and the cost rises
on the straight way from it to the best. A straight way that rises does not prove that every bent one
does; of a valley so level that the gradient vanishes at two places along it no other minima are reported."""

from collections.abc import Iterable, Iterator, Mapping

import numpy as np

import softjax as sj
from calibration.data import plausibility
from calibration.fitting import warnings
from calibration.fitting.curves import modulus_by_times
from calibration.fitting.errors import Errors
from calibration.fitting.material import Estimate, Goodness, MaterialFit
from calibration.fitting.problem import Element, Lanes
from calibration.fitting.profiles import Profile, weighted_deviation
from calibration.fitting.stages import ComponentFit, StageFit
from calibration.fitting.warnings import FitWarning
from calibration.observables import OBSERVABLES, RESTITUTION
from calibration.rounding import with_error

NO_RESIDUAL = 1e-12  # of ε
MOST_OFF = 0.5  # rms of an observable other than ε, in parts of its values
MODULUS_OFF = 2.0  # errors by which the modulus of the contact times is off
MOVED = 1e-2  # in z, from which on values are others to a reader
STATIONS = 32
# Share of the cost that the next step may still promise where the gradient counts as vanished. A
# rise no larger than that may be made of what the two searches left undone.
LEFT_UNDONE = 1e-8
LEAST_NOISE = 1e-10  # of ε: less is no noise
LAW_OR_GROUPS = (
    f"The law misses a trend ({warnings.OTHER_LAWS}), or other points belong together than those of the "
    "groups; intervals are too narrow."
)
WITH_PROFILES = (
    "Fit with profiles, or sample the posterior: this interval, from the standard error, covers less "
    "than stated."
)
AT_ONE = (
    "The data show no loss but the plastic one: eps_up cannot exceed 1; its interval is one-sided."
)


def named(code: str, causes: Iterable[str | None], owner: str | None) -> Iterator[FitWarning]:
    return (FitWarning(code, cause, owner) for cause in causes if cause)  # type: ignore[arg-type]


def _owner(fit: ComponentFit, sets: tuple[int, ...]) -> str | None:
    """The data set that something is about; None for several."""
    return fit.component.specs[sets[0]].data.name if len(sets) == 1 else None


def _has_arrays(fit: ComponentFit) -> bool:
    return any(spec.model.trees for spec in fit.component.specs)


def of_component(fit: ComponentFit, by_element: dict[int, Estimate], curves: dict[str, Profile]):
    """Warnings about a component's parameters and searches."""
    elements, raised = fit.component.elements, []
    separation = _separation(fit, curves)
    together: dict[tuple[str, str | None], list[str]] = {}
    for k, element in enumerate(elements):
        if "[" in element.name:  # a number of a network is no parameter that anybody reads
            continue
        name, owner = element.name, _owner(fit, element.sets)
        raised += _at_an_end(name, by_element[k], owner)
        far = _off_prior(element, float(fit.theta[k]))
        raised += named("prior-conflict", [far], owner)
        is_open = by_element[k].method == "undetermined" and by_element[k].value is not None
        if is_open and not by_element[k].at_bound and not _is_apart(separation, name, owner):
            together.setdefault(("rank-deficient", owner), []).append(name)
        if by_element[k].skewed:
            together.setdefault(("skewed", owner), []).append(name)
    for (code, owner), names in together.items():
        text, verb = " and ".join(names), "do" if len(names) > 1 else "does"
        cause = f"the likelihood is skewed in {text}"
        if code == "rank-deficient":
            cause = f"{text} {verb} not show in these data, or only together with another"
        advice = WITH_PROFILES if code == "skewed" and fit.converged and not curves else ""
        raised.append(FitWarning(code, cause, owner, advice))  # type: ignore[arg-type]
    raised += _collinear(fit, separation)
    for stage in fit.stages:
        name, reason = stage.report.stage, stage.report.reason
        crossed = f"{stage.crossings} points changed between elastic and plastic on the way"
        lone = f"{name}: one search alone ended so low, and it misses the points"
        causes = {
            "not-converged": "" if stage.ends.converged[0] else f"{name}: {reason}",
            "branch-change": crossed if stage.crossings else "",
            "several-minima": lone if stage.alone else "",
        }
        for code, cause in causes.items():
            for data in stage.problem.datasets:
                raised += named(code, [cause], data.name)
        for k, rise in _other_minima(fit, stage, by_element).items():
            higher = f"only {rise:.2g} higher" if rise >= 0 else f"{-rise:.2g} lower"
            cause = f"another minimum for {elements[k].name} has a chi squared {higher}"
            raised.append(FitWarning("several-minima", cause, _owner(fit, elements[k].sets)))
    return raised + separation


def _at_an_end(name: str, estimate: Estimate, owner: str | None) -> Iterator[FitWarning]:
    if estimate.value is None:
        # the cost falls, ever less, however large the parameter gets
        cause = f"{name} grows without bound: any large value is as good"
        yield FitWarning("at-bound", cause, owner)
    elif estimate.at_bound:
        # no bound that somebody gave: ε_17 is 1 at most
        advice = AT_ONE if name == "eps_up" and estimate.value == 1 else ""
        yield FitWarning("at-bound", f"{name} is at its bound {estimate.value:.4g}", owner, advice)


def _is_apart(separation: list[FitWarning], name: str, owner: str | None) -> bool:
    """Whether a warning of σ and ψ, which are not separate, is about it."""
    owners = {w.material for w in separation if w.code == "sigma-psi-not-separate"}
    return name in ("sigma", "psi") and owner in owners


def _off_prior(element: Element, value: float) -> str | None:
    mean, deviation = element.parameter.prior or (0.0, np.inf)
    off = abs(value - mean) / deviation
    if off <= warnings.FROM_PRIOR:
        return None
    return (
        f"{element.name} is {value:.3g}, {off:.2g} standard deviations of its prior "
        f"({mean:.3g} ± {deviation:.2g}) from the mean of that"
    )


def _collinear(fit: ComponentFit, separation: list[FitWarning]) -> list[FitWarning]:
    """Two parameters of a likelihood that are determined together only, and what of them is known."""
    if not fit.is_likelihood or _has_arrays(fit):
        return []
    known, points, elements = fit.uncertainty, fit.final.problem.points, fit.component.elements
    covariance = np.where(known.known[:, None] & known.known, known.covariance, 0.0)
    size = np.sqrt(np.where(np.diag(covariance) > 0, np.diag(covariance), np.inf))
    correlation = np.triu(covariance / np.outer(size, size), 1)
    by_owner: dict[str | None, FitWarning] = {}  # one is enough of a data set
    for i, j in np.argwhere(np.abs(correlation) > warnings.COLLINEAR):
        first, second = elements[i], elements[j]
        shared = sorted({*first.sets} & {*second.sets})
        owner = _owner(fit, tuple(shared)) if shared else None
        if not shared or all(_is_apart(separation, e.name, owner) for e in (first, second)):
            continue
        cause = f"{first.name} and {second.name} are correlated by {correlation[i, j]:.5f}"
        measured = np.flatnonzero((points.set == shared[0]) & (points.observable == 0))
        if len(measured):
            middle = _in_the_middle(fit, measured)
            cause += f"; the data determine ε in their middle, {middle}"
        by_owner.setdefault(owner, FitWarning("collinear", cause, owner))
    return list(by_owner.values())


def _in_the_middle(fit: ComponentFit, points: np.ndarray) -> str:
    """ε of the curve at the middle of some points, with its standard error."""
    problem, known = fit.final.problem, fit.uncertainty
    velocity = problem.points.velocity[points]
    middle = points[np.argmin(np.abs(np.log(velocity / np.median(velocity))))]
    linear = problem.bare.linearise(fit.z[None])
    covariance = known.of_predictions[np.ix_(problem.active, problem.active)]
    error = float(np.sqrt(max(linear.per[0, middle] @ covariance @ linear.per[0, middle], 0.0)))
    middle_text = with_error(float(linear.prediction[0, middle]), error)
    return f"{middle_text} at {problem.points.velocity[middle]:.3g} m/s"


def _separation(fit: ComponentFit, curves: dict[str, Profile]) -> list[FitWarning]:
    """σ and ψ of Zhou's law that only their combination ε_up is known of; ε_up in their place."""
    raised = []
    for g, spec in enumerate(fit.component.specs):
        if spec.model.law_type is not sj.Zhou or spec.objective != "model":
            continue
        if spec.by_eps_up:
            cause = "no points below the critical velocity: sigma and psi act through eps_up alone"
            raised.append(FitWarning("eps-up-only", cause, spec.data.name))
        places = fit.component.places(g)
        if not {"sigma", "psi"} <= {*places}:
            continue
        pair = [places["sigma"], places["psi"]]
        errors = fit.uncertainty.errors[pair]
        labels = [fit.component.elements[k].label for k in pair]
        wide = [warnings.is_wide(curves[label]) for label in labels if label in curves]
        if not np.max(errors) <= warnings.SEPARATE or any(wide):
            cause = f"the standard error of ln sigma is {errors[0]:.2g}"
            if not np.isfinite(errors[0]):
                cause = "only one combination of sigma and psi shows"
            raised.append(FitWarning("sigma-psi-not-separate", cause, spec.data.name))
    return raised


def _other_minima(fit: ComponentFit, stage: StageFit, estimates: Mapping[int, Estimate]):
    """Elements with a value outside their interval at a minimum nearly as good, and how much higher χ² is there."""
    problem, rises = stage.problem, {}

    def is_outside(k: int, value: float) -> bool:
        low, high = estimates[k].low, estimates[k].high
        return not (low is None or low <= value) or not (high is None or value <= high)

    def cost(*places: np.ndarray) -> np.ndarray:
        """Cost of the points, each on its branch there, and of the priors."""
        z = np.array(places)
        return problem.linearise(z, Lanes(elastic=problem.elastic_at(z)), slopes=False).cost

    for other in stage.others:
        # at an end of a range is none: a valley without an end has no second minimum
        if not other.converged[0] or np.any(stage.limits) or np.any(other.limits):
            continue
        way = other.z[0] - stage.z
        theta = problem.transform.physical(other.z[0])
        moved = [
            int(k)
            for k in problem.active
            if abs(way[k]) > MOVED and fit.uncertainty.known[k] and is_outside(k, theta[k])
        ]
        if not moved:
            continue
        spread = weighted_deviation(fit, problem, LEAST_NOISE)
        ends = cost(stage.z, other.z[0])
        rise = float(2 * (ends[1] - ends[0]) / np.mean(spread**2))
        if rise < warnings.SEVERAL_DELTA:
            # closely near the ends: the rise around a shallow minimum is there
            shares = np.sin(np.linspace(0, np.pi / 2, STATIONS + 2)[1:-1]) ** 2
            between = cost(*(stage.z + share * way for share in shares))
            if np.any(between > np.max(ends) * (1 + LEFT_UNDONE)):
                rises |= {k: rise for k in moved if k not in rises}
    return rises


def of_set(fit: ComponentFit, part: MaterialFit, residual, errors: Mapping[str, Errors]):
    """Warnings about one data set's points.

    Args:
        residual: fitted less measured ε.
        errors: of the points of each observable.
    """
    raised: list[FitWarning] = []
    if RESTITUTION in errors:
        raised += _of_restitution(part, residual, errors[RESTITUTION])
        raised += named("offset", _offsets(fit, part, residual), part.name)
    for name, goodness in part.observed.items():
        raised += _of_observable(part, name, goodness, errors[name])
    return [*raised, *_of_modulus(part)]


def _of_restitution(part: MaterialFit, residual, errors: Errors) -> list[FitWarning]:
    """Warnings about one data set's curve.

    Args:
        residual: fitted less measured ε.
        errors: those of its points.
    """
    data, left, name = part.data, part.residual_degrees, part.name
    velocity, restitution = errors.velocity, data.restitution[np.isfinite(data.restitution)]
    standardised, is_off = np.array(part.standardised), np.abs(residual) > NO_RESIDUAL
    yields = part.law.elastic_velocity() if isinstance(part.law, sj.RateIndependentLaw) else np.nan
    yields = np.asarray(yields, float)
    ever_yields = bool(np.any((yields > 0) & (yields < np.inf)))
    raised = [*named("data", (note for note in data.notes if "above 1" in note), name)]
    for implausible in plausibility(data):  # about yield only if the law yields
        if ever_yields or implausible.code != "yield-beyond-limit":
            code = "groups" if implausible.code == "groups" else "plausibility"
            raised.append(FitWarning(code, implausible.cause, name, implausible.advice))
    misfit, runs = None, warnings.runs(velocity, np.where(is_off, standardised, 0.0))
    if errors.is_stated and part.reduced_chi_squared is not None:
        of_noise = None if data.degrees is None else float(np.mean(data.degrees))
        misfit = warnings.misfit(part.reduced_chi_squared, left, of_noise)
    elif part.objective == "two-step" and part.rms_empirical is not None:
        misfit = warnings.misfit_against_scatter(part.n, part.rms, left, part.rms_empirical)
    far = None if misfit else _far_from_stated(part, errors)
    causes = {"model-misfit": misfit, "stated-uncertainty": far, "residual-runs": runs}
    if np.any(is_off) and not (raised or misfit or runs):
        # where the curve misses the points neither says anything of the errors
        curve = restitution + residual
        alike = None if errors.shares else warnings.alike_neighbours(velocity, standardised)
        causes["unequal-scatter"] = warnings.unequal_scatter(velocity, curve, standardised)
        causes["groups"] = alike
    stated = errors.points.uncertainty if errors.is_stated else None
    kink, uncertain = yields if ever_yields else np.nan, data.velocity_uncertainty
    level = warnings.no_velocity_dependence(velocity, restitution, stated, part.family)
    causes["no-velocity-dependence"] = level
    causes["velocity-errors"] = warnings.velocity_errors(data.velocity, uncertain, kink)
    for code, cause in causes.items():
        advice = LAW_OR_GROUPS if code == "residual-runs" and errors.shares else ""
        raised += [FitWarning(code, cause, name, advice)] if cause else []
    raised += named("status", warnings.statuses(part.status, velocity), name)
    below = "all velocities are below the critical velocity" if part.known_to < np.inf else None
    return [*raised, *named("all-below-yield", [below], name)]


def _far_from_stated(goodness: Goodness, errors: Errors) -> str | None:
    if errors.points.uncertainty is None:  # only an error of the velocity is
        return None
    scale = goodness.reduced_chi_squared if "scale" in errors.unknown else None
    size = np.array(goodness.standardised)
    return warnings.far_from_stated(size, goodness.variances, scale, goodness.family)


def _offsets(fit: ComponentFit, part: MaterialFit, residual) -> Iterator[str | None]:
    """Whether a group is far from the others, or the set from the curve that others determine too."""
    offsets, deviation = part.group_offsets, part.group_deviation or 0.0
    yield warnings.far_group(offsets, deviation)
    if len(fit.component.sets) > 1:
        standard = warnings.standard_offsets(offsets, deviation) if offsets else part.standardised
        yield warnings.off_as_a_whole(np.array(standard), float(np.mean(residual)))


def _of_observable(part: MaterialFit, observable: str, goodness: Goodness, errors: Errors):
    """Whether the curve misses what else than ε was measured."""
    words, reduced = OBSERVABLES[observable].words, goodness.reduced_chi_squared
    misses = warnings.misfit(reduced, goodness.residual_degrees) if errors.is_stated else None
    trend = warnings.runs(errors.velocity, np.array(goodness.standardised))
    far = None if misses else _far_from_stated(goodness, errors)
    causes = {"model-misfit": misses, "stated-uncertainty": far, "residual-runs": trend}
    for code, cause in causes.items():
        yield from named(code, [cause and f"{words}: {cause}"], part.name)
    if goodness.rms > MOST_OFF:  # an estimated scatter takes a wrong unit or size as it is
        cause = f"{words}: the law misses the values by {100 * goodness.rms:.3g} % (rms)"
        advice = "Check the unit and the bodies; of dents, which diameter was measured (`dent`)."
        yield FitWarning("plausibility", cause, part.name, advice)


def _of_modulus(part: MaterialFit) -> Iterator[FitWarning]:
    modulus = modulus_by_times(part)
    if modulus is not None and abs(modulus.off) > MODULUS_OFF * modulus.error:
        cause = (
            f"the contact times are those of {np.exp(modulus.off):.3g} times the stated modulus E, "
            f"which they determine to {100 * modulus.error:.2g} %"
        )
        yield FitWarning("modulus", cause, part.name)
