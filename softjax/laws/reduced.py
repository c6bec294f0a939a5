"""The reduced form of a law: what the routes integrate.

Overlap x in units of an overlap scale L, impact velocity y in units of a velocity scale V, time in
L/V and force in (5/4) M V²/L, so that every law obeys

    x'' = -(5/4) p(x),  x(0) = 0,  x'(0) = y        and        ∫ p dx = (2/5) y² up to the peak.

With Hertz's law and first yield as scales (L = δ_cr, V = v_cr) this is p = x^{3/2}.

    ReducedRateIndependent    loading and unloading force
    └── ReducedClosedForm     peak, release and work too, so that nothing is left to quadrature
    ReducedRateDependent      force of overlap and velocity, and where the contact ends
"""

from abc import abstractmethod
from typing import Any, ClassVar, Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from softjax.contact import Contact
from softjax.fields import Flags, Numbers
from softjax.numerics.powers import quotient, safe_power

End = Literal["zero-overlap", "zero-force"]  # where a contact with damping ends
ENDS = ("zero-overlap", "zero-force")
Origin = Literal["zero-overlap", "residual-overlap"]


class Scales(NamedTuple):
    """The units of a reduced collision."""

    overlap: Numbers  # L [m]
    velocity: Numbers  # V [m/s]

    @property
    def time(self) -> Numbers:
        """L/V [s]."""
        return quotient(self.overlap, self.velocity)


class Reduced(NamedTuple):
    """Impacts in the units of a law, ready for either route.

    Attributes:
        law: reduced.
        scales: its units.
        y: impact velocity over the velocity scale.
        speed_ratio: velocity over the one that y stands for, where squares of it would underflow; overlaps
            and times are scaled back by it. None: nowhere.
    """

    law: Any
    scales: Scales
    y: Numbers
    speed_ratio: Numbers | None = None


class ReducedRateIndependent(eqx.Module):
    """Forces of the overlap x and, on unloading, of its largest value x_m.

    Up to `elastic_limit` loading and unloading follow one power law with work (2/5) x^k,
    k = `work_exponent`: p = x^{3/2} with Hertz's 5/2, p = (4/5) x with the linear spring's 2.
    A law that never leaves this stage has the limit infinity, one without it 0.

    `powers_about` says at which overlap the unloading force is a series of half powers: √x, as
    Hertz's, or √(x - x*). By the ODE a law whose forces are given with their works is integrated
    in that root; all others in a variable that suits any power at either place.

    `rounding` says how exact its works are: how many rounding errors ε_p² of an elastic collision may be off.
    """

    work_exponent: ClassVar[float] = 2.5
    elastic_limit: ClassVar[float] = 1.0
    powers_about: ClassVar[Origin] = "zero-overlap"
    rounding: ClassVar[float] = 4.0

    @abstractmethod
    def loading(self, x: Numbers) -> Numbers:
        """p_L(x) >= 0 for 0 <= x <= `end()`."""

    @abstractmethod
    def unloading(self, x: Numbers, peak: Numbers) -> Numbers:
        """p_U(x; x_m), equal to p_L(x_m) at x = x_m."""

    def unloading_at(self, x: Numbers, recovered: Numbers, peak: Numbers) -> Numbers:
        """p_U(x; x_m) with x_m - x known to its own precision, which nearly plastic impacts need."""
        return self.unloading(x, peak)

    def breakpoints(self) -> tuple:
        """Overlaps at which a force has a kink, except the elastic limit; each broadcasts."""
        return ()

    def residual(self, peak: Numbers) -> Numbers | None:
        """x*, the last zero of the unloading force below the peak; None leaves it to search."""
        return None

    def recovered(self, peak: Numbers) -> Numbers | None:
        """x_m - x* where the law knows it to better precision than the difference."""
        return None

    def releases(self, peak: Numbers) -> Flags | None:
        """Whether the unloading force vanishes at some positive overlap; None: as is found."""
        return None

    def exponent_at(self, peak: Numbers) -> Numbers | float:
        """The exponent k of the law's work, with which overlaps of slow impacts follow from those of faster ones."""
        return self.work_exponent

    def end(self) -> Numbers | float:
        """The overlap at which the loading force vanishes or ends; infinite where it never does."""
        return jnp.inf

    def on_loading(self) -> "ReducedRateIndependent":
        """The same, without the derivatives of numbers that act on unloading alone."""
        return self

    def beyond_expansion(self, peak: Numbers) -> Flags:
        """Whether the law was pushed beyond the range it was derived for."""
        return jnp.zeros_like(peak, dtype=bool)


