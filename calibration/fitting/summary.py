"""Each data set's part of a result: estimates, what follows from them, goodness of fit, warnings.

Another end of a search counts as another minimum only if the gradient vanishes there and the cost rises
on the straight way from it to the best. A straight way that rises does not prove that every bent one
does; of a valley so level that the gradient vanishes at two places along it no other minima are reported."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

import softjax as sj
from calibration.data import RestitutionData, plausibility
from calibration.fitting import warnings
from calibration.fitting.curves import modulus_by_times
from calibration.fitting.errors import Carried, Errors
from calibration.fitting.laws import LINE, eq_17, several_yields
from calibration.fitting.material import Estimate, Goodness, MaterialFit, Outlier
from calibration.fitting.problem import DRAG, Element, Lanes, Problem
from calibration.fitting.profiles import Profile, estimate_of, estimates, weighted_deviation
from calibration.fitting.request import Request, blocks_of
from calibration.fitting.search import TINY
from calibration.fitting.stages import ComponentFit, StageFit, fitted
from calibration.fitting.uncertainty import NULL_SHARE, RANK_TOLERANCE, leverages, quantile
from calibration.fitting.warnings import FitWarning
from calibration.observables import OBSERVABLES, RESTITUTION
from calibration.parameters import NONE
from calibration.rounding import with_error

RARE = 0.05  # probability that the farthest of n normal errors is named
MOST_OUTLIERS = 100  # of one data set
NO_ERRORS = 1e-9  # of ε: residuals below are none
NO_RESIDUAL = 1e-12  # of ε
MOST_OFF = 0.5  # rms of an observable other than ε, in parts of its values
DIFFERENCE = 1e-3  # in z, of fourth-order differences: their error is near 1e-12
PLAIN: dict[str, Any] = {"optimiser": "levenberg-marquardt", "starts": 4}
MODULUS_OFF = 2.0  # errors by which the modulus of the contact times is off
NOISELESS = 1e-9  # rms of ε about Eq. (17) below which data are a curve and no measurement
MOVED = 1e-2  # in z, from which on values are others to a reader
STATIONS = 32
# Share of the cost that the next step may still promise where the gradient counts as vanished. A
# rise no larger than that may be made of what the two searches left undone.
LEFT_UNDONE = 1e-8
OPEN = ("rank-deficient", "sigma-psi-not-separate")  # an infinite condition number is the same fact
LEAST_NOISE = 1e-10  # of ε: less is no noise
LAW_OR_GROUPS = (
    f"The law misses a trend ({warnings.OTHER_LAWS}), or other points belong together than those of the "
    "groups; intervals are too narrow."
)
AT_ONE = (
    "The data show no loss but the plastic one: eps_up cannot exceed 1; its interval is one-sided."
)


def summarise(
    fit: ComponentFit, curves: dict[str, Profile], confidence: float
) -> tuple[list[MaterialFit], list[FitWarning], dict[str, Estimate]]:
    """Each data set's part, the warnings about several of them, and the error of the drag coefficient."""
    found = estimates(fit, curves, confidence)
    shared_warnings = _of_component(fit, found, curves)
    materials = [
        _material(fit, g, found, confidence, shared_warnings)
        for g in range(len(fit.component.sets))
    ]
    elements = enumerate(fit.component.elements)
    drag = {e.label: found[k] for k, e in elements if e.name == DRAG}
    return materials, [one for one in shared_warnings if one.material is None], drag


