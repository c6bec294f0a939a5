"""Materials: what a body is made of, and the three of Zhou's Table 1."""

import equinox as eqx

from softjax.fields import Number, check_fields, number_field, numbers_of


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
