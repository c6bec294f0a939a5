"""Expected standard errors of planned measurements, and determined combinations in words.

    A = A₀ + Σ_i ∇ε(v_i) ∇ε(v_i)ᵀ/V_i

is the information on ln θ, with A₀ that of a fit (the inverse of its covariance) or of priors, and V_i
the variance of a planned ε. A planned shot is a point of the kind that the fit's data are (a drop from
a height, a pair of velocities, a bounce, an ε with its own uncertainty); see `calibration.fitting.curves`.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import jax
import numpy as np
from jaxtyping import ArrayLike, Float

import softjax as sj
from calibration.data import RestitutionData
from calibration.data.checks import as_number
from calibration.data.json_file import plain
from calibration.errors import DataError, did_you_mean
from calibration.fitting.collisions import Route
from calibration.fitting.curves import curve_and_slopes, further_variances, yield_velocity
from calibration.fitting.laws import OF_CONTACT, eps_up_of, numbers_in
from calibration.fitting.material import MaterialFit
from calibration.fitting.problem import Element
from calibration.fitting.request import Request
from calibration.fitting.result import FitResult
from calibration.observables import OBSERVABLES, RESTITUTION
from calibration.parameters import Parameter, as_parameter
from calibration.rounding import number
from softjax.fields import numbers_of, options_of, whole_fields

USUAL_NOISE = 0.01  # standard uncertainty of ε unless stated
PLACEHOLDER = 0.5  # ε of data that have none yet
UNDETERMINED = 1.0  # relative standard error above which a combination counts as not determined
NO_BOUND = 100.0  # and from which no number is given for it
ALMOST_NOTHING = 1e-6  # prior information on each ln θ: known to a factor e^1000 beforehand
TAKES_PART = 0.2  # share of a parameter in a direction from which it is named
ROUNDED = 1.1  # times the error of a direction: that of its product with the exponents as written
DECIMALS = range(2, 9)
BY_HAND = (
    "to plan elsewhere take the law with values given by hand: `softjax sensitivity FILE.toml "
    "--chi … --sigma … --psi … --study design --from …`"
)
NO_MODEL = "model: information and designs are those of the likelihood"

Column = Float[np.ndarray, "n"]


@dataclass(frozen=True)
class Plan:
    """A law whose parameters are to be known better, and what is known of them.

    Attributes:
        material: the law, and the data that planned shots are like.
        free: name of each parameter in the law -> as results call it.
        before: A₀, (p, p), on ln θ.
        uncertainty: standard uncertainty of a planned ε; None: as the fit's data have it.
        route: from the law to ε.
        left_open: why each parameter that the fit did not determine is taken as known.
        intervals: the fit's own, in words, by parameter.
        sensors: what else each shot shows, and its relative standard uncertainty.
    """

    material: MaterialFit
    free: Mapping[str, str]
    before: Float[np.ndarray, "p p"]
    uncertainty: Column | float | None
    route: Route
    left_open: tuple[str, ...] = ()
    intervals: Mapping[str, str] = field(default_factory=dict)
    sensors: Mapping[str, float] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.free.values())

    def taken_as_known(self, targets: Iterable[str]) -> tuple[str, ...]:
        """A sentence for each parameter that the fit did not determine, with intervals of the targets."""
        targets = list(targets)
        whose = "error" if len(targets) == 1 else "errors"
        more = [f"; {self.intervals[name]}" for name in targets if name in self.intervals]
        text = f": the {whose} of {', '.join(targets)} may be larger{''.join(more)}"
        return tuple(why + text for why in self.left_open)

    @property
    def truth(self) -> Float[np.ndarray, "p"]:
        """θ."""
        values = self.material.model.inside(self.material.values)
        return np.array([float(values[name]) for name in self.free])

    @property
    def unit(self) -> Float[np.ndarray, "p"]:
        """|θ|, and 1 where θ = 0: slopes in θ times these are in ln θ."""
        return np.abs(self.truth) + (self.truth == 0)

    @property
    def symbols(self) -> tuple[str, ...]:
        """χ̃, or χ̃[name] where there are several data sets."""
        model = self.material.model
        declared = {name: None if "[" in name else model.declared(name) for name in self.free}
        short = {name: (one.symbol if one else "") or name for name, one in declared.items()}
        return tuple(short[name] + label.removeprefix(name) for name, label in self.free.items())

    @property
    def yields(self) -> float:
        """The velocity at which an impact yields [m/s]; 0 for laws without."""
        return yield_velocity(self.material.law) or 0.0

    def curve(self, velocity: Column) -> tuple[Column, Float[np.ndarray, "n p"]]:
        """ε, and θ ∂ε/∂θ."""
        value, slope = curve_and_slopes(self.material, velocity, self.route)
        columns = [list(self.material.free).index(name) for name in self.free]
        return value, slope[:, columns] * self.unit

    def relative_slopes(self, velocity: Column, observable: str) -> Float[np.ndarray, "n p"]:
        """∂ ln O/∂ ln θ of what else an impact shows; 0 where it does not show it."""
        value, slope = curve_and_slopes(self.material, velocity, self.route, observable)
        columns = [list(self.material.free).index(name) for name in self.free]
        shown = (value > 0)[:, None]
        return np.where(
            shown, slope[:, columns] * self.unit / np.where(shown, value[:, None], 1), 0
        )

    def shots(
        self, velocity: Column, uncertainty: Column | float | None = None
    ) -> tuple[Float[np.ndarray, "n r p"], Column]:
        """G of each shot, with information Gᵀ G, one row for ε and one for each sensor; and u(ε).

        The ε of an impact that does not rebound adds nothing.
        """
        value, slope = self.curve(velocity)
        stated = self.uncertainty if uncertainty is None else uncertainty
        if stated is None:
            every = further_variances(self.material, velocity, lambda v: self.curve(v)[0])
            stated = np.sqrt(sum(every.values()))
        error = np.broadcast_to(np.asarray(stated, float), velocity.shape)
        rows = [np.where(value > 0, 1 / error, 0.0)[:, None] * slope]
        rows += [self.relative_slopes(velocity, name) / u for name, u in self.sensors.items()]
        return np.stack(rows, axis=1), error

    def information(
        self, velocity: Column, uncertainty: Column | float | None = None
    ) -> tuple[Float[np.ndarray, "p p"], Column]:
        """A₀ and what shots add, and u(ε)."""
        added, error = self.shots(velocity, uncertainty)
        return self.before + np.einsum("nri,nrj->ij", added, added), error


def plan_of(
    law: sj.ContactLaw | FitResult,
    reach: ArrayLike,
    *,
    parameters: Mapping[str, Any] | None = None,
    objective: str | None = None,
    route: Route = None,
    material: str | None = None,
    uncertainty: float | None = None,
    measured: tuple[ArrayLike, ArrayLike] | None = None,
    sensors: Mapping[str, float] | None = None,
) -> Plan:
    """The plan for a law, or for one of a fit's materials.

    Args:
        reach: velocities that are planned, or the ends of what can be [m/s].
        measured: velocities and uncertainties of ε of what is there already, for a law.
    The others are those of `fisher_information`.

    Raises:
        ValueError: naming the argument, its value and what is accepted.
    """
    reach, sensors = np.asarray(reach, float).ravel(), _checked_sensors(sensors or {})
    if objective not in (None, "model"):
        raise DataError("objective", objective, NO_MODEL)
    with jax.enable_x64(True):
        if isinstance(law, FitResult):
            for name, value in (("parameters", parameters), ("measured", measured)):
                if value is not None:
                    raise DataError(name, value, "left out with a fit, which has its own")
            plan = replace(_of_fit(law, material, reach, uncertainty, route), sensors=sensors)
        elif not isinstance(law, sj.ContactLaw):
            raise DataError("law", law, "a contact law or a FitResult")
        elif material is not None:
            raise DataError("material", material, "left out with a law")
        else:
            v, u = ((), 1.0) if measured is None else measured
            there = checked_impacts(v, u, "measured")
            every = np.concatenate([there[0], reach])
            plan = _of_law(law, every, parameters or {}, uncertainty, route, sensors)
            if len(there[0]):
                plan = replace(plan, before=plan.information(*there)[0])
            plan = replace(plan, sensors=sensors)
    contact = plan.material.data.contact
    if contact is not None and any(map(np.ndim, contact.leaves().values())):
        raise DataError("contact", "other for each impact", "one for all impacts")
    if not plan.names:
        raise DataError("parameters", "none free", "at least one that is free and determined")
    return plan


def checked_impacts(velocity: ArrayLike, uncertainty: ArrayLike, name: str):
    """Velocities and uncertainties of one length."""
    v, u = np.asarray(velocity, float).ravel(), np.asarray(uncertainty, float)
    if not (np.all(np.isfinite(u)) and np.all(u > 0)):
        raise DataError("uncertainty", uncertainty, "positive")
    if u.ndim and u.shape != v.shape:
        raise DataError(name, f"{u.size} uncertainties", f"one for all, or {v.size}")
    return v, np.broadcast_to(u, v.shape)


def _of_law(
    law: sj.ContactLaw, every: Column, parameters, uncertainty, route: Route, sensors=()
) -> Plan:
    for name, value in numbers_of(law).items():
        if np.ndim(value):
            raise DataError(name, f"of shape {np.shape(value)}", "a single number")
    contact = getattr(law, "contact", None)
    columns = (one.replace("residual_", "") for one in sensors)
    shown: dict[str, Any] = dict.fromkeys(columns, np.ones(len(every)))
    data = RestitutionData(
        every,
        np.full(len(every), PLACEHOLDER),
        contact,
        name="the plan",
        limit_velocity=None if contact else getattr(law, "limit_velocity", None),
        plausibility=False,
        **shown,
    )
    stated: dict[str, Any] = dict(parameters)
    for name, value in parameters.items():
        is_held = isinstance(value, Parameter) and not value.free and value.value is None
        if is_held and hasattr(law, name):
            stated[name] = Parameter(getattr(law, name), free=False)
    stated |= {name: getattr(law, name) for name in options_of(type(law))}
    for name in whole_fields(type(law)):
        is_free = name in stated and as_parameter(name, stated[name]).free
        stated[name] = Parameter(getattr(law, name), free=is_free)
    spec = Request((data,), stated).with_options(law=type(law)).specs()[0]
    free = {one.name: one.name for one in spec.local if one.parameter.free}
    material = MaterialFit(
        data=data,
        objective="model",
        model=spec.model,
        parameters={},
        derived={},
        values={one.name: _truth(law, one) for one in spec.local},
        labels=free,
        rms=math.nan,
        rms_empirical=None,
        empirical=None,
        converged=True,
        status=(),
    )
    plan = Plan(material, free, np.zeros((0, 0)), uncertainty or USUAL_NOISE, route)
    priors = (one.parameter.prior for one in spec.local if one.name in free)
    sizes = [prior[1] if prior else np.inf for prior in priors]
    return replace(plan, before=np.diag((plan.unit / sizes) ** 2))


def _truth(law: Any, local: Element) -> Any:
    """The value of a parameter in the law."""
    name, parameter = local.name, local.parameter
    stem, _, entry = name.partition("[")
    if local.stands_in:
        return local.start
    if entry:
        return numbers_in(getattr(law, stem))[int(entry[:-1])]
    if name.startswith(OF_CONTACT):
        value = getattr(law.contact, name.removeprefix(OF_CONTACT))
    else:
        value = float(eps_up_of(law)) if name == "eps_up" else getattr(law, name, None)
    if value is None:  # such as c1
        raise DataError("parameters", name, "of those whose value the law has")
    if not parameter.free and parameter.value not in (None, value):
        accepted = f"the value of the law, {value:g}, if it is fixed"
        raise DataError(f"parameters[{name!r}]", parameter.value, accepted)
    if parameter.free and not local.declared.lower < value < local.declared.upper:
        raise DataError(name, value, f"{local.declared.accepted}, inside its range, or fixed")
    return float(value)


def _of_fit(result: FitResult, name: str | None, reach: Column, uncertainty, route: Route) -> Plan:
    material = result.material(name)
    if material.objective != "model":
        raise DataError("objective", material.objective, f'{NO_MODEL}; fit with "model"')
    low, high = material.known_from, material.known_to
    for outside in reach[(reach < low) | (reach > high)][:1]:
        end = f"up to {high:.4g} m/s" if low <= 0 else f"{low:.4g} m/s or more"
        accepted = f"{end}, where this fit knows the law; {BY_HAND}"
        raise DataError("velocity", float(outside), accepted)
    places = {label: k for k, label in enumerate(result.covariance_names)}
    size = np.diag(result.covariance)
    free = {
        parameter: label
        for parameter, label in material.free.items()
        if np.isfinite(size[places[label]])
    }
    chosen = route or result.request.route_of_curve(material.model.law_type)
    plan = Plan(material, free, np.zeros((0, 0)), uncertainty, chosen)
    rows = [places[label] for label in plan.names]
    covariance = result.covariance[np.ix_(rows, rows)] / np.outer(plan.unit, plan.unit)
    left = [name for name in material.free if name not in free]
    intervals = {label: text for label in plan.names if (text := _interval(label, result))}
    return replace(
        plan,
        before=np.linalg.inv(covariance),
        left_open=tuple(
            _left_open(parameter, material.parameters.get(parameter)) for parameter in left
        ),
        intervals=intervals,
    )


def _left_open(name: str, estimate: Any) -> str:
    at_bound = estimate is not None and estimate.at_bound and estimate.value is not None
    why = f"is at its bound {number(estimate.value, 4)}" if at_bound else "is not determined"
    return f"{name} {why} and is taken as known"


def _interval(label: str, result: FitResult) -> str:
    """The fit's own, and in parts of the value as the promised errors are."""
    estimate = result.estimates.get(label)
    if estimate is None or estimate.low is None or estimate.high is None:
        return ""
    ends, value = (estimate.low, estimate.high), estimate.value
    shown = " to ".join(number(x, 4) for x in ends)
    text = f"the fit's {100 * result.confidence:g} % interval of {label} is {shown}"
    parts = " to ".join(f"{100 * (x / value - 1):+.2g} %" for x in ends) if value else ""
    return f"{text} ({parts})" if parts else text


