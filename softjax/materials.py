"""Materials: what a body is made of, and the three of Zhou's Table 1."""

import equinox as eqx
from jaxtyping import ArrayLike, Float

from softjax._checks import as_real, check, check_broadcast, check_positive

Field = Float[ArrayLike, "..."]


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

    youngs_modulus: Field = eqx.field(converter=as_real)
    poisson_ratio: Field = eqx.field(converter=as_real)
    density: Field = eqx.field(converter=as_real)
    yield_strength: Field = eqx.field(converter=as_real)

    def __check_init__(self):
        check_positive("youngs_modulus", self.youngs_modulus, "modulus in pascals")
        check(
            "poisson_ratio",
            self.poisson_ratio,
            lambda nu: (nu > -1) & (nu <= 0.5),
            "a number in (-1, 0.5]",
        )
        check_positive("density", self.density, "density in kg/m³")
        check_positive("yield_strength", self.yield_strength, "strength in pascals")
        check_broadcast(self.leaves())

    def leaves(self) -> dict[str, Field]:
        """The four properties by name."""
        names = ("youngs_modulus", "poisson_ratio", "density", "yield_strength")
        return {name: getattr(self, name) for name in names}


# Zhou, Theor. Appl. Mech. Lett. 3, 021003 (2013), Table 1. The nylon's modulus is the bulk value;
# the paper notes that it is about ten times the one of the measurements' own source.
STAINLESS_STEEL = Material(1.93e11, 0.35, 8030.0, 3.10e8)
CHROME_STEEL = Material(2.03e11, 0.28, 7830.0, 2.03e9)
NYLON = Material(2.5e9, 0.30, 1140.0, 4.0e7)
