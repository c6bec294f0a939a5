"""What is wanted of a particle code: a law's ε over a range of velocities."""

from dataclasses import dataclass
from typing import Any

import jax
import numpy as np

import softjax as sj
from calibration.data import RestitutionData
from calibration.errors import DataError, printable
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
        poisson_ratio: of the smaller sphere [-]; None where only the contact is known.
        on_wall: whether the law is of a ball on a flat wall, or of two balls; None where only the
            contact is known.
        velocity, restitution: [m/s] and [-], shape (POINTS,).
        measured: lowest and highest velocity of the data [m/s]; None without data.
        doubts: codes of what is doubted of the fit.
    """

    law: Any
    contact: sj.Contact
    name: str
    radius: float
    radius_of: str
    poisson_ratio: float | None
    on_wall: bool | None
    velocity: np.ndarray
    restitution: np.ndarray
    measured: Range | None = None
    doubts: tuple[str, ...] = ()

    @property
    def range(self) -> Range:
        return float(self.velocity[0]), float(self.velocity[-1])


def wanted_of(
    source: FitResult | MaterialFit | sj.ContactLaw,
    material: str | None = None,
    velocity_range: Range | None = None,
    losses: bool = True,
    radius: float | None = None,
    on_wall: bool | None = None,
) -> Wanted:
    """What a fit's or a law's ε is over a range of velocities.

    Args:
        source: a fit or a law.
        material: the data set of a fit of several; a name for a law.
        velocity_range: lowest and highest [m/s]; the data's where left out.
        losses: False wants ε_p, what the force alone gives back.
        radius: what overlaps are told over [m].
        on_wall: whether the law is of a ball on a wall; as a fit knows where left out.

    Raises:
        ValueError: naming the argument, its value and what is accepted.
    """
    fit = source.material(material) if isinstance(source, FitResult) else source
    law = fit.law if isinstance(fit, MaterialFit) else fit
    if not isinstance(law, sj.ContactLaw):
        raise DataError("result_or_law", law, "a FitResult, a MaterialFit or a contact law")
    data = fit.data if isinstance(fit, MaterialFit) else None
    contact = _contact(law, data)
    velocity = np.geomspace(*_range(fit, velocity_range), POINTS)
    spheres = [body for body in data.bodies if body.radius is not None] if data else []
    smaller = min(spheres, key=lambda body: body.radius, default=None)
    if on_wall is None and spheres:
        on_wall = len(spheres) == 1
    return Wanted(
        law,
        contact,
        printable(data.name if data is not None else material or type(law).__name__),
        *_radius(radius, None if smaller is None else smaller.radius, contact),
        None if smaller is None else float(smaller.material.poisson_ratio),
        on_wall,
        velocity,
        restitution_of(law, velocity, losses),
        None if data is None else (float(np.min(data.velocity)), float(np.max(data.velocity))),
        _doubts(fit),
    )


def _doubts(fit: Any) -> tuple[str, ...]:
    found = fit.warnings if isinstance(fit, MaterialFit) else ()
    return tuple(dict.fromkeys(doubt.code for doubt in found))


def restitution_of(law: Any, velocity: np.ndarray, losses: bool = True) -> np.ndarray:
    """ε, or ε_p without the losses that are in no force.

    Raises:
        ValueError: at the first velocity where the law has no answer.
    """
    hit = sj.restitution(law, velocity)
    none = np.asarray(hit.status) & UNANSWERED != 0
    if np.any(none):
        accepted = "one over which the law has a turning point"
        raise DataError("velocity_range", f"one with {velocity[np.argmax(none)]:.4g} m/s", accepted)
    return np.asarray(hit.coefficient if losses else hit.plastic_coefficient)


def _radius(told: float | None, sphere: float | None, contact: sj.Contact) -> tuple[float, str]:
    """What overlaps are told over, and whose radius that is."""
    if told is not None:
        if not 0 < told < np.inf:
            raise DataError("radius", told, "a positive length in m")
        return float(told), "sphere's"
    if sphere is not None:
        return float(sphere), "sphere's"
    return number_of(contact.radius), "effective"


def _contact(law: Any, data: RestitutionData | None) -> sj.Contact:
    contact = getattr(law, "contact", None) or (data.contact if data is not None else None)
    if contact is None:
        accepted = "one with a contact: a code needs elastic properties and sizes of the bodies"
        raise DataError("result_or_law", type(law).__name__, accepted)
    if any(np.size(leaf) != 1 for leaf in jax.tree.leaves((law, contact))):
        raise DataError("result_or_law", "a law of several pairs of bodies", "a law of one pair")
    return contact


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
        raise DataError(
            "velocity_range", f"{low:g}:{high:g}", f"within what the fit knows, {known}"
        )
    return low, high
