"""What a contact law gives, and so which route to the restitution it can take.

A law speaks SI. What the routes integrate is its *reduced* form: overlap x in units of the law's
overlap scale L, impact velocity y in units of its velocity scale V, time in L/V and force in
(5/4) M V²/L, so that every law obeys

    x'' = -(5/4) p(x),  x(0) = 0,  x'(0) = y        and        ∫ p dx = (2/5) y² up to the peak.

With Hertz's law and first yield as scales (L = δ_cr, V = v_cr) this is p = x^{3/2}.

    ContactLaw
    ├── RateIndependentLaw    force depends on the overlap and its peak: energy balance or ODE
    ├── RateDependentLaw      force depends on the velocity as well: ODE only
    └── HardSphereLaw         no force, only ε(v): nothing to integrate, no history, no contact

    ReducedRateIndependent    loading and unloading force
    └── ReducedClosedForm     their works and roots too, so that nothing is left to quadrature
    ReducedRateDependent      elastic and dissipative(overlap, velocity) force, and where they end

Numbers, options and whole fields of a law are declared (`softjax.fields`): their checks, validity
under tracing, and what a fit knows of them follow from that.
"""

from abc import abstractmethod
from typing import Any, ClassVar, Literal, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from softjax._checks import check_type
from softjax._numerics import safe_power
from softjax.contact import Contact
from softjax.fields import are_valid, check_fields

End = Literal["zero-overlap", "zero-force"]  # where a contact with damping ends
ENDS = ("zero-overlap", "zero-force")


class Scales(NamedTuple):
    """The units of a reduced collision."""

    overlap: Array  # L [m]
    velocity: Array  # V [m/s]

    @property
    def time(self) -> Array:
        """L/V [s]."""
        return self.overlap / self.velocity


class Outcome(NamedTuple):
    """A collision in reduced variables, as either route computes it."""

    peak: Array  # x_m, the largest overlap
    residual: Array  # x*, where the unloading force vanishes; 0 where it does not
    plastic_squared: Array  # ε_p², the part of the impact energy that the force gives back
    turns: Array  # whether the bodies ever come to rest against each other


class ReducedRateIndependent(eqx.Module):
    """Forces of the overlap x and, on unloading, of its largest value x_m.

    Up to `elastic_limit` loading and unloading follow one power law with work (2/5) x^k,
    k = `work_exponent`: p = x^{3/2} with Hertz's 5/2, p = (4/5) x with the linear spring's 2.
    A law that never leaves this stage has the limit infinity, one without it 0.
    """

    work_exponent: ClassVar[float] = 2.5
    elastic_limit: ClassVar[float] = 1.0

    @abstractmethod
    def loading(self, x: Array) -> Array:
        """p_L(x) >= 0 for 0 <= x <= `end()`."""

    @abstractmethod
    def unloading(self, x: Array, peak: Array) -> Array:
        """p_U(x; x_m), equal to p_L(x_m) at x = x_m."""

    def releases(self, peak: Array) -> Array:
        """Whether the unloading force vanishes at some positive overlap."""
        return self.unloading(jnp.zeros_like(peak), peak) < 0

    def residual(self, peak: Array) -> Array | None:
        """x* where the law writes its unloading force about it; None leaves its root to search."""
        return None

    def end(self) -> Array:
        """The overlap at which the loading force vanishes or ends; infinite where it never does."""
        return jnp.asarray(jnp.inf)

    def beyond_expansion(self, peak: Array) -> Array:
        """Whether the law was pushed beyond the range it was derived for."""
        return jnp.zeros_like(peak, dtype=bool)


class ReducedClosedForm(ReducedRateIndependent):
    """A rate-independent law whose works and roots are known, beside its forces."""

    @abstractmethod
    def loading_work(self, x: Array) -> Array:
        """W_L(x) = ∫_0^x p_L dx."""

    @abstractmethod
    def largest_velocity(self) -> Array:
        """y_max, from which on no collision turns: W_L(end) = (2/5) y_max²."""

    @abstractmethod
    def peak(self, y: Array) -> Array:
        """x_m with W_L(x_m) = (2/5) y², for 1 <= y < y_max."""

    @abstractmethod
    def release(self, peak: Array) -> tuple[Array, Array, Array]:
        """Residual overlap x* (p_U(x*) = 0, or 0), what is recovered x_m - x*, and its work.

        The difference is given beside its terms because it would cancel where x* nears x_m.
        """

    @abstractmethod
    def unloading_work(self, peak: Array, recovered: Array) -> Array:
        """∫ p_U dx from x_m - recovered to x_m."""


