"""What is exported: a law, its ε over a range of velocities, and its impacts as codes follow them."""

import dataclasses
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

import softjax as sj
from calibration.data.air import Fall
from calibration.errors import DataError, printable
from calibration.fit_result import FitResult
from calibration.fitting.material import MaterialFit
from softjax.many_body import elastic_limit, loading_work

POINTS = 65  # velocities at which ε is compared, evenly in the logarithm
POISSON_RATIO = 0.3  # where only the contact is known: the modulus that is written goes with it
EQUAL = 1e-9  # of the factor of an unloading force to 1
SLOWEST = 1e-4  # factor that durations are stated with, of bodies that hardly part
NODES = 24  # of the time of loading

Range = tuple[float, float]
Curve = Float[np.ndarray, " n"]


@dataclass(frozen=True)
class ExportOptions:
    """Options of an export, by their names in `calibration.particle_codes.entry.export`."""

    material: str | None
    velocity_range: Range | None
    tolerance: float
    law: str
    steps: int | None
    overlap: float | None
    radius: float | None
    on_wall: bool | None
    losses: bool
    prefix: str
    types: tuple[int, int] | None
    below: str
    sizes: tuple[float, ...] | None
    gravity: float | None


@dataclass(frozen=True, eq=False)
class Pair:
    """Two types of atoms, 1, 2, …, the radius of the smaller one [m] and their contact."""

    types: tuple[int, int]
    smaller: float
    contact: sj.Contact


@dataclass(frozen=True, eq=False)
class Target:
    """A law of single numbers, the velocities [m/s] of a scene, ε there, and the fit, if it is of one.

    `radius` is of the smaller sphere [m], else the effective one, `radius_of` says which; `on_wall` is
    None where only the contact is known; `pairs` are of the sizes that were named; `gravity` is g [m/s²],
    0 where weight is left out.
    """

    options: ExportOptions
    law: Any
    contact: sj.Contact
    name: str
    radius: float
    radius_of: str
    poisson_ratio: float
    on_wall: bool | None
    velocity: np.ndarray
    restitution: np.ndarray
    pairs: tuple[Pair, ...]
    gravity: float
    fit: MaterialFit | None

    @property
    def range(self) -> Range:
        return float(self.velocity[0]), float(self.velocity[-1])


def target_of(source: FitResult | MaterialFit | sj.ContactLaw, options: ExportOptions) -> Target:
    """ε of a fit or a law over a range of velocities.

    Raises:
        ValueError: naming the argument, its value and what is accepted.
    """
    chosen = source.material(options.material) if isinstance(source, FitResult) else source
    fit = chosen if isinstance(chosen, MaterialFit) else None
    law = fit.law if fit else chosen
    if not isinstance(law, sj.ContactLaw):
        raise DataError("result_or_law", law, "a FitResult, a MaterialFit or a contact law")
    contact = getattr(law, "contact", None) or (fit.data.contact if fit else None)
    if contact is None:
        accepted = (
            "a law with a field `contact`: a code needs elastic properties and sizes of the bodies"
        )
        raise DataError("result_or_law", type(law).__name__, accepted)
    if any(np.size(leaf) != 1 for leaf in jax.tree.leaves((law, contact))):
        raise DataError("result_or_law", "a law of several pairs of bodies", "a law of one pair")
    velocity = np.geomspace(*_range(fit, options.velocity_range), POINTS)
    spheres = [body for body in fit.data.bodies if body.radius is not None] if fit else []
    smaller = min(spheres, key=lambda body: body.radius, default=None)
    on_wall = len(spheres) == 1 if options.on_wall is None and spheres else options.on_wall
    known = options.radius or (smaller.radius if smaller else None)
    density = float(smaller.material.density) if smaller else None
    return Target(
        options,
        law,
        contact,
        printable(fit.data.name if fit else options.material or type(law).__name__),
        float(known or number_of(contact.radius)),
        "sphere's" if known else "effective",
        float(smaller.material.poisson_ratio) if smaller else POISSON_RATIO,
        on_wall,
        velocity,
        restitution_of(law, velocity, options.losses),
        _pairs(contact, options.sizes, density, on_wall),
        _gravity(fit, options.gravity),
        fit,
    )


def _gravity(fit: MaterialFit | None, gravity: float | None) -> float:
    """g as stated, else that of measured heights, else the standard one [m/s²]."""
    fall = fit.data.fall if fit else None
    return float((fall or Fall()).gravity if gravity is None else gravity)


def _range(fit: MaterialFit | None, velocity_range: Range | None) -> Range:
    if velocity_range is not None:
        low, high = map(float, velocity_range)
    elif fit is not None:
        low = max(float(np.min(fit.data.velocity)), fit.known_from)
        high = min(float(np.max(fit.data.velocity)), fit.known_to)
    else:
        raise DataError("velocity_range", None, "given with a law: (lowest, highest) in m/s")
    text = f"{low:g}:{high:g}"
    if not 0 < low < high < np.inf:
        raise DataError("velocity_range", text, "lowest:highest in m/s, 0 < lowest")
    if fit is not None and not np.all(fit.determined([low, high])):
        known = f"{fit.known_from:.4g} to {fit.known_to:.4g} m/s"
        raise DataError("velocity_range", text, f"where the data determine ε, {known}")
    return low, high


