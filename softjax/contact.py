"""Materials, and the contact of two bodies: effective quantities and the scales of first yield."""

import math
from typing import Any

import equinox as eqx
import jax.numpy as jnp

from softjax.checks import ArgumentError, as_real, check, check_broadcast, check_type
from softjax.fields import Number, check_fields, choice_field, number_field, numbers_of
from softjax.numerics.powers import quotient

# Contact radius a² = A δ with A = factor · R. The paper's printed b = (3πR/4E)^{1/3} of Eq. (2)
# gives π^{2/3} R, Hertz's own b gives R; Table 1's critical velocities need the printed one.
AREA_FACTORS = {"zhou": math.pi ** (2 / 3), "hertz": 1.0}


class Material(eqx.Module):
    """The elastic and plastic properties of one body.

    Attributes (floats, or arrays that broadcast: another material for each impact):
        youngs_modulus: E [Pa], positive.
        poisson_ratio: mu [-], in (-1, 0.5].
        density: rho [kg/m³], positive.
        yield_strength: Y [Pa], positive: the contact pressure at which the body first yields.

    Raises:
        ValueError: naming the property, its value and what is accepted.
    """

    youngs_modulus: Number = number_field("E", "Pa", "modulus", within="(0, inf)")
    poisson_ratio: Number = number_field("ν", "-", "ratio", within="(-1, 0.5]")
    density: Number = number_field("ρ", "kg/m³", "density", within="(0, inf)")
    yield_strength: Number = number_field("Y", "Pa", "strength", within="(0, inf)")

    def __check_init__(self):
        check_fields(self)

    def leaves(self) -> dict[str, Number]:
        """The four properties by name."""
        return numbers_of(self)


# Zhou, Theor. Appl. Mech. Lett. 3, 021003 (2013), Table 1. The nylon's modulus is the bulk value;
# the paper notes that it is about ten times the one of the measurements' own source.
STAINLESS_STEEL = Material(1.93e11, 0.35, 8030.0, 3.10e8)
"""Stainless steel of Zhou (2013), Table 1."""
CHROME_STEEL = Material(2.03e11, 0.28, 7830.0, 2.03e9)
"""Chrome steel of Zhou (2013), Table 1."""
NYLON = Material(2.5e9, 0.30, 1140.0, 4.0e7)
"""Nylon of Zhou (2013), Table 1, with the bulk modulus."""


class Contact(eqx.Module):
    """Two bodies about to collide head-on, reduced to one body of effective properties.

    Stored leaves, independent of each other under differentiation:
        youngs_modulus: E [Pa], 1/E = (1-ν1²)/E1 + (1-ν2²)/E2 (Eq. 2).
        radius: R = R1 R2/(R1+R2) [m] (Eq. 2).
        mass: M = M1 M2/(M1+M2) [kg] (Eq. 3).
        yield_strength: Y [Pa], the smaller of the two.
        limit_velocity: v_lim [m/s] of Eq. (17), √(3Y/ρ) with ρ of the body that yields.
    Static:
        area: "zhou" (contact area as the paper prints it) or "hertz"; see `AREA_FACTORS`.

    Build one with `Contact.between_spheres` or `Contact.with_wall`. Fields may be arrays that
    broadcast against the impact velocity. The computed properties (`stiffness`,
    `critical_overlap`, `critical_velocity`, `yield_ratio`) of a *gradient* with this structure are
    no numbers of meaning: only its stored leaves are derivatives.
    """

    youngs_modulus: Number = number_field("E", "Pa", "modulus", within="(0, inf)")
    radius: Number = number_field("R", "m", "length", within="(0, inf)")
    mass: Number = number_field("M", "kg", "mass", within="(0, inf)")
    yield_strength: Number = number_field("Y", "Pa", "strength", within="(0, inf)")
    limit_velocity: Number = number_field("v_lim", "m/s", "velocity", within="(0, inf)")
    area: str = choice_field(*AREA_FACTORS)

    def __check_init__(self):
        check_fields(self)

    @classmethod
    def between_spheres(
        cls,
        material_1: Material,
        material_2: Material,
        radius_1: Number,
        radius_2: Number,
        area: str = "zhou",
    ) -> "Contact":
        """Two spheres of any materials and radii [m].

        Raises:
            ValueError: naming the argument, its value and what is accepted.
        """
        (radius_1, mass_1), (radius_2, mass_2) = _spheres(
            {"material_1": material_1, "material_2": material_2},
            {"radius_1": radius_1, "radius_2": radius_2},
        )
        return cls(
            radius=radius_1 * radius_2 / (radius_1 + radius_2),
            # as a ratio: the product of two small masses would underflow in float32
            mass=mass_1 / (1 + mass_1 / mass_2),
            **_of_both(material_1, material_2),
            area=area,
        )

    @classmethod
    def with_wall(
        cls, material: Material, wall: Material, radius: Number, area: str = "zhou"
    ) -> "Contact":
        """A sphere of `material` and `radius` [m] against a flat, heavy wall.

        Raises:
            ValueError: naming the argument, its value and what is accepted.
        """
        materials = {"material": material, "wall": wall}
        ((radius, mass),) = _spheres(materials, {"radius": radius})
        return cls(radius=radius, mass=mass, **_of_both(material, wall), area=area)

    def leaves(self) -> dict[str, Number]:
        """The five stored quantities by name."""
        return numbers_of(self)

    @property
    def stiffness(self):
        """Hertz's k = 4/3 E √R [N/m^1.5] (Eq. 2)."""
        return 4 / 3 * self.youngs_modulus * _sqrt(self.radius)

    @property
    def yield_ratio(self):
        """E/Y [-]."""
        return self.youngs_modulus / self.yield_strength

    @property
    def area_factor(self) -> float:
        """A/R [-], where the contact radius is a = √(A δ)."""
        return AREA_FACTORS[self.area]

    @property
    def yield_strain(self):
        """√(δ_cr/R) = π (A/R) Y/(2E) [-]: peak pressure 3kδ^{1/2}/(2πA) equal to Y (Eq. 5a)."""
        return 0.5 * math.pi * self.area_factor * self.yield_strength / self.youngs_modulus

    @property
    def critical_overlap(self):
        """δ_cr [m], the overlap of first yield (Eq. 5a)."""
        strain = self.yield_strain
        return self.radius * (strain * strain)

    @property
    def critical_velocity(self):
        """v_cr = √(4k/5M) δ_cr^{5/4} [m/s], the impact velocity of first yield (Eq. 5b)."""
        # Regrouped in strains: no intermediate leaves float32's range from 1 nm to 1 km spheres.
        # Products and square roots alone round alike in Python, in JAX and compiled, so that an
        # impact at exactly `critical_velocity` is elastic by all three.
        strain = self.yield_strain
        volume = self.radius * self.radius * self.radius
        numbers = isinstance(volume, float) and isinstance(self.mass, float)
        per_mass = volume / self.mass if numbers else quotient(volume, self.mass)
        speed_squared = 16 / 15 * self.youngs_modulus * per_mass * strain
        return _sqrt(speed_squared) * (strain * strain)


