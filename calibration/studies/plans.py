"""Plans of further measurements: what they determine, in numbers and words.

    A = A₀ + Σ_i ∇ε(v_i) ∇ε(v_i)ᵀ/V_i

is the information on ln θ, with A₀ that of a fit (the inverse of its covariance) or of priors, and V_i
the variance of a planned ε. A planned shot is a point of the kind that the fit's data are (a drop from
a height, a pair of velocities, a bounce, an ε with its own uncertainty); see `calibration.fitting.curves`.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import jax
import numpy as np
from jaxtyping import ArrayLike, Float

import softjax as sj
from calibration.data import RestitutionData
from calibration.data.json_file import plain
from calibration.errors import DataError
from calibration.fitting.collisions import Route
from calibration.fitting.curves import curve_and_slopes, further_variances, like_measured
from calibration.fitting.elements import DRAG, Element
from calibration.fitting.estimates import FitEstimates
from calibration.fitting.laws import OF_CONTACT, eps_up_of, numbers_in
from calibration.fitting.material import MaterialFit
from calibration.fitting.request import Request
from calibration.observables import RESTITUTION
from calibration.options import require_likelihood
from calibration.parameters import Parameter, as_parameter
from calibration.rounding import number
from calibration.symbols import symbol
from softjax.fields import numbers_of, options_of, shared_fields

USUAL_NOISE = 0.01  # standard uncertainty of ε unless stated
NO_BOUND = 100.0  # relative standard error from which on no number is given
ALMOST_NOTHING = 1e-6  # prior information on each ln θ: known to a factor e^1000 beforehand
LARGEST_ERROR = 0.1  # of a planned reading, over the reading
BY_HAND = (
    "to plan elsewhere take the law with values given by hand: `softjax sensitivity FILE.toml "
    "--set chi=… sigma=… psi=… --study design --from …`"
)

Column = Float[np.ndarray, "n"]
Matrices = Float[np.ndarray, "... p p"]
Errors = dict[str, float | None]


@dataclass(frozen=True)
class Plan:
    """A law whose parameters are to be known better, and what is known of them.

    Attributes:
        material: the law with its free parameters, and the data that planned shots are like.
        before: A₀, (p, p), on ln θ.
        uncertainty: standard uncertainty of a planned ε; None: as the fit's data have it.
        route: from the law to ε.
        result: the fit whose law it is; None without.
        of_inputs: covariance of ln θ of the fit's uncertain inputs, which no shot makes smaller.
    """

    material: MaterialFit
    before: Matrices
    uncertainty: Any
    route: Route
    result: FitEstimates | None = None
    of_inputs: Matrices | None = None

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.material.free.values())

    @property
    def truth(self) -> Float[np.ndarray, " p"]:
        values = self.material.model.inside(self.material.values)
        return np.array([float(values[name]) for name in self.material.free])

    @property
    def unit(self) -> Float[np.ndarray, " p"]:
        """Slopes in θ times these are in ln θ."""
        return _unit(self.truth)

    @property
    def symbols(self) -> tuple[str, ...]:
        """χ̃, or χ̃[name] where there are several data sets."""
        pairs, model = self.material.free.items(), self.material.model
        return tuple(symbol(n, model).text + label.removeprefix(n) for n, label in pairs)

    @property
    def by_inputs(self) -> dict[str, float]:
        """The part of uncertain inputs in each parameter, relative."""
        return relative_parts(self.names, self.of_inputs)

    @property
    def aims(self) -> dict[str, Float[np.ndarray, " p"]]:
        """Each parameter as a product of powers of all."""
        return dict(zip(self.names, np.eye(len(self.names)), strict=True))

    @property
    def taken_as_known(self) -> tuple[str, ...]:
        """Sentences: parameters that the fit did not determine or whose likelihood is skewed, drag of the air."""
        if self.result is None:
            return ()
        sentences, fit = [], self.result.material(self.material.name)
        for name in (name for name in fit.free if name not in self.material.free):
            estimate, why = fit.parameters.get(name), "is not determined"
            if estimate is not None and estimate.at_bound and estimate.value is not None:
                why = f"is at its bound {number(estimate.value, 4)}"
            sentences.append(f"{name} {why} and is taken as known: errors may be larger")
        parameters = [(name, fit.parameters.get(name)) for name in self.material.free]
        skewed = " and ".join(name for name, estimate in parameters if estimate and estimate.skewed)
        if skewed:
            sentences.append(
                f"the likelihood is skewed in {skewed}: errors now and expected follow from its curvature, "
                "and the fit's intervals may be much narrower or wider"
            )
        if fit.data.errors.by_drag is not None:  # a shot's errors are its own here
            sentences.append(
                f"{DRAG}, in common to all flights, is taken as known in the new ones: errors may be larger"
            )
        return tuple(sentences)

    def slopes(self, velocity: Column) -> tuple[Column, Float[np.ndarray, "n p"]]:
        """ε and θ ∂ε/∂θ."""
        value, slope = curve_and_slopes(self.material, velocity, self.route)
        return value, slope * self.unit

    def shots(self, velocity: Column) -> tuple[Matrices, Column]:
        """Information of each shot, (n, p, p), and u(ε); what is 0, as without rebound, adds none."""
        error, share = self.uncertainty, 1.0
        if error is None:
            variances = further_variances(self.material, velocity, lambda v: self.slopes(v)[0])
            error = np.sqrt(sum(variances.values()))
            share = self.material.family.information**0.5  # of errors with heavy tails
        value, slope = self.slopes(velocity)
        row = np.where(value > 0, share / error, 0)[:, None] * slope
        information = row[:, :, None] * row[:, None, :]
        return information, np.broadcast_to(np.asarray(error, float), velocity.shape)


def plan_of(
    law: Any,
    reach: Any,
    *,
    parameters: Mapping[str, Any] | None = None,
    route: Route = None,
    material: str | None = None,
    uncertainty: Any = None,
    measured: tuple[ArrayLike, ArrayLike] | None = None,
) -> Plan:
    """The plan for a law, or for one of a fit's materials.

    Args:
        reach: velocities that are planned, or the ends of what can be [m/s].
        measured: velocities and uncertainties of ε of what is there already, for a law.
        The others are those of `fisher_information`.
    """
    reach, is_fit = np.asarray(reach, float).ravel(), isinstance(law, FitEstimates)
    if not is_fit and not isinstance(law, sj.ContactLaw):
        raise DataError("law", law, "a contact law or a FitResult")
    own = {"parameters": parameters, "measured": measured} if is_fit else {"material": material}
    for name in (name for name, value in own.items() if value is not None):
        raise DataError(
            name, own[name], f"left out with a {'fit, which has its own' if is_fit else 'law'}"
        )
    with jax.enable_x64(True):
        if is_fit:
            plan = _of_fit(law, material, reach, route)
        else:
            old, size = ((), 1.0) if measured is None else measured
            v, u = checked_impacts(old, size, "measured")
            plan = _of_law(law, np.append(v, reach), parameters or {}, route)
            if v.size:
                information = replace(plan, uncertainty=u).shots(v)[0]
                plan = replace(plan, before=plan.before + np.sum(information, axis=0))
    contact = plan.material.data.contact
    if contact is not None and any(map(np.ndim, contact.leaves().values())):
        raise DataError("contact", "other for each impact", "one for all impacts")
    if not plan.names:
        accepted = "at least one that is free"
        if is_fit:
            accepted = (
                "determined by the data of the fit, one at least: fix another, or give it a prior"
            )
        raise DataError("parameters", "none", accepted)
    uncertainty = plan.uncertainty if uncertainty is None else uncertainty
    return replace(plan, uncertainty=uncertainty)


def checked_impacts(velocity: ArrayLike, uncertainty: ArrayLike | None, name: str):
    """Velocities, and uncertainties of one length if any."""
    v = np.asarray(velocity, float).ravel()
    if uncertainty is None:
        return v, None
    u = np.asarray(uncertainty, float)
    if not (np.all(np.isfinite(u)) and np.all(u > 0)):
        raise DataError("uncertainty", uncertainty, "positive")
    if u.ndim and u.shape != v.shape:
        raise DataError(name, f"{u.size} uncertainties", f"one for all, or {v.size}")
    return v, np.broadcast_to(u, v.shape)


def _of_law(law: Any, velocity: Column, parameters, route: Route) -> Plan:
    """Parameters as `fit` would take them, of data that have no values yet."""
    for name, value in numbers_of(law).items():
        if np.ndim(value):
            raise DataError(name, f"of shape {np.shape(value)}", "a single number")
    contact, ones = getattr(law, "contact", None), np.ones(len(velocity))
    limit = None if contact else getattr(law, "limit_velocity", None)
    data = RestitutionData(velocity, ones / 2, contact, name="plan", limit_velocity=limit)
    stated: dict[str, Any] = dict(parameters)
    for name, value in parameters.items():
        is_held = isinstance(value, Parameter) and not value.free and value.value is None
        if is_held and hasattr(law, name):
            stated[name] = Parameter(getattr(law, name), free=False)
    stated |= {name: getattr(law, name) for name in options_of(type(law))}
    for name in shared_fields(type(law)):
        is_free = name in stated and as_parameter(name, stated[name]).free
        stated[name] = Parameter(getattr(law, name), free=is_free)
    spec = Request((data,), stated).with_options(law=type(law)).specs()[0]
    free = [element for element in spec.local if element.parameter.free]
    material = MaterialFit(
        data=data,
        objective="model",
        model=spec.model,
        parameters={},
        derived={},
        values={element.name: _truth(law, element) for element in spec.local},
        labels={element.name: element.name for element in free},
        rms=math.nan,
        rms_empirical=None,
        empirical=None,
        converged=True,
        status=(),
    )
    plan = Plan(material, np.zeros((0, 0)), USUAL_NOISE, route)
    sizes = [element.parameter.prior[1] if element.parameter.prior else np.inf for element in free]
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
        value = eps_up_of(law) if name == "eps_up" else getattr(law, name, None)
    if value is None:  # such as c1
        raise DataError("parameters", name, "of those whose value the law has")
    if not parameter.free and parameter.value not in (None, value):
        accepted = f"the value of the law, {value:g}, if it is fixed"
        raise DataError(f"parameters[{name!r}]", parameter.value, accepted)
    if parameter.free and not local.declared.lower < value < local.declared.upper:
        raise DataError(name, value, f"{local.declared.accepted}, inside its range, or fixed")
    return float(value)


def _of_fit(result: FitEstimates, name: str | None, reach: Column, route: Route) -> Plan:
    material = result.material(name)
    require_likelihood(material.objective)
    low, high = material.known_from, material.known_to
    for outside in reach[(reach < low) | (reach > high)][:1]:
        end = f"up to {high:.4g} m/s" if low <= 0 else f"{low:.4g} m/s or more"
        accepted = f"{end}, where this fit knows the law; {BY_HAND}"
        raise DataError("velocity", float(outside), accepted)
    places = {label: k for k, label in enumerate(result.covariance_names)}
    known = np.isfinite(np.diag(result.covariance))
    labels = {name: label for name, label in material.free.items() if known[places[label]]}
    route = route or result.request.route_of_curve(material.model.law_type)
    noise = None if RESTITUTION in material.measured else USUAL_NOISE
    plan = Plan(replace(material, labels=labels), np.zeros((0, 0)), noise, route, result=result)
    rows = [places[label] for label in plan.names]
    scale = np.outer(plan.unit, plan.unit)
    covariance = result.statistical_covariance[np.ix_(rows, rows)] / scale
    budget = result.budget
    of_inputs = None if budget is None else budget.covariance(plan.names) / scale
    return replace(plan, before=np.linalg.inv(covariance), of_inputs=of_inputs)


def covariance_of(information: Matrices, of_inputs: Matrices | None = None) -> Matrices:
    """Covariance of ln θ; a negligible prior keeps it finite where the data determine nothing.

    `of_inputs`: the part of uncertain inputs, which no shot makes smaller.
    """
    of_points = np.linalg.inv(information + ALMOST_NOTHING * np.eye(information.shape[-1]))
    return of_points if of_inputs is None else of_points + of_inputs


def errors_of(
    information: Matrices,
    aims: Mapping[str, np.ndarray],
    by_inputs: Mapping[str, float] | None = None,
) -> Errors:
    """Standard errors of aim · ln θ, with the parts of uncertain inputs by name; None: not determined."""
    covariance, parts = covariance_of(information), by_inputs or {}
    errors = {
        name: float(np.hypot(np.sqrt(aim @ covariance @ aim), parts.get(name, 0.0)))
        for name, aim in aims.items()
    }
    return {name: error if error <= NO_BOUND else None for name, error in errors.items()}


def relative_parts(names: Sequence[str], of_inputs: Matrices | None) -> dict[str, float]:
    """Standard deviations of ln θ by uncertain inputs; empty without."""
    if of_inputs is None:
        return {}
    return dict(zip(names, np.sqrt(np.diag(of_inputs)).tolist(), strict=True))


def lowest_shot(material: MaterialFit, low: float, high: float) -> float:
    """The lowest velocity of planned shots whose reading is known to 10 % by its stated error [m/s]."""
    velocity = np.geomspace(high, low, 400)
    data, rows = material.data, np.flatnonzero(np.isfinite(material.data.restitution))
    if not rows.size:
        return low
    measured = data.errors.select(rows), data.velocity[rows], data.restitution[rows]
    expected = curve_and_slopes(material, velocity)[0]
    u_v = like_measured(*measured, velocity, expected, material.timing).velocity_uncertainty
    if u_v is None:
        return low
    share = u_v / (data.errors.measured_by.power * velocity * LARGEST_ERROR)
    k = int(np.argmax(share > 1))  # the first from above
    if k == 0:
        return low
    ends = slice(k - 1, k + 1)
    return float(np.exp(np.interp(0.0, np.log(share[ends]), np.log(velocity[ends]))))


@dataclass(frozen=True, eq=False, kw_only=True)
class Planned:
    """Planned shots, and what is known with them of p parameters θ.

    Attributes:
        names, symbols: the parameters.
        velocity, uncertainty: v [m/s] and standard uncertainty of ε of each shot, (n,), ascending in a
            design.
        before: relative errors that are known now, by a fit or priors or what was measured; None
            where nothing is.
        taken_as_known: a sentence for each parameter of the fit that has no standard error, on skewed
            likelihoods, and on the drag of the air.
    """

    names: tuple[str, ...]
    symbols: tuple[str, ...]
    velocity: Float[np.ndarray, " n"]
    uncertainty: Float[np.ndarray, " n"]
    before: Errors | None
    taken_as_known: tuple[str, ...]

    @property
    def _range(self) -> str:
        """ "0.5 to 6 m/s, standard uncertainty of ε 0.01 to 0.02"."""
        columns = self.velocity, self.uncertainty
        low, high = ([f"{of(x):.3g}" for x in columns] for of in (np.min, np.max))
        v, u = (a if a == b else f"{a} to {b}" for a, b in zip(low, high, strict=True))
        return f"{v} m/s, standard uncertainty of ε {u}"


@dataclass(frozen=True, eq=False, kw_only=True)
class Information(Planned):
    """Information of planned impacts about the parameters, by the likelihood.

    Attributes:
        truth: θ.
        matrix: Fisher's information on ln θ, (p, p), what was known before included.
        of_inputs: covariance of ln θ of uncertain inputs, which impacts make no smaller; None: none.
    """

    truth: Float[np.ndarray, " p"]
    matrix: Float[np.ndarray, "p p"]
    of_inputs: Float[np.ndarray, "p p"] | None = None

    @property
    def covariance(self) -> Float[np.ndarray, "p p"]:
        """Covariance of ln θ; NaN for what is not determined."""
        covariance = covariance_of(self.matrix, self.of_inputs)
        is_open = np.diag(covariance) > NO_BOUND**2
        return np.where(is_open | is_open[:, None], np.nan, covariance)

    @property
    def relative_errors(self) -> Errors:
        """Expected standard error of ln θ; None where the impacts do not determine θ."""
        aims = dict(zip(self.names, np.eye(len(self.names)), strict=True))
        return errors_of(self.matrix, aims, self.by_inputs)

    @property
    def by_inputs(self) -> dict[str, float]:
        """The part of uncertain inputs in each parameter, relative."""
        return relative_parts(self.names, self.of_inputs)

    @property
    def standard_errors(self) -> Errors:
        """Expected standard error of θ; None where the impacts do not determine it."""
        pairs = zip(self.relative_errors.items(), _unit(self.truth).tolist(), strict=True)
        return {n: None if e is None else unit * e for (n, e), unit in pairs}

    def to_dict(self) -> dict[str, Any]:
        """A dictionary for JSON; undefined numbers are None."""
        table = {
            "parameters": dict(zip(self.names, self.truth, strict=True)),
            "velocity": self.velocity,
            "uncertainty": self.uncertainty,
            "standard_errors": self.standard_errors,
            "relative_standard_errors": self.relative_errors,
            "information": self.matrix,
            "taken_as_known": self.taken_as_known,
            "before": self.before,
        }
        return plain(table)

    def __str__(self) -> str:
        where = f", {self._range}" if len(self.velocity) else ""
        lines = [f"{len(self.velocity)} planned impacts{where}"]
        of_each = zip(self.symbols, _unit(self.truth), self.relative_errors.items(), strict=True)
        for letter, unit, (name, error) in of_each:
            now = "" if self.before is None else f", now {_written(self.before[name], unit)}"
            lines.append(f"expected standard error of {letter}: {_written(error, unit)}{now}")
        return "\n".join([*lines, *self.taken_as_known])


def _written(error: float | None, unit: float) -> str:
    """An error, and its share of the value."""
    if error is None:
        return "not determined"
    share = number(100 * error, 2) if error < 1 else f"{100 * error:.0f}"
    return f"{error * unit:.3g} ({share} %)"


def _unit(theta: Float[np.ndarray, " p"]) -> Float[np.ndarray, " p"]:
    """|θ|, and 1 where θ = 0."""
    return np.where(theta == 0, 1.0, np.abs(theta))


def fisher_information(
    law: sj.ContactLaw | FitEstimates,
    velocity: ArrayLike = (),
    uncertainty: ArrayLike | None = None,
    route: sj.AbstractRoute | None = None,
    *,
    parameters: Mapping[str, Any] | None = None,
    material: str | None = None,
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
        route: from the law to ε; the energy balance where it can, unless stated.
        parameters: which are free, and their priors, as `fit` takes them: {"psi": 0.54} holds ψ,
            {"contact.youngs_modulus": cal.Parameter(prior=(2e11, 1e10))} is a nuisance.
        material: which one of a fit's.

    Raises:
        ValueError: naming the argument, its value and what is accepted.
    """
    v, u = checked_impacts(velocity, uncertainty, "velocity")
    plan = plan_of(law, v, uncertainty=u, parameters=parameters, route=route, material=material)
    if not (v.size or plan.result):
        raise DataError("velocity", "empty", "one velocity [m/s] or more")
    if not np.all(np.isfinite(v) & (v > 0)):
        raise DataError("velocity", velocity, "positive speeds in m/s")
    matrix, error = plan.before, v
    if v.size:
        with jax.enable_x64(True):
            added, error = plan.shots(v)
        matrix = plan.before + np.sum(added, axis=0)
    return Information(
        names=plan.names,
        symbols=plan.symbols,
        truth=plan.truth,
        velocity=v,
        uncertainty=error,
        matrix=matrix,
        of_inputs=plan.of_inputs,
        before=errors_of(plan.before, plan.aims, plan.by_inputs) if np.any(plan.before) else None,
        taken_as_known=plan.taken_as_known,
    )
