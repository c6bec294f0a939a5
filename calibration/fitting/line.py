"""Eq. (18), χ̃ = c1 + c2 E/Y: one line for several materials of Zhou's law, and for the next one.

Materials scatter about the line by more than their errors u explain. With a relative scatter s,

    var χ̃_i = u_i² + s² (c1 + c2 x_i)²,    Σ (χ̃_i - c1 - c2 x_i)²/var χ̃_i = n - 2

gives s (0 where the sum without it is smaller), and for a further material of x = E/Y

    var χ̃ = (1, x) C (1, x)ᵀ + s² (c1 + c2 x)²

with C that of weighted least squares with these variances (of the fit itself where s is 0 or unknown), and
Student's t of n - 2. Two materials leave no degree of freedom: s is unknown then. ε_up of the further material, or σ and ψ
where each fitted material has its own, is as stated, else the mean of the fitted ones (of logit ε_up, ln σ, ln ψ),
uncertain by their standard deviation, times √(1 + 1/n), with Student's t of n - 1.

Source: Paule and Mandel, J. Res. Natl. Bur. Stand. 87, 377 (1982), of s.
"""

from dataclasses import dataclass, replace
from typing import Any

import jax
import numpy as np

import softjax as sj
from calibration.data.checks import as_number, checked_confidence, require
from calibration.errors import DataError
from calibration.fitting.laws import LINE, several_yields, sigma_of
from calibration.fitting.material import Band, Estimate
from calibration.fitting.problem import DRAG
from calibration.fitting.profiles import estimate_of
from calibration.fitting.request import Request, SetSpec
from calibration.fitting.stages import ComponentFit, StageFit, fitted
from calibration.fitting.summary import derived_of, eps_up_of
from calibration.fitting.uncertainty import quantile
from calibration.parameters import Parameter

PSI = 0.5  # stands in where ε_up is what is known: above yield it acts through ε_up alone
STEEPEST = 20.0  # ψ at the end of an interval: there is no loss below first yield
ROUNDING = 1e-9  # of χ̃: errors below are not used; of ε_up: what is 1
TINY = np.finfo(float).tiny
WIDE = 30.0  # ratio of an interval's ends, from which on it is of no use; of ε_up their difference
WIDE_EPS_UP = 0.1


@dataclass(frozen=True)
class LineMaterial:
    """A material that the line was fitted to.

    Attributes:
        name: of the data set.
        yield_ratio: E/Y.
        chi, chi_error: χ̃ of its own fit.
        eps_up: ε_up of its own fit.
        psi: of its own fit; None where it acts through ε_up alone.
    """

    name: str
    yield_ratio: float
    chi: float
    chi_error: float | None
    eps_up: float
    psi: float | None = None


