"""Which warnings a fit raises.

Functions yield codes of `calibration.fitting.warnings.ADVICE` with their causes in words, None where there is
none, and with advice of their own where that of the code does not fit.

Another end of a search counts as another minimum where a value is outside its interval."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import jax
import numpy as np
from jaxtyping import Float
from scipy import special

import softjax as sj
from calibration.data import plausibility
from calibration.fitting.errors import Errors
from calibration.fitting.material import Estimate, Goodness, MaterialFit
from calibration.fitting.noise import Family
from calibration.fitting.problem import DRAG, Batch
from calibration.fitting.profiles import Profile, weighted_deviation
from calibration.fitting.search import Ends
from calibration.fitting.stages import MOVED, ComponentFit, StageFit
from calibration.fitting.warnings import CONFIDENCE, OTHER_LAWS, FitWarning, runs
from calibration.observables import OBSERVABLES, RESTITUTION
from calibration.rounding import number, with_error

COLLINEAR = 0.99  # correlation from which on two parameters count as one number
SEPARATE = 1.0  # standard error of ln σ from which on σ and ψ count as one number
STILL_FALLS = 1e-5  # of -2 ln L with a factor of e on a parameter: less is level
AS_GOOD = 1e-3  # difference of -2 ln L that is none to a reader
SEVERAL_DELTA = 4.0  # Δχ² below which another minimum is nearly as good
VELOCITY_ERRORS = 0.15  # of a velocity, up to which intervals were seen to be right
NEAR_JUMP = 0.02  # of the critical velocity, within which a point may be on either side
SHARE_OF_NOISE = 1 / 3  # from which on a jump of ε is one to speak of
BESIDE = 1e-9  # of the critical velocity, on both sides of which ε is compared
MOST_NAMED = 8
NEAR_YIELD = 2.0  # standard uncertainties of a velocity around the kink at first yield
BLOCK, FEW = 16, 1024  # impacts in the smallest compiled program; up to so many it computes all
LARGE_OVERLAP = 0.1  # of the effective radius: no small contact
FEWEST_GROUPS = 4  # of which one may be far from the others
FEWEST_POINTS = 10  # that show a trend
FAR_FROM_STATED = 3.0  # times a stated uncertainty
LINE_ROUNDS = 50  # of a straight line and the weights of its points in turn
FROM_PRIOR = 3.0  # of its standard deviations, beyond which an estimate contradicts a prior
NO_RESIDUAL = 1e-12  # of ε
MOST_OFF = 0.5  # rms of an observable other than ε, in parts of its values
LEAST_NOISE = 1e-10  # of ε: less is no noise
NOISELESS = 1e-9  # rms of ε about Eq. (17) below which data are a curve and no measurement
MISSES = f"The law misses a trend ({OTHER_LAWS})."
CURVE = f"The data are a curve without noise: the law misses it ({OTHER_LAWS})."
LAW_OR_GROUPS = (
    f"The law misses a trend ({OTHER_LAWS}), or other points belong together than those of the "
    "groups."
)
AT_ONE = (
    "The data show no loss but the plastic one: eps_up cannot exceed 1; its interval is one-sided."
)
STEEPEST = (
    "Of the points that it acts on only the fastest show a loss; its interval is one-sided. State a "
    "highest value as its bound to have it searched further."
)
OF_UNITS = "Check the unit and the bodies; of dents, which diameter was measured (`dent`)."
Column = Float[np.ndarray, "n"]
Found = Iterator[tuple[str, str | None] | tuple[str, str | None, str]]  # code, cause, advice


def raised(owner: str | None, found: Iterable[tuple[str | None, ...]]) -> list[FitWarning]:
    """A warning about a data set (None: about several) for each cause."""
    return [FitWarning(code, cause, owner, *own) for code, cause, *own in found if cause]  # type: ignore[arg-type]


def _owner(fit: ComponentFit, sets: tuple[int, ...]) -> str | None:
    """The data set that something is about; None for several."""
    return fit.component.specs[sets[0]].data.name if len(sets) == 1 else None


def of_component(fit: ComponentFit, by_element: dict[int, Estimate], curves: dict[str, Profile]):
    """Warnings about a component's parameters and searches."""
    separation, found = _separation(fit, curves), []
    open_names: dict[str | None, list[str]] = {}
    skewed_names: dict[str | None, list[str]] = {}
    for k, element in enumerate(fit.component.elements):
        if "[" in element.name:  # a number of a network is no parameter that anybody reads
            continue
        owner, estimate = _owner(fit, element.sets), by_element[k]
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
    found += _collinear(fit, separation)
    for stage in fit.stages:
        for data in stage.problem.datasets:
            found += raised(data.name, _of_search(stage))
        for rise, values in _other_minima(fit, stage, by_element):
            there, here = (
                ", ".join(f"{fit.component.elements[k].label} = {at[k]:.4g}" for k in values)
                for at in (values, fit.theta)
            )
            far = f"is {abs(rise):.2g} {'higher' if rise >= 0 else 'lower'}"
            far = far if abs(rise) > AS_GOOD else "is the same"
            cause = f"another minimum, where -2 ln L {far}: {there}; intervals are of {here} alone"
            sets = {s for k in values for s in fit.component.elements[k].sets}
            found.append(FitWarning("several-minima", cause, _owner(fit, tuple(sets))))
    return found + separation


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


