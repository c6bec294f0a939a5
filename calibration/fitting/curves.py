"""Curves of fitted laws, their bands, and the errors of further measurements.

The covariance is carried through exact derivatives. A further point is of the kind that the data are: a
drop from a height, a pair of velocities, a bounce, or an ε with uncertainties of its own. Its variance
comes from the code that reads measured ones, at its velocity and the ε of the curve.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float

import softjax as sj
from calibration.data import PointErrors, RestitutionData
from calibration.data.checks import require
from calibration.errors import DataError, listed
from calibration.fitting.collisions import Laws, Route
from calibration.fitting.errors import Errors
from calibration.fitting.laws import OF_CONTACT, model_of_class
from calibration.fitting.material import Band, Goodness, MaterialFit
from calibration.fitting.problem import Element, Points, Problem, block_name
from calibration.fitting.uncertainty import Freedom, quantile
from calibration.observables import PLACES, RESTITUTION
from calibration.parameters import Parameter, Transform

MODULUS_STEP = 1e-4  # of E, in the difference that gives ∂ ln t/∂ ln E
LEAST_SLOPE = 1e-3  # of ln t in ln E, below which contact times do not depend on E
WIDE = (-np.inf, np.inf)
STEP = 1e-4  # of a velocity, in the differences that give dε/dv
SLOWEST = 1e-6  # of the highest velocity: nothing is dropped from no height
LEAST_REBOUND = 1e-3  # of ε, of a bounce that is planned
ALIKE = 1e-3  # relative spread up to which stated uncertainties count as equal

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
    return found.prediction[0], found.per[0]


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
    """ε(v), or another observable, with a confidence band; NaN where the data determine nothing.

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
        if added:  # more degrees of freedom do not make one measurement surer than the mean
            of_mean = freedom.degrees(labels, slope, carried, block, {})
            reach = np.maximum(
                reach, quantile(confidence, of_mean) * np.sqrt(np.maximum(carried, 0))
            )
        return value, value - reach, value + reach, error

    return band_of(material, velocity, kind, parts)


def _of_observable(material: MaterialFit, observable: str) -> Goodness:
    if observable not in material.observed:
        accepted = f"one that was measured: {listed([RESTITUTION, *material.observed])}"
        raise DataError("observable", observable, accepted)
    return material.observed[observable]


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
    sizes = of_each_impact(material)
    if sizes and sizes != {len(velocity)}:
        accepted = f"{sizes.pop()} velocities, as the bodies differ from impact to impact"
        raise DataError("velocity", f"{len(velocity)} long", accepted)
    free = list(material.free)
    elements = tuple(_element(material, name) for name in free)
    places = {name: k for k, name in enumerate(free)}
    local = {name: (places.get(name, -1), value) for name, value in material.values.items()}
    laws = Laws.of(model, [(len(velocity), data.contact, local)])
    theta = np.array([e.start for e in elements])
    every = np.arange(len(free))
    ones, code = np.ones(len(velocity)), np.full(len(velocity), PLACES[observable])
    return Problem(
        (data,),
        elements,
        Transform.of([WIDE] * len(free), [None] * len(free)),
        laws.bind(theta, every),
        Points(velocity, 0 * ones, ones, np.zeros(len(ones), int), code, ones, 0 * ones),
        every,
        route,
    )


def _element(material: MaterialFit, name: str) -> Element:
    declared = material.model.declared(name) if "[" not in name else None
    start = material.model.inside({name: material.values[name]})[name]
    return Element(name, Parameter(), declared, float(start), WIDE, False, name, (0,))  # type: ignore[arg-type]


def of_each_impact(material: MaterialFit) -> set[int]:
    """Numbers of impacts over which bodies or parameters differ; empty if all impacts share them."""
    return {np.size(value) for value in _differing(material)}


def _differing(material: MaterialFit) -> list[Any]:
    contact = material.data.contact
    values = [*material.values.values(), *(contact.leaves().values() if contact else ())]
    return [value for value in values if np.ndim(value)]


