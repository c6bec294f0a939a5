"""Eq. (18), χ̃ = c1 + c2 E/Y: one line for several materials of Zhou's law, and for the next one.

c1 and c2 are shared parameters of the law, fitted to all curves from where each material ended by itself, and around
that: with two points below yield each, four materials ended 1.1 above the lowest cost of 16.64.
Materials scatter about the line by more than their errors u explain. With a relative scatter s,

    var χ̃_i = u_i² + s² (c1 + c2 x_i)²,    Σ (χ̃_i - c1 - c2 x_i)²/var χ̃_i = n - 2

gives s (0 where the sum without it is smaller), and for a further material of x = E/Y

    var χ̃ = (1, x) C (1, x)ᵀ + s² (c1 + c2 x)²

with C that of weighted least squares with these variances (of the fit itself where s is 0 or unknown), and
Student's t of n - 2. Two materials leave no degree of freedom: s is unknown then. ε_up of the further material
is the mean of the fitted ones (of logit ε_up), uncertain by their standard deviation times √(1 + 1/n), with
Student's t of n - 1.

Stated uncertainties of inputs move c1, c2 and the mean ε_up together: all materials that have an input are fitted
again with it moved by ± u, and half the differences are added in squares to errors and intervals. s is that of the
errors of the points alone, so that inputs of one material each are partly in it, too: intervals are rather too wide.

Source: Paule and Mandel, J. Res. Natl. Bur. Stand. 87, 377 (1982), of s.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import jax
import numpy as np
from scipy import special

import softjax as sj
from calibration.data.checks import checked_confidence, require
from calibration.data.inputs import Input
from calibration.errors import DataError
from calibration.fitting.budget import Budget, Contribution, budget_of, with_input_uncertainty
from calibration.fitting.components import ComponentFit, fit_component
from calibration.fitting.degrees_of_freedom import quantile
from calibration.fitting.elements import DRAG
from calibration.fitting.laws import LINE, eps_up_of, sigma_of
from calibration.fitting.material import Band, Estimate, MaterialFit
from calibration.fitting.problem import Problem
from calibration.fitting.request import Request, SetSpec, assemble
from calibration.parameters import Parameter

STARTS = 4  # of the fit on the line: few points below yield leave materials minima of their own
PSI = 0.5  # of a further material: above yield, where its curve is known, ψ acts through ε_up alone
ROUNDING = 1e-9  # of χ̃: errors below are not used; of ε_up: what is 1; of E/Y: what is one
TINY = np.finfo(float).tiny
LEAST_PART = 1e-3  # of χ̃, that a moved input leaves of it
LOSS = "logit_eps_up"  # the mean, in the budget of a line
THROUGH = {name: f"{name}_through_chi" for name in LINE}

Own = tuple[ComponentFit, SetSpec, int]  # of a data set with a χ̃: its fit, its options, its element


@dataclass(frozen=True)
class LineMaterial:
    """A material that the line was fitted to.

    Attributes:
        name: of the data set.
        yield_ratio: E/Y.
        chi, chi_error: χ̃ of its own fit.
        eps_up: ε_up of its own fit.
    """

    name: str
    yield_ratio: float
    chi: float
    chi_error: float | None
    eps_up: float


class Loss(NamedTuple):
    """logit ε_up of a further material: its mean, its error, and how far its interval goes."""

    mean: float
    error: float
    reach: float


@dataclass(frozen=True)
class Line:
    """Eq. (18), χ̃ = c1 + c2 E/Y, through all materials.

    Attributes:
        c1, c2: fitted directly to all curves at once.
        rms: of each material's curve with χ̃ from the line.
        through_chi: c1 and c2 through the fitted χ̃ with their weights instead.
        covariance: of c1 and c2, with what the scatter about the line and uncertain inputs add; None where
            the data have no noise.
        materials: those that it was fitted to, by themselves.
        options, area: of their laws and contacts.
        confidence: of intervals.
        budget: what uncertain inputs add to c1, c2 and the mean logit ε_up; None where none is stated.
    """

    c1: Estimate
    c2: Estimate
    rms: dict[str, float]
    through_chi: dict[str, Estimate]
    converged: bool
    covariance: tuple[tuple[float, float], tuple[float, float]] | None = None
    materials: tuple[LineMaterial, ...] = ()
    options: dict[str, str] | None = None
    area: str = "zhou"
    confidence: float = 0.95
    budget: Budget | None = None

    @property
    def statistical_covariance(self) -> np.ndarray | None:
        """The covariance without what uncertain inputs add."""
        if self.covariance is None or self.budget is None:
            return None if self.covariance is None else np.array(self.covariance)
        return np.array(self.covariance) - self.budget.covariance(LINE)

    @property
    def chi(self) -> dict[str, float]:
        """χ̃ on the line of each material that it was fitted to."""
        return {m.name: float(self._line(m.yield_ratio)) for m in self.materials}

    @property
    def scatter(self) -> float | None:
        """Relative standard deviation of χ̃ about the line in addition to the fits' errors; None: unknown."""
        ratio, chi, error = _columns(self.materials)
        return None if len(chi) < 3 else _scatter(self._line(ratio), chi, error)

    @property
    def has_noise(self) -> bool:
        """Whether the data have noise, so that c1 and c2 have errors; rounding is none."""
        return self.covariance is not None and _have_noise(self.materials)

    @property
    def range(self) -> tuple[float, float]:
        """The lowest and the highest E/Y of the fitted materials."""
        ratios = [material.yield_ratio for material in self.materials]
        return min(ratios), max(ratios)

    def unloading_factor(self, contact: sj.Contact, confidence: float | None = None) -> Estimate:
        """χ̃ that the line gives a further material.

        Raises:
            ValueError: where the line gives none that is positive.
        """
        if not isinstance(contact, sj.Contact) or np.ndim(contact.yield_ratio):
            raise DataError("contact", contact, "a softjax.Contact of single numbers")
        if contact.area != self.area:
            raise DataError("area", contact.area, f"{self.area}, as of the fitted materials")
        return self.at(_ratio(contact), confidence)

    def at(self, ratio: float, confidence: float | None = None) -> Estimate:
        """χ̃ at some E/Y."""
        level = self.confidence if confidence is None else checked_confidence(confidence)
        found = self._by_points(ratio, level)
        if self.budget is None or found.standard_error is None:
            return found
        assert found.value is not None
        assert found.low is not None
        assert found.high is not None
        # χ̃ is positive: in its logarithm
        budget, z = self.budget.of_sum("chi", self._weights(ratio)), float(quantile(level, np.inf))
        down, up = (z * move / found.value for move in budget.moves("chi"))
        return replace(
            found,
            standard_error=float(np.hypot(found.standard_error, budget.input_error("chi"))),
            statistical_error=found.standard_error,
            low=found.value * float(np.exp(-np.hypot(np.log(found.value / found.low), down))),
            high=found.value * float(np.exp(np.hypot(np.log(found.high / found.value), up))),
        )

    def _weights(self, ratio: float) -> dict[str, float]:
        """c1 and c2 in χ̃ at some E/Y."""
        return dict(zip(LINE, (1.0, ratio), strict=True))

    def _by_points(self, ratio: float, level: float) -> Estimate:
        """χ̃ at some E/Y with errors of the points and of the scatter about the line alone."""
        value, scatter = float(self._line(ratio)), self.scatter or 0.0
        if not value > 0:
            raise DataError("E/Y", ratio, f"such that c1 + c2 E/Y is positive; it is {value:.4g}")
        covariance: Any = self.statistical_covariance
        if not self.has_noise:
            if not scatter:
                return Estimate(value, method="derived")
            x, chi, u = _columns(self.materials)
            covariance = _least_squares(x, chi, u**2 + (scatter * self._line(x)) ** 2)[1]
        at = np.array([1.0, ratio])
        error = float(at @ np.asarray(covariance) @ at + (scatter * value) ** 2) ** 0.5
        # χ̃ is positive: in its logarithm
        reach = float(quantile(level, self._degrees)) * error / value
        low, high = value * np.exp(-reach), value * np.exp(min(reach, 700.0))
        return Estimate(value, error, float(low), float(high), "derived")

    def law(self, contact: sj.Contact) -> sj.Zhou:
        """Zhou's law of a further material above first yield: χ̃ of the line, and the mean ε_up.

        Where fewer than two materials determine ε_up it is 1: ε is then the plastic part ε_p alone.

        Args:
            contact: its bodies, of the area that was fitted with.

        Raises:
            ValueError: naming the argument, its value and what is accepted.
        """
        loss = self._loss(self.confidence)
        return self._law(contact, self.unloading_factor(contact).value, loss and loss.mean)

    def band(self, contact: sj.Contact, velocity: Any, *, confidence: float | None = None) -> Band:
        """ε(v) of a further material above first yield, with what its χ̃ and ε_up are uncertain by.

        NaN below first yield. The limits are those of χ̃ and of ε_up at the ends of its interval, and of both
        as each uncertain input of the fitted materials moves them, their distances from the curve added in
        squares; of ε_p, where no ε_up is known, those of χ̃ alone.

        Args:
            contact: its bodies, of the area that was fitted with.
            velocity: [m/s], any shape.
            confidence: that of the fit where left out.

        Raises:
            ValueError: naming the argument, its value and what is accepted.
        """
        level = self.confidence if confidence is None else checked_confidence(confidence)
        velocity = np.asarray(velocity, float)
        flat = velocity.ravel()
        require("velocity", flat, lambda v: v >= 0, "a speed of 0 m/s or more")
        self.unloading_factor(contact, level)  # refuses bodies that the line is not for
        ratio, loss = _ratio(contact), self._loss(level)
        chi, centre = self._by_points(ratio, level), None if loss is None else loss.mean
        assert chi.value is not None

        def curve(value: float | None, logit: float | None) -> np.ndarray:
            law = self._law(contact, value, logit)
            with jax.enable_x64(True):
                return np.asarray(sj.restitution(law, flat).coefficient)

        value = curve(chi.value, centre)
        moved, reaches = [], []
        if chi.low is not None:
            moved.append((curve(chi.low, centre), curve(chi.high, centre)))
            reaches.append(float(quantile(level, self._degrees)))
        if loss is not None:
            step = loss.reach * loss.error
            moved.append((curve(chi.value, loss.mean - step), curve(chi.value, loss.mean + step)))
            reaches.append(loss.reach)
        for changes in self._moved(ratio) if moved else ():
            least, z = LEAST_PART * chi.value, float(quantile(level, np.inf))
            pair = [
                curve(max(chi.value + c, least), None if centre is None else centre + by) - value
                for c, by in changes
            ]
            moved.append((value + z * np.minimum(*pair), value + z * np.maximum(*pair)))
            reaches.append(z)
        known = flat >= float(np.asarray(contact.critical_velocity))
        unknown = np.full(len(flat), np.nan)
        low, high, errors = unknown, unknown, unknown
        if moved:
            ends = np.array([np.sort(pair, axis=0) for pair in moved])
            size = 2 * np.reshape(reaches, (-1, 1))
            errors = np.linalg.norm((ends[:, 1] - ends[:, 0]) / size, axis=0)
            down, up = np.maximum([value - ends[:, 0], ends[:, 1] - value], 0)
            low = np.maximum(value - np.linalg.norm(down, axis=0), 0.0)
            high = np.minimum(value + np.linalg.norm(up, axis=0), 1.0)
        parts = (value, low, high, errors)
        columns = (np.where(known, part, np.nan).reshape(velocity.shape) for part in parts)
        return Band(velocity, *columns)

    def remarks(self, contact: sj.Contact) -> list[str]:
        """Remarks about a prediction, one matter a line."""
        chi, ratio, count = self.unloading_factor(contact), _ratio(contact), len(self.materials)
        scatter, ends = self.scatter, f", {100 * self.confidence:g} % interval {{:.4g}} to {{:.4g}}"
        known = "" if chi.low is None else ends.format(chi.low, chi.high)
        lines = [f"unloading factor {chi.value:.4g}{known}, by Eq. (18) at E/Y = {ratio:.4g}"]
        of_scatter = "unknown, as two materials leave no degree of freedom"
        if scatter is not None:
            freedom = f"{count} materials, {count - 2} degree{'s' * (count > 3)} of freedom"
            of_scatter = f"{100 * scatter:.2g} % ({freedom})"
        lines.append(f"scatter about the line: {of_scatter}")
        loss, above = self._loss(self.confidence), "above first yield"
        if loss is None:
            lines.append(
                f"the curve is the plastic part ε_p alone, {above}: fewer than two of the fitted materials "
                "determine ε_up"
            )
        else:
            step = loss.reach * loss.error
            z, moves = float(quantile(self.confidence, np.inf)), (0.0, 0.0)
            if self.budget is not None:
                moves = self.budget.moves(LOSS)
            down, up = (float(np.hypot(step, z * move)) for move in moves)
            mean, low, high = special.expit(loss.mean + np.array([0.0, -down, up]))
            lines.append(
                f"the curve is ε, {above}, with ε_up {mean:.4g}{ends.format(low, high)}: the mean of logit "
                "ε_up of the fitted materials with its whole scatter, in which the errors of the fits are"
            )
        least, most = self.range
        if not least <= ratio <= most:
            text = f"warning: extrapolation: E/Y = {ratio:.4g}"
            lines.append(f"{text}, the fitted materials have {least:.4g} to {most:.4g}")
        return lines

    def _moved(self, ratio: float) -> list[tuple[tuple[float, float], tuple[float, float]]]:
        """Changes of χ̃ at some E/Y and of logit ε_up by each uncertain input, moved up and down."""
        if self.budget is None:
            return []
        of_chi = self.budget.of_sum("chi", self._weights(ratio))
        return [
            (
                (part.up["chi"], own.up.get(LOSS, 0.0)),
                (part.down["chi"], own.down.get(LOSS, 0.0)),
            )
            for part, own in zip(of_chi.inputs, self.budget.inputs, strict=True)
        ]

    @property
    def _degrees(self) -> float:
        """Degrees of freedom of a prediction."""
        return len(self.materials) - 2 if self.scatter else np.inf

    def _line(self, ratio: Any) -> Any:
        c1, c2 = (np.nan if c.value is None else c.value for c in (self.c1, self.c2))
        return c1 + c2 * ratio

    def _loss(self, confidence: float) -> Loss | None:
        """logit ε_up of a further material; None where fewer than two materials determine one.

        A law at an end of its range has the least number there is, or rounds to its end.
        """
        logits = _logits([material.eps_up for material in self.materials])
        logits = logits[np.isfinite(logits)]
        count = len(logits)
        if count < 2:
            return None
        error = float(np.std(logits, ddof=1)) * (1 + 1 / count) ** 0.5
        return Loss(float(np.mean(logits)), error, float(quantile(confidence, count - 1)))

    def _law(self, contact: sj.Contact, chi: float | None, logit: float | None) -> sj.Zhou:
        eps_up = 1.0 if logit is None else float(special.expit(logit))
        with jax.enable_x64(True):
            sigma = abs(float(sigma_of(contact, eps_up, PSI)))  # 0, not -0, of ε_up = 1
            return sj.Zhou(contact, chi=chi, sigma=sigma, psi=PSI, **(self.options or {}))