def _of_search(stage: StageFit) -> Found:
    name = stage.report.stage
    if not stage.ends.converged[0]:
        yield "not-converged", f"{name}: {stage.report.reason}"
    if stage.single_search:
        lone = f"{name}: one search alone ended so low, and it misses the points"
        yield "several-minima", lone


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
        owner = _owner(fit, tuple(shared)) if shared else None
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


def _other_minima(fit: ComponentFit, stage: StageFit, estimates: Mapping[int, Estimate]):
    """Ends of other searches nearly as good, with a value outside its interval: how much higher -2 ln L is, and values.

    An end where a parameter grows without bound is none: a valley without an end has no second minimum.
    """
    problem = stage.problem
    bounds = problem.transform.part(problem.active)

    def runs_away(end: Ends) -> bool:
        bound_side = end.bound_side[0]
        return bool(np.any((bound_side != 0) & ~np.isfinite(bounds.bound_beyond(bound_side))))

    def is_outside(k: int, value: float) -> bool:
        low, high = estimates[k].low, estimates[k].high
        return (low is not None and value < low) or (high is not None and value > high)

    ends = [end for end in stage.others if end.converged[0] and not runs_away(end)]
    if not ends or runs_away(stage.ends):
        return
    cost = problem.linearise(np.stack([stage.z, *(end.z[0] for end in ends)]), slopes=False).cost
    spread = weighted_deviation(fit, problem, LEAST_NOISE)
    rises = 2 * (cost[1:] - cost[0]) / np.mean(spread**2)
    for end, rise in zip(ends, rises, strict=True):
        theta = problem.transform.physical(end.z[0])
        differs = fit.uncertainty.known & (np.abs(end.z[0] - stage.z) > MOVED)
        moved = {int(k): float(theta[k]) for k in problem.active if differs[k]}
        if rise < SEVERAL_DELTA and any(is_outside(k, value) for k, value in moved.items()):
            yield float(rise), moved


def of_set(fit: ComponentFit, part: MaterialFit, residual, errors: Mapping[str, Errors]):
    """Warnings about one data set's points.

    Args:
        residual: fitted less measured ε.
        errors: of the points of each observable.
    """
    found: list[FitWarning] = []
    if RESTITUTION in errors:
        found += _of_restitution(part, residual, errors[RESTITUTION])
        found += raised(part.name, [("yield-jump", _beside_jump(fit, part))])
    found += raised(part.name, _of_levels(fit, part, residual))
    for name, goodness in part.observed.items():
        words = OBSERVABLES[name].words
        causes = _of_residuals(part, goodness, errors[name], np.array(goodness.standardised))
        found += raised(
            part.name, ((c, why and f"{words}: {why}", *own) for c, why, *own in causes)
        )
        if goodness.rms > MOST_OFF:  # an estimated scatter takes a wrong unit or size as it is
            cause = f"{words}: the law misses the values by {100 * goodness.rms:.3g} % (rms)"
            found.append(FitWarning("plausibility", cause, part.name, OF_UNITS))
    return found


