"""Eq. (18) for the next material: its unloading factor, its law and its curve, with what they are worth.

    χ̃ = c1 + c2 E/Y

Materials scatter about the line by more than their errors u explain. With a relative scatter s,

    var χ̃_i = u_i² + s² (c1 + c2 x_i)²,    Σ (χ̃_i - c1 - c2 x_i)²/var χ̃_i = n - 2

gives s (0 where the sum without it is smaller), and for a further material of x = E/Y

    var χ̃ = (1, x) C (1, x)ᵀ + s² (c1 + c2 x)²

with C that of weighted least squares with these variances (of the fit itself where s is 0 or unknown), and
Student's t of n - 2. Two materials leave no freedom: s is unknown then. ε_up of the further material, or σ and ψ
where each fitted material has its own, is as stated, else the mean of the fitted ones (of logit ε_up, ln σ, ln ψ),
uncertain by their standard deviation, times √(1 + 1/n), with Student's t of n - 1.

Source: Paule and Mandel, J. Res. Natl. Bur. Stand. 87, 377 (1982), of s.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import jax
import numpy as np

import softjax as sj
from calibration.data.checks import as_number, checked_confidence, require
from calibration.errors import DataError
from calibration.fitting.estimate import Band, Estimate
from calibration.fitting.laws import sigma_of
from calibration.fitting.uncertainty import quantile

PSI = 0.5  # stands in where ε_up is what is known: above yield it acts through ε_up alone
ROUNDING = 1e-9  # of χ̃: errors below tell nothing


@dataclass(frozen=True)
class LineMaterial:
    """A material that the line was fitted to.

    Attributes:
        name: of the data set.
        yield_ratio: E/Y.
        chi, chi_error: χ̃ of its own fit.
        eps_up: ε_up of its own fit.
        sigma, psi: of its own fit; None where these act through ε_up alone.
    """

    name: str
    yield_ratio: float
    chi: float
    chi_error: float | None
    eps_up: float
    sigma: float | None = None
    psi: float | None = None


class Loss(NamedTuple):
    """ε_up, σ or ψ of the further material, on the scale where it is taken as normal."""

    name: str
    centre: float
    error: float
    degrees: float


@dataclass(frozen=True)
class Line:
    """Eq. (18), χ̃ = c1 + c2 E/Y, through all materials.

    Attributes:
        c1, c2: fitted directly to all curves at once (None where that was not asked for, then
            through the fitted χ̃).
        rms: of each material's curve with χ̃ from the line.
        chi: what the line gives for each material.
        through_chi: c1 and c2 through the fitted χ̃ with their weights instead.
        method: "curves" or "weighted".
        covariance: of c1 and c2; None where the data have no noise.
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
        """Relative standard deviation of χ̃ about the line beside the fits' errors; None: unknown."""
        if len(self.materials) < 3:
            return None
        return _scatter(self._line(self._ratios), self._chi, self._errors, len(self.materials) - 2)

    @property
    def range(self) -> tuple[float, float]:
        """The lowest and the highest E/Y of the fitted materials."""
        return float(np.min(self._ratios)), float(np.max(self._ratios))

    def unloading_factor(self, contact: sj.Contact, confidence: float | None = None) -> Estimate:
        """χ̃ that the line gives a further material.

        Raises:
            ValueError: where the line gives none that is positive.
        """
        return self.at(_ratio(contact), confidence)

    def at(self, ratio: float, confidence: float | None = None) -> Estimate:
        """The same at some E/Y."""
        level = self.confidence if confidence is None else checked_confidence(confidence)
        return self._at(ratio, level)

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
            eps_up: restitution at first yield; or `sigma` and `psi` of Eq. (17). Where left out, the
                mean of the fitted materials.

        Raises:
            ValueError: naming the argument, its value and what is accepted.
        """
        self._check(contact)
        losses, given = self._losses(eps_up, sigma, psi)
        chi = self.unloading_factor(contact).value
        return self._law(contact, chi, given | {one.name: one.centre for one in losses})

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
        """ε(v) of a further material, with what its χ̃ and its ε_up, or σ and ψ, are uncertain by.

        NaN below first yield where only ε_up is known. The limits are those of each unknown at the
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
        centres = given | {one.name: one.centre for one in losses}

        def curve(value: float | None = chi.value, **moved: float) -> np.ndarray:
            law = self._law(contact, value, centres | moved)
            with jax.enable_x64(True):
                return np.asarray(sj.restitution(law, flat).coefficient)

        value = curve()
        moved = [(curve(chi.low), curve(chi.high), _reach(chi, level))]
        for one in losses:
            reach = float(quantile(level, one.degrees))
            low, high = (curve(**{one.name: one.centre + s * reach * one.error}) for s in (-1, 1))
            moved.append((low, high, reach))
        down, up, error = np.zeros(flat.shape), np.zeros(flat.shape), np.zeros(flat.shape)
        for low, high, reach in moved:
            down += np.maximum(value - np.minimum(low, high), 0.0) ** 2
            up += np.maximum(np.maximum(low, high) - value, 0.0) ** 2
            error += (0.5 * (high - low) / reach) ** 2
        low, high = np.maximum(value - np.sqrt(down), 0.0), np.minimum(value + np.sqrt(up), 1.0)
        known = np.ones(flat.shape, bool)
        if "psi" not in centres:
            known = flat >= float(np.asarray(contact.critical_velocity))
        parts = (value, low, high, np.sqrt(error))
        columns = (np.where(known, part, np.nan).reshape(velocity.shape) for part in parts)
        return Band(velocity, *columns)

    def left_out(self, confidence: float | None = None) -> dict[str, Estimate]:
        """χ̃ of each material as the line through the others predicts it, by weighted least squares.

        Raises:
            ValueError: for fewer than three materials.
        """
        level = self.confidence if confidence is None else checked_confidence(confidence)
        if len(self.materials) < 3:
            raise DataError("materials", len(self.materials), "3 or more, to leave one out")
        found = {}
        for one in self.materials:
            others = tuple(other for other in self.materials if other is not one)
            c1, c2 = _through(others)
            line = replace(
                self, c1=Estimate(c1), c2=Estimate(c2), materials=others, covariance=None
            )
            found[one.name] = line._at(one.yield_ratio, level)
        return found

    def remarks(
        self,
        contact: sj.Contact,
        *,
        eps_up: float | None = None,
        sigma: float | None = None,
        psi: float | None = None,
    ) -> list[str]:
        """What a prediction rests on, a line each."""
        chi, ratio = self.unloading_factor(contact), _ratio(contact)
        told = f"unloading factor {chi.value:.4g}"
        if chi.standard_error is not None:
            told += f", {100 * self.confidence:g} % interval {chi.low:.4g} to {chi.high:.4g}"
        lines = [f"{told}, by Eq. (18) at E/Y = {ratio:.4g}"]
        scatter, count = self.scatter, len(self.materials)
        if scatter is None:
            lines.append("scatter about the line: unknown, as two materials leave no freedom")
        else:
            freedom = f"{count} materials, {count - 2} degree{'s' * (count > 3)} of freedom"
            lines.append(f"scatter about the line: {100 * scatter:.2g} % ({freedom})")
        for one in self._losses(eps_up, sigma, psi)[0]:
            reach = float(quantile(self.confidence, one.degrees)) * one.error
            low, high = (_plain(one.name, one.centre + s * reach) for s in (-1, 1))
            value = _plain(one.name, one.centre)
            lines.append(
                f"{one.name} {value:.4g}, {100 * self.confidence:g} % interval {low:.4g} to {high:.4g}: "
                "the mean of the fitted materials and their scatter"
            )
        least, most = self.range
        if not least <= ratio <= most:
            lines.append(
                f"warning: extrapolation: E/Y = {ratio:.4g}, the fitted materials have {least:.4g} "
                f"to {most:.4g}"
            )
        return lines

    @property
    def _ratios(self) -> np.ndarray:
        return np.array([one.yield_ratio for one in self.materials])

    @property
    def _chi(self) -> np.ndarray:
        return np.array([one.chi for one in self.materials])

    @property
    def _errors(self) -> np.ndarray:
        return _errors_of(self.materials)

    def _line(self, ratio: Any) -> Any:
        assert self.c1.value is not None
        assert self.c2.value is not None
        return self.c1.value + self.c2.value * ratio

    def _check(self, contact: Any) -> None:
        if not isinstance(contact, sj.Contact) or np.ndim(contact.yield_ratio):
            raise DataError("contact", contact, "a softjax.Contact of single numbers")
        if contact.area != self.area:
            raise DataError("area", contact.area, f"{self.area}, as of the fitted materials")

    def _at(self, ratio: float, level: float) -> Estimate:
        """χ̃ at E/Y, with the interval at a level of confidence."""
        value, scatter = float(self._line(ratio)), self.scatter
        if not value > 0:
            raise DataError("E/Y", ratio, f"such that c1 + c2 E/Y is positive; it is {value:.4g}")
        covariance, degrees = self.covariance, np.inf
        if scatter:
            variance = self._errors**2 + (scatter * self._line(self._ratios)) ** 2
            design = np.stack([np.ones(len(variance)), self._ratios], axis=1)
            covariance = np.linalg.inv(design.T @ (design / variance[:, None]))
            degrees = len(self.materials) - 2
        elif covariance is None and np.all(self._errors > 0):
            design = np.stack([np.ones(len(self.materials)), self._ratios], axis=1)
            covariance = np.linalg.inv(design.T @ (design / self._errors[:, None] ** 2))
        if covariance is None:
            return Estimate(value, method="derived")
        at = np.array([1.0, ratio])
        error = float(at @ np.asarray(covariance) @ at + ((scatter or 0.0) * value) ** 2) ** 0.5
        reach = float(quantile(level, degrees)) * error / value  # χ̃ is positive: in its logarithm
        low, high = value * np.exp(-reach), value * np.exp(min(reach, 700.0))
        return Estimate(value, error, float(low), float(high), "derived")

    def _losses(self, eps_up, sigma, psi) -> tuple[list[Loss], dict[str, float]]:
        """Means of what is not stated, and what is, on the scales of `Loss`."""
        told = {"eps_up": eps_up, "sigma": sigma, "psi": psi}
        stated = {name: value for name, value in told.items() if value is not None}
        for name, value in stated.items():
            inside = (lambda x: 0 < x < 1) if name == "eps_up" else (lambda x: x > 0)
            accepted = "between 0 and 1" if name == "eps_up" else "a positive number"
            stated[name] = _scaled(name, as_number(name, value, inside, accepted))
        if "eps_up" in stated:
            if len(stated) > 1:
                raise DataError("eps_up", eps_up, "left out with sigma and psi")
            return [], stated
        separate = all(None not in (one.sigma, one.psi) for one in self.materials)
        if stated and not separate and len(stated) < 2:
            missing = "psi" if "sigma" in stated else "sigma"
            raise DataError(missing, "missing", "given, as the fit knows ε_up only")
        names = ("sigma", "psi") if separate or stated else ("eps_up",)
        return [self._mean(name) for name in names if name not in stated], stated

    def _mean(self, name: str) -> Loss:
        """Of the fitted materials; those at an end of the range tell no mean."""
        values = np.array([getattr(one, name) for one in self.materials], float)
        inside = (values > 0) & (values < (1 if name == "eps_up" else np.inf))
        scaled = np.array([_scaled(name, float(value)) for value in values[inside]])
        if len(scaled) < 2:
            accepted = "given: fewer than two of the fitted materials have one"
            raise DataError(name, "missing", accepted)
        count = len(scaled)
        spread = float(np.std(scaled, ddof=1)) * (1 + 1 / count) ** 0.5
        return Loss(name, float(np.mean(scaled)), spread, count - 1.0)

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


