"""Which doubts a fit raises: about its parameters, its searches, and each data set's curve."""

import numpy as np

from calibration import doubt as doubts
from calibration.doubt import Doubt
from calibration.material_fit import MaterialFit
from calibration.minima import MOVED, rises_between

ROUNDING = 1e-10  # of ε: less is no noise


def shared_doubts(fitted, estimates, curves) -> list[Doubt]:
    """Doubts about parameters and searches."""
    setup, known = fitted.setup, fitted.uncertainty
    found: list[Doubt] = []
    for e in setup.elements:
        name = setup.datasets[e.sets[0]].name if len(e.sets) == 1 else None
        estimate = estimates[e.position]
        if estimate.at_bound:
            found.append(doubts.at_bound(e.column, estimate.value, name))
        elif estimate.value is None:
            found.append(doubts.without_bound(e.column, name))
        elif estimate.method == "undetermined":
            cause = f"{e.column} does not show in these data, or only together with another"
            found.append(Doubt("rank-deficient", cause, name))
    for stage in fitted.stages:
        if not stage.search.converged:
            cause = f"{stage.report.stage}: {stage.search.reason}"
            found += [Doubt("not-converged", cause, name) for name in _names(setup, stage)]
        if stage.crossings:
            cause = f"{stage.crossings} points changed between elastic and plastic on the way"
            found += [Doubt("branch-change", cause, name) for name in _names(setup, stage)]
        found += _several_minima(fitted, stage)
    if known.condition_number > doubts.CONDITION_LIMIT:
        cause = f"the Jacobian's condition number is {known.condition_number:.2g}"
        found.append(Doubt("ill-conditioned", cause))
    return found + _separation(fitted, curves)


def _names(setup, stage) -> list[str]:
    weight = stage.problem.obs.weight
    return [d.name for g, d in enumerate(setup.datasets) if np.any(weight[setup.rows(g)] > 0)]


def _several_minima(fitted, stage) -> list[Doubt]:
    """Minima of nearly the same cost at other values, among the ends of the other starts."""
    if stage.problem.loss != "squared":
        return []
    found = []
    for other in stage.others:
        if other.converged:
            for elements in _together(fitted.setup, stage.problem):
                found += _other_minimum(fitted, stage, other, elements)
    return list(dict.fromkeys(found))


def _together(setup, problem) -> list[list]:
    """The searched elements, those together that share a data set: each group has its own minima."""
    groups: list[list] = []
    for e in setup.elements:
        if e.position in problem.active:
            near = [g for g in groups if any({*e.sets} & {*other.sets} for other in g)]
            joined = [other for g in near for other in g]
            groups = [*(g for g in groups if g not in near), [*joined, e]]
    return groups


def _other_minimum(fitted, stage, other, elements) -> list[Doubt]:
    """The same for one group, the other elements where the best search found them."""
    problem, known = stage.problem, fitted.uncertainty
    positions = [e.position for e in elements]
    there = np.where(np.isin(problem.active, positions), other.z, problem.start)
    way = dict(zip(problem.active, np.abs(there - problem.start), strict=True))
    moved = [e for e in elements if way[e.position] > MOVED]
    moved = [e for e in moved if not known.undetermined[known.of(e.position)]]
    held = {*stage.search.limits, *other.limits} & {*positions}
    if held or not moved:  # a valley without an end has no second minimum
        return []
    rise = _rise(fitted, problem, there, {g for e in elements for g in e.sets})
    cost = lambda x: float(np.sum(_residual(problem, x) ** 2))  # noqa: E731
    if rise >= doubts.SEVERAL_DELTA or not rises_between(cost, problem.start, there):
        return []
    told = f"only {rise:.2g} higher" if rise >= 0 else f"{-rise:.2g} lower"
    return [_another(fitted.setup, e, told) for e in moved]


def _another(setup, e, told: str) -> Doubt:
    name = setup.datasets[e.sets[0]].name if len(e.sets) == 1 else None
    return Doubt("several-minima", f"another minimum for {e.column} has a chi squared {told}", name)


def _residual(problem, x) -> np.ndarray:
    """Weighted residuals and priors, each point on the branch that it has at x."""
    return problem.with_elastic(problem.elastic_at(problem.full(x))).linearise(x)[0]


def _rise(fitted, problem, there, sets) -> float:
    """χ² there less χ² at the best: squares over the variance that noise gives them."""
    own = np.isin(problem.obs.group, list(sets)) & (problem.obs.weight > 0)
    variance = np.maximum(fitted.uncertainty.noise, ROUNDING) ** 2 * problem.obs.weight**2
    gain = _residual(problem, there) ** 2 - _residual(problem, problem.start) ** 2
    points, priors = gain[: len(own)], gain[len(own) :]
    spread = np.mean(variance[own])  # a prior weighs as a point
    return float(np.sum(points[own] / variance[own]) + np.sum(priors) / spread)


def _separation(fitted, curves) -> list[Doubt]:
    """σ and ψ that only their combination ε_up is known of; and ε_up in their place."""
    setup, known = fitted.setup, fitted.uncertainty
    found = []
    for g, data in enumerate(setup.datasets):
        if setup.layout.up_given[g] and setup.plans[g] == "model":
            cause = "no points below the critical velocity: sigma and psi act through eps_up alone"
            found.append(Doubt("eps-up-only", cause, data.name))
        pair = [e for e in setup.elements if g in e.sets and e.column in ("sigma", "psi")]
        rows = [known.of(e.position) for e in pair]
        own = [curves[e.label] for e in pair if e.label in curves]
        if len(rows) == 2 and setup.plans[g] == "model":
            errors = np.sqrt(np.diag(known.covariance)[rows])
            if not np.max(errors) <= doubts.SEPARATE or any(map(doubts.is_wide, own)):
                cause = f"the standard error of ln sigma is {errors[0]:.2g}"
                found.append(Doubt("sigma-psi-not-separate", cause, data.name))
    return found


def material_doubts(fitted, part: MaterialFit, g, residual, left) -> list[Doubt]:
    """Doubts about one data set's curve."""
    data, name = part.data, part.name
    found = [Doubt("data", note, name) for note in data.notes if "above 1" in note]
    uncertainty = fitted.setup.uncertainties[g]
    if data.uncertainty is not None and part.reduced_chi_squared is not None:
        noise = float(np.sqrt(np.mean(uncertainty**2)))
        found.append(doubts.misfit(part.rms, noise, part.reduced_chi_squared, left, name))
    elif part.plan == "two-step":
        n = part.n
        scatter = part.rms_empirical * np.sqrt(n / max(n - 2, 1))
        found.append(
            doubts.misfit_against_scatter(
                part.rms * np.sqrt(n / max(left, 1)), scatter, max(left, 1), max(n - 2, 1), name
            )
        )
    found.append(doubts.runs(data.velocity, residual, name))
    found.append(doubts.no_velocity_dependence(data.velocity, data.restitution, uncertainty, name))
    found += doubts.statuses(part.status, data.velocity, name)
    if part.plan in ("two-step", "model") and np.all(
        fitted.setup.obs.elastic[fitted.setup.rows(g)]
    ):
        cause = "all velocities are below the critical velocity"
        found.append(Doubt("all-below-yield", cause, name))
    return [one for one in found if one is not None]