def _beside_jump(fit: ComponentFit, part: MaterialFit) -> str | None:
    """Points so near to first yield that they decide where it is, as ε jumps there and yield moves in the fit."""
    problem = fit.final.problem
    g = [spec.data.name for spec in fit.component.specs].index(part.name)
    yield_elements = () if problem.affects_yield is None else np.flatnonzero(problem.affects_yield)
    if not any(g in fit.component.elements[k].sets for k in yield_elements):
        return None
    critical, velocity = problem.yields_at(fit.z), problem.points.velocity
    assert critical is not None
    sides = Batch(velocity=critical * (1 + BESIDE * np.array([[-1.0], [1.0]])))
    below, above = problem.bare.linearise(np.tile(fit.z, (2, 1)), sides, False).prediction
    is_big = np.abs(above - below) > SHARE_OF_NOISE * fit.uncertainty.deviation
    is_eps = (problem.points.set == g) & (problem.points.observable == 0)
    near = np.flatnonzero(is_eps & is_big & (np.abs(velocity / critical - 1) <= NEAR_JUMP))
    if not len(near):
        return None
    data, rows = part.data, np.flatnonzero(np.isfinite(part.data.restitution))
    first = int(np.flatnonzero(is_eps)[0])
    lines = () if data.origin is None else data.origin.lines
    named = []
    for row in rows[near - first]:
        place = f"line {lines[row]}" if row < len(lines) else f"row {row + 1}"
        named.append(f"{place} at {data.velocity[row]:.4g} m/s")
    jump = float(np.max(np.abs(above - below)[near]))
    where = f"within {100 * NEAR_JUMP:g} % of the critical velocity, where ε jumps by {jump:.2g}"
    more = f" and {len(named) - MOST_NAMED} more" if len(named) > MOST_NAMED else ""
    return f"{', '.join(named[:MOST_NAMED])}{more}: {where}"


def _overlap(part: MaterialFit) -> str | None:
    """Overlaps of more than a tenth of the effective radius; not by laws whose stiffness is a guess.

    Computed only where Hertz's overlap, or that of a pressure Y, comes near: δ = (15 M v²/16 E √R)^{2/5}
    and v √(M/(2π R Y)).
    """
    contact, v = part.contact, part.data.velocity
    if contact is None or isinstance(
        part.law, sj.HardSphereLaw | sj.WaltonBraun | sj.LinearSpringDashpot
    ):
        return None
    modulus, radius, mass, strength = (
        np.asarray(getattr(contact, n))
        for n in ("youngs_modulus", "radius", "mass", "yield_strength")
    )
    elastic = (15 * mass * v**2 / (16 * modulus * radius**0.5)) ** 0.4
    plastic = v * np.sqrt(mass / (2 * np.pi * radius * strength))
    if np.max(np.maximum(elastic, plastic) / radius) < 0.5 * LARGE_OVERLAP:
        return None
    share = _peak_overlap(part.law, v) / radius
    if not np.any(share > LARGE_OVERLAP):
        return None
    first = float(np.min(v[share > LARGE_OVERLAP]))
    most = f"up to {100 * np.nanmax(share):.2g} % of the effective radius"
    return f"the overlap is {most}, beyond {100 * LARGE_OVERLAP:g} % from {first:.3g} m/s on"


def _peak_overlap(law: sj.ContactLaw, velocity: Column) -> Column:
    """δ_max of each impact; in blocks, so that data sets of any length share a compiled program."""
    if len(velocity) > FEW or any(np.ndim(leaf) for leaf in jax.tree.leaves(law)):
        return np.asarray(sj.restitution(law, velocity).peak_overlap)
    blocks = np.array_split(velocity, range(BLOCK, len(velocity), BLOCK))
    return np.concatenate([np.asarray(sj.restitution(law, v).peak_overlap) for v in blocks])


def _of_restitution(part: MaterialFit, residual, errors: Errors) -> list[FitWarning]:
    """Warnings about one data set's ε."""
    data, name, velocity = part.data, part.name, errors.velocity
    restitution = data.restitution[np.isfinite(data.restitution)]
    standardised, is_off = np.array(part.standardised), np.abs(residual) > NO_RESIDUAL
    yields = part.law.elastic_velocity() if isinstance(part.law, sj.RateIndependentLaw) else np.nan
    yields = np.asarray(yields, float)
    ever_yields = bool(np.any((yields > 0) & (yields < np.inf)))
    found = raised(name, (("data", note) for note in data.notes if "above 1" in note))
    found += raised(name, (("track", track.smoothed or None) for track in data.tracks))
    for implausible in plausibility(data):  # about yield only if the law yields
        if ever_yields or implausible.code != "yield-beyond-limit":
            code = "groups" if implausible.code == "groups" else "plausibility"
            found.append(FitWarning(code, implausible.cause, name, implausible.advice))
    of_curve = raised(name, _of_residuals(part, part, errors, np.where(is_off, standardised, 0.0)))
    missed = {warning.code for warning in of_curve} & {"model-misfit", "residual-runs"}
    if np.any(is_off) and not (found or missed):
        # where the curve misses the points neither says anything of the errors
        unequal = _unequal_scatter(velocity, restitution + residual, standardised)
        alike = None if errors.shares else _alike_neighbours(velocity, standardised)
        of_curve += raised(name, [("unequal-scatter", unequal), ("groups", alike)])
    level = _no_velocity_dependence(errors, restitution, part.family)
    kink = yields if ever_yields else np.nan
    below = "all velocities are below the critical velocity" if part.known_to < np.inf else None
    last = (
        ("no-velocity-dependence", level),
        ("velocity-errors", _velocity_errors(data.velocity, data.velocity_uncertainty, kink)),
        *(("status", cause) for cause in _statuses(part.status, velocity)),
        ("all-below-yield", below),
        ("overlap", _overlap(part)),
    )
    return [*found, *of_curve, *raised(name, last)]