def covariance_of(information: Float[np.ndarray, "... p p"]) -> Float[np.ndarray, "... p p"]:
    """Covariance of ln θ; a negligible prior keeps it finite where the data determine nothing."""
    return np.linalg.inv(information + ALMOST_NOTHING * np.eye(information.shape[-1]))


@dataclass(frozen=True, eq=False)
class Information:
    """What planned impacts determine of p parameters θ, by the likelihood.

    Attributes:
        names, symbols: the parameters.
        truth: θ.
        velocity, uncertainty: v [m/s] and standard uncertainty of ε of each planned impact, (n,).
        matrix: Fisher's information on ln θ, (p, p), what was known before included.
        covariance: of ln θ, (p, p); NaN for what is not determined.
        taken_as_known: a sentence for each parameter of the fit that has no standard error.
        sensors: what else is measured, and its relative uncertainty.
        without: the same without the sensors; None where there are none.
        before: relative errors that are known now, by a fit or priors; None where nothing is.
    """

    names: tuple[str, ...]
    symbols: tuple[str, ...]
    truth: Float[np.ndarray, "p"]
    velocity: Float[np.ndarray, "n"]
    uncertainty: Float[np.ndarray, "n"]
    matrix: Float[np.ndarray, "p p"]
    covariance: Float[np.ndarray, "p p"]
    taken_as_known: tuple[str, ...] = ()
    sensors: Mapping[str, float] = field(default_factory=dict)
    without: "Information | None" = None
    before: Mapping[str, float | None] | None = None

    @property
    def relative_errors(self) -> dict[str, float | None]:
        """Expected standard error of ln θ; None where the impacts do not determine θ."""
        errors = np.sqrt(np.diag(self.covariance)).tolist()
        return _finite(self.names, errors)

    @property
    def standard_errors(self) -> dict[str, float | None]:
        """Expected standard error of θ; None where the impacts do not determine it."""
        pairs = zip(self.relative_errors.items(), self.truth.tolist(), strict=True)
        return {n: None if e is None else abs(value or 1.0) * e for (n, e), value in pairs}

    @property
    def directions(self) -> tuple[Float[np.ndarray, "p"], Float[np.ndarray, "p p"]]:
        """Eigenvalues of the information, the best known direction first, and eigenvectors.

        A column has the exponents of a product of powers of θ; its largest one is positive.
        """
        values, vectors = np.linalg.eigh(0.5 * (self.matrix + self.matrix.T))
        largest = np.argmax(np.abs(vectors), axis=0)
        vectors = vectors * np.sign(vectors[largest, np.arange(len(values))])
        return np.maximum(values[::-1], 0), vectors[:, ::-1]

    @property
    def words(self) -> tuple[str, ...]:
        """Each direction in a sentence, the best known first."""
        values, vectors = self.directions
        errors = np.maximum(values, NO_BOUND**-2) ** -0.5
        return tuple(
            _sentence(
                self.symbols, value, *_exponents(direction, errors[:, None] * vectors.T, error)
            )
            for value, direction, error in zip(values, vectors.T, errors, strict=True)
        )

    def to_dict(self) -> dict[str, Any]:
        """A dictionary for JSON; undefined numbers are None."""
        values, vectors = self.directions
        return plain(
            {
                "parameters": dict(zip(self.names, self.truth, strict=True)),
                "velocity": self.velocity,
                "uncertainty": self.uncertainty,
                "standard_errors": self.standard_errors,
                "relative_standard_errors": self.relative_errors,
                "information": self.matrix,
                "eigenvalues": values,
                "directions": vectors.T,
                "words": self.words,
                "taken_as_known": self.taken_as_known,
                "before": self.before,
            }
            | of_sensors(
                self.sensors, None if self.without is None else self.without.relative_errors
            )
        )

    def __str__(self) -> str:
        lines = [f"{len(self.velocity)} planned impacts{in_range(self.velocity, self.uncertainty)}"]
        if self.without is not None:
            without = self.without.relative_errors
            lines += sensors_text(self.sensors, self.relative_errors, without)
        return "\n".join([*lines, *self.words, *self.taken_as_known])


