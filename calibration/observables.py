"""Observables of an impact, and the output of the collision that predicts each.

A data set is rows of (velocity, observable, value). ε is the one that every set may have; the others
are `RestitutionData.observed`, one `Observed` each, and a fit takes all of them as rows of one
likelihood (`calibration.fitting.problem.Points`). A further observable is a row of `OBSERVABLES`, for what is
predicted, and of `data.columns.OBSERVED_COLUMNS`, for what is measured. It follows
from the force alone. One that depends on ε also concerns what `request._identified` searches, what `laws` starts
from and takes for known, and `checks.impacts.beside_jump`.

The others have a dimension: a fit works with them in parts of a power law of v through the measured
values, so that scatter, where none is stated, is relative.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

RESTITUTION = "restitution"
ALIKE = 1e-6  # relative spread up to which uncertainties are the same part of each value


class Observable(NamedTuple):
    """An observable of a collision.

    Attributes:
        symbol, unit, words: its symbol, SI unit ("-" for none), and name in words.
        of: prediction of a `softjax.Restitution`, in SI and differentiable, 0 where there is none.
        power: of v that it goes with under Hertz's law.
        is_signed_square: whether a collision gives its square, below 0 where nothing rebounds, and a fit
            takes the signed root: ε alone. Another that depends on ε is a number as it stands.
    """

    symbol: str
    unit: str
    words: str
    of: Callable[[Any], Any]
    power: float = 0.0
    is_signed_square: bool = False

    @property
    def is_relative(self) -> bool:
        """Whether its errors are in parts of its values: what has a dimension."""
        return self.unit != "-"


def _diameter(area: Any, overlap: Any) -> Any:
    """2√(A δ) with a derivative of 0 at δ = 0."""
    product = area * overlap
    positive = product > 0
    return jnp.where(positive, 2 * jnp.sqrt(jnp.where(positive, product, 1.0)), 0.0)


def _dent(hit: Any) -> Any:
    contact = hit.law.contact
    return _diameter(contact.area_factor * contact.radius, hit.peak_overlap)


def _residual_dent(hit: Any) -> Any:
    return _diameter(2 * hit.law.contact.radius, hit.residual_overlap)


OBSERVABLES: dict[str, Observable] = {
    RESTITUTION: Observable(
        "ε", "-", "coefficient of restitution", lambda hit: hit.coefficient, is_signed_square=True
    ),
    "contact_time": Observable("t_c", "s", "contact time", lambda hit: hit.duration, -0.2),
    "peak_force": Observable("F_max", "N", "largest force", lambda hit: hit.peak_force, 1.2),
    "peak_overlap": Observable("δ_max", "m", "largest penetration", lambda h: h.peak_overlap, 0.8),
    "dent_diameter": Observable("d", "m", "diameter of the dent, 2√(A δ_max)", _dent, 0.4),
    "residual_dent_diameter": Observable(
        "d", "m", "diameter of the dent, 2√(2R δ*)", _residual_dent, 0.4
    ),
}
PLACES = {name: k for k, name in enumerate(OBSERVABLES)}


@dataclass(frozen=True, eq=False)
class Observed:
    """Values of one observable other than ε.

    Attributes:
        name: of `OBSERVABLES`.
        rows: which impacts of the data set, ascending, (k,).
        value: positive, in SI, (k,).
        uncertainty: standard uncertainty in SI, (k,), positive; None: a relative scatter is estimated.
        scale: what relative errors are parts of, in SI, (k,).
    """

    name: str
    rows: Int[np.ndarray, " k"]
    value: Float[np.ndarray, " k"]
    uncertainty: Float[np.ndarray, " k"] | None
    scale: Float[np.ndarray, " k"]

    @property
    def in_parts(self) -> Float[np.ndarray, " k"] | None:
        """The stated uncertainty in parts of `scale`; one stated as the same part of each value is that part."""
        if self.uncertainty is None:
            return None
        parts = self.uncertainty / self.value
        return parts if np.ptp(parts) <= ALIKE * parts[0] else self.uncertainty / self.scale

    def __len__(self) -> int:
        return len(self.value)


def scale_of(value: np.ndarray, velocity: np.ndarray, radius: Any = None) -> np.ndarray:
    """A power law of v, and of R where it differs, through the logarithms of values.

    Relative errors as parts of the values themselves would weigh small values more, and lower all that
    is fitted by 2 u². Of fewer points than twice its coefficients the values themselves.
    """
    columns = [np.ones(len(value))]
    for column in (velocity, radius):
        if np.ndim(column) and np.ptp(np.log(column)) > 0:
            columns.append(np.log(column))
    if len(value) < 2 * len(columns):
        return value
    design, logs = np.stack(columns, axis=1), np.log(value)
    return np.exp(design @ np.linalg.lstsq(design, logs, rcond=None)[0])


def predicted(name: str, hit: Any) -> Any:
    """An observable in SI from a `softjax.Restitution`."""
    return OBSERVABLES[name].of(hit)