def _ratio(contact: sj.Contact | None) -> float:
    assert contact is not None
    return float(np.mean(np.asarray(contact.yield_ratio)))


def _logits(eps_up: Sequence[float]) -> np.ndarray:
    """logit ε_up; NaN of an end of its range."""
    values = np.array(eps_up, float)
    return special.logit(np.where((values > TINY) & (values < 1 - ROUNDING), values, np.nan))


def _columns(materials: tuple[LineMaterial, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """E/Y and χ̃ of the materials, and its standard errors, 0 where the data have no noise."""
    rows = [(m.yield_ratio, m.chi, m.chi_error or 0.0) for m in materials]
    x, chi, u = np.array(rows, float).reshape(-1, 3).T
    return x, chi, u


def _have_noise(materials: tuple[LineMaterial, ...]) -> bool:
    """Whether errors of all χ̃ are more than rounding, and so are weights."""
    _, chi, u = _columns(materials)
    return bool(np.all(u > ROUNDING * chi))


def _scatter(line: np.ndarray, chi: np.ndarray, errors: np.ndarray) -> float:
    """s of Paule and Mandel."""
    from scipy.optimize import brentq

    degrees = len(chi) - 2

    def excess(log_s: float) -> float:
        variance = errors**2 + (np.exp(log_s) * line) ** 2
        return float(np.sum((chi - line) ** 2 / variance)) - degrees

    largest = float(np.sqrt(np.sum((chi / line - 1) ** 2) / degrees))  # without errors
    if largest <= ROUNDING or excess(np.log(largest) - 20) <= 0:
        return 0.0
    return float(np.exp(brentq(excess, np.log(largest) - 20, np.log(largest) + 1e-9)))


def _least_squares(x: np.ndarray, y: np.ndarray, variance: np.ndarray):
    """c of y = c1 + c2 x, its covariance, and how each y moves it, (2, n)."""
    design = np.stack([np.ones_like(x), x], axis=1)
    weighted = design / variance[:, None]
    covariance = np.linalg.pinv(design.T @ weighted)
    influence = covariance @ weighted.T
    return influence @ y, covariance, influence


def _rows(covariance: np.ndarray) -> tuple[tuple[float, float], tuple[float, float]]:
    (a, b), (c, d) = covariance.tolist()
    return (a, b), (c, d)


class LineFit(NamedTuple):
    """The line, and the fit on it, of the materials that have a χ̃ of their own."""

    line: Line
    request: Request
    fit: ComponentFit


def fit_line(request: Request, fits: list[ComponentFit]) -> LineFit | None:
    """The line through all materials with a χ̃ of their own; None where these have fewer than two E/Y.

    c1 and c2 are fitted to all curves with what else was free. That weighs a material by 1/u² of its χ̃, so its
    scatter about the line moves c1 and c2 as it moves the line of least squares with these weights.
    """
    with_chi, confidence = _with_chi(fits), request.options.confidence
    materials = tuple(_material(*each) for each in with_chi)
    x, chi, u = _columns(materials)
    if request.options.unloading_line is None or len(x) < 2 or np.ptp(x) <= ROUNDING * np.max(x):
        return None
    has_noise = _have_noise(materials)
    c, normal, influence = _least_squares(x, chi, u**2 if has_noise else np.ones(len(x)))
    own, joint = _on_one_line(request, with_chi, c)
    names, specs = [e.name for e in joint.component.elements], joint.component.specs
    places = [names.index(name) for name in LINE]
    values, slope, known = joint.theta[places], joint.slope[places], joint.uncertainty
    on_line = values[0] + values[1] * x
    scatter = _scatter(on_line, chi, u) if len(x) > 2 else 0.0
    added = (influence * (scatter * on_line) ** 2) @ influence.T + (0.0 if has_noise else np.nan)
    covariance = known.covariance[np.ix_(places, places)] * np.outer(slope, slope) + added
    reach = quantile(confidence, len(x) - 2 if scatter else known.parameter_dof[places])
    c1, c2 = _with_errors(values, covariance, reach)
    problem, contact = joint.final.problem, specs[0].data.contact
    assert contact is not None
    residual = problem.linearise(joint.z[None]).prediction[0] - problem.points.value
    line = Line(
        c1=c1,
        c2=c2,
        rms={
            spec.data.name: float(np.sqrt(np.mean(residual[problem.of_restitution(g)] ** 2)))
            for g, spec in enumerate(specs)
        },
        through_chi=dict(zip(LINE, _with_errors(c, normal + added, reach), strict=True)),
        converged=bool(joint.final.ends.converged[0]),
        covariance=_rows(covariance) if np.all(np.isfinite(covariance)) else None,
        materials=materials,
        options=dict(specs[0].model.options),
        area=contact.area,
        confidence=confidence,
    )
    return LineFit(line, own, joint)


def _on_one_line(
    request: Request, own: Sequence[Own], c: np.ndarray
) -> tuple[Request, ComponentFit]:
    """The fit with c1 and c2 for every χ̃, and what else was free, from where each material ended.

    Args:
        c: c1 and c2 to begin with.
    """
    on_line = {name: Parameter(float(value)) for name, value in zip(LINE, c, strict=True)}
    parameters = []
    for fit, spec, k in own:
        elements, bound_side = fit.component.elements, fit.uncertainty.bound_side
        # what is at an end of its range there begins anew
        z = np.where(bound_side != 0, fit.component.start, fit.z)
        theta = fit.final.problem.transform.physical(z)
        stated = {e.name: e.parameter for e in spec.local if e.parameter.value is not None}
        for name, place in fit.component.places(elements[k].sets[0]).items():
            start = {"value": float(theta[place])}
            stated[name] = elements[place].parameter.model_copy(update=start)
        stated = {name: value for name, value in stated.items() if name not in ("chi", DRAG)}
        parameters.append(stated | on_line | dict(spec.model.options))
    names = {spec.data.name for _, spec, _ in own}
    datasets = tuple(data for data in request.datasets if data.name in names)
    options = {"law": "zhou", "starts": STARTS, "optimiser": "levenberg-marquardt"}
    joint = replace(request, datasets=datasets, parameters=parameters).with_options(**options)
    (component,) = assemble(joint)
    return joint, fit_component(component, joint.options)


def with_inputs(
    found: LineFit,
    inputs: Mapping[str, Sequence[Input]],
    budget: Budget,
    fits: Mapping[str, MaterialFit],
) -> Line:
    """The line with what uncertain inputs add: the fit on it is continued with each of them moved.

    Args:
        inputs: of each data set by its name.
        budget: of the materials' own fits, whose laws move too.
        fits: of the materials by themselves.
    """
    line, request = found.line, found.request
    of_sets = [inputs[data.name] for data in request.datasets]
    estimates = {name: getattr(line, name) for name in LINE}
    of_line = budget_of(request, [found.fit], of_sets, estimates, {}, _coefficients)
    if of_line is None:
        return line
    alone = {member: part for part in budget.inputs for member in part.members}
    parts = []
    for part in of_line.inputs:
        up, down = _through_laws(line, alone[part.members[0]], fits)
        parts.append(replace(part, up=part.up | up, down=part.down | down, laws={}))
    of_line = replace(of_line, inputs=tuple(parts))
    of = lambda estimate, label: with_input_uncertainty(estimate, of_line, label, line.confidence)  # noqa: E731
    added = of_line.covariance(LINE)
    return replace(
        line,
        c1=of(line.c1, "c1"),
        c2=of(line.c2, "c2"),
        through_chi={name: of(line.through_chi[name], THROUGH[name]) for name in LINE},
        covariance=line.covariance and _rows(np.array(line.covariance) + added),
        budget=of_line,
    )


def _coefficients(fit: ComponentFit, problem: Problem, z: np.ndarray) -> dict[str, float]:
    """c1 and c2 of the fit on the line."""
    theta = problem.transform.physical(z)
    pairs = zip(fit.component.elements, theta, strict=True)
    return {e.name: float(value) for e, value in pairs if e.name in LINE}


def _through_laws(
    line: Line, part: Contribution, fits: Mapping[str, MaterialFit]
) -> list[dict[str, float]]:
    """Changes of the line through the fitted χ̃ and of the mean logit ε_up by one input, moved up and down."""
    u = _columns(line.materials)[2]
    variance = u**2 if _have_noise(line.materials) else np.ones(len(u))

    def of(laws: Sequence[Any]) -> np.ndarray:
        x, chi = np.array([(_ratio(law.contact), float(law.chi)) for law in laws]).T
        logits = _logits([eps_up_of(law) for law in laws])
        loss = np.mean(logits[np.isfinite(logits)]) if np.any(np.isfinite(logits)) else 0.0
        return np.append(_least_squares(x, chi, variance)[0], loss)

    base = [fits[material.name].law for material in line.materials]
    ends = []
    for side in range(2):
        moved = [
            jax.tree.unflatten(jax.tree.structure(law), part.laws[m.name][side])
            if m.name in part.laws
            else law
            for law, m in zip(base, line.materials, strict=True)
        ]
        changes = (of(moved) - of(base)).tolist()
        ends.append(dict(zip((*THROUGH.values(), LOSS), changes, strict=True)))
    return ends


def _with_errors(values: np.ndarray, covariance: np.ndarray, reach: Any) -> list[Estimate]:
    """c1 and c2 with errors, and intervals of so many of these; none where they are not known."""
    errors = np.sqrt(np.diag(covariance))
    columns = np.transpose([values, errors, values - reach * errors, values + reach * errors])
    known = [[None if np.isnan(x) else x for x in row] for row in columns.tolist()]
    return [Estimate(x, u, low, high, "wald", True) for x, u, low, high in known]


def _material(fit: ComponentFit, spec: SetSpec, k: int) -> LineMaterial:
    g = next(g for g, other in enumerate(fit.component.specs) if other is spec)
    law = fit.final.problem.law_of(fit.theta, g)
    variance = float(fit.uncertainty.covariance[k, k] * fit.slope[k] ** 2)
    return LineMaterial(
        spec.data.name,
        _ratio(spec.data.contact),
        float(fit.theta[k]),
        variance**0.5 if np.isfinite(variance) else None,
        eps_up_of(law),
    )


def _with_chi(fits: list[ComponentFit]) -> list[Own]:
    """Data sets of Zhou's law with a χ̃ of their own: the fit, its options, its element."""
    by_set = {}
    for fit in fits:
        for g, spec in enumerate(fit.component.specs):
            for k, e in enumerate(fit.component.elements):
                if e.name == "chi" and e.sets == (g,) and spec.model.key == "zhou":
                    by_set[fit.component.sets[g]] = fit, spec, k
    return [by_set[g] for g in sorted(by_set)]
