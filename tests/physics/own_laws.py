"""Laws of a user's: the library's forces in newtons, and one whose restitution is known."""

import jax.numpy as jnp

import softjax as sj


class Hardening(sj.RateIndependentLaw):
    """Hertz's loading; unloads along an ever higher power: ε² = 2.5/(2.5 + δ_max/length)."""

    contact: sj.Contact
    length: float = 1e-4

    def loading_force(self, overlap):
        return self.contact.stiffness * sj.power_3_2(overlap)

    def unloading_force(self, overlap, peak_overlap):
        power = 1.5 + peak_overlap / self.length
        return self.loading_force(peak_overlap) * (overlap / peak_overlap) ** power


class Borrowed(sj.RateIndependentLaw):
    contact: sj.Contact
    law: sj.RateIndependentLaw

    def elastic_overlap(self):
        velocity = self.law.elastic_velocity()
        yields = (velocity > 0) & (velocity < jnp.inf)
        impact = 1.25 * self.contact.mass * jnp.where(yields, velocity, 0.0) ** 2
        return (impact / self.contact.stiffness) ** 0.4

    def loading_force(self, overlap):
        return self.law.loading_force(overlap)

    def unloading_force(self, overlap, peak_overlap):
        return self.law.unloading_force(overlap, peak_overlap)
