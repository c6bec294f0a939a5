"""Which doubts a fit raises: about its parameters, its searches, and each data set's curve."""

import numpy as np

import softjax as sj
from calibration.data import plausibility
from calibration.fitting import doubt as doubts
from calibration.fitting.component_fit import ComponentFit
from calibration.fitting.doubt import Doubt
from calibration.fitting.errors import Errors
from calibration.fitting.estimate import Estimate
from calibration.fitting.material import MaterialFit
from calibration.fitting.minima import other_minima
from calibration.fitting.profiles import Profile

ROUNDING = 1e-12  # of ε
AT_ONE = "The data show no loss beside the plastic one: eps_up cannot exceed 1; its interval is one-sided."


def shared_doubts(
    fit: ComponentFit, estimates: dict[int, Estimate], curves: dict[str, Profile]
) -> list[Doubt]:
    """Doubts about a component's parameters and searches."""
    found: list[Doubt] = []
    for k, element in enumerate(fit.component.elements):
        found += _of_estimate(element.name, estimates[k], _owner(fit, element.sets))
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
    return found + _separation(fit, curves)


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
    return []


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
        doubts.runs(data.velocity, np.where(np.abs(residual) < ROUNDING, 0.0, standardised), name)
    )
    if np.max(np.abs(residual)) > ROUNDING and not any(found):
        # where the curve misses the points neither says anything of the errors
        found.append(
            doubts.unequal_scatter(data.velocity, data.restitution + residual, standardised, name)
        )
        if not errors.shares:
            found.append(doubts.alike_neighbours(data.velocity, standardised, name))
    stated = data.uncertainty
    found.append(doubts.no_velocity_dependence(data.velocity, data.restitution, stated, name))
    found += doubts.statuses(part.status, data.velocity, name)
    if part.known_to < np.inf:
        cause = "all velocities are below the critical velocity"
        found.append(Doubt("all-below-yield", cause, name))
    return [one for one in found if one is not None]