def of_impact(material: MaterialFit, impact: int) -> MaterialFit:
    """The fit with the bodies and parameters of one of its impacts for all velocities."""

    def one(value: Any) -> Any:
        return value[impact] if np.ndim(value) else value

    data, contact = material.data, material.data.contact
    if contact is not None:
        leaves = {name: float(one(leaf)) for name, leaf in contact.leaves().items()}
        contact = sj.Contact(**leaves, area=contact.area)
    limit = data.limit_velocity
    limit = None if limit is None else float(one(limit))
    data = replace(data, contact=contact, limit_velocity=limit, bodies=(), plausibility=False)
    values = {name: one(value) for name, value in material.values.items()}
    return replace(material, data=data, values=values)


def distinct_impacts(material: MaterialFit) -> list[int]:
    """The first impact of each kind of bodies and parameters; none where all impacts share them."""
    columns = [np.asarray(value, float) for value in _differing(material)]
    if not columns:
        return []
    rounded = [np.round(np.log(np.abs(column) + 1e-300), 9) for column in columns]
    return sorted(np.unique(np.stack(rounded, axis=1), axis=0, return_index=True)[1].tolist())


class ModulusByTimes(NamedTuple):
    """Estimate of E from contact times: the deviation from the stated E, and its relative error."""

    off: float
    error: float


def modulus_by_times(material: MaterialFit) -> ModulusByTimes | None:
    """ln of E by the contact times alone, less that of the stated one, everything else as fitted.

    With s = ∂ ln t/∂ ln E and r = ln(t/predicted), Σ s r/u² / Σ s²/u². None where E is free, or was not
    stated, contact times are not determined, or these do not depend on E.
    """
    name = OF_CONTACT + "youngs_modulus"
    contact = material.data.contact
    if contact is None or name in material.labels or "contact_time" not in material.observed:
        return None
    one = next(one for one in material.data.observed if one.name == "contact_time")
    velocity = material.data.velocity

    def times(factor: float) -> np.ndarray:
        moved = replace(contact, youngs_modulus=np.asarray(contact.youngs_modulus) * factor)
        law = replace(material, data=replace(material.data, contact=moved)).law
        with jax.enable_x64(True):
            return np.log(np.asarray(sj.restitution(law, velocity).duration)[one.rows])

    slope = (times(1 + MODULUS_STEP) - times(1 - MODULUS_STEP)) / (2 * MODULUS_STEP)
    scatter = material.observed["contact_time"].noise or 0.0
    stated = 0.0 if one.uncertainty is None else one.uncertainty / one.value
    weight = 1 / (scatter**2 + stated**2 + np.zeros(len(one)))
    total = float(np.sum(weight * slope**2))
    if not total > 0 or np.max(np.abs(slope)) < LEAST_SLOPE:
        return None
    off = float(np.sum(weight * slope * (np.log(one.value) - times(1.0)))) / total
    return ModulusByTimes(off, total**-0.5)


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
        accepted = "Zhou's law, with which Eq. (17) is fitted"
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


def further_variances(
    material: MaterialFit,
    velocity: Velocity,
    curve: Callable[[Velocity], Velocity],
    observable: str = RESTITUTION,
) -> dict[str, Velocity]:
    """Variances of one more measurement at each velocity [m/s], by where they come from.

    Args:
        curve: ε of the fitted law, or the observable, at velocities.
        observable: what is measured; variances of others than ε are relative.
    """
    data, of_data, observed = material.data, material.variances, None
    value = data.restitution[np.isfinite(data.restitution)]
    if observable != RESTITUTION:
        of_data = material.observed[observable].variances
        observed = next(one for one in data.observed if one.name == observable)
        value = observed.value
    errors = Errors.of(data, observed=observed)
    points, timing = errors.points, material.timing
    found = {kind: np.full(len(velocity), mean) for kind, mean in of_data.items()}
    kind = next((name for name in found if name not in ("scatter", "group")), None)
    if kind is None or (points.uncertainty is None and kind != "timing"):
        return found

    def variance(velocity: Velocity) -> Velocity:
        down, middle, up = (curve(velocity * (1 + side * STEP)) for side in (-1, 0, 1))
        slope = (up - down) / (2 * STEP * velocity) / (1.0 if observed is None else middle)
        planned = like_measured(points, errors.velocity, value, velocity, middle, timing)
        return planned.covariance(slope).diagonal

    found[kind] = variance(np.maximum(velocity, SLOWEST * np.max(errors.velocity)))
    if kind == "scale":
        found[kind] = found[kind] * of_data[kind] / np.mean(variance(errors.velocity))
    return found