class ReducedRateDependent(eqx.Module):
    """An elastic force with work (2/5) x^k, k = `work_exponent`, and one that takes energy.

    `ends_at` says where the contact ends: where the overlap vanishes again, or where the damping
    force cancels the elastic one. For the latter their ratio must grow throughout unloading; it
    does where |p_D|/(|x'| x^{k-1}) falls with x.
    """

    work_exponent: ClassVar[float] = 2.5
    ends_at: eqx.AbstractVar[str]

    @abstractmethod
    def dissipative(self, x: Array, velocity: Array) -> Array:
        """p_D(x, x'), of the sign of x' and zero with it."""

    def elastic(self, x: Array) -> Array:
        """p_E(x)."""
        return 0.4 * self.work_exponent * safe_power(x, self.work_exponent - 1)

    def force(self, x: Array, velocity: Array) -> Array:
        """p(x, x') = p_E + p_D."""
        return self.elastic(x) + self.dissipative(x, velocity)


class ContactLaw(eqx.Module):
    """A contact law of two bodies, in SI units.

    Subclass `RateIndependentLaw`, `RateDependentLaw` or `HardSphereLaw`, not this. Whatever numbers
    and options a law has are dataclass fields, best declared (`softjax.fields`).

    Raises:
        ValueError: naming the field, its value and what is accepted.
    """

    def __check_init__(self):
        check_fields(self)

    @abstractmethod
    def scales(self) -> Scales:
        """The overlap [m] and velocity [m/s] in which the reduced law is written."""

    def is_valid(self) -> Array:
        """Whether all fields are numbers the law accepts (where tracing kept them unchecked)."""
        return are_valid(self)

    def total_restitution(self, plastic_squared, velocity, elastic) -> tuple[Array, Array]:
        """ε² from ε_p², and whether a loss outside the force law is at its limit.

        A law that knows of no losses but those of its force gives back what it was given.
        """
        return plastic_squared, jnp.zeros_like(elastic)


class ForceLaw(ContactLaw):
    """A law with a force: what both kinds of it have."""

    contact: eqx.AbstractVar[Contact]

    def __check_init__(self):
        check_type("contact", self.contact, Contact, "a Contact")

    @abstractmethod
    def reduced(self) -> Any:
        """The law in the units of `scales`."""

    def force_scale(self):
        """(5/4) M V²/L [N]."""
        scales = self.scales()
        return 1.25 * self.contact.mass * scales.velocity * (scales.velocity / scales.overlap)


class RateIndependentLaw(ForceLaw):
    """A law whose force depends on the overlap and its largest value: either route.

    `jumps_at_yield` says whether ε jumps where an impact leaves the elastic stage. A search that
    moves what yield depends on then holds every impact on its branch during a step.
    """

    jumps_at_yield: ClassVar[bool] = False

    @abstractmethod
    def reduced(self) -> ReducedRateIndependent:
        """The law in the units of `scales`."""

    def elastic_velocity(self) -> Array:
        """The impact velocity [m/s] up to which nothing yields; infinite or 0 for laws without."""
        reduced = self.reduced()
        limit = reduced.elastic_limit ** (reduced.work_exponent / 2)
        return jnp.asarray(self.scales().velocity) * limit

    def loading_force(self, overlap) -> Array:
        """Contact force [N] on loading at `overlap` [m]."""
        x = jnp.asarray(overlap) / self.scales().overlap
        return self.force_scale() * self.reduced().loading(x)

    def unloading_force(self, overlap, peak_overlap) -> Array:
        """Contact force [N] on unloading at `overlap` [m] after the largest overlap [m]."""
        length = self.scales().overlap
        x, peak = jnp.asarray(overlap) / length, jnp.asarray(peak_overlap) / length
        return self.force_scale() * self.reduced().unloading(x, peak)


class RateDependentLaw(ForceLaw):
    """A law whose force depends on the velocity too: no energy balance, only the ODE."""

    @abstractmethod
    def reduced(self) -> ReducedRateDependent:
        """The law in the units of `scales`."""

    def force(self, overlap, velocity) -> Array:
        """Contact force [N] at `overlap` [m] and its rate `velocity` [m/s]."""
        scales = self.scales()
        x, u = jnp.asarray(overlap) / scales.overlap, jnp.asarray(velocity) / scales.velocity
        return self.force_scale() * self.reduced().force(x, u)


class HardSphereLaw(ContactLaw):
    """A law that gives ε without a force: instantaneous, without overlap, without a history."""

    @abstractmethod
    def restitution_squared(self, velocity: Array) -> Array:
        """ε² at the impact velocity v > 0 [m/s]."""

    def limit(self) -> Array:
        """The velocity [m/s] from which on the law has no value but 0; infinite without one."""
        return jnp.asarray(jnp.inf)

    def total_restitution(self, plastic_squared, velocity, elastic) -> tuple[Array, Array]:
        return plastic_squared, velocity >= self.limit()

    def scales(self) -> Scales:
        """No scale enters."""
        return Scales(jnp.asarray(1.0), jnp.asarray(1.0))
