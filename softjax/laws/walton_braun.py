"""Walton and Braun's bilinear hysteretic spring."""

import jax
import jax.numpy as jnp
import numpy as np

from softjax.checks import ArgumentError, is_traced, shown
from softjax.contact import Contact
from softjax.fields import Flags, Number, Numbers, check_fields, number_field
from softjax.laws.base import RateIndependentLaw
from softjax.laws.reduced import Reduced, ReducedClosedForm, Scales


class WaltonBraun(RateIndependentLaw, final=True):
    """A linear spring on loading, a stiffer one on unloading.

        loading:    P = k1 δ
        unloading:  P = k2 (δ - δ*),  k2 = k20 + s P_max

    which gives

        ε = √(k1/k2),  P_max = v √(k1 M)    and so    ε = [k1/(k20 + s v √(k1 M))]^{1/2}

    Symbols: P force [N]; δ overlap, δ* = δ_max - P_max/k2 what remains of it [m];
    k1 = `loading_stiffness`, k20 = `unloading_stiffness` [N/m]; s = `growth` [1/m];
    M = `contact.mass` [kg]; v impact velocity [m/s].

    Not to be confused with `Thornton`, whose loading is Hertz's up to yield and which is elastic
    below a critical velocity; this law loses energy at every velocity.

    Attributes:
        contact: the two bodies; only their mass enters (the radius is the unit of length).
        loading_stiffness: k1 > 0 [N/m].
        unloading_stiffness: k20 >= k1 [N/m], k2 of the softest impact. Where tracing hides the
            values, k2 < k1 is computed as k2 = k1 and the status says `NO_RESIDUAL_OVERLAP`.
        growth: s >= 0 [1/m]; 0 (default) keeps k2, and with it ε, constant.

    Source: Walton and Braun, J. Rheol. 30, 949 (1986), where s is a pure number S because forces
    and overlaps are scaled.
    Range: an effective law for granular simulations; k1 is no property of the material.
    """

    contact: Contact
    loading_stiffness: Number = number_field("k1", "N/m", "stiffness", within="(0, inf)")
    unloading_stiffness: Number = number_field("k20", "N/m", "stiffness", within="(0, inf)")
    growth: Number = number_field("s", "1/m", "growth", within="[0, inf)", default=0.0)

    def __check_init__(self):
        check_fields(self)  # what is compared are numbers, or placeholders of JAX's own
        loading, unloading = both = self.loading_stiffness, self.unloading_stiffness
        known = all(
            isinstance(x, float | np.ndarray | jax.Array) and not is_traced(x) for x in both
        )
        if known and np.any(np.asarray(unloading) < np.asarray(loading)):
            raise ArgumentError(
                "`unloading_stiffness` must be at least `loading_stiffness` "
                f"({shown(loading)} N/m), but is {shown(unloading)}"
            )

    def scales(self) -> Scales:
        """R, and R √(k1/M)."""
        radius = jnp.asarray(self.contact.radius)
        frequency = jnp.sqrt(self.loading_stiffness) / jnp.sqrt(self.contact.mass)
        return Scales(radius, radius * frequency)

    def reduced(self) -> "ReducedWaltonBraun":
        return self._over(self.scales().overlap)

    def reduced_at(self, velocity: Numbers) -> Reduced:
        """In units of each impact: v √(M/k1), the largest overlap, and v."""
        radius, unit = self.scales()
        scales = Scales(radius * (velocity / unit), jnp.asarray(velocity))
        return Reduced(self._over(scales.overlap), scales, jnp.ones_like(scales.overlap))

    def _over(self, length) -> "ReducedWaltonBraun":
        ratio = jnp.asarray(self.unloading_stiffness) / self.loading_stiffness
        return ReducedWaltonBraun(ratio, jnp.asarray(self.growth) * length)


class ReducedWaltonBraun(ReducedClosedForm):
    """p_L = (4/5) x and p_U = (4/5) [x_m - K (x_m - x)] with K = k2/k1 = ratio + growth x_m."""

    work_exponent = 2.0
    elastic_limit = 0.0  # unloading differs from the first touch on
    powers_about = "residual-overlap"

    ratio: Numbers
    growth: Numbers

    def loading(self, x: Numbers) -> Numbers:
        return 0.8 * x

    def unloading(self, x: Numbers, peak: Numbers) -> Numbers:
        return self.unloading_at(x, peak - x, peak)

    def unloading_at(self, x: Numbers, recovered: Numbers, peak: Numbers) -> Numbers:
        return 0.8 * (peak - self._stiffening(peak) * recovered)

    def releases(self, peak: Numbers) -> Flags:
        return self.ratio + self.growth * peak >= 1

    def residual(self, peak: Numbers) -> Numbers:
        return jnp.maximum(peak - self.recovered(peak), 0.0)

    def peak(self, y: Numbers) -> Numbers:
        return y * jnp.ones_like(self.ratio)

    def release(self, peak: Numbers) -> tuple[Numbers, Numbers, Numbers]:
        recovered = self.recovered(peak)
        work = 0.8 * recovered * (peak - 0.5 * self._stiffening(peak) * recovered)
        return self.residual(peak), recovered, work

    def _stiffening(self, peak: Numbers) -> Numbers:
        """K = k2/k1, 1 at least."""
        stiffening = self.ratio + self.growth * peak
        return jnp.where(stiffening >= 1, stiffening, 1.0)

    def recovered(self, peak: Numbers) -> Numbers:
        """x_m - x*."""
        return peak / self._stiffening(peak)