def like_measured(
    errors: PointErrors,
    velocity: Float[np.ndarray, "k"],
    restitution: Float[np.ndarray, "k"],
    at: Velocity,
    expected: Velocity,
    timing: float | None = None,
) -> PointErrors:
    """The errors of impacts that are planned, measured as others were.

    Args:
        errors, velocity, restitution: of those that were measured.
        at, expected: v [m/s] and ε of those that are planned.
        timing: standard uncertainty of a time [s] where `errors` state none.
    """

    def like(sizes: Any, was: Any = None, now: Any = None) -> Velocity:
        """All alike, or the same part of the quantity, or those of points next in velocity."""
        alike = [(np.ones(len(sizes)), np.ones(len(at)))]
        alike += [] if was is None else [(np.where(was > 0, was, np.nan), now)]
        for unit, ours in alike:
            parts = sizes / unit
            if np.ptp(parts) <= ALIKE * np.median(parts):
                return ours * np.median(parts)
        order = np.argsort(velocity, kind="stable")
        return np.interp(at, velocity[order], sizes[order])

    own: dict[str, Any] = {}
    if errors.kind == "repeats":
        return PointErrors.alone(len(at), like(errors.uncertainty))
    if errors.restitution_alone is not None:
        own["uncertainty"] = like(errors.restitution_alone)
    if errors.velocity_alone is not None and errors.kind != "velocities":  # v is one of the two
        own["velocity_uncertainty"] = like(errors.velocity_alone, velocity, at)
    if not errors.kind:
        return PointErrors.alone(len(at), own.get("uncertainty"), own.get("velocity_uncertainty"))
    gravity = _gravity(errors, velocity)
    table = _measured(errors.kind, at, np.maximum(expected, LEAST_REBOUND), gravity)
    told: dict[str, Any] = {"gravity": gravity}
    if errors.kind in ("intervals", "times"):
        per = len(table["launch"]) // len(at)
        own = {name: np.repeat(column, per) for name, column in own.items()}
        told["timing_uncertainty"] = timing if errors.size is None else np.median(errors.size)
    else:
        were = _measured(errors.kind, velocity, restitution, gravity)
        sizes = zip(table, errors.sizes(0.0)[errors.index[:, :2]].T, strict=True)
        own |= {f"{name}_uncertainty": like(u, were[name], table[name]) for name, u in sizes}
    return RestitutionData.from_table(
        table | own, plausibility=False, name="planned", **told
    ).errors


def _gravity(errors: PointErrors, velocity: Float[np.ndarray, "k"]) -> float | None:
    """g of the data: v ∂v/∂h of heights is g, ∂v/∂t of times g/2."""
    if errors.kind == "heights":
        return float(np.median(velocity * errors.to_velocity[:, 0]))
    if errors.kind == "velocities":
        return None
    return 2 * float(np.median(np.max(errors.to_velocity, axis=1)))


def _measured(kind: str, velocity: Velocity, restitution: Velocity, gravity: Any) -> dict[str, Any]:
    """Readings of impacts in vacuum; of bounces, one launch of two intervals or three times for each."""
    if kind == "velocities":
        return {"impact_velocity": velocity, "rebound_velocity": restitution * velocity}
    if kind == "heights":
        drop = velocity**2 / (2 * gravity)
        return {"drop_height": drop, "rebound_height": restitution**2 * drop}
    first = 2 * velocity / gravity
    steps = {"interval": [first, restitution * first]}
    if kind == "times":
        steps = {"time": [0 * first, first, first * (1 + restitution)]}
    ((name, rows),) = steps.items()
    launch = np.repeat([str(k) for k in range(len(velocity))], len(rows))
    return {"launch": launch, name: np.transpose(rows).ravel()}