def _of_residuals(part: MaterialFit, goodness: Goodness, errors: Errors, standardised) -> Found:
    """Whether noise explains how far the points of an observable are from the curve."""
    misfit, of_curve, has_intervals = None, False, part.objective == "model"
    advice = (LAW_OR_GROUPS if errors.shares else "") if has_intervals else MISSES
    if errors.is_stated:
        misfit = _misfit(goodness, errors.degrees)
    elif not has_intervals and part.rms_empirical is not None:
        misfit = _misfit_about_eq_17(part, part.rms_empirical)
        of_curve = part.rms_empirical < NOISELESS
    far = None if misfit else _far_from_stated(goodness, errors)
    if errors.is_stated and not far:
        misfit = misfit or _misfit_of_family(goodness, errors.degrees)
    yield "model-misfit", misfit, CURVE if of_curve else "" if has_intervals else MISSES
    yield "stated-uncertainty", far
    if not of_curve:
        yield "residual-runs", runs(errors.velocity, standardised), advice


def _misfit(goodness: Goodness, of_noise: float | None) -> str | None:
    """χ² of the residuals larger than noise makes it once in a hundred.

    Args:
        of_noise: degrees of freedom of the noise itself, None where it is stated.
    """
    reduced, degrees = goodness.reduced_chi_squared, goodness.residual_degrees
    if reduced is None or degrees < 1 or not np.isfinite(reduced):
        return None
    limit = special.chdtri(degrees, 1 - CONFIDENCE) / degrees
    if of_noise is not None:
        limit = special.fdtri(degrees, of_noise, CONFIDENCE)
    if reduced <= limit:
        return None
    # of points that count unequally rms and noise are no measure of it
    size = f"residuals of {number(reduced**0.5, 3)} times the noise"
    return f"{size} (reduced chi squared {number(reduced, 3)})"


def _misfit_of_family(goodness: Goodness, of_noise: float | None) -> str | None:
    """Misfit by errors that have no χ²: by the normal numbers that are as rare as the residuals.

    An outlier counts as much as one at the limit: heavy tails are there to bear a few, however far.
    """
    family, degrees = goodness.family, goodness.residual_degrees
    if family.is_least_squares or degrees < 1:
        return None
    # each has the variance 1: as many degrees of freedom as the fit leaves
    white = np.array(goodness.standardised)
    limit = family.farthest(len(white))
    reduced = float(np.mean(family.normal_of(np.clip(white, -limit, limit)) ** 2))
    probability = float(special.chdtrc(degrees, reduced * degrees))
    if of_noise is not None:
        probability = float(special.fdtrc(degrees, of_noise, reduced))
    if not probability < 1 - CONFIDENCE:
        return None
    size = "less than 1e-12" if probability < 1e-12 else f"{probability:.1g}"
    return f"{family.words} as stated give residuals as large with a probability of {size}"


def _misfit_about_eq_17(part: MaterialFit, about_eq_17: float) -> str | None:
    """Misfit where the noise is estimated from the scatter about Eq. (17): an F test.

    Scatter at rounding level is no noise estimate, but then a larger rms is a misfit all the same.
    """
    degrees, of_noise = max(part.residual_degrees, 1), max(part.n - 2, 1)
    ratio = (part.rms / max(about_eq_17, 1e-16)) ** 2 * of_noise / degrees
    if ratio <= special.fdtri(degrees, of_noise, CONFIDENCE) or part.rms < NOISELESS:
        return None
    exact = about_eq_17 < NOISELESS
    of_eq_17 = (
        "the data follow Eq. (17) exactly" if exact else f"that of Eq. (17) is {about_eq_17:.3g}"
    )
    return f"rms {part.rms:.4g} where {of_eq_17}"


