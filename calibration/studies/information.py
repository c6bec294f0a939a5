"""What data can tell before they are taken: expected standard errors, and directions in words."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import jax
import numpy as np
from jaxtyping import ArrayLike, Float

import softjax as sj
from calibration.data.json_file import plain
from calibration.errors import DataError
from calibration.fitting.problem import Element
from calibration.fitting.result import FitResult
from calibration.studies.planned import Column, Plan, equations, relative_unit
from calibration.studies.planning import checked_impacts, plan_of, taken_as_known

NOT_KNOWN = 1.0  # relative standard error from which a combination counts as left open
NO_BOUND = 100.0  # and from which no number is given for it
TAKES_PART = 0.2  # share of a parameter in a direction from which it is named
ELSEWHERE = 0.01  # relative difference from which it is told that a fit finds other values


@dataclass(frozen=True, eq=False)
class Information:
    """What n impacts tell of p parameters θ through a fit.

    Attributes:
        objective: "model" or "two-step".
        names, symbols: the parameters.
        truth: θ of the law.
        found: θ that the fit finds on the impacts without noise: the same under `model`.
        velocity, uncertainty: v [m/s] and standard uncertainty of ε of each impact, (n,); those
            measured first.
        matrix: information on ln θ, (p, p): Fisher's for `model`; for `two-step` the inverse of
            the stacked equations' covariance, Aᵀ (middle)⁻¹ A.
        covariance: of ln θ, (p, p), as the fit's own; NaN for what the impacts do not determine.
        taken_as_known: a sentence for each parameter of the fit that has no standard error, and on
            errors that its points share.
    """

    objective: str
    names: tuple[str, ...]
    symbols: tuple[str, ...]
    truth: Float[np.ndarray, "p"]
    found: Float[np.ndarray, "p"]
    velocity: Float[np.ndarray, "n"]
    uncertainty: Float[np.ndarray, "n"]
    matrix: Float[np.ndarray, "p p"]
    covariance: Float[np.ndarray, "p p"]
    taken_as_known: tuple[str, ...] = ()

    @property
    def relative_errors(self) -> dict[str, float | None]:
        """Expected standard error of ln θ; None where the impacts do not determine θ."""
        errors = np.sqrt(np.maximum(np.diag(self.covariance), 0))
        return {n: _finite(e) for n, e in zip(self.names, errors.tolist(), strict=True)}

    @property
    def standard_errors(self) -> dict[str, float | None]:
        """Expected standard error of θ; None where the impacts do not determine it."""
        relative = self.relative_errors.values()
        pairs = zip(self.names, self.found.tolist(), relative, strict=True)
        return {name: None if e is None else abs(value or 1.0) * e for name, value, e in pairs}

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
        return tuple(_sentence(self.symbols, *pair) for pair in zip(values, vectors.T, strict=True))

    @property
    def remark(self) -> str:
        """A sentence where the fit would find other values than the law's; else nothing."""
        moved = [
            f"{symbol} = {found:.4g} instead of {truth:.4g}"
            for symbol, found, truth in zip(self.symbols, self.found, self.truth, strict=True)
            if abs(found - truth) > ELSEWHERE * abs(truth)
        ]
        if not moved:
            return ""
        return f"without noise {self.objective} finds {', '.join(moved)} from these impacts"

    def to_dict(self) -> dict[str, Any]:
        """For JSON: undefined numbers are None."""
        values, vectors = self.directions
        return plain(
            {
                "objective": self.objective,
                "parameters": dict(zip(self.names, self.truth, strict=True)),
                "found": dict(zip(self.names, self.found, strict=True)),
                "standard_errors": self.standard_errors,
                "relative_standard_errors": self.relative_errors,
                "information": self.matrix,
                "eigenvalues": values,
                "directions": vectors.T,
                "words": self.words,
                "taken_as_known": self.taken_as_known,
            }
        )

    def __str__(self) -> str:
        lines = f"{len(self.velocity)} impacts, {self.objective}", *self.words
        return "\n".join(filter(None, (*lines, self.remark, *self.taken_as_known)))