def _material(fit: ComponentFit, g: int, found, confidence: float, shared_warnings) -> MaterialFit:
    spec, problem = fit.component.specs[g], fit.final.problem
    blocks = [(k, block) for k, block in enumerate(problem.blocks) if block.set == g]
    goodness = {block.observable: _goodness(fit, k) for k, block in blocks}
    of_eps = goodness.get(RESTITUTION) or next(iter(goodness.values()))
    outliers = tuple(one for of_one in goodness.values() for one in of_one.outliers)
    at = problem.linearise(fit.z[None], slopes=False)
    first = problem.of_restitution(g)
    known_from, known_to = _determined_between(fit, g)
    parameters, values, labels = _parameters(fit, g, found, known_to)
    part = MaterialFit(
        **(vars(of_eps) | {"outliers": outliers}),
        data=spec.data,
        objective=spec.objective,
        model=spec.model,
        parameters=parameters,
        derived=derived_of(fit, g, confidence),
        values=values,
        labels=labels,
        rms_empirical=None,
        empirical=None,
        converged=fit.converged,
        status=tuple(map(int, at.status[0][first])),
        known_from=known_from,
        known_to=known_to,
        observed={name: one for name, one in goodness.items() if name != RESTITUTION},
    )
    part, disagreements = _with_eq_17(fit, g, part)
    found_warnings = [one for one in shared_warnings if one.material == part.name] + disagreements
    errors = dict(zip(goodness, spec.errors, strict=True))
    if RESTITUTION in errors:
        off = at.prediction[0][first] - problem.points.value[first]
        found_warnings += _of_restitution(part, off, errors[RESTITUTION])
        found_warnings += _named("offset", _offsets(fit, part, off), part.name)
    for name, one in part.observed.items():
        found_warnings += _of_observable(part, name, one, errors[name])
    return replace(part, warnings=(*found_warnings, *_of_modulus(part)))


def _parameters(fit: ComponentFit, g: int, found, known_to: float):
    """Estimates of what was free and what was held, without the numbers of whole parameters; all that
    makes the law; and what the covariance calls what was free."""
    parameters, values, labels = {}, {}, {}
    places = fit.component.places(g)
    for local in fit.component.specs[g].local:
        name, place, shown = local.name, places.get(local.name), "[" not in local.name
        if place is not None:
            values[name] = float(fit.theta[place])
            labels[name] = fit.component.elements[place].label
            parameters |= {name: found[place]} if shown else {}
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
    critical = np.asarray(problem.yields_at(fit.z))[of_set]
    below = problem.points.velocity[of_set] <= critical
    free = {e.name for e in fit.component.elements if g in e.sets}
    with_prior = {e.name for e in fit.component.elements if e.parameter.prior is not None}
    needs_below = spec.by_eps_up or ({"sigma", "psi"} & free) - with_prior
    above_is_open = "chi" in {local.name for local in spec.local if local.parameter.value is None}
    several = not spec.by_eps_up and several_yields(spec.data.contact)
    knows_below = bool(np.any(below)) or not needs_below or several
    chi_told = not np.all(below) or not ({"chi", "c1", "c2"} & free or above_is_open)
    known_from = 0.0 if knows_below else float(np.max(critical))
    return known_from, (np.inf if chi_told else float(np.min(critical)))


def _goodness(fit: ComponentFit, k: int) -> Goodness:
    """Goodness of fit for one observable of a data set."""
    problem, first = fit.final.problem, fit.stages[0].problem  # which knows what the points share
    span, errors, s = problem.spans[k], first.errors[k], first.variances[k]
    found, one = problem.linearise(fit.z[None]), first.linearise(fit.z[None]).carried(span)
    is_free = fit.uncertainty.limits[problem.active] == 0  # the others cannot follow a point
    leverage = leverages(np.where(is_free, found.jacobian[0], 0.0))[: problem.count][span]
    left = float(max(len(leverage) - np.sum(leverage), 0.0))
    spread = weighted_deviation(fit, problem)[span]
    allowed = np.sqrt(np.maximum(1 - leverage, 1e-12)) * np.where(spread > 0, spread, 1.0)
    off = found.prediction[0][span] - problem.points.value[span]
    stated = errors.is_stated or errors.unknown == ("scale",)
    reduced = None
    if errors.points.uncertainty is not None and left >= 1 and stated and errors.is_normal:
        factor = errors.factor({**s, "scale": 1.0}, one.slope, one.bend)
        reduced = float(np.sum(errors.whiten(factor, off[None, :, None]) ** 2)) / left
    nu = errors.family(s).dof
    return Goodness(
        rms=float(np.sqrt(np.mean(off**2))),
        reduced_chi_squared=reduced,
        variances=_variances(errors, s, one),
        timing=float(s["timing"]) ** 0.5 if "timing" in s else None,
        noise_dof=None if nu is None else float(nu),
        outliers=_outliers(first, k, one, off, leverage),
        standardised=tuple(map(float, found.residual[0, : problem.count][span] / allowed)),
        leverage=tuple(map(float, leverage)),
        residual_degrees=left,
        group_offsets=_group_offsets(first, k, one, off),
    )


