"""What is exported: a law, its ε over a range of velocities, and its forces as codes follow them."""

import dataclasses
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import softjax as sj
from calibration.data import RestitutionData
from calibration.errors import DataError, printable
from calibration.fitting.material import MaterialFit
from calibration.fitting.result import FitResult

POINTS = 65  # velocities at which ε is compared, evenly in the logarithm
UNANSWERED = int(sj.Status.NO_TURNING_POINT | sj.Status.INVALID_INPUT)

Range = tuple[float, float]
Curve = Float[np.ndarray, " n"]


@dataclass(frozen=True, eq=False)
class Target:
    """A law, the velocities at which a scene needs it, and its ε there.

    Attributes:
        law: with single numbers for all its fields, and a contact.
        name: of the material.
        radius: what overlaps are told over: the radius [m] of the smaller sphere, or the effective
            one where only the contact is known (`radius_of` says which).
        poisson_ratio, density: of the smaller sphere [-], [kg/m³]; None where only the contact is
            known.
        on_wall: whether the law is of a ball on a flat wall, or of two balls; None where only the
            contact is known.
        velocity, restitution: [m/s] and [-], shape (POINTS,).
        measured: lowest and highest velocity of the data [m/s]; None without data.
        doubts: codes of the fit's warnings.
        determined_from: the velocity [m/s] below which the fit does not determine ε.
        pairs: of the sizes that were named: two types of atoms and their contact.
    """

    law: Any
    contact: sj.Contact
    name: str
    radius: float
    radius_of: str
    poisson_ratio: float | None
    density: float | None
    on_wall: bool | None
    velocity: np.ndarray
    restitution: np.ndarray
    measured: Range | None = None
    doubts: tuple[str, ...] = ()
    determined_from: float = 0.0
    pairs: tuple[tuple[int, int, sj.Contact], ...] = ()

    @property
    def range(self) -> Range:
        return float(self.velocity[0]), float(self.velocity[-1])


def target_of(
    source: FitResult | MaterialFit | sj.ContactLaw,
    material: str | None = None,
    velocity_range: Range | None = None,
    losses: bool = True,
    radius: float | None = None,
    on_wall: bool | None = None,
    sizes: tuple[float, ...] | None = None,
) -> Target:
    """What a fit's or a law's ε is over a range of velocities.

    Args:
        source: a fit or a law.
        material: the data set of a fit of several; a name for a law.
        velocity_range: lowest and highest [m/s]; the data's where left out.
        losses: False wants ε_p, what the force alone gives back.
        radius: what overlaps are told over [m].
        on_wall: whether the law is of a ball on a wall; as a fit knows where left out.
        sizes: radii [m] of the types of atoms of the scene, all of this material.

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
    return Target(
        law,
        contact,
        printable(data.name if data is not None else material or type(law).__name__),
        *_radius(radius, None if smaller is None else smaller.radius, contact),
        None if smaller is None else float(smaller.material.poisson_ratio),
        None if smaller is None else float(smaller.material.density),
        on_wall,
        velocity,
        restitution_of(law, velocity, losses),
        None if data is None else (float(np.min(data.velocity)), float(np.max(data.velocity))),
        _doubts(fit),
        fit.known_from if isinstance(fit, MaterialFit) else 0.0,
        _pairs(contact, sizes, None if smaller is None else smaller.material.density, on_wall),
    )


def _pairs(contact: sj.Contact, sizes: Any, density: Any, on_wall: bool | None) -> tuple:
    """Contacts of all pairs of types; without a density of two like spheres with this contact."""
    if sizes is None:
        return ()
    if on_wall:
        raise DataError("sizes", sizes, "left out for a ball on a wall: export each size by itself")
    radii = np.array(sizes, float)
    if not np.all((radii > 0) & (radii < np.inf)):
        raise DataError("sizes", sizes, "radii of the types of atoms in m")
    sphere = 4 / 3 * np.pi * (2 * number_of(contact.radius)) ** 3
    masses = 4 / 3 * np.pi * radii**3 * (density or 2 * number_of(contact.mass) / sphere)

    def of_both(values, i, j):
        return float(values[i] * values[j] / (values[i] + values[j]))

    return tuple(
        (
            i + 1,
            j + 1,
            dataclasses.replace(contact, radius=of_both(radii, i, j), mass=of_both(masses, i, j)),
        )
        for i in range(len(radii))
        for j in range(i, len(radii))
    )


def with_contact(law: Any, contact: sj.Contact) -> Any:
    """The law between bodies of other sizes."""
    return (
        law if getattr(law, "contact", None) is None else dataclasses.replace(law, contact=contact)
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
    if isinstance(fit, MaterialFit) and not np.all(fit.determined([low, high])):
        known = f"{fit.known_from:.4g} to {fit.known_to:.4g} m/s"
        raise DataError(
            "velocity_range", f"{low:g}:{high:g}", f"within what the fit knows, {known}"
        )
    return low, high


@dataclass(frozen=True, eq=False)
class Impacts:
    """Arrays over velocities [m/s]: ε as a code has it, ε_p, largest overlap [m], duration [s].

    `factor` is (ε/ε_p)², by which the unloading force is multiplied; ε is 1 at most.
    """

    velocity: Curve
    coefficient: Curve
    plastic: Curve
    peak: Curve
    duration: Curve

    @property
    def factor(self) -> Curve:
        safe = np.where(self.plastic > 0, self.plastic, 1.0)
        return np.where(self.plastic > 0, (self.coefficient / safe) ** 2, 0.0)

    @property
    def gain(self) -> float:
        """The most energy that an impact brings back above what it had, over that."""
        return float(max(np.max(self.coefficient) ** 2 - 1, 0.0))


def impacts_of(law: Any, velocity: Curve, losses: bool = True) -> Impacts:
    """Impacts on a law with a force; `losses`: with what is in ε and in no force."""
    hit = sj.restitution(law, velocity)
    plastic = np.asarray(hit.plastic_coefficient)
    coefficient = np.minimum(np.asarray(hit.coefficient), 1.0) if losses else plastic
    return Impacts(
        velocity, coefficient, plastic, np.asarray(hit.peak_overlap), np.asarray(hit.duration)
    )


def end_of(law: Any) -> str:
    """Where a contact with damping ends: "zero-overlap" or "zero-force"."""
    return getattr(law, "end", None) or law.reduced().ends_at


def unloading_force(law: Any, overlap: Any, peak_overlap: Any) -> Array:
    """That of a law [N]; where nothing has yielded that of Hertz, as on loading."""
    after_yield = law.unloading_force(overlap, peak_overlap)
    if not hasattr(law, "elastic_velocity"):
        return after_yield
    yielded = peak_overlap > _elastic_overlap(law)
    return jnp.where(yielded, after_yield, law.loading_force(overlap))


def _elastic_overlap(law: Any) -> Array:
    """The largest overlap of an impact that just does not yield, by Hertz's force [m]."""
    energy = law.contact.mass * law.elastic_velocity() ** 2 / 2
    return (2.5 * energy / law.contact.stiffness) ** 0.4