def sensors_text(sensors: Mapping[str, float], errors, without) -> list[str]:
    """Relative errors with sensors and without them, a parameter a line; nothing without sensors."""
    if not sensors:
        return []
    shown = ", ".join(f"{name} to {100 * u:.2g} %" for name, u in sensors.items())
    pairs = ((name, *map(_per_cent, (e, without[name]))) for name, e in errors.items())
    return [
        f"with {shown} of each impact",
        *(f"  {name}: {a}; without: {b}" for name, a, b in pairs),
    ]


def of_sensors(sensors: Mapping[str, float], without: Mapping[str, Any] | None) -> dict[str, Any]:
    """Sensors as a dictionary for JSON."""
    return {"sensors": dict(sensors), "without_sensors": without} if sensors else {}


def _per_cent(error: float | None) -> str:
    return "not determined" if error is None else f"to {100 * error:.2g} %"


def fisher_information(
    law: sj.ContactLaw | FitResult,
    velocity: ArrayLike = (),
    uncertainty: ArrayLike | None = None,
    objective: str | None = None,
    route: sj.EnergyBalance | sj.ClosedForm | sj.ODE | None = None,
    *,
    parameters: Mapping[str, Any] | None = None,
    material: str | None = None,
    sensors: Mapping[str, float] | None = None,
) -> Information:
    """Fisher information of planned measurements of ε on the parameters of a law.

    Args:
        law: with the parameters as far as they are known; or a fit by `model`, whose covariance is
            what is known before. Of its parameters those count that it determined.
        velocity: v [m/s] of the impacts; for a fit further ones, which share no error: each is of a
            specimen, or launch, of its own.
        uncertainty: standard uncertainty of each ε, one number or (n,); 0.01 where left out, for a
            fit that of a point of the same kind as its data (a drop from that height with its
            uncertainty, say), scatter and the offset of another group included.
        objective: "model"; nothing else has information.
        route: from the law to ε; the energy balance where it can, unless stated.
        parameters: which are free, and their priors, as `fit` takes them: {"psi": 0.54} holds ψ,
            {"contact.youngs_modulus": cal.Parameter(prior=(2e11, 1e10))} is a nuisance.
        material: which one of a fit's.
        sensors: what else each impact is to show, and its relative standard uncertainty, as
            {"contact_time": 0.02}; of `calibration.observables`. The errors without it are given too.

    Raises:
        ValueError: naming the argument, its value and what is accepted.
    """
    plan = plan_of(
        law,
        velocity,
        parameters=parameters,
        objective=objective,
        route=route,
        material=material,
        sensors=sensors,
    )
    v, u = checked_impacts(velocity, 1.0 if uncertainty is None else uncertainty, "velocity")
    if not (v.size or isinstance(law, FitResult)):
        raise DataError("velocity", "empty", "one velocity [m/s] or more")
    if not np.all(np.isfinite(v) & (v > 0)):
        raise DataError("velocity", velocity, "positive speeds in m/s")

    def expected(plan: Plan, **more: Any) -> Information:
        matrix, error = plan.before, u
        if v.size:
            with jax.enable_x64(True):
                matrix, error = plan.information(v, None if uncertainty is None else u)
        known = plan.taken_as_known(plan.names)
        one = plan.names, plan.symbols, plan.truth, v, error, matrix, _closed(matrix), known
        errors = np.sqrt(np.diag(_closed(plan.before))).tolist()
        before = _finite(plan.names, errors) if np.any(plan.before) else None
        return Information(*one, before=before, **more)

    without = expected(replace(plan, sensors={}))
    return expected(plan, sensors=plan.sensors, without=without) if plan.sensors else without


