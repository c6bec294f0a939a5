"""Which doubts a fit raises: about its parameters, its searches, and each data set's curve."""

from dataclasses import replace

import numpy as np

import softjax as sj
from calibration.data import plausibility
from calibration.fitting import doubt as doubts
from calibration.fitting.component_fit import ComponentFit
from calibration.fitting.doubt import Doubt
from calibration.fitting.errors import Errors
from calibration.fitting.estimate import Estimate
from calibration.fitting.material import Goodness, MaterialFit
from calibration.fitting.minima import other_minima
from calibration.fitting.profiles import Profile
from calibration.observables import OBSERVABLES
from calibration.rounding import with_error

ROUNDING = 1e-12  # of ε
AT_ONE = "The data show no loss beside the plastic one: eps_up cannot exceed 1; its interval is one-sided."


def shared_doubts(
    fit: ComponentFit, estimates: dict[int, Estimate], curves: dict[str, Profile]
) -> list[Doubt]:
    """Doubts about a component's parameters and searches."""
    found: list[Doubt] = []
    for k, element in enumerate(fit.component.elements):
        found += _of_estimate(element.name, estimates[k], _owner(fit, element.sets))
    separation = _separation(fit, curves)
    found += _collinear(fit, separation)
    for stage in fit.stages:
        names = [data.name for data in stage.problem.datasets]
        if not stage.found.converged[0]:
            cause = f"{stage.report.stage}: {stage.report.reason}"
            found += [Doubt("not-converged", cause, name) for name in names]
        if stage.crossings:
            cause = f"{stage.crossings} points changed between elastic and plastic on the way"
            found += [Doubt("branch-change", cause, name) for name in names]
        if stage.alone:
            cause = f"{stage.report.stage}: one search alone ended so low, and it misses the points"
            found += [Doubt("several-minima", cause, name) for name in names]
        for k, rise in other_minima(fit, stage, doubts.SEVERAL_DELTA):
            element = fit.component.elements[k]
            told = f"only {rise:.2g} higher" if rise >= 0 else f"{-rise:.2g} lower"
            cause = f"another minimum for {element.name} has a chi squared {told}"
            found.append(Doubt("several-minima", cause, _owner(fit, element.sets)))
    condition = float(fit.uncertainty.condition_number[0])
    if condition > doubts.CONDITION_LIMIT and not _has_whole(fit):
        cause = f"the Jacobian's condition number is {condition:.2g}"
        found.append(Doubt("ill-conditioned", cause, _owner(fit, fit.component.sets)))
    return found + separation


def _of_estimate(name: str, estimate: Estimate, owner: str | None) -> list[Doubt]:
    if "[" in name:  # a number of a network is no parameter that anybody reads
        return []
    if estimate.at_bound and estimate.value is not None:
        # no bound that somebody gave: ε_17 is 1 at most
        advice = AT_ONE if name == "eps_up" and estimate.value == 1 else None
        return [Doubt("at-bound", f"{name} is at its bound {estimate.value:.4g}", owner, advice)]
    if estimate.value is None:
        # the cost falls, ever less, however large the parameter gets
        return [Doubt("at-bound", f"{name} grows without bound: any large value is as good", owner)]
    if estimate.method == "undetermined":
        cause = f"{name} does not show in these data, or only together with another"
        return [Doubt("rank-deficient", cause, owner)]
    if estimate.skewed:
        cause = f"the interval of {name} is not its standard error's: the likelihood is skewed"
        return [Doubt("skewed", cause, owner)]
    return []


def _collinear(fit: ComponentFit, separation: list[Doubt]) -> list[Doubt]:
    """Two parameters of a likelihood that are told together only, and what of them is known."""
    if not fit.is_likelihood or _has_whole(fit):
        return []
    known, problem, elements = fit.uncertainty, fit.final.problem, fit.component.elements
    apart = {doubt.material for doubt in separation if doubt.code == "sigma-psi-not-separate"}
    covariance = np.where(known.known[0][:, None] & known.known[0], known.covariance[0], 0.0)
    size = np.sqrt(np.where(np.diag(covariance) > 0, np.diag(covariance), np.inf))
    correlation = np.triu(covariance / np.outer(size, size), 1)
    found: list[Doubt] = []
    for i, j in np.argwhere(np.abs(correlation) > doubts.COLLINEAR):
        one, other = elements[i], elements[j]
        shared = set(one.sets) & set(other.sets)
        owner = _owner(fit, tuple(sorted(shared))) if shared else None
        if not shared or (owner in apart and {one.name, other.name} == {"sigma", "psi"}):
            continue
        if any(doubt.material == owner for doubt in found):
            continue  # one is enough of a data set
        place = fit.component.sets.index(min(shared))
        points = np.flatnonzero((problem.points.set == place) & (problem.points.observable == 0))
        told = ""
        if len(points):
            told = f"; known is ε in the middle of the data, {_in_the_middle(fit, points)}"
        names = f"{one.name} and {other.name}"
        cause = f"{names} are correlated by {correlation[i, j]:.4f}{told}"
        found.append(Doubt("collinear", cause, owner))
    return found


