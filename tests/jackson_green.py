"""Jackson and Green's law of a sphere on a rigid flat, from its publications, in newtons and metres.

Loading: R. L. Jackson and I. Green, A finite element study of elasto-plastic hemispherical contact
against a rigid flat, J. Tribol. 127, 343 (2005). What remains: R. Jackson, I. Chusoipin and
I. Green, A finite element study of the residual stress and deformation in hemispherical contacts,
J. Tribol. 127, 484 (2005). Back: Hertz's law of a larger radius. ε fitted to their collisions:
R. L. Jackson, I. Green and D. B. Marghitu, Predicting the coefficient of restitution of impacting
elastic-perfectly plastic spheres, Nonlinear Dyn. 60, 217 (2010).
"""

import jax.numpy as jnp
import numpy as np

import softjax as sj


class JacksonGreen(sj.RateIndependentLaw):
    """F/F_c = e^{-w^{5/12}/4} w^{3/2} + (4 H/C Y)(1 - e^{-w^{5/9}/25}) w beyond w = δ/δ_c = 1.9.

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
    """ε over v/v_c for Y/E < 0.008, fitted by its authors to 1 <= v/v_c <= 1000."""
    ratio = np.maximum(ratio, 1.0)
    slow = 1 - 0.1 * np.log(ratio) * ((ratio - 1) / 59) ** 0.156
    over = np.maximum(ratio, 60.0)
    fast = 1 - 0.1 * np.log(60) - 0.11 * np.log(over / 60) * (over - 60) ** (2.36 * yield_strain)
    return np.where(ratio < 60, slow, fast)
