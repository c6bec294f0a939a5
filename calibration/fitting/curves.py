"""Curves of fitted laws, and their bands: the covariance carried through exact derivatives."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

import softjax as sj
from calibration.data.checks import require
from calibration.errors import DataError, listed
from calibration.fitting.collisions import Route
from calibration.fitting.estimate import Band
from calibration.fitting.further import further_variances
from calibration.fitting.laws import OF_CONTACT, model_of_class
from calibration.fitting.material import Goodness, MaterialFit
from calibration.fitting.problem import Element, Points, Problem
from calibration.fitting.rows import Rows, SetRows
from calibration.fitting.transform import Transform
from calibration.fitting.uncertainty import Freedom, quantile
from calibration.observables import PLACES, RESTITUTION
from calibration.parameters import Parameter

WIDE = (-np.inf, np.inf)

Velocity = Float[np.ndarray, "n"]


def curve_and_slopes(
    material: MaterialFit,
    velocity: Float[np.ndarray, "n"],
    route: Route = None,
    observable: str = RESTITUTION,
) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n free"]]:
    """ε, or another observable in SI, of the fitted law, and its slopes in the free parameters.

    In physical units; ε is 0 without rebound.
    """
    with jax.enable_x64(True):
        problem = curve_problem(material, velocity, route, observable)
        theta = np.array([e.start for e in problem.elements])
        found = problem.linearise(theta[None])
    return found.prediction[0], found.jacobian[0]


def band(
    material: MaterialFit,
    velocity: Any,
    names: tuple[str, ...],
    covariance: Float[np.ndarray, "p p"],
    freedom: Freedom,
    confidence: float,
    kind: str = "mean",
    route: Route = None,
    observable: str = RESTITUTION,
) -> Band:
    """ε(v), or another observable, with a confidence band; NaN where the fit knows nothing.

    Args:
        names, covariance: of the free parameters, in physical units.
        freedom: how well the covariance is known.
        kind: "mean", of the curve itself, or "prediction", of one more measurement.
        route: from the law to ε; None: what suits the law.
        observable: of `calibration.observables`, in SI.
    """
    labels = tuple(material.free.values())
    rows = [names.index(label) for label in labels]
    block, dof = material.name, material.noise_dof
    if observable != RESTITUTION:
        if kind == "prediction":
            dof = _of_observable(material, observable).noise_dof
        block = block_name(material.name, observable)

    def parts(velocity: Velocity) -> tuple[np.ndarray, ...]:
        value, slope = curve_and_slopes(material, velocity, route, observable)
        carried = np.einsum("ni,ij,nj->n", slope, covariance[np.ix_(rows, rows)], slope)
        at = lambda v: curve_and_slopes(material, v, route, observable)[0]  # noqa: E731
        added = (
            further_variances(material, velocity, at, observable) if kind == "prediction" else {}
        )
        if observable != RESTITUTION:  # relative variances
            added = {name: value**2 * one for name, one in added.items()}
        variance = np.maximum(carried, 0.0) + sum(added.values())
        degrees = freedom.degrees(labels, slope, variance, block, added)
        if added and dof is not None:
            degrees = np.minimum(degrees, dof)
        error = np.sqrt(variance)
        reach = quantile(confidence, degrees) * error
        return value, value - reach, value + reach, error

    return band_of(material, velocity, kind, parts)


def _of_observable(material: MaterialFit, observable: str) -> Goodness:
    if observable not in material.observed:
        accepted = f"one that was measured: {listed([RESTITUTION, *material.observed])}"
        raise DataError("observable", observable, accepted)
    return material.observed[observable]


def block_name(name: str, observable: str) -> str:
    """What an observable of a data set is called beside the sets themselves."""
    return name if observable == RESTITUTION else f"{name}: {observable}"


def band_of(
    material: MaterialFit,
    velocity: Any,
    kind: str,
    parts: Callable[[Velocity], tuple[np.ndarray, ...]],
) -> Band:
    """A band from its curve, low and high limits and standard errors at some velocities in a row."""
    velocity = np.asarray(velocity, float)
    flat = velocity.ravel()
    require("velocity", flat, lambda v: v >= 0, "a speed of 0 m/s or more")
    known = material.determined(flat)
    value, low, high, error = (
        np.where(known, part, np.nan).reshape(velocity.shape) for part in parts(flat)
    )
    return Band(velocity, value, low, high, error, kind)


def curve_problem(
    material: MaterialFit,
    velocity: Float[np.ndarray, "n"],
    route: Route = None,
    observable: str = RESTITUTION,
) -> Problem:
    """The fitted law at other velocities, its free parameters searched as they are.

    Raises:
        ValueError: where the bodies differ from impact to impact, and are as many no more.
    """
    data, model = material.data, material.model
    _check_length(material, len(velocity))
    free = list(material.free)
    elements = tuple(_element(material, name) for name in free)
    places = {name: k for k, name in enumerate(free)}
    local = {name: (places.get(name, -1), value) for name, value in material.values.items()}
    rows = Rows.of(model, [SetRows(len(velocity), data.contact, local)], material.trees)
    theta = np.array([e.start for e in elements])
    every = np.arange(len(free))
    ones, code = np.ones(len(velocity)), np.full(len(velocity), PLACES[observable])
    return Problem(
        (data,),
        elements,
        Transform.of([WIDE] * len(free), [None] * len(free)),
        rows.bind(theta, every),
        Points(velocity, 0 * ones, ones, np.zeros(len(ones), int), code, ones, 0 * ones),
        every,
        route,
    )


def _element(material: MaterialFit, name: str) -> Element:
    declared = material.model.declared(name) if "[" not in name else None
    start = material.model.inside({name: material.values[name]})[name]
    return Element(name, name, (0,), Parameter(), declared, float(start), WIDE)  # type: ignore[arg-type]


def of_each_impact(material: MaterialFit) -> set[int]:
    """How many bodies or parameters differ from impact to impact: none where all impacts share them."""
    values = list(material.values.values())
    if material.data.contact is not None:
        values += list(material.data.contact.leaves().values())
    return {np.size(value) for value in values if np.ndim(value)}


def _check_length(material: MaterialFit, count: int) -> None:
    """As many velocities as impacts that the fit was to, where bodies or parameters differ in these."""
    sizes = of_each_impact(material)
    if sizes and sizes != {count}:
        accepted = f"{sizes.pop()} velocities, as the bodies differ from impact to impact"
        raise DataError("velocity", f"{count} long", accepted)


def yield_velocity(law: sj.ContactLaw) -> float | None:
    """v [m/s] from which on a law's impacts yield; None without, or with one for each impact."""
    if not isinstance(law, sj.RateIndependentLaw):
        return None
    velocity = np.asarray(law.elastic_velocity())
    return float(velocity) if velocity.ndim == 0 and 0 < velocity < np.inf else None


def as_empirical(material: MaterialFit) -> MaterialFit:
    """Eq. (17) against the same points, as a fit of its own.

    Under `two-step` its σ and ψ are those of the fit, with their errors.

    Raises:
        ValueError: where there is none: for other laws than Zhou's.
    """
    if material.model.key == "eq-17":
        return material
    if material.empirical is None:
        accepted = "Zhou's law, beside which Eq. (17) is fitted"
        raise DataError("law", material.model.key, accepted)
    names = {"sigma": "sigma", "psi": "psi", "limit_velocity": OF_CONTACT + "limit_velocity"}
    own = material.labels if material.objective == "two-step" else {}
    return replace(
        material,
        model=model_of_class(sj.EmpiricalRestitution, "eq-17", {}),
        values=material.empirical,
        labels={new: own[old] for new, old in names.items() if old in own},
        known_from=0.0,
        known_to=np.inf,
    )