@dataclass(frozen=True)
class Line:
    """Eq. (18), χ̃ = c1 + c2 E/Y, through all materials.

    Attributes:
        c1, c2: fitted directly to all curves at once (None where that was not requested, then
            through the fitted χ̃).
        rms: of each material's curve with χ̃ from the line.
        chi: what the line gives for each material.
        through_chi: c1 and c2 through the fitted χ̃ with their weights instead.
        method: "curves" or "weighted".
        covariance: of c1 and c2, with what the scatter about the line adds; None where the data have
            no noise.
        materials: those that it was fitted to, by themselves.
        options, area: of their laws and contacts.
        confidence: of intervals.
    """

    c1: Estimate
    c2: Estimate
    rms: dict[str, float]
    chi: dict[str, Estimate]
    through_chi: dict[str, Estimate] | None
    converged: bool
    method: str = "curves"
    covariance: tuple[tuple[float, float], tuple[float, float]] | None = None
    materials: tuple[LineMaterial, ...] = ()
    options: dict[str, str] | None = None
    area: str = "zhou"
    confidence: float = 0.95

    @property
    def scatter(self) -> float | None:
        """Relative standard deviation of χ̃ about the line in addition to the fits' errors; None: unknown."""
        ratio, chi, error = self._columns
        return None if len(chi) < 3 else _scatter(self._line(ratio), chi, error)

    @property
    def has_noise(self) -> bool:
        """Whether the data have noise, so that c1 and c2 have errors; rounding is none."""
        _, chi, error = self._columns
        return self.covariance is not None and bool(np.all(error > ROUNDING * chi))

    @property
    def range(self) -> tuple[float, float]:
        """The lowest and the highest E/Y of the fitted materials."""
        return float(np.min(self._columns[0])), float(np.max(self._columns[0]))

    def unloading_factor(self, contact: sj.Contact, confidence: float | None = None) -> Estimate:
        """χ̃ that the line gives a further material.

        Raises:
            ValueError: where the line gives none that is positive.
        """
        return self.at(_ratio(contact), confidence)

    def at(self, ratio: float, confidence: float | None = None) -> Estimate:
        """χ̃ at some E/Y."""
        level = self.confidence if confidence is None else checked_confidence(confidence)
        value, scatter = float(self._line(ratio)), self.scatter or 0.0
        if not value > 0:
            raise DataError("E/Y", ratio, f"such that c1 + c2 E/Y is positive; it is {value:.4g}")
        covariance, (x, y, u) = self.covariance, self._columns
        if not self.has_noise and (scatter or np.all(u > 0)):
            covariance = _least_squares(x, y, u**2 + (scatter * self._line(x)) ** 2)[1]
        if covariance is None:
            return Estimate(value, method="derived")
        at = np.array([1.0, ratio])
        error = float(at @ np.asarray(covariance) @ at + (scatter * value) ** 2) ** 0.5
        # χ̃ is positive: in its logarithm
        reach = float(quantile(level, self._degrees)) * error / value
        low, high = value * np.exp(-reach), value * np.exp(min(reach, 700.0))
        return Estimate(value, error, float(low), float(high), "derived")

    def law(
        self,
        contact: sj.Contact,
        *,
        eps_up: float | None = None,
        sigma: float | None = None,
        psi: float | None = None,
    ) -> sj.Zhou:
        """Zhou's law of a further material, with χ̃ of the line.

        Args:
            contact: its bodies, of the area that was fitted with.
            eps_up: restitution at first yield, or `sigma` of Eq. (17) in its place. Where both are
                left out, the mean of the fitted materials.
            psi: of Eq. (17), which acts below first yield; the mean where left out.

        Raises:
            ValueError: naming the argument, its value and what is accepted.
        """
        self._check(contact)
        losses, given = self._losses(eps_up, sigma, psi)
        chi = self.unloading_factor(contact).value
        return self._law(contact, chi, given | {name: mean for name, (mean, *_) in losses.items()})

    def band(
        self,
        contact: sj.Contact,
        velocity: Any,
        *,
        eps_up: float | None = None,
        sigma: float | None = None,
        psi: float | None = None,
        confidence: float | None = None,
    ) -> Band:
        """ε(v) of a further material, with what its χ̃, ε_up and ψ are uncertain by.

        NaN below first yield where ψ is unknown. The limits are those of each unknown at the
        ends of its interval, their distances from the curve added in squares.

        Args:
            velocity: [m/s], any shape.

        The other arguments are those of `law`.

        Raises:
            ValueError: naming the argument, its value and what is accepted.
        """
        self._check(contact)
        level = self.confidence if confidence is None else checked_confidence(confidence)
        losses, given = self._losses(eps_up, sigma, psi)
        velocity = np.asarray(velocity, float)
        flat = velocity.ravel()
        require("velocity", flat, lambda v: v >= 0, "a speed of 0 m/s or more")
        chi = self.unloading_factor(contact, level)
        centres = given | {name: mean for name, (mean, *_) in losses.items()}

        def curve(value: float | None = chi.value, **moved: float) -> np.ndarray:
            law = self._law(contact, value, centres | moved)
            with jax.enable_x64(True):
                return np.asarray(sj.restitution(law, flat).coefficient)

        value = curve()
        moved = [(curve(chi.low), curve(chi.high), float(quantile(level, self._degrees)))]
        for name, (mean, error, degrees) in losses.items():
            reach = float(quantile(level, degrees))
            most = np.log(STEEPEST) if name == "psi" else np.inf
            low, high = mean - reach * error, min(mean + reach * error, max(mean, most))
            moved.append((curve(**{name: low}), curve(**{name: high}), reach))
        ends = [(np.minimum(a, b), np.maximum(a, b)) for a, b, _ in moved]
        down = np.sqrt(sum(np.maximum(value - low, 0.0) ** 2 for low, _ in ends))
        up = np.sqrt(sum(np.maximum(high - value, 0.0) ** 2 for _, high in ends))
        errors = np.sqrt(sum((0.5 * (high - low) / reach) ** 2 for low, high, reach in moved))
        known = np.ones(flat.shape, bool)
        if "psi" not in centres:
            known = flat >= float(np.asarray(contact.critical_velocity))
        parts = (value, np.maximum(value - down, 0.0), np.minimum(value + up, 1.0), errors)
        columns = (np.where(known, part, np.nan).reshape(velocity.shape) for part in parts)
        return Band(velocity, *columns)

    def left_out(self, confidence: float | None = None) -> dict[str, Estimate]:
        """χ̃ of each material as the line through the others predicts it, by weighted least squares.

        Raises:
            ValueError: for fewer than three materials.
        """
        if len(self.materials) < 3:
            raise DataError("materials", len(self.materials), "3 or more, to leave one out")
        predictions = {}
        for material in self.materials:
            rest = tuple(other for other in self.materials if other is not material)
            others = replace(self, materials=rest, covariance=None)
            c1, c2 = map(Estimate, others._through())
            line = replace(others, c1=c1, c2=c2)
            predictions[material.name] = line.at(material.yield_ratio, confidence)
        return predictions

    def remarks(
        self,
        contact: sj.Contact,
        *,
        eps_up: float | None = None,
        sigma: float | None = None,
        psi: float | None = None,
    ) -> list[str]:
        """Assumptions of a prediction, one in each line."""
        chi, ratio = self.unloading_factor(contact), _ratio(contact)
        text = f"unloading factor {chi.value:.4g}"
        if chi.standard_error is not None:
            text += f", {100 * self.confidence:g} % interval {chi.low:.4g} to {chi.high:.4g}"
        lines = [f"{text}, by Eq. (18) at E/Y = {ratio:.4g}"]
        if chi.high is not None and chi.low is not None and chi.high > WIDE * chi.low:
            text = "warning: this interval is too wide to be of use: fit more materials"
            lines.append(f"{text}, as {len(self.materials)} leave the line few degrees of freedom")
        scatter, count = self.scatter, len(self.materials)
        if scatter is None:
            lines.append(
                "scatter about the line: unknown, as two materials leave no degree of freedom"
            )
        else:
            freedom = f"{count} materials, {count - 2} degree{'s' * (count > 3)} of freedom"
            lines.append(f"scatter about the line: {100 * scatter:.2g} % ({freedom})")
        for name, (mean, error, degrees) in self._losses(eps_up, sigma, psi)[0].items():
            reach = float(quantile(self.confidence, degrees)) * error
            value, low, high = (_plain(name, mean + side * reach) for side in (0, -1, 1))
            lines.append(
                f"{name} {value:.4g}, {100 * self.confidence:g} % interval {low:.4g} to {high:.4g}: "
                "the mean of the fitted materials and their scatter"
            )
            if high > WIDE * low or (name == "eps_up" and high - low > WIDE_EPS_UP):
                lines.append(
                    f"warning: a mean of {degrees + 1:.0f} materials has few degrees of freedom, and this "
                    f"interval is too wide to be of use: state {name} (--{name.replace('_', '-')})"
                )
        least, most = self.range
        if not least <= ratio <= most:
            lines.append(
                f"warning: extrapolation: E/Y = {ratio:.4g}, the fitted materials have {least:.4g} "
                f"to {most:.4g}"
            )
        return lines

    @property
    def _columns(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """E/Y and χ̃ of the materials, and its standard errors, 0 where the data have no noise."""
        rows = [(m.yield_ratio, m.chi, m.chi_error or 0.0) for m in self.materials]
        x, y, u = np.array(rows, float).reshape(-1, 3).T
        return x, y, u

    @property
    def _degrees(self) -> float:
        """Degrees of freedom of a prediction."""
        return len(self.materials) - 2 if self.scatter else np.inf

    def _through(self) -> tuple[float, float]:
        """c1 and c2 by least squares through fitted χ̃, weighted by their errors and their scatter."""
        ratio, chi, errors = self._columns
        c, scatter = np.zeros(2), 0.0
        for _ in range(20):
            size = np.sqrt(errors**2 + (scatter * chi) ** 2)
            size = size if np.all(size > ROUNDING * chi) else chi
            c = _least_squares(ratio, chi, size**2)[0]
            if len(chi) < 3:
                break
            scatter = _scatter(np.maximum(c[0] + c[1] * ratio, 1e-3 * chi), chi, errors)
        return float(c[0]), float(c[1])

    def _line(self, ratio: Any) -> Any:
        assert self.c1.value is not None
        assert self.c2.value is not None
        return self.c1.value + self.c2.value * ratio

    def _check(self, contact: Any) -> None:
        if not isinstance(contact, sj.Contact) or np.ndim(contact.yield_ratio):
            raise DataError("contact", contact, "a softjax.Contact of single numbers")
        if contact.area != self.area:
            raise DataError("area", contact.area, f"{self.area}, as of the fitted materials")

    def _losses(self, eps_up, sigma, psi):
        """Mean, error and degrees of freedom of each loss that is not stated, and the stated ones.

        On the scales where their errors are normal.
        """
        arguments = {"eps_up": eps_up, "sigma": sigma, "psi": psi}
        stated = {name: value for name, value in arguments.items() if value is not None}
        for name, value in stated.items():
            inside = (lambda x: 0 < x < 1) if name == "eps_up" else (lambda x: x > 0)
            accepted = "between 0 and 1" if name == "eps_up" else "a positive number"
            stated[name] = _scaled(name, as_number(name, value, inside, accepted))
        if {"eps_up", "sigma"} <= {*stated}:
            raise DataError("eps_up", eps_up, "left out with sigma")
        if "sigma" in stated and psi is None:
            raise DataError("psi", "missing", "given with sigma")
        names = [] if {"eps_up", "sigma"} & {*stated} else ["eps_up"]
        if psi is None and len(self._inside("psi")) > 1:  # else unknown below first yield
            names.append("psi")
        return {name: self._mean(name) for name in names}, stated

    def _mean(self, name: str) -> tuple[float, float, float]:
        """Mean of the fitted materials, its error for a further one, and degrees of freedom."""
        scaled = self._inside(name)
        count = len(scaled)
        if count < 2:
            accepted = "given: fewer than two fitted materials have one off the ends of its range"
            raise DataError(name, "missing", accepted)
        error = float(np.std(scaled, ddof=1)) * (1 + 1 / count) ** 0.5
        return float(np.mean(scaled)), error, count - 1.0

    def _inside(self, name: str) -> list[float]:
        """Values of the fitted materials on their scale, without those at an end of the range."""
        values = [x for material in self.materials if (x := getattr(material, name)) is not None]
        # a law at an open end of its range has the least number there is, or rounds to its end
        most = 1 - ROUNDING if name == "eps_up" else np.inf
        return [_scaled(name, x) for x in values if TINY < x < most]

    def _law(self, contact: sj.Contact, chi: float | None, losses: dict[str, float]) -> sj.Zhou:
        values = {name: _plain(name, value) for name, value in losses.items()}
        psi = values.get("psi", PSI)
        with jax.enable_x64(True):
            sigma = values.get("sigma")
            if sigma is None:
                sigma = float(sigma_of(contact, values["eps_up"], psi))
            return sj.Zhou(contact, chi=chi, sigma=sigma, psi=psi, **(self.options or {}))


def _ratio(contact: sj.Contact) -> float:
    return float(np.asarray(contact.yield_ratio))


def _scaled(name: str, value: float) -> float:
    return float(np.log(value / (1 - value)) if name == "eps_up" else np.log(value))


def _plain(name: str, value: float) -> float:
    with np.errstate(over="ignore"):
        return float(1 / (1 + np.exp(-value)) if name == "eps_up" else np.exp(value))


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
    """c of y = c1 + c2 x, and its covariance."""
    design = np.stack([np.ones_like(x), x], axis=1)
    covariance = np.linalg.pinv(design.T @ (design / variance[:, None]))
    return covariance @ (design.T @ (y / variance)), covariance


def fit_line(request: Request, fits: list[ComponentFit]) -> tuple[Line, StageFit | None] | None:
    """The line through all materials with a χ̃ of their own; None where there are fewer than two.

    Fitted to all curves at once, with what else was free; or through the fitted χ̃ with their
    weights.
    """
    with_chi = _with_chi(fits)
    if request.options.unloading_line is None or len(with_chi) < 2:
        return None
    through, normal = _through_chi(with_chi, request.options.confidence)
    joint = _joint(request, with_chi, through)
    if request.options.unloading_line == "weighted":
        return _with_materials(_weighted(joint, with_chi, through), with_chi, normal, request), None
    names = [e.name for e in joint.component.elements]
    c1, c2 = (
        estimate_of(joint, names.index(name), None, request.options.confidence) for name in LINE
    )
    sets = enumerate(joint.component.specs)
    chi = {s.data.name: derived_of(joint, g, request.options.confidence)["chi"] for g, s in sets}
    line = Line(c1, c2, _rms(joint, joint.z), chi, through, bool(joint.final.ends.converged[0]))
    places = [names.index(name) for name in LINE]
    slope = joint.slope[places]
    covariance = joint.uncertainty.covariance[np.ix_(places, places)] * np.outer(slope, slope)
    return _with_materials(line, with_chi, covariance, request), joint.final


def _with_materials(line: Line, with_chi, covariance: np.ndarray | None, request: Request) -> Line:
    """The line with the data that a prediction for a further material needs."""
    materials = []
    for fit, spec, k in with_chi:
        place = next(i for i, other in enumerate(fit.component.specs) if other is spec)
        law = fit.final.problem.law_of(fit.theta, place)
        variance = _variance(fit, k)
        error = variance**0.5 if np.isfinite(variance) else None
        separate = not spec.by_eps_up and not several_yields(spec.data.contact)
        psi = float(law.psi) if separate else None
        name, chi = spec.data.name, float(fit.theta[k])
        materials.append(LineMaterial(name, _mean_ratio(spec), chi, error, eps_up_of(law), psi))
    rows = None
    if covariance is not None and np.all(np.isfinite(covariance)) and np.any(covariance):
        (a, b), (_, d) = covariance.tolist()
        rows = ((a, b), (b, d))
    first, confidence = with_chi[0][1], request.options.confidence
    common = {"options": dict(first.model.options), "area": first.data.contact.area}
    return _with_scatter(
        replace(line, covariance=rows, materials=tuple(materials), confidence=confidence, **common)
    )


def _with_scatter(line: Line) -> Line:
    """Errors of c1 and c2 that include the scatter of χ̃ about the line.

    Both estimates weigh a material by 1/u² of its χ̃, so its deviation moves them as it moves the line of
    least squares with these weights.
    """
    x, chi, u = line._columns
    if np.all(u <= ROUNDING * chi):  # rounding is no error, of a c1 near 0 either
        bare: dict[str, Any] = {"standard_error": None, "low": None, "high": None}
        c1, c2 = replace(line.c1, **bare), replace(line.c2, **bare)
        return replace(line, c1=c1, c2=c2, covariance=None)
    if not line.scatter or not line.has_noise:
        return line
    design = np.stack([np.ones_like(x), x], axis=1)
    influence = _least_squares(x, chi, u**2)[1] @ (design / u[:, None] ** 2).T
    added = (influence * (line.scatter * line._line(x)) ** 2) @ influence.T
    covariance = np.asarray(line.covariance) + added
    reach = float(quantile(line.confidence, line._degrees))

    def widened(estimate: Estimate, more: float) -> Estimate:
        if estimate.value is None or estimate.standard_error is None:
            return estimate
        error = float(np.hypot(estimate.standard_error, more**0.5))
        low, high = estimate.value - reach * error, estimate.value + reach * error
        return replace(estimate, standard_error=error, low=low, high=high)

    c1, c2 = map(widened, (line.c1, line.c2), np.diag(added))
    through = line.through_chi
    if through is not None:
        pairs = zip(through.items(), np.diag(added), strict=True)
        through = {name: widened(estimate, more) for (name, estimate), more in pairs}
    (a, b), (_, d) = covariance.tolist()
    return replace(line, c1=c1, c2=c2, through_chi=through, covariance=((a, b), (b, d)))


def _with_chi(fits: list[ComponentFit]) -> list[tuple[ComponentFit, SetSpec, int]]:
    """Data sets of Zhou's law with a χ̃ of their own: the fit, its options, its element."""
    by_set = {}
    for fit in fits:
        for g, spec in enumerate(fit.component.specs):
            for k, e in enumerate(fit.component.elements):
                if e.name == "chi" and e.sets == (g,) and spec.model.key == "zhou":
                    by_set[fit.component.sets[g]] = fit, spec, k
    return [by_set[g] for g in sorted(by_set)]


def _joint(request: Request, with_chi, through: dict[str, Estimate]) -> ComponentFit:
    """All curves with every χ̃ on one line, from where each was alone; everything else as requested."""
    on_line, parameters = {name: Parameter(through[name].value) for name in LINE}, []
    for fit, spec, k in with_chi:
        stated = {e.name: e.parameter for e in spec.local if e.parameter.value is not None}
        elements, theta = fit.component.elements, fit.final.problem.transform.physical(fit.z)
        for name, place in fit.component.places(elements[k].sets[0]).items():
            start = {"value": float(theta[place])}
            stated[name] = elements[place].parameter.model_copy(update=start)
        stated = {name: value for name, value in stated.items() if name not in ("chi", DRAG)}
        parameters.append(stated | on_line | dict(spec.model.options))
    names = {spec.data.name for _, spec, _ in with_chi}
    datasets = tuple(data for data in request.datasets if data.name in names)
    joint = replace(request, datasets=datasets, parameters=parameters)
    options = {"law": "zhou", "starts": 1, "optimiser": "levenberg-marquardt"}
    return fitted(joint.with_options(**options))[0]


def _through_chi(with_chi, confidence: float) -> tuple[dict[str, Estimate], np.ndarray | None]:
    """Weighted least squares through the fitted χ̃, and the covariance; equal weights without errors."""
    rows = [(_mean_ratio(spec), fit.theta[k], _variance(fit, k)) for fit, spec, k in with_chi]
    ratio, chi, variance = np.transpose(rows)
    # of data without scatter an error is what rounding left: no weight
    usable = np.all(variance > (0.1 * ROUNDING * chi) ** 2) and np.all(np.isfinite(variance))
    c, normal = _least_squares(ratio, chi, variance if usable else np.ones(len(chi)))
    degrees = min(float(fit.uncertainty.degrees[k]) for fit, _, k in with_chi)
    reach = quantile(confidence, degrees)
    table = {}
    for i, name in enumerate(LINE):
        error = float(np.sqrt(normal[i, i])) if usable else None
        ends = (None, None) if error is None else (c[i] - reach * error, c[i] + reach * error)
        low, high = (None if end is None else float(end) for end in ends)
        table[name] = Estimate(float(c[i]), error, low, high, "wald", True)
    return table, normal if usable else None


def _variance(fit: ComponentFit, k: int) -> float:
    """Variance of an element in physical units."""
    return float(fit.uncertainty.covariance[k, k] * fit.slope[k] ** 2)


def _mean_ratio(spec: SetSpec) -> float:
    """E/Y of a data set."""
    assert spec.data.contact is not None
    return float(np.mean(np.asarray(spec.data.contact.yield_ratio)))


def _weighted(joint: ComponentFit, with_chi, through: dict[str, Estimate]) -> Line:
    """The line through the fitted χ̃, and how the curves follow it."""
    z, elements = np.array(joint.z), joint.component.elements
    for k, e in enumerate(elements):
        if e.name in LINE:
            z[k] = through[e.name].value
    c1, c2 = (through[name] for name in LINE)
    assert c1.value is not None
    assert c2.value is not None
    on_line = {s.data.name: Estimate(c1.value + c2.value * _mean_ratio(s)) for _, s, _ in with_chi}
    return Line(c1, c2, _rms(joint, z), on_line, through, True, "weighted")


def _rms(joint: ComponentFit, z: np.ndarray) -> dict[str, float]:
    """Rms of each material's curve with χ̃ from the line."""
    problem = joint.final.problem
    residual = problem.linearise(z[None]).prediction[0] - problem.points.value
    return {
        data.name: float(np.sqrt(np.mean(residual[problem.of_restitution(g)] ** 2)))
        for g, data in enumerate(problem.datasets)
    }