def _pairs(contact: sj.Contact, sizes: Any, density: Any, on_wall: bool | None) -> tuple[Pair, ...]:
    """Contacts of all pairs of types. Without a density it is that of two like spheres with this contact."""
    if sizes is None:
        return ()
    if on_wall:
        raise DataError("sizes", sizes, "left out for a ball on a wall: export each size by itself")
    radii = np.array(sizes, float)
    if not np.all((radii > 0) & (radii < np.inf)):
        raise DataError("sizes", sizes, "radii of the types of atoms in m")
    like = 2 * number_of(contact.mass) / (2 * number_of(contact.radius)) ** 3
    bodies = {"radius": radii, "mass": radii**3 * (4 / 3 * np.pi * density if density else like)}
    pairs = []
    for i, j in combinations_with_replacement(range(len(radii)), 2):
        reduced = {name: float(x[i] * x[j] / (x[i] + x[j])) for name, x in bodies.items()}
        of_pair = dataclasses.replace(contact, **reduced)
        pairs.append(Pair((i + 1, j + 1), float(min(radii[i], radii[j])), of_pair))
    return tuple(pairs)


def with_contact(law: Any, contact: sj.Contact) -> Any:
    """The law between bodies of other sizes."""
    return dataclasses.replace(law, contact=contact) if hasattr(law, "contact") else law


def number_of(leaf: Any) -> float:
    """A single number of a law or contact."""
    return float(np.asarray(leaf).reshape(()))


def restitution_of(law: Any, velocity: np.ndarray, losses: bool = True) -> np.ndarray:
    """ε, or ε_p: without the losses that are in no force.

    Raises:
        ValueError: at the first velocity where the law has no answer.
    """
    hit = sj.restitution(law, velocity)
    none = ~sj.Status.has_end(np.asarray(hit.status))
    if np.any(none):
        accepted = "one over which the bodies come to rest and part again"
        raise DataError("velocity_range", f"one with {velocity[np.argmax(none)]:.4g} m/s", accepted)
    return np.asarray(hit.coefficient if losses else hit.plastic_coefficient)


@dataclass(frozen=True, eq=False)
class Impacts:
    """Arrays over velocities [m/s]: ε as a code has it, ε_p, largest overlap [m], duration [s], peak force [N].

    `factor` is (ε/ε_p)², by which the unloading force is multiplied; ε is 1 at most.
    """

    velocity: Curve
    coefficient: Curve
    plastic: Curve
    peak: Curve
    duration: Curve
    force: Curve

    @property
    def factor(self) -> Curve:
        safe = np.where(self.plastic > 0, self.plastic, np.inf)
        return (self.coefficient / safe) ** 2

    @property
    def gain(self) -> float:
        """The largest relative gain of energy in an impact."""
        return float(max(np.max(self.coefficient) ** 2 - 1, 0.0))

    def softened(self, factor: float) -> "Impacts":
        """Repeat the impacts on springs softer by `factor`."""
        longer = {"peak": factor * self.peak, "duration": factor * self.duration}
        return dataclasses.replace(self, **longer, force=self.force / factor)


def impacts_of(law: Any, velocity: Curve, losses: bool = True) -> Impacts:
    """Impacts on a law with a force; `losses`: with those that are in ε and in no force.

    A body that unloads by a force f times as large goes the same way 1/√f times as slowly.
    """
    hit = sj.restitution(law, velocity)
    numbers = hit.plastic_coefficient, hit.peak_overlap, hit.duration, hit.peak_force
    impacts = Impacts(velocity, coefficient_of(hit, losses), *map(np.asarray, numbers))
    factor = impacts.factor
    if np.all(np.abs(factor - 1) < EQUAL) or not isinstance(law, sj.RateIndependentLaw):
        return impacts
    loading = np.minimum(_loading_time(law, impacts.peak), impacts.duration)
    back = (impacts.duration - loading) / np.sqrt(np.clip(factor, SLOWEST, None))
    return dataclasses.replace(
        impacts, duration=np.where(factor > 0, loading + back, impacts.duration)
    )


def _loading_time(law: Any, peak: Curve) -> Curve:
    """∫ dδ/δ' up to the largest overlap [s], ½ M δ'² = ∫ P dδ from δ to it, over s of δ = δ_max (1 - s²)."""
    node, weight = np.polynomial.legendre.leggauss(NODES)
    at = (node[:, None] + 1) / 2
    works = jax.jit(_work_left)(law, np.sqrt(peak * (1 - at**2)), np.sqrt(peak + 0 * at))
    speed = np.sqrt(2 * np.asarray(works) / number_of(law.contact.mass))
    return np.sum(weight[:, None] * peak * at / speed, axis=0)


def _work_left(law: Any, low: Any, high: Any) -> Any:
    yields = jnp.clip(jnp.sqrt(elastic_limit(law)), low, high)
    return loading_work(law, low, yields) + loading_work(law, yields, high)


def coefficient_of(hit: sj.Restitution, losses: bool) -> Curve:
    """ε as a code has it, 1 at most, or ε_p."""
    plastic = np.asarray(hit.plastic_coefficient)
    return np.minimum(np.asarray(hit.coefficient), 1.0) if losses else plastic
