"""Curves of fitted laws, their bands, and the errors of further measurements.

The covariance is carried through exact derivatives. A further point is of the kind that the data are: a
drop from a height, a pair of velocities, a bounce, or an ε with uncertainties of its own. Its variance
comes from the code that reads measured ones, at its velocity and the ε of the curve.
"""

from collections.abc import Callable, Sequence
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
from calibration.fitting.degrees_of_freedom import dof_of, quantile
from calibration.fitting.elements import Element
from calibration.fitting.errors import Errors
from calibration.fitting.material import Band, MaterialFit
from calibration.fitting.problem import Problem, block_name
from calibration.fitting.request import WIDE
from calibration.fitting.rows import Points
from calibration.observables import OBSERVABLES, PLACES, RESTITUTION
from calibration.parameters import Parameter, Transform
from softjax.fields import Declared

STEP = 1e-4  # of a velocity, in the differences that give dε/dv
SLOWEST = 1e-6  # of the highest velocity: nothing is dropped from no height
LEAST_REBOUND = 1e-3  # of ε, of a bounce that is planned
NO_VARIANCE = 1e-12  # of the largest, below which that of a direction is none
HIDDEN = 1e-3  # of a slope, from which on a part along what is not determined counts
AFFECTS = 1e-6  # of a prediction, by a parameter that acts on no point
SAME_BODY = 9  # decimal places of the logarithms of numbers of a body: equal ones are one body
ALIKE = 1e-3  # relative spread up to which stated uncertainties count as equal

Velocity = Float[np.ndarray, "n"]


def curve_and_slopes(
    material: MaterialFit, velocity: Velocity, route: Route = None, observable: str = RESTITUTION
) -> tuple[Velocity, Float[np.ndarray, "n free"]]:
    """ε, or another observable in SI, of the fitted law, and its slopes in the free parameters.

    In physical units; ε is 0 without rebound.
    """
    with jax.enable_x64(True):
        problem = curve_problem(material, velocity, route, observable)
        linear = problem.linearise(np.array([[e.start for e in problem.elements]]))
    return linear.prediction[0], linear.per[0]


def curve_problem(
    material: MaterialFit, velocity: Velocity, route: Route = None, observable: str = RESTITUTION
) -> Problem:
    """The fitted law at other velocities, its free parameters searched as they are.

    Raises:
        ValueError: where the bodies differ from impact to impact, and are as many no more.
    """
    sizes, count = {len(value) for value in _differing(material)}, len(velocity)
    if sizes and sizes != {count}:
        accepted = f"{sizes.pop()} velocities, as the bodies differ from impact to impact"
        raise DataError("velocity", f"{count} long", accepted)
    free = list(material.free)
    inside = material.model.inside({name: material.values[name] for name in free})
    elements = tuple(
        Element(name, Parameter(), Declared(name), float(value), WIDE, label=name, sets=(0,))
        for name, value in inside.items()
    )
    places = {name: k for k, name in enumerate(free)}
    local = {name: (places.get(name, -1), value) for name, value in material.values.items()}
    laws = Laws.of(material.model, [(count, material.data.contact, local)])
    all_free, code = np.arange(len(free)), np.full(count, PLACES[observable])
    zero, ones = np.zeros(count), np.ones(count)
    return Problem(
        (material.data,),
        elements,
        Transform.of([WIDE] * len(free), [None] * len(free)),
        laws.bind(np.array([e.start for e in elements]), all_free),
        Points(velocity, zero, ones, zero.astype(int), code, ones, zero),
        all_free,
        route,
    )


