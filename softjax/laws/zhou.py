"""Zhou's elastic–plastic law of two soft spheres.

Y. H. Zhou, Modeling of softsphere normal collisions with characteristic of coefficient of
restitution dependent on impact velocity, Theor. Appl. Mech. Lett. 3, 021003 (2013).

In the units of first yield, x = δ/δ_cr and forces in k δ_cr^{3/2}, with

    d = 3 δ_cr/(2A) = 2κ/3    what the plastic region takes from the elastic pressure
    X = χ̃ E/Y                 how steeply the plastic force unloads

π a_p² Y becomes d (x² - 1) and cos²θ = 1 - a_p²/a² becomes 1 - (2d/3)(x² - 1)/x.
"""

import math

import jax.numpy as jnp

from softjax.contact import Contact
from softjax.fields import Flags, Number, Numbers, choice_field, number_field
from softjax.laws._first_order import FirstOrder
from softjax.laws._full import Full
from softjax.laws.base import RateIndependentLaw
from softjax.laws.empirical import PSI, SIGMA, loss_exponent
from softjax.laws.reduced import Scales
from softjax.numerics.roots import compute_if_any


class Zhou(RateIndependentLaw, final=True):
    """Elastic–plastic loading, plastic unloading, acoustic and thermal losses, Zhou (2013).

    Loading is Hertz's until the peak pressure reaches Y; then a central region carries Y and the
    rim the rest of Hertz's pressure (Eqs. 6, 8). Unloading follows the elastic part and a straight
    line for the plastic one (Eqs. 11, 12). What is not plastic enters ε and no force:

        ε = ε_17(v)                           v <= v_cr  (Eq. 17)
        ε² = ε_p² + ε_17(v_cr)² - 1           v > v_cr   (Eq. 16)

    Not to be confused with `Thornton`, which lets the force grow linearly after yield and unloads
    along Hertz's law with a larger radius.

    Attributes:
        contact: the two bodies.
        chi: unloading factor χ̃ >= 0 [-] (Eq. 11); Eq. (18) takes χ̃ = c1 + c2 E/Y.
        sigma, psi: σ >= 0, ψ > 0 [-], the coefficients of Eq. (17).
        form: "first-order" in the plastic region's size (Eqs. 8 and 12, the paper's results) or
            "full" (Eqs. 6 and 11, cos³θ kept).
        kappa: "consistent", κ = π² b² Y²/k^{4/3} as the forces have it, or "printed",
            κ = 36 (π/2)^{8/3} (Y/E)², with which Table 1's χ̃ were found. They differ tenfold.

    Range: while the plastic radius is inside the contact radius, about d x_m < 1; beyond it the
    status says so.
    """

    jumps_at_yield = True  # ε_p² = 1 + 2d/3 just above

    contact: Contact
    chi: Number = number_field("χ̃", "-", "unloading factor", within="[0, inf)")
    sigma: Number = number_field(*SIGMA)
    psi: Number = number_field(*PSI)
    form: str = choice_field("first-order", "full")
    kappa: str = choice_field("consistent", "printed")

    def scales(self) -> Scales:
        """δ_cr and v_cr, Eq. (5)."""
        return Scales(self.contact.critical_overlap, self.contact.critical_velocity)

    def elastic_velocity(self):
        """v_cr [m/s], Eq. (5b)."""
        return self.contact.critical_velocity

    def plasticity(self):
        """d = 2κ/3 [-]."""
        if self.kappa == "printed":
            kappa = 36 * (math.pi / 2) ** (8 / 3) / self.contact.yield_ratio**2  # below Eq. (10)
            return 2 / 3 * kappa
        # 3 δ_cr/(2A): κ = π² b² Y²/k^{4/3} with the b that belongs to A
        return 1.5 * self.contact.yield_strain**2 / self.contact.area_factor

    def reduced(self) -> FirstOrder | Full:
        steepness = self.chi * self.contact.yield_ratio  # X = χ̃ E/Y
        law = FirstOrder if self.form == "first-order" else Full
        return law(jnp.asarray(self.plasticity()), jnp.asarray(steepness))

    def total_restitution(self, plastic_squared, velocity, elastic) -> tuple[Numbers, Flags]:
        """ε² by Eq. (16) above yield and Eq. (17) below, and whether v >= v_lim."""
        limit, critical = self.contact.limit_velocity, self.contact.critical_velocity
        limit, sigma, psi = (jnp.asarray(x) for x in (limit, self.sigma, self.psi))
        below_yield = 1 + compute_if_any(_lost, elastic, velocity, limit, sigma, psi)
        above_yield = plastic_squared + _lost(critical, limit, sigma, psi)  # Eq. (16)
        return jnp.where(elastic, below_yield, above_yield), velocity >= limit


def _lost(velocity, limit, sigma, psi) -> Numbers:
    """ε_17² - 1."""
    return jnp.expm1(-2 * loss_exponent(velocity, limit, sigma, psi))
