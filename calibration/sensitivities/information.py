"""What data can tell before they are taken: expected standard errors, and directions in words."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import ArrayLike, Float

import softjax as sj
from calibration.curve.options import COEFFICIENTS
from calibration.sensitivities import estimating
from calibration.sensitivities.inputs import symbol

NOT_KNOWN = 1.0  # relative standard error from which a combination counts as left open
NO_BOUND = 100.0  # and from which no number is given for it
TAKES_PART = 0.2  # share of a parameter in a direction from which it is named


@dataclass(frozen=True, eq=False)
class Information:
    """What n impacts tell of p parameters θ through an objective.

    Attributes:
        objective: "two-step" or "model".
        names, values: the parameters, and θ at which this holds.
        velocity, uncertainty: v [m/s] and standard uncertainty of ε of each impact, (n,).
        matrix: information on ln θ, (p, p): Fisher's for `model`; for `two-step` the inverse of
            the stacked equations' covariance, Aᵀ (middle)⁻¹ A.
        eigenvalues: of it, (p,), the best known direction first.
        directions: columns are its eigenvectors, (p, p): exponents of products of powers of θ.
        covariance: of ln θ, (p, p).
    """

    objective: str
    names: tuple[str, ...]
    values: Float[np.ndarray, " p"]
    velocity: Float[np.ndarray, " n"]
    uncertainty: Float[np.ndarray, " n"]
    matrix: Float[np.ndarray, "p p"]
    eigenvalues: Float[np.ndarray, " p"]
    directions: Float[np.ndarray, "p p"]
    covariance: Float[np.ndarray, "p p"]

    @property
    def relative_errors(self) -> dict[str, float | None]:
        """Expected standard error of ln θ; None where the impacts do not determine θ."""
        errors = np.sqrt(np.maximum(np.diag(self.covariance), 0))
        return {n: _finite(e) for n, e in zip(self.names, errors.tolist(), strict=True)}

    @property
    def standard_errors(self) -> dict[str, float | None]:
        """Expected standard error of θ; None where the impacts do not determine it."""
        relative = self.relative_errors.values()
        pairs = zip(self.names, self.values.tolist(), relative, strict=True)
        return {name: None if e is None else value * e for name, value, e in pairs}

    @property
    def words(self) -> tuple[str, ...]:
        """Each direction in a sentence, the best known first."""
        pairs = zip(self.eigenvalues, self.directions.T, strict=True)
        return tuple(_sentence(self.names, *pair) for pair in pairs)

    def to_dict(self) -> dict[str, Any]:
        """For JSON: undefined numbers are None."""
        return {
            "objective": self.objective,
            "parameters": dict(zip(self.names, self.values.tolist(), strict=True)),
            "standard_errors": self.standard_errors,
            "relative_standard_errors": self.relative_errors,
            "information": self.matrix.tolist(),
            "eigenvalues": self.eigenvalues.tolist(),
            "directions": self.directions.T.tolist(),
            "words": list(self.words),
        }

    def __str__(self) -> str:
        return "\n".join([f"{len(self.velocity)} impacts, {self.objective}", *self.words])


def fisher_information(
    law: sj.Zhou,
    velocity: Float[ArrayLike, " n"],
    uncertainty: float | Float[ArrayLike, " n"] = 0.01,
    objective: str = "two-step",
    route: sj.EnergyBalance | sj.ODE | None = None,
) -> Information:
    """What measurements of ε at these velocities will tell of χ̃, σ and ψ.

    Args:
        law: Zhou's law with the parameters as far as they are known.
        velocity: v [m/s] of the impacts, measured or planned.
        uncertainty: standard uncertainty of each ε, one number or (n,).
        objective: "two-step" or "model", see `calibration.sensitivities.estimating`.
        route: the energy balance unless told.

    Raises:
        ValueError: naming the argument, its value and what is accepted.
    """
    check_law(law)
    check_objective(objective)
    velocity = _velocities(law, velocity)
    uncertainty = np.broadcast_to(check_uncertainty(uncertainty), velocity.shape)
    names = estimating.parameters_of(objective, law, float(np.min(velocity)))
    rows = estimating.slopes(law, velocity, route)
    slope, middle = estimating.summed(rows, uncertainty**-2.0, names, objective)
    slope, middle = np.asarray(slope), np.asarray(middle)
    matrix = slope if objective == "model" else slope.T @ np.linalg.pinv(middle) @ slope
    eigenvalues, directions = np.linalg.eigh(0.5 * (matrix + matrix.T))
    return Information(
        objective=objective,
        names=names,
        values=np.array([_value(law, name) for name in names]),
        velocity=velocity,
        uncertainty=uncertainty,
        matrix=matrix,
        eigenvalues=np.maximum(eigenvalues[::-1], 0),
        directions=_with_sign(directions[:, ::-1]),
        covariance=np.asarray(estimating.covariance(slope, middle)),
    )


def check_law(law: Any) -> None:
    """What this and the search for velocities can use."""
    if not isinstance(law, sj.Zhou):
        raise ValueError(f"`law` must be a Zhou law, but is {type(law).__name__}")
    for name in COEFFICIENTS:
        value = getattr(law, name)
        if np.ndim(value) or not float(value) > 0:
            raise ValueError(f"`{name}` must be one positive number, but is {value!r}")


def check_objective(objective: Any) -> None:
    if objective not in estimating.OBJECTIVES:
        accepted = " or ".join(map(repr, estimating.OBJECTIVES))
        raise ValueError(f"`objective` must be {accepted}, but is {objective!r}")


def check_uncertainty(uncertainty: Any) -> np.ndarray:
    values = np.asarray(uncertainty, float)
    if not (np.all(np.isfinite(values)) and np.all(values > 0)):
        raise ValueError(f"`uncertainty` must be positive, but is {uncertainty!r}")
    return values


def _velocities(law: sj.Zhou, velocity) -> np.ndarray:
    velocity = np.asarray(velocity, float).ravel()
    limit = float(law.contact.limit_velocity)
    if not (velocity.size and np.all((velocity > 0) & (velocity < limit))):
        accepted = f"one velocity or more between 0 and the limit velocity, {limit:.6g} m/s"
        raise ValueError(f"`velocity` must be {accepted}")
    return velocity


def _value(law: sj.Zhou, name: str) -> float:
    return float(estimating.eps_up(law) if name == "eps_up" else getattr(law, name))


def _with_sign(directions: np.ndarray) -> np.ndarray:
    """The largest exponent of each direction made positive, so that equal runs read alike."""
    largest = np.argmax(np.abs(directions), axis=0)
    return directions * np.sign(directions[largest, np.arange(directions.shape[1])])


def _finite(error: float) -> float | None:
    return error if math.isfinite(error) and error < NO_BOUND else None


def _sentence(names, eigenvalue, direction) -> str:
    error = math.inf if eigenvalue <= 0 else eigenvalue**-0.5
    taking_part = [i for i, share in enumerate(direction) if abs(share) > TAKES_PART]
    product = " · ".join(_power(names[i], direction[i]) for i in taking_part)
    letters = " and ".join(symbol(names[i]) for i in taking_part)
    if error < NOT_KNOWN:
        return f"{product} will be known to {100 * error:.2g} %"
    if len(taking_part) == 1:
        return f"{letters} is left open ({_open(error)})"
    return f"{letters} only together: {product} is left open ({_open(error)})"


def _open(error: float) -> str:
    if error >= NO_BOUND:
        return "these impacts do not tell it"
    return f"standard error of its logarithm {error:.2g}"


def _power(name: str, exponent: float) -> str:
    if abs(exponent - 1) < 0.005:
        return symbol(name)
    return f"{symbol(name)}^{exponent:.2f}"