def _far_from_stated(goodness: Goodness, errors: Errors) -> str | None:
    """Residuals far larger than the stated uncertainties, or far smaller: by what is estimated, or their median."""
    if errors.points.uncertainty is None:  # only an error of the velocity is
        return None
    variances, size = goodness.variances, np.abs(goodness.standardised)
    stated = variances.get("stated", variances.get("repeats", 0.0))
    if "scale" in errors.unknown:
        of_stated = float(np.mean(errors.points.uncertainty**2))
        ratio = (goodness.reduced_chi_squared or variances.get("scale", 0.0) / of_stated) ** 0.5
    elif stated <= 0 or errors.points.measured_by.is_precise:
        return None
    elif variances.get("scatter"):
        ratio = (1 + variances["scatter"] / stated) ** 0.5
    else:
        ratio = float(np.median(size) / goodness.family.quantile(0.75))
    few = len(size) < FEWEST_POINTS
    if ratio > FAR_FROM_STATED or (ratio < 1 / FAR_FROM_STATED and not few):
        return f"the points scatter by {ratio:.2g} times what was stated"
    return None


def _unequal_scatter(velocity: Column, restitution: Column, standardised: Column) -> str | None:
    """The size of the residuals goes with the velocity, or with ε: Spearman's rank correlation."""
    size = np.abs(standardised)
    if len(size) < FEWEST_POINTS or np.ptp(size) < 1e-9:
        return None
    for name, values in (("velocity", velocity), ("restitution", restitution)):
        if np.ptp(values) == 0:
            continue
        correlation = np.corrcoef(_ranks(values), _ranks(size))[0, 1]
        t = abs(correlation) * np.sqrt((len(size) - 2) / max(1 - correlation**2, 1e-300))
        if special.stdtr(len(size) - 2, -t) < 0.25 * (1 - CONFIDENCE):  # of two that are looked at
            verb = "grow" if correlation > 0 else "shrink"
            return f"the residuals {verb} with the {name} (rank correlation {correlation:.2f})"
    return None


def _ranks(values: Column) -> Column:
    """Ranks of values; equal values share the mean of theirs; `scipy.stats` takes half a second to import."""
    _, place, count = np.unique(values, return_inverse=True, return_counts=True)
    return (np.cumsum(count) - 0.5 * (count - 1))[place]


def _alike_neighbours(velocity: Column, standardised: Column) -> str | None:
    """Residuals of neighbouring rows go together, in a file that is not in the order of velocity."""
    n, steps = len(standardised), np.diff(velocity)
    squares = float(np.sum(standardised**2))
    if n < FEWEST_POINTS or np.all(steps >= 0) or np.all(steps <= 0) or squares < 1e-18:
        return None
    correlation = float(np.sum(standardised[1:] * standardised[:-1])) / squares
    if correlation * np.sqrt(n) < special.ndtri(CONFIDENCE):
        return None
    return f"residuals of neighbouring rows are alike (correlation {correlation:.2f})"


def _of_levels(fit: ComponentFit, part: MaterialFit, residual) -> Found:
    """Whether the law misses the level of groups, one is far from the others, or the set from a common curve.

    Student's test of the mean of the groups' predicted offsets, Grubbs' of the farthest one; without groups
    Student's of the residuals, where other sets determine the curve too. Offsets are over the standard
    deviations that they have as predictions.

    Source: Grubbs, Ann. Math. Stat. 21, 27 (1950).
    """
    blocks = enumerate(fit.stages[0].problem.blocks)
    of_set = [(k, b) for k, b in blocks if fit.component.specs[b.set].data.name == part.name]
    for k, block in of_set:
        level = fit.offsets[k].missed_level if k in fit.offsets else None
        if level is not None:
            missed = f"by {level:+.2g}"
            if block.observable != RESTITUTION:
                missed = f"in {OBSERVABLES[block.observable].words} by {100 * level:+.2g} %"
            side = "above" if level > 0 else "below"
            cause = f"the law misses the level of the groups {missed}: as a whole they are {side} the curve"
            yield "level", cause
    first = next((k for k, block in of_set if block.observable == RESTITUTION), None)
    if part.group_offsets and first in fit.offsets:
        # in the order of `group_offsets`
        value, _, standard = fit.offsets[first]
        order = np.argsort(-np.abs(value), kind="stable")
        value, standard = value[order], standard[order]
        m = len(standard)
        if m < FEWEST_GROUPS or not np.all(np.isfinite(standard)):
            return
        k = int(np.argmax(np.abs(standard - np.mean(standard))))
        others = np.delete(standard, k)
        spread = np.std(others, ddof=1) * np.sqrt(1 + 1 / (m - 1))
        far = abs(standard[k] - np.mean(others)) / max(spread, 1e-300)
        if far > special.stdtrit(m - 2, 1 - 0.5 * (1 - CONFIDENCE) / m):
            cause = f"group {[*part.group_offsets][k]} is off by {value[k]:.2g}"
            yield "offset", f"{cause}, {far:.2g} times the scatter of the other groups"
        return
    standard, several = np.array(part.standardised), len(fit.component.sets) > 1
    n = len(standard)
    if several and n >= FEWEST_GROUPS and np.ptp(standard) > 0:
        far = abs(np.mean(standard)) / np.std(standard, ddof=1) * np.sqrt(n)
        if far > special.stdtrit(n - 1, 1 - 0.5 * (1 - CONFIDENCE)):
            mean = float(np.mean(residual))
            where = f"{'below' if mean > 0 else 'above'} the curve as a whole"
            yield "offset", f"its points lie {where}, by {abs(mean):.2g} on the average"


