"""Thornton's elastic–perfectly plastic law of two spheres.

In the units of first yield, x = δ/δ_y and forces in k δ_y^{3/2}, nothing is left but y = v/V_y.
"""

from dataclasses import replace
from typing import Literal

import jax.numpy as jnp
from jaxtyping import ArrayLike, Float

from softjax.contact import Contact
from softjax.fields import Flags, Number, Numbers, choice_field, number_field
from softjax.laws.base import RateIndependentLaw
from softjax.laws.reduced import ReducedClosedForm, Scales
from softjax.numerics.powers import power_3_2, quotient

Area = Literal["hertz", "contact"]
AREAS = ("hertz", "contact")


class Thornton(RateIndependentLaw, final=True):
    """Hertz's force up to yield, a straight line beyond, Hertz's with a larger radius back.

        loading, δ <= δ_y:  P = k δ^{3/2}
        loading, δ > δ_y:   P = P_y + π p_y R (δ - δ_y)
        unloading:          P = 4/3 E √R_p (δ - δ*)^{3/2},  R_p = R k δ_max^{3/2}/P_max
        with                δ_y = R (π p_y/2E)²,  V_y = √(4k/5M) δ_y^{5/4}

    which gives, with r = V_y/v < 1,

        ε = √(6√3/5) √(1 - r²/6) [r/(r + 2√(6/5 - r²/5))]^{1/4}      (`thornton_restitution`)

    Symbols: P force [N]; δ overlap, δ* what remains of it [m]; k, E, R, M:
    `contact.stiffness` [N/m^1.5], `.youngs_modulus` [Pa], `.radius` [m], `.mass` [kg];
    p_y = `yield_factor` · `contact.yield_strength`, the limiting contact pressure [Pa].

    Not to be confused with `WaltonBraun`, which is linear from the first touch on, or with `Zhou`,
    where loading after yield is no straight line and unloading steepens with the factor χ̃.

    Attributes:
        contact: the two bodies.
        yield_factor: p_y/Y [-], > 0; 1 by default, 1.6 (first yield below the surface) to 2.8
            (indentation hardness) in the literature. V_y grows with its power 5/2.
        area: "hertz" (default), V_y of Hertz's contact area whatever `contact.area` is: what the
            formula's author means; or "contact", V_y the critical velocity of the contact as it
            is, for comparison with laws that yield there.

    Source: Thornton, J. Appl. Mech. 64, 383 (1997).
    Range: no hardening, and plastic deformation confined to the contact region. For v far above
    V_y it gives ε ∝ v^{-1/4}.
    """

    contact: Contact
    yield_factor: Number = number_field(
        "p_y/Y", "-", "factor of the yield strength", within="(0, inf)", default=1.0
    )
    area: Area = choice_field(*AREAS)

    def scales(self) -> Scales:
        """δ_y and V_y."""
        # the contact that first yields at the pressure p_y, of the requested area
        yielding = replace(
            self.contact,
            yield_strength=self.yield_factor * self.contact.yield_strength,
            area="hertz" if self.area == "hertz" else self.contact.area,
        )
        return Scales(yielding.critical_overlap, yielding.critical_velocity)

    def reduced(self) -> "ReducedThornton":
        return ReducedThornton()


def thornton_restitution(
    contact: Contact,
    velocity: Float[ArrayLike, "..."],
    yield_factor: Number = 1.0,
    area: Area = "hertz",
) -> Numbers:
    """ε = √(6√3/5) √(1 - r²/6) [r/(r + 2√(6/5 - r²/5))]^{1/4}, r = V_y/v; 1 for v <= V_y.

    The closed form of Thornton, J. Appl. Mech. 64, 383 (1997), by its force law `Thornton`.

    Args:
        contact: the two bodies.
        velocity: relative impact velocity v >= 0 [m/s], a number or an array of any shape.
        yield_factor: contact yield pressure p_y as a factor of the contact's yield strength [-].
        area: "hertz": V_y is the critical velocity of Hertz's contact area; "contact": that of
            `contact` as it is.

    Returns:
        The coefficient of restitution [-], of the broadcast shape; gradient 0 for v <= V_y.

    Raises:
        ValueError: naming the argument, its value and what is accepted. Under `jit` nothing is
            raised: there 0 with gradient 0 marks invalid arguments.
    """
    import softjax  # which is built on laws

    return softjax.restitution(Thornton(contact, yield_factor, area), velocity).coefficient


class ReducedThornton(ReducedClosedForm):
    """p_L = x^{3/2}, then 1 + (3/2)(x - 1); p_U = p_m [(x - x*)/(x_m - x*)]^{3/2}.

    x_m - x* = p_m/√x_m: the contact radius at the peak is that of both loading and unloading.
    """

    powers_about = "residual-overlap"

    def loading(self, x: Numbers) -> Numbers:
        return jnp.where(x > 1, 1 + 1.5 * (x - 1), power_3_2(jnp.minimum(x, 1.0)))

    def unloading(self, x: Numbers, peak: Numbers) -> Numbers:
        return self.unloading_at(x, peak - x, peak)

    def unloading_at(self, x: Numbers, recovered: Numbers, peak: Numbers) -> Numbers:
        return self.loading(peak) * power_3_2(1 - recovered / self.recovered(peak))

    def releases(self, peak: Numbers) -> Flags:
        return jnp.ones_like(peak, dtype=bool)  # at yield too, where x* rounds to zero

    def residual(self, peak: Numbers) -> Numbers:
        excess = jnp.maximum(peak - 1, 0.0) / (jnp.sqrt(peak) + 1)  # √x_m - 1
        # x_m^{3/2} - p_m, its cancelling terms multiplied out
        return excess * excess * ((excess + 1.5) / jnp.sqrt(peak))

    def peak(self, y: Numbers) -> Numbers:
        slow = quotient(1.0, y)  # the square of y itself leaves float32's range at 1e19
        force = y * jnp.sqrt(1.2 - 0.2 * slow * slow)  # p_m
        return 1 + 0.8 * (y - 1) * quotient(y + 1, force + 1)

    def release(self, peak: Numbers) -> tuple[Numbers, Numbers, Numbers]:
        recovered = self.recovered(peak)
        return self.residual(peak), recovered, 0.4 * self.loading(peak) * recovered

    def recovered(self, peak: Numbers) -> Numbers:
        """x_m - x*."""
        return self.loading(peak) / jnp.sqrt(peak)
