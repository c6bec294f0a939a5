"""All warnings of a component and of one data set."""

import itertools
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

import softjax as sj
from calibration.data import plausibility
from calibration.fitting.checks.impacts import (
    beside_jump,
    no_velocity_dependence,
    overlap,
    statuses,
    velocity_errors,
)
from calibration.fitting.checks.levels import of_levels
from calibration.fitting.checks.parameters import of_parameters
from calibration.fitting.checks.residuals import alike_neighbours, of_residuals, unequal_scatter
from calibration.fitting.checks.searches import of_stage
from calibration.fitting.components import ComponentFit
from calibration.fitting.errors import Errors
from calibration.fitting.material import Estimate, MaterialFit
from calibration.fitting.profiles import Profile
from calibration.fitting.warnings import FitWarning, raised
from calibration.observables import OBSERVABLES, RESTITUTION

NO_RESIDUAL = 1e-12  # of ε
MOST_OFF = 0.5  # rms of an observable other than ε, in parts of its values
OF_UNITS = "Check the unit and the bodies; of dents, which diameter was measured (`dent`)."


def of_component(
    fit: ComponentFit, by_element: dict[int, Estimate], curves: dict[str, Profile]
) -> list[FitWarning]:
    """Warnings about a component's parameters and searches."""
    stages = (of_stage(fit, stage, by_element) for stage in fit.stages)
    return [*of_parameters(fit, by_element, curves), *itertools.chain.from_iterable(stages)]


def of_set(fit: ComponentFit, part: MaterialFit, residual, errors: Mapping[str, Errors]):
    """Warnings about one data set's points.

    Args:
        residual: fitted less measured ε.
        errors: of the points of each observable.
    """
    found: list[FitWarning] = []
    if RESTITUTION in errors:
        found += _of_restitution(part, residual, errors[RESTITUTION])
        found += raised(part.name, [("yield-jump", beside_jump(fit, part))])
    found += raised(part.name, of_levels(fit, part, residual))
    for name, goodness in part.observed.items():
        words = OBSERVABLES[name].words
        causes = of_residuals(part, goodness, errors[name], np.array(goodness.standardised))
        warnings = raised(part.name, causes)
        found += [replace(warning, cause=f"{words}: {warning.cause}") for warning in warnings]
        if goodness.rms > MOST_OFF:  # an estimated scatter takes a wrong unit or size as it is
            cause = f"{words}: the law misses the values by {100 * goodness.rms:.3g} % (rms)"
            found.append(FitWarning("plausibility", cause, part.name, OF_UNITS))
    return found


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
    of_curve = raised(name, of_residuals(part, part, errors, np.where(is_off, standardised, 0.0)))
    missed = {warning.code for warning in of_curve} & {"model-misfit", "residual-runs"}
    if np.any(is_off) and not (found or missed):
        # where the curve misses the points neither says anything of the errors
        unequal = unequal_scatter(velocity, restitution + residual, standardised)
        alike = None if errors.shares else alike_neighbours(velocity, standardised)
        of_curve += raised(name, [("unequal-scatter", unequal), ("groups", alike)])
    level = no_velocity_dependence(errors, restitution, part.family)
    kink = yields if ever_yields else np.nan
    below = "all velocities are below the critical velocity" if part.known_to < np.inf else None
    last = (
        ("no-velocity-dependence", level),
        ("velocity-errors", velocity_errors(data.velocity, data.velocity_uncertainty, kink)),
        *(("status", cause) for cause in statuses(part.status, velocity)),
        ("all-below-yield", below),
        ("overlap", overlap(part)),
    )
    return [*found, *of_curve, *raised(name, last)]