def fisher_information(
    law: sj.ContactLaw | FitResult,
    velocity: ArrayLike = (),
    uncertainty: ArrayLike | None = None,
    objective: str | None = None,
    route: sj.EnergyBalance | sj.ClosedForm | sj.ODE | None = None,
    *,
    parameters: Mapping[str, Any] | None = None,
    material: str | None = None,
) -> Information:
    """What measurements of ε at these velocities will tell of a law's parameters.

    Args:
        law: with the parameters as far as they are known; or a fit, whose points count as well and
            whose objective, free parameters, priors and uncertainties are its own, its loss taken
            as squared. Errors that its points share (groups, bounce trains) count as in the fit,
            without what Kenward and Roger add for variances that are estimates. Of the parameters
            those count that it determined.
        velocity: v [m/s] of the impacts, measured or planned; for a fit further ones, which share
            no error: each is of a specimen, or launch, of its own.
        uncertainty: standard uncertainty of each ε, one number or (n,); 0.01 where left out, for a
            fit the one that its points have, the scatter between its groups included.
        objective: "model" (default) or, of Zhou's law, "two-step".
        route: from the law to ε; the energy balance where it can, unless told.
        parameters: which are free, and their priors, as `fit` takes them: {"psi": 0.54} holds ψ,
            {"contact.youngs_modulus": cal.Parameter(prior=(2e11, 1e10))} is a nuisance.
        material: which one of a fit's.

    Raises:
        ValueError: naming the argument, its value and what is accepted.
    """
    plan = plan_of(
        law, velocity, parameters=parameters, objective=objective, route=route, material=material
    )
    error = plan.noise if uncertainty is None else uncertainty
    v, u = checked_impacts(velocity, error, "velocity")
    if not v.size + plan.measured[plan.place][0].size:
        raise DataError("velocity", "empty", "one velocity [m/s] or more")
    found = information_of(plan, v, u)
    return replace(found, taken_as_known=taken_as_known(law, material, found.names, plan))


def information_of(plan: Plan, velocity: Column, uncertainty: Column) -> Information:
    """What a plan's fit makes of these impacts beside the measured ones."""
    with jax.enable_x64(True):
        component, z, known = plan.fitted(velocity, uncertainty)
        told = equations(plan, velocity, uncertainty, z)
    slope = told.slope_before + np.sum(told.slope, axis=0)
    middle = told.middle_before + told.score.T @ told.score
    problem = component.stages[-1][1]
    unit = relative_unit(problem, z)
    return Information(
        objective=plan.objective,
        names=tuple(e.label for e in component.elements),
        symbols=tuple(map(symbol_of, component.elements)),
        truth=np.array([e.start for e in component.elements]),
        found=problem.transform.physical(z),
        velocity=problem.points.velocity,
        uncertainty=known.noise.deviation[0],
        matrix=slope if plan.is_likelihood else slope.T @ np.linalg.pinv(middle) @ slope,
        covariance=known.covariance[0] * np.outer(unit, unit),
    )


def symbol_of(element: Element) -> str:
    """χ̃, or χ̃[name] where there are several data sets."""
    return (element.declared.symbol or element.name) + element.label.removeprefix(element.name)


def _finite(error: float) -> float | None:
    return error if math.isfinite(error) and error < NO_BOUND else None


def _sentence(symbols: Sequence[str], eigenvalue: float, direction: np.ndarray) -> str:
    error = math.inf if eigenvalue <= 0 else eigenvalue**-0.5
    taking_part = [i for i, share in enumerate(direction) if abs(share) > TAKES_PART]
    product = " · ".join(_power(symbols[i], float(direction[i])) for i in taking_part)
    letters = " and ".join(symbols[i] for i in taking_part)
    if error < NOT_KNOWN:
        return f"{product} will be known to {100 * error:.2g} %"
    if len(taking_part) == 1:
        return f"{letters} is left open ({_open(error)})"
    return f"{letters} only together: {product} is left open ({_open(error)})"


def _open(error: float) -> str:
    if error >= NO_BOUND:
        return "these impacts do not tell it"
    return f"standard error of its logarithm {error:.2g}"


def _power(symbol: str, exponent: float) -> str:
    return symbol if abs(exponent - 1) < 0.005 else f"{symbol}^{exponent:.2f}"