def _reach(chi: Estimate, level: float) -> float:
    """Half the interval of χ̃ in standard errors, on the logarithmic scale."""
    if not chi.standard_error or chi.high is None or chi.low is None or chi.value is None:
        return float(quantile(level, np.inf))
    return 0.5 * np.log(chi.high / chi.low) / (chi.standard_error / chi.value)


def _scaled(name: str, value: float) -> float:
    return float(np.log(value / (1 - value)) if name == "eps_up" else np.log(value))


def _plain(name: str, value: float) -> float:
    with np.errstate(over="ignore"):
        return float(1 / (1 + np.exp(-value)) if name == "eps_up" else np.exp(value))


def _errors_of(materials: Sequence[LineMaterial]) -> np.ndarray:
    """Standard errors of χ̃; 0 where the data have no noise."""
    return np.array([one.chi_error or 0.0 for one in materials])


def _scatter(line: np.ndarray, chi: np.ndarray, errors: np.ndarray, degrees: int) -> float:
    """s of Paule and Mandel."""
    from scipy.optimize import brentq

    def excess(log_s: float) -> float:
        variance = errors**2 + (np.exp(log_s) * line) ** 2
        return float(np.sum((chi - line) ** 2 / variance)) - degrees

    largest = float(np.sqrt(np.sum((chi / line - 1) ** 2) / degrees))  # without errors
    if largest <= ROUNDING or excess(np.log(largest) - 20) <= 0:
        return 0.0
    return float(np.exp(brentq(excess, np.log(largest) - 20, np.log(largest) + 1e-9)))


def _through(materials: Sequence[LineMaterial]) -> tuple[float, float]:
    """c1 and c2 by least squares through fitted χ̃, weighted by their errors and their scatter."""
    x = np.array([one.yield_ratio for one in materials])
    chi, errors = np.array([one.chi for one in materials]), _errors_of(materials)
    design, scatter = np.stack([np.ones_like(x), x], axis=1), 0.0
    c = np.zeros(2)
    for _ in range(20):
        size = np.sqrt(errors**2 + (scatter * chi) ** 2)
        if not np.all(size > ROUNDING * chi):
            size = chi
        c = np.linalg.lstsq(design / size[:, None], chi / size, rcond=None)[0]
        if len(materials) < 3:
            break
        scatter = _scatter(np.maximum(design @ c, 1e-3 * chi), chi, errors, len(materials) - 2)
    return float(c[0]), float(c[1])