def band(
    result: Any,
    material: MaterialFit,
    velocity: Any,
    confidence: float,
    kind: str = "mean",
    observable: str = RESTITUTION,
    impact: int | None = None,
) -> Band:
    """ε(v), or another observable, of one of a result's fits with a confidence band; see `FitResult.band`."""
    labels = tuple(material.free.values())
    rows = [result.covariance_names.index(label) for label in labels]
    covariance = result.of_predictions[np.ix_(rows, rows)]
    block = block_name(material.name, observable)
    dof = dof_of(result.dof_by_component, material.name, labels)
    hidden = _Hidden.of(result)
    route = result.request.route_of_curve(material.model.law_type)
    further = kind == "prediction"
    if further and observable not in material.measured:
        accepted = f"one that was measured: {listed(material.measured)}"
        raise DataError("observable", observable, accepted)
    of_noise = material.goodness(observable)

    def parts(velocity: Velocity) -> tuple[np.ndarray, ...]:
        value, slope = curve_and_slopes(material, velocity, route, observable)
        variance_of_curve = np.maximum(np.einsum("ni,ij,nj->n", slope, covariance, slope), 0.0)
        if result.budget is not None:
            variance_of_curve += (
                result.budget.curve_error(material, velocity, observable, impact) ** 2
            )
        variance_of_curve[hidden.affects(value, slope, rows)] = np.nan
        degrees = dof.satterthwaite(labels, slope, variance_of_curve, block, {})
        reach = quantile(confidence, degrees) * np.sqrt(variance_of_curve)
        if not further:
            return value, value - reach, value + reach, np.sqrt(variance_of_curve)
        at = lambda v: curve_and_slopes(material, v, route, observable)[0]  # noqa: E731
        scale = value**2 if OBSERVABLES[observable].is_relative else 1.0
        variances = further_variances(material, velocity, at, observable)
        added = {name: scale * variance for name, variance in variances.items()}
        error = np.sqrt(variance_of_curve + sum(added.values()))
        degrees = dof.satterthwaite(labels, slope, error**2, block, added)
        if of_noise is not None:
            degrees = of_noise.family.predictive_degrees(degrees)
        # more degrees of freedom do not make one measurement surer than the mean
        reach = np.maximum(reach, quantile(confidence, degrees) * error)
        return value, value - reach, value + reach, error

    return band_of(material, velocity, kind, parts)


class _Hidden(NamedTuple):
    """Directions of the parameters that the data do not determine.

    Those of a network are left out: it has more weights than points, and follows the points all the same.
    """

    size: Float[np.ndarray, " p"]  # unit of each parameter that is part of one, else 0
    directions: Float[np.ndarray, "p n"]  # in these units, orthonormal
    unseen: Float[np.ndarray, " p"]  # |θ| of each that acts on no point, else 0

    @classmethod
    def of(cls, result: Any) -> "_Hidden":
        """Find the directions in the covariance, which has no variance along them."""
        estimates = [result.estimates.get(name) for name in result.covariance_names]
        variance = np.diagonal(result.of_predictions)
        left_out = ~np.isfinite(np.diagonal(result.covariance)) & np.isfinite(variance)
        left_out &= np.array([e is not None for e in estimates], bool)  # no weights of a network
        size = np.where(left_out, np.sqrt(variance), 0.0)
        value = [abs(e.value or 0.0) if e and not e.at_bound else 0.0 for e in estimates]
        unseen = np.where(left_out & (size == 0), value, 0.0)
        some = np.flatnonzero(size)
        directions = np.zeros((len(size), len(some)))
        if len(some):
            block = result.of_predictions[np.ix_(some, some)] / np.outer(size[some], size[some])
            values, vectors = np.linalg.eigh(block)
            directions[some] = vectors * (values < NO_VARIANCE * values[-1])
        return cls(size, directions, unseen)

    def affects(self, value: Velocity, slope: Any, rows: Sequence[int]) -> np.ndarray:
        """Whether they move the curve at each velocity, where it has the slopes `slope` in the parameters of `rows`."""
        scaled = slope * self.size[rows]
        part = np.linalg.norm(scaled @ self.directions[rows], axis=1)
        unseen = np.max(np.abs(slope) * self.unseen[rows], axis=1, initial=0.0)
        return (part > HIDDEN * np.linalg.norm(scaled, axis=1)) | (unseen > AFFECTS * np.abs(value))


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
    columns = (np.where(known, part, np.nan).reshape(velocity.shape) for part in parts(flat))
    value, low, high, error = columns
    return Band(velocity, value, low, high, error, kind)