class ReducedClosedForm(ReducedRateIndependent):
    """A rate-independent law whose collisions are known in closed form, with its forces.

    Both forces are smooth beyond the elastic limit, or `breakpoints` says where they are not.
    """

    def largest_velocity(self) -> Numbers:
        """y_max, from which on the bodies do not come to rest: W_L(end) = (2/5) y_max²; infinite without an end."""
        return jnp.asarray(jnp.inf)

    @abstractmethod
    def peak(self, y: Numbers) -> Numbers:
        """x_m with W_L(x_m) = (2/5) y², for 1 <= y < y_max."""

    @abstractmethod
    def release(self, peak: Numbers) -> tuple[Numbers, Numbers, Numbers]:
        """Residual overlap x* (p_U(x*) = 0, or 0), what is recovered x_m - x*, and its work.

        The difference is given with its terms because it would cancel where x* nears x_m.
        """


class ReducedRateDependent(eqx.Module):
    """An elastic force with work (2/5) x^k, k = `work_exponent`, and one that takes energy.

    `ends_at` says where the contact ends: where the overlap vanishes again, or where the damping
    force cancels the elastic one, whichever comes first. For the latter their ratio should grow
    throughout unloading, or fall slowly; it grows where |p_D|/(|x'| x^{k-1}) falls with x.
    """

    work_exponent: ClassVar[float] = 2.5
    ends_at: eqx.AbstractVar[str]

    @abstractmethod
    def dissipative(self, x: Numbers, velocity: Numbers) -> Numbers:
        """p_D(x, x'), of the sign of x' and zero with it."""

    def elastic(self, x: Numbers) -> Numbers:
        """p_E(x)."""
        return 0.4 * self.work_exponent * safe_power(x, self.work_exponent - 1)

    def force(self, x: Numbers, velocity: Numbers) -> Numbers:
        """p(x, x') = p_E + p_D."""
        return self.elastic(x) + self.dissipative(x, velocity)

    def exponent_at(self, peak: Numbers) -> Numbers | float:
        """The exponent k of the elastic work, with which overlaps of slow impacts follow from those of faster ones."""
        return self.work_exponent


def rescaled_slow(law, scales: Scales, velocity: Numbers) -> Reduced:
    """Impacts of a law in units that are the same for all, slow ones faster, whose squares would underflow.

    Laws without an elastic stage act down to rest; near it they follow their elastic power law, by
    which overlaps and times of the faster collision are scaled back.
    """
    y = velocity / scales.velocity
    if getattr(law, "elastic_limit", 0.0) > 0:
        return Reduced(law, scales, y)
    tiny = float(jnp.finfo(y.dtype).tiny)
    # derivatives of works over y² meet y³; those of a damped collision y²
    least = tiny ** (0.25 if isinstance(law, ReducedRateIndependent) else 0.4)
    return Reduced(law, scales, jnp.maximum(y, least), jnp.minimum(y / least, 1.0))


def hertz_scales(contact: Contact) -> Scales:
    """L = R and V = √(4k/5M) R^{5/4}: units in which Hertz's law is x'' = -(5/4) x^{3/2}.

    First yield is no part of these laws, so that their units cannot be those of yield.
    """
    radius = jnp.asarray(contact.radius)
    # a quotient of roots: the derivative of one by M leaves float32's range at M = 1e-20 kg
    root = radius * jnp.sqrt(radius) / jnp.sqrt(contact.mass)
    return Scales(radius, jnp.sqrt(16 / 15 * contact.youngs_modulus) * root)


class HertzMotion(NamedTuple):
    """Hertz's collisions, for whatever v is a number.

    Attributes:
        overlap: the largest one, L [m].
        time: L/v [s], R/V over the rate.
        rate: (v/V)^{1/5}, time's inverse over that at V.
        whole: R and V.
    """

    overlap: Numbers
    time: Numbers
    rate: Numbers
    whole: Scales


def hertz_motion(contact: Contact, velocity: Numbers) -> HertzMotion:
    """Of impacts at v [m/s], by one power."""
    whole = hertz_scales(contact)
    rate = _fifth_root(velocity) / _fifth_root(whole.velocity)
    time = quotient(whole.time, jnp.where(rate > 0, rate, 1.0))
    return HertzMotion(whole.overlap * rate**4, time, rate, whole)


@jax.custom_jvp
def _fifth_root(x: Numbers) -> Numbers:
    """x^{1/5} of x >= 0; where its derivatives would leave the range of numbers they are 0."""
    return safe_power(x, 0.2)


@_fifth_root.defjvp
def _fifth_root_jvp(values, tangents):
    (x,), (change,) = values, tangents
    root = _fifth_root(x)
    # second derivatives of times meet x^{-2.2}
    moves = x > float(jnp.finfo(x.dtype).tiny) ** 0.4
    slope = quotient(0.2 * jnp.where(moves, root, 1.0), jnp.where(moves, x, 1.0))
    return root, slope * jnp.where(moves, change, 0.0)


def hertz_scales_at(contact: Contact, velocity) -> Scales:
    """V = v and L the largest overlap of Hertz's collision at v > 0: every impact in units of its own.

    Where a law knows no scale, neither the slowest impact nor the fastest leaves a number's range.
    """
    whole = hertz_scales(contact)
    return Scales(whole.overlap * (velocity / whole.velocity) ** 0.8, jnp.asarray(velocity))