def _spheres(materials: dict[str, Material], radii: dict[str, Number]) -> list[tuple[Any, Any]]:
    """Radius and mass of each sphere, checked; a material without a radius is that of a wall."""
    for name, material in materials.items():
        check_type(name, material, Material, "a Material")
    radii = {name: as_real(radius, "m") for name, radius in radii.items()}
    for name, radius in radii.items():
        check(name, radius, lambda a: a > 0, "a positive length in m")
    properties = {
        f"{which}.{name}": leaf
        for which, material in materials.items()
        for name, leaf in material.leaves().items()
    }
    check_broadcast(radii | properties)
    spheres = zip(radii.items(), materials.values(), strict=False)
    return [(radius, _sphere_mass(material, radius, name)) for (name, radius), material in spheres]


def _sphere_mass(material: Material, radius, name: str):
    try:
        mass = 4 / 3 * math.pi * material.density * radius**3
    except OverflowError:  # of Python's numbers
        mass = math.inf
    if isinstance(mass, float) and not 0 < mass < math.inf:
        what = "a length in m of a sphere whose mass is within a number's range"
        raise ArgumentError(f"`{name}` must be {what}, but is {radius!r}")
    return mass


def _of_both(first: Material, second: Material) -> dict[str, Any]:
    """E of Eq. (2): compliances add. Y and v_lim = √(3Y/ρ) of the body that yields; at equal Y the denser one."""
    compliance_1 = (1 - first.poisson_ratio**2) / first.youngs_modulus
    compliance_2 = (1 - second.poisson_ratio**2) / second.youngs_modulus
    first_yields = first.yield_strength < second.yield_strength
    second_yields = second.yield_strength < first.yield_strength
    strength = _where(first_yields, first.yield_strength, second.yield_strength)
    denser = _where(first.density > second.density, first.density, second.density)
    density = _where(first_yields, first.density, _where(second_yields, second.density, denser))
    return {
        "youngs_modulus": 1 / (compliance_1 + compliance_2),
        "yield_strength": strength,
        "limit_velocity": _sqrt(3 * strength / density),
    }


def _sqrt(x):
    return math.sqrt(x) if isinstance(x, float) else jnp.sqrt(x)


def _where(condition, yes, no):
    """`jnp.where` that leaves Python numbers alone, so that they keep double precision."""
    if isinstance(condition, bool):
        return yes if condition else no
    return jnp.where(condition, yes, no)