def _in_the_middle(fit: ComponentFit, points: np.ndarray) -> str:
    """ε of the curve at the middle of some points, with its standard error."""
    problem, known = fit.final.problem, fit.uncertainty
    velocity = problem.points.velocity[points]
    middle = points[np.argmin(np.abs(np.log(velocity / np.median(velocity))))]
    theta, per_z = problem.transform.physical(fit.z[None]), problem.transform.slope(fit.z[None])
    value, slope, _ = problem.curve(theta, per_z)
    own = known.of_predictions[0][np.ix_(problem.active, problem.active)]
    error = float(np.sqrt(max(slope[0, middle] @ own @ slope[0, middle], 0.0)))
    told = with_error(float(value[0, middle]), error)
    return f"{told} at {problem.points.velocity[middle]:.3g} m/s"


def _has_whole(fit: ComponentFit) -> bool:
    return any(spec.trees for spec in fit.component.specs)


def _owner(fit: ComponentFit, sets: tuple[int, ...]) -> str | None:
    """The data set that something is about; None for several."""
    if len(sets) != 1:
        return None
    return fit.component.specs[fit.component.sets.index(sets[0])].data.name


def _separation(fit: ComponentFit, curves: dict[str, Profile]) -> list[Doubt]:
    """σ and ψ of Zhou's law that only their combination ε_up is known of; ε_up in their place."""
    found = []
    for g, spec in zip(fit.component.sets, fit.component.specs, strict=True):
        if spec.model.law_type is not sj.Zhou or spec.objective != "model":
            continue
        if spec.by_eps_up:
            cause = "no points below the critical velocity: sigma and psi act through eps_up alone"
            found.append(Doubt("eps-up-only", cause, spec.data.name))
        places = fit.component.places(g)
        pair = [places[name] for name in ("sigma", "psi") if name in places]
        if len(pair) == 2:
            errors = fit.uncertainty.errors[0, pair]
            labels = [fit.component.elements[k].label for k in pair]
            wide = [doubts.is_wide(curves[label]) for label in labels if label in curves]
            if not np.max(errors) <= doubts.SEPARATE or any(wide):
                cause = (
                    f"the standard error of ln sigma is {errors[0]:.2g}"
                    if np.isfinite(errors[0])
                    else "only one combination of sigma and psi shows"
                )
                found.append(Doubt("sigma-psi-not-separate", cause, spec.data.name))
    return found


def _implausible(part: MaterialFit) -> list[Doubt | None]:
    """What looks like a slip in the data; of yield only where the law yields."""
    found = plausibility(part.data)
    if not _yields(part.law):
        found = tuple(one for one in found if one.code != "yield-beyond-limit")
    return [
        Doubt(
            "groups" if one.code == "groups" else "plausibility", one.cause, part.name, one.remedy
        )
        for one in found
    ]


def _yields(law: sj.ContactLaw) -> bool:
    """Whether there is a velocity from which on something yields."""
    if not isinstance(law, sj.RateIndependentLaw):
        return False
    velocity = np.asarray(law.elastic_velocity())
    return bool(np.any((velocity > 0) & (velocity < np.inf)))


def material_doubts(part: MaterialFit, residual, errors: Errors) -> list[Doubt]:
    """Doubts about one data set's curve.

    Args:
        residual: fitted less measured ε.
        errors: those of its points.
    """
    data, name, left = part.data, part.name, part.residual_degrees
    velocity, restitution = errors.velocity, data.restitution[np.isfinite(data.restitution)]
    found: list[Doubt | None] = [
        Doubt("data", note, name) for note in data.notes if "above 1" in note
    ]
    found += _implausible(part)
    if errors.is_stated and part.reduced_chi_squared is not None:
        of_noise = None if data.degrees is None else float(np.mean(data.degrees))
        reduced = part.reduced_chi_squared
        found.append(doubts.misfit(reduced, left, of_noise, name))
    elif part.objective == "two-step" and part.rms_empirical is not None:
        n = part.n
        scatter = part.rms_empirical * np.sqrt(n / max(n - 2, 1))
        rms = part.rms * np.sqrt(n / max(left, 1))
        found.append(doubts.misfit_against_scatter(rms, scatter, max(left, 1), max(n - 2, 1), name))
    standardised = np.array(part.standardised)
    found.append(
        doubts.runs(velocity, np.where(np.abs(residual) < ROUNDING, 0.0, standardised), name)
    )
    if np.max(np.abs(residual)) > ROUNDING and not any(found):
        # where the curve misses the points neither says anything of the errors
        found.append(doubts.unequal_scatter(velocity, restitution + residual, standardised, name))
        if not errors.shares:
            found.append(doubts.alike_neighbours(velocity, standardised, name))
    stated = errors.points.uncertainty
    found.append(doubts.no_velocity_dependence(velocity, restitution, stated, name))
    found += doubts.statuses(part.status, velocity, name)
    if part.known_to < np.inf:
        cause = "all velocities are below the critical velocity"
        found.append(Doubt("all-below-yield", cause, name))
    return [one for one in found if one is not None]


def observed_doubts(
    part: MaterialFit, observable: str, one: Goodness, errors: Errors
) -> list[Doubt]:
    """Whether the curve misses what else than ε was measured."""
    found: list[Doubt | None] = []
    if errors.is_stated and one.reduced_chi_squared is not None:
        found.append(doubts.misfit(one.reduced_chi_squared, one.residual_degrees, None, part.name))
    found.append(doubts.runs(errors.velocity, np.array(one.standardised), part.name))
    words = OBSERVABLES[observable].words
    return [replace(doubt, cause=f"{words}: {doubt.cause}") for doubt in found if doubt is not None]