def _group_offsets(first: Problem, k: int, one: Carried, off) -> dict[str, tuple[float, float]]:
    """Best linear unbiased predictions of the groups' offsets, with their conditional errors."""
    errors, s, (place, observable, _) = first.errors[k], first.variances[k], first.blocks[k]
    if errors.group is None or "group" not in s:
        return {}
    factor, variance = errors.factor(s, one.slope, one.bend), float(s["group"])
    solved = errors.solve(factor, -off[None, :, None])[0, :, 0]
    offsets = variance * np.bincount(errors.group, solved)
    sizes = np.sqrt(variance / (1 + variance * factor.per.reshape(-1)))
    data = first.datasets[place]
    rows = next(rows for _, name, rows, *_ in blocks_of(data) if name == observable)
    index = data.group_index
    assert index is not None
    labels = np.array(data.groups, dtype=object)[np.unique(index[rows])]
    order = np.argsort(-np.abs(offsets), kind="stable")
    return {str(labels[i]): (float(offsets[i]), float(sizes[i])) for i in order}


def _outliers(first: Problem, k: int, one: Carried, off, leverage) -> tuple[Outlier, ...]:
    """Points beyond `RARE`: the one of n points that noise sends so far once in twenty data sets."""
    from scipy import special

    errors, s, (place, observable, span) = first.errors[k], first.variances[k], first.blocks[k]
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
    farthest = np.argsort(-size, kind="stable")[:MOST_OUTLIERS]
    data, points = first.datasets[place], first.points
    rows = next(rows for _, name, rows, *_ in blocks_of(data) if name == observable)
    lines = () if data.origin is None else data.origin.lines
    return tuple(
        Outlier(
            int(rows[i]) + 1,
            int(lines[rows[i]]) if rows[i] < len(lines) else None,
            float(points.velocity[span][i]),
            float((points.value * points.unit)[span][i]),
            float(np.copysign(size[i], residual[i])),
            float(weight[i]),
            observable,
        )
        for i in farthest
        if size[i] > limit
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
    return float(eq_17(critical_velocity_of(law), limit, float(law.sigma), float(law.psi)))


def chi_of(law: sj.Zhou) -> float:
    return float(law.chi)


def derived_of(fit: ComponentFit, g: int, confidence: float) -> dict[str, Estimate]:
    """Quantities derived from Zhou's law of one data set; empty for other laws.

    Of bodies that differ from impact to impact v_cr is the highest, and ε_up none.
    """
    spec, problem = fit.component.specs[g], fit.final.problem
    if spec.model.law_type is not sj.Zhou:
        return {}
    critical = np.asarray(problem.yields_at(fit.z))[problem.points.set == g]
    found = {"critical_velocity": Estimate(float(np.max(critical)), method="derived")}
    if not (spec.by_eps_up or several_yields(spec.data.contact)):
        found["eps_up"] = _carried(fit, g, eps_up_of, confidence, 1.0)
    if "chi" not in spec.model.parameters:
        found["chi"] = _carried(fit, g, chi_of, confidence, np.inf)
    return found


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
    acting = (gradient != 0) & (fit.uncertainty.limits == 0)
    whole = fit.uncertainty.covariance
    if fit.is_likelihood and _shows(fit, gradient):  # along no null direction
        whole = fit.uncertainty.of_predictions
    covariance = whole[np.ix_(acting, acting)]
    variance = float(gradient[acting] @ covariance @ gradient[acting]) if np.any(acting) else np.nan
    if not (np.isfinite(variance) and variance >= 0):
        return Estimate(value, method="derived")
    error = variance**0.5
    degrees = fit.uncertainty.along(np.where(acting, gradient, 0.0)[None])[0]
    reach = quantile(confidence, degrees) * error
    low, high = float(max(value - reach, 0.0)), float(min(value + reach, most))
    return Estimate(value, error, low, high, "derived")


def _shows(fit: ComponentFit, gradient: np.ndarray) -> bool:
    """Whether a number moves the points with whatever moves it."""
    problem = fit.final.problem
    rows = problem.linearise(fit.z[None]).jacobian[0]
    size = np.maximum(np.linalg.norm(rows, axis=0), TINY)
    rows, way = rows / size, gradient[problem.active] / size
    left = way - rows.T @ np.linalg.lstsq(rows.T, way, rcond=RANK_TOLERANCE)[0]
    return bool(np.linalg.norm(left) <= NULL_SHARE * np.linalg.norm(way))


def _with_eq_17(fit: ComponentFit, g: int, part: MaterialFit):
    """With the rms and coefficients of Eq. (17); and whether `model` disagrees with `two-step`."""
    spec = fit.component.specs[g]
    if spec.model.law_type is sj.EmpiricalRestitution:
        return replace(part, rms_empirical=part.rms, empirical=part.values), []
    if spec.model.law_type is not sj.Zhou:
        return part, []
    two_step = spec.objective == "two-step"
    alone, place = (fit, g) if two_step else (_eq_17_alone(spec.data), 0)
    if alone is None:
        return part, []
    problem = alone.stages[0].problem
    off = problem.linearise(alone.z[None]).prediction[0] - problem.points.value
    rms = float(np.sqrt(np.mean(off[problem.of_restitution(place)] ** 2)))
    law = problem.law_of(alone.theta, place)
    values = {name: float(getattr(law, name)) for name in ("limit_velocity", "sigma", "psi")}
    part = replace(part, rms_empirical=rms, empirical=values)
    return part, _disagreements(fit, part) if two_step and rms >= NOISELESS else []


def _eq_17_alone(data: RestitutionData) -> ComponentFit | None:
    """Eq. (17) against all points; None without a limit velocity."""
    if data.limit_velocity is None or np.sum(np.isfinite(data.restitution)) <= 2:
        return None
    plain = replace(data.of_restitution(), contact=None)
    return fitted(Request((plain,)).with_options(law="eq-17", **PLAIN))[0]


def _disagreements(two: ComponentFit, part: MaterialFit) -> list[FitWarning]:
    """Warnings where a fit by `model` has another ε_up or χ̃, by more than their errors."""
    free = {e.name: e.parameter.prior for e in two.component.elements}
    plainly_free = set(free) == {"chi", "sigma", "psi"} and not any(free.values())
    if len(two.component.sets) > 1 or not plainly_free:
        return []
    fit = fitted(Request((part.data,), part.model.options).with_options(law="zhou", **PLAIN))[0]
    others = derived_of(fit, 0, 0.95)
    for k, element in enumerate(fit.component.elements):
        others[element.name] = estimate_of(fit, k, None, 0.95)
    by_two_step = {**part.derived, **part.parameters}
    pairs = {name: (others.get(name), by_two_step.get(name)) for name in ("eps_up", "chi")}
    causes = (warnings.disagreement(name, *pair) for name, pair in pairs.items())
    return list(_named("objectives-disagree", causes, part.name))


def _named(code: str, causes: Iterable[str | None], owner: str | None) -> Iterator[FitWarning]:
    return (FitWarning(code, cause, owner) for cause in causes if cause)  # type: ignore[arg-type]


def _owner(fit: ComponentFit, sets: tuple[int, ...]) -> str | None:
    """The data set that something is about; None for several."""
    return fit.component.specs[sets[0]].data.name if len(sets) == 1 else None


def _has_whole(fit: ComponentFit) -> bool:
    return any(spec.model.trees for spec in fit.component.specs)


def _of_component(
    fit: ComponentFit, found: dict[int, Estimate], curves: dict[str, Profile]
) -> list[FitWarning]:
    """Warnings about a component's parameters and searches."""
    elements, found_warnings = fit.component.elements, []
    separation = _separation(fit, curves)
    together: dict[tuple[str, str | None], list[str]] = {}
    for k, element in enumerate(elements):
        if "[" in element.name:  # a number of a network is no parameter that anybody reads
            continue
        name, owner = element.name, _owner(fit, element.sets)
        found_warnings += _at_an_end(name, found[k], owner)
        far = _off_prior(element, float(fit.theta[k]))
        found_warnings += _named("prior-conflict", [far], owner)
        is_open = found[k].method == "undetermined" and found[k].value is not None
        if is_open and not found[k].at_bound and not _is_apart(separation, name, owner):
            together.setdefault(("rank-deficient", owner), []).append(name)
        if found[k].skewed:
            together.setdefault(("skewed", owner), []).append(name)
    for (code, owner), names in together.items():
        named, verb = " and ".join(names), "do" if len(names) > 1 else "does"
        cause = f"the likelihood is skewed in {named}"
        if code == "rank-deficient":
            cause = f"{named} {verb} not show in these data, or only together with another"
        found_warnings.append(FitWarning(code, cause, owner))  # type: ignore[arg-type]
    found_warnings += _collinear(fit, separation)
    for stage in fit.stages:
        name, reason = stage.report.stage, stage.report.reason
        crossed = f"{stage.crossings} points changed between elastic and plastic on the way"
        lone = f"{name}: one search alone ended so low, and it misses the points"
        causes = {
            "not-converged": "" if stage.found.converged[0] else f"{name}: {reason}",
            "branch-change": crossed if stage.crossings else "",
            "several-minima": lone if stage.alone else "",
        }
        for code, cause in causes.items():
            for data in stage.problem.datasets:
                found_warnings += _named(code, [cause], data.name)
        for k, rise in _other_minima(fit, stage).items():
            higher = f"only {rise:.2g} higher" if rise >= 0 else f"{-rise:.2g} lower"
            cause = f"another minimum for {elements[k].name} has a chi squared {higher}"
            found_warnings.append(
                FitWarning("several-minima", cause, _owner(fit, elements[k].sets))
            )
    condition = float(fit.uncertainty.condition_number)
    is_known = any(one.code in OPEN for one in found_warnings + separation)
    if condition > warnings.CONDITION_LIMIT and not (is_known or _has_whole(fit)):
        cause = f"the Jacobian's condition number is {condition:.2g}"
        every = tuple(range(len(fit.component.sets)))
        found_warnings.append(FitWarning("ill-conditioned", cause, _owner(fit, every)))
    return found_warnings + separation


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
    found = {one.material for one in separation if one.code == "sigma-psi-not-separate"}
    return name in ("sigma", "psi") and owner in found


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
    if not fit.is_likelihood or _has_whole(fit):
        return []
    known, points, elements = fit.uncertainty, fit.final.problem.points, fit.component.elements
    covariance = np.where(known.known[:, None] & known.known, known.covariance, 0.0)
    size = np.sqrt(np.where(np.diag(covariance) > 0, np.diag(covariance), np.inf))
    correlation = np.triu(covariance / np.outer(size, size), 1)
    found: dict[str | None, FitWarning] = {}  # one is enough of a data set
    for i, j in np.argwhere(np.abs(correlation) > warnings.COLLINEAR):
        one, other = elements[i], elements[j]
        shared = sorted({*one.sets} & {*other.sets})
        owner = _owner(fit, tuple(shared)) if shared else None
        if not shared or all(_is_apart(separation, e.name, owner) for e in (one, other)):
            continue
        cause = f"{one.name} and {other.name} are correlated by {correlation[i, j]:.5f}"
        measured = np.flatnonzero((points.set == shared[0]) & (points.observable == 0))
        if len(measured):
            middle = _in_the_middle(fit, measured)
            cause += f"; the data determine ε in their middle, {middle}"
        found.setdefault(owner, FitWarning("collinear", cause, owner))
    return list(found.values())


def _in_the_middle(fit: ComponentFit, points: np.ndarray) -> str:
    """ε of the curve at the middle of some points, with its standard error."""
    problem, known = fit.final.problem, fit.uncertainty
    velocity = problem.points.velocity[points]
    middle = points[np.argmin(np.abs(np.log(velocity / np.median(velocity))))]
    found = problem.bare.linearise(fit.z[None])
    own = known.of_predictions[np.ix_(problem.active, problem.active)]
    error = float(np.sqrt(max(found.per[0, middle] @ own @ found.per[0, middle], 0.0)))
    middle_text = with_error(float(found.prediction[0, middle]), error)
    return f"{middle_text} at {problem.points.velocity[middle]:.3g} m/s"


def _separation(fit: ComponentFit, curves: dict[str, Profile]) -> list[FitWarning]:
    """σ and ψ of Zhou's law that only their combination ε_up is known of; ε_up in their place."""
    found = []
    for g, spec in enumerate(fit.component.specs):
        if spec.model.law_type is not sj.Zhou or spec.objective != "model":
            continue
        if spec.by_eps_up:
            cause = "no points below the critical velocity: sigma and psi act through eps_up alone"
            found.append(FitWarning("eps-up-only", cause, spec.data.name))
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
            found.append(FitWarning("sigma-psi-not-separate", cause, spec.data.name))
    return found


def _other_minima(fit: ComponentFit, stage: StageFit) -> dict[int, float]:
    """Elements with another value at another minimum that is nearly as good, and how much higher χ² is there."""
    problem, found = stage.problem, {}

    def cost(*places: np.ndarray) -> np.ndarray:
        """Of the points, each on its branch there, and of the priors."""
        z = np.array(places)
        return problem.linearise(z, Lanes(elastic=problem.elastic_at(z)), slopes=False).cost

    for other in stage.others:
        # at an end of a range is none: a valley without an end has no second minimum
        if not other.converged[0] or np.any(stage.limits) or np.any(other.limits):
            continue
        way = other.z[0] - stage.z
        moved = [k for k in problem.active if abs(way[k]) > MOVED and fit.uncertainty.known[k]]
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
                found |= {int(k): rise for k in moved if k not in found}
    return found


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
    found = [*_named("data", (note for note in data.notes if "above 1" in note), name)]
    for one in plausibility(data):  # about yield only if the law yields
        if ever_yields or one.code != "yield-beyond-limit":
            code = "groups" if one.code == "groups" else "plausibility"
            found.append(FitWarning(code, one.cause, name, one.advice))
    misfit, runs = None, warnings.runs(velocity, np.where(is_off, standardised, 0.0))
    if errors.is_stated and part.reduced_chi_squared is not None:
        of_noise = None if data.degrees is None else float(np.mean(data.degrees))
        misfit = warnings.misfit(part.reduced_chi_squared, left, of_noise)
    elif part.objective == "two-step" and part.rms_empirical is not None:
        misfit = warnings.misfit_against_scatter(part.n, part.rms, left, part.rms_empirical)
    causes = {"model-misfit": misfit, "residual-runs": runs}
    if np.any(is_off) and not (found or misfit or runs):
        # where the curve misses the points neither says anything of the errors
        curve = restitution + residual
        alike = None if errors.shares else warnings.alike_neighbours(velocity, standardised)
        causes["unequal-scatter"] = warnings.unequal_scatter(velocity, curve, standardised)
        causes["groups"] = alike
    stated = errors.points.uncertainty if errors.is_stated else None
    kink, uncertain = yields if ever_yields else np.nan, data.velocity_uncertainty
    noise = errors.family({"dof": part.noise_dof})
    level = warnings.no_velocity_dependence(velocity, restitution, stated, noise)
    causes["no-velocity-dependence"] = level
    causes["velocity-errors"] = warnings.velocity_errors(data.velocity, uncertain, kink)
    for code, cause in causes.items():
        advice = LAW_OR_GROUPS if code == "residual-runs" and errors.shares else ""
        found += [FitWarning(code, cause, name, advice)] if cause else []
    found += _named("status", warnings.statuses(part.status, velocity), name)
    below = "all velocities are below the critical velocity" if part.known_to < np.inf else None
    return [*found, *_named("all-below-yield", [below], name)]


def _offsets(fit: ComponentFit, part: MaterialFit, residual) -> Iterator[str | None]:
    """Whether a group is far from the others, or the set from the curve that others determine too."""
    offsets, deviation = part.group_offsets, part.group_deviation or 0.0
    yield warnings.far_group(offsets, deviation)
    if len(fit.component.sets) > 1:
        standard = warnings.standard_offsets(offsets, deviation) if offsets else part.standardised
        yield warnings.off_as_a_whole(np.array(standard), float(np.mean(residual)))


def _of_observable(
    part: MaterialFit, observable: str, one: Goodness, errors: Errors
) -> Iterator[FitWarning]:
    """Whether the curve misses what else than ε was measured."""
    words, reduced = OBSERVABLES[observable].words, one.reduced_chi_squared
    misses = warnings.misfit(reduced, one.residual_degrees) if errors.is_stated else None
    trend = warnings.runs(errors.velocity, np.array(one.standardised))
    for code, cause in (("model-misfit", misses), ("residual-runs", trend)):
        yield from _named(code, [cause and f"{words}: {cause}"], part.name)
    if one.rms > MOST_OFF:  # an estimated scatter takes a wrong unit or size as it is
        cause = f"{words}: the law misses the values by {100 * one.rms:.3g} % (rms)"
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
