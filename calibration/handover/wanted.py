"""What is wanted of a particle code: a law's ε over a range of velocities."""

from dataclasses import dataclass
from typing import Any

import jax
import numpy as np

import softjax as sj
from calibration.errors import DataError
from calibration.fitting.material import MaterialFit
from calibration.fitting.result import FitResult

POINTS = 65  # velocities at which ε is compared, evenly in the logarithm
UNANSWERED = int(sj.Status.NO_TURNING_POINT | sj.Status.INVALID_INPUT)

Range = tuple[float, float]


@dataclass(frozen=True, eq=False)
class Wanted:
    """A law, the velocities at which a scene needs it, and its ε there.

    Attributes:
        law: with single numbers for all its fields, and a contact.
        name: of the material.
        radius: what overlaps are told over: the radius [m] of the smaller sphere, or the effective
            one where only the contact is known (`radius_of` says which).
        velocity, restitution: [m/s] and [-], shape (POINTS,).
    """

    law: Any
    name: str
    radius: float
    radius_of: str
    velocity: np.ndarray
    restitution: np.ndarray

    @property
    def range(self) -> Range:
        return float(self.velocity[0]), float(self.velocity[-1])

    @property
    def contact(self) -> sj.Contact:
        return self.law.contact


def wanted_of(
    source: FitResult | MaterialFit | sj.ContactLaw,
    material: str | None,
    velocity_range: Range | None,
    radius: float | None,
) -> Wanted:
    """What a fit's or a law's ε is over a range; the data's range where none is given.

    Raises:
        ValueError: naming the argument, its value and what is accepted.
    """
    fit = source.material(material) if isinstance(source, FitResult) else source
    law = fit.law if isinstance(fit, MaterialFit) else fit
    if not isinstance(law, sj.ContactLaw):
        raise DataError("result_or_law", law, "a FitResult, a MaterialFit or a contact law")
    law = checked_law(law)
    low, high = _range(fit, velocity_range)
    velocity = np.geomspace(low, high, POINTS)
    name = fit.name if isinstance(fit, MaterialFit) else material or type(law).__name__
    told = (radius, "sphere") if radius is not None else _radius(fit, law)
    return Wanted(law, name, *told, velocity, restitution_of(law, velocity))


def restitution_of(law: Any, velocity: np.ndarray) -> np.ndarray:
    """ε in float64.

    Raises:
        ValueError: at the first velocity where the law has no answer.
    """
    with jax.enable_x64(True):
        hit = sj.restitution(law, velocity)
    none = np.asarray(hit.status) & UNANSWERED != 0
    if np.any(none):
        accepted = "one over which the law has a turning point"
        raise DataError("velocity_range", f"one with {velocity[np.argmax(none)]:.4g} m/s", accepted)
    return np.asarray(hit.coefficient)


def checked_law(law: Any) -> Any:
    """The law with plain numbers for fields.

    Raises:
        ValueError: where it has several values a field, or no contact.
    """
    if getattr(law, "contact", None) is None:
        accepted = "a law of a contact: a code needs elastic properties and sizes of the bodies"
        raise DataError("result_or_law", type(law).__name__, accepted)
    several = [np.shape(leaf) for leaf in jax.tree.leaves(law.contact) if np.size(leaf) != 1]
    if several:
        raise DataError("contact", f"of arrays of shape {several[0]}", "one pair of bodies")
    return law


def number_of(leaf: Any) -> float:
    """A single number of a law or contact."""
    return float(np.asarray(leaf).reshape(()))


def _range(fit: Any, velocity_range: Range | None) -> Range:
    if velocity_range is None:
        if not isinstance(fit, MaterialFit):
            raise DataError("velocity_range", None, "given with a law: (lowest, highest) in m/s")
        low, high = float(np.min(fit.data.velocity)), float(np.max(fit.data.velocity))
        low, high = max(low, fit.known_from), min(high, fit.known_to)
    else:
        low, high = map(float, velocity_range)
    if not 0 < low < high < np.inf:
        raise DataError("velocity_range", f"{low:g}:{high:g}", "lowest:highest in m/s, 0 < lowest")
    if isinstance(fit, MaterialFit) and not np.all(fit.known([low, high])):
        known = f"{fit.known_from:.4g} to {fit.known_to:.4g} m/s"
        raise DataError("velocity_range", f"{low:g}:{high:g}", f"within what the fit knows, {known}")
    return low, high


def _radius(fit: Any, law: Any) -> tuple[float, str]:
    bodies = fit.data.bodies if isinstance(fit, MaterialFit) else ()
    radii = [body.radius for body in bodies if body.radius is not None]
    if radii:
        return float(min(radii)), "sphere"
    return number_of(law.contact.radius), "effective"


