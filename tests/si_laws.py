"""The library's laws as a user would write them: forces in newtons over overlaps in metres."""

import jax.numpy as jnp
import numpy as np

import softjax as sj
from tests.cases import pair

STEEL = pair("stainless steel", area="hertz")


class HertzSI(sj.RateIndependentLaw):
    contact: sj.Contact

    def loading_force(self, overlap):
        return self.contact.stiffness * overlap**1.5  # as most people would

    def unloading_force(self, overlap, peak_overlap):
        return self.contact.stiffness * overlap**1.5


class ThorntonSI(sj.RateIndependentLaw):
    """A straight line beyond yield, back along Hertz's law of a larger radius."""

    contact: sj.Contact
    yield_factor: float

    def pressure(self):
        return self.yield_factor * self.contact.yield_strength

    def elastic_overlap(self):
        c = self.contact
        return c.radius * (np.pi * self.pressure() / (2 * c.youngs_modulus)) ** 2

    def loading_force(self, overlap):
        c, start = self.contact, self.elastic_overlap()
        beyond = c.stiffness * start**1.5 + np.pi * self.pressure() * c.radius * (overlap - start)
        return jnp.where(overlap > start, beyond, c.stiffness * sj.power_3_2(overlap))

    def unloading_force(self, overlap, peak_overlap):
        c, peak = self.contact, self.loading_force(peak_overlap)
        radius = c.radius * c.stiffness * sj.power_3_2(peak_overlap) / peak
        stiffness = 4 / 3 * c.youngs_modulus * jnp.sqrt(radius)
        rest = peak_overlap - (peak / stiffness) ** (2 / 3)
        return stiffness * sj.power_3_2(overlap - rest)


class WaltonBraunSI(sj.RateIndependentLaw):
    contact: sj.Contact
    loading_stiffness: float
    unloading_stiffness: float
    growth: float

    def loading_force(self, overlap):
        return self.loading_stiffness * overlap

    def unloading_force(self, overlap, peak_overlap):
        peak = self.loading_stiffness * peak_overlap
        stiffness = self.unloading_stiffness + self.growth * peak
        return peak - stiffness * (peak_overlap - overlap)


class ZhouSI(sj.RateIndependentLaw):
    """The first-order form, Eqs. (8) and (12) with π a_p² Y = k δ_cr^{3/2} d (x² - 1)."""

    contact: sj.Contact
    chi: float

    def elastic_overlap(self):
        return self.contact.critical_overlap

    def unit(self):
        return self.contact.stiffness * self.contact.critical_overlap**1.5

    def size(self):
        """d."""
        return 1.5 * self.contact.yield_strain**2 / self.contact.area_factor

    def loading_force(self, overlap):
        x = overlap / self.contact.critical_overlap
        yielded = self.size() * (x**2 - 1) * (1 - jnp.sqrt(x))
        return self.unit() * (sj.power_3_2(x) + jnp.where(x > 1, yielded, 0.0))

    def unloading_force(self, overlap, peak_overlap):
        d, steep = self.size(), self.chi * self.contact.yield_ratio
        x, peak = (length / self.contact.critical_overlap for length in (overlap, peak_overlap))
        elastic = (1 - d * peak) * sj.power_3_2(x) + d * jnp.sqrt(x)
        return self.unit() * (elastic + d * (peak**2 - 1) * (1 - steep * (1 - x / peak)))


class ViscoelasticSI(sj.RateDependentLaw):
    contact: sj.Contact
    dissipation_time: float
    end = "zero-force"

    def force(self, overlap, velocity):
        damped = 1.5 * self.dissipation_time * jnp.sqrt(overlap) * velocity
        return self.contact.stiffness * (sj.power_3_2(overlap) + damped)


PAIRS = {
    "hertz": (HertzSI(STEEL), sj.Hertz(STEEL)),
    "thornton": (ThorntonSI(STEEL, 1.6), sj.Thornton(STEEL, 1.6)),
    "walton-braun": (WaltonBraunSI(STEEL, 1e6, 2e6, 1e3), sj.WaltonBraun(STEEL, 1e6, 2e6, 1e3)),
    "zhou": (ZhouSI(STEEL, 1.7944), sj.Zhou(STEEL, 1.7944, 0.0, 1.0)),
    "viscoelastic": (ViscoelasticSI(STEEL, 1e-6), sj.ViscoelasticHertz(STEEL, 1e-6)),
}
