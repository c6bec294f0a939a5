"""Whether the data determine each parameter: bounds, priors, pairs that show only together."""

import numpy as np

import softjax as sj
from calibration.fitting.components import ComponentFit
from calibration.fitting.elements import DRAG
from calibration.fitting.material import Estimate
from calibration.fitting.profiles import Profile, weighted_deviation
from calibration.fitting.warnings import FitWarning, Found, raised
from calibration.rounding import number, with_error

COLLINEAR = 0.99  # correlation from which on two parameters count as one number
SEPARATE = 1.0  # standard error of ln σ from which on σ and ψ count as one number
STILL_FALLS = 1e-5  # of -2 ln L with a factor of e on a parameter: less is level
FROM_PRIOR = 3.0  # of its standard deviations, beyond which an estimate contradicts a prior
LEAST_NOISE = 1e-10  # of ε: less is no noise
AT_ONE = (
    "The data show no loss but the plastic one: eps_up cannot exceed 1; its interval is one-sided."
)
STEEPEST = (
    "Of the points that it acts on only the fastest show a loss; its interval is one-sided. State a "
    "highest value as its bound to have it searched further."
)


def of_parameters(
    fit: ComponentFit, by_element: dict[int, Estimate], curves: dict[str, Profile]
) -> list[FitWarning]:
    """Warnings about the parameters of a component."""
    separation, found = _separation(fit, curves), []
    open_names: dict[str | None, list[str]] = {}
    skewed_names: dict[str | None, list[str]] = {}
    for k, element in enumerate(fit.component.elements):
        if "[" in element.name:  # a number of a network is no parameter that anybody reads
            continue
        owner, estimate = fit.owner(element.sets), by_element[k]
        found += raised(owner, _of_element(fit, k, estimate))
        is_open = estimate.method == "undetermined" and estimate.value is not None
        if is_open and not estimate.at_bound and not _is_apart(separation, element.name, owner):
            open_names.setdefault(owner, []).append(element.name)
        if estimate.skewed:
            skewed_names.setdefault(owner, []).append(element.name)
    for owner, names in open_names.items():
        text = " and ".join(names) + (" do" if len(names) > 1 else " does")
        cause = f"{text} not show in these data, or only together with another"
        found.append(FitWarning("rank-deficient", cause, owner))
    for owner, names in skewed_names.items():
        cause = f"the likelihood is skewed in {' and '.join(names)}"
        found.append(FitWarning("skewed", cause, owner))
    return [*found, *_collinear(fit, separation), *separation]


def _slope(fit: ComponentFit, k: int) -> float:
    """Fall of -2 ln L if a parameter grows by a factor of e, the others at their best."""
    problem = fit.final.problem
    if k not in problem.active:
        return 0.0
    gradient = problem.linearise(fit.z[None]).gradient[0, problem.active.tolist().index(k)]
    return float(abs(2 * gradient) / np.mean(weighted_deviation(fit, problem, LEAST_NOISE) ** 2))


def _of_element(fit: ComponentFit, k: int, estimate: Estimate) -> Found:
    element, value = fit.component.elements[k], float(fit.theta[k])
    name = element.name
    if estimate.value is None:
        # the cost falls, ever less, however large the parameter gets
        as_good, slope = "any large value is as good", _slope(fit, k)
        if slope > STILL_FALLS:
            as_good = (
                f"the search ends at {value:.1g}, where -2 ln L still falls by {slope:.2g} with a factor of "
                "e; the other parameters are those of this value"
            )
        yield "at-bound", f"{name} grows without bound: {as_good}"
    elif estimate.at_bound:
        # no bound that somebody gave: ε_17 is 1 at most
        advice = AT_ONE if name == "eps_up" and estimate.value == 1 else ""
        advice = _of_drag(fit) if name == DRAG else advice
        cause = f"{name} is at its bound {estimate.value:.4g}"
        if estimate.value == element.end:
            cause = (
                f"{name} is at the end of its range, {element.end:.4g}: -2 ln L would fall by "
                f"{_slope(fit, k):.2g} with a factor of e on it"
            )
            advice = STEEPEST
        yield "at-bound", cause, advice
    mean, deviation = element.parameter.prior or (0.0, np.inf)
    distance = abs(value - mean) / deviation
    if distance > FROM_PRIOR:
        text = f"{name} is {value:.3g}, {distance:.2g} standard deviations from its prior"
        yield "prior-conflict", f"{text} {mean:.3g} ± {deviation:.2g}"


def _of_drag(fit: ComponentFit) -> str:
    """Advice where flights lose less than by buoyancy alone."""
    heights = []
    for data in fit.stages[0].problem.datasets:
        if data.fall is not None:
            ends = data.fall.height(np.array([np.min(data.velocity), np.max(data.velocity)]))
            low, high = (number(float(end), 3) for end in ends)
            heights.append(f"drops of {low} to {high} {data.fall.unit}?")
    which = f" ({heights[0]})" if heights else ""
    return f"A drag coefficient is not negative: check the unit of the heights{which}, size and mass of the ball."


def _is_apart(separation: list[FitWarning], name: str, owner: str | None) -> bool:
    """Whether a warning of σ and ψ, which are not separate, is about it."""
    owners = {w.material for w in separation if w.code == "sigma-psi-not-separate"}
    return name in ("sigma", "psi") and owner in owners


def _collinear(fit: ComponentFit, separation: list[FitWarning]) -> list[FitWarning]:
    """Two parameters of a likelihood that are determined together only, and what of them is known."""
    if not fit.is_likelihood or any(spec.model.trees for spec in fit.component.specs):
        return []
    known, points, elements = fit.uncertainty, fit.final.problem.points, fit.component.elements
    covariance = np.where(known.known[:, None] & known.known, known.covariance, 0.0)
    size = np.sqrt(np.where(np.diag(covariance) > 0, np.diag(covariance), np.inf))
    correlation = np.triu(covariance / np.outer(size, size), 1)
    by_owner: dict[str | None, FitWarning] = {}  # one is enough of a data set
    for i, j in np.argwhere(np.abs(correlation) > COLLINEAR):
        first, second = elements[i], elements[j]
        shared = sorted({*first.sets} & {*second.sets})
        owner = fit.owner(tuple(shared)) if shared else None
        if not shared or all(_is_apart(separation, e.name, owner) for e in (first, second)):
            continue
        cause = f"{first.name} and {second.name} are correlated by {correlation[i, j]:.5f}"
        measured = np.flatnonzero((points.set == shared[0]) & (points.observable == 0))
        if len(measured):
            middle = _in_the_middle(fit, measured)
            cause += f"; ε itself is well determined, {middle}"
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
        ends = [(curves[n].low or 0.0, curves[n].high or np.inf) for n in labels if n in curves]
        # open on a side, or as wide as 4 standard errors
        is_wide = any(low <= 0 or np.log(high / low) > 4 * SEPARATE for low, high in ends)
        if is_wide or not np.max(errors) <= SEPARATE:
            cause = f"the standard error of ln sigma is {errors[0]:.2g}"
            if not np.isfinite(errors[0]):
                cause = "only one combination of sigma and psi shows"
            found.append(FitWarning("sigma-psi-not-separate", cause, spec.data.name))
    return found