def _finite(names: Sequence[str], errors: Sequence[float]) -> dict[str, float | None]:
    return {n: e if math.isfinite(e) else None for n, e in zip(names, errors, strict=True)}


def _closed(matrix: Float[np.ndarray, "p p"]) -> Float[np.ndarray, "p p"]:
    """The covariance, NaN for what is not determined."""
    covariance = covariance_of(matrix)
    is_open = np.sqrt(np.diag(covariance)) > NO_BOUND
    covariance[is_open], covariance[:, is_open] = np.nan, np.nan
    return covariance


def _checked_sensors(sensors: Mapping[str, float]) -> dict[str, float]:
    names = [name for name in OBSERVABLES if name != RESTITUTION]
    for name in sensors:
        if name not in names:
            raise DataError("sensors", name, f"of {', '.join(names)}{did_you_mean(name, names)}")
    positive = "a positive relative uncertainty"
    return {
        name: as_number(f"sensors[{name!r}]", size, lambda u: u > 0, positive)
        for name, size in sensors.items()
    }


def in_range(velocity: Iterable[float], uncertainty: Iterable[float]) -> str:
    """ ", 0.5 to 6 m/s, uncertainty of ε 0.01 to 0.02"; nothing without impacts."""
    v, u = np.asarray(velocity, float), np.asarray(uncertainty, float)
    return f", {_span(v)} m/s, standard uncertainty of ε {_span(u)}" if v.size else ""


