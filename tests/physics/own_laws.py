"""Laws as users write them: the library's own in newtons and metres, and one from the literature."""

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


class JacksonGreen(sj.RateIndependentLaw):
    """A sphere on a rigid flat, J. Tribol. 127, 343 and 484 (2005); back along a larger Hertz's.

    F/F_c = e^{-w^{5/12}/4} w^{3/2} + (4 H/C Y)(1 - e^{-w^{5/9}/25}) w beyond w = δ/δ_c = 1.9.

    With C = 1.295 e^{0.736 ν}, δ_c = (π C Y/2E)² R and H/Y = 2.84 [1 - e^{-0.82 (a/R)^{-0.7}}]; back
    by F_m [(δ - δ*)/(δ_m - δ*)]^{3/2}, δ* = 1.02 δ_m [1 - ((w_m + 5.9)/6.9)^{-0.54}].
    """

    contact: sj.Contact
    poisson_ratio: float

    def factor(self):
        """C: the peak pressure at first yield is C Y."""
        return 1.295 * jnp.exp(0.736 * self.poisson_ratio)

    def strain(self):
        """a/R = √(δ_c/R) at first yield."""
        return (
            0.5 * jnp.pi * self.factor() * self.contact.yield_strength / self.contact.youngs_modulus
        )

    def critical_overlap(self):
        return self.strain() ** 2 * self.contact.radius

    def critical_force(self):
        return self.contact.stiffness * self.critical_overlap() ** 1.5

    def elastic_overlap(self):
        return 1.9 * self.critical_overlap()

    def loading_force(self, overlap):
        w = jnp.maximum(overlap / self.critical_overlap(), 1.9)
        growth = 0.07 * jnp.exp(23 * self.contact.yield_strength / self.contact.youngs_modulus)
        radius = self.strain() * jnp.sqrt(w) * (w / 1.9) ** growth  # a/R
        hardness = 2.84 * (1 - jnp.exp(-0.82 * radius**-0.7))  # H/Y
        elastic = jnp.exp(-0.25 * w ** (5 / 12)) * w**1.5
        plastic = 4 * hardness / self.factor() * (1 - jnp.exp(-(w ** (5 / 9)) / 25)) * w
        yields = overlap > self.elastic_overlap()
        hertz = self.contact.stiffness * overlap**1.5
        return jnp.where(yields, self.critical_force() * (elastic + plastic), hertz)

    def residual_overlap(self, peak_overlap):
        w = peak_overlap / self.critical_overlap()
        return 1.02 * peak_overlap * (1 - ((w + 5.9) / 6.9) ** -0.54)

    def unloading_force(self, overlap, peak_overlap):
        rest = self.residual_overlap(peak_overlap)
        share = jnp.maximum((overlap - rest) / (peak_overlap - rest), 0.0)
        return self.loading_force(peak_overlap) * share**1.5


def published_fit(ratio, yield_strain):
    """ε over v/v_c for Y/E < 0.008, fitted by its authors to 1 <= v/v_c <= 1000.

    R. L. Jackson, I. Green and D. B. Marghitu, Nonlinear Dyn. 60, 217 (2010).
    """
    ratio = np.maximum(ratio, 1.0)
    slow = 1 - 0.1 * np.log(ratio) * ((ratio - 1) / 59) ** 0.156
    over = np.maximum(ratio, 60.0)
    fast = 1 - 0.1 * np.log(60) - 0.11 * np.log(over / 60) * (over - 60) ** (2.36 * yield_strain)
    return np.where(ratio < 60, slow, fast)