def _differing(material: MaterialFit) -> list[np.ndarray]:
    """Bodies and parameters that differ from impact to impact."""
    contact = material.data.contact
    values = [*material.values.values(), *(contact.leaves().values() if contact else ())]
    return [np.asarray(value, float) for value in values if np.ndim(value)]


def distinct_impacts(material: MaterialFit) -> list[int]:
    """The first impact of each kind of bodies and parameters; none where all impacts share them."""
    logs = (np.log(np.abs(value) + 1e-300) for value in _differing(material))
    columns = [np.round(values, SAME_BODY) for values in logs]
    if not columns:
        return []
    return sorted(np.unique(np.stack(columns, axis=1), axis=0, return_index=True)[1].tolist())


def of_impact(material: MaterialFit, impact: int) -> MaterialFit:
    """The fit with the bodies and parameters of one of its impacts for all velocities."""
    pick = lambda value: value[impact] if np.ndim(value) else value  # noqa: E731
    data, contact = material.data, material.data.contact
    if contact is not None:
        leaves = {name: float(pick(leaf)) for name, leaf in contact.leaves().items()}
        contact = sj.Contact(**leaves, area=contact.area)
    limit = None if data.limit_velocity is None else float(pick(data.limit_velocity))
    data = replace(data, contact=contact, limit_velocity=limit, bodies=())
    return replace(material, data=data, values={k: pick(v) for k, v in material.values.items()})


def yield_velocity(law: sj.ContactLaw) -> float | None:
    """v [m/s] from which on a law's impacts yield; None without, or with one for each impact."""
    if not isinstance(law, sj.RateIndependentLaw):
        return None
    velocity = np.asarray(law.elastic_velocity())
    return float(velocity) if velocity.ndim == 0 and 0 < velocity < np.inf else None


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
        observed = next(block for block in data.observed if block.name == observable)
        value = observed.value
    errors = Errors.of(data, observed=observed)
    variances = {kind: np.full(len(velocity), mean) for kind, mean in of_data.items()}
    kind = next((name for name in variances if name not in ("scatter", "group")), None)
    if kind is None:
        return variances

    def variance(velocity: Velocity) -> Velocity:
        down, middle, up = (curve(velocity * (1 + side * STEP)) for side in (-1, 0, 1))
        slope = (up - down) / (2 * STEP * velocity) / (1.0 if observed is None else middle)
        measured = errors.points, errors.velocity, value
        planned = like_measured(*measured, velocity, middle, material.timing)
        return planned.variance(slope)

    variances[kind] = variance(np.maximum(velocity, SLOWEST * np.max(errors.velocity)))
    if kind == "scale":
        variances[kind] = variances[kind] * of_data[kind] / np.mean(variance(errors.velocity))
    return variances


def like_measured(
    errors: PointErrors,
    velocity: Float[np.ndarray, " k"],
    restitution: Float[np.ndarray, " k"],
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

    kind = errors.measured_by
    u, u_v = errors.u_restitution, errors.u_velocity
    # of a pair of velocities v is one of the two
    u_v = None if u_v is None or kind.has_velocity else like(u_v, velocity, at)
    gravity = kind.gravity(velocity, errors.to_velocity)
    table = kind.readings(at, np.maximum(expected, LEAST_REBOUND), gravity)
    if not table:  # v and ε themselves are stated
        u = errors.uncertainty
        return PointErrors.independent(len(at), None if u is None else like(u), u_v)
    stated = {"uncertainty": None if u is None else like(u), "velocity_uncertainty": u_v}
    each = len(next(iter(table.values()))) // len(at)  # rows of a point
    options = {name: np.repeat(x, each) for name, x in stated.items() if x is not None}
    were = kind.readings(velocity, restitution, gravity)
    planned: dict[str, Any] = {}
    if errors.size is not None or timing is not None:
        planned = kind.planned(errors.sizes(timing or 0.0), errors.index, like, were, table)
    return RestitutionData.from_table(table | options | planned, gravity=gravity).errors