def _no_velocity_dependence(errors: Errors, restitution: Column, noise: Family) -> str | None:
    """A straight line's slope is zero within its 95 % interval, by the noise of the fit.

    Scatter that is not stated is estimated about the line, in turn with the weights of the points.
    """
    velocity, stated = errors.velocity, errors.points.uncertainty if errors.is_stated else None
    if np.ptp(velocity) == 0:
        return f"all points have one velocity, {velocity[0]:.4g} m/s"
    residual_dof, unit = len(velocity) - 2, np.ones(len(velocity)) if stated is None else stated
    design = np.stack([np.ones(len(velocity)), velocity - np.mean(velocity)], 1)
    white, target = design / unit[:, None], restitution / unit
    weight, scale = np.ones(len(velocity)), 1.0
    for _ in range(LINE_ROUNDS):
        line = np.linalg.pinv(white * weight[:, None] ** 0.5) @ (target * weight**0.5)
        residual = target - white @ line
        if stated is None:
            scale = (
                float(np.sum(weight * residual**2) / residual_dof) ** 0.5
                if residual_dof > 0
                else np.inf
            )
        weight, before = noise.weight(residual / max(scale, 1e-300)), weight
        if np.array_equal(weight, before):
            break
    error = scale * float(np.linalg.inv(white.T @ white * noise.information)[1, 1]) ** 0.5
    slope, quantile = float(line[1]), float(special.ndtri(0.975))
    if stated is None and residual_dof > 0:
        quantile = float(special.stdtrit(residual_dof, 0.975))
    if abs(slope) > quantile * error or (error == 0 and abs(slope) * np.ptp(velocity) > 1e-9):
        return None
    if error == np.inf:
        return (
            f"the slope of restitution is {slope:.2g} per m/s, and two points do not tell its error"
        )
    return f"the slope of restitution is {slope:.2g} ± {error:.2g} per m/s, 0 within its error"


def _velocity_errors(velocity: Column, uncertainty: Any, yields: Any) -> str | None:
    """Errors of velocities that their treatment to second order does not carry.

    Args:
        yields: the velocity of first yield [m/s], where the curve has a kink; NaN without one.
    """
    if uncertainty is None:
        return None
    most = float(np.max(np.asarray(uncertainty) / velocity))
    near = int(np.sum(np.abs(velocity - yields) < NEAR_YIELD * np.asarray(uncertainty)))
    causes = []
    if most > VELOCITY_ERRORS:
        causes.append(f"velocities are uncertain by up to {100 * most:.2g} %")
    if near:
        causes.append(
            f"{near} of {len(velocity)} points are nearer to first yield than {NEAR_YIELD:g} "
            "standard uncertainties of their velocity"
        )
    return "; ".join(causes) or None


def _statuses(status: Any, velocity: Column) -> Iterator[str]:
    """Each flag that is raised at data points, other than elastic."""
    for flag in sj.Status:
        at = velocity[(np.asarray(status, int) & int(flag)) != 0]
        if sj.Status.is_ok(int(flag)) or not len(at):
            continue
        span = f"{np.min(at):.3g} to {np.max(at):.3g} m/s" if len(at) > 1 else f"{at[0]:.3g} m/s"
        yield f"{flag.name} at {len(at)} of {len(status)} points ({span})"
