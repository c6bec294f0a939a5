"""The numbers that ε depends on, by name, and the law they make.

A property of a material acts through the contact that is built of it, so derivatives are taken
through the function that builds it. Such functions are small values here, so that equal ones
compile once.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np

import softjax as sj
from calibration.curve.options import COEFFICIENTS

PROPERTIES = ("youngs_modulus", "poisson_ratio", "density", "yield_strength")
PADDING = 64
SYMBOLS = {
    "youngs_modulus": "E",
    "poisson_ratio": "ν",
    "density": "ρ",
    "yield_strength": "Y",
    "radius": "R",
    "mass": "M",
    "limit_velocity": "v_lim",
    "chi": "χ̃",
    "sigma": "σ",
    "psi": "ψ",
    "eps_up": "ε_up",
    "velocity": "v",
}
UNITS = {
    "youngs_modulus": "Pa",
    "density": "kg/m³",
    "yield_strength": "Pa",
    "radius": "m",
    "mass": "kg",
    "limit_velocity": "m/s",
    "velocity": "m/s",
}

# exponents of kilogram, metre and second; what is not here is a number without a unit
DIMENSIONS = {
    "youngs_modulus": (1, -1, -2),
    "yield_strength": (1, -1, -2),
    "density": (1, -3, 0),
    "radius": (0, 1, 0),
    "mass": (1, 0, 0),
    "limit_velocity": (0, 1, -1),
    "velocity": (0, 1, -1),
}


@dataclass(frozen=True)
class Inputs:
    """Named numbers, and how a law is made of them.

    Attributes:
        values: name -> value, SI. A name may end in `_1`, `_2`, `_wall`: of which body.
        build: makes the law of such a mapping; hashable, traceable by JAX.
    """

    values: Mapping[str, float]
    build: Any

    def law(self) -> sj.ContactLaw:
        """The law of the values themselves."""
        return self.build(self.values)

    def __getitem__(self, name: str) -> float:
        return self.values[name]


@dataclass(frozen=True)
class Spheres:
    """Builds Zhou's law of two spheres of one material, of one radius or two."""

    area: str = "zhou"
    form: str = "first-order"
    kappa: str = "consistent"

    def __call__(self, values: Mapping[str, Any]) -> sj.Zhou:
        material = _material(values)
        one, two = (values[name] if name in values else values["radius"] for name in _RADII)
        contact = sj.Contact.between_spheres(material, material, one, two, area=self.area)
        return _zhou(self, contact, values)


@dataclass(frozen=True)
class UnlikeSpheres(Spheres):
    """Builds Zhou's law of two spheres, each of its own material and radius."""

    def __call__(self, values: Mapping[str, Any]) -> sj.Zhou:
        one, two = _material(values, "_1"), _material(values, "_2")
        radius_1, radius_2 = (values[name] for name in _RADII)
        contact = sj.Contact.between_spheres(one, two, radius_1, radius_2, area=self.area)
        return _zhou(self, contact, values)


@dataclass(frozen=True)
class SphereAndWall(Spheres):
    """Builds Zhou's law of a sphere and a flat wall of its own material."""

    def __call__(self, values: Mapping[str, Any]) -> sj.Zhou:
        material, wall = _material(values), _material(values, "_wall")
        contact = sj.Contact.with_wall(material, wall, values["radius"], area=self.area)
        return _zhou(self, contact, values)


@dataclass(frozen=True)
class Leaves:
    """Builds any law of its own fields and its contact's, each held independent."""

    structure: Any
    names: tuple[str, ...]

    def __call__(self, values: Mapping[str, Any]) -> sj.ContactLaw:
        return jax.tree.unflatten(self.structure, [values[name] for name in self.names])


def of_spheres(
    material: sj.Material,
    radius: float,
    *,
    chi: float,
    sigma: float,
    psi: float,
    area: str = "zhou",
    form: str = "first-order",
    kappa: str = "consistent",
) -> Inputs:
    """Two equal spheres: E, ν, ρ, Y and R of both moved together, and χ̃, σ, ψ."""
    values = {name: float(getattr(material, name)) for name in PROPERTIES}
    values |= {"radius": float(radius), "chi": chi, "sigma": sigma, "psi": psi}
    return Inputs(values, Spheres(area, form, kappa))


def of_law(law: sj.ContactLaw) -> Inputs:
    """Any law: its own fields and the contact's stored leaves, single numbers.

    Raises:
        ValueError: where a field is an array.
    """
    paths, structure = jax.tree_util.tree_flatten_with_path(law)
    names = tuple(str(path[-1]).lstrip(".") for path, _ in paths)
    for name, (_, leaf) in zip(names, paths, strict=True):
        if np.ndim(leaf):
            raise ValueError(f"`{name}` must be a single number, but has shape {np.shape(leaf)}")
    values = {name: float(leaf) for name, (_, leaf) in zip(names, paths, strict=True)}
    return Inputs(values, Leaves(structure, names))


def as_inputs(inputs: Inputs | sj.ContactLaw) -> Inputs:
    """Inputs as they are, or those of a law.

    Raises:
        ValueError: for anything else.
    """
    if isinstance(inputs, sj.ContactLaw):
        return of_law(inputs)
    if isinstance(inputs, Inputs):
        return inputs
    raise ValueError(f"`inputs` must be Inputs or a contact law, but is {inputs!r}")


def split(name: str) -> tuple[str, str]:
    """`youngs_modulus_wall` is youngs_modulus of the wall."""
    for body in ("1", "2", "wall"):
        if name.endswith(f"_{body}"):
            return name.removesuffix(f"_{body}"), body
    return name, ""


def check_velocity(velocity: Any) -> np.ndarray:
    """Velocities as a flat array.

    Raises:
        ValueError: for what is no finite velocity of 0 or more.
    """
    values = np.asarray(velocity, float).ravel()
    if not (values.size and np.all(np.isfinite(values) & (values >= 0))):
        accepted = "one finite velocity [m/s] or more, each 0 or above"
        raise ValueError(f"`velocity` must be {accepted}, but is {velocity!r}")
    return values


def padded(velocity: np.ndarray) -> np.ndarray:
    """Filled up to a multiple of `PADDING`, so that most batches share one compilation."""
    return np.pad(velocity, (0, -len(velocity) % PADDING), mode="edge")


def symbol(name: str) -> str:
    """The letter of a quantity: `youngs_modulus_wall` is E wall."""
    stem, body = split(name)
    return " ".join(filter(None, (SYMBOLS.get(stem, stem), body)))


def unit(name: str) -> str:
    """Its SI unit; empty for a number without one."""
    return UNITS.get(split(name)[0], "")


def dimension(name: str) -> tuple[int, int, int]:
    """Exponents of kg, m and s of a quantity of `Spheres` and its like, or of a Zhou law."""
    return DIMENSIONS.get(split(name)[0], (0, 0, 0))


_RADII = ("radius_1", "radius_2")


def _material(values: Mapping[str, Any], body: str = "") -> sj.Material:
    return sj.Material(*(values[name + body] for name in PROPERTIES))


def _zhou(build: Spheres, contact: sj.Contact, values: Mapping[str, Any]) -> sj.Zhou:
    own = (values[name] for name in COEFFICIENTS)
    return sj.Zhou(contact, *own, form=build.form, kappa=build.kappa)