def _span(values: Column) -> str:
    low, high = f"{np.min(values):.3g}", f"{np.max(values):.3g}"
    return low if low == high else f"{low} to {high}"


def _exponents(direction: np.ndarray, factor: np.ndarray, error: float) -> tuple[np.ndarray, int]:
    """Exponents of a direction with as few letters and decimals as leave its error what it is.

    A letter of a small exponent matters where its own error is large.

    Args:
        factor: F with Fᵀ F the covariance of ln θ.
    """
    few = np.where(np.abs(direction) > TAKES_PART, direction, 0.0).round(2)
    if error >= UNDETERMINED:
        return few, 2
    tries = [(few, 2), *((direction.round(k), k) for k in DECIMALS)]
    enough = (one for one in tries if np.linalg.norm(factor @ one[0]) < ROUNDED * error)
    return next(enough, tries[-1])


def _sentence(
    symbols: Sequence[str], eigenvalue: float, exponents: np.ndarray, decimals: int
) -> str:
    error = math.inf if eigenvalue <= 0 else eigenvalue**-0.5
    taking_part = np.flatnonzero(exponents).tolist()
    product = " · ".join(_power(symbols[i], float(exponents[i]), decimals) for i in taking_part)
    letters = " and ".join(symbols[i] for i in taking_part)
    if error < UNDETERMINED:
        return f"{product} will be known to {100 * error:.2g} %"
    if len(taking_part) == 1:
        return f"{letters} is not determined ({_open(error)})"
    return f"{letters} only together: {product} is not determined ({_open(error)})"


def _open(error: float) -> str:
    if error >= NO_BOUND:
        return "these impacts have no information on it"
    return f"standard error of its logarithm {error:.2g}"


def _power(symbol: str, exponent: float, decimals: int) -> str:
    return symbol if exponent == 1 else f"{symbol}^{exponent:.{decimals}f}"
